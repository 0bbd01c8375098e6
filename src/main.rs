//! The `rebond` command.

use rebond::cli::{Cli, execute, launch};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::read(std::env::args_os()) {
        Ok(cli) => cli,
        // The first process alone prints help and the version, which are no errors.
        Err(why) if why.exit_code() == 0 && launch::rank() > 0 => return ExitCode::SUCCESS,
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
