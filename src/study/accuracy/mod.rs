//! Work-precision study behind `rebond study`: the error of each run against its time.
//!
//! Each run is measured twice. Its *error in time* is its distance from the motion of the
//! semi-discrete problem on its own mesh ([`truth`]). Its *error in space* is the distance of that
//! motion from the one on a finer mesh, both evaluated as the C1 functions they are ([`norms`]).
//! Their sum bounds the whole error, and the larger one shows what to refine. Runs are ranked by
//! the root mean square of the error at the probes, relative to the largest deflection there, up to
//! the [horizon](crate::scene::Horizon) that the scene names: past the second impact the motion
//! amplifies any difference, so that a comparison of trajectories says little.
//!
//! A first run gives the errors. Its seconds are the least of several further repetitions.

pub mod front;
mod measuring;
pub mod norms;
pub mod pictures;
pub mod plan;
mod report;
pub mod trajectory;
pub mod truth;
mod types;

use crate::error::{Error, Result};
use crate::linalg::Native;
use crate::mesh::Point;
use crate::modes;
use crate::scene::{EngineName, Grid, Horizon, Probe, Scene, Study};
use crate::simulation::{self, Matrices, Model, Outcome};
use measuring::{PATIENCE, Reference, limit, measure, mesh_and_space, take, take_at_once};
use norms::Metric;
use plan::{Case, Plan, mesh_name};
use std::rc::Rc;
use trajectory::{Deviation, Parts, Trajectory};
use truth::{Family, ReferenceSolution, ReferenceSpec};
pub use types::{Accuracy, Failure, Limit, Run, Scales};

/// Number of steps from which the time of a run is estimated.
const FORETELLING_STEPS: f64 = 20.0;

/// Steps of reference solutions relative to the smallest step of the study.
///
/// The first holds for the reference mesh, the second for the other meshes.
const REFERENCE_STEP: f64 = 0.5;
const LIMIT_STEP: f64 = 0.25;

/// Largest time between contacts of one impact, relative to the first natural period.
const PART_OF_PERIOD: f64 = 0.125;

/// Number of frequencies computed to find the first positive one; rigid motions are three at most.
const LOWEST: usize = 4;

/// Ratio to the reference solution's own error below which a run's error is not resolved.
const FLOOR: f64 = 3.0;

/// Runs a scene on the engine that it names, and keeps the displacements where asked to.
pub type Runner<'r> = dyn Fn(&Scene, bool) -> Result<(Trajectory, Outcome)> + 'r;

/// Runs a scene on the native engine; this is its [`Runner`].
///
/// # Errors
/// Returns the errors of [`Model::new`], and the error that ends the run.
pub fn run_native(scene: &Scene, keep_fields: bool) -> Result<(Trajectory, Outcome)> {
    Trajectory::record(scene, &Model::new(scene)?, &simulation::condensed, keep_fields)
}

/// Observer of a study.
pub trait Watch {
    /// Reports the start of the study, with its number of parts and an estimate of its seconds.
    fn begins(&mut self, parts: usize, seconds: f64);

    /// Reports the start of one part.
    fn starts(&mut self, what: &str);

    /// Reports the end of one part, with all results so far.
    ///
    /// # Errors
    /// Returns any error that prevents the study from going on, which then stops.
    fn done(&mut self, so_far: &Accuracy) -> Result<()>;
}

