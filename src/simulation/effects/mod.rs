//! Effects of a scene, composed once into the semi-discrete problem: matrices, loads, bounds, and
//! their time-dependent parts.
//!
//! Where supports move, U is the deflection relative to the *lift*, the quasi-static shape that the
//! support motion gives the plate. In that frame supports are at rest, obstacles move by less the
//! lift, and inertia is a load (the pseudo-static decomposition of earthquake engineering: Clough
//! and Penzien, *Dynamics of Structures*, section 26-1).

mod attribution;
mod bearing;
pub(super) mod buckling;
mod contributions;
mod damping;
mod following_pressure;
mod friction;
mod ground;
mod heights;
mod inertia;
mod loads;
mod matrices;
mod motion;
mod of_cells;
mod reactions;
mod registry;
mod rigid;
mod sliders;
mod start;
mod statics;
mod stretched_equilibrium;
mod stretching;
mod units;

pub(super) use attribution::Attribution;
pub(super) use ground::BuildContext;
pub(super) use loads::totals as load_totals;
pub use loads::{LoadTotal, Resultant};
pub(super) use motion::Lift;
pub(super) use of_cells::OfCells;
pub(super) use reactions::{Reactions, Wrench};

use super::{DeflectionDof, DofCoordinates, phase};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::{ElementMatrix, Engine, Form, SingularMassCell};
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene::Mass;
use crate::scheme::{FollowingLoad, Start, System, TimeDependence};
use following_pressure::FollowingPressure;
use heights::Heights;
use loads::Loads;
use std::rc::Rc;
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
    /// Obstacles behind the bounds, if there is anything to touch.
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

/// Returns all matrices of a scene.
///
/// # Errors
/// Returns the errors of the scene's formulas and regions on the mesh.
pub(super) fn matrices<P: Partition>(ground: &BuildContext<P>) -> Result<Matrices> {
    let initial = &ground.scene.initial.static_pressure;
    let load = if initial.is_zero() {
        Loads::new(ground, &ground.terms.loads)?.constant(ground)?
    } else {
        Some(ground.local_load(&ground.pressed(initial)?))
    };
    let (sites, bounded) = heights::sites(ground, &heights::opposite(ground)?, &[]);
    Ok(Matrices {
        stiffness: ground.stiffness(),
        consistent: ground.consistent_mass(),
        singular: ground.singular_mass(),
        load: load.unwrap_or_else(|| vec![0.0; ground.space.dofs()]),
        bounded: sites[..bounded].iter().map(|site| site.dof).collect(),
    })
}

/// Returns the rigid motions that nothing restrains, in words. Collective.
///
/// # Errors
/// Returns the same errors as [`matrices`].
pub(super) fn mechanism<P: Partition>(ground: &BuildContext<P>) -> Result<Option<&'static str>> {
    ground.require_held_parts()?;
    Ok(ground.mechanism())
}

