//! Safe handles on PETSc objects and on MPI.
//!
//! The crate has unsafe code in files of this folder only, each of which allows it at its top.
//!
//! [`Context::start`] starts MPI and PETSc. Every handle keeps the context alive, frees its object
//! when it is dropped and stays on its thread. Errors of PETSc become an
//! [`Error::Petsc`](crate::Error::Petsc) with the function and its message; PETSc prints none of
//! them.
//!
//! # Collective calls
//!
//! A call is *collective* where its documentation says so: every rank of the communicator must make
//! it, in the same order. Creating and dropping a handle is collective too, as is dropping the last
//! owner of the context. Therefore validate first, then enter. A rank among several that finds an
//! error must not unwind past live handles, but call [`Context::fail`], which ends all ranks. A
//! panic does the same.
//!
//! # Numbers
//!
//! [`Index`] is PETSc's integer (32 bits): positions in distributed vectors, points of a mesh.
//! Lengths on this rank are `usize`. [`INFINITY`] is PETSc's value for an absent bound; anything
//! smaller, even 1e20, counts as a bound.

mod sys;
mod library;
mod error;
mod handle;
mod callback;
mod ending;
mod world;
mod context;
mod words;
pub mod options;
mod index_set;
mod vec;
mod mat;
mod ksp;
mod multigrid;
mod bounded;
mod snes;
mod tao;
mod operator;
mod section;
mod dm;
mod refinement;

pub use context::Context;
pub use dm::Plex;
pub use index_set::IndexSet;
pub use ksp::Ksp;
pub use mat::Matrix;
pub use multigrid::{MultigridLevels, Smoother};
pub use operator::Operator;
pub use refinement::Refinement;
pub use section::{Dofs, Section};
pub use snes::Snes;
pub use tao::Tao;
pub use vec::Vector;
pub use world::WorldComm;

/// Integer type of PETSc.
pub type Index = i32;

/// PETSc's value for an absent upper bound (`PETSC_INFINITY`); its negative for a lower one.
pub const INFINITY: f64 = f64::MAX / 4.0;

/// Reason why a solver ended: PETSc's code and its name, such as `DIVERGED_MAX_IT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason {
    /// Code of PETSc: positive for convergence, negative for failure, 0 while the solver runs.
    pub code: i32,
    /// Name that PETSc gives the code.
    pub text: String,
}

impl Reason {
    /// Returns whether the solver reports convergence, which does not replace a check of the
    /// solution.
    pub fn converged(&self) -> bool {
        self.code > 0
    }
}
