//! The handles on PETSc, on 1 to 4 ranks.

use crate::common::ranks::Case;
use rebond::petsc::Context;

mod matrices;
mod plex;
mod solvers;
mod start;
mod vectors;

/// Returns the cases of all handles.
pub fn cases() -> impl Iterator<Item = &'static Case> {
    [start::CASES, vectors::CASES, matrices::CASES, solvers::CASES, plex::CASES].into_iter().flatten()
}

pub fn close(left: f64, right: f64, tolerance: f64) {
    assert!((left - right).abs() <= tolerance * right.abs().max(1.0), "{left} is not {right}");
}

/// Returns this rank's share of `0..n`, whose size differs among ranks.
fn share(context: &Context, n: usize) -> std::ops::Range<usize> {
    let cut = |rank: usize| (n * rank * (rank + 1)) / (context.size() * (context.size() + 1));
    cut(context.rank())..cut(context.rank() + 1)
}
