//! Simulation of a scene: model, scheme, and the main loop with its observer.

mod body;
mod contacts;
#[cfg(feature = "petsc")]
mod distributed;
mod effects;
mod fields;
mod opposite;
mod partition;
mod pause;
mod phase;

pub use contacts::Contact;
#[cfg(feature = "petsc")]
pub use distributed::check_options;
pub use fields::{Fields, Lattice, Snapshot};
pub use opposite::opposite;
pub use pause::{DofCoordinates, RunState};
pub use phase::on_phase;
pub(crate) use phase::phase;

use crate::archive::Archive;
use crate::assembly::{self, Probe};
use crate::communicator::{Communicator, SelfComm};
use crate::dof_map::{DofMap, NodeConstraint};
use crate::energy::Guard;
use crate::error::{Error, Result};
use crate::linalg::{Engine, LinearCombination, Native};
use crate::mesh::{Mesh, Point};
use crate::motion::Motion;
use crate::obstacle::Bounds;
use crate::plate::Sections;
use crate::scene::{self, ContactSolver, EngineName, FieldInput, Mass, Scene};
use crate::scheme::{
    Conserving, Event, EventStatistics, Exact, Midpoint, Newmark, NewmarkParameters, RelaxationStatistics,
    Scheme, Start, System,
};
pub use crate::vi::SolverFactory;
use crate::vi::{Condensed, Solver};
use body::PlateAssembly;
pub use body::{mesh, mesh_and_made};
use contacts::Contacts;
use effects::{BuildContext, Effects, OfCells};
pub use effects::{LoadTotal, Matrices, Resultant};
use partition::{Partition, WholeMesh};
use serde::{Deserialize, Serialize};
use std::rc::Rc;
use std::time::Instant;

/// Semi-discrete model of a scene, ready to run.
pub struct Model<E: Engine = Native> {
    /// Semi-discrete impact problem.
    pub system: System<E>,
    /// Initial conditions.
    pub start: Start,
    /// Probes of the scene: the contributions of this process's dofs to each, in the frame of the
    /// supports.
    pub probes: Vec<Probe>,
    /// Support motions and their contributions to the probes.
    frame: SupportFrame,
    /// Free deflections of this process with their positions; the bounded ones come first, in the
    /// order of the bounds.
    pub sites: Vec<DeflectionDof>,
    /// Positions of the dofs and velocities of this process.
    pub places: DofCoordinates,
    /// Sampling of snapshots, if the scene asks for them.
    pub fields: Option<Fields>,
    /// Rigid motions that nothing restrains, in words; `None` if there are none.
    pub mechanism: Option<&'static str>,
    /// Warnings from the set-up, one sentence each; the same on every process.
    pub warnings: Vec<String>,
    /// Kinetic energy of the plate moving at the speed of sound of its material, in J.
    sonic: f64,
    /// Wall time of mesh and matrices, and of the static start, in s.
    pub seconds: [f64; 2],
}

/// Free deflection at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeflectionDof {
    /// Index of the dof.
    pub dof: usize,
    /// Index of the node in the mesh.
    pub node: usize,
    /// Position, in m.
    pub at: [f64; 2],
}

fn nothing_free() -> Error {
    Error::Mesh("the supports hold every dof of the mesh: nothing can move".into())
}

/// Support motions, each with its contribution to the probes per metre.
#[derive(Default)]
struct SupportFrame(Vec<(Rc<FieldInput>, Vec<f64>)>);

/// Returns the free dofs of a scene's mesh.
///
/// # Errors
/// Returns [`Error::Mesh`] where a support applies to no part of the mesh.
pub fn space(scene: &Scene, mesh: &Mesh) -> Result<DofMap> {
    Ok(DofMap::of(&holds(scene, mesh)?).with_extra(scene.balls.len()))
}

/// Returns thickness and material of the plate, cell by cell.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn sections<'s>(scene: &'s Scene, mesh: &Mesh) -> Result<impl Sections + use<'s>> {
    PlateAssembly::new(scene, mesh, &SelfComm)
}

/// Returns the rigid motions that nothing restrains, in words; `None` if there are none.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn mechanism(scene: &Scene, mesh: &Mesh) -> Result<Option<&'static str>> {
    on_ground(scene, mesh, &holds(scene, mesh)?, effects::mechanism)
}

/// Returns the matrices of a scene on its mesh, over the free dofs if `supported`, else over all
/// dofs.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn matrices(scene: &Scene, mesh: &Mesh, supported: bool) -> Result<Matrices> {
    let holds =
        if supported { holds(scene, mesh)? } else { vec![NodeConstraint::default(); mesh.nodes.len()] };
    on_ground(scene, mesh, &holds, effects::matrices)
}

