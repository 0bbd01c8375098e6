//! Runs of a sweep: whole periods of the drive, from the start of the scene or from the end of
//! another run. Several runs of equal systems go in lock step.

use super::lyapunov::{Exponent, TwoRuns};
use super::measures::{Measures, PeriodRecorder};
use crate::communicator::Communicator;
#[cfg(feature = "petsc")]
use crate::distributed::Distributed;
use crate::error::{Error, Result};
use crate::linalg::{Engine, MassModes, Native};
use crate::scene::{Mass, Scene, SchemeSpec, SweepSpec};
use crate::scheme::{NewmarkParameters, Scheme, SharedModes, SideBySide, Start};
use crate::simulation::{Model, SolverFactory, StepMonitor};
use serde::{Deserialize, Serialize};
use std::cell::OnceCell;
use std::rc::Rc;

/// Number of steps between questions whether to stop.
const ASK_EVERY: u64 = 256;

/// State of a run at its end, from which the next value continues.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CarriedState {
    /// Displacement, in m, one entry per dof.
    displacement: Vec<f64>,
    /// Velocity, in m/s, one entry per dof.
    velocity: Vec<f64>,
    /// Periods of the drive since the first of the runs began.
    periods: u64,
}

impl CarriedState {
    /// Returns the initial conditions in a model, with deflections moved into its bounds, which may
    /// be others than those of the run before.
    fn start<E: Engine>(&self, model: &Model<E>) -> Result<Start> {
        let (here, there) = (model.start.displacement.len(), self.displacement.len());
        if here != there {
            return Err(Error::Usage(format!(
                "the state of {there} dofs does not fit {here}; expected a sweep over keys that keep mesh and supports, \
                 or sweep.direction = \"apart\""
            )));
        }
        let mut start = Start { displacement: self.displacement.clone(), velocity: self.velocity.clone() };
        let bounds = &model.system.bounds;
        for (bound, &dof) in bounds.dofs.iter().enumerate() {
            let (u, [lower, upper]) = (&mut start.displacement[dof], bounds.rigid(bound));
            *u = u.max(lower).min(upper);
        }
        Ok(start)
    }
}

/// Measures of a run and its last state.
pub(super) type Finished = (Measures, CarriedState);

/// Run that is ready to start: the model of its scene and its initial conditions.
pub(super) struct PreparedRun<E: Engine = Native> {
    scene: Scene,
    sweep: SweepSpec,
    model: Rc<Model<E>>,
    start: Start,
    /// Periods of the drive before the run.
    before: u64,
    /// Modes in which runs go in lock step with this one, once they are needed.
    modes: OnceCell<Option<Rc<MassModes>>>,
}

impl<E: Engine> PreparedRun<E> {
    /// Prepares a run of a scene whose step divides the period and whose end is that of the run,
    /// from a state or from the start of the scene, with a model that `build` makes. Collective.
    ///
    /// # Errors
    /// Returns the errors of the model, and [`Error::Usage`] where the state does not fit it.
    pub fn new(
        scene: Scene,
        sweep: SweepSpec,
        carried: Option<&CarriedState>,
        build: impl FnOnce(&Scene) -> Result<Model<E>>,
    ) -> Result<PreparedRun<E>> {
        let before = carried.map_or(0, |carried| carried.periods);
        let scene = match before {
            0 => scene,
            _ => scene.from_time(before as f64 * sweep.period()),
        };
        let model = Rc::new(build(&scene)?);
        let start = carried.map_or(Ok(model.start.clone()), |carried| carried.start(&model));
        let start = model.system.engine.comm().all_ok(start)?;
        Ok(PreparedRun { scene, sweep, model, start, before, modes: OnceCell::new() })
    }