/// Runs a study: every case of its plan that is not `known` yet.
///
/// Up to `jobs` cases run at the same time if all are on the native engine, which makes their times
/// unreliable. A failed run is recorded, and the study goes on.
///
/// # Errors
/// Returns [`Error::Usage`] where the steps have no common multiple, the error of the motion on the
/// reference mesh, and errors of `watch`.
pub fn study(
    scene: &Scene,
    study: &Study,
    known: Option<Accuracy>,
    run: &Runner,
    jobs: usize,
    watch: &mut dyn Watch,
) -> Result<Accuracy> {
    let jobs = if study.engines == [EngineName::Native] { jobs.max(1) } else { 1 };
    let base = &watched(scene)?;
    let plan = Plan::new(base, study);
    let interval = study.interval(base.time.end).ok_or_else(|| {
        Error::Usage("the steps of the study have no common multiple short enough to compare runs".into())
    })?;
    let smallest = study.steps.iter().copied().fold(f64::INFINITY, f64::min);
    let finest = base.mesh.with(study.elements[0], study.reference_cells, study.reference_refine);
    let todo = Todo::new(&plan, known.as_ref());
    let parts = usize::from(todo.reference) + todo.limits.len() + todo.cases.len();
    watch.begins(parts, estimate_seconds(base, study, &todo, finest, interval, run));

    let together = PART_OF_PERIOD * first_period(base)?;
    let reference = if todo.reference {
        watch.starts(&format!("reference, {}", mesh_name(&finest)));
        let step = REFERENCE_STEP * smallest;
        let spec = ReferenceSpec { grid: finest, family: Family::Singular, interval, step, together };
        let truth = ReferenceSolution::new(base, spec, run)?;
        Some(Reference::new(base, truth)?)
    } else {
        None
    };
    let mut accuracy = known.unwrap_or_else(|| Accuracy {
        title: base.title.clone(),
        complete: false,
        until: study.until,
        interval,
        probes: base.output.probes.iter().map(|probe| probe.name.clone()).collect(),
        scales: Scales::default(),
        reference: String::new(),
        limits: Vec::new(),
        runs: Vec::new(),
        failures: Vec::new(),
        dropped: Vec::new(),
        at_once: 1,
    });
    accuracy.dropped = plan.dropped;
    accuracy.at_once = accuracy.at_once.max(jobs);
    if let Some(Reference { truth, .. }) = &reference {
        accuracy.until = match (study.until, truth.impacts.len()) {
            (Horizon::SecondImpact, 0..2) | (Horizon::FirstImpact, 0) => Horizon::End,
            (until, _) => until,
        };
        let refused: String = truth.refused.iter().map(|why| format!("; not by {why}")).collect();
        accuracy.reference = format!("{}, {}{refused}", mesh_name(&finest), truth.source);
        accuracy.scales = reference.as_ref().map(Reference::scales).unwrap_or_default();
        watch.done(&accuracy)?;
    }
    let scales = accuracy.scales;

    for &grid in &plan.grids {
        let (mesh, space) = mesh_and_space(base, grid)?;
        let metric = Metric::new(&mesh, &space, &simulation::sections(base, &mesh)?)?;
        let mut truths: Vec<(Family, Rc<ReferenceSolution>)> = Vec::new();
        for (_, family) in todo.limits.iter().filter(|(own, _)| *own == grid) {
            let step = LIMIT_STEP * smallest;
            watch.starts(&format!("limit, {}", mesh_name(&grid)));
            let spec = ReferenceSpec { grid, family: *family, interval, step, together };
            match ReferenceSolution::new(base, spec, run) {
                Ok(truth) => {
                    if let (None, Some(reference)) = (accuracy.limit(&grid, *family), &reference) {
                        let space_error = reference.distance(base, &truth, &study.at)?;
                        accuracy.limits.push(limit(&mesh, &truth, space.dofs(), scales, space_error));
                    }
                    truths.push((*family, Rc::new(truth)));
                }
                Err(error) => accuracy.failures.push(Failure {
                    what: format!("limit, {}, {family}", mesh_name(&grid)),
                    why: error.to_string(),
                }),
            }
            watch.done(&accuracy)?;
        }
        let cases: Vec<&Case> = todo.cases.iter().filter(|case| case.grid == grid).collect();
        for together in cases.chunks(jobs) {
            together.iter().for_each(|case| watch.starts(&case.to_string()));
            let taken = match together {
                [case] => vec![take(base, study, case, interval, run)],
                _ => take_at_once(base, study, together, interval),
            };
            for (case, taken) in together.iter().zip(taken) {
                let family = Family::of(&case.method);
                let truth = truths.iter().find(|(own, _)| *own == family);
                let measured = match truth.zip(accuracy.limit(&grid, family)) {
                    Some(((_, truth), limit)) => {
                        let space_error = limit.space.probes;
                        taken.and_then(|taken| measure(study, case, taken, truth, &metric)).map(
                            |mut measured| {
                                let horizon =
                                    |parts: Parts<Deviation>| parts.at(study.until).rms / scales.deflection;
                                let own = horizon(truth.error.probes);
                                measured.time_error = horizon(measured.time.probes);
                                measured.space_error = horizon(space_error);
                                measured.at_floor = measured.time_error < FLOOR * own;
                                measured
                            },
                        )
                    }
                    None => Err(Error::Usage("its limit could not be computed".into())),
                };
                match measured {
                    Ok(run) => accuracy.runs.push(run),
                    Err(error) => {
                        accuracy.failures.push(Failure { what: case.to_string(), why: error.to_string() })
                    }
                }
                watch.done(&accuracy)?;
            }
        }
    }
    accuracy.complete = true;
    watch.done(&accuracy)?;
    Ok(accuracy)
}

/// Returns the scene, with default probes if it has none.
///
/// These are the corners, the middles of the edges and the centre of the rectangle. On a mesh from
/// a file they are the nodes nearest to those points of the bounding rectangle.
fn watched(scene: &Scene) -> Result<Scene> {
    let mut scene = scene.clone();
    if scene.output.probes.is_empty() {
        let mesh = simulation::mesh(&scene)?;
        let extremes = |of: fn(&Point) -> f64| {
            mesh.nodes
                .iter()
                .map(of)
                .fold([f64::MAX, f64::MIN], |[least, most], x| [least.min(x), most.max(x)])
        };
        let (x, y) = (extremes(|node| node.x), extremes(|node| node.y));
        let between = |[least, most]: [f64; 2], part: f64| (1.0 - part) * least + part * most;
        let places = [("left", 0.0), ("middle", 0.5), ("right", 1.0)];
        let heights = [("bottom", 0.0), ("middle", 0.5), ("top", 1.0)];
        let probe = |(across, up): ((&str, f64), (&str, f64))| {
            let at = Point::new(between(x, across.1), between(y, up.1));
            let away = |node: &&Point| (**node - at).norm();
            let node = mesh.nodes.iter().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(&at);
            let at = if scene.file.is_some() { *node } else { at };
            Probe { name: format!("{} {}", up.0, across.0), at: [at.x, at.y], point: None, ball: None }
        };
        let pairs = places.iter().flat_map(|across| heights.iter().map(|up| (*across, *up)));
        scene.output.probes = pairs.map(probe).collect();
    }
    Ok(scene)
}

