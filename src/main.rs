//! The `rebond` command.

use rebond::Error;
use rebond::cli::{Cli, execute, launch};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = match Cli::read(std::env::args_os()) {
        Ok(cli) => cli,
        // Help and the version are no errors, and printed once.
        Err(why) if why.exit_code() == 0 => match launch::prints() {
            Ok(true) => why.exit(),
            Ok(false) => return ExitCode::SUCCESS,
            Err(error) => return report(&error),
        },
        Err(why) => {
            launch::wait_turn();
            why.exit()
        }
    };
    execute(&cli).map_or_else(|error| report(&error), |()| ExitCode::SUCCESS)
}

/// Prints an error once for all processes, and returns its exit code.
fn report(error: &Error) -> ExitCode {
    launch::wait_turn();
    eprintln!("rebond: {error}");
    ExitCode::from(error.exit_code())
}
