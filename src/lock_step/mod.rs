//! Newmark runs of equal systems in lock step, in the modes that carry inertia.
//!
//! A displacement is the sum of the modes and of a massless part, which reactions r, loads of fixed
//! distribution and the start move along few directions:
//!
//! ```math
//! U = \Phi q + H s + W p + e\, c .
//! ```
//!
//! H is the response of the massless part to unit reactions, W that to the loads, and e the
//! massless part of the start. No two of these coordinates are coupled, so that a step of the
//! scheme is a division for each, and a contact problem [in compliance form](crate::vi::compliance)
//! for each system that touches:
//!
//! ```math
//! \Bigl( \frac{\mu}{\Delta t^2} + \beta k + \frac{d}{2 \Delta t} \Bigr) x
//!    = g - k z^n - d\, \frac{z^n - z^{n-1}}{\Delta t} ,
//! ```
//!
//! with `$\mu = 1$`, `$k = \omega^2$` and `$g = \Phi^T (F + G^T r)$` for a mode, and `$\mu = 0$`,
//! `$k = 1$` and g = r, the factor of the load, or 0 for the others. The modes are those of the
//! modal mass, or with a mass of cells all modes with inertia, of which the paper's singular mass
//! has no more than cells. Each lane of the registers of the processor computes for one system.
//!
//! The modal mass and a mass of cells differ in their massless part. That of the modal mass follows
//! the loads at once, has no damping and starts in equilibrium (see
//! [`ModalScheme`](crate::scheme::ModalScheme)). With a mass of cells it obeys the scheme like all
//! else, and Rayleigh damping acts on it.

mod lane_contacts;
mod lane_coordinates;
mod lane_energies;
mod lane_levels;
mod lane_start;
mod lane_sums;
mod load_laws;
mod mode_lane;
mod mode_runs;
mod shared_modes;

pub use mode_lane::ModeLane;
pub use mode_runs::ModeRuns;
pub use shared_modes::SharedModes;
