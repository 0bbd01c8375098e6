//! Questions about a scene: its natural frequencies, its inf-sup constant, what a run will cost, whether solvers agree, what
//! accuracy costs.

pub mod accuracy;
pub mod compare;
pub mod figures;
pub mod infsup;
mod inspect;
mod lanczos;
mod matrices;
pub mod modes;
pub mod stability;

pub use inspect::{Check, Deflection, Frequencies, Inspection, advised_step, check, inspect};
pub use matrices::write_matrices;
