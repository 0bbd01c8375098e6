//! Safe handles on PETSc's objects: the only unsafe code of the crate.
//!
//! [`Context::start`] starts MPI and PETSc. Every handle keeps the context alive, frees its object when it is dropped
//! and stays on its thread. What PETSc refuses is an [`Error::Petsc`](crate::Error::Petsc) with the function and its message;
//! nothing of it reaches the screen.
//!
//! # Collective calls
//!
//! A call is *collective* where its doc says so: every rank of the communicator must make it, in the same order.
//! Creating and dropping a handle is collective too, as is dropping the last owner of the context. Therefore
//! validate first, then enter; and where a rank of several finds an error, do not unwind past live handles: call [`Context::fail`],
//! which ends all ranks. A panic does the same by itself.
//!
//! # Numbers
//!
//! [`Index`] is PETSc's integer (32 bits): positions in distributed vectors, points of a mesh. Lengths on this rank are `usize`.
//! [`INFINITY`] is the bound that PETSc takes for none; anything smaller, even 1e20, is a bound to it.

#![allow(unsafe_code)]

mod sys;
mod error;
mod handle;
mod callback;
mod context;
pub mod options;
mod index_set;
mod vec;
mod mat;
mod ksp;
mod snes;
mod tao;
mod section;
mod dm;
pub mod plate;
pub mod engine;

pub use context::{Comm, Context};
pub use dm::Plex;
pub use engine::Distributed;
pub use index_set::IndexSet;
pub use ksp::Ksp;
pub use mat::Matrix;
pub use plate::Part;
pub use section::{Dofs, Section};
pub use snes::Snes;
pub use tao::Tao;
pub use vec::Vector;

/// PETSc's integer.
pub type Index = i32;

/// The bound that PETSc takes for none (with a minus for lower ones): its `PETSC_INFINITY`.
pub const INFINITY: f64 = f64::MAX / 4.0;

/// Why a solver ended: PETSc's code and its name, such as `DIVERGED_MAX_IT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Reason {
    /// Positive where it converged, negative where it gave up, 0 while it runs.
    pub code: i32,
    /// PETSc's name for it.
    pub text: String,
}

impl Reason {
    /// Whether the solver says that it converged. What it says is not always so: judge the solution too.
    pub fn converged(&self) -> bool {
        self.code > 0
    }
}

/// PETSc lets tolerances pass that are not a number.
fn refuse_nan(tolerances: &[f64]) -> crate::Result<()> {
    if tolerances.iter().any(|value| value.is_nan()) {
        return Err(crate::Error::Petsc("a tolerance is not a number".into()));
    }
    Ok(())
}
