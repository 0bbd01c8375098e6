//! Runs of a sweep that go in lock step in modes, recorded together.

use super::measures::{PeriodRecorder, TotalContact};
use super::prepared_run::{ASK_EVERY, Finished, PreparedRun};
use crate::error::{Error, Result};
use crate::kernels::Lanes;
use crate::linalg::Native;
use crate::lock_step::ModeRuns;
use crate::scheme::Scheme;
use crate::simulation::StepMonitor;

/// Runs in lock step in modes, on their way. They are recorded together, and each is looked at by
/// itself only where it meets an obstacle.
pub(super) struct PeriodicModeRuns<'m> {
    of: Vec<&'m PreparedRun>,
    all: ModeRuns<'m>,
    monitors: Vec<StepMonitor<'m, Native>>,
    recorder: PeriodRecorder,
    values: Vec<Lanes>,
}

impl<'m> PeriodicModeRuns<'m> {
    /// Starts to measure runs at their start.
    pub fn new(of: &[&'m PreparedRun], mut all: ModeRuns<'m>) -> Result<PeriodicModeRuns<'m>> {
        let lanes = of.iter().enumerate();
        let monitors = lanes.map(|(lane, run)| run.monitor(all.lane(lane))).collect::<Result<_>>()?;
        Ok(PeriodicModeRuns {
            recorder: of[0].recorder(),
            values: vec![Lanes::default(); of[0].model.probes.len()],
            of: of.to_vec(),
            all,
            monitors,
        })
    }

    /// Makes the runs to their end.
    pub fn run(mut self, interrupts: &dyn Fn() -> bool) -> Result<Vec<Finished>> {
        self.note()?;
        for step in 0..self.of[0].steps() {
            if step.is_multiple_of(ASK_EVERY) && interrupts() {
                return Err(Error::Interrupted { step, time: self.all.lane(0).time() });
            }
            self.all.advance()?;
            self.note()?;
        }
        let PeriodicModeRuns { of, mut all, mut monitors, recorder, .. } = self;
        let lanes = of.iter().zip(&mut monitors).enumerate();
        let finished = lanes.map(|(lane, (run, monitor))| {
            let now = monitor.check_energies(all.lane(lane))?;
            run.finished(all.lane(lane), now, (&recorder, lane), None)
        });
        finished.collect()
    }

    /// Checks and records the step just made; the start is step 0.
    fn note(&mut self) -> Result<()> {
        let PeriodicModeRuns { of, all, monitors, recorder, values } = self;
        let step = all.step();
        let kkt = all.kkt();
        if monitors.iter().any(|monitor| monitor.is_due(step, kkt)) {
            for ((lane, monitor), energies) in monitors.iter_mut().enumerate().zip(all.energies()) {
                monitor.check(all.lane(lane), || Ok(energies))?;
            }
        }
        if let Some([forces, impulses]) = all.contacts() {
            for (lane, monitor) in monitors.iter_mut().enumerate() {
                let (force, impulse) = (forces.0[lane], impulses.0[lane]);
                let contact = TotalContact { touches: force > 0.0, force, peak: 0.0, impulse };
                if recorder.note_contact(lane, step, contact) {
                    let met = monitor.impact(all.lane(lane))?;
                    recorder.note_closing(lane, met.map_or(0.0, |met| met.velocity.abs()));
                }
            }
        }
        if recorder.begins_after(step) {
            for lane in 0..of.len() {
                recorder.begin(lane, all.lane(lane).energies()?);
            }
        }
        for (value, probe) in values.iter_mut().zip(&of[0].model.probes) {
            let parts = probe.weights().iter().map(|&(dof, weight)| weight * all.deflections(dof));
            *value = parts.fold(Lanes::default(), |sum, part| sum + part);
        }
        recorder.note(step, values);
        Ok(())
    }
}
