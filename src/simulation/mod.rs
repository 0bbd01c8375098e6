//! Simulation of a scene: model, scheme, and the main loop with its observer.

mod contacts;
mod deflection;
#[cfg(feature = "petsc")]
mod distributed;
mod dof_coordinates;
mod effects;
mod external_load;
mod extremes;
mod fields;
mod forces;
mod frictional_probes;
mod levels;
mod membrane_forces;
mod meshing;
mod named_forces;
mod nodal_motion;
mod observer;
mod opposite;
mod outcome;
mod pause;
mod phase;
mod plate_assembly;
mod ranks;
mod readings;
mod refinement;
mod regions;
mod run;
mod step_check;
mod step_monitor;
mod stops;
mod stress_fields;
mod stresses;
mod time_loop;

pub use contacts::Contact;
use deflection::DeflectionSites;
pub use deflection::LargestDeflection;
#[cfg(feature = "petsc")]
pub use distributed::check_options;
pub use dof_coordinates::{DeflectionDof, DofCoordinates};
pub use effects::{LoadTotal, Matrices, Resultant};
pub use external_load::ExternalLoad;
use extremes::StressSites;
pub use extremes::{Envelope, Extremes, StressPeak, StressWatch};
pub use fields::{Fields, Lattice, Snapshot};
pub use levels::LinearChoice;
pub(crate) use levels::linear_choice;
pub use meshing::{mesh, mesh_and_made};
pub use named_forces::{HardestImpact, NamedForce, NodeReaction, ObstacleForce, SupportForce};
pub use observer::{Both, NodeEvent, Observer, Row};
pub use opposite::opposite;
pub use outcome::{BlockSeconds, EnergySpan, Impact, LinearIterations, Outcome, Seconds};
pub(crate) use outcome::{JOINED, add_contact};
pub use pause::RunState;
pub use phase::on_phase;
pub(crate) use phase::phase;
pub use ranks::QuickestRanks;
pub use run::{resume, run, run_scheme};
pub(crate) use step_check::{advice, check_residual};
pub use step_monitor::StepMonitor;
pub use stress_fields::SnapshotStresses;

use crate::assembly::Probe;
use crate::communicator::{Communicator, SelfComm};
use crate::dof_map::{DofMap, NodeConstraint};
use crate::energy::Guard;
use crate::error::{Error, Result};
use crate::linalg::{Engine, LinearCombination, Native};
use crate::mesh::Mesh;
use crate::modes::buckling::Buckling;
use crate::partition::{Partition, WholeMesh};
use crate::plate::Sections;
use crate::scene::{ContactSolver, EngineName, Mass, Scene};
use crate::scheme::{Friction, Scheme, Solution, Start, StepBalance, System};
pub use crate::vi::SolverFactory;
use crate::vi::{Condensed, Solver};
use effects::{Attribution, BuildContext, Effects, OfCells, Reactions};
use frictional_probes::FrictionalProbes;
use nodal_motion::NodalMotion;
use plate_assembly::PlateAssembly;
pub use readings::FramedProbe;
use readings::Readings;
use std::rc::Rc;
use std::time::Instant;
use stops::Stop;
use stresses::PlateCurvatures;