/// Returns resultant forces and moments of the loads of a scene.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn load_totals(scene: &Scene, mesh: &Mesh) -> Result<Vec<LoadTotal>> {
    if scene.load.is_none() && scene.initial.static_pressure.is_zero() {
        return Ok(Vec::new());
    }
    on_ground(scene, mesh, &vec![NodeConstraint::default(); mesh.nodes.len()], effects::load_totals)
}

/// Returns the constraints that the supports of a scene put on each node.
fn holds(scene: &Scene, mesh: &Mesh) -> Result<Vec<NodeConstraint>> {
    Ok(DofMap::holds(mesh, &body::supports(scene, mesh, &SelfComm)?))
}

/// Calls a closure with the build context of a single process.
fn on_ground<R>(
    scene: &Scene,
    mesh: &Mesh,
    holds: &[NodeConstraint],
    act: impl FnOnce(&BuildContext<WholeMesh>) -> Result<R>,
) -> Result<R> {
    let space = DofMap::of(holds).with_extra(scene.balls.len());
    if space.dofs() == scene.balls.len() {
        return Err(nothing_free());
    }
    phase("matrices");
    let cells = assembly::cells(mesh, &space, &PlateAssembly::new(scene, mesh, &SelfComm)?)?;
    let gaps: Vec<_> = (0..scene.balls.len()).map(|ball| Some(space.extra(ball))).collect();
    act(&BuildContext {
        scene,
        partition: &WholeMesh,
        mesh,
        holds,
        space: &space,
        gaps: &gaps,
        cells: &cells,
    })
}

impl Model {
    /// Builds the model of a scene on the native engine, without parts that the scene does not use.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for an engine or contact solver that this build does not have,
    /// [`Error::Mesh`] and [`Error::Singular`] for a plate without a unique solution, and
    /// [`Error::Scene`] for a formula without a value.
    pub fn new(scene: &Scene) -> Result<Model> {
        serves(scene, EngineName::Native, &[ContactSolver::Condensed])?;
        let clock = Instant::now();
        phase("mesh");
        let mesh = mesh(scene)?;
        on_ground(scene, &mesh, &holds(scene, &mesh)?, |ground| {
            let engine = Native::with_layout(ground.space.layout(&mesh));
            compose(clock, engine, ground)
        })
    }
}

/// Assembles the model of a scene on an engine. Collective.
fn compose<E: OfCells, P: Partition>(
    clock: Instant,
    engine: E,
    ground: &BuildContext<P>,
) -> Result<Model<E>> {
    let Effects { system, start, lifts, sites, places, mechanism, warnings, seconds } =
        effects::compose(engine, ground)?;
    let shapes: Vec<&[f64]> = lifts.iter().map(|lift| &*lift.shape).collect();
    let (mut probes, mut lifted) = (Vec::new(), vec![Vec::new(); lifts.len()]);
    for probe in &ground.scene.output.probes {
        let (probe, of_lifts) = ground.probe(probe, &shapes)?;
        probes.push(probe);
        lifted.iter_mut().zip(of_lifts).for_each(|(lifted, of)| lifted.push(of));
    }
    let motions = lifts.iter().map(|lift| lift.motion.clone());
    let frame = SupportFrame(motions.zip(lifted).collect());
    let fields = Fields::new(ground, &lifts)?;
    let seconds = [clock.elapsed().as_secs_f64() - seconds, seconds];
    let sonic = sonic_energy(ground);
    Ok(Model { system, start, probes, frame, sites, places, fields, mechanism, warnings, sonic, seconds })
}

/// Returns the kinetic energy of the plate moving at the speed of sound of its stiffest material,
/// sqrt(E / rho), in J. Collective.
fn sonic_energy<P: Partition>(ground: &BuildContext<P>) -> f64 {
    let mass: f64 = ground.cells.iter().map(|cell| cell.local.weight).sum();
    let mass = ground.comm().all_reduce_sum(mass);
    let scene = ground.scene;
    let plates = std::iter::once(&scene.plate.plate).chain(scene.parts.iter().map(|part| &part.plate));
    let stiffest = plates.map(|plate| {
        let across = plate.orthotropy.map_or(0.0, |orthotropy| orthotropy.across);
        plate.youngs_modulus.max(across) / plate.density
    });
    0.5 * mass * stiffest.fold(0.0, f64::max)
}

