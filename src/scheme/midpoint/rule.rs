//! Midpoint rule besides its formulas: construction, start, work and checkpoint.

use super::MidpointRule;
use super::instants::StepInstants;
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{copy_scaled, waxpby, waxpy};
use crate::scheme::following_load::FollowedLoad;
use crate::scheme::quadratisation::Quadratisation;
use crate::scheme::state::{State, SupportVelocities};
use crate::scheme::step_driver::StepDriver;
use crate::scheme::{StepBalance, System};
use crate::vi::Solver;
use std::rc::Rc;

impl<'s, E: Engine> MidpointRule<'s, E> {
    /// Prepares steps of `dt` seconds with a solver for the matrix [`MidpointRule::matrix`].
    pub fn new(
        system: &'s System<E>,
        dt: f64,
        solver: Box<dyn Solver<E>>,
        support_velocities: Rc<SupportVelocities>,
    ) -> Result<MidpointRule<'s, E>> {
        let velocities = || vec![0.0; system.engine.velocities(&system.mass)];
        let mut driver = StepDriver::new(system, Self::matrix(system, dt), dt, solver)?;
        driver.begin_friction(0.5)?;
        Ok(MidpointRule {
            driver,
            instants: StepInstants::new(system, dt, support_velocities),
            dt,
            stretching: None,
            followed: None,
            midpoints: Default::default(),
            ahead: Vec::new(),
            v: velocities(),
            half_dp: velocities(),
            dv: velocities(),
        })
    }

    /// Returns the power dissipated by mass-proportional damping during the step, in W.
    pub fn dissipated_power(&self) -> Result<f64> {
        let System { engine, mass, damping, .. } = self.driver.system;
        if damping.mass == 0.0 {
            return Ok(0.0);
        }
        // The midpoint velocity is V + dV/2 = 2/dt C^-1 B x.
        Ok(damping.mass * (2.0 / self.dt).powi(2) * engine.mass_norm_squared(mass, &self.half_dp)?)
    }

    /// Returns the work of time-dependent data between two states on the line of the step, in J.
    /// Collective.
    pub fn work(&self, from: &State, to: &State) -> Result<f64> {
        self.instants.work(from, to, &self.driver.reaction)
    }

    /// Sets x from the initial velocity (m/s), as if a step had ended at the start.
    pub fn begin(&mut self, velocity: &[f64], start: &State) -> Result<()> {
        copy_scaled(0.5 * self.dt, velocity, &mut self.driver.x);
        self.instants.begin(&start.instant)
    }

    /// Takes up the forces of stretching and of a load that depends on the deflection, which moved
    /// with the initial velocity (m/s) before the start.
    pub fn follow_deflection(&mut self, velocity: &[f64], start: &State) -> Result<()> {
        self.stretching = Quadratisation::new(self.driver.system, &start.u)?;
        self.followed = FollowedLoad::new(self.driver.system, &start.u)?;
        if self.stretching.is_some() || self.followed.is_some() {
            let before =
                |steps: f64| start.u.iter().zip(velocity).map(|(u, v)| u - steps * self.dt * v).collect();
            self.midpoints = [0.5, 1.5].map(before);
            self.ahead.clone_from(&start.u);
        }
        Ok(())
    }

    /// Returns the mean rate `$2 x / \Delta t$` of U in the last step, in m/s: the initial velocity
    /// as long as no step was taken.
    pub fn mean_rate(&self) -> Vec<f64> {
        self.driver.x.iter().map(|x| 2.0 / self.dt * x).collect()
    }

    /// Returns the balance of the last step, from a displacement (m) at an instant (s) on: that of
    /// the midpoint, without the change of the support frame.
    pub fn balance(&self, from: &[f64], time: f64) -> Result<StepBalance> {
        let system @ System { damping, drive, .. } = self.driver.system;
        let mut balance = StepBalance::zero(system);
        let of_x = 1.0 + 2.0 * damping.stiffness / self.dt;
        waxpy(of_x, &self.driver.x, from, &mut balance.displacement);
        if !self.ahead.is_empty() {
            let middle = time + 0.5 * self.dt;
            self.stretching
                .iter()
                .for_each(|stretching| stretching.add_to(&mut balance, middle, &self.ahead));
            balance.follow(system, [0.0, 1.0], middle, &self.ahead);
        }
        if !balance.rates.is_empty() {
            balance.rates = self.mean_rate();
        }
        waxpby(
            1.0 / self.dt,
            &self.dv,
            2.0 * damping.mass / self.dt,
            &self.half_dp,
            &mut balance.acceleration,
        );
        if let (Some(modal), Some(damped)) = (&drive.modal, &self.driver.damped) {
            balance.add_modal_damping(system, modal, damped)?;
        }
        self.driver.balance_friction(&mut balance);
        self.instants.balance(time, &mut balance);
        Ok(balance)
    }

    /// Saves or restores the last solution and the solver.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.instants.archive(archive)?;
        self.stretching.as_mut().map_or(Ok(()), |stretching| stretching.archive(archive))?;
        self.followed.as_mut().map_or(Ok(()), |followed| followed.archive(archive))?;
        if !self.ahead.is_empty() {
            for midpoint in &mut self.midpoints {
                archive.vector(VectorKind::Dofs, midpoint)?;
            }
        }
        archive.vector(VectorKind::Dofs, &mut self.driver.x)?;
        archive.vector(VectorKind::Bounds, &mut self.driver.reaction)?;
        self.driver.archive(archive)
    }
}
