//! Branches of periodic motions: driven ones over a key of the scene, and free vibrations over
//! their energy.
//!
//! A periodic motion is a fixed point of the [return map](crate::scheme::ReturnMap) of a period.
//! Newton's method finds it, stable or not (shooting), and steps along the branch in its own arc
//! length lead around folds. The eigenvalues of the derivative of the map, Floquet's multipliers,
//! tell what becomes of small disturbances in a period. `docs/continuation.md` defines every column
//! and tells how to read the pictures.

mod branch;
pub mod driven;
mod family;
pub mod free;
mod orbit;
mod pictures;
mod points;
mod report;

pub use branch::{BranchLimits, Follower, PeriodicMotion};
pub use driven::{Driven, DrivenScene};
pub use family::Family;
pub use free::Free;
pub use orbit::Orbit;
pub use pictures::{PICTURES, figures};
pub use points::PointKind;
pub use report::{BranchReport, BranchRow, CSV, JSON};