/// Semi-discrete model of a scene, ready to run.
pub struct Model<E: Engine = Native> {
    /// Semi-discrete impact problem.
    pub system: System<E>,
    /// Initial conditions.
    pub start: Start,
    /// Probes of the scene: the contributions of this process's dofs to each, in the frame of the
    /// supports.
    pub probes: Vec<Probe>,
    /// Quantities at the probes.
    readings: Readings,
    /// Free deflections of this process with their positions; the bounded ones come first, in the
    /// order of the bounds.
    pub sites: Vec<DeflectionDof>,
    /// Positions of the dofs and velocities of this process.
    pub places: DofCoordinates,
    /// Obstacles behind the bounds, if there is anything to touch.
    attribution: Option<Attribution>,
    /// Reactions of the supports, if any of them has a name.
    reactions: Option<Reactions>,
    /// Sampling of snapshots, if the scene asks for them.
    pub fields: Option<Fields>,
    /// Motion of the nodes beside supports that move.
    motion: Rc<NodalMotion>,
    /// Deflections among which the largest is found.
    deflections: DeflectionSites,
    /// Stresses at the nodes, if the scene asks for their extremes.
    extremes: Option<Rc<StressSites>>,
    /// Rigid motions that nothing restrains, in words; `None` if there are none.
    pub mechanism: Option<&'static str>,
    /// Notes on the mesh file, one sentence each.
    pub notes: Vec<String>,
    /// Warnings from the set-up, one sentence each; the same on every process.
    pub warnings: Vec<String>,
    /// Kinetic energy of the plate moving at the speed of sound of its material, in J.
    sonic: f64,
    /// Wall time of mesh and matrices, and of the static start, in s.
    pub seconds: [f64; 2],
}

fn nothing_free() -> Error {
    Error::Mesh("the supports hold every dof of the mesh: nothing can move".into())
}

/// Returns the free dofs of a scene's mesh.
///
/// # Errors
/// Returns [`Error::Mesh`] where a support applies to no part of the mesh.
pub fn space(scene: &Scene, mesh: &Mesh) -> Result<DofMap> {
    let holds = holds(scene, mesh)?;
    let stops = stops_on(scene, mesh, &holds)?;
    let space = DofMap::of(&holds).with_extra(scene.attachments.ball_dofs());
    Ok(space.with_tips(stops.iter().map(|stop| stop.node)))
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

/// Returns the multiple of the forces in the plane at which the plate of a scene buckles, nearest
/// to zero and negative for reversed forces, with the place (m) of the largest deflection.
/// `None` where it does not buckle.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn buckling(scene: &Scene, mesh: &Mesh) -> Result<Option<(f64, [f64; 2])>> {
    on_ground(scene, mesh, &holds(scene, mesh)?, |ground| {
        let engine = Native::with_layout(ground.space.layout(mesh));
        let Some(Buckling { factor, shape }) = effects::buckling::load(ground, &engine)? else {
            return Ok(None);
        };
        let deflection =
            |&node: &usize| -> f64 { ground.space.deflection(node).map_or(0.0, |dof| shape[dof].abs()) };
        let largest = (0..mesh.nodes.len()).max_by(|a, b| deflection(a).total_cmp(&deflection(b)));
        Ok(Some((factor, mesh.nodes[largest.unwrap_or(0)].into())))
    })
}

/// Returns the multiple of a pressure that depends on the deflection beyond which the plate of a
/// scene, without obstacles, has no equilibrium; `None` without such a pressure or limit.
///
/// # Errors
/// Returns the same errors as [`Model::new`].
pub fn pull_in(scene: &Scene, mesh: &Mesh) -> Result<Option<f64>> {
    on_ground(scene, mesh, &holds(scene, mesh)?, |ground| {
        ground.pull_in(&Native::with_layout(ground.space.layout(mesh)))
    })
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
    let supports = regions::supports(scene, mesh, &SelfComm).map_err(|why| scene.explain(why))?;
    Ok(DofMap::holds(mesh, &supports))
}

/// Returns the tips of compliant stops, on a single process.
fn stops_on(scene: &Scene, mesh: &Mesh, holds: &[NodeConstraint]) -> Result<Vec<Stop>> {
    let sums = |of_nodes: &[f64]| Ok(of_nodes.to_vec());
    stops::find(scene, mesh, holds, &SelfComm, &sums).map_err(|why| scene.explain(why))
}

