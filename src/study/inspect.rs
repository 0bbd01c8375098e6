//! Analysis of a scene before it runs: [`inspect`] its matrices, [`check`] the cost of a run.

use super::frequencies::{
    Frequencies, advised_for, energy_step_for, frequencies, frequencies_of, list, on_native_engine,
    with_rigid_balls,
};
use super::infsup::{self, InfSup};
use super::modal_figures::{self, ModalFigures};
use super::static_reactions::{StaticReaction, static_reactions};
use super::warnings;
use crate::assembly::{self, CellArrays};
use crate::error::{Error, Result};
use crate::linalg::{Engine, Form, Native};
use crate::membrane::Stretch;
use crate::mesh::{Cell, Made, Mesh, Point};
use crate::output::text::{Report, engineering, grouped, short, significant};
use crate::output::vtu;
use crate::scene::{FieldInput, Mass, Output, ProbeQuantity, Scene};
use crate::scheme::exact::expected_candidates;
use crate::scheme::{self, System};
use crate::simulation::{
    self, Fields, LinearChoice, LoadTotal, Matrices, Model, Observer, QuickestRanks, Resultant, Row,
    StressPeak,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt;
use std::time::{Duration, Instant};

/// Number of inserted nodes that a check lists.
const LISTED: usize = 10;

/// Moment relative to the force in N, or to the other moment, below which it is rounding.
const ROUNDING: f64 = 1e-12;

/// Time for which a check measures real steps.
const WATCH: Duration = Duration::from_millis(200);

/// Deflections at a probe, in m.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Deflection {
    /// Name of the probe.
    pub probe: String,
    /// Coordinates of the probe, in m.
    pub at: [f64; 2],
    /// Initial deflection; `None` where a mechanism under load has no static one.
    pub start: Option<f64>,
    /// Static deflection under `[load]`; `None` without load, for a mechanism, and with balls in
    /// the air.
    pub loaded: Option<f64>,
}

/// Results of an inspection.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Title of the scene.
    pub title: String,
    /// Number of nodes of the mesh.
    pub nodes: usize,
    /// Number of cells, which is the number of velocities of the singular mass.
    pub cells: usize,
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of dofs that an obstacle bounds.
    pub bounded_dofs: usize,
    /// Mass of the cells with everything fixed to them (the trace of C), in kg.
    pub mass: f64,
    /// Rigid motions that the supports permit, in words.
    pub mechanism: Option<&'static str>,
    /// Multiple of the forces in the plane at which the plate buckles, nearest to zero; negative
    /// for reversed forces, `None` where it does not buckle.
    pub buckling_factor: Option<f64>,
    /// Multiple of a pressure that depends on the deflection beyond which the plate has no
    /// equilibrium without obstacles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pull_in_factor: Option<f64>,
    /// Place of the largest deflection of a buckled plate, in m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub buckles_at: Option<[f64; 2]>,
    /// Initial energy E_0, in J; `None` where a mechanism under load has no static deflection.
    pub initial_energy: Option<f64>,
    /// Static deflections at the probes.
    pub deflections: Vec<Deflection>,
    /// Largest von Mises stress of the initial deflection; `None` where there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub largest_stress: Option<StressPeak>,
    /// Reactions of the supports in the static start; empty without one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub reactions: Vec<StaticReaction>,
    /// Frequencies with the consistent mass M_r.
    pub consistent: Frequencies,
    /// Frequencies with the singular mass M: that of the scene's modes, or of cells.
    pub singular: Frequencies,
    /// Inf-sup constants of the bounded deflections; of all free ones where there is no obstacle.
    /// They belong to the mass of cells and are not computed for the modal mass.
    pub inf_sup: InfSup,
    /// Figures of the modal mass, if the scene has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modal: Option<ModalFigures>,
    /// [Advised step](super::advised_step), in s.
    pub advised_step: Option<f64>,
    /// [Step for the energy](super::energy_step), in s; `None` where every step conserves it, and
    /// where none does.
    pub energy_step: Option<f64>,
    /// Warnings, each with its reason.
    pub warnings: Vec<String>,
}