impl<E: Engine + 'static> Model<E>
where
    E::Factor: 'static,
{
    /// Returns the scene's scheme at its start, with the condensed contact solver. The step matrix
    /// is factored.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the step matrix is not positive definite.
    pub fn scheme(&self, scene: &Scene) -> Result<Box<dyn Scheme + '_>> {
        self.scheme_with(scene, &condensed)
    }
}

impl<E: Engine> Model<E> {
    /// Returns the scene's scheme at its start, with contact solvers from a factory.
    ///
    /// # Errors
    /// Returns the errors of the solver on its matrix.
    pub fn scheme_with<'m>(
        &'m self,
        scene: &Scene,
        solver: &'m SolverFactory<E>,
    ) -> Result<Box<dyn Scheme + 'm>> {
        let System { engine, bounds, .. } = &self.system;
        let (step, start) = (scene.time.step, self.start.clone());
        Ok(match scene.time.scheme {
            scene::SchemeSpec::Newmark { beta, restitution } => {
                let parameters = NewmarkParameters { beta, restitution, step };
                let solver = solver(engine, &Newmark::matrix(&self.system, parameters), bounds.len())?;
                Box::new(Newmark::with_solver(&self.system, parameters, start, solver)?)
            }
            scene::SchemeSpec::Midpoint { massless } => {
                let solver = solver(engine, &Midpoint::matrix(&self.system, step), bounds.len())?;
                Box::new(Midpoint::with_solver(&self.system, step, massless, start, solver)?)
            }
            scene::SchemeSpec::Conserving => {
                Box::new(Conserving::with_solver(&self.system, step, start, solver)?)
            }
            scene::SchemeSpec::Exact => Box::new(Exact::new(&self.system, step, start)?),
        })
    }

    /// Computes the deflections at the probes at an instant (s), in m.
    fn probe(&self, time: f64, u: &[f64], values: &mut [f64]) -> Result<()> {
        let mut own: Vec<f64> = self.probes.iter().map(|probe| probe.deflection(u)).collect();
        for (motion, lift) in &self.frame.0 {
            let moved = motion.at(Point::origin(), time)?;
            own.iter_mut().zip(lift).for_each(|(own, lift)| *own += moved * lift);
        }
        values.copy_from_slice(&self.system.engine.comm().all_reduce_sum_slice(&own));
        Ok(())
    }
}

/// Builds the condensed contact solver, on any engine.
///
/// # Errors
/// Returns [`Error::Singular`] where the matrix is not positive definite.
pub fn condensed<E: Engine + 'static>(
    engine: &E,
    sum: &LinearCombination<E>,
    bounded: usize,
) -> Result<Box<dyn Solver<E>>>
where
    E::Factor: 'static,
{
    Ok(Box::new(Condensed::new(engine, sum, bounded)?))
}

/// Returns an error unless this engine and its contact solvers are those that the scene asks for.
fn serves(scene: &Scene, engine: EngineName, solvers: &[ContactSolver]) -> Result<()> {
    if scene.solver.engine != engine {
        return Err(Error::Usage(format!(
            "solver.engine: this build has no \"{}\"; it has \"{}\"",
            scene.solver.engine, engine
        )));
    }
    if !solvers.contains(&scene.solver.vi) {
        let known: Vec<String> = solvers.iter().map(|vi| format!("\"{vi}\"")).collect();
        return Err(Error::Usage(format!(
            "solver.vi: the {} engine has no \"{}\"; it has {}",
            engine,
            scene.solver.vi,
            known.join(", ")
        )));
    }
    Ok(())
}

/// Returns an error for a KKT residual above the tolerance.
pub(crate) fn judge(step: u64, time: f64, residual: f64, tolerance: f64) -> Result<()> {
    if !residual.is_finite() {
        return Err(Error::NotFinite { step, time, what: "the displacement" });
    }
    if residual > tolerance {
        return Err(Error::NotConverged { step, time, residual, tolerance });
    }
    Ok(())
}

/// Row of the history.
#[derive(Debug, Clone, Copy)]
pub struct Row<'r> {
    /// Index of the step.
    pub step: u64,
    /// Time, in s.
    pub time: f64,
    /// Energy of the scheme, in J.
    pub energy: f64,
    /// Kinetic energy, in J.
    pub kinetic: f64,
    /// Elastic energy, in J.
    pub elastic: f64,
    /// Work of the external loads, in J.
    pub work: f64,
    /// Number of nodes in contact at this instant.
    pub contact_nodes: usize,
    /// Sum of the reactions of the obstacles at this instant, in N, positive upwards.
    pub contact_force: f64,
    /// Iterations of the contact solver since the last row.
    pub vi_iterations: u64,
    /// Largest relative KKT residual since the last row.
    pub kkt: f64,
    /// Deflections at the probes, in m.
    pub probes: &'r [f64],
}