/// Calls a closure with the build context of a single process.
fn on_ground<R>(
    scene: &Scene,
    mesh: &Mesh,
    holds: &[NodeConstraint],
    act: impl FnOnce(&BuildContext<WholeMesh>) -> Result<R>,
) -> Result<R> {
    let space = DofMap::of(holds).with_extra(scene.attachments.ball_dofs());
    if space.dofs() == scene.attachments.ball_dofs() {
        return Err(nothing_free());
    }
    let stops = stops_on(scene, mesh, holds)?;
    let space = space.with_tips(stops.iter().map(|stop| stop.node));
    let gaps: Vec<_> = (0..scene.attachments.ball_dofs()).map(|dof| Some(space.extra(dof))).collect();
    act(&BuildContext::new((scene, mesh), &WholeMesh, holds, &space, &gaps, &stops)?)
}

impl Model {
    /// Builds the model of a scene on the native engine, without parts that the scene does not use.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for an engine or contact solver that this build does not have,
    /// [`Error::Mesh`] and [`Error::Singular`] for a plate without a unique solution, and
    /// [`Error::Scene`] for a formula without a value.
    pub fn new(scene: &Scene) -> Result<Model> {
        serves(scene, EngineName::Native)?;
        let clock = Instant::now();
        phase("mesh");
        let mesh = mesh(scene).map_err(|why| scene.explain(why))?;
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
    let Effects { system, start, lifts, sites, places, attribution, reactions, mechanism, warnings, seconds } =
        effects::compose(engine, ground).map_err(|why| ground.scene.explain(why))?;
    let shapes: Vec<&[f64]> = lifts.iter().map(|lift| &*lift.shape).collect();
    let probes = ground.scene.output.probes.iter().map(|probe| ground.probe(probe, &shapes));
    let probes: Vec<_> = probes.collect::<Result<_>>()?;
    let curvatures = PlateCurvatures::if_asked(ground)?;
    let motion = Rc::new(NodalMotion::new(ground, &lifts));
    let friction = FrictionalProbes::new(ground.scene, &system, &sites)?;
    let readings = Readings::new(ground, &probes, &lifts, &motion, curvatures.as_ref(), friction)?;
    let probes = probes.into_iter().map(|(probe, _)| probe).collect();
    let fields = Fields::new(ground, &motion, curvatures.as_ref())?;
    let extremes = StressSites::if_asked(ground, &motion, curvatures.as_ref())?.map(Rc::new);
    let seconds = [clock.elapsed().as_secs_f64() - seconds, seconds];
    let deflections = DeflectionSites::new(&places, &sites, &motion);
    let sonic = sonic_energy(ground);
    Ok(Model {
        system,
        start,
        probes,
        readings,
        sites,
        places,
        attribution,
        reactions,
        fields,
        motion,
        deflections,
        extremes,
        mechanism,
        notes: ground.mesh.notes.clone(),
        warnings,
        sonic,
        seconds,
    })
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

impl<E: Engine + 'static> Model<E> {
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
        scene.time.scheme.start(&self.system, scene.time.step, self.start.clone(), solver)
    }

    /// Returns force (N) and moments about the axes x and y through its centroid (N m) of each
    /// named support at the present step of a scheme that keeps its balance. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the loads.
    pub fn support_forces(&self, scheme: &mut dyn Scheme) -> Result<Vec<[f64; 3]>> {
        let Some(reactions) = &self.reactions else { return Ok(Vec::new()) };
        Ok(self.sum_reactions(reactions, &reactions.at_nodes(&self.system, &scheme.balance()?)?))
    }

    /// Returns force (N) and moments about the axes x and y through its centroid (N m) of each
    /// named support, with the plate held at rest in its start by the loads of the first instant.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine, of the loads and of the support motions.
    pub fn static_reactions(&self) -> Result<Vec<[f64; 3]>> {
        let Some(reactions) = &self.reactions else { return Ok(Vec::new()) };
        let balance = StepBalance::at_rest(&self.system, &self.start.displacement)?;
        Ok(self.sum_reactions(reactions, &reactions.at_nodes(&self.system, &balance)?))
    }

    /// Returns force and moments of each named support, given this process's part of the forces at
    /// its nodes. Collective.
    fn sum_reactions(&self, reactions: &Reactions, at_nodes: &[f64]) -> Vec<[f64; 3]> {
        self.system.engine.comm().all_reduce_sum_slice(&reactions.sums(at_nodes))
    }