/// Returns the first natural period of a scene with obstacles, in s; 0 for scenes without.
fn first_period(base: &Scene) -> Result<f64> {
    if !base.has_contact() {
        return Ok(0.0);
    }
    let mesh = simulation::mesh(base)?;
    let Matrices { stiffness, consistent, load, .. } = simulation::matrices(base, &mesh, true)?;
    let engine = Native::new(load.len());
    let (stiffness, mass) = (engine.form(stiffness), engine.form(consistent));
    let mechanism = simulation::mechanism(base, &mesh)?.is_some();
    let lowest = modes::lowest(&engine, &stiffness, &mass, LOWEST, mechanism)?;
    Ok(lowest.into_iter().find(|frequency| *frequency > 0.0).map_or(0.0, f64::recip))
}

/// Remaining work of a plan.
struct Todo {
    /// Whether the motion on the reference mesh is needed, for the error in space of some limit.
    reference: bool,
    /// Limits of the remaining runs, and limits not known yet.
    limits: Vec<(Grid, Family)>,
    /// Remaining runs.
    cases: Vec<Case>,
}

impl Todo {
    fn new(plan: &Plan, known: Option<&Accuracy>) -> Todo {
        let failed = |what: String| known.is_some_and(|known| known.failures.iter().any(|f| f.what == what));
        let measured =
            |case: &Case| known.is_some_and(|known| known.runs.iter().any(|run| run.case == *case));
        let is_left = |case: &&Case| !measured(case) && !failed(case.to_string());
        let cases: Vec<Case> = plan.cases.iter().filter(is_left).copied().collect();
        let (mut limits, mut reference) = (Vec::new(), known.is_none());
        for &grid in &plan.grids {
            let of_methods = plan.methods.iter().map(Family::of);
            for family in std::iter::once(Family::Singular).chain(of_methods) {
                let is_known = known.is_some_and(|known| known.limit(&grid, family).is_some());
                let is_needed =
                    cases.iter().any(|case| case.grid == grid && Family::of(&case.method) == family);
                let is_over = is_known || failed(format!("limit, {}, {family}", mesh_name(&grid)));
                if (is_needed || !is_over) && !limits.contains(&(grid, family)) {
                    reference |= !is_over;
                    limits.push((grid, family));
                }
            }
        }
        Todo { reference, limits, cases }
    }
}

/// Estimates the time of all runs, in s, from the first steps of each method on each mesh.
///
/// Contact costs more than these steps.
fn estimate_seconds(
    base: &Scene,
    study: &Study,
    todo: &Todo,
    finest: Grid,
    interval: f64,
    run: &Runner,
) -> f64 {
    let seconds = |case: &Case, repetitions: f64| {
        let mut scene = case.scene(base, interval);
        let steps = scene.time.steps() as f64;
        scene.time.end = scene.time.step * steps.min(FORETELLING_STEPS);
        // A case that fails here fails as quickly in its turn.
        run(&scene, false).map_or(0.0, |(_, outcome)| {
            let of = outcome.seconds;
            let once =
                of.assembly + of.equilibrium + of.factor + of.stepping * steps / outcome.steps.max(1) as f64;
            once * (1.0 + repetitions.min((PATIENCE / once).ceil()))
        })
    };
    let smallest = study.steps.iter().copied().fold(f64::INFINITY, f64::min);
    let truth = |grid: Grid, family: Family, step: f64| {
        let (first, last) = family.methods(truth::cells(base, grid).unwrap_or(usize::MAX));
        let method = first.first().copied().unwrap_or(last);
        // A limit is computed twice: exactly both times, or with the step and with twice the step.
        let (step, again) = if method.scheme.name().has_step() { (step, 0.5) } else { (interval, 1.0) };
        seconds(&Case { grid, method, step }, again)
    };
    let runs: f64 = todo.cases.iter().map(|case| seconds(case, f64::from(study.repeat))).sum();
    let limits = todo.limits.iter().map(|(grid, family)| truth(*grid, *family, LIMIT_STEP * smallest));
    let reference = f64::from(todo.reference);
    runs + limits.sum::<f64>() + reference * truth(finest, Family::Singular, REFERENCE_STEP * smallest)
}
