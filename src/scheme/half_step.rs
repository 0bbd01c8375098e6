//! Implicit half of a midpoint step, shared by [`super::Midpoint`] and [`super::Conserving`].

use super::System;
use super::drive::InstantData;
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Answer, CheckedSolver, Problem, Solver, StepReport};
use std::rc::Rc;

/// State (U, V) with its forces, reactions and energies.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Displacement U, in m, one entry per dof.
    pub u: Vec<f64>,
    /// Velocity V, in m/s, one entry per velocity dof.
    pub v: Vec<f64>,
    /// Reactions of the obstacles where U is in equilibrium for given p, in N, one entry per bound.
    pub reaction: Vec<f64>,
    /// Force F - K U with the constant load, in N, one entry per dof.
    pub force: Vec<f64>,
    /// Time-dependent data at the instant of the state.
    pub moment: InstantData,
    /// Velocities of the support frame that V is measured relative to, in m/s, one entry per
    /// motion.
    pub rates: Vec<f64>,
    /// Energies of the state; the work is that of the constant load, in J.
    pub energies: Energies,
}

impl State {
    /// Builds the initial state from a displacement (m) and its rate (m/s).
    pub fn new<E: Engine>(system: &System<E>, u: Vec<f64>, rate: &[f64]) -> Result<State> {
        let System { engine, mass, bounds, .. } = system;
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.project(mass, rate, &mut v)?;
        let (reaction, force) = (vec![0.0; bounds.len()], vec![0.0; u.len()]);
        let moment = system.moment(0.0)?;
        let rates = system.drive.rates(0.0)?;
        let mut state = State { u, v, reaction, force, moment, rates, energies: Energies::default() };
        state.weigh(system)?;
        Ok(state)
    }

    /// Saves the state to an archive or restores it from there.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.energies)?;
        self.moment.archive(archive)?;
        archive.value(&mut self.rates)?;
        archive.vector(VectorKind::Dofs, &mut self.u)?;
        archive.vector(VectorKind::Dofs, &mut self.force)?;
        archive.vector(VectorKind::Velocities, &mut self.v)?;
        archive.vector(VectorKind::Bounds, &mut self.reaction)
    }

    /// Updates force and energies from U and V.
    pub fn weigh<E: Engine>(&mut self, system: &System<E>) -> Result<()> {
        let elastic = system.force(&self.u, &mut self.force)?;
        let kinetic = 0.5 * system.engine.mass_norm_squared(&system.mass, &self.v)?;
        self.energies = Energies { kinetic, elastic, work: system.work(&self.u)? };
        Ok(())
    }

    /// Measures V relative to the support velocities just after `time` (s). Returns the change of
    /// kinetic energy, which counts as work, in J.
    pub fn ride<E: Engine>(&mut self, system: &System<E>, images: &Images, time: f64) -> Result<f64> {
        if images.is_empty() {
            return Ok(0.0);
        }
        let rates = system.drive.rates(time)?;
        change_frame(images, &self.rates, &rates, &mut self.v);
        self.rates = rates;
        let before = self.energies.kinetic;
        self.energies.kinetic = 0.5 * system.engine.mass_norm_squared(&system.mass, &self.v)?;
        Ok(self.energies.kinetic - before)
    }

    /// Scales V so that the kinetic energy decreases by `energy` (J).
    pub fn shed(&mut self, energy: f64) {
        let kept = 1.0 - energy / self.energies.kinetic;
        self.v.iter_mut().for_each(|v| *v *= kept.sqrt());
        self.energies.kinetic -= energy;
    }
}

/// Velocities V with the momentum of the support shape at 1 m/s, one vector per motion.
pub(super) type Images = [Vec<f64>];

/// Changes the frame of the velocity v from frame velocities `from` to `to` (m/s, one entry per
/// motion).
pub(super) fn change_frame(images: &Images, from: &[f64], to: &[f64], v: &mut [f64]) {
    for (image, (from, to)) in images.iter().zip(from.iter().zip(to)) {
        v.iter_mut().zip(image).for_each(|(v, image)| *v -= (to - from) * image);
    }
}

