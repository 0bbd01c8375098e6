//! Runs of a sweep that go in lock step in modes, recorded together.

use super::measures::{PeriodRecorder, TotalContact};
use super::prepared_run::{ASK_EVERY, Finished, PreparedRun};
use crate::error::{Error, Result};
use crate::kernels::Lanes;
use crate::linalg::Native;
use crate::lock_step::ModeRuns;
use crate::scheme::Solution;
use crate::simulation::StepMonitor;

/// Runs in lock step in modes, on their way. They are recorded together, and each is looked at by
/// itself only where it meets an obstacle.
pub(super) struct PeriodicModeRuns<'m> {
    runs: Vec<&'m PreparedRun>,
    motion: ModeRuns<'m>,
    monitors: Vec<StepMonitor<'m, Native>>,
    recorder: PeriodRecorder,
    values: Vec<Lanes>,
    /// Whether probes of each run are read by themselves, since some read more than deflections.
    reads_each: bool,
}

impl<'m> PeriodicModeRuns<'m> {
    /// Starts to measure runs at their start.
    pub fn new(runs: &[&'m PreparedRun], mut motion: ModeRuns<'m>) -> Result<PeriodicModeRuns<'m>> {
        let lanes = runs.iter().enumerate();
        let monitors = lanes.map(|(lane, run)| run.monitor(&motion.lane(lane))).collect::<Result<_>>()?;
        Ok(PeriodicModeRuns {
            recorder: runs[0].recorder(),
            values: vec![Lanes::default(); runs[0].scene.output.probes.len()],
            reads_each: runs
                .iter()
                .any(|run| !run.model.probes_deflections_only() || run.model.probes != runs[0].model.probes),
            runs: runs.to_vec(),
            motion,
            monitors,
        })
    }

    /// Makes the runs to their end.
    pub fn run(mut self, interrupts: &dyn Fn() -> bool) -> Result<Vec<Finished>> {
        self.note()?;
        for step in 0..self.runs[0].steps() {
            if step.is_multiple_of(ASK_EVERY) && interrupts() {
                return Err(Error::Interrupted { step, time: self.motion.lane(0).time() });
            }
            self.motion.advance()?;
            self.note()?;
        }
        let PeriodicModeRuns { runs, mut motion, mut monitors, recorder, .. } = self;
        let lanes = runs.iter().zip(&mut monitors).enumerate();
        let finished = lanes.map(|(lane, (run, monitor))| {
            let now = monitor.check_energies(&motion.lane(lane))?;
            run.finished(&mut motion.lane(lane), now, (&recorder, lane), None)
        });
        finished.collect()
    }

    /// Checks and records the step just made; the start is step 0.
    fn note(&mut self) -> Result<()> {
        let PeriodicModeRuns { runs, motion, monitors, recorder, values, reads_each } = self;
        let step = motion.step;
        let kkt = motion.kkt();
        if *reads_each {
            let mut read = vec![0.0; values.len()];
            for (lane, monitor) in monitors.iter_mut().enumerate() {
                monitor.note(&mut motion.lane(lane), &mut read)?;
                values.iter_mut().zip(&read).for_each(|(values, value)| values.0[lane] = *value);
            }
        } else if monitors.iter().any(|monitor| monitor.is_due(step, kkt)) {
            for ((lane, monitor), energies) in monitors.iter_mut().enumerate().zip(motion.energies()) {
                monitor.check(&motion.lane(lane), || Ok(energies))?;
            }
        }
        if let Some([forces, impulses]) = motion.contacts() {
            for (lane, monitor) in monitors.iter_mut().enumerate() {
                let (force, impulse) = (forces.0[lane], impulses.0[lane]);
                let contact = TotalContact { touches: force > 0.0, force, peak: 0.0, impulse };
                if recorder.note_contact(lane, step, contact) {
                    let met = monitor.impact(&motion.lane(lane))?;
                    recorder.note_closing(lane, met.map_or(0.0, |met| met.velocity.abs()));
                }
            }
        }
        if recorder.begins_after(step) {
            for lane in 0..runs.len() {
                recorder.begin(lane, motion.lane(lane).energies()?);
            }
        }
        let deflections = if *reads_each { &[] } else { &*runs[0].model.probes };
        for (value, probe) in values.iter_mut().zip(deflections) {
            let parts = probe.weights().iter().map(|&(dof, weight)| weight * motion.deflections(dof));
            *value = parts.fold(Lanes::default(), |sum, part| sum + part);
        }
        recorder.note(step, values);
        Ok(())
    }
}
