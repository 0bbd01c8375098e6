//! Signals that ask a run to stop.

use crate::error::{Error, Result};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
use std::sync::OnceLock;
use std::thread;
use std::time::{Duration, Instant};

/// When a signal first came.
static ASKED: OnceLock<Instant> = OnceLock::new();

/// A signal this long after the first one does not wait for the step to end: launchers may send several at once.
const IMPATIENT: Duration = Duration::from_secs(1);

/// Bytes of the stack of the thread that listens.
const STACK: usize = 1 << 16;

/// From now on SIGINT and SIGTERM are a request, and a second one is an end.
///
/// # Errors
/// [`Error::Usage`] where the system refuses, [`Error::Memory`] where it has no room for a thread.
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

/// Whether a signal has come.
pub(super) fn came() -> bool {
    ASKED.get().is_some()
}
