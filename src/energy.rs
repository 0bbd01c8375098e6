//! The energy ledger of a run, and the guard that stops it when energy appears from nowhere.

use crate::archive::Archive;
use crate::error::{Error, Result};

/// Energies at one instant, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Energies {
    /// Kinetic energy.
    pub kinetic: f64,
    /// Elastic energy.
    pub elastic: f64,
    /// Potential of the constant loads, F . U: what they have given since the flat plate; and what loads and obstacles that change with
    /// time have given since the start.
    pub work: f64,
}

impl Energies {
    /// What an undamped plate conserves: kinetic + elastic - work.
    pub fn total(&self) -> f64 {
        self.kinetic + self.elastic - self.work
    }
}

/// Stops a run whose energy exceeds a multiple of its start.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    start: f64,
    scale: f64,
    limit: f64,
    advice: &'static str,
}

impl Guard {
    /// A guard at `limit` times the energy of the start; `advice` ends the message.
    ///
    /// Under loads the start's energy may vanish or be negative: energies are measured against the largest part of it.
    pub fn new(start: Energies, limit: f64, advice: &'static str) -> Guard {
        let scale = [start.total(), start.kinetic, start.elastic, start.work]
            .into_iter()
            .fold(0.0, |scale: f64, part| scale.max(part.abs()));
        Guard { start: start.total(), scale, limit, advice }
    }

    /// Shows an archive what energies are measured against.
    ///
    /// # Errors
    /// [`Error::Checkpoint`].
    pub fn state(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.start)?;
        archive.value(&mut self.scale)
    }

    /// Looks at the energy of a step.
    ///
    /// # Errors
    /// [`Error::NotFinite`] for a NaN or an infinity, [`Error::EnergyGuard`] past the limit.
    pub fn check(&mut self, step: u64, time: f64, now: Energies) -> Result<()> {
        let energy = now.total();
        if !energy.is_finite() {
            return Err(Error::NotFinite { step, time, what: "the energy" });
        }
        // A start at rest in the flat position has no energy: the work done since sets the scale.
        self.scale = self.scale.max(now.work.abs());
        let growth = energy - self.start;
        if growth > (self.limit - 1.0) * self.scale {
            let ratio = 1.0 + growth / self.scale;
            return Err(Error::EnergyGuard { step, time, ratio, limit: self.limit, advice: self.advice });
        }
        Ok(())
    }
}
