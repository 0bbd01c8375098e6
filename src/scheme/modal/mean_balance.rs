//! Means over a step of the grid, for the balance of forces.

use super::coordinates::Coordinates;
use super::data::ModalData;
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;

/// Instants (s) of loads, and their weights.
type Instants = Vec<(f64, f64)>;

/// Weight of a load that is lost in the rounding of the others.
const NEGLIGIBLE: f64 = 0.01 * f64::EPSILON;

/// Parts of the mean balance of forces over a step of the grid.
#[derive(Debug, Clone, Default)]
pub(super) struct MeanBalance {
    /// Reported modes, their rates and the support velocities at the instant before.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub frame_rates: Vec<f64>,
    /// Mean data of the last step of any length, and the instants (s) of its loads with weights.
    pub last: ModalData,
    pub of_last: Instants,
    /// Instants of the loads of the present state, with their weights: a relaxed step ends between
    /// the loads of its two ends.
    pub held: Instants,
    /// Mean data over the step of the grid, with the instants of loads and their weights.
    pub mean: ModalData,
    pub loads: Instants,
}

impl MeanBalance {
    /// Begins a step of the grid.
    pub fn begin(&mut self) {
        let ModalData { factors, force, places, wave, .. } = &mut self.mean;
        [factors, force, places, wave].into_iter().for_each(|values| values.fill(0.0));
        self.loads.clear();
    }

    /// Keeps the loads of a step that was shortened to the part `gamma`; the whole step would have
    /// ended at the instant `end` (s).
    pub fn keep_loads(&mut self, end: f64, gamma: f64) {
        let part = |instants: &Instants, share: f64| -> Instants {
            instants.iter().map(|(time, weight)| (*time, share * weight)).collect()
        };
        self.of_last = part(&self.held, 0.5);
        self.of_last.push((end, 0.5));
        self.held = part(&self.held, 1.0 - gamma);
        self.held.push((end, gamma));
        self.held.retain(|(_, weight)| weight.abs() > NEGLIGIBLE);
    }

    /// Adds the last step of any length with its share of the step of the grid.
    pub fn add(&mut self, share: f64) {
        let MeanBalance { last, mean, loads, of_last, .. } = self;
        axpy(share, &last.factors, &mut mean.factors);
        axpy(share, &last.force, &mut mean.force);
        axpy(share, &last.places, &mut mean.places);
        axpy(share, &last.wave, &mut mean.wave);
        loads.extend(of_last.iter().map(|(time, weight)| (*time, share * weight)));
    }

    /// Saves or restores the state. Collective.
    pub fn archive<E: Engine>(&mut self, archive: &mut Archive, modal: &Coordinates<E>) -> Result<()> {
        modal.archive(&mut self.q, archive)?;
        modal.archive(&mut self.v, archive)?;
        archive.value(&mut self.frame_rates)?;
        self.last.archive(archive, modal)?;
        self.mean.archive(archive, modal)?;
        archive.value(&mut self.of_last)?;
        archive.value(&mut self.held)?;
        archive.value(&mut self.loads)
    }
}
