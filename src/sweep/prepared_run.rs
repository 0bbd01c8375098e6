//! Run of a sweep that is ready to start.

use super::measures::{Measures, PeriodRecorder};
use crate::communicator::Communicator;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::{Engine, Native};
use crate::lock_step::SharedModes;
use crate::scene::{Mass, Scene, SchemeSpec, SweepSpec};
use crate::scheme::{NewmarkParameters, Solution, Start};
use crate::simulation::{Model, StepMonitor};
use serde::{Deserialize, Serialize};
use std::cell::OnceCell;
use std::rc::Rc;

/// Number of steps between questions whether to stop.
pub(super) const ASK_EVERY: u64 = 256;

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
    pub scene: Scene,
    pub sweep: SweepSpec,
    pub model: Rc<Model<E>>,
    pub start: Start,
    /// Periods of the drive before the run.
    before: u64,
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
        Ok(PreparedRun { scene, sweep, model, start, before })
    }

    /// Returns the number of steps per period of the drive.
    pub fn per_period(&self) -> u64 {
        (self.sweep.period() / self.scene.time.step).round() as u64
    }

    /// Returns the number of steps.
    pub fn steps(&self) -> u64 {
        self.sweep.periods * self.per_period()
    }

    /// Starts the checks of a scheme that makes the run.
    pub fn monitor(&self, scheme: &dyn Solution) -> Result<StepMonitor<'_, E>> {
        StepMonitor::new(&self.scene, &self.model, scheme)
    }

    /// Starts the measures of the run and of those in lock step with it.
    pub fn recorder(&self) -> PeriodRecorder {
        let PreparedRun { scene, sweep, .. } = self;
        PeriodRecorder::new(scene.output.probes.len(), self.per_period(), sweep.settle * self.per_period())
    }

    /// Returns the measures of the run as one of a recorder, and the last state of its scheme with
    /// its energies there.
    pub fn finished(
        &self,
        scheme: &mut dyn Solution,
        now: Energies,
        (recorder, run): (&PeriodRecorder, usize),
        lyapunov: Option<f64>,
    ) -> Result<Finished> {
        let PreparedRun { sweep, before, .. } = self;
        let measures = recorder.measures(run, scheme.step(), now, sweep.tolerance, lyapunov);
        let (displacement, velocity) = (scheme.displacement().to_vec(), scheme.velocity()?);
        Ok((measures, CarriedState { displacement, velocity, periods: before + sweep.periods }))
    }
}

impl PreparedRun {
    /// Returns the parameters of the Newmark scheme, if the run is one that may go in lock step.
    pub fn parameters(&self) -> Option<NewmarkParameters> {
        let Scene { time, .. } = &self.scene;
        let SchemeSpec::Newmark { beta, restitution } = time.scheme else { return None };
        // With beta = 1/4 the scheme refuses a modal mass.
        let takes = !self.sweep.lyapunov && (time.mass != Mass::Modal || beta > 0.25);
        takes.then_some(NewmarkParameters { beta, restitution, step: time.step })
    }
}

/// Run that others go in lock step with, and what they share.
pub(super) struct Leader<'m> {
    pub run: &'m PreparedRun,
    shared: OnceCell<Option<SharedModes<'m>>>,
}

impl<'m> Leader<'m> {
    /// Makes a run one that others go with.
    pub fn new(run: &'m PreparedRun) -> Leader<'m> {
        Leader { run, shared: OnceCell::new() }
    }

    /// Returns what the runs share, if they go in modes.
    pub fn shared(&self) -> Option<&SharedModes<'m>> {
        let shared = || {
            let system = &self.run.model.system;
            let modes = SharedModes::modes(system).ok().flatten()?;
            SharedModes::new(system, &modes).ok()
        };
        self.shared.get_or_init(shared).as_ref()
    }

    /// Returns whether a run can go in lock step with this one.
    pub fn takes(&self, run: &PreparedRun) -> bool {
        let timing = |run: &PreparedRun| {
            let SweepSpec { periods, settle, .. } = run.sweep;
            run.parameters().map(|parameters| (parameters, run.sweep.period().to_bits(), periods, settle))
        };
        timing(run).is_some()
            && timing(run) == timing(self.run)
            && self.shared().is_some_and(|shared| shared.fit(&run.model.system))
    }
}
