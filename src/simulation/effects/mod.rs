//! Effects of a scene, composed once into the semi-discrete problem: matrices, loads, bounds, and
//! their time-dependent parts.
//!
//! Where supports move, U is the deflection relative to the *lift*, the quasi-static shape that the
//! support motion gives the plate. In that frame supports are at rest, obstacles move by less the
//! lift, and inertia is a load (the pseudo-static decomposition of earthquake engineering: Clough
//! and Penzien, *Dynamics of Structures*, section 26-1).

mod attached;
mod attribution;
mod bearing;
mod elastic_edges;
mod ground;
mod heights;
mod held_loads;
mod inertia;
mod loads;
mod lumps;
mod motion;
mod of_cells;
mod parts;
mod reactions;
mod ribs;
mod sliders;
mod start;
mod statics;
mod stop_springs;
mod units;

pub(super) use attribution::Attribution;
pub(super) use ground::BuildContext;
pub use loads::{LoadTotal, Resultant};
pub(super) use motion::Lift;
pub(super) use of_cells::OfCells;
pub(super) use reactions::{Reactions, Wrench};

use super::{DeflectionDof, DofCoordinates, phase};
use crate::assembly::{self, CellArrays};
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::error::Result;
use crate::linalg::{ElementMatrix, Engine, Form, SingularMassCell};
use crate::mesh::Mesh;
use crate::modes;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene::{Mass, Scene};
use crate::scheme::{Damping, ModalDamping, Start, System, TimeDependence};
use attached::Attached;
use heights::Heights;
use loads::Loads;
use statics::Statics;
use std::time::Instant;

/// Matrices of a scene, in element contributions.
pub struct Matrices {
    /// Contributions to K.
    pub stiffness: Vec<ElementMatrix>,
    /// Contributions to `$M_r$`.
    pub consistent: Vec<ElementMatrix>,
    /// Rows of B and entries of C.
    pub singular: Vec<SingularMassCell>,
    /// Load of `initial.static_pressure` or, where that is 0, the constant part of `[load]`, in N.
    pub load: Vec<f64>,
    /// Bounded dofs, ascending.
    pub bounded: Vec<usize>,
}

/// Semi-discrete problem of a plate with all effects of a scene.
pub(super) struct Effects<E: Engine> {
    pub system: System<E>,
    pub start: Start,
    pub lifts: Vec<Lift>,
    /// Deflections of the engine's dofs; the bounded ones come first, in the order of the bounds.
    pub sites: Vec<DeflectionDof>,
    pub places: DofCoordinates,
    /// Obstacles behind the bounds, if any of them has a name.
    pub attribution: Option<Attribution>,
    /// Reactions of the supports, if any of them has a name.
    pub reactions: Option<Reactions>,
    /// Rigid motions that nothing restrains, in words.
    pub mechanism: Option<&'static str>,
    /// Warnings on the scene, one sentence each; the same on every process.
    pub warnings: Vec<String>,
    /// Wall time of the static start, in s.
    pub seconds: f64,
}

/// Adds the masses of ribs, and masses at points that can move, to those of the cells. Collective.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a rib that leaves the plate.
pub(super) fn add_fixed_masses(
    scene: &Scene,
    mesh: &Mesh,
    holds: &[NodeConstraint],
    comm: &impl Communicator,
    cells: &mut [CellArrays],
) -> Result<()> {
    let bare: Vec<_> = cells.iter().map(|cell| cell.local.clone()).collect();
    ribs::add_masses(scene, mesh, comm, cells)?;
    lumps::add_masses(scene, mesh, holds, comm, cells)?;
    assembly::average_carried(cells, &bare);
    Ok(())
}

/// Returns all matrices of a scene.
///
/// # Errors
/// Returns the errors of the scene's formulas and regions on the mesh.
pub(super) fn matrices<P: Partition>(ground: &BuildContext<P>) -> Result<Matrices> {
    let attached = Attached::new(ground)?;
    let initial = &ground.scene.initial.static_pressure;
    let load = if initial.is_zero() {
        Loads::new(ground, &attached)?.constant
    } else {
        Some(ground.pressed(initial)?)
    };
    let (sites, bounded) = heights::sites(ground, &heights::opposite(ground)?, &attached.balls, &[]);
    Ok(Matrices {
        stiffness: attached.stiffness(ground.cells),
        consistent: attached.consistent_mass(ground.cells),
        singular: attached.singular_mass(ground.cells),
        load: load.unwrap_or_else(|| vec![0.0; ground.space.dofs()]),
        bounded: sites[..bounded].iter().map(|site| site.dof).collect(),
    })
}

/// Returns the resultants of the loads of a scene, in a build context with all dofs free.
///
/// # Errors
/// Returns the same errors as [`matrices`].
pub(super) fn load_totals<P: Partition>(ground: &BuildContext<P>) -> Result<Vec<LoadTotal>> {
    loads::totals(ground, &Attached::new(ground)?)
}

/// Returns the rigid motions that nothing restrains, in words. Collective.
///
/// # Errors
/// Returns the same errors as [`matrices`].
pub(super) fn mechanism<P: Partition>(ground: &BuildContext<P>) -> Result<Option<&'static str>> {
    let attached = Attached::new(ground)?;
    attached.require_held_parts(ground)?;
    Ok(attached.mechanism(ground))
}

