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

/// Share of the energy at the speed of sound that, times the guard's limit, a plate may hold: at 100 all of it.
const HELD: f64 = 0.01;

/// What to do where a plate holds more energy than it can.
const TOO_FAST: &str = "an obstacle, a support or a load moves it within a step as no plate can move: check them, or take a smaller \
                        time.step";

/// Stops a run whose energy exceeds a multiple of its start, or what any plate can hold.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    start: f64,
    scale: f64,
    held: f64,
    limit: f64,
    advice: &'static str,
}

impl Guard {
    /// A guard at `limit` times the energy of the start; `advice` ends the message.
    ///
    /// Under loads the start's energy may vanish or be negative: energies are measured against the largest part of it. What changes
    /// with time gives energy that the total does not show; `sonic` is the plate's kinetic energy at the speed of sound of its
    /// material, in J, above which it is no elastic plate: infinite where nothing changes with time.
    pub fn new(start: Energies, sonic: f64, limit: f64, advice: &'static str) -> Guard {
        let scale = [start.total(), start.kinetic, start.elastic, start.work]
            .into_iter()
            .fold(0.0, |scale: f64, part| scale.max(part.abs()));
        Guard { start: start.total(), scale, held: scale.max(HELD * sonic), limit, advice }
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
        let Guard { scale, held, limit, .. } = *self;
        let guarded =
            |ratio: f64, of, advice| Err(Error::EnergyGuard { step, time, ratio, of, limit, advice });
        // Contact and damping take at most what there was and what work has given.
        if growth > (limit - 1.0) * scale || growth < -(limit + 1.0) * scale {
            return guarded(1.0 + growth / scale, "its start", self.advice);
        }
        // Work hides in the total what it gives: the plate itself must be able to hold it.
        let content = now.kinetic + now.elastic;
        if content > limit * held {
            return guarded(content / held, "what the plate has at a tenth of its speed of sound", TOO_FAST);
        }
        Ok(())
    }
}