/// Builds the semi-discrete problem of a scene, in the order of its equations. Collective.
///
/// # Errors
/// Returns the errors of the scene's formulas and regions on the mesh, and
/// [`Singular`](crate::Error::Singular) where a static start is asked of a mechanism.
pub(super) fn compose<E: OfCells, P: Partition>(engine: E, ground: &BuildContext<P>) -> Result<Effects<E>> {
    let mut warnings = Vec::from_iter(units::question(ground));
    let mechanism = mechanism(ground)?;
    if let Some(motion) = mechanism {
        warnings.push(format!(
            "the supports leave the plate a mechanism: {motion}; only obstacles can hold it at rest"
        ));
    }

    // M and K.
    // A buckled plate moves in the modes of the plate without its forces.
    let is_buckled =
        buckling::is_buckled(ground, &engine, mechanism)? && ground.scene.time.mass == Mass::Modal;
    let [unpressed, geometric] = if is_buckled { ground.without_prestress() } else { Default::default() };
    let stiffness = engine.native().form(if is_buckled { unpressed } else { ground.stiffness() });
    let (mass, doubt) = inertia::mass(&engine, ground, &stiffness, mechanism.is_some())
        .map_err(|error| error.beside(&warnings))?;
    warnings.extend(doubt);
    let mut system = System {
        engine,
        stiffness,
        mass,
        damping: damping::rayleigh(ground.scene),
        load: None,
        bounds: Bounds::default(),
        bound_numbers: None,
        drive: TimeDependence::default(),
    };
    let geometric = is_buckled.then(|| system.engine.native().form(geometric));
    system.drive.stretching = stretching::form(ground, &system, geometric.as_ref())?.map(Rc::new);
    system.drive.membrane = stretching::over_dofs(ground, &system.mass);

    // C and the damping of modes.
    let dashpots = ground.terms.dashpots(system.damping.stiffness, ground.comm());
    system.drive.dashpots = dashpots.map(|dashpots| system.engine.native().form(dashpots));
    system.drive.modal = damping::modal(ground, &system, mechanism.is_some())?;

    // F.
    phase("loads");
    let loads = Loads::new(ground, &ground.terms.loads)?;
    system.load = loads.constant(ground)?;
    (system.drive.terms, system.drive.load) = loads.in_time(ground)?;
    let following = FollowingPressure::new(ground)?;
    system.drive.following = following.map(|pressure| -> Box<dyn FollowingLoad> { Box::new(pressure) });
    let is_singular = matches!(system.mass, Form::SingularMassCells(_));
    if is_singular && (system.drive.membrane.is_some() || system.drive.following.is_some()) {
        system.drive.rigid = ground.rigid_velocities();
    }

    // The frame of the supports.
    let lifts = motion::lifts(ground, &system, mechanism)?;

    // G, and the bounds on G U.
    let opposite = heights::opposite(ground)?;
    let sliders = sliders::find(ground, &opposite)?;
    let (sites, bounded) = heights::sites(ground, &opposite, &sliders);
    let heights = Heights::new(ground, &opposite, &sites[..bounded], &sliders, &lifts)?;
    system.drive.sliders = sliders::bounded(ground, &sliders, &sites[..bounded]);
    if let Some((friction, doubt)) = friction::of_obstacles(ground, &opposite, &sites[..bounded], &lifts)? {
        system.drive.friction = Some(friction);
        warnings.extend(doubt);
    }
    system.drive.viscous_tips = heights::viscous_tips(ground, &sites[..bounded]);
    let attribution = Attribution::if_any(ground, &opposite, &sites[..bounded])?;
    let dofs = system.engine.dofs();
    let moving = |lift: &Lift| lift.moving(ground, &sites[..bounded], dofs);
    system.drive.supports = lifts.iter().map(moving).collect::<Result<_>>()?;
    system.bounds = system.drive.relative_bounds(0.0, heights.at_start()?)?;
    if ground.scene.time.scheme.capabilities().needs_singular_mass.is_some() {
        heights::refuse_stopped(ground, &system.bounds)?;
    }
    let places = DofCoordinates::new(ground, dofs);
    if P::DIVIDES {
        system.bound_numbers = Some(places.bound_numbers(&system.engine, &system.bounds.dofs));
    }

    // The start.
    let clock = Instant::now();
    let faced = (&*opposite, &sites[..bounded]);
    let (start, doubt) = start::start(ground, &system, mechanism, &lifts, &places, faced)?;
    warnings.extend(doubt);
    let seconds = clock.elapsed().as_secs_f64();

    // What changes with time after it, and the rows of held dofs.
    if heights.vary() && ground.comm().all_reduce_any(bounded > 0) {
        system.drive.bounds = Some(Box::new(move |t, bounds: &mut Bounds| heights.set(t, bounds)));
    }
    let reactions = Reactions::new(ground, &system, &loads, &lifts, &sites[..bounded])?;
    Ok(Effects { system, start, lifts, sites, places, attribution, reactions, mechanism, warnings, seconds })
}
