//! Newmark scheme as a [`Scheme`]: start, steps, and the quantities that it reports.

use super::instants::CentralInstants;
use super::start::FirstStep;
use super::stiffness_force::StiffnessForce;
use super::{Levels, Newmark, NewmarkParameters};
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::scheme::following_load::FollowedLoad;
use crate::scheme::quadratisation::Quadratisation;
use crate::scheme::step_driver::{Formulas, StepDriver};
use crate::scheme::{
    Approach, Friction, NodalFriction, Scheme, Solution, Start, Statistics, StepBalance, StepRecord, System,
};
use crate::vi::{Condensed, Solver};
use std::cell::RefCell;

impl<'s, E: Engine + 'static> Newmark<'s, E> {
    /// Starts the scheme with the condensed solver.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the step matrix is not positive definite.
    pub fn new(system: &'s System<E>, parameters: NewmarkParameters, start: Start) -> Result<Newmark<'s, E>> {
        let matrix = Self::matrix(system, parameters);
        let solver = Condensed::new(&system.engine, &matrix, system.bounds.len())?;
        Newmark::with_solver(system, parameters, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Newmark<'s, E> {
    /// Starts the scheme with a given solver for the matrix [`Newmark::matrix`].
    ///
    /// # Errors
    /// Returns the errors of the solver.
    pub fn with_solver(
        system: &'s System<E>,
        parameters: NewmarkParameters,
        start: Start,
        solver: Box<dyn Solver<E>>,
    ) -> Result<Newmark<'s, E>> {
        let dofs = system.engine.dofs();
        let matrix = Self::matrix(system, parameters);
        let mut driver = StepDriver::new(system, matrix, parameters.step, solver)?;
        let mut record = StepRecord::new(parameters.step, system.bounds.len());
        let mut levels = Levels {
            system,
            parameters,
            stretching: Quadratisation::new(system, &start.displacement)?,
            followed: FollowedLoad::new(system, &start.displacement)?,
            u_n: start.displacement,
            d_n: vec![0.0; dofs],
            force: StiffnessForce::new(dofs),
            stored: [0.0; 2],
            v0: system.bounds.dofs.iter().map(|&dof| start.velocity[dof]).collect(),
            instants: CentralInstants::new(system, parameters)?,
            product: if system.is_damped() { vec![0.0; dofs] } else { Vec::new() },
        };
        levels.force.renew(system, &levels.u_n)?;
        let stored = levels.limits().stored_energy(|bound| levels.u_n[system.bounds.dofs[bound]]);
        let at_start = if system.bounds.laws.are_rigid() { 0.0 } else { system.total(stored)? };
        driver.begin_sliding(&levels.u_n, 1.0);
        driver.begin_friction(1.0)?;
        driver.set_obstacle_paths([0.0, parameters.step])?;
        driver.feed_residuals_forward(levels.energy_at_start(&start.velocity)?);
        let mut first = FirstStep { levels: &mut levels, v0: &start.velocity };
        driver.solve(&mut first)?;
        driver.report_to(&first, &mut record);
        record.reaction.copy_from_slice(&driver.reaction);
        first.levels.stretch(&driver.x, [0.5, 0.0])?;
        // Half a trapezoidal step has the force of its end.
        first.levels.stretching.iter_mut().for_each(|stretching| stretching.applied = stretching.root);
        first.update(&mut driver);
        driver.restart_modal_damping(&levels)?;
        levels.store(&record.admissible, driver.sliding.as_ref())?;
        levels.stored[0] = at_start;
        levels.account(0, &driver.x, &driver.reaction)?;
        levels.add_heat(0, &mut driver);
        let velocities = vec![0.0; system.engine.velocities(&system.mass)];
        let work = RefCell::new([vec![0.0; dofs], velocities]);
        Ok(Newmark { driver, levels, record, work })
    }

    /// Returns the increments `$U^n - U^{n-1}$` and `$U^{n+1} - U^n$`, in m.
    fn increments(&self) -> impl Iterator<Item = [f64; 2]> {
        self.levels.d_n.iter().zip(&self.driver.x).map(|(d, x)| [*d, d + x])
    }

    /// Returns the central velocity `$(U^{n+1} - U^{n-1}) / 2 \Delta t$`, in m/s.
    pub(super) fn central_velocity(&self) -> impl Iterator<Item = f64> {
        let twice = 2.0 * self.levels.parameters.step;
        self.increments().map(move |[d, e]| (d + e) / twice)
    }

    /// Returns the discrete invariant of beta = 1/2 between n and n + 1, in J:
    ///
    /// ```math
    /// H = \frac12 \Bigl|\frac{U^{n+1} - U^n}{\Delta t}\Bigr|_M^2 + \frac14 \bigl(|U^{n+1}|_K^2 +
    /// |U^n|_K^2\bigr) - \frac12 F \cdot (U^{n+1} + U^n) - W_n - \frac12 w_n ,
    /// ```
    ///
    /// with the constant load F and the work `$W_n$`, `$w_n$` of time-dependent data, and the mean
    /// of the energies stored in bounds that yield. H is constant in free flight without damping;
    /// for e = 0 it never rises.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn invariant(&self) -> Result<f64> {
        let Levels { system, parameters, u_n, force, stretching, followed, instants, .. } = &self.levels;
        let System { engine, stiffness, mass, .. } = system;
        let rate: Vec<f64> = self.increments().map(|[_, e]| e / parameters.step).collect();
        let next: Vec<f64> = u_n.iter().zip(self.increments()).map(|(u, [_, e])| u + e).collect();
        let mut product = vec![0.0; next.len()];
        let kinetic = engine.multiply(mass, &rate, &mut product)?;
        let elastic = engine.multiply(stiffness, &next, &mut product)?
            + 2.0 * force.elastic_energy(system, u_n, &mut product)?
            + 2.0 * stretching.as_ref().map_or(0.0, |stretching| stretching.root.powi(2));
        let work = system.work(u_n)? + system.work(&next)?;
        let [by_friction, next_by_friction] = self.driver.friction_work();
        let by_time = instants.as_ref().map_or(0.0, |instants| instants.work + 0.5 * instants.increment)
            + followed.as_ref().map_or(0.0, |followed| followed.work + 0.5 * followed.increment)
            + by_friction
            + 0.5 * next_by_friction;
        let stored = 0.5 * (parameters.stored_now(self.levels.stored) + self.levels.stored[1]);
        Ok(0.5 * kinetic + 0.25 * elastic + stored - 0.5 * work - by_time)
    }
}

