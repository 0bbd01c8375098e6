//! Means over a step of the grid, for the balance of forces.

use super::coordinates::Coordinates;
use super::data::ModalData;
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;

/// Parts of the mean balance of forces over a step of the grid.
#[derive(Debug, Clone, Default)]
pub(super) struct MeanBalance {
    /// Reported modes, their rates and the support velocities at the instant before.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    pub frame_rates: Vec<f64>,
    /// Mean data of the last step of any length, and the instants (s) of its ends.
    pub last: ModalData,
    pub ends: [f64; 2],
    /// Mean data over the step of the grid, with the instants of loads and their weights.
    pub mean: ModalData,
    pub loads: Vec<(f64, f64)>,
}

impl MeanBalance {
    /// Begins a step of the grid.
    pub fn begin(&mut self) {
        let ModalData { factors, force, places, wave, .. } = &mut self.mean;
        [factors, force, places, wave].into_iter().for_each(|values| values.fill(0.0));
        self.loads.clear();
    }

    /// Adds the last step of any length with its share of the step of the grid.
    pub fn add(&mut self, share: f64) {
        let MeanBalance { last, mean, loads, ends, .. } = self;
        axpy(share, &last.factors, &mut mean.factors);
        axpy(share, &last.force, &mut mean.force);
        axpy(share, &last.places, &mut mean.places);
        axpy(share, &last.wave, &mut mean.wave);
        loads.extend(ends.map(|time| (time, 0.5 * share)));
    }

    /// Saves or restores the state. Collective.
    pub fn archive<E: Engine>(&mut self, archive: &mut Archive, modal: &Coordinates<E>) -> Result<()> {
        modal.archive(&mut self.q, archive)?;
        modal.archive(&mut self.v, archive)?;
        archive.value(&mut self.frame_rates)?;
        self.last.archive(archive, modal)?;
        self.mean.archive(archive, modal)?;
        archive.value(&mut self.ends)?;
        archive.value(&mut self.loads)
    }
}
