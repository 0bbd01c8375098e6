//! What memory a reading or a long run takes: a program of its own, for all that runs in it is counted.

use peak_alloc::PeakAlloc;

mod gmsh;
mod long;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;
