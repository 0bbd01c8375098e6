//! Memory that readers and long runs need. This is a program of its own, since all allocations in a
//! process are counted.

use peak_alloc::PeakAlloc;
use std::sync::{Mutex, MutexGuard, PoisonError};

#[path = "../common/clock.rs"]
mod clock;
mod gmsh;
mod long;
#[path = "../common/models.rs"]
mod models;
mod steps;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Prevents other tests from allocating until the guard is dropped.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}
