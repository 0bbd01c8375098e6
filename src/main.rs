//! The `rebond` command.

use clap::Parser;
use rebond::cli::{Cli, execute};
use std::process::ExitCode;

fn main() -> ExitCode {
    match execute(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("rebond: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
