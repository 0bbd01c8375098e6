//! Studies of a scene: frequencies, inf-sup constant, cost of a run, comparison of solvers,
//! work-precision, stability, and the figures of the paper.

pub mod accuracy;
pub mod compare;
pub mod figures;
mod frequencies;
mod in_time;
pub mod infsup;
mod inspect;
mod linearity;
mod matrices;
mod modal_figures;
mod mode_shapes;
mod points;
pub mod stability;
mod sound;
mod static_reactions;
mod warnings;

pub use frequencies::{Frequencies, advised_step, energy_step};
pub use inspect::{Check, Deflection, Inspection, SweepCost, check, inspect};
pub use linearity::of_run as warning_of_run;
pub use matrices::{MATRICES, matrices_are_of, write_matrices};
pub use modal_figures::{ContactFigures, ModalFigures};
pub use mode_shapes::ModeShapes;
pub use sound::{Sound, Source};
pub use static_reactions::StaticReaction;
pub use warnings::{MOST_DOFS, warnings, warnings_apart};
