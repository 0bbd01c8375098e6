//! Factorisations and contact solvers.

#[path = "../common/mod.rs"]
mod common;

mod cholesky;
mod obstacle_membrane;
mod vi;