/// Receiver of the results of a run.
pub trait Observer {
    /// Receives a row of the history, every `output.every` steps and at the end.
    ///
    /// # Errors
    /// Returns any error that must stop the run.
    fn row(&mut self, row: &Row) -> Result<()>;

    /// Receives the contacts that ended since the last row, or at the end of the run.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        let _ = ended;
        Ok(())
    }

    /// Receives this process's part of a snapshot, every `output.fields_every` steps and at the
    /// end.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        let _ = snapshot;
        Ok(())
    }

    /// Receives the notice that every process has received its part of the snapshot of that step
    /// and time (s).
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn fields_complete(&mut self, step: u64, time: f64) -> Result<()> {
        let _ = (step, time);
        Ok(())
    }

    /// Receives the closing or opening of a gap at a node, before the row of its step. Only
    /// event-driven schemes report these.
    ///
    /// # Errors
    /// Returns any error that must stop the run.
    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        let _ = event;
        Ok(())
    }

    /// Receives the scheme itself, after each row.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn state(&mut self, scheme: &dyn Scheme) -> Result<()> {
        let _ = scheme;
        Ok(())
    }

    /// Receives the whole state of the run, every `output.checkpoint_every` steps and before an
    /// interruption; on the first process only.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn pause(&mut self, pause: RunState) -> Result<()> {
        let _ = pause;
        Ok(())
    }

    /// Returns whether [`Observer::end`] needs the state at the last step; the same on all
    /// processes.
    fn keeps_end(&self) -> bool {
        false
    }

    /// Receives the whole state of the run at its last step, and the motion at that instant, from
    /// which another run may start; on the first process only. The state is taken before the
    /// additions to the files that mark the end, so that a run to a later end continues from it as
    /// if there had been no end.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn end(&mut self, pause: RunState, motion: Motion) -> Result<()> {
        let _ = (pause, motion);
        Ok(())
    }

    /// Returns whether the run shall stop after this step. The call is frequent and must be cheap.
    fn interrupts(&self) -> bool {
        false
    }

    /// Receives the end of a step. The call is frequent and must be cheap.
    fn step(&mut self, step: u64, contact_nodes: usize) {
        let _ = (step, contact_nodes);
    }
}

/// Closing or opening of the gap at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeEvent {
    /// Index of the node.
    pub node: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Time, direction and velocity of the event.
    pub event: Event,
}

/// First impact on an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Impact {
    /// Time, in s: where the extrapolated free motion meets the obstacle, or the time of the event
    /// for an event-driven scheme.
    pub time: f64,
    /// Index of the first node in contact.
    pub node: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Velocity relative to the obstacle before impact, in m/s, positive upwards: negative where
    /// the gap closes from above the obstacle, whichever of the two moves, in any frame. For a ball
    /// it is the velocity of its gap, relative to the plate.
    pub velocity: f64,
}

/// Energy at the start and end and its extremes over the rows, in J.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EnergySpan {
    /// Energy at the start, in J.
    pub start: f64,
    /// Energy at the last row, in J.
    pub end: f64,
    /// Least energy, in J.
    pub min: f64,
    /// Largest energy, in J.
    pub max: f64,
}

/// Wall time by phase, in s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Time for mesh and matrices, in s.
    pub assembly: f64,
    /// Time for the static start, in s.
    pub equilibrium: f64,
    /// Time for the first factorisation, in s.
    pub factor: f64,
    /// Time for all steps and their observers, in s.
    pub stepping: f64,
}

/// Summary of a finished run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of dofs bounded by an obstacle.
    pub bounded_dofs: usize,
    /// Number of steps.
    pub steps: u64,
    /// Number of steps with contact.
    pub contact_steps: u64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of numeric factorisations of the step matrix.
    pub factorisations: u64,
    /// Number of steps solved again by a more robust method, because the first solution did not
    /// meet the tolerance.
    pub retries: u64,
    /// Largest number of nodes in contact at once.
    pub most_contact_nodes: usize,
    /// Work counters of an event-driven scheme.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub tally: Option<EventStatistics>,
    /// Energy at the start and end and its extremes.
    pub energy: EnergySpan,
    /// First impact; `None` if there was no contact.
    pub first_impact: Option<Impact>,
    /// Intervals in which the plate touches any obstacle, in s. Intervals closer than a hundredth
    /// of the run, or in successive steps, are joined.
    pub contacts: Vec<[f64; 2]>,
    /// Number of contacts of single nodes, i.e. of rows of contacts.csv.
    pub node_contacts: u64,
    /// Largest relative KKT residual of all steps.
    pub worst_kkt: f64,
    /// Largest violation of a bound in all steps, in m.
    pub worst_penetration: f64,
    /// Relaxation statistics of a conserving scheme.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<RelaxationStatistics>,
    /// Wall time by phase, in s.
    pub seconds: Seconds,
}

