//! Handler of the signals that ask a run to stop.

use crate::error::{Error, Result};
#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::Signals;
#[cfg(unix)]
use std::sync::Arc;
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

/// Makes SIGINT, SIGTERM and SIGHUP, which a terminal that closes sends, a request to stop; a later
/// one ends the program. SIGHUP stays ignored where it was when the program started, as `nohup` has
/// it.
///
/// # Errors
/// Returns [`Error::Usage`] where the system refuses, [`Error::Memory`] where it has no room for a
/// thread.
pub(super) fn listen() -> Result<()> {
    let mut asking = vec![SIGINT, SIGTERM];
    #[cfg(unix)]
    if !ignores_hangup() {
        asking.push(SIGHUP);
    }
    let mut signals =
        Signals::new(asking).map_err(|why| Error::Usage(format!("signals cannot be caught: {why}")))?;
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

/// Makes a write beyond the limit on the size of files an error, which names the file, instead of
/// the end of the program.
pub(super) fn survive_full_files() {
    #[cfg(unix)]
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::default());
}

/// Returns whether the program was started with SIGHUP ignored, as far as the system tells.
#[cfg(unix)]
fn ignores_hangup() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    mask.is_some_and(|mask| mask >> (SIGHUP - 1) & 1 == 1)
}

/// Returns whether a signal was received.
pub(super) fn signal_received() -> bool {
    ASKED.get().is_some()
}
