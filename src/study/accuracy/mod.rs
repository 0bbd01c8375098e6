//! What accuracy costs in time: the work behind `rebond study`.
//!
//! Each run is measured twice. Its *error in time* is its distance from the motion of the semi-discrete problem on its own mesh
//! ([`truth`]); its *error in space* is the distance of that motion from the one on a finer mesh, both evaluated as the C1
//! functions they are ([`norms`]). Their sum bounds the whole error, and the larger says where to spend. Runs are ranked by
//! the root mean square of the error at the probes, relative to the largest deflection there, up to the
//! [horizon](crate::scene::Horizon) that the scene names: past the second impact the motion of this problem amplifies any difference, and a
//! comparison of trajectories says little.
//!
//! Seconds are the least of several repetitions after a first run, which is the one that is measured.

pub mod front;
pub mod norms;
pub mod pictures;
pub mod plan;
mod report;
pub mod trajectory;
pub mod truth;

use crate::error::{Error, Result};
use crate::linalg::Native;
use crate::mesh::{Cell, Mesh, Point};
use crate::modes;
use crate::scene::{EngineName, Grid, Horizon, Mass, Probe, Scene, Study};
use crate::simulation::{self, Matrices, Model, Outcome};
use crate::space::Space;
use norms::{Jet, Metric, Norms, Points, Sampler};
use plan::{Case, Dropped, Plan, mesh_name};
use serde::{Deserialize, Serialize};
use std::rc::Rc;
use trajectory::{Deviation, Distance, Parts, Trajectory};
use truth::{Family, Truth};

/// Repetitions stop once they have taken this long together, in s.
const PATIENCE: f64 = 10.0;

/// Short runs are repeated until they have taken this long together, in s, so that one moment's disturbance does not rank them; at most
/// this often.
const ENOUGH: f64 = 0.2;
const MOST_REPETITIONS: u32 = 30;

/// Steps from which the time of a run is foretold.
const FORETELLING_STEPS: f64 = 20.0;

/// A truth computed by small steps takes this part of the smallest step of the study, on the reference mesh and on the others.
const REFERENCE_STEP: f64 = 0.5;
const LIMIT_STEP: f64 = 0.25;

/// Contacts less than this part of the first natural period apart are one impact.
const PART_OF_PERIOD: f64 = 0.125;

/// Frequencies among which the first is sought: a plate has three rigid motions at most.
const LOWEST: usize = 4;

/// A run within this many times the truth's own error is not told from it.
const FLOOR: f64 = 3.0;

/// Runs a scene on the engine that it names, and keeps the displacements where asked to.
pub type Runner<'r> = dyn Fn(&Scene, bool) -> Result<(Trajectory, Outcome)> + 'r;

/// The native engine's [`Runner`].
///
/// # Errors
/// What [`Model::new`] says, and what ends the run.
pub fn natively(scene: &Scene, keep_fields: bool) -> Result<(Trajectory, Outcome)> {
    Trajectory::record(scene, &Model::new(scene)?, &simulation::condensed, keep_fields)
}

/// What watches a study.
pub trait Watch {
    /// The study begins: so many parts of work, and about so many seconds.
    fn begins(&mut self, parts: usize, seconds: f64);

    /// A part of the work begins.
    fn starts(&mut self, what: &str);

    /// A part is done, and this is what is known.
    ///
    /// # Errors
    /// Whatever keeps it from going on; the study stops.
    fn done(&mut self, so_far: &Accuracy) -> Result<()>;
}

/// What a relative error is relative to: the largest magnitude in the finest motion.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Scales {
    /// Deflection at the probes, in m.
    pub deflection: f64,
    /// L2 norm of the deflection, in m2.
    pub l2: f64,
    /// Its energy norm, in J^(1/2).
    pub energy: f64,
}

/// A motion that runs tend to as their step shrinks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// The mesh.
    pub mesh: String,
    /// Its mass.
    pub mass: Mass,
    /// Whose limit it is: the singular mass has one, of the consistent one each method has its own.
    pub family: String,
    /// How it was computed.
    pub source: String,
    /// What was to compute it before, and why it did not.
    pub refused: Vec<String>,
    /// Free dofs.
    pub dofs: usize,
    /// Side of a square as large as a cell on average, two triangles counted as one, in m.
    pub size: f64,
    /// When its impacts begin, in s.
    pub impacts: Vec<f64>,
    /// Its first touch, in s.
    pub first_impact: Option<f64>,
    /// Its own error at the probes, estimated, relative.
    pub own_error: Parts<Deviation>,
    /// Its distance from the motion on the reference mesh: the error in space.
    pub space: Distance,
}