/// Builds the semi-discrete problem of a scene. Collective.
///
/// # Errors
/// Returns the errors of the scene's formulas and regions on the mesh, and
/// [`Singular`](crate::Error::Singular) where a static start is asked of a mechanism.
pub(super) fn compose<E: OfCells, P: Partition>(engine: E, ground: &BuildContext<P>) -> Result<Effects<E>> {
    let BuildContext { scene, cells, .. } = *ground;
    let attached = Attached::new(ground)?;
    attached.require_held_parts(ground)?;
    let mechanism = attached.mechanism(ground);
    let mut warnings = Vec::from_iter(units::question(ground));
    if let Some(motion) = mechanism {
        warnings.push(format!(
            "the supports leave the plate a mechanism: {motion}; only obstacles can hold it at rest"
        ));
    }
    if scene.time.mass == Mass::Singular && mechanism.is_some() {
        attached.refuse_weightless(ground)?;
    }
    let stiffness = engine.native().form(attached.stiffness(cells));
    let mass = match scene.time.mass {
        Mass::Singular => engine.native().averages(attached.singular_mass(cells)),
        Mass::Consistent | Mass::Modal => engine.native().form(attached.consistent_mass(cells)),
    };
    engine.require_memory(&(&stiffness + &mass), scene.time.factors())?;
    // Balls are loose too, and their rigid motions come with those of the plate.
    let is_loose = mechanism.is_some() || !scene.attachments.balls.is_empty();
    let mass = match mass {
        Form::Cells(consistent) if scene.time.mass == Mass::Modal => {
            phase("modes");
            let range = scene.time.modes;
            let (mass, doubt) = inertia::modal_mass(&engine, &stiffness, consistent, range, is_loose)?;
            warnings.extend(doubt);
            mass
        }
        mass => mass,
    };
    let damping = scene
        .damping
        .as_ref()
        .map_or(Damping::default(), |of| Damping { mass: of.mass, stiffness: of.stiffness });
    phase("loads");
    let loads = Loads::new(ground, &attached)?;
    let mut system = System {
        engine,
        stiffness,
        mass,
        damping,
        load: loads.constant.clone(),
        bounds: Bounds::default(),
        bound_numbers: None,
        drive: TimeDependence::default(),
    };

    let dashpots = attached.stops.dashpots(damping.stiffness, ground.comm());
    system.drive.dashpots = dashpots.map(|dashpots| system.engine.native().form(dashpots));

    let statics = Statics { ground, attached: &attached, mechanism };
    let lifts = motion::lifts(&system, &statics)?;

    if let Some(ratios) = scene.damping.as_ref().map(|damping| &damping.modal).filter(|of| !of.is_empty()) {
        let System { engine, stiffness, mass, .. } = &system;
        system.drive.modal = Some(match mass {
            Form::Modal { modes, .. } => inertia::modal_damping(modes, ratios),
            _ => {
                // Rigid motions come first and do not count.
                let rigid = if is_loose { 3 + scene.attachments.balls.len() } else { 0 };
                let mut modes = modes::shapes(engine, stiffness, mass, ratios.len() + rigid, is_loose)?;
                modes.retain(|mode| mode.frequency > 0.0);
                ModalDamping::new(engine, mass, &modes, ratios)?
            }
        });
    }

    let opposite = heights::opposite(ground)?;
    let sliders = sliders::find(ground, &opposite)?;
    let (sites, bounded) = heights::sites(ground, &opposite, &attached.balls, &sliders);
    let heights = Heights::new(ground, &opposite, &sites[..bounded], &sliders, &lifts)?;
    system.drive.sliders = sliders::bounded(ground, &sliders, &sites[..bounded]);
    let is_named = scene.obstacles.iter().any(|obstacle| obstacle.name.is_some());
    let attribution = is_named.then(|| Attribution::new(ground, &opposite, &sites[..bounded])).transpose()?;
    let dofs = system.engine.dofs();
    let moving = |lift: &Lift| lift.moving(ground, &attached, &sites[..bounded], dofs);
    system.drive.supports = lifts.iter().map(moving).collect::<Result<_>>()?;
    system.bounds = system.drive.relative_bounds(0.0, heights.at_start()?)?;
    if scene.time.scheme.capabilities().needs_singular_mass.is_some() {
        attached.refuse_stopped(ground, &system.bounds)?;
    }

    let clock = Instant::now();
    let places = DofCoordinates::new(ground, system.engine.dofs(), attached.carried());
    if P::DIVIDES {
        system.bound_numbers = Some(places.bound_numbers(&system.engine, &system.bounds.dofs));
    }
    let (start, doubt) = start::start(&system, &statics, &loads, &lifts, &places)?;
    warnings.extend(doubt);
    let seconds = clock.elapsed().as_secs_f64();
    (system.drive.terms, system.drive.load) = loads.in_time();
    if heights.vary() && ground.comm().all_reduce_any(bounded > 0) {
        system.drive.bounds = Some(Box::new(move |t, bounds: &mut Bounds| heights.set(t, bounds)));
    }
    let reactions = Reactions::new(ground, &system, &attached, &lifts)?;
    Ok(Effects { system, start, lifts, sites, places, attribution, reactions, mechanism, warnings, seconds })
}