    /// Makes the run by itself, with contact solvers from a factory. Collective.
    ///
    /// # Errors
    /// Returns the errors of a run, and [`Error::Interrupted`] once `interrupts` says so.
    pub fn run_alone(&self, solver: &SolverFactory<E>, interrupts: &dyn Fn() -> bool) -> Result<Finished> {
        let again = || {
            let Scene { time, .. } = &self.scene;
            time.scheme.start(&self.model.system, time.step, self.start.clone(), solver)
        };
        let mut run = [PeriodicRun::new(self, again()?, Some(&again))?];
        make(&mut run, interrupts)?;
        let [run] = run;
        run.finish()
    }
}

#[cfg(feature = "petsc")]
impl PreparedRun<Distributed> {
    /// Returns a factory of the contact solver that the scene names.
    pub fn solver(&self) -> Box<SolverFactory<Distributed>> {
        self.model.solver(&self.scene)
    }
}

impl PreparedRun {
    /// Returns the parameters of the Newmark scheme, if the run is one that may go in lock step.
    fn parameters(&self) -> Option<NewmarkParameters> {
        let Scene { time, .. } = &self.scene;
        let SchemeSpec::Newmark { beta, restitution } = time.scheme else { return None };
        // With beta = 1/4 the scheme refuses a modal mass.
        let takes = !self.sweep.lyapunov && (time.mass != Mass::Modal || beta > 0.25);
        let takes = takes && SideBySide::takes(&self.model.system);
        takes.then_some(NewmarkParameters { beta, restitution, step: time.step })
    }

    /// Returns the modes for runs in lock step with this one, if they go in modes.
    fn modes(&self) -> Option<Rc<MassModes>> {
        self.modes.get_or_init(|| SharedModes::modes(&self.model.system).ok().flatten()).clone()
    }

    /// Returns whether the run can go in lock step with another one.
    pub fn goes_with(&self, other: &PreparedRun) -> bool {
        let timing = |run: &PreparedRun| {
            let SweepSpec { periods, settle, .. } = run.sweep;
            run.parameters().map(|parameters| (parameters, run.sweep.period().to_bits(), periods, settle))
        };
        let goes_in_modes = |run: &PreparedRun| run.model.system.drive.load.is_none();
        let in_modes = other.modes().is_some();
        timing(self).is_some()
            && timing(self) == timing(other)
            && SideBySide::are_equal(&self.model.system, &other.model.system)
            && if in_modes { goes_in_modes(self) } else { self.scene.time.mass != Mass::Modal }
    }
}

/// Makes runs that go with a model in lock step. The result of each does not depend on the
/// others, to the bit.
///
/// # Errors
/// Returns the first error of any of the runs, and [`Error::Interrupted`] once `interrupts` says
/// so.
pub(super) fn run_together(
    runs: &[&PreparedRun],
    model: &PreparedRun,
    interrupts: &dyn Fn() -> bool,
) -> Result<Vec<Finished>> {
    let Some(parameters) = runs.first().and_then(|run| run.parameters()) else { return Ok(Vec::new()) };
    let models: Vec<Rc<Model>> = runs.iter().map(|run| run.model.clone()).collect();
    let systems: Vec<_> = models.iter().map(|model| &model.system).collect();
    let starts: Vec<Start> = runs.iter().map(|run| run.start.clone()).collect();
    if let Some(modes) = model.modes() {
        let shared = SharedModes::new(&model.model.system, &modes)?;
        return finish_all(runs, shared.start(&systems, parameters, &starts)?, interrupts);
    }
    let all = SideBySide::new(&models, |model: &Model| &model.system)?;
    finish_all(runs, all.start(&systems, parameters, &starts)?, interrupts)
}

/// Makes runs whose schemes advance in turn, to their end.
fn finish_all<'m>(
    runs: &[&'m PreparedRun],
    lanes: Vec<impl Scheme + 'm>,
    interrupts: &dyn Fn() -> bool,
) -> Result<Vec<Finished>> {
    let lanes = lanes.into_iter().zip(runs);
    let made = lanes.map(|(lane, run)| PeriodicRun::new(run, Box::new(lane), None));
    let mut made: Vec<PeriodicRun<Native>> = made.collect::<Result<_>>()?;
    make(&mut made, interrupts)?;
    made.into_iter().map(PeriodicRun::finish).collect()
}