/// One run, measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// What ran.
    #[serde(flatten)]
    pub case: Case,
    /// Free dofs.
    pub dofs: usize,
    /// Steps.
    pub steps: u64,
    /// Those in contact.
    pub contact_steps: u64,
    /// Iterations of the contact solver.
    pub vi_iterations: u64,
    /// Numeric factorisations.
    pub factorisations: u64,
    /// Worst relative KKT residual.
    pub worst_kkt: f64,
    /// Seconds of mesh, matrices, static start and first factorisation.
    pub set_up_seconds: f64,
    /// Seconds of all steps.
    pub stepping_seconds: f64,
    /// Distance from the limit on the same mesh.
    pub time: Distance,
    /// Error in time that ranks the run: root mean square at the probes up to the horizon, relative.
    pub time_error: f64,
    /// Error in space of its limit, likewise.
    pub space_error: f64,
    /// Whether the error in time is too near the limit's own to be told from it.
    pub at_floor: bool,
    /// Instant of the first touch less that of the limit, in s.
    pub first_impact_error: Option<f64>,
    /// Energy at the end over its start less one, and the largest such departure.
    pub energy_drift: Option<[f64; 2]>,
}

impl Run {
    /// Seconds of the whole run.
    pub fn seconds(&self) -> f64 {
        self.set_up_seconds + self.stepping_seconds
    }

    /// Bound of the whole error, relative.
    pub fn error(&self) -> f64 {
        self.time_error + self.space_error
    }

    /// The error that dominates.
    pub fn dominating(&self) -> &'static str {
        if self.time_error > self.space_error { "time" } else { "space" }
    }
}

/// A run that did not reach its end.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// What ran.
    pub what: String,
    /// What ended it.
    pub why: String,
}

/// A study: what each run costs, and how far it is off.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// The scene's title.
    pub title: String,
    /// Whether all runs are in.
    pub complete: bool,
    /// What ranks the runs: the part of them that the scene names, if they have the impact that ends it, else the whole.
    pub until: Horizon,
    /// Time between instants of comparison, in s.
    pub interval: f64,
    /// The probes' names.
    pub probes: Vec<String>,
    /// What errors are relative to.
    pub scales: Scales,
    /// The mesh on which the error in space is measured, and how its motion was computed.
    pub reference: String,
    /// What runs tend to.
    pub limits: Vec<Limit>,
    /// The runs.
    pub runs: Vec<Run>,
    /// Those that failed.
    pub failures: Vec<Failure>,
    /// Combinations left out.
    #[serde(skip_deserializing)]
    pub dropped: Vec<Dropped>,
    /// Most runs made at once; from 2 on their times are not to be relied on.
    pub at_once: usize,
}

/// A scene without probes is watched at its corners, the middles of its edges, and its centre; on a mesh from a file, at the nodes nearest
/// to those of the rectangle about it.
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

/// The motion on the reference mesh, at its quadrature points.
struct Reference {
    truth: Truth,
    points: Points,
    jets: Vec<Vec<Jet>>,
}

