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
mod context;
pub mod options;

pub use context::{Comm, Context};

/// PETSc's integer.
pub type Index = i32;

/// The bound that PETSc takes for none (with a minus for lower ones): its `PETSC_INFINITY`.
pub const INFINITY: f64 = f64::MAX / 4.0;