    /// Returns the rates of all deflections and slopes of this process's cells at the present
    /// instant of a scheme, three per node, in a frame at rest. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the support motions.
    pub fn nodal_rates(&self, scheme: &mut dyn Solution) -> Result<Vec<f64>> {
        let velocity = scheme.velocity()?;
        let mut rates = self.motion.relative(&self.system.engine.to_local(&velocity)?);
        self.motion.carry(&scheme.support_rates()?, &mut rates);
        Ok(rates)
    }

    /// Returns force (N) and dissipated energy (J) of each slider of the scene. Collective.
    pub fn friction(&self, scene: &Scene, scheme: &dyn Scheme) -> Vec<[f64; 2]> {
        let mut sums = vec![[0.0; 2]; scene.sliders.len()];
        for Friction { number, force, dissipated } in scheme.friction() {
            sums[number] = [force, dissipated];
        }
        self.system.engine.comm().all_reduce_sum_slice(sums.as_flattened()).as_chunks().0.to_vec()
    }

    /// Returns the guard of the energy of a scheme at its start.
    fn guard(&self, scene: &Scene, scheme: &dyn Solution) -> Result<Guard> {
        let sonic = if self.system.drive.varies() { self.sonic } else { f64::INFINITY };
        let guard = Guard::new(scheme.energies()?, sonic, scene.solver.energy_guard, advice(scene));
        // A buckled plate at rest has no energy but rounding.
        let stretching = self.system.drive.stretching.as_ref();
        Ok(guard.beside(stretching.map_or(0.0, |form| form.depth())))
    }

    /// Starts a search for the largest von Mises stress; `None` unless the scene asks for extremes.
    pub fn stress_watch(&self) -> Option<StressWatch> {
        self.extremes.as_ref().map(StressWatch::new)
    }

    /// Returns the probes of deflections, each with its share of the lift by every support that
    /// moves, per metre.
    pub fn framed_deflections(&self) -> Vec<FramedProbe> {
        self.readings.deflections().cloned().collect()
    }

    /// Returns whether [`Model::probes`] give the values at all probes: deflections beside supports
    /// that do not move.
    pub fn probes_deflections_only(&self) -> bool {
        self.readings.are_deflections_only()
    }
}

/// Builds the condensed contact solver, on any engine.
///
/// # Errors
/// Returns [`Error::Singular`] where the matrix is not positive definite.
pub fn condensed<E: Engine + 'static>(
    engine: &E,
    sum: &LinearCombination,
    bounded: usize,
) -> Result<Box<dyn Solver<E>>> {
    Ok(Box::new(Condensed::new(engine, sum, bounded)?))
}

/// Returns an error unless the scene asks for this engine and for one of its contact solvers.
fn serves(scene: &Scene, engine: EngineName) -> Result<()> {
    if scene.solver.engine != engine {
        return Err(Error::Usage(format!(
            "solver.engine: this build has no \"{}\"; it has \"{}\"",
            scene.solver.engine, engine
        )));
    }
    let has = |vi: &ContactSolver| engine == EngineName::Petsc || vi.runs_on_any_engine();
    if !has(&scene.solver.vi) {
        let names = ContactSolver::ALL.into_iter().filter(has);
        let names: Vec<String> = names.map(|vi| format!("\"{vi}\"")).collect();
        return Err(Error::Usage(format!(
            "solver.vi: the {} engine has no \"{}\"; it has {}",
            engine,
            scene.solver.vi,
            names.join(", ")
        )));
    }
    if scene.time.mass == Mass::Modal && scene.solver.vi != ContactSolver::Condensed {
        return Err(Error::Usage(format!(
            "solver.vi: time.mass = \"modal\" solves contact in compliance form, not by \"{}\"; expected \"condensed\"",
            scene.solver.vi
        )));
    }
    Ok(())
}
