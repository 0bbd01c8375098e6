//! What memory a reading or a long run takes: a program of its own, for all that runs in it is counted.

use peak_alloc::PeakAlloc;
use std::sync::{Mutex, MutexGuard, PoisonError};

#[path = "../common/clock.rs"]
mod clock;
mod gmsh;
mod long;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Until it is dropped, no other test allocates.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}