/// Results of a check: size and cost of a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// Title of the scene.
    pub title: String,
    /// Scene with every default filled in, as TOML.
    pub scene: String,
    /// Effects that act on the plate.
    pub effects: Vec<String>,
    /// Number of nodes of the mesh.
    pub nodes: usize,
    /// Number of cells of the mesh.
    pub cells: usize,
    /// Names that the mesh file gives to edges, groups and points.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub names: BTreeMap<&'static str, Vec<String>>,
    /// Notes on the mesh file, one sentence each.
    pub notes: Vec<String>,
    /// Nodes moved or inserted for points and lines of obstacles and supports.
    pub made_nodes: Vec<String>,
    /// Pull-in factor as in [`Inspection`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pull_in_factor: Option<f64>,
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of dofs that an obstacle bounds.
    pub bounded_dofs: usize,
    /// Entries of the step matrix's factor; an order with contact dofs last adds a few per cent.
    pub factor_entries: usize,
    /// Linear solver of a run on PETSc, on one rank; `None` on the native engine, which factors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub linear: Option<LinearChoice>,
    /// Estimate of the memory of a run on the native engine, in bytes.
    pub memory: usize,
    /// Forces and moments of the loads.
    pub loads: Vec<LoadTotal>,
    /// Frequencies with the scene's mass.
    pub frequencies: Frequencies,
    /// Figures of the modal mass, if the scene has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modal: Option<ModalFigures>,
    /// Number of steps of the run.
    pub steps: u64,
    /// Time step of the scene, in s.
    pub step: f64,
    /// [Advised step](super::advised_step), in s; also `None` for `exact`, which needs none.
    pub advised_step: Option<f64>,
    /// [Step for the energy](super::energy_step), in s; `None` where every step conserves it, and
    /// where none does.
    pub energy_step: Option<f64>,
    /// Whether the motion between instants is exact, so that any step is accurate.
    pub any_step: bool,
    /// Time per step, in s, measured on the native engine over the first steps, with what a run
    /// records.
    pub seconds_per_step: f64,
    /// Expected time of the run, in s, with set-up, rows and snapshots.
    pub expected_seconds: f64,
    /// Whether anything touches in the first steps.
    #[serde(skip)]
    pub has_watched_contact: bool,
    /// Size of all snapshots, in bytes; `None` where the scene asks for none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snapshots: Option<u64>,
    /// Cost of the scene's sweep, if it has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepCost>,
    /// Ranks that would shorten the run; `None` where one process is the quickest way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub quickest: Option<QuickestRanks>,
    /// Warnings, each with its reason.
    pub warnings: Vec<String>,
}

/// Cost of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SweepCost {
    /// Number of runs.
    pub runs: usize,
    /// Number of periods of each run.
    pub periods: u64,
    /// Expected time in one process, on one thread, in s.
    pub expected_seconds: f64,
}

