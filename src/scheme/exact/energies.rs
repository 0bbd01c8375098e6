//! Energies of velocities of modes, from the reduced model alone.
//!
//! K couples neither the modes and the rest W and H of the displacement `$U = \Phi z + W + H r$`,
//! nor, since K W and K H are F and G^T but for their parts along the modes, do their energies need
//! the shape:
//!
//! ```math
//! \tfrac12 U^T K U = \tfrac12 z^T \Omega^2 z + \tfrac12 F^T W + r^T w + \tfrac12 r^T R\, r, \qquad
//! F^T U = F^T \Phi z + F^T W + r^T w ,
//! ```
//!
//! with w = G W and R = G H at the candidates.

use super::Exact;
use super::reduction::ReducedModel;
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::dot;
use faer::Mat;

impl<E: Engine> Exact<'_, E> {
    /// Returns the energies of the present state; see the [module page](self).
    pub(super) fn modal_energies(&self) -> Result<Energies> {
        let ReducedModel { stiffness, force, rest, rest_at, compliance, .. } = &self.reduction;
        let coordinates = self.motion.modes.coordinates(&self.state);
        let place = &self.motion.modes.spectrum.vectors * coordinates.get(.., ..1);
        let reactions = self.reactions_of_modes();
        let gaps = compliance * Mat::from_fn(reactions.len(), 1, |i, _| reactions[i]);
        let modes: f64 = (0..place.nrows()).map(|k| stiffness[(k, k)] * place[(k, 0)].powi(2)).sum();
        let load = self.system.work(rest.col_as_slice(0))?;
        let shift = dot(rest_at.col_as_slice(0), &reactions);
        let rate = coordinates.col_as_slice(1);
        Ok(Energies {
            kinetic: 0.5 * dot(rate, rate),
            elastic: 0.5 * (modes + load + dot(gaps.col_as_slice(0), &reactions)) + shift,
            work: dot(force.col_as_slice(0), place.col_as_slice(0)) + load + shift,
        })
    }
}
