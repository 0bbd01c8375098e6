//! One run of a sweep: whole periods of the drive, from the start of the scene or from the end of
//! another run.

use super::lyapunov::{Exponent, TwoRuns};
use super::measures::{Measures, PeriodRecorder};
use crate::error::{Error, Result};
use crate::scene::{Scene, SweepSpec};
use crate::scheme::{Scheme, Start};
use crate::simulation::{Model, StepMonitor, condensed};
use serde::{Deserialize, Serialize};

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
    fn start(&self, model: &Model) -> Result<Start> {
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

/// Runs a scene whose step divides the period and whose end is that of the run. Returns its
/// measures and its last state.
///
/// # Errors
/// Returns the errors of a run, and [`Error::Interrupted`] once `interrupts` says so.
pub(super) fn run(
    scene: &Scene,
    sweep: &SweepSpec,
    carried: Option<&CarriedState>,
    interrupts: &dyn Fn() -> bool,
) -> Result<(Measures, CarriedState)> {
    let before = carried.map_or(0, |carried| carried.periods);
    let later;
    let scene = match before {
        0 => scene,
        _ => {
            later = scene.from_time(before as f64 * sweep.period());
            &later
        }
    };
    let model = Model::new(scene)?;
    let start = carried.map_or(Ok(model.start.clone()), |carried| carried.start(&model))?;
    let begin = || scene.time.scheme.start(&model.system, scene.time.step, start.clone(), &condensed);
    let mut scheme = begin()?;
    let per_period = (sweep.period() / scene.time.step).round() as u64;
    let settle = sweep.settle * per_period;
    let monitor = StepMonitor::new(scene, &model, scheme.as_ref())?;
    let mut recorder = PeriodRecorder::new(monitor, scene.output.probes.len(), per_period, settle);
    recorder.note(scheme.as_mut())?;
    let mut beside: Option<(Box<dyn Scheme>, Exponent)> = None;
    for step in 0..sweep.periods * per_period {
        if step.is_multiple_of(ASK_EVERY) && interrupts() {
            return Err(Error::Interrupted { step, time: scheme.time() });
        }
        if sweep.lyapunov && step == settle {
            let mut second = begin()?;
            let mut runs = TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
            runs.part()?;
            let exponent = Exponent::new(&mut runs, sweep.periods - sweep.settle)?;
            beside = Some((second, exponent));
        }
        scheme.advance()?;
        recorder.note(scheme.as_mut())?;
        if let Some((second, exponent)) = &mut beside {
            second.advance()?;
            second.take_events();
            if (step + 1).is_multiple_of(per_period) {
                let mut runs =
                    TwoRuns { system: &model.system, first: scheme.as_mut(), second: second.as_mut() };
                exponent.note(&mut runs)?;
            }
        }
    }
    let lyapunov = beside.and_then(|(_, exponent)| exponent.per_period()).map(|per| per / sweep.period());
    let displacement = scheme.displacement().to_vec();
    let velocity = scheme.velocity()?;
    let measures = recorder.measures(scheme.as_ref(), sweep.tolerance, lyapunov)?;
    Ok((measures, CarriedState { displacement, velocity, periods: before + sweep.periods }))
}
