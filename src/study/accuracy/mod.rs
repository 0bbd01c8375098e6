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
pub mod norms;
pub mod pictures;
pub mod plan;
mod report;
pub mod trajectory;
pub mod truth;

use crate::dof_map::DofMap;
use crate::error::{Error, Result};
use crate::linalg::Native;
use crate::mesh::{Cell, Mesh, Point};
use crate::modes;
use crate::scene::{EngineName, Grid, Horizon, Mass, Probe, Scene, Study};
use crate::simulation::{self, Matrices, Model, Outcome};
use norms::{Jet, Metric, Norms, Points, Sampler};
use plan::{Case, Dropped, Plan, mesh_name};
use serde::{Deserialize, Serialize};
use std::rc::Rc;
use trajectory::{Deviation, Distance, Parts, Trajectory};
use truth::{Family, ReferenceSolution, ReferenceSpec};

/// Limit on the total time of a case's repetitions, in s.
const PATIENCE: f64 = 10.0;

/// Total time, in s, up to which short cases are repeated, at most [`MOST_REPETITIONS`] times.
///
/// This keeps a momentary disturbance from affecting the ranks.
const ENOUGH: f64 = 0.2;
const MOST_REPETITIONS: u32 = 30;

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

/// Scales of relative errors: the largest magnitudes in the motion on the reference mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Scales {
    /// Deflection at the probes, in m.
    pub deflection: f64,
    /// L2 norm of the deflection, in m2.
    pub l2: f64,
    /// Energy norm of the deflection, in J^(1/2).
    pub energy: f64,
}

/// Motion to which runs converge as their step tends to zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the mesh.
    pub mesh: String,
    /// Mass matrix.
    pub mass: Mass,
    /// Family of methods with this limit: all of the singular mass, or one method of the consistent
    /// mass.
    pub family: String,
    /// Method by which the motion was computed.
    pub source: String,
    /// Methods that were tried before, and why they failed.
    pub refused: Vec<String>,
    /// Number of free dofs.
    pub dofs: usize,
    /// Side of a square with the mean area of a cell, two triangles counted as one cell, in m.
    pub size: f64,
    /// Starts of the impacts, in s.
    pub impacts: Vec<f64>,
    /// Time of the first contact, in s.
    pub first_impact: Option<f64>,
    /// Estimate of the limit's own error at the probes, relative.
    pub own_error: Parts<Deviation>,
    /// Error in space: the distance from the motion on the reference mesh.
    pub space: Distance,
}

/// Measurements of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Mesh, method and step.
    #[serde(flatten)]
    pub case: Case,
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of steps.
    pub steps: u64,
    /// Number of steps in contact.
    pub contact_steps: u64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of numeric factorisations.
    pub factorisations: u64,
    /// Worst relative KKT residual.
    pub worst_kkt: f64,
    /// Time of mesh, matrices, static start and first factorisation, in s.
    pub set_up_seconds: f64,
    /// Time of all steps, in s.
    pub stepping_seconds: f64,
    /// Distance from the limit on the same mesh.
    pub time: Distance,
    /// Error in time that ranks the run: root mean square at the probes up to the horizon,
    /// relative.
    pub time_error: f64,
    /// Error in space of the limit: root mean square at the probes up to the horizon, relative.
    pub space_error: f64,
    /// Whether the error in time is too close to the limit's own error to be resolved.
    pub at_floor: bool,
    /// Time of the first contact minus that of the limit, in s.
    pub first_impact_error: Option<f64>,
    /// Relative change of the energy at the end, and the largest magnitude of that change during
    /// the run.
    pub energy_drift: Option<[f64; 2]>,
}

impl Run {
    /// Returns the time of the whole run, in s.
    pub fn seconds(&self) -> f64 {
        self.set_up_seconds + self.stepping_seconds
    }

    /// Returns a bound on the whole error, relative.
    pub fn error(&self) -> f64 {
        self.time_error + self.space_error
    }

    /// Returns the name of the larger error.
    pub fn dominating(&self) -> &'static str {
        if self.time_error > self.space_error { "time" } else { "space" }
    }
}

