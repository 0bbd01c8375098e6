//! Where the motion starts.

use super::OfCells;
use super::attached::{Attached, Rider};
use super::bearing;
use super::ground::{Ground, Team};
use super::loads::Loads;
use super::motion::{Frames, Lift};
use crate::error::{Error, Result};
use crate::obstacle::Bounds;
use crate::scheme::{self, Start, System};
use crate::simulation::judge;
use crate::space::PER_NODE;

/// A start counts as within the obstacles, and on its supports, to this part of the deflection.
const BEYOND: f64 = 1e-9;

/// What equilibria are found with.
pub(super) struct Statics<'g, T: Team> {
    pub ground: &'g Ground<'g, T>,
    pub attached: &'g Attached<'g>,
    /// The rigid motions that nothing holds.
    pub mechanism: Option<&'static str>,
}

impl<T: Team> Statics<'_, T> {
    /// Equilibrium of the plate under a load that leaves balls alone: they stay where they are. Collective.
    pub fn equilibrium<E: OfCells>(
        &self,
        system: &System<E>,
        load: &[f64],
        bounds: &Bounds,
    ) -> Result<Vec<f64>> {
        let held = self.held(system);
        let stiffness = held.as_ref().unwrap_or(&system.stiffness);
        let (u, _, verdict) = scheme::equilibrium(&system.engine, stiffness, load, bounds)?;
        judge(0, 0.0, verdict.kkt, self.ground.scene.solver.tolerance)?;
        Ok(u)
    }

    /// The stiffness of the plate with balls that stay where they are; `None` where there are none.
    fn held<E: OfCells>(&self, system: &System<E>) -> Option<E::Form> {
        let Ground { scene, cells, .. } = *self.ground;
        (!scene.balls.is_empty())
            .then(|| system.engine.native().form(self.attached.stiffness_that_holds_balls(cells)))
    }

    /// The equilibrium that the scene starts from. Collective.
    fn at_rest<E: OfCells>(&self, system: &System<E>, loads: &Loads, frames: &Frames) -> Result<Vec<f64>> {
        let Ground { scene, own, add_up, .. } = self.ground;
        let initial = &scene.initial;
        let key = if initial.equilibrium { "initial.equilibrium" } else { "initial.static_pressure" };
        if let (Some(motion), true) = (self.mechanism, scene.obstacles.is_empty()) {
            return Err(Error::Singular(format!(
                "{key}: the plate has no equilibrium, for its supports leave it a mechanism: {motion}"
            )));
        }
        let mut load = add_up(&self.ground.pressed(&initial.static_pressure)?)?;
        frames.pull(0.0, &mut load)?;
        if initial.equilibrium {
            let constant = loads.constant.iter().flatten();
            load.iter_mut().zip(constant).for_each(|(load, f)| *load += f);
            loads.add(0.0, &mut load)?;
        }
        self.lift_balls(&mut load)?;
        let gaps: Vec<usize> = self.attached.balls.iter().filter_map(|ball| own(ball.gap)).collect();
        let mut bounds = system.bounds.clone();
        for (i, dof) in bounds.dofs.iter().enumerate() {
            if gaps.contains(dof) {
                (bounds.lower[i], bounds.upper[i]) = (f64::NEG_INFINITY, f64::INFINITY);
            }
        }
        if self.mechanism.is_none() {
            return self.equilibrium(system, &load, &bounds);
        }
        let held = self.held(system);
        let stiffness = held.as_ref().unwrap_or(&system.stiffness);
        bearing::equilibrium(self, key, system, stiffness, &load, &bounds)
    }

    /// Takes what pulls at balls from a load: it is on their gaps, and on the plate under them, which carries none of it. Collective.
    fn lift_balls(&self, load: &mut [f64]) -> Result<()> {
        let Ground { scene, space, own, add_up, .. } = self.ground;
        if scene.balls.is_empty() {
            return Ok(());
        }
        let mut local = vec![0.0; space.dofs()];
        for Rider { spot, gap, .. } in &self.attached.balls {
            if let Some(dof) = own(*gap) {
                spot.free.push(-load[dof], &mut local);
                load[dof] = 0.0;
            }
        }
        load.iter_mut().zip(add_up(&local)?).for_each(|(load, f)| *load += f);
        Ok(())
    }
}

/// The start under `[initial]`. Collective.
pub(super) fn start<E: OfCells, T: Team>(
    system: &System<E>,
    statics: &Statics<T>,
    loads: &Loads,
    frames: &Frames,
    lifts: &[Lift],
) -> Result<Start> {
    let Statics { ground, attached, .. } = statics;
    let Ground { scene, space, team, .. } = **ground;
    let initial = &scene.initial;
    let engine = &system.engine;
    // Deflections are over those of the supports, velocities are not.
    let mut velocity = space.interpolate(&team.together(ground.shape_of(&initial.velocity))?);
    for Lift { motion, shape, .. } in lifts {
        let rate = motion.jet(0.0)?.first;
        velocity.iter_mut().zip(space.interpolate(shape)).for_each(|(v, lift)| *v -= rate * lift);
    }
    let mut velocity = ground.owned(&velocity, engine.dofs());
    let mut displacement = if initial.equilibrium || !initial.static_pressure.is_zero() {
        statics.at_rest(system, loads, frames)?
    } else {
        let shape = ground.shape_of(&initial.deflection).and_then(|shape| on_supports(ground, shape));
        ground.owned(&space.interpolate(&team.together(shape)?), engine.dofs())
    };
    let (u, v) = (engine.on_cells(&displacement)?, engine.on_cells(&velocity)?);
    for Rider { ball, spot, gap, .. } in &attached.balls {
        let Some(dof) = (ground.own)(*gap) else { continue };
        displacement[dof] = ball.height - spot.free.deflection(&u);
        velocity[dof] = ball.velocity - spot.free.deflection(&v);
        for Lift { motion, shape, .. } in lifts {
            let (jet, lift) = (motion.jet(0.0)?, spot.of_shape.deflection(shape));
            displacement[dof] -= lift * jet.value;
            velocity[dof] -= lift * jet.first;
        }
    }
    let violation = engine.maximum(system.bounds.violation(&displacement))?;
    let largest = displacement.iter().fold(system.bounds.magnitude(), |m, u| m.max(u.abs()));
    if violation > BEYOND * engine.maximum(largest)? {
        return Err(Error::Scene(format!(
            "initial: the plate starts {violation:.3e} m beyond an obstacle; expected a start within all of them"
        )));
    }
    Ok(Start { displacement, velocity })
}

/// The deflection of the start, if it is such as the supports allow.
fn on_supports<T: Team>(ground: &Ground<T>, shape: Vec<f64>) -> Result<Vec<f64>> {
    let largest = shape.iter().step_by(PER_NODE).fold(0.0, |m: f64, w| m.max(w.abs()));
    let w = |node: usize| shape[PER_NODE * node];
    let torn = |&node: &usize| ground.holds[node].deflection > 0.0 && w(node).abs() > BEYOND * largest;
    match (0..ground.holds.len()).find(torn) {
        None => Ok(shape),
        Some(node) => {
            let (at, w) = (ground.mesh.nodes[node], w(node));
            let wrong = format!("{w:?} m at ({}, {}), where a support holds the plate at 0", at.x, at.y);
            Err(Error::Scene(format!("initial.deflection: {wrong}")))
        }
    }
}
