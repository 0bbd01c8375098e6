//! The `rebond` command.

use rebond::cli::{Cli, execute, launch};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::read(std::env::args_os()) {
        Ok(cli) => cli,
        Err(why) => {
            launch::wait_turn();
            why.exit()
        }
    };
    match execute(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            launch::wait_turn();
            eprintln!("rebond: {error}");
            ExitCode::from(error.exit_code())
        }
    }
}