/// Run that did not reach its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// Name of the run.
    pub what: String,
    /// Reason of the failure.
    pub why: String,
}

/// Results of a study: the cost and the errors of each run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// Title of the scene.
    pub title: String,
    /// Whether all runs are included.
    pub complete: bool,
    /// Horizon that ranks the runs; the whole run if the scene's horizon needs an impact that is
    /// missing.
    pub until: Horizon,
    /// Time between instants of comparison, in s.
    pub interval: f64,
    /// Names of the probes.
    pub probes: Vec<String>,
    /// Scales of relative errors.
    pub scales: Scales,
    /// Mesh on which the error in space is measured, and the method that computed its motion.
    pub reference: String,
    /// Limits of the runs.
    pub limits: Vec<Limit>,
    /// Completed runs.
    pub runs: Vec<Run>,
    /// Failed runs.
    pub failures: Vec<Failure>,
    /// Combinations left out.
    #[serde(skip_deserializing)]
    pub dropped: Vec<Dropped>,
    /// Largest number of simultaneous runs; times are unreliable if it exceeds 1.
    pub at_once: usize,
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

/// Motion on the reference mesh, at its quadrature points.
struct Reference {
    truth: ReferenceSolution,
    points: Points,
    jets: Vec<Vec<Jet>>,
}

impl Reference {
    fn new(base: &Scene, truth: ReferenceSolution) -> Result<Reference> {
        let (mesh, space) = mesh_and_space(base, truth.grid)?;
        let points = Points::new(&mesh, &simulation::sections(base, &mesh)?)?;
        let sampler = Sampler::new(&mesh, &space, points.at())?;
        let jets = truth.trajectory.fields.iter().map(|u| sampler.jets(u)).collect();
        Ok(Reference { truth, points, jets })
    }

    fn scales(&self) -> Scales {
        let zeros = vec![[0.0; 4]; self.points.at().len()];
        let largest = self.jets.iter().fold(Norms::default(), |largest, jets| {
            let norms = self.points.distance(jets, &zeros);
            Norms { l2: largest.l2.max(norms.l2), energy: largest.energy.max(norms.energy) }
        });
        Scales { deflection: self.truth.trajectory.scale(), l2: largest.l2, energy: largest.energy }
    }

    /// Returns the error in space of a motion on another mesh.
    fn distance(&self, base: &Scene, truth: &ReferenceSolution, instants: &[f64]) -> Result<Distance> {
        let (mesh, space) = mesh_and_space(base, truth.grid)?;
        let sampler = Sampler::new(&mesh, &space, self.points.at())?;
        let norms: Vec<Norms> = truth
            .trajectory
            .fields
            .iter()
            .zip(&self.jets)
            .map(|(u, reference)| self.points.distance(&sampler.jets(u), reference))
            .collect();
        let finest = &self.truth;
        Ok(Distance::new(&truth.trajectory, &finest.trajectory, &finest.impacts, Some(&norms), instants))
    }
}

