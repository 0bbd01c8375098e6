//! The `rebond` command.

use rebond::Error;
use rebond::cli::{Cli, execute, launch};
use std::process::ExitCode;

/// Stack of the program, in bytes, as most systems give it.
const STACK: usize = 8 << 20;

/// Runs the program, in a thread of its own where the system gives a small stack.
fn main() -> ExitCode {
    if !has_small_stack() {
        return run();
    }
    match std::thread::Builder::new().stack_size(STACK).spawn(run).map(std::thread::JoinHandle::join) {
        Ok(Ok(code)) => code,
        // The thread has printed its panic.
        Ok(Err(_)) => ExitCode::from(101),
        Err(why) => {
            eprintln!("rebond: the stack is small, and there is no room for another: {why}");
            ExitCode::from(2)
        }
    }
}

#[cfg(unix)]
fn has_small_stack() -> bool {
    let limit = rustix::process::getrlimit(rustix::process::Resource::Stack).current;
    limit.is_some_and(|limit| limit < STACK as u64)
}

#[cfg(not(unix))]
fn has_small_stack() -> bool {
    true
}

fn run() -> ExitCode {
    let cli = match Cli::read(std::env::args_os()) {
        Ok(cli) => cli,
        // Help and the version are no errors, and printed once.
        Err(why) if why.exit_code() == 0 => match launch::prints() {
            Ok(true) => why.exit(),
            Ok(false) => return ExitCode::SUCCESS,
            Err(error) => return report(&error),
        },
        Err(why) => match why.to_string().strip_prefix("error: ") {
            Some(text) => return report(&Error::Usage(text.trim_end().to_owned())),
            None => {
                launch::wait_turn();
                why.exit()
            }
        },
    };
    execute(&cli).map_or_else(|error| report(&error), |()| ExitCode::SUCCESS)
}

/// Prints an error once for all processes, and returns its exit code.
fn report(error: &Error) -> ExitCode {
    launch::wait_turn();
    eprintln!("rebond: {error}");
    ExitCode::from(error.exit_code())
}