/// Inspects the matrices of a scene.
///
/// # Errors
/// Returns the errors of [`Model::new`], and those of a static equilibrium that does not converge.
pub fn inspect(scene: &Scene) -> Result<Inspection> {
    let mesh = simulation::mesh(scene)?;
    let mechanism = simulation::mechanism(scene, &mesh)?;
    let mut native = on_native_engine(scene);
    native.output.extremes = true;
    let is_static = scene.initial.is_static();
    let mut model = Model::new(&native);
    let no_start = mechanism.is_some() && is_static && matches!(model, Err(Error::Singular(_)));
    if no_start {
        native.initial.static_pressure = FieldInput::new("initial.static_pressure", 0.0);
        native.initial.equilibrium = false;
        model = Model::new(&native);
    }
    let model = model?;
    let buckling = simulation::buckling(scene, &mesh)?;
    let pull_in_factor = match mechanism {
        None => simulation::pull_in(scene, &mesh)?,
        Some(_) => None,
    };
    let Model { system, .. } = &model;
    let (engine, stiffness) = (&system.engine, &system.stiffness);
    let Matrices { consistent, singular: rows, .. } = simulation::matrices(scene, &mesh, true)?;

    // A ball in the air has no equilibrium.
    let is_loose = mechanism.is_some() || !scene.attachments.balls.is_empty();
    let loaded = match &system.load {
        Some(load) if !is_loose && !scene.stretches() && system.drive.following.is_none() => {
            let (u, _, report) = scheme::equilibrium(engine, stiffness, load, &system.bounds)?;
            simulation::check_residual(0, 0.0, report.kkt, scene.solver.tolerance)?;
            Some(u)
        }
        _ => None,
    };
    let deflection = |(probe, spec): (&assembly::Probe, &crate::scene::Probe)| Deflection {
        probe: spec.name.clone(),
        at: spec.at,
        start: (!no_start).then(|| probe.deflection(&model.start.displacement)),
        loaded: loaded.as_ref().map(|u| probe.deflection(u)),
    };
    let probes = model.probes.iter().zip(&scene.output.probes);
    let probes = probes.filter(|(_, spec)| spec.quantity == ProbeQuantity::Deflection);
    let deflections = probes.map(deflection).collect();

    let mut stresses = model.stress_watch();
    if let Some(stresses) = &mut stresses {
        stresses.note(engine, &model.start.displacement, 0.0)?;
    }
    let peak = stresses.and_then(|stresses| stresses.largest(engine.comm()));
    let largest_stress = peak.filter(|peak| !no_start && peak.value > 0.0);

    let bounded = if system.bounds.is_empty() {
        model.sites.iter().map(|site| site.dof).collect()
    } else {
        system.bounds.dofs.to_vec()
    };
    let is_modal = scene.time.mass == Mass::Modal;
    let inf_sup = match is_modal {
        true => InfSup { raw: None, energy: None },
        false => infsup::constants(engine.dofs(), stiffness, is_loose, &rows, &bounded)?,
    };
    let mass = rows.iter().map(|row| row.mass).sum();
    let cells = engine.averages(rows);
    let singular = if is_modal { &system.mass } else { &cells };
    let consistent = engine.form(consistent);
    let [singular, consistent] = [singular, &consistent].map(|mass| frequencies(&model, mass, is_loose));
    // A rigid motion may have no mass in the one that the scene does not use.
    let frequencies = match scene.time.mass {
        Mass::Consistent => consistent.map(|consistent| (singular.unwrap_or_default(), consistent)),
        Mass::Singular | Mass::Modal => singular.map(|singular| (singular, consistent.unwrap_or_default())),
    };
    let (singular, consistent) = frequencies.map_err(|error| error.beside(&model.warnings))?;
    let free = if scene.time.mass == Mass::Consistent { &consistent } else { &singular };
    let fastest = with_rigid_balls(&native, free.clone());
    let (advised_step, energy_step) = (advised_for(scene, &fastest), energy_step_for(scene, &fastest));
    let mut warnings = warnings::judged(scene, &model.warnings, Some((&model, &fastest)));
    let modal = modal_figures::figures(scene, &model, loaded.as_deref(), &mut warnings)?;
    Ok(Inspection {
        title: scene.title.clone(),
        nodes: mesh.nodes.len(),
        cells: mesh.cells.len(),
        dofs: engine.dofs(),
        bounded_dofs: system.bounds.len(),
        mass,
        mechanism,
        buckling_factor: buckling.map(|(factor, _)| factor),
        pull_in_factor,
        buckles_at: buckling.map(|(_, place)| place),
        initial_energy: (!no_start).then(|| initial_energy(&model)).transpose()?,
        deflections,
        largest_stress,
        reactions: if no_start || scene.stretches() { Vec::new() } else { static_reactions(scene)? },
        consistent,
        singular,
        inf_sup,
        modal,
        advised_step,
        energy_step,
        warnings,
    })
}

