//! Massless part of the displacement, which the singular mass leaves without inertia.
//!
//! This part is the idea of the paper's method: it follows the contact at once. [`potential`] is
//! its energy for the implicit schemes; the saddle points and the compliance at the contact dofs
//! serve the exact scheme and the schemes in modes.

pub mod contact_compliance;
pub(crate) mod modal_saddle_point;
pub(super) mod penalty;
pub mod potential;
pub(super) mod saddle_point;
pub(super) mod velocity_basis;
