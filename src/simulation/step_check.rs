//! Check of a step: its residual, and advice on its energy.

use crate::error::{Error, Result};
use crate::scene::Scene;

/// Number of steps between checks of the energy where rows are further apart.
pub(super) const GUARD_EVERY: u64 = 100;

/// Returns an error for a KKT residual above the tolerance.
pub(crate) fn check_residual(step: u64, time: f64, residual: f64, tolerance: f64) -> Result<()> {
    if !residual.is_finite() {
        return Err(Error::NotFinite { step, time, what: "the displacement" });
    }
    if residual > tolerance {
        return Err(Error::NotConverged { step, time, residual, tolerance });
    }
    Ok(())
}

/// Returns advice for the user on a spurious gain of energy.
pub(crate) fn advice(scene: &Scene) -> &'static str {
    let of_scheme = scene.time.scheme.advice_on_energy(scene.time.mass.is_singular());
    of_scheme.unwrap_or("check the loads and the initial state")
}
