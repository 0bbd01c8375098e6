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

mod advice;
mod cpu;
pub mod front;
mod measuring;
pub mod norms;
pub mod pictures;
pub mod plan;
mod report;
pub mod trajectory;
pub mod truth;
mod types;
pub mod whole;

use crate::error::{Error, Result};
use crate::geometry::range;
use crate::linalg::Native;
use crate::mesh::Point;
use crate::modes;
use crate::scene::{EngineName, Grid, Horizon, Mass, Probe, ProbeQuantity, Scene, Study};
use crate::simulation::{self, Matrices, Model, Outcome};
use measuring::{Measurement, PATIENCE, Reference, record, take, take_at_once};
use norms::Metric;
use plan::{Absent, Case, Plan, leave_out, mesh_and_space, mesh_name};
use std::rc::Rc;
use trajectory::{Deviation, Parts, Trajectory};
use truth::{Family, ReferenceSolution, ReferenceSpec};
pub use types::{Accuracy, Limit, Run, Scales};
use whole::{BestRun, ReferenceMotion, keep_best};

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
    Trajectory::record(scene, keep_fields, |trajectory| Model::new(scene)?.run(scene, trajectory))
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

/// Runs a study: every case of its plan that is not in the `past` part of it.
///
/// Up to `jobs` cases run at the same time if all are on the native engine, which makes their times
/// unreliable. A failed run is recorded, and the study goes on.
///
/// # Errors
/// Returns the errors of [`Plan::new`], [`Error::Usage`] where the steps have no common multiple,
/// the error of the motion on the reference mesh, and errors of `watch`.
pub fn study(
    scene: &Scene,
    study: &Study,
    past: Option<Accuracy>,
    run: &Runner,
    jobs: usize,
    watch: &mut dyn Watch,
) -> Result<Accuracy> {
    let jobs = if study.engines == [EngineName::Native] { jobs.max(1) } else { 1 };
    let base = &watched(scene)?;
    let plan = Plan::new(base, study)?;
    let interval = study.interval(base.time.end).ok_or_else(|| {
        Error::Usage("the steps of the study have no common multiple short enough to compare runs".into())
    })?;
    let todo = Todo::new(&plan, study, past.as_ref());
    let together = PART_OF_PERIOD * first_period(base)?;
    let setting = Setting { base, study, interval, together, run };
    let parts = usize::from(todo.reference) + todo.limits.len() + todo.cases.len();
    watch.begins(parts, setting.estimate_seconds(&todo));

    let mut accuracy = past.unwrap_or_else(|| Accuracy::unknown(base, study, interval));
    accuracy.dropped = plan.dropped.clone();
    accuracy.at_once = accuracy.at_once.max(jobs);
    let reference = if todo.reference { Some(setting.reference(&mut accuracy, watch)?) } else { None };
    for &grid in &plan.grids {
        let (mesh, space) = mesh_and_space(base, grid)?;
        let metric = Metric::new(&mesh, &space, &simulation::sections(base, &mesh)?)?;
        let mut truths: Vec<(Family, Rc<ReferenceSolution>)> = Vec::new();
        for (_, family) in todo.limits.iter().filter(|(mesh, _)| *mesh == grid) {
            watch.starts(&format!("limit, {}", mesh_name(&grid)));
            match ReferenceSolution::new(base, setting.limit(grid, *family), run) {
                Ok(truth) => {
                    if let (None, Some(reference)) = (accuracy.limit(&grid, *family), &reference) {
                        let limit = reference.limit(base, &truth, accuracy.scales, &study.at)?;
                        accuracy.limits.push(limit);
                    }
                    truths.push((*family, Rc::new(truth)));
                }
                Err(error) => accuracy.failures.push(Absent {
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
                // A scheme and mass that cannot take the scene are told once, not at every step.
                if let Err(Error::Usage(why)) = &taken {
                    let what = format!("{}, {}", mesh_name(&grid), case.method);
                    leave_out(&mut accuracy.dropped, what, why);
                    watch.done(&accuracy)?;
                    continue;
                }
                let recorded =
                    taken.and_then(|taken| setting.record(&mut accuracy, case, &taken, &truths, &metric));
                if let Err(error) = recorded {
                    accuracy.failures.push(Absent { what: case.to_string(), why: error.to_string() });
                }
                watch.done(&accuracy)?;
            }
        }
    }
    accuracy.complete = true;
    watch.done(&accuracy)?;
    Ok(accuracy)
}

/// Scene, lists and instants of a study, and its runner.
struct Setting<'s> {
    base: &'s Scene,
    study: &'s Study,
    interval: f64,
    /// Largest time between contacts of one impact, in s.
    together: f64,
    run: &'s Runner<'s>,
}

impl Setting<'_> {
    /// Returns the specification of the motion on the reference mesh.
    fn finest(&self) -> ReferenceSpec {
        let Study { reference_cells, reference_refine, .. } = *self.study;
        let family = match self.study.reference_mass {
            Mass::Modal => Family::Modal(self.study.reference_modes),
            Mass::Singular | Mass::Consistent => Family::Singular,
        };
        ReferenceSpec {
            grid: self.base.mesh.with(self.study.elements[0], reference_cells, reference_refine),
            family,
            interval: self.interval,
            step: if family == Family::Singular { REFERENCE_STEP } else { LIMIT_STEP } * self.smallest(),
            together: self.together,
            is_limit: false,
            keep_fields: self.study.limits,
        }
    }

    /// Returns the specification of a limit.
    fn limit(&self, grid: Grid, family: Family) -> ReferenceSpec {
        let step = LIMIT_STEP * self.smallest();
        ReferenceSpec { grid, family, step, is_limit: true, keep_fields: true, ..self.finest() }
    }

    /// Returns the smallest step, in s.
    fn smallest(&self) -> f64 {
        self.study.steps.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// Computes the motion on the reference mesh, and enters it into the results.
    fn reference(&self, accuracy: &mut Accuracy, watch: &mut dyn Watch) -> Result<Reference> {
        let spec = self.finest();
        watch.starts(&format!("reference, {}", mesh_name(&spec.grid)));
        let truth = ReferenceSolution::new(self.base, spec, self.run)?;
        let reference = Reference::new(self.base, truth)?;
        let truth = &reference.truth;
        accuracy.until = match (self.study.until, truth.impacts.len()) {
            (Horizon::SecondImpact, 0..2) | (Horizon::FirstImpact, 0) => Horizon::End,
            (until, _) => until,
        };
        let refused: String = truth.refused.iter().map(|why| format!("; not by {why}")).collect();
        accuracy.reference = format!("{}, {}{refused}", mesh_name(&spec.grid), truth.source);
        accuracy.scales = reference.scales();
        accuracy.motion = ReferenceMotion::new(&truth.trajectory, &truth.impacts);
        watch.done(accuracy)?;
        Ok(reference)
    }

    /// Measures the errors of a run, and enters it into the results.
    fn record(
        &self,
        accuracy: &mut Accuracy,
        case: &Case,
        taken: &Measurement,
        truths: &[(Family, Rc<ReferenceSolution>)],
        metric: &Metric,
    ) -> Result<()> {
        let scale = accuracy.scales.deflection;
        let mut run = record(case, taken, accuracy);
        if self.study.limits {
            let family = Family::of(&case.method);
            let truth = truths.iter().find(|(other, _)| *other == family).map(|(_, truth)| truth);
            let Some((truth, limit)) = truth.zip(accuracy.limit(&case.grid, family)) else {
                return Err(Error::Usage("its limit could not be computed".into()));
            };
            let horizon = |parts: Parts<Deviation>| parts.at(self.study.until).rms / scale;
            let time = taken.error_in_time(self.study, truth, metric)?;
            let error = horizon(time.probes);
            run.at_floor = error < FLOOR * horizon(truth.error.probes);
            (run.time_error, run.space_error) = (Some(error), Some(horizon(limit.space.probes)));
            run.first_impact_error =
                taken.outcome.first_impact.zip(truth.first_impact).map(|(a, b)| a.time - b);
            run.time = Some(time);
        }
        if self.study.floor && self.is_finest(&case.grid) {
            let (name, mass, error) = (case.to_string(), case.method.mass, run.whole_error);
            let samples = taken.trajectory.samples.clone();
            keep_best(&mut accuracy.best, BestRun { name, mass, error, samples });
        }
        accuracy.runs.push(run);
        Ok(())
    }

    /// Returns whether no other mesh of the study has more rectangles.
    fn is_finest(&self, grid: &Grid) -> bool {
        let Study { cells, refinements, .. } = self.study;
        let rectangles = |[nx, ny]: [usize; 2], refine: u32| (nx * ny) << (2 * refine);
        let size = rectangles(grid.cells, grid.refine);
        cells.iter().all(|cells| refinements.iter().all(|refine| rectangles(*cells, *refine) <= size))
    }

    /// Estimates the time of all runs, in s, from the first steps of each method on each mesh.
    ///
    /// Contact costs more than these steps.
    fn estimate_seconds(&self, todo: &Todo) -> f64 {
        let mut measured: Vec<(Case, [f64; 2])> = Vec::new();
        let mut seconds = |case: &Case, repetitions: f64| {
            let steps = (self.base.time.end / case.step).round();
            let same =
                measured.iter().find(|(other, _)| (other.grid, other.method) == (case.grid, case.method));
            let [set_up, step] = same.map_or_else(|| self.first_seconds(case), |(_, seconds)| *seconds);
            measured.push((*case, [set_up, step]));
            let once = set_up + step * steps;
            let repeated = if once > PATIENCE { 0.0 } else { repetitions.min((PATIENCE / once).ceil()) };
            once * (1.0 + repeated)
        };
        let mut truth = |spec: ReferenceSpec| {
            let (first, last) = spec.family.methods(
                mesh_and_space(self.base, spec.grid).map_or(usize::MAX, |(mesh, _)| mesh.cells.len()),
            );
            let method = first.first().copied().unwrap_or(last);
            // A limit is computed twice: exactly both times, or with the step and with twice the
            // step.
            let has_step = method.scheme.name().has_step();
            let step = if has_step { spec.step } else { self.interval };
            let case = Case { grid: spec.grid, method, step };
            let once = seconds(&case, 0.0);
            once * if spec.is_limit { if has_step { 1.5 } else { 2.0 } } else { 1.0 }
        };
        let limits: f64 = todo.limits.iter().map(|(grid, family)| truth(self.limit(*grid, *family))).sum();
        let reference = if todo.reference { truth(self.finest()) } else { 0.0 };
        let runs = todo.cases.iter().map(|case| seconds(case, f64::from(self.study.repeat)));
        runs.sum::<f64>() + limits + reference
    }

    /// Returns the time of the set-up and of a step, in s, from the first steps of a case.
    ///
    /// Both are 0 for a case that fails, which fails as quickly in its turn.
    fn first_seconds(&self, case: &Case) -> [f64; 2] {
        let mut scene = case.scene(self.base, self.interval);
        let steps = scene.time.steps() as f64;
        scene.time.end = scene.time.step * steps.min(FORETELLING_STEPS);
        (self.run)(&scene, false).map_or([0.0; 2], |(_, outcome)| {
            let time = outcome.seconds;
            [time.assembly + time.equilibrium + time.factor, time.stepping / outcome.steps.max(1) as f64]
        })
    }
}

/// Returns the scene with the probes of deflections, or with default ones if it has none.
///
/// These are the corners, the middles of the edges and the centre of the rectangle. On a mesh from
/// a file they are the nodes nearest to those points of the bounding rectangle.
fn watched(scene: &Scene) -> Result<Scene> {
    let mut scene = scene.clone();
    scene.output.probes.retain(|probe| probe.quantity == ProbeQuantity::Deflection);
    if scene.output.probes.is_empty() {
        let mesh = simulation::mesh(&scene)?;
        let [x, y] = [0, 1].map(|axis| range(mesh.nodes.iter().map(|node| node[axis])));
        let between = |[least, most]: [f64; 2], part: f64| (1.0 - part) * least + part * most;
        let places = [("left", 0.0), ("middle", 0.5), ("right", 1.0)];
        let heights = [("bottom", 0.0), ("middle", 0.5), ("top", 1.0)];
        for ((column, across), (row, up)) in places.into_iter().flat_map(|x| heights.map(|y| (x, y))) {
            let mut place = Point::new(between(x, across), between(y, up));
            let away = |node: &&Point| (**node - place).norm();
            let nearest = mesh.nodes.iter().min_by(|a, b| away(a).total_cmp(&away(b)));
            if let (Some(node), true) = (nearest, scene.file.is_some()) {
                place = *node;
            }
            let (name, quantity) = (format!("{row} {column}"), ProbeQuantity::Deflection);
            scene.output.probes.push(Probe { name, at: place.into(), point: None, ball: None, quantity });
        }
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
    let is_loose = simulation::mechanism(base, &mesh)?.is_some() || !base.attachments.balls.is_empty();
    let lowest = modes::lowest(&engine, [&stiffness, &mass], LOWEST, is_loose)?;
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
    fn new(plan: &Plan, study: &Study, past: Option<&Accuracy>) -> Todo {
        let failed = |what: String| past.is_some_and(|past| past.failures.iter().any(|f| f.what == what));
        let measured = |case: &Case| past.is_some_and(|past| past.runs.iter().any(|run| run.case == *case));
        let is_left = |case: &&Case| !measured(case) && !failed(case.to_string());
        let cases: Vec<Case> = plan.cases.iter().filter(is_left).copied().collect();
        let (mut limits, mut reference) = (Vec::new(), past.is_none());
        for &grid in plan.grids.iter().filter(|_| study.limits) {
            let always = (study.reference_mass == Mass::Singular).then_some(Family::Singular);
            let of_methods = plan.cases.iter().filter(|case| case.grid == grid);
            for family in always.into_iter().chain(of_methods.map(|case| Family::of(&case.method))) {
                let is_known = past.is_some_and(|past| past.limit(&grid, family).is_some());
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
