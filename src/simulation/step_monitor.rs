//! Checks and readings of a scheme that is stepped without the main loop.

use super::outcome::first_impact;
use super::readings::Accelerations;
use super::step_check::{GUARD_EVERY, check_residual};
use super::{Impact, Model};
use crate::energy::{Energies, Guard};
use crate::error::Result;
use crate::linalg::Engine;
use crate::scene::Scene;
use crate::scheme::Solution;

/// Checks of every step, as in a run, and readings of the probes.
pub struct StepMonitor<'m, E: Engine> {
    scene: &'m Scene,
    model: &'m Model<E>,
    guard: Guard,
    accelerations: Accelerations,
}

impl<'m, E: Engine> StepMonitor<'m, E> {
    /// Starts to monitor a scheme of a model.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new(scene: &'m Scene, model: &'m Model<E>, scheme: &dyn Solution) -> Result<StepMonitor<'m, E>> {
        let guard = model.guard(scene, scheme)?;
        Ok(StepMonitor { scene, model, guard, accelerations: Accelerations::new(scene) })
    }

    /// Checks residual and energy of the step just made, and reads the probes. Collective.
    ///
    /// # Errors
    /// Returns the errors with which a run stops.
    pub fn note(&mut self, scheme: &mut dyn Solution, probes: &mut [f64]) -> Result<()> {
        self.check(scheme, || scheme.energies())?;
        let Model { readings, system, .. } = self.model;
        self.accelerations.note(readings, system, scheme)?;
        readings.read(system, &self.accelerations, scheme, probes)
    }

    /// Returns whether a step with a residual needs [`StepMonitor::check`].
    pub fn is_due(&self, step: u64, kkt: f64) -> bool {
        step.is_multiple_of(GUARD_EVERY) || kkt.is_nan() || kkt > self.scene.solver.tolerance
    }

    /// Checks residual and energies of the step just made; `energies` is called where the energies
    /// are due. Collective.
    ///
    /// # Errors
    /// Returns the errors with which a run stops.
    pub fn check(
        &mut self,
        scheme: &dyn Solution,
        energies: impl FnOnce() -> Result<Energies>,
    ) -> Result<()> {
        let (step, time, kkt) = (scheme.step(), scheme.time(), scheme.step_report().kkt);
        check_residual(step, time, kkt, self.scene.solver.tolerance)?;
        if step.is_multiple_of(GUARD_EVERY) {
            self.guard.check(step, time, energies()?)?;
        }
        Ok(())
    }

    /// Checks the energies of the step just made, and returns them. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::EnergyGuard`] or [`crate::Error::NotFinite`] where the energies are
    /// impossible, and the errors of the engine.
    pub fn check_energies(&mut self, scheme: &dyn Solution) -> Result<Energies> {
        let energies = scheme.energies()?;
        self.guard.check(scheme.step(), scheme.time(), energies)?;
        Ok(energies)
    }

    /// Returns the earliest impact of the step just made. Collective.
    ///
    /// # Errors
    /// Returns the errors of obstacles and support motions.
    pub fn impact(&self, scheme: &dyn Solution) -> Result<Option<Impact>> {
        first_impact(self.model, scheme, self.scene.time.step, &|_| true)
    }
}
