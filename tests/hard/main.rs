//! Scenes that are known to break solvers of this kind.

#[path = "../common/mod.rs"]
mod common;

mod fuzz;
mod invariance;
mod properties;
mod scenes;
mod sweeps;
