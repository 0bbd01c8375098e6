//! Loads, obstacles and supports that depend on time, as the midpoint rule sees them.
//!
//! Loads and obstacles enter as the mean of their values at the two ends of the step. This differs
//! from their value at the midpoint by `$O(\Delta t^2)$` and makes the energy balance exact while
//! the set of nodes in contact does not change: the energy grows by
//!
//! ```math
//! \tfrac12 (F^n + F^{n+1}) \cdot (U^{n+1} - U^n) + r \cdot (l^{n+1} - l^n) - \Delta t\, V^T D V,
//! \qquad V = 2 x / \Delta t,
//! ```
//!
//! with l the obstacles in contact; the first two terms add up to the work in
//! [`Energies`](crate::energy::Energies).
//!
//! # Moving supports
//!
//! U is measured relative to the shape `$R s(t)$` that the support motion s gives the plate. During
//! a step the reference frame moves at the constant velocity that leads from `$s^n$` to
//! `$s^{n+1}$`, so that no inertial force arises in it. At each instant the frame velocity jumps,
//! and the momentum of V changes by `$-M R$` times that jump. The plate therefore receives the
//! impulse of every kink of s, at its instant to second order, and U + R s does not depend on the
//! inertial frame in which plate and supports are described. Between steps V is measured relative
//! to s' just after the instant. The kinetic energy that V gains where the frame velocity changes
//! counts as work.

use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::scheme::drive::InstantData;
use crate::scheme::state::{State, SupportVelocities, change_frame};
use crate::scheme::{StepBalance, System};
use std::rc::Rc;

/// Time-dependent data of one step, and the frame in which it is taken.
pub(in crate::scheme) struct StepInstants<'s, E: Engine> {
    system: &'s System<E>,
    /// Length of the step, in s.
    dt: f64,
    /// Data at the end of the step, and the mean of both ends.
    end: InstantData,
    mean: InstantData,
    support_velocities: Rc<SupportVelocities>,
    /// Velocities of the support frame during the step, in m/s, one entry per motion.
    pub frame_rates: Vec<f64>,
    /// Work of the change of frame at the start of the step, in J.
    frame_work: f64,
}

impl<'s, E: Engine> StepInstants<'s, E> {
    /// Allocates the data of steps of `dt` seconds.
    pub fn new(
        system: &'s System<E>,
        dt: f64,
        support_velocities: Rc<SupportVelocities>,
    ) -> StepInstants<'s, E> {
        let instant = InstantData::new(&system.drive, system.engine.dofs(), &system.bounds);
        StepInstants {
            system,
            dt,
            end: instant.clone(),
            mean: instant,
            frame_rates: vec![0.0; support_velocities.len()],
            support_velocities,
            frame_work: 0.0,
        }
    }

    /// Sets the data as if a step had ended at the start.
    pub fn begin(&mut self, start: &InstantData) -> Result<()> {
        self.end.set(&self.system.drive, self.dt)?;
        self.mean.extrapolate(start, &self.end, -0.5);
        Ok(())
    }

    /// Evaluates the data of the step from a state at `time` (s), and sets `v` to the velocity of
    /// that state in the frame of the step, which moves uniformly to the support places at its end.
    pub fn enter(&mut self, from: &State, time: f64, v: &mut [f64]) -> Result<()> {
        let System { engine, mass, drive, .. } = self.system;
        if drive.varies() {
            self.end.set(drive, time + self.dt)?;
            self.mean.combine(&from.instant, &self.end, |from, end| 0.5 * (from + end));
        }
        v.copy_from_slice(&from.v);
        if self.support_velocities.is_empty() {
            return Ok(());
        }
        let ends = from.instant.places.iter().zip(&self.end.places);
        self.frame_rates = ends.map(|(from, end)| (end - from) / self.dt).collect();
        change_frame(&self.support_velocities, &from.frame_rates, &self.frame_rates, v);
        self.frame_work = 0.5 * engine.mass_norm_squared(mass, v)? - from.energies.kinetic;
        Ok(())
    }

    /// Returns the bounds on the midpoint, in m.
    pub fn limits(&self) -> &Bounds {
        self.mean.bounds(&self.system.bounds)
    }

    /// Sets the parts of the balance of a step from an instant (s) that depend on time, but for the
    /// support accelerations.
    pub fn balance(&self, time: f64, balance: &mut StepBalance) {
        balance.loads = vec![(time, 0.5), (time + self.dt, 0.5)];
        balance.places.copy_from_slice(&self.mean.places);
        balance.support_rates.copy_from_slice(&self.frame_rates);
    }

    /// Adds the time-dependent part of the midpoint load to `force`, in N.
    pub fn add_load(&self, force: &mut [f64]) {
        self.mean.add_load(force);
    }

    /// Sets `to` to the data at the fraction gamma of the step from the state at `time` (s).
    pub fn reach(&self, from: &State, time: f64, gamma: f64, to: &mut InstantData) -> Result<()> {
        if gamma == 1.0 {
            to.copy(&self.end);
            return Ok(());
        }
        let drive = &self.system.drive;
        to.set(drive, time + gamma * self.dt)?;
        // The frame moves uniformly; the next step makes up for the difference to the true support
        // place.
        let place = |(from, rate): (&f64, &f64)| from + gamma * self.dt * rate;
        let places: Vec<f64> = from.instant.places.iter().zip(&self.frame_rates).map(place).collect();
        to.carry(drive, &places);
        Ok(())
    }

    /// Returns the work, in J, of time-dependent data between two states on the line of this step
    /// with the midpoint reactions (N). Collective.
    pub fn work(&self, from: &State, to: &State, reaction: &[f64]) -> Result<f64> {
        if !self.system.drive.varies() {
            return Ok(0.0);
        }
        let load = self.mean.load.iter().flatten();
        let displacement = to.u.iter().zip(&from.u).map(|(to, from)| to - from);
        let loads: f64 = load.zip(displacement).map(|(f, du)| f * du).sum();
        Ok(self.frame_work + self.system.total(loads + from.instant.boundary_work(&to.instant, reaction))?)
    }

    /// Saves or restores the data of the last step.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.mean.archive(archive)?;
        archive.value(&mut self.frame_rates)
    }
}