impl Outcome {
    fn new<E: Engine>(model: &Model<E>, scheme: &dyn Scheme, factor: f64) -> Result<Outcome> {
        let start = scheme.energies()?.total();
        let [assembly, equilibrium] = model.seconds;
        let System { engine, bounds, .. } = &model.system;
        let [dofs, bounded_dofs] = engine.comm().all_reduce_sum([engine.dofs(), bounds.len()]);
        Ok(Outcome {
            dofs,
            bounded_dofs,
            steps: 0,
            contact_steps: 0,
            vi_iterations: 0,
            factorisations: 0,
            retries: 0,
            most_contact_nodes: 0,
            tally: None,
            energy: EnergySpan { start, end: start, min: start, max: start },
            first_impact: None,
            contacts: Vec::new(),
            node_contacts: 0,
            worst_kkt: 0.0,
            worst_penetration: 0.0,
            relaxation: None,
            seconds: Seconds { assembly, equilibrium, factor, stepping: 0.0 },
        })
    }

    /// Saves or restores what steps change here; the rest is in the schemes.
    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        for count in [&mut self.steps, &mut self.contact_steps, &mut self.vi_iterations, &mut self.retries] {
            archive.value(count)?;
        }
        archive.value(&mut self.most_contact_nodes)?;
        archive.value(&mut self.energy)?;
        archive.value(&mut self.first_impact)?;
        archive.value(&mut self.contacts)?;
        archive.value(&mut self.node_contacts)?;
        archive.value(&mut self.worst_kkt)?;
        archive.value(&mut self.worst_penetration)?;
        archive.value(&mut self.seconds.stepping)
    }

    /// Joins intervals of contact that are close in a run to its present end but were not in the
    /// run to an earlier end.
    fn join_contacts(&mut self, scene: &Scene) {
        let mut joined = Vec::new();
        self.contacts.iter().for_each(|&interval| note_interval(&mut joined, scene, interval));
        self.contacts = joined;
    }

    /// Records the events up to the present instant, and returns them.
    fn note_events<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &mut dyn Scheme,
        observer: &mut dyn Observer,
    ) -> Result<Vec<Event>> {
        let events = scheme.take_events();
        for &event in &events {
            let Event { time, bound, closes, velocity, .. } = event;
            let DeflectionDof { node, at, .. } = model.sites[bound];
            if closes && self.first_impact.is_none() {
                self.first_impact = Some(Impact { time, node, at, velocity });
            }
            note_contact(&mut self.contacts, scene, time);
            observer.event(&NodeEvent { node, at, event })?;
        }
        Ok(events)
    }

    /// Records a step and its events. Returns the number of nodes in contact and their total force,
    /// in N.
    fn note<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &dyn Scheme,
        events: bool,
    ) -> Result<(usize, f64)> {
        let verdict = scheme.step_report();
        self.steps = scheme.step();
        self.vi_iterations += u64::from(verdict.iterations);
        self.retries += u64::from(verdict.retries > 0);
        if verdict.kkt > self.worst_kkt || verdict.kkt.is_nan() {
            self.worst_kkt = verdict.kkt;
        }
        if !scene.has_contact() {
            return Ok((0, 0.0));
        }
        let (engine, bounds) = (&model.system.engine, scheme.limits());
        let (mut nodes, mut force, mut penetration) = (0, 0.0, 0.0_f64);
        for (i, (&r, &z)) in scheme.reaction().iter().zip(scheme.admissible()).enumerate() {
            nodes += usize::from(r != 0.0);
            force += r;
            penetration = penetration.max(bounds.lower[i] - z).max(z - bounds.upper[i]);
        }
        let ranks = engine.comm().all_gather_one((nodes, force, penetration));
        let nodes = ranks.iter().map(|(nodes, ..)| nodes).sum();
        let force = ranks.iter().map(|(_, force, _)| force).sum();
        let penetrations = ranks.iter().map(|(.., penetration)| *penetration);
        self.worst_penetration = penetrations.fold(self.worst_penetration, f64::max);
        self.contact_steps += u64::from(nodes > 0 || events);
        if nodes > 0 {
            self.most_contact_nodes = self.most_contact_nodes.max(nodes);
            if self.first_impact.is_none() {
                self.first_impact = first_impact(model, scheme, scene.time.step)?;
            }
            note_contact(&mut self.contacts, scene, scheme.time());
        }
        Ok((nodes, force))
    }
}