impl<E: Engine> Solution for Newmark<'_, E> {
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        &self.levels.u_n
    }

    fn limits(&self) -> &Bounds {
        self.levels.limits()
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity().collect())
    }

    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.levels.instants.as_ref().map_or(Vec::new(), CentralInstants::support_rates))
    }

    /// Returns the energies of the paper's `$E_n$` (section 5.2), with the central velocity and the
    /// true energy of stretching.
    fn energies(&self) -> Result<Energies> {
        let Levels { system, parameters, u_n, force, stretching, followed, stored, instants, .. } =
            &self.levels;
        let [rate, v] = &mut *self.work.borrow_mut();
        let elastic = force.elastic_energy(system, u_n, rate)?;
        rate.iter_mut().zip(self.central_velocity()).for_each(|(rate, now)| *rate = now);
        let kinetic = system.kinetic_energy(rate, v)?;
        let by_time = instants.as_ref().map_or(0.0, |instants| instants.work)
            + followed.as_ref().map_or(0.0, |followed| followed.work)
            + self.driver.friction_work()[0];
        let work = system.work(u_n)? + by_time;
        let stretched = stretching.as_ref().map_or(0.0, |stretching| stretching.stored);
        Ok(Energies { kinetic, elastic: elastic + stretched + parameters.stored_now(*stored), work })
    }

    fn invariant(&self) -> Result<f64> {
        Newmark::invariant(self)
    }

    fn friction_at_nodes(&self) -> Vec<NodalFriction> {
        self.driver.friction_at_nodes()
    }

    fn approach(&self, bound: usize) -> Approach {
        let Levels { system, u_n, d_n, v0, .. } = &self.levels;
        let dof = system.bounds.dofs[bound];
        // U^{-1} is a ghost value, not a displacement that occurred.
        let velocity = if self.record.step == 0 { v0[bound] } else { d_n[dof] / self.record.dt };
        Approach { time: self.record.time(), deflection: u_n[dof], velocity }
    }
}