impl Reference {
    fn new(base: &Scene, truth: Truth) -> Result<Reference> {
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

    /// The error in space of a motion on another mesh.
    fn distance(&self, base: &Scene, truth: &Truth, instants: &[f64]) -> Result<Distance> {
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

fn mesh_and_space(base: &Scene, grid: Grid) -> Result<(Mesh, Space)> {
    let mut scene = base.clone();
    scene.mesh = grid;
    let mesh = simulation::mesh(&scene)?;
    let space = simulation::space(&scene, &mesh)?;
    Ok((mesh, space))
}

/// The first natural period of a scene with obstacles, in s; 0 where it does not matter.
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

/// Makes a study: every case of its plan on the runner of its engine, but for what is known of the same study already. With several
/// `jobs` as many cases run at once, if all are on the native engine: their times are then not to be relied on.
///
/// # Errors
/// What ends the motion that all are measured against, and what the watch says. A run that fails is told, and the study goes on.
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
    watch.begins(parts, foretell(base, study, &todo, finest, interval, run));

    let together = PART_OF_PERIOD * first_period(base)?;
    let reference = if todo.reference {
        watch.starts(&format!("reference, {}", mesh_name(&finest)));
        let step = REFERENCE_STEP * smallest;
        let truth = Truth::new(base, finest, Family::Singular, interval, step, together, run)?;
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
        let mut truths: Vec<(Family, Rc<Truth>)> = Vec::new();
        for (_, family) in todo.limits.iter().filter(|(own, _)| *own == grid) {
            let step = LIMIT_STEP * smallest;
            watch.starts(&format!("limit, {}", mesh_name(&grid)));
            match Truth::new(base, grid, *family, interval, step, together, run) {
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
                    None => Err(Error::Usage("the motion that it tends to could not be computed".into())),
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
    /// The limit of a family on a mesh.
    fn limit(&self, grid: &Grid, family: Family) -> Option<&Limit> {
        let (mesh, family) = (mesh_name(grid), family.to_string());
        self.limits.iter().find(|limit| limit.mesh == mesh && limit.family == family)
    }
}

/// What is left of a plan.
struct Todo {
    /// The motion that the error in space is measured against, for a limit whose own is not known.
    reference: bool,
    /// The limits of runs that are left, and those not known.
    limits: Vec<(Grid, Family)>,
    /// The runs.
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

fn limit(mesh: &Mesh, truth: &Truth, dofs: usize, scales: Scales, space: Distance) -> Limit {
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

/// Side of a square as large as a cell on average, in m; two triangles count as one.
fn size(mesh: &Mesh) -> f64 {
    let area = |cell| mesh.area(cell);
    let parts = |cell: &Cell| if cell.nodes().len() == 3 { 0.5 } else { 1.0 };
    let rectangles: f64 = mesh.cells.iter().map(parts).sum();
    ((0..mesh.cells.len()).map(area).sum::<f64>() / rectangles).sqrt()
}

/// A case that was run.
struct Taken {
    trajectory: Trajectory,
    outcome: Outcome,
    keep_fields: bool,
    /// Least seconds of set-up and of stepping.
    seconds: [f64; 2],
}

/// Runs a case: once for its motion, then for the time that it takes.
fn take(base: &Scene, study: &Study, case: &Case, interval: f64, run: &Runner) -> Result<Taken> {
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
    Ok(Taken { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] })
}

/// As [`take`], cases side by side on the native engine.
fn take_at_once(base: &Scene, study: &Study, cases: &[&Case], interval: f64) -> Vec<Result<Taken>> {
    std::thread::scope(|scope| {
        let start = |case| scope.spawn(move || take(base, study, case, interval, &natively));
        let running: Vec<_> = cases.iter().copied().map(start).collect();
        running
            .into_iter()
            .map(|run| run.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

/// How far a case is from the motion that it tends to.
fn measure(study: &Study, case: &Case, taken: Taken, truth: &Truth, metric: &Metric) -> Result<Run> {
    let Taken { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] } = taken;
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

/// Seconds of all runs, from the first steps of each method on each mesh: contact costs more.
fn foretell(base: &Scene, study: &Study, todo: &Todo, finest: Grid, interval: f64, run: &Runner) -> f64 {
    let seconds = |case: &Case, repetitions: f64| {
        let mut scene = case.scene(base, interval);
        let steps = scene.time.steps() as f64;
        scene.time.end = scene.time.step * steps.min(FORETELLING_STEPS);
        // What fails now fails quickly when its turn comes.
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
        // Twice exactly; else with the step, and with twice that.
        let (step, again) = if method.scheme.name().has_step() { (step, 0.5) } else { (interval, 1.0) };
        seconds(&Case { grid, method, step }, again)
    };
    let runs: f64 = todo.cases.iter().map(|case| seconds(case, f64::from(study.repeat))).sum();
    let limits = todo.limits.iter().map(|(grid, family)| truth(*grid, *family, LIMIT_STEP * smallest));
    let reference = f64::from(u8::from(todo.reference));
    runs + limits.sum::<f64>() + reference * truth(finest, Family::Singular, REFERENCE_STEP * smallest)
}