/// Determines size and cost of a run, from a fifth of a second of it.
///
/// # Errors
/// Returns the errors that would stop the run before its first step. A later one is a warning.
pub fn check(scene: &Scene) -> Result<Check> {
    let native = on_native_engine(scene);
    let model = Model::new(&native)?;
    let Model { system, .. } = &model;
    let (mesh, made) = simulation::mesh_and_made(scene)?;
    let frequencies = frequencies_of(&native, &model).map_err(|error| error.beside(&model.warnings))?;
    let inertia = 1.0 / (scene.time.step * scene.time.step);
    let factor_entries =
        system.engine.factor_size(&(&system.mass * inertia + &system.stiffness), &[])?.entries;
    let Watched { set_up, seconds_per_step, touches, failure, snapshot } = stopwatch(&native, &model)?;
    // One snapshot at the start, and one at the end if no other is due there.
    let count = scene.output.fields.map_or(0, |fields| 1 + scene.time.steps().div_ceil(fields.every));
    let snapshots = snapshot.map(|(bytes, _)| bytes * count);
    let (advised_step, energy_step) =
        (advised_for(scene, &frequencies), energy_step_for(scene, &frequencies));
    let mut warnings = warnings::judged(scene, &model.warnings, Some((&model, &frequencies)));
    warnings.extend(failure.map(|failure| format!("the run stops early: {failure}")));
    let modal = modal_figures::figures(scene, &model, None, &mut warnings)?;
    let steps = scene.time.steps();
    let drawing = snapshot.map_or(0.0, |(_, seconds)| seconds * count as f64);
    let expected_seconds = set_up + seconds_per_step * steps as f64 + drawing;
    Ok(Check {
        title: scene.title.clone(),
        scene: scene.resolved(),
        effects: scene.effects(),
        nodes: mesh.nodes.len(),
        cells: mesh.cells.len(),
        names: if scene.file.is_some() { names(&mesh) } else { BTreeMap::new() },
        notes: mesh.notes.clone(),
        made_nodes: made.iter().map(told).collect(),
        pull_in_factor: if model.mechanism.is_none() { simulation::pull_in(scene, &mesh)? } else { None },
        dofs: system.engine.dofs(),
        bounded_dofs: system.bounds.len(),
        factor_entries,
        linear: simulation::linear_choice(scene, &mesh),
        loads: simulation::load_totals(&native, &mesh)?,
        memory: memory(&mesh, system.engine.dofs(), scene.time.factors() * factor_entries)
            + dense(scene, system),
        frequencies,
        modal,
        steps,
        step: scene.time.step,
        advised_step,
        energy_step,
        any_step: scene.time.scheme.capabilities().is_event_driven,
        seconds_per_step,
        expected_seconds,
        has_watched_contact: touches,
        snapshots,
        sweep: None,
        quickest: QuickestRanks::new(&native, system.engine.dofs(), steps, expected_seconds),
        warnings,
    })
}

/// Returns the names of a mesh by their kind.
fn names(mesh: &Mesh) -> BTreeMap<&'static str, Vec<String>> {
    let Mesh { edges, groups, points, .. } = mesh;
    let kinds = [
        ("edges", edges.keys().cloned().collect::<Vec<_>>()),
        ("groups", groups.keys().cloned().collect()),
        ("points", points.keys().cloned().collect()),
    ];
    kinds.into_iter().filter(|(_, names)| !names.is_empty()).collect()
}

fn initial_energy(model: &Model) -> Result<f64> {
    let (system, u) = (&model.system, &model.start.displacement);
    let stretching = system.drive.stretching.as_ref().map_or(Ok(0.0), |form| -> Result<f64> {
        let mut stretch = Stretch::default();
        form.evaluate(&system.projected(u)?, &mut stretch);
        Ok(stretch.energy())
    })?;
    let [elastic, kinetic] = system.energies(u, &model.start.velocity)?;
    Ok(stretching + (elastic + kinetic) - system.work(u)?)
}

