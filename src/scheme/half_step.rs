//! Half a step of the midpoint rule: what [`super::Midpoint`] and [`super::Conserving`] share.

use super::System;
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;
use crate::vi::{Solver, Step, Verdict};

/// A state (U, V) and what follows from it.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// U.
    pub u: Vec<f64>,
    /// V.
    pub v: Vec<f64>,
    /// Reactions of the obstacles at U, where U is in equilibrium with its velocities held.
    pub reaction: Vec<f64>,
    /// F - K U.
    pub force: Vec<f64>,
    /// Its energies.
    pub energies: Energies,
}

impl State {
    /// The state of a displacement and its rate.
    pub fn new<E: Engine>(system: &System<E>, u: Vec<f64>, rate: &[f64]) -> Result<State> {
        let System { engine, mass, bounds, .. } = system;
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.velocity(mass, rate, &mut v)?;
        let (reaction, force) = (vec![0.0; bounds.len()], vec![0.0; u.len()]);
        let mut state = State { u, v, reaction, force, energies: Energies::default() };
        state.weigh(system)?;
        Ok(state)
    }

    /// Sets force and energies to those of U and V.
    pub fn weigh<E: Engine>(&mut self, system: &System<E>) -> Result<()> {
        let elastic = system.force(&self.u, &mut self.force)?;
        let kinetic = 0.5 * system.engine.vis_viva(&system.mass, &self.v)?;
        self.energies = Energies { kinetic, elastic, work: system.work(&self.u)? };
        Ok(())
    }
}

/// The implicit half of a step, from a state to the middle (U + x, V + dV/2).
pub(super) struct HalfStep<'s, E: Engine> {
    system: &'s System<E>,
    sum: [(f64, &'s E::Form); 2],
    solver: Step<E>,
    /// Length of the whole step, in s.
    pub dt: f64,
    b: Vec<f64>,
    bounds: Bounds,
    /// x.
    pub x: Vec<f64>,
    /// C^-1 B x: half the change of p.
    pub rate: Vec<f64>,
    /// dV.
    pub dv: Vec<f64>,
    /// Reactions in the middle.
    pub reaction: Vec<f64>,
}

impl<'s, E: Engine> HalfStep<'s, E> {
    /// The matrix of a step, 4 M / dt^2 + K.
    pub fn sum(system: &'s System<E>, dt: f64) -> [(f64, &'s E::Form); 2] {
        [(4.0 / (dt * dt), &system.mass), (1.0, &system.stiffness)]
    }

    /// With a solver of [`HalfStep::sum`].
    pub fn new(system: &'s System<E>, dt: f64, solver: Box<dyn Solver<E>>) -> Result<HalfStep<'s, E>> {
        let System { engine, mass, bounds, .. } = system;
        let sum = Self::sum(system, dt);
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        Ok(HalfStep {
            system,
            sum,
            solver: Step::new(solver, engine, &sum)?,
            dt,
            b: vec![0.0; dofs],
            bounds: bounds.clone(),
            x: vec![0.0; dofs],
            rate: vec![0.0; velocities],
            dv: vec![0.0; velocities],
            reaction: vec![0.0; bounds.len()],
        })
    }

    /// Takes the increment that a first velocity makes.
    pub fn begin(&mut self, velocity: &[f64]) {
        self.x.iter_mut().zip(velocity).for_each(|(x, v)| *x = 0.5 * self.dt * v);
    }

    /// Rate of U over the last half step, in m/s.
    pub fn rates(&self) -> Vec<f64> {
        self.x.iter().map(|x| 2.0 / self.dt * x).collect()
    }

    /// Solves (4 M / dt^2 + K) x = 2/dt B^T V + F - K U + G^T r for U + x within the bounds.
    pub fn solve(&mut self, from: &State) -> Result<Verdict> {
        let System { engine, mass, bounds, .. } = self.system;
        let dt = self.dt;
        engine.momentum(mass, &from.v, &mut self.b)?;
        for (b, force) in self.b.iter_mut().zip(&from.force) {
            *b = 2.0 / dt * *b + force;
        }
        self.bounds.shift(bounds, |dof, bound| bound - from.u[dof]);
        let length = self.system.length(&from.u)?;
        let sum: &Sum<E> = &self.sum;
        let verdict =
            self.solver.solve(engine, sum, &self.b, &self.bounds, length, &mut self.x, &mut self.reaction)?;
        engine.velocity(mass, &self.x, &mut self.rate)?;
        for (dv, (rate, v)) in self.dv.iter_mut().zip(self.rate.iter().zip(&from.v)) {
            *dv = 4.0 / dt * rate - 2.0 * v;
        }
        Ok(verdict)
    }

    /// U + 2 gamma x and V + gamma dV.
    pub fn extend(&self, from: &State, gamma: f64, to: &mut State) {
        for (to, (u, x)) in to.u.iter_mut().zip(from.u.iter().zip(&self.x)) {
            *to = u + 2.0 * gamma * x;
        }
        for (to, (v, dv)) in to.v.iter_mut().zip(from.v.iter().zip(&self.dv)) {
            *to = v + gamma * dv;
        }
    }

    /// Numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
