//! Handler of the signals that ask a run to stop.

use crate::error::{Error, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

/// Time of the first signal.
static ASKED: OnceLock<Instant> = OnceLock::new();

/// Time after the first signal from which another ends the program at once.
///
/// Launchers may send several signals at the same time.
const IMPATIENT: Duration = Duration::from_secs(1);

/// Stack size of the listening thread, in bytes.
const STACK: usize = 1 << 16;

/// Makes SIGINT and SIGTERM a request to stop; a later one ends the program.
///
/// # Errors
/// Returns [`Error::Usage`] where the system refuses, [`Error::Memory`] where it has no room for a
/// thread.
pub(super) fn listen() -> Result<()> {
    let mut signals = Signals::new([SIGINT, SIGTERM])
        .map_err(|why| Error::Usage(format!("signals cannot be caught: {why}")))?;
    let listen = move || {
        for _ in signals.forever() {
            if ASKED.get_or_init(Instant::now).elapsed() > IMPATIENT {
                std::process::exit(130);
            }
        }
    };
    let listener = thread::Builder::new().stack_size(STACK).spawn(listen);
    listener.map(drop).map_err(|why| Error::Memory(format!("signals cannot be listened to: {why}")))
}

/// Returns whether a signal was received.
pub(super) fn signal_received() -> bool {
    ASKED.get().is_some()
}