fn mesh_and_space(base: &Scene, grid: Grid) -> Result<(Mesh, DofMap)> {
    let mut scene = base.clone();
    scene.mesh = grid;
    let mesh = simulation::mesh(&scene)?;
    let space = simulation::space(&scene, &mesh)?;
    Ok((mesh, space))
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

impl Accuracy {
    /// Returns the limit of a family on a mesh.
    fn limit(&self, grid: &Grid, family: Family) -> Option<&Limit> {
        let (mesh, family) = (mesh_name(grid), family.to_string());
        self.limits.iter().find(|limit| limit.mesh == mesh && limit.family == family)
    }
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

fn limit(mesh: &Mesh, truth: &ReferenceSolution, dofs: usize, scales: Scales, space: Distance) -> Limit {
    let relative =
        |d: Deviation| Deviation { rms: d.rms / scales.deflection, max: d.max / scales.deflection };
    Limit {
        mesh: mesh_name(&truth.grid),
        mass: match truth.family {
            Family::Singular => Mass::Singular,
            Family::Consistent(_) => Mass::Consistent,
        },
        family: truth.family.to_string(),
        source: truth.source.clone(),
        refused: truth.refused.clone(),
        dofs,
        size: size(mesh),
        impacts: truth.impacts.clone(),
        first_impact: truth.first_impact,
        own_error: truth.error.probes.map(relative),
        space,
    }
}

/// Returns the side of a square with the mean area of a cell, in m; two triangles count as one
/// cell.
fn size(mesh: &Mesh) -> f64 {
    let area = |cell| mesh.area(cell);
    let parts = |cell: &Cell| if cell.nodes().len() == 3 { 0.5 } else { 1.0 };
    let rectangles: f64 = mesh.cells.iter().map(parts).sum();
    ((0..mesh.cells.len()).map(area).sum::<f64>() / rectangles).sqrt()
}

/// Completed run of a case.
struct Measurement {
    trajectory: Trajectory,
    outcome: Outcome,
    keep_fields: bool,
    /// Least times of set-up and of stepping, in s.
    seconds: [f64; 2],
}

/// Runs a case once for its motion, then repeatedly for its time.
fn take(base: &Scene, study: &Study, case: &Case, interval: f64, run: &Runner) -> Result<Measurement> {
    let mut scene = case.scene(base, interval);
    let keep_fields = scene.solver.engine == EngineName::Native;
    let (trajectory, outcome) = run(&scene, keep_fields)?;
    scene.output.every = u64::MAX;
    let (mut set_up_seconds, mut stepping_seconds, mut spent) = (f64::INFINITY, f64::INFINITY, 0.0);
    for round in 0.. {
        let settled = study.repeat == 1 || spent > ENOUGH || round >= MOST_REPETITIONS;
        if round >= study.repeat && settled || spent > PATIENCE {
            break;
        }
        let (_, outcome) = run(&scene, false)?;
        let seconds = outcome.seconds;
        let set_up = seconds.assembly + seconds.equilibrium + seconds.factor;
        set_up_seconds = set_up.min(set_up_seconds);
        stepping_seconds = seconds.stepping.min(stepping_seconds);
        spent += set_up + seconds.stepping;
    }
    Ok(Measurement { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] })
}

/// Works as [`take`] for several cases at the same time, on the native engine.
fn take_at_once(base: &Scene, study: &Study, cases: &[&Case], interval: f64) -> Vec<Result<Measurement>> {
    std::thread::scope(|scope| {
        let start = |case| scope.spawn(move || take(base, study, case, interval, &run_native));
        let running: Vec<_> = cases.iter().copied().map(start).collect();
        running
            .into_iter()
            .map(|run| run.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

/// Measures the distance of a case from its limit.
fn measure(
    study: &Study,
    case: &Case,
    taken: Measurement,
    truth: &ReferenceSolution,
    metric: &Metric,
) -> Result<Run> {
    let Measurement { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] } = taken;
    let reference = &truth.trajectory;
    let norms: Option<Vec<Norms>> = keep_fields
        .then(|| {
            let pairs = trajectory.fields.iter().zip(&reference.fields);
            pairs.map(|(a, b)| metric.distance(a, b)).collect::<Result<_>>()
        })
        .transpose()?;
    let time = Distance::new(&trajectory, reference, &truth.impacts, norms.as_deref(), &study.at);
    let touch = outcome.first_impact.map(|impact| impact.time);
    Ok(Run {
        case: *case,
        dofs: outcome.dofs,
        steps: outcome.steps,
        contact_steps: outcome.contact_steps,
        vi_iterations: outcome.vi_iterations,
        factorisations: outcome.factorisations,
        worst_kkt: outcome.worst_kkt,
        set_up_seconds,
        stepping_seconds,
        time,
        time_error: f64::NAN,
        space_error: f64::NAN,
        at_floor: false,
        first_impact_error: touch.zip(truth.first_impact).map(|(own, exact)| own - exact),
        energy_drift: trajectory.energy_drift(),
    })
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