/// Cost of a run, as its first steps show it.
struct Watched {
    /// Time of the set-up, in s.
    set_up: f64,
    /// Time of a step, in s.
    seconds_per_step: f64,
    /// Whether anything touches in its first steps.
    touches: bool,
    /// Why it stops among its first steps.
    failure: Option<Error>,
    /// Size of a snapshot, in bytes, and its time, in s; `None` where the scene asks for none.
    snapshot: Option<(u64, f64)>,
}

/// Observer of the first steps of a run, with all that it records of them.
struct FirstSteps {
    begin: Instant,
    /// Number of steps, and the time (s) that they took.
    steps: u64,
    seconds: f64,
    touches: bool,
    line: String,
}

impl Observer for FirstSteps {
    fn begin(&mut self, _: f64) {
        self.begin = Instant::now();
    }

    fn row(&mut self, row: &Row) -> Result<()> {
        self.line.clear();
        row.write(&mut self.line);
        Ok(())
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        (self.steps, self.seconds) = (step, self.begin.elapsed().as_secs_f64());
        self.touches |= contact_nodes > 0;
    }

    fn interrupts(&self) -> bool {
        self.steps > 0 && self.begin.elapsed() >= WATCH
    }
}

/// Makes the first steps of a run, without its snapshots.
fn stopwatch(scene: &Scene, model: &Model) -> Result<Watched> {
    let clock = Instant::now();
    let mut scheme = model.scheme(scene)?;
    let set_up = model.seconds.iter().sum::<f64>() + clock.elapsed().as_secs_f64();
    let mut first = FirstSteps { begin: clock, steps: 0, seconds: 0.0, touches: false, line: String::new() };
    let still = Scene { output: Output { fields: None, ..scene.output.clone() }, ..scene.clone() };
    let (_, ended) = simulation::run_scheme(&still, model, scheme.as_mut(), set_up, &mut first)?;
    let failure = ended.err().filter(|error| !matches!(error, Error::Interrupted { .. }));
    // A plate in motion: zeros at the start take no place on the disk.
    let bits = scene.output.fields.map_or(64, |fields| fields.precision);
    let sample = |fields: &Fields| {
        fields.sample(&model.system, scheme.as_mut()).map(|snapshot| vtu::size(&snapshot, bits))
    };
    let begin = Instant::now();
    let snapshot = model.fields.as_ref().map(sample).transpose();
    let snapshot = if failure.is_some() { snapshot.unwrap_or_default() } else { snapshot? };
    let snapshot = snapshot.map(|bytes| (bytes, begin.elapsed().as_secs_f64()));
    let FirstSteps { steps, seconds, touches, .. } = first;
    Ok(Watched { set_up, seconds_per_step: seconds / steps.max(1) as f64, touches, failure, snapshot })
}

/// Returns the memory of a scheme's dense arrays, in bytes.
fn dense(scene: &Scene, system: &System<Native>) -> usize {
    let System { engine, mass, bounds, .. } = system;
    let bounded = match mass {
        Form::Modal { .. } => expected_candidates(bounds.len()),
        _ => bounds.len(),
    };
    scene.time.scheme.dense_memory(engine.dofs(), engine.velocities(mass), bounded)
}

/// Estimates the peak memory of a run, in bytes.
///
/// The sum consists of the factors, the entries before assembly, the cells' arrays and the scheme's
/// vectors.
fn memory(mesh: &Mesh, dofs: usize, factor_entries: usize) -> usize {
    const NUMBER: usize = size_of::<f64>();
    // An entry before assembly takes row, column and value, and as much again for sorting. K and M
    // each have one lower triangle per cell.
    const ENTRY: usize = 5 * NUMBER;
    const VECTORS: usize = 24;
    let nodes = |cell: &Cell| 3 * cell.nodes().len();
    let cells: usize = mesh.cells.iter().map(|cell| nodes(cell) * (nodes(cell) + 1) * ENTRY).sum();
    let records: usize = mesh.cells.iter().map(|cell| size_of::<CellArrays>() * 4 + 24 * nodes(cell)).sum();
    NUMBER * (factor_entries + VECTORS * dofs) + cells + records
}

