//! Factorisations and contact solvers.

#[path = "../common/mod.rs"]
mod common;

mod cholesky;
mod compliance;
mod digits;
mod fed;
mod limit;
mod obstacle_membrane;
mod vi;