/// Adds an instant of contact (s) to the intervals, see [`Outcome::contacts`].
pub(crate) fn note_contact(contacts: &mut Vec<[f64; 2]>, scene: &Scene, time: f64) {
    note_interval(contacts, scene, [time, time]);
}

/// Adds an interval of contact (s) to the intervals, joined to the last one where it is close.
fn note_interval(contacts: &mut Vec<[f64; 2]>, scene: &Scene, [begin, end]: [f64; 2]) {
    let together = (0.01 * scene.time.end).max(1.5 * scene.time.step);
    match contacts.last_mut() {
        Some([_, last]) if begin - *last <= together => *last = end,
        _ => contacts.push([begin, end]),
    }
}

/// Returns the impact that comes first among the bounds met in this step, if node and obstacle move
/// uniformly. Collective.
fn first_impact<E: Engine>(model: &Model<E>, scheme: &dyn Scheme, step: f64) -> Result<Option<Impact>> {
    let System { engine, drive, .. } = &model.system;
    let touched = || scheme.reaction().iter().enumerate().filter(|(_, r)| **r != 0.0);
    // Bounds at the earliest instant before contact of any of these nodes, and one step later.
    let times = touched().map(|(bound, _)| scheme.approach(bound).time);
    let before =
        -engine.comm().all_reduce_max(times.fold(f64::NEG_INFINITY, |latest, time| latest.max(-time)));
    let before = if before.is_finite() { before.max(0.0) } else { 0.0 };
    let [from, to] = [model.system.bounds_at(before)?, model.system.bounds_at(before + step)?];
    let met = |(bound, &r): (usize, &f64)| {
        let approach = scheme.approach(bound);
        let of = |bounds: &Bounds| if r > 0.0 { bounds.lower[bound] } else { bounds.upper[bound] };
        let rate = (of(&to) - of(&from)) / step;
        // An absent obstacle has infinite height and gets the rate zero.
        let rate = if rate.is_finite() { rate } else { 0.0 };
        let target = if drive.bounds.is_some() && of(&from).is_finite() {
            of(&from) + rate * (approach.time - before)
        } else {
            of(scheme.limits())
        };
        let (gap, velocity) = (target - approach.deflection, approach.velocity - rate);
        let mut delay = if gap == 0.0 { 0.0 } else { gap / velocity };
        if drive.bounds.is_some() {
            delay = delay.min(scheme.time() + step - approach.time).max(0.0);
        }
        let DeflectionDof { node, at, .. } = model.sites[bound];
        ((approach.time + delay).max(0.0), velocity, node, at)
    };
    let touched = touched();
    let own = touched.map(met).min_by(|a, b| a.0.total_cmp(&b.0));
    let all = engine.comm().all_gather(own.as_slice());
    let first = all.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(first.map(|(time, velocity, node, at)| Impact { time, node, at, velocity }))
}

/// Returns advice for the user on a spurious gain of energy.
pub(crate) fn advice(scene: &Scene) -> &'static str {
    match (scene.time.scheme, scene.time.mass) {
        (scene::SchemeSpec::Midpoint { .. }, Mass::Consistent) => {
            "the midpoint scheme is unstable with the consistent mass at every step: set time.mass = \"singular\""
        }
        (scene::SchemeSpec::Midpoint { .. }, Mass::Singular) => {
            "a smaller time.step conserves better, and time.scheme = \"conserving\" at every step"
        }
        (scene::SchemeSpec::Newmark { restitution, .. }, _) if restitution > 0.0 => {
            "a smaller time.step or time.restitution conserves better"
        }
        _ => "check the loads and the initial state",
    }
}

/// Number of steps between checks of the energy where rows are further apart.
const GUARD_EVERY: u64 = 100;

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
    let clock = Instant::now();
    phase("factorisation");
    let scheme = model.scheme_with(scene, solver)?;
    run_scheme(scene, model, scheme, clock.elapsed().as_secs_f64(), observer)
}

