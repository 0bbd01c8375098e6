//! Energies of a run, and the guard that stops it when energy appears from nowhere.

use crate::archive::Archive;
use crate::error::{Error, Result};

/// Energies at one instant, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Energies {
    /// Kinetic energy, in J.
    pub kinetic: f64,
    /// Elastic energy, in J.
    pub elastic: f64,
    /// Work of the constant loads, F . U, since the flat plate, and of loads and obstacles that
    /// change with time, since the start, in J.
    pub work: f64,
}

impl Energies {
    /// Returns the energy that an undamped plate conserves, kinetic + elastic - work, in J.
    pub fn total(&self) -> f64 {
        self.kinetic + self.elastic - self.work
    }
}

/// Share of the kinetic energy at the speed of sound that, times the guard's limit, a plate may
/// hold; a limit of 100 allows all of it.
const HELD: f64 = 0.01;

/// Part of the energy that a run is measured against, below which the energy at its start is none.
const ROUNDING: f64 = 1e-9;

/// Reference of a run that starts with no energy but rounding.
const FROM_NOTHING: &str = "the largest energy of loads or buckling so far (it is 0 J at the start)";

/// Advice for a plate that holds more energy than is possible.
const TOO_FAST: &str = "an obstacle, a support or a load moves the plate faster than any plate can move: check them, or set a smaller \
                        time.step";

/// Guard that stops a run whose energy exceeds a multiple of its start, or more than any plate can
/// hold.
#[derive(Debug, Clone, Copy)]
pub struct Guard {
    start: f64,
    scale: f64,
    held: f64,
    limit: f64,
    advice: &'static str,
}

impl Guard {
    /// Creates a guard at `limit` times the energy of the start; `advice` ends the message.
    ///
    /// Under loads the total at the start may vanish or be negative, so energies are measured
    /// against its largest part. Loads, supports and obstacles that change with time give energy
    /// that the total does not show. `sonic` is the plate's kinetic energy at its material's speed
    /// of sound, in J, above which it is no elastic plate; it is infinite where nothing changes
    /// with time.
    pub fn new(start: Energies, sonic: f64, limit: f64, advice: &'static str) -> Guard {
        let scale = [start.total(), start.kinetic, start.elastic, start.work]
            .into_iter()
            .fold(0.0, |scale: f64, part| scale.max(part.abs()));
        Guard { start: start.total(), scale, held: scale.max(HELD * sonic), limit, advice }
    }

    /// Returns the guard with a further energy against which energies are measured, in J.
    pub fn beside(self, energy: f64) -> Guard {
        let scale = self.scale.max(energy);
        Guard { scale, held: self.held.max(scale), ..self }
    }

    /// Saves or restores the energies that serve as reference.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.start)?;
        archive.value(&mut self.scale)
    }

    /// Checks the energy of a step.
    ///
    /// # Errors
    /// Returns [`Error::NotFinite`] for a NaN or an infinity, and [`Error::EnergyGuard`] past the
    /// limit.
    pub fn check(&mut self, step: u64, time: f64, now: Energies) -> Result<()> {
        let energy = now.total();
        if !energy.is_finite() {
            return Err(Error::NotFinite { step, time, what: "the energy" });
        }
        // A start at rest in the flat position has no energy, so the work done since sets the
        // scale.
        self.scale = self.scale.max(now.work.abs());
        let growth = energy - self.start;
        let Guard { scale, held, limit, .. } = *self;
        let guarded =
            |ratio: f64, of, advice| Err(Error::EnergyGuard { step, time, ratio, of, limit, advice });
        // Contact and damping remove at most the energy at the start and the work done since.
        if growth > (limit - 1.0) * scale || growth < -(limit + 1.0) * scale {
            let starts = self.start.abs() > ROUNDING * scale;
            let reference = if starts { "its start" } else { FROM_NOTHING };
            return guarded(1.0 + growth / scale, reference, self.advice);
        }
        // Work cancels in the total, so the plate itself must be able to hold its energy.
        let content = now.kinetic + now.elastic;
        if content > limit * held {
            return guarded(
                content / held,
                "the plate's kinetic energy at a tenth of its speed of sound",
                TOO_FAST,
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Energies, Guard};

    /// The reference of the ratio has a name that fits it: a start without energy is none.
    #[test]
    fn the_guard_names_the_energy_that_it_measures_against() {
        let told = |start: Energies, work: f64| {
            let mut guard = Guard::new(start, f64::INFINITY, 100.0, "advice");
            guard.check(1, 0.1, Energies { kinetic: 1e3 + work, work, ..start }).unwrap_err().to_string()
        };
        let moving = Energies { kinetic: 1.0, ..Energies::default() };
        assert!(told(moving, 0.0).contains("the energy is 1000 times its start, past the guard of 100"));
        let words = "the energy is 1001 times the largest energy of loads or buckling so far (it is 0 J at";
        assert!(told(Energies::default(), 1.0).contains(words), "{}", told(Energies::default(), 1.0));
    }
}
