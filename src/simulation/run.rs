//! Runs of a model: from the start, or from the state of an interrupted run.

use super::time_loop::{RunMonitor, TimeLoop, time_loop};
use super::{Model, Observer, Outcome, RunState, condensed, phase};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::scene::Scene;
use crate::scheme::{Scheme, Statistics};
use crate::vi::SolverFactory;
use std::time::Instant;

/// Runs a model with a contact solver. The outcome shows how far the run came, whatever stopped it.
///
/// # Errors
/// Returns an error where the run cannot start.
pub fn run<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    solver: &SolverFactory<E>,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    resume(scene, model, solver, None, observer)
}

impl<E: Engine + 'static> Model<E> {
    /// Runs the model with the condensed contact solver, like [`run`].
    ///
    /// # Errors
    /// Returns an error where the run cannot start.
    pub fn run(&self, scene: &Scene, observer: &mut dyn Observer) -> Result<(Outcome, Result<()>)> {
        run(scene, self, &condensed, observer)
    }
}

/// Runs a model like [`run`], from a paused run of the same scene, if there is one. The resumed run
/// is bitwise identical to an uninterrupted one.
///
/// # Errors
/// Returns the same errors as [`run`], and [`crate::Error::Checkpoint`] for the state of another
/// scene.
pub fn resume<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    solver: &SolverFactory<E>,
    from: Option<RunState>,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    let clock = Instant::now();
    phase("factorisation");
    let mut scheme = model.scheme_with(scene, solver).map_err(|why| scene.explain(why))?;
    let part = from.map(|state| state.part(model)).transpose()?;
    run_from(scene, model, scheme.as_mut(), clock.elapsed().as_secs_f64(), part, observer)
}

/// Runs a model like [`run`], with a scheme at its start, which took `seconds` to build.
///
/// # Errors
/// Returns the same errors as [`run`].
pub fn run_scheme<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    scheme: &mut dyn Scheme,
    seconds: f64,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    run_from(scene, model, scheme, seconds, None, observer)
}

/// Runs the scheme from its start or from the state in an archive.
fn run_from<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    scheme: &mut dyn Scheme,
    seconds: f64,
    from: Option<Archive>,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    if model.reactions.is_some() {
        scheme.keep_balance()?;
    }
    let mut outcome = Outcome::new(model, scheme, seconds)?;
    let mut monitor = RunMonitor::new(scene, model, scheme)?;
    if let Some(mut archive) = from {
        monitor.archive(model, scheme, &mut outcome, &mut archive)?;
    }
    let ended = time_loop(TimeLoop {
        scene,
        model,
        scheme,
        outcome: &mut outcome,
        monitor: &mut monitor,
        observer,
        probes: vec![0.0; model.probes.len()],
        observed: Ok(()),
    });
    outcome.forces = monitor.forces.summary(scheme.time());
    let dissipated = model.friction(scene, scheme).into_iter();
    outcome.dissipated = scene.slider_names().zip(dissipated.map(|[_, dissipated]| dissipated)).collect();
    let heats = monitor.forces.obstacles().zip(scheme.dissipated_by_obstacles());
    let heats = heats.zip(scene.dissipating_obstacles()).filter(|(_, dissipates)| *dissipates);
    outcome.dissipated.extend(heats.map(|((name, heat), _)| (name.to_owned(), heat)));
    let Statistics { factorisations, relaxation, events, stretching_gap } = scheme.statistics();
    (outcome.factorisations, outcome.relaxation, outcome.tally) = (factorisations, relaxation, events);
    outcome.stretching_gap = stretching_gap;
    outcome.linear = model.system.engine.linear_solves().into();
    let comm = model.system.engine.comm();
    // Other errors may have stopped some processes earlier than others.
    let is_common = matches!(
        ended,
        Ok(()) | Err(Error::Interrupted { .. } | Error::EnergyGuard { .. } | Error::PulledIn { .. })
    );
    if is_common || comm.size() == 1 {
        outcome.extremes = monitor.extremes(model);
        outcome.worst_penetration = comm.all_reduce_max(outcome.worst_penetration);
        outcome.largest_deflection = monitor.deflection.largest(comm);
    }
    outcome.seconds.blocks = monitor.clock.seconds;
    outcome.seconds.stepping = outcome.seconds.blocks.total();
    Ok((outcome, ended))
}
