//! Initial conditions.

use super::bearing;
use super::contributions::Body;
use super::ground::BuildContext;
use super::heights;
use super::motion::Lift;
use super::of_cells::OfCells;
use super::stretched_equilibrium;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy};
use crate::mesh::Point;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene::Side;
use crate::scheme::{Start, System};
use crate::simulation::{DeflectionDof, DofCoordinates};

/// Tolerance, relative to the deflection, for a start within the obstacles and on the supports.
const BEYOND: f64 = 1e-9;

impl<P: Partition> BuildContext<'_, P> {
    /// Computes the equilibrium from which the scene starts. Collective.
    fn at_rest<E: OfCells>(&self, system: &System<E>, mechanism: Option<&'static str>) -> Result<Vec<f64>> {
        let BuildContext { scene, partition, .. } = self;
        let initial = &scene.initial;
        let key = initial.key();
        if let (Some(motion), true) = (mechanism, scene.obstacles.is_empty()) {
            return Err(Error::Singular(format!(
                "{key}: the plate has no equilibrium, for its supports leave it a mechanism: {motion}"
            )));
        }
        crate::simulation::phase("static start");
        let mut load = partition.add_up(&self.local_load(&self.pressed(&initial.static_pressure)?))?;
        system.drive.add_support_force(0.0, &mut load)?;
        if initial.equilibrium {
            if let Some(constant) = &system.load {
                add(constant, &mut load);
            }
            for term in &system.drive.terms {
                axpy((term.factor)(0.0)?, &term.load, &mut load);
            }
            system.drive.load.iter().try_for_each(|of_time| of_time(0.0, &mut load))?;
        }
        self.lift_bodies(&mut load)?;
        let gaps = self.terms.bodies.iter().flat_map(|body| body.tip.into_iter().chain([body.gap]));
        let gaps: Vec<usize> = gaps.filter_map(|dof| partition.own_dof(dof)).collect();
        let mut bounds = system.bounds.clone();
        for (i, dof) in bounds.dofs.iter().enumerate() {
            if gaps.contains(dof) {
                (bounds.lower[i], bounds.upper[i]) = (f64::NEG_INFINITY, f64::INFINITY);
            }
        }
        if self.scene.stretches() {
            if let Some(motion) = mechanism {
                return Err(Error::Scene(format!(
                    "{key}: the supports leave the plate a mechanism: {motion}; in_plane.stretching finds its equilibrium \
                     only where supports hold it"
                )));
            }
            if system.drive.membrane.is_some() {
                return self.nonlinear(key, system, &load, &bounds);
            }
            let mut u = self.equilibrium(system, &load, &Bounds::default())?;
            stretched_equilibrium::settle(self, system, &bounds, &mut u)?;
            return Ok(u);
        }
        if system.drive.following.is_some() && initial.equilibrium {
            return self.nonlinear(key, system, &load, &bounds);
        }
        if mechanism.is_none() {
            return self.equilibrium(system, &load, &bounds);
        }
        bearing::equilibrium(self, key, system, &self.stiffness_at_rest(system), &load, &bounds)
    }

    /// Removes the loads of bodies from `load`, where they act on the gaps and on the plate below:
    /// held at rest, bodies do not load the plate. Collective.
    fn lift_bodies(&self, load: &mut [f64]) -> Result<()> {
        if self.gaps.is_empty() {
            return Ok(());
        }
        let mut local = vec![0.0; self.space.dofs()];
        for Body { spot, gap, .. } in &self.terms.bodies {
            if let Some(dof) = self.partition.own_dof(*gap) {
                spot.free.push(-load[dof], &mut local);
                load[dof] = 0.0;
            }
        }
        add(&self.partition.add_up(&local)?, load);
        Ok(())
    }
}