/// Runs a model like [`run`], from a paused run of the same scene. The resumed run is bitwise
/// identical to an uninterrupted one.
///
/// # Errors
/// Returns the same errors as [`run`], and [`Error::Checkpoint`] for the state of another scene.
pub fn resume<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    solver: &SolverFactory<E>,
    pause: RunState,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    let clock = Instant::now();
    phase("factorisation");
    let scheme = model.scheme_with(scene, solver)?;
    let part = Some(pause.part(model)?);
    run_from(scene, model, scheme, clock.elapsed().as_secs_f64(), part, observer)
}

/// Runs a model like [`run`], with a scheme at its start that took `factor` seconds to build.
///
/// # Errors
/// Returns the same errors as [`run`].
pub fn run_scheme<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    scheme: Box<dyn Scheme + '_>,
    seconds: f64,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    run_from(scene, model, scheme, seconds, None, observer)
}

/// Runs the scheme from its start or from the state in an archive.
fn run_from<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    mut scheme: Box<dyn Scheme + '_>,
    seconds: f64,
    from: Option<Archive>,
    observer: &mut dyn Observer,
) -> Result<(Outcome, Result<()>)> {
    let mut outcome = Outcome::new(model, scheme.as_ref(), seconds)?;
    let sonic = if model.system.drive.varies() { model.sonic } else { f64::INFINITY };
    let mut watch = RunMonitor::new(scene, sonic, scheme.as_ref())?;
    if let Some(mut archive) = from {
        watch.archive(model, scheme.as_mut(), &mut outcome, &mut archive)?;
        outcome.join_contacts(scene);
    }
    let ended = time_loop(scene, model, scheme.as_mut(), &mut outcome, &mut watch, observer);
    outcome.factorisations = scheme.factorisations();
    outcome.relaxation = scheme.relaxation();
    outcome.tally = scheme.event_statistics();
    outcome.seconds.stepping = watch.seconds();
    Ok((outcome, ended))
}

/// State of the main loop that persists between steps.
struct RunMonitor {
    guard: Guard,
    /// Number of iterations since the last row.
    iterations: u64,
    kkt: f64,
    contacts: Contacts,
    /// Whether the present step has been recorded.
    noted: bool,
    /// Time of the steps before the clock was started, in s.
    before: f64,
    clock: Instant,
}

impl RunMonitor {
    fn new(scene: &Scene, sonic: f64, scheme: &dyn Scheme) -> Result<RunMonitor> {
        Ok(RunMonitor {
            guard: Guard::new(scheme.energies()?, sonic, scene.solver.energy_guard, advice(scene)),
            iterations: 0,
            kkt: 0.0,
            contacts: Contacts::default(),
            noted: false,
            before: 0.0,
            clock: Instant::now(),
        })
    }

    /// Returns the time of all steps so far, in s.
    fn seconds(&self) -> f64 {
        self.before + self.clock.elapsed().as_secs_f64()
    }

    /// Saves or restores the whole run between two steps.
    fn archive<E: Engine>(
        &mut self,
        model: &Model<E>,
        scheme: &mut dyn Scheme,
        outcome: &mut Outcome,
        archive: &mut Archive,
    ) -> Result<()> {
        scheme.archive(archive)?;
        self.guard.archive(archive)?;
        archive.value(&mut self.iterations)?;
        archive.value(&mut self.kkt)?;
        archive.value(&mut self.noted)?;
        self.contacts.archive(model.system.bounds.len(), archive)?;
        // A last state has no times, so that equal runs leave equal bytes.
        outcome.seconds.stepping = if self.noted { self.seconds() } else { 0.0 };
        outcome.archive(archive)?;
        if !archive.saves() {
            (self.before, self.clock) = (outcome.seconds.stepping, Instant::now());
        }
        Ok(())
    }
}

/// Passes a snapshot to the observer where one is due; a process whose observer failed earlier only
/// takes part in the sampling. Returns the result of this process's observer.
fn show_fields<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    scheme: &mut dyn Scheme,
    last: bool,
    watched: Result<()>,
    observer: &mut dyn Observer,
) -> Result<Result<()>> {
    let (step, time) = (scheme.step(), scheme.time());
    let (Some(fields), Some(asked)) = (&model.fields, scene.output.fields) else { return Ok(watched) };
    if step % asked.every != 0 && !last {
        return Ok(watched);
    }
    let snapshot = fields.sample(&model.system, scheme)?;
    let shown = watched.and_then(|()| observer.fields(&snapshot));
    let complete = model.system.engine.comm().all_reduce_all(shown.is_ok());
    Ok(if complete { observer.fields_complete(step, time) } else { shown })
}

