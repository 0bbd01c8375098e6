//! The command under mpirun, and with PETSc's solvers.

#[path = "../common/mod.rs"]
mod common;

mod effects;
mod multigrid;
mod options;
mod runs;
mod sweeps;
mod vi;
