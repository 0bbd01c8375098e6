//! Questions about a scene: its natural frequencies, its inf-sup constant, what a run will cost, whether solvers agree.

pub mod compare;
pub mod infsup;
mod inspect;
mod lanczos;
mod matrices;
pub mod modes;

pub use inspect::{Check, Deflection, Frequencies, Inspection, advised_step, check, inspect};
pub use matrices::write_matrices;