fn time_loop<E: Engine>(
    scene: &Scene,
    model: &Model<E>,
    scheme: &mut dyn Scheme,
    outcome: &mut Outcome,
    watch: &mut RunMonitor,
    observer: &mut dyn Observer,
) -> Result<()> {
    let mut probes = vec![0.0; model.probes.len()];
    // Result of this process's observer, for instance an error of a full disk; the process
    // continues until all processes know of it.
    let mut watched = Ok(());
    let engine = &model.system.engine;
    if watch.noted {
        scheme.advance().map_err(|error| locate(error, model))?;
    }
    loop {
        let (step, time) = (scheme.step(), scheme.time());
        let last = step == scene.time.steps();
        watch.noted = false;
        if last && observer.keeps_end() {
            let pause =
                RunState::take(model, step, time, |archive| watch.archive(model, scheme, outcome, archive))?;
            let motion = model.places.motion(engine, scene, scheme)?;
            if let Some((pause, motion)) = pause.zip(motion) {
                watched = watched.and_then(|()| observer.end(pause, motion));
            }
        }
        watch.noted = true;
        let RunMonitor { guard, iterations, kkt, contacts, .. } = watch;
        let events = outcome.note_events(scene, model, scheme, observer)?;
        let (contact_nodes, contact_force) = outcome.note(scene, model, scheme, !events.is_empty())?;
        let verdict = scheme.step_report();
        *iterations += u64::from(verdict.iterations);
        *kkt = kkt.max(verdict.kkt);
        judge(step, time, verdict.kkt, scene.solver.tolerance)?;
        contacts.note(&model.sites, scene.time.step, scheme, &events);
        if step % scene.output.every == 0 || last {
            let energies = scheme.energies()?;
            let guarded = guard.check(step, time, energies);
            if let Err(Error::NotFinite { .. }) = guarded {
                return guarded;
            }
            let energy = energies.total();
            outcome.energy.end = energy;
            outcome.energy.min = outcome.energy.min.min(energy);
            outcome.energy.max = outcome.energy.max.max(energy);
            model.probe(time, scheme.displacement(), &mut probes)?;
            let row = Row {
                step,
                time,
                energy,
                kinetic: energies.kinetic,
                elastic: energies.elastic,
                work: energies.work,
                contact_nodes,
                contact_force,
                vi_iterations: *iterations,
                kkt: *kkt,
                probes: &probes,
            };
            watched = watched.and_then(|()| observer.row(&row));
            if scene.has_contact() {
                if last {
                    contacts.close(&model.sites, f64::INFINITY);
                }
                let ended = engine.comm().all_gather(&contacts.take());
                let ended: Vec<Contact> = ended.into_iter().map(Contact::from_numbers).collect();
                outcome.node_contacts += ended.len() as u64;
                watched = watched.and_then(|()| observer.contacts(&ended));
            }
            watched = watched.and_then(|()| observer.state(scheme));
            (*iterations, *kkt) = (0, 0.0);
            guarded?;
        } else if step % GUARD_EVERY == 0 {
            guard.check(step, time, scheme.energies()?)?;
        }
        watched = show_fields(scene, model, scheme, last, watched, observer)?;
        observer.step(step, contact_nodes);
        if last {
            return engine.comm().all_ok(watched);
        }
        // All processes stop after the same step.
        let asked = (watched.is_err(), watched.is_ok() && observer.interrupts());
        let asked = engine.comm().all_gather_one(asked);
        if asked.iter().any(|(failed, _)| *failed) {
            return engine.comm().all_ok(watched);
        }
        let stops = asked.iter().any(|(_, interrupted)| *interrupted);
        let every = scene.output.checkpoint_every;
        if stops || step > 0 && every.is_some_and(|every| step.is_multiple_of(every)) {
            let pause =
                RunState::take(model, step, time, |archive| watch.archive(model, scheme, outcome, archive))?;
            watched = pause.map_or(Ok(()), |pause| observer.pause(pause));
        }
        if stops {
            engine.comm().all_ok(watched)?;
            return Err(Error::Interrupted { step, time });
        }
        scheme.advance().map_err(|error| locate(error, model))?;
    }
}

/// Adds node and position to the error of a scheme, which knows no mesh and only the index of the
/// bound.
fn locate<E: Engine>(error: Error, model: &Model<E>) -> Error {
    match error {
        Error::Events { step, time, count, bound, .. } => {
            let DeflectionDof { node, at: [x, y], .. } = model.sites[bound];
            Error::Events { step, time, count, bound, place: format!("node {node} at ({x}, {y})") }
        }
        error => error,
    }
}
