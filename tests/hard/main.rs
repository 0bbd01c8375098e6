//! Scenes that are known to break solvers of this kind.

#[path = "../common/mod.rs"]
mod common;

mod drawn;
mod fuzz;
mod invariance;
mod modal;
mod properties;
mod scenes;
mod sweeps;
