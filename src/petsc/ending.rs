//! End of the program on every rank.

#![allow(unsafe_code)]

use crate::error::Error;
use mpi::topology::SimpleCommunicator;
use mpi::traits::Communicator;
use std::ffi::{c_int, c_ulong};
use std::io::Write;
use std::time::Duration;

/// Reports an error and ends the program on every rank, with the error's exit code.
///
/// One rank suffices (not collective). If several ranks have the same error, the lowest one reports
/// it.
pub(super) fn fail(world: &SimpleCommunicator, error: &Error) -> ! {
    let (rank, size) = (world.rank(), world.size());
    // Rank 0 reports at once, and ends the others while they wait for their turn.
    std::thread::sleep(Duration::from_millis(if rank == 0 { 0 } else { 5000 + 20 * rank.min(100) as u64 }));
    let place = if size > 1 { format!(" (rank {rank} of {size})") } else { String::new() };
    let _ = writeln!(std::io::stderr(), "rebond: {error}{place}");
    wait_until_read();
    abort(world, error.exit_code())
}

/// Ends the program on every rank at once. Not collective.
pub(super) fn abort(world: &SimpleCommunicator, code: u8) -> ! {
    let _ = std::io::stdout().flush();
    if world.size() == 1 {
        std::process::exit(code.into());
    }
    world.abort(code.into())
}

/// Makes a panic on one rank end all ranks, which would otherwise wait for it for ever.
///
/// This covers panics inside callbacks too.
pub(super) fn abort_on_panic() {
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        before(panic);
        wait_until_read();
        // SAFETY: MPI is thread-safe enough to be aborted from anywhere.
        unsafe { mpi::ffi::MPI_Abort(mpi::ffi::RSMPI_COMM_WORLD, 101) };
    }));
}

/// Waits until the launcher has read standard error, whose unread part may be lost in an abort.
///
/// Works on Linux only; does nothing elsewhere.
fn wait_until_read() {
    const FIONREAD: c_ulong = 0x541B;
    const PAUSE: Duration = Duration::from_millis(10);
    unsafe extern "C" {
        fn ioctl(file: c_int, request: c_ulong, ...) -> c_int;
    }
    let _ = std::io::stderr().flush();
    if cfg!(not(target_os = "linux")) {
        return;
    }
    for _ in 0..500 {
        let mut waiting: c_int = 0;
        // SAFETY: the request writes one integer; a file that is no pipe returns an error.
        let code = unsafe { ioctl(2, FIONREAD, &mut waiting as *mut c_int) };
        if code != 0 || waiting == 0 {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    // The launcher needs some time to pass the text on.
    std::thread::sleep(10 * PAUSE);
}
