//! Runs of a sweep: whole periods of the drive, from the start of the scene or from the end of
//! another run. Several runs of equal systems go in lock step.

use super::lyapunov::{Exponent, TwoRuns};
use super::measures::{PeriodRecorder, TotalContact};
use super::periodic_mode_runs::PeriodicModeRuns;
use super::prepared_run::{ASK_EVERY, Finished, Leader, PreparedRun};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::kernels::Lanes;
use crate::linalg::Engine;
use crate::scene::Scene;
use crate::scheme::{Scheme, Start};
use crate::simulation::{Model, SolverFactory, StepMonitor};
use std::rc::Rc;

impl<E: Engine> PreparedRun<E> {
    /// Makes the run by itself, with contact solvers from a factory. Collective.
    ///
    /// # Errors
    /// Returns the errors of a run, and [`Error::Interrupted`] once `interrupts` says so.
    pub fn run_alone(&self, solver: &SolverFactory<E>, interrupts: &dyn Fn() -> bool) -> Result<Finished> {
        let again = || {
            let Scene { time, .. } = &self.scene;
            time.scheme.start(&self.model.system, time.step, self.start.clone(), solver)
        };
        let mut run = PeriodicRun::new(self, again()?, &again)?;
        for step in 0..self.steps() {
            if step.is_multiple_of(ASK_EVERY) && interrupts() {
                return Err(Error::Interrupted { step, time: run.scheme.time() });
            }
            run.advance()?;
        }
        run.finish()
    }
}

/// Makes runs that go with a leader in lock step. The result of each does not depend on the
/// others, to the bit.
///
/// # Errors
/// Returns the first error of any of the runs, and [`Error::Interrupted`] once `interrupts` says
/// so.
pub(super) fn run_together(
    runs: &[&PreparedRun],
    leader: &Leader,
    interrupts: &dyn Fn() -> bool,
) -> Result<Vec<Finished>> {
    let parameters = runs.first().and_then(|run| run.parameters());
    let (Some(parameters), Some(shared)) = (parameters, leader.shared()) else { return Ok(Vec::new()) };
    let models: Vec<Rc<Model>> = runs.iter().map(|run| run.model.clone()).collect();
    let systems: Vec<_> = models.iter().map(|model| &model.system).collect();
    let starts: Vec<Start> = runs.iter().map(|run| run.start.clone()).collect();
    let motions = shared.start(&systems, parameters, &starts)?;
    PeriodicModeRuns::new(runs, motions)?.run(interrupts)
}

/// Start of a run once more, beside itself.
type StartAgain<'m> = dyn Fn() -> Result<Box<dyn Scheme + 'm>> + 'm;

/// Run on its way.
struct PeriodicRun<'m, E: Engine> {
    of: &'m PreparedRun<E>,
    scheme: Box<dyn Scheme + 'm>,
    monitor: StepMonitor<'m, E>,
    /// Measures, of which those of the first run count.
    recorder: PeriodRecorder,
    /// Values at the probes, and the same in the first lane.
    values: Vec<f64>,
    lanes: Vec<Lanes>,
    again: &'m StartAgain<'m>,
    /// Second motion for the Lyapunov exponent.
    beside: Option<(Box<dyn Scheme + 'm>, Exponent)>,
}

impl<'m, E: Engine> PeriodicRun<'m, E> {
    /// Starts to measure a scheme at its start. A second one for the Lyapunov exponent starts by
    /// `again`.
    fn new(
        prepared: &'m PreparedRun<E>,
        scheme: Box<dyn Scheme + 'm>,
        again: &'m StartAgain<'m>,
    ) -> Result<PeriodicRun<'m, E>> {
        let mut run = PeriodicRun {
            monitor: prepared.monitor(scheme.as_ref())?,
            recorder: prepared.recorder(),
            values: vec![0.0; prepared.scene.output.probes.len()],
            lanes: vec![Lanes::default(); prepared.scene.output.probes.len()],
            of: prepared,
            scheme,
            again,
            beside: None,
        };
        run.note()?;
        Ok(run)
    }

    /// Advances by one step.
    fn advance(&mut self) -> Result<()> {
        let PreparedRun { sweep, model, .. } = self.of;
        let PeriodicRun { scheme, again, .. } = self;
        if sweep.lyapunov && self.recorder.begins_after(scheme.step()) {
            let mut second = again()?;
            let mut runs = TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
            runs.part()?;
            let exponent = Exponent::new(&mut runs, sweep.periods - sweep.settle)?;
            self.beside = Some((second, exponent));
        }
        self.scheme.advance()?;
        self.note()?;
        let PeriodicRun { scheme, beside, .. } = self;
        let Some((second, exponent)) = beside else { return Ok(()) };
        second.advance()?;
        second.take_events();
        if scheme.step().is_multiple_of(self.of.per_period()) {
            let mut runs = TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
            exponent.note(&mut runs)?;
        }
        Ok(())
    }

    /// Checks and records the step just made; the start is step 0. Collective.
    fn note(&mut self) -> Result<()> {
        let PeriodicRun { scheme, monitor, recorder, values, lanes, .. } = self;
        let scheme = scheme.as_mut();
        monitor.note(scheme, values)?;
        let step = scheme.step();
        let events = scheme.take_events();
        let record = scheme.record();
        let (mut force, mut impulse) = (0.0, 0.0);
        for bound in record.candidates() {
            force += record.reaction[bound].abs();
            impulse += record.impulses[bound].abs();
        }
        let [force, impulse] = self.of.model.system.engine.comm().all_reduce_sum([force, impulse]);
        let touches = force > 0.0 || !events.is_empty();
        let peak = events.iter().map(|event| event.force.abs()).fold(0.0, f64::max);
        let is_impact = recorder.note_contact(0, step, TotalContact { touches, force, peak, impulse });
        if recorder.measures_step(step) {
            let closing = events.iter().filter(|event| event.closes);
            closing.for_each(|event| recorder.note_closing(0, event.velocity.abs()));
        }
        if is_impact && events.is_empty() {
            let met = monitor.impact(scheme)?;
            recorder.note_closing(0, met.map_or(0.0, |met| met.velocity.abs()));
        }
        if recorder.begins_after(step) {
            recorder.begin(0, scheme.energies()?);
        }
        lanes.iter_mut().zip(&*values).for_each(|(lanes, value)| *lanes = Lanes::first(*value));
        recorder.note(step, lanes);
        Ok(())
    }

    /// Returns the measures and the last state.
    fn finish(mut self) -> Result<Finished> {
        let now = self.monitor.check_energies(self.scheme.as_ref())?;
        let lyapunov = self.beside.and_then(|(_, exponent)| exponent.per_period());
        let lyapunov = lyapunov.map(|per| per / self.of.sweep.period());
        self.of.finished(self.scheme.as_mut(), now, (&self.recorder, 0), lyapunov)
    }
}