impl<E: Engine> Scheme for Newmark<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.record.step += 1;
        self.levels.shift(&self.driver.x, (self.record.step + 1) as f64 * self.record.dt)?;
        self.levels.force.elastic.into_iter().for_each(|energy| self.driver.note_energy(energy));
        let dt = self.record.dt;
        self.driver.set_obstacle_paths([0, 1].map(|step| (self.record.step + step) as f64 * dt))?;
        self.driver.solve(&mut self.levels)?;
        self.driver.report_to(&self.levels, &mut self.record);
        self.record.end_step(&self.driver.reaction);
        self.levels.force.add(self.driver.stiffness_product());
        self.levels.stretch(&self.driver.x, [1.0, 2.0])?;
        self.levels.store(&self.record.admissible, self.driver.sliding.as_ref())?;
        self.levels.account(self.record.step, &self.driver.x, &self.driver.reaction)?;
        self.levels.add_heat(self.record.step, &mut self.driver);
        Ok(())
    }

    /// Returns the forces of the step from the instant, and the energies dissipated up to it.
    fn friction(&self) -> Vec<Friction> {
        self.driver.sliding.as_ref().map_or(Vec::new(), |sliding| sliding.friction(1))
    }

    fn dissipated_by_obstacles(&self) -> Vec<f64> {
        self.driver.heat()
    }

    /// Returns the balance of the equation of the step from `$U^n$`, which is that of the instant
    /// n.
    fn balance(&mut self) -> Result<StepBalance> {
        let Levels { system, parameters, u_n, stretching, instants, .. } = &self.levels;
        let NewmarkParameters { beta, step: dt, .. } = *parameters;
        let System { engine, mass, damping, drive, .. } = system;
        let is_start = self.record.step == 0;
        let mut balance = StepBalance::zero(system);
        let mut inertia = vec![0.0; u_n.len()];
        for (i, [d, e]) in self.increments().enumerate() {
            // The unknown and the damped rate of the first step are those of `start`.
            let (x, rate) = if is_start { (2.0 * e, e / dt) } else { (e - d, (d + e) / (2.0 * dt)) };
            balance.displacement[i] = u_n[i] + (beta * x + damping.stiffness * rate);
            inertia[i] = (e - d) / (dt * dt) + damping.mass * rate;
            balance.rates.get_mut(i).into_iter().for_each(|damped| *damped = rate);
        }
        let time = self.record.time();
        stretching.iter().for_each(|stretching| stretching.add_to(&mut balance, time, u_n));
        balance.follow(system, [0.0, 1.0], time, u_n);
        engine.project(mass, &inertia, &mut balance.acceleration)?;
        self.driver.balance_friction(&mut balance);
        if let (Some(modal), Some(damped)) = (&drive.modal, &self.driver.damped) {
            balance.add_modal_damping(system, modal, damped)?;
        }
        if let Some(instants) = instants {
            balance.loads = parameters.times(self.record.step);
            balance.places = instants.mean_places();
            balance.support_rates = instants.support_rates();
            balance.support_accelerations = instants.accelerations();
        }
        Ok(balance)
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        let Levels { system, u_n, d_n, force, stretching, followed, stored, instants, .. } = &mut self.levels;
        if !system.bounds.laws.are_rigid() {
            archive.value(stored)?;
        }
        for vector in [u_n, d_n, &mut self.driver.x] {
            archive.vector(VectorKind::Dofs, vector)?;
        }
        force.archive(archive)?;
        stretching.as_mut().map_or(Ok(()), |stretching| stretching.archive(archive))?;
        followed.as_mut().map_or(Ok(()), |followed| followed.archive(archive))?;
        instants.as_mut().map_or(Ok(()), |instants| instants.archive(archive))?;
        self.driver.archive(archive)
    }

    fn statistics(&self) -> Statistics {
        Statistics {
            factorisations: self.driver.factorisations(),
            stretching_gap: self.levels.stretching.as_ref().map(Quadratisation::gap),
            ..Statistics::default()
        }
    }
}