/// Returns the initial conditions of `[initial]` and warnings on them. Collective.
pub(super) fn start<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    mechanism: Option<&'static str>,
    lifts: &[Lift],
    places: &DofCoordinates,
    (opposite, sites): (&[Vec<usize>], &[DeflectionDof]),
) -> Result<(Start, Option<String>)> {
    let BuildContext { scene, space, .. } = *ground;
    let comm = ground.comm();
    let initial = &scene.initial;
    let engine = &system.engine;
    // Initial deflections are relative to the supports, velocities are not.
    let given = comm.all_ok(ground.shape_of(&initial.velocity))?;
    let rates = system.drive.rates(0.0)?;
    let of_supports = |dof: usize| lifts.iter().zip(&rates).map(|(lift, rate)| rate * lift.shape[dof]).sum();
    let thrown = if initial.velocity.is_zero() { None } else { contradiction(ground, &given, of_supports) };
    // The message names the violation of the first process that has one.
    let thrown = comm.all_gather(thrown.as_slice()).into_iter().next();
    let doubt = thrown.map(|thrown| {
        format!("initial.velocity: {}; it stops the plate there at once", in_words(thrown, "m/s", "1/s"))
    });
    let mut velocity = space.interpolate(&given);
    for (Lift { shape, .. }, rate) in lifts.iter().zip(&rates) {
        axpy(-rate, &space.interpolate(shape), &mut velocity);
    }
    let mut velocity = ground.owned(&velocity, engine.dofs());
    let mut displacement = if let Some(from) = &initial.from {
        let [u, v] = places.start(engine, &from.motion)?;
        velocity = v;
        u
    } else if initial.is_static() {
        ground.at_rest(system, mechanism)?
    } else {
        let shape = ground.shape_of(&initial.deflection).and_then(|shape| on_supports(ground, shape));
        ground.owned(&space.interpolate(&comm.all_ok(shape)?), engine.dofs())
    };
    let (u, v) = (engine.to_local(&displacement)?.into_owned(), engine.to_local(&velocity)?.into_owned());
    for Body { spot, gap, tip, start, .. } in &ground.terms.bodies {
        let Some(dof) = ground.partition.own_dof(*gap) else { continue };
        displacement[dof] = start[0] - spot.free.deflection(&u);
        velocity[dof] = start[1] - spot.free.deflection(&v);
        for (Lift { motion, shape, .. }, rate) in lifts.iter().zip(&rates) {
            let lift = spot.of_shape.deflection(shape);
            displacement[dof] -= lift * motion.at(Point::origin(), 0.0)?;
            velocity[dof] -= lift * rate;
        }
        if let Some(tip) = tip.and_then(|tip| ground.partition.own_dof(tip)) {
            (displacement[tip], velocity[tip]) = (displacement[dof], velocity[dof]);
        }
    }
    if scene.initial.from.is_none() {
        let tips =
            ground.tips().map(|(_, tip)| tip).chain(ground.terms.bodies.iter().filter_map(|body| body.tip));
        let tips = tips.filter_map(|tip| ground.partition.own_dof(tip));
        compress(tips, &system.bounds, &mut displacement, &mut velocity);
    }
    let violation = comm.all_reduce_max(system.bounds.violation(&displacement));
    let largest = displacement.iter().fold(system.bounds.magnitude(), |m, u| m.max(u.abs()));
    if violation > BEYOND * comm.all_reduce_max(largest) {
        // The rank of the largest violation names it.
        let worst = system.bounds.worst(&displacement);
        let beyond = worst.filter(|(_, depth)| *depth == violation).map(|(bound, _)| {
            let [lower, _] = system.bounds.rigid(bound);
            let site = &sites[bound];
            let side = if displacement[site.dof] < lower { Side::Below } else { Side::Above };
            let what = heights::bounding(ground, opposite, site, side)?;
            let [x, y] = site.at;
            Err::<(), _>(Error::Scene(format!(
                "{}: at ({x}, {y}) the plate starts {violation:.3e} m beyond {what}; expected a start within all obstacles",
                initial.key()
            )))
        });
        comm.all_ok(beyond.transpose())?;
    }
    Ok((Start { displacement, velocity }, doubt))
}

/// Holds the tips of compliant stops back at their obstacles where the plate starts beyond them.
fn compress(
    tips: impl Iterator<Item = usize>,
    bounds: &Bounds,
    displacement: &mut [f64],
    velocity: &mut [f64],
) {
    for (dof, bound) in tips.filter_map(|dof| Some((dof, bounds.dofs.binary_search(&dof).ok()?))) {
        let within = displacement[dof].max(bounds.lower[bound]).min(bounds.upper[bound]);
        if within != displacement[dof] {
            (displacement[dof], velocity[dof]) = (within, 0.0);
        }
    }
}

/// Returns the initial deflection if the supports allow it.
fn on_supports<P: Partition>(ground: &BuildContext<P>, shape: Vec<f64>) -> Result<Vec<f64>> {
    match contradiction(ground, &shape, |_| 0.0) {
        None => Ok(shape),
        Some(fault) => Err(Error::Scene(format!("initial.deflection: {}", in_words(fault, "m", "")))),
    }
}

/// Violation of a support by an initial field: place, whether the field itself violates the support
/// or its slope along x or y, the value given, and the value held.
type Contradiction = ([f64; 2], bool, f64, f64);

/// Describes a violation, with the units of the field and of its slope.
fn in_words(([x, y], is_value, given, held): Contradiction, of_value: &str, of_slope: &str) -> String {
    let [x, y, given, held] = [x, y, given, held].map(|x| format!("{x:.3e}").parse().unwrap_or(x));
    let (what, unit) = if is_value { ("", of_value) } else { ("a slope of ", of_slope) };
    let held = if held == 0.0 { "0".to_owned() } else { format!("{held:?} {unit}") };
    let given = format!("{given:?} {unit}");
    format!("{what}{} at ({x}, {y}), where a support holds the plate at {held}", given.trim_end())
}

/// Returns the first node of this process at which a field (three values per node) violates a
/// support: in its value where the deflection is held, in its slopes where the plate is clamped.
fn contradiction<P: Partition>(
    ground: &BuildContext<P>,
    shape: &[f64],
    of_supports: impl Fn(usize) -> f64,
) -> Option<Contradiction> {
    let largest = |is_chosen: fn(usize) -> bool| {
        let chosen = shape.iter().enumerate().filter(|(dof, _)| is_chosen(dof % PER_NODE));
        chosen.fold(0.0, |m: f64, (_, value)| m.max(value.abs()))
    };
    let scales = [largest(|which| which == 0), largest(|which| which > 0)];
    let wrong = |node: usize| {
        let held = DofMap::held(&ground.holds[node]);
        let is_clamped = held.iter().all(|held| *held);
        (0..PER_NODE).find_map(|which| {
            let dof = PER_NODE * node + which;
            let (given, held) = (shape[dof], of_supports(dof));
            let is_held = if which == 0 { ground.holds[node].deflection > 0.0 } else { is_clamped };
            let is_off = (given - held).abs() > BEYOND * scales[usize::from(which > 0)].max(held.abs());
            let Point { coords } = ground.mesh.nodes[node];
            (is_held && is_off).then(|| (coords.into(), which == 0, given, held))
        })
    };
    (0..ground.holds.len()).find_map(wrong)
}