/// Advances runs with equally many steps in turn, to their end.
fn make<E: Engine>(runs: &mut [PeriodicRun<E>], interrupts: &dyn Fn() -> bool) -> Result<()> {
    let steps = runs.iter().map(PeriodicRun::steps).max().unwrap_or(0);
    for step in 0..steps {
        if step.is_multiple_of(ASK_EVERY) && interrupts() {
            let time = runs.first().map_or(0.0, |run| run.scheme.time());
            return Err(Error::Interrupted { step, time });
        }
        for run in &mut *runs {
            run.advance()?;
        }
    }
    Ok(())
}

/// Start of a run once more, beside itself.
type StartAgain<'m> = dyn Fn() -> Result<Box<dyn Scheme + 'm>> + 'm;

/// Run on its way.
struct PeriodicRun<'m, E: Engine> {
    of: &'m PreparedRun<E>,
    scheme: Box<dyn Scheme + 'm>,
    recorder: PeriodRecorder<'m, E>,
    per_period: u64,
    again: Option<&'m StartAgain<'m>>,
    /// Second motion for the Lyapunov exponent.
    beside: Option<(Box<dyn Scheme + 'm>, Exponent)>,
}

impl<'m, E: Engine> PeriodicRun<'m, E> {
    /// Starts to measure a scheme at its start. A second one for the Lyapunov exponent starts by
    /// `again`.
    fn new(
        of: &'m PreparedRun<E>,
        mut scheme: Box<dyn Scheme + 'm>,
        again: Option<&'m StartAgain<'m>>,
    ) -> Result<PeriodicRun<'m, E>> {
        let PreparedRun { scene, sweep, model, .. } = of;
        let per_period = (sweep.period() / scene.time.step).round() as u64;
        let monitor = StepMonitor::new(scene, model, scheme.as_ref())?;
        let probes = scene.output.probes.len();
        let mut recorder = PeriodRecorder::new(monitor, probes, per_period, sweep.settle * per_period);
        recorder.note(scheme.as_mut())?;
        Ok(PeriodicRun { of, scheme, recorder, per_period, again, beside: None })
    }

    fn steps(&self) -> u64 {
        self.of.sweep.periods * self.per_period
    }

    /// Advances by one step.
    fn advance(&mut self) -> Result<()> {
        let PeriodicRun { of, scheme, recorder, per_period, again, beside } = self;
        let PreparedRun { sweep, model, .. } = *of;
        if let Some(again) = again.filter(|_| sweep.lyapunov && scheme.step() == sweep.settle * *per_period) {
            let mut second = again()?;
            let mut runs = TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
            runs.part()?;
            let exponent = Exponent::new(&mut runs, sweep.periods - sweep.settle)?;
            *beside = Some((second, exponent));
        }
        scheme.advance()?;
        recorder.note(scheme.as_mut())?;
        let Some((second, exponent)) = beside else { return Ok(()) };
        second.advance()?;
        second.take_events();
        if scheme.step().is_multiple_of(*per_period) {
            let mut runs = TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
            exponent.note(&mut runs)?;
        }
        Ok(())
    }

    /// Returns the measures and the last state.
    fn finish(mut self) -> Result<Finished> {
        let PreparedRun { sweep, before, .. } = self.of;
        let lyapunov = self.beside.and_then(|(_, exponent)| exponent.per_period());
        let lyapunov = lyapunov.map(|per| per / sweep.period());
        let displacement = self.scheme.displacement().to_vec();
        let velocity = self.scheme.velocity()?;
        let measures = self.recorder.measures(self.scheme.as_ref(), sweep.tolerance, lyapunov)?;
        Ok((measures, CarriedState { displacement, velocity, periods: before + sweep.periods }))
    }
}