/// Describes a node that was moved or inserted.
fn told(made: &Made) -> String {
    let place = |p: Point| format!("({}, {})", significant(p.x), significant(p.y));
    match made.moved_from {
        Some(from) => format!("{} moved from {}", place(made.at), place(from)),
        None => place(made.at),
    }
}

/// Formats a load as `12 N (0.6 N m, -2.4 N m about the axes x, y)`.
fn push(Resultant { force, moments: [x, y] }: &Resultant) -> String {
    // Symmetric loads have moments of rounding.
    let rounding = ROUNDING * force.abs().max(x.abs()).max(y.abs());
    let moment = |moment: f64| engineering(if moment.abs() > rounding { moment } else { 0.0 }, "N m");
    let [x, y] = [*x, *y].map(moment);
    format!("{} ({x}, {y} about the axes x, y)", engineering(*force, "N"))
}

fn closing(report: &mut Report, warnings: &[String]) {
    for warning in warnings {
        report.text("warning", warning);
    }
}

impl fmt::Display for Inspection {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut report = Report::new(&self.title);
        report.count("nodes", self.nodes as u64, "").count("cells", self.cells as u64, "");
        report.count("dofs", self.dofs as u64, "").count("bounded dofs", self.bounded_dofs as u64, "");
        report.number("mass", self.mass, "kg");
        report.optional("buckling factor", self.buckling_factor, "");
        if let Some([x, y]) = self.buckles_at {
            report.text("  buckles at", format!("({}, {}) m", significant(x), significant(y)));
        }
        report.optional("pull-in factor", self.pull_in_factor, "");
        report.optional("initial energy", self.initial_energy, "J");
        for Deflection { probe, start, loaded, .. } in &self.deflections {
            report.optional(&format!("{probe}, start"), *start, "m");
            report.optional(&format!("{probe}, under load"), *loaded, "m");
        }
        if let Some(StressPeak { value, at: [x, y], .. }) = self.largest_stress {
            report.number("largest von Mises stress, start", value, "Pa");
            report.text("  at", format!("({}, {}) m", significant(x), significant(y)));
        }
        for StaticReaction { support, force, moments } in &self.reactions {
            let [x, y] = moments.map(|moment| format!("{} N m", significant(moment)));
            let words = format!("{} N; about x and y through its centroid: {x}, {y}", significant(*force));
            report.text(format!("{support}, start"), words);
        }
        let singular = if self.modal.is_some() { "modal" } else { "singular" };
        let masses = [("consistent", &self.consistent), (singular, &self.singular)];
        for (name, Frequencies { lowest, highest }) in masses {
            report.text(format!("frequencies, {name} mass"), list(lowest));
            if name != "modal" {
                report.optional(&format!("highest, {name} mass"), *highest, "Hz");
            }
        }
        report.optional("inf-sup, raw dofs", self.inf_sup.raw, "");
        report.optional("inf-sup, energy norms", self.inf_sup.energy, "");
        if let Some(modal) = &self.modal {
            modal.report(&mut report);
        } else if self.inf_sup.raw.is_none() {
            report.text("inf-sup", "not computed: too near to singular for a mesh of this size");
        }
        report.optional("advised step", self.advised_step, "s");
        report.optional("  for the energy", self.energy_step, "s");
        closing(&mut report, &self.warnings);
        report.fmt(f)
    }
}

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut report = Report::new(&self.title);
        let effects = if self.effects.is_empty() { "none".to_owned() } else { self.effects.join(", ") };
        report.text("effects", effects);
        let [nodes, cells, dofs, bounded] =
            [self.nodes, self.cells, self.dofs, self.bounded_dofs].map(|count| grouped(count as u64));
        report
            .text("mesh", format!("{nodes} nodes, {cells} cells, {dofs} dofs, of which {bounded} may touch"));
        for (kind, names) in &self.names {
            report.text(*kind, names.join(", "));
        }
        for note in &self.notes {
            report.text("mesh file", note);
        }
        if !self.made_nodes.is_empty() {
            let others = self.made_nodes.len().saturating_sub(LISTED);
            let others = if others > 0 { format!(", and {others} more") } else { String::new() };
            let listed = self.made_nodes[..self.made_nodes.len().min(LISTED)].join(", ");
            report.text("nodes made", listed + &others);
        }
        for LoadTotal { key, start, largest } in &self.loads {
            report.text("total force", format!("{} of {key} at t = 0", push(start)));
            if let Some((t, largest)) = largest {
                report.text("  at most", format!("{} at t = {}", push(largest), engineering(*t, "s")));
            }
        }
        report.text("frequencies", list(&self.frequencies.lowest));
        if let Some(modal) = &self.modal {
            modal.report(&mut report);
        } else if let Some(highest) = self.frequencies.highest {
            report.text("  highest", engineering(highest, "Hz"));
        }
        if let Some(factor) = self.pull_in_factor.filter(|factor| *factor < 1.0) {
            let words =
                format!("at {factor:.3} times load.pressure; beyond it only an obstacle stops the plate");
            report.text("pull-in", words);
        }
        report.text("time step", self.step_in_words());
        let memory = engineering(self.memory as f64, "B");
        let solver = |LinearChoice { method, reason }: &LinearChoice| format!(", {method} solver ({reason})");
        let linear = self.linear.as_ref().map_or(String::new(), solver);
        let more = if self.bounded_dofs > 0 && !self.has_watched_contact { ", more in contact," } else { "" };
        let time = about(self.expected_seconds) + more;
        report.text("run", format!("{} steps, {time} and {memory} of memory{linear}", grouped(self.steps)));
        if let Some(bytes) = self.snapshots {
            report.text("snapshots", format!("{} on the disk", engineering(bytes as f64, "B")));
        }
        if let Some(SweepCost { runs, periods, expected_seconds }) = self.sweep {
            let (runs, time) = (grouped(runs as u64), about(expected_seconds));
            report.text("sweep", format!("{runs} runs of {periods} periods, {time} with one job"));
        }
        if let Some(QuickestRanks { ranks, seconds }) = self.quickest {
            report.text("quickest", format!("mpirun -n {ranks} rebond run: {}", about(seconds)));
        }
        closing(&mut report, &self.warnings);
        report.fmt(f)
    }
}

impl Check {
    /// Returns the time step beside the advised ones.
    fn step_in_words(&self) -> String {
        let step = engineering(self.step, "s");
        if self.any_step {
            return format!("{step}; any: the motion between instants is exact");
        }
        let advised = self.advised_step.map(|advised| format!("{} is advised", engineering(advised, "s")));
        let energy = self.energy_step.map(|energy| format!("{} for the energy", engineering(energy, "s")));
        let words: Vec<String> = advised.into_iter().chain(energy).collect();
        if words.is_empty() { step } else { format!("{step}; {}", words.join(", ")) }
    }
}

/// Returns a time that is known to a digit or so, such as `about 3 min`.
fn about(seconds: f64) -> String {
    let (count, unit) = match seconds {
        s if s < 0.1 => return "less than 0.1 s".into(),
        s if s < 90.0 => (s, "s"),
        s if s < 5400.0 => (s / 60.0, "min"),
        s if s < 172_800.0 => (s / 3600.0, "h"),
        s => (s / 86_400.0, "days"),
    };
    format!("about {} {unit}", short(if count < 10.0 { (10.0 * count).round() / 10.0 } else { count }))
}