/// Solver for the implicit half of a step, from a state (U, V) to the midpoint (U + x, V + dV/2).
pub(super) struct HalfStep<'s, E: Engine> {
    system: &'s System<E>,
    sum: [(f64, &'s E::Form); 2],
    solver: CheckedSolver<E>,
    /// Length of the whole step, in s.
    pub dt: f64,
    b: Vec<f64>,
    bounds: Bounds,
    /// Time-dependent data at the end of the step, and the mean of both ends.
    end: InstantData,
    mean: InstantData,
    /// Modal coordinates of V in the damped modes at the start of the last step.
    shares: Option<Vec<f64>>,
    images: Rc<Images>,
    /// Velocities of the support frame during the step (m/s, one entry per motion), V at its start
    /// relative to that frame (m/s), and the work of the change of frame (J).
    chords: Vec<f64>,
    v: Vec<f64>,
    ridden: f64,
    /// Displacement increment x to the midpoint, in m, one entry per dof.
    pub x: Vec<f64>,
    /// Half the change of p, `$C^{-1} B x$`, in m, one entry per velocity dof.
    pub rate: Vec<f64>,
    /// Velocity change dV over the whole step, in m/s, one entry per velocity dof.
    pub dv: Vec<f64>,
    /// Reactions at the midpoint, in N, one entry per bound.
    pub reaction: Vec<f64>,
}

impl<'s, E: Engine> HalfStep<'s, E> {
    /// Returns the step matrix `$4 M / \Delta t^2 + K + 2 D / \Delta t$` (paper, equation 6, with
    /// damping).
    pub fn sum(system: &'s System<E>, dt: f64) -> [(f64, &'s E::Form); 2] {
        let System { mass, stiffness, damping, .. } = system;
        let rate = 2.0 / dt;
        [(4.0 / (dt * dt) + rate * damping.mass, mass), (1.0 + rate * damping.stiffness, stiffness)]
    }

    /// Builds the step from a solver for the matrix [`HalfStep::sum`].
    pub fn new(
        system: &'s System<E>,
        dt: f64,
        solver: Box<dyn Solver<E>>,
        images: Rc<Images>,
    ) -> Result<HalfStep<'s, E>> {
        let System { engine, mass, bounds, drive, .. } = system;
        if let Some(modal) = &drive.modal {
            modal.check(dt)?;
        }
        let sum = Self::sum(system, dt);
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        let moment = InstantData::new(drive, dofs, bounds);
        Ok(HalfStep {
            system,
            sum,
            solver: CheckedSolver::new(solver, engine, &sum)?,
            dt,
            b: vec![0.0; dofs],
            bounds: bounds.clone(),
            end: moment.clone(),
            mean: moment,
            shares: None,
            chords: vec![0.0; images.len()],
            v: vec![0.0; velocities],
            ridden: 0.0,
            images,
            x: vec![0.0; dofs],
            rate: vec![0.0; velocities],
            dv: vec![0.0; velocities],
            reaction: vec![0.0; bounds.len()],
        })
    }

    /// Sets x from the initial velocity (m/s), as if a step had ended at the start.
    pub fn begin(&mut self, velocity: &[f64], start: &InstantData) -> Result<()> {
        self.x.iter_mut().zip(velocity).for_each(|(x, v)| *x = 0.5 * self.dt * v);
        self.end.set(&self.system.drive, self.dt)?;
        self.mean.extrapolate(start, &self.end, -0.5);
        Ok(())
    }

    /// Returns the initial velocity, in m/s, as long as no step was taken.
    pub fn first_velocity(&self) -> Vec<f64> {
        self.x.iter().map(|x| 2.0 / self.dt * x).collect()
    }

    /// Solves
    /// `$(4 M / \Delta t^2 + K + 2 D / \Delta t)\, x = \frac{2}{\Delta t} B^T V + F - K U + G^T r$`
    /// with U + x within the bounds (paper, equation 6, in increments). The state `from` is that at
    /// `time` (s).
    pub fn solve(&mut self, from: &State, time: f64) -> Result<StepReport> {
        let System { engine, mass, drive, .. } = self.system;
        let dt = self.dt;
        if drive.varies() {
            self.end.set(drive, time + dt)?;
            self.mean.combine(&from.moment, &self.end, |from, end| 0.5 * (from + end));
        }
        engine.project_transpose(mass, &from.v, &mut self.b)?;
        let shares = self.shares()?;
        self.ride_evenly(from)?;
        for (b, force) in self.b.iter_mut().zip(&from.force) {
            *b = 2.0 / dt * *b + force;
        }
        self.mean.push(&mut self.b);
        if let (Some(modal), Some(now)) = (&drive.modal, &shares) {
            let before = self.shares.as_ref().unwrap_or(now);
            let middle = now.iter().zip(before).map(|(now, before)| 1.5 * now - 0.5 * before);
            modal.resist(middle, &mut self.b);
            self.shares = shares;
        }
        let limits = self.mean.bounds(&self.system.bounds);
        self.bounds.shift(limits, |dof, bound| bound - from.u[dof]);
        let length = self.system.length(limits, &from.u)?;
        let problem = Problem { matrix: &self.sum, rhs: &self.b, bounds: &self.bounds, length };
        let mut answer = Answer { x: &mut self.x, reaction: &mut self.reaction };
        let verdict = self.solver.solve(engine, &problem, &mut answer)?;
        engine.project(mass, &self.x, &mut self.rate)?;
        for (dv, (rate, v)) in self.dv.iter_mut().zip(self.rate.iter().zip(&self.v)) {
            *dv = 4.0 / dt * rate - 2.0 * v;
        }
        Ok(verdict)
    }

    /// Sets v to the velocity at the start of the step, relative to a frame that moves uniformly to
    /// the support places at its end, and b to the momentum of v.
    fn ride_evenly(&mut self, from: &State) -> Result<()> {
        self.v.copy_from_slice(&from.v);
        if self.images.is_empty() {
            return Ok(());
        }
        let System { engine, mass, .. } = self.system;
        let ends = from.moment.places.iter().zip(&self.end.places);
        self.chords = ends.map(|(from, end)| (end - from) / self.dt).collect();
        change_frame(&self.images, &from.rates, &self.chords, &mut self.v);
        self.ridden = 0.5 * engine.mass_norm_squared(mass, &self.v)? - from.energies.kinetic;
        engine.project_transpose(mass, &self.v, &mut self.b)
    }

    /// Returns the modal coordinates, in the damped modes, of the velocity whose momentum is b.
    fn shares(&self) -> Result<Option<Vec<f64>>> {
        let System { engine, drive, .. } = self.system;
        drive.modal.as_ref().map(|modal| modal.of_momentum(engine, &self.b)).transpose()
    }

    /// Restores the modal coordinates of the state at which the last step started.
    pub fn recall(&mut self, from: &State) -> Result<()> {
        let System { engine, mass, .. } = self.system;
        engine.project_transpose(mass, &from.v, &mut self.b)?;
        self.shares = self.shares()?;
        Ok(())
    }

    /// Returns the velocities of the support frame during the step, in m/s, one entry per motion.
    pub fn chords(&self) -> &[f64] {
        &self.chords
    }

    /// Returns the bounds on U + x, in m.
    pub fn limits(&self) -> &Bounds {
        self.mean.bounds(&self.system.bounds)
    }

    /// Adds the time-dependent part of the midpoint load to `force`, in N.
    pub fn push(&self, force: &mut [f64]) {
        self.mean.push(force);
    }

    /// Sets `to` to the time-dependent data at the fraction gamma of the step from the state at
    /// `time` (s).
    pub fn reach(&self, from: &State, time: f64, gamma: f64, to: &mut InstantData) -> Result<()> {
        if gamma == 1.0 {
            to.copy(&self.end);
            return Ok(());
        }
        let drive = &self.system.drive;
        to.set(drive, time + gamma * self.dt)?;
        // The frame moves uniformly; the next step makes up for the difference to the true support
        // place.
        let way = |(from, chord): (&f64, &f64)| from + gamma * self.dt * chord;
        let places: Vec<f64> = from.moment.places.iter().zip(&self.chords).map(way).collect();
        to.carry(drive, &places);
        Ok(())
    }

    /// Returns the work, in J, of time-dependent data between a state and another one on the line
    /// of this step.
    pub fn given(&self, from: &State, to: &State) -> Result<f64> {
        if !self.system.drive.varies() {
            return Ok(0.0);
        }
        let load = self.mean.load.iter().flatten();
        let ways = to.u.iter().zip(&from.u).map(|(to, from)| to - from);
        let loads: f64 = load.zip(ways).map(|(f, way)| f * way).sum();
        Ok(self.ridden + self.system.total(loads + from.moment.carried(&to.moment, &self.reaction))?)
    }

    /// Returns the power dissipated by mass-proportional damping during the step, in W.
    pub fn loss(&self) -> Result<f64> {
        let System { engine, mass, damping, .. } = self.system;
        if damping.mass == 0.0 {
            return Ok(0.0);
        }
        // The midpoint velocity is V + dV/2 = 2/dt C^-1 B x.
        Ok(damping.mass * (2.0 / self.dt).powi(2) * engine.mass_norm_squared(mass, &self.rate)?)
    }

    /// Sets `to` to the state (U + 2 gamma x, V + gamma dV).
    pub fn extend(&self, from: &State, gamma: f64, to: &mut State) {
        for (to, (u, x)) in to.u.iter_mut().zip(from.u.iter().zip(&self.x)) {
            *to = u + 2.0 * gamma * x;
        }
        for (to, (v, dv)) in to.v.iter_mut().zip(self.v.iter().zip(&self.dv)) {
            *to = v + gamma * dv;
        }
        to.rates.copy_from_slice(&self.chords);
    }

    /// Saves or restores the last solution and the solver.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.mean.archive(archive)?;
        archive.value(&mut self.chords)?;
        archive.vector(VectorKind::Dofs, &mut self.x)?;
        archive.vector(VectorKind::Bounds, &mut self.reaction)?;
        self.solver.archive(&self.system.engine, &self.sum, &self.system.bounds, archive)
    }

    /// Returns the number of numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
