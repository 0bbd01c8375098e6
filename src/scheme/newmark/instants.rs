//! Loads, obstacles and supports that depend on time, as the Newmark scheme sees them.
//!
//! The load F of a step is the beta-average of its values at the three instants n - 1, n and n + 1,
//! and the bounds l, u are averaged with the weights of `$U^{n+1,e}$`:
//!
//! ```math
//! \frac{l^{n+1} + e\, l^{n-1}}{1 + e} \le G U^{n+1,e} \le \frac{u^{n+1} + e\, u^{n-1}}{1 + e} .
//! ```
//!
//! The motion relative to an obstacle therefore obeys the same law of restitution at any speed of
//! the obstacle, and a plate carried along with its obstacle at constant speed moves as it does at
//! rest. Loads and obstacles are extrapolated linearly to the instant before the start.
//!
//! # Work
//!
//! Time-dependent loads and obstacles do the work `$W_n$`, with r the reactions and l the obstacle
//! (lower or upper) in contact:
//!
//! ```math
//! w_n = \tfrac12 F_\beta^n \cdot (U^{n+1} - U^{n-1}) + \tfrac12 r^n \cdot (l^{n+1} - l^{n-1}),
//!    \qquad W_n = W_{n-1} + \tfrac12 (w_{n-1} + w_n) .
//! ```
//!
//! This work closes the balance of the beta = 1/2 invariant to rounding: H grows by `$w_n$`, less
//! `$\Delta t\, V^T D V$` with V the central velocity, less the energy lost in contact.
//!
//! # Moving supports
//!
//! U is measured relative to the shape `$R s(t)$` that the support motion s gives the plate. The
//! scheme for U + R s equals the scheme for U with the additional load
//! `$-M R\,(s^{n+1} - 2 s^n + s^{n-1}) / \Delta t^2$` at instant n, for any s: this is the mean
//! acceleration weighted with a hat function of width 2 dt, which includes jumps of the velocity.
//! The ghost value at the start is `$s^{-1} = s^1 - 2 \Delta t\, s'(0)$`, analogous to `$U^{-1}$`.

use super::{NewmarkParameters, levels};
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::scheme::System;
use crate::scheme::drive::InstantData;

/// Time-dependent data at the instants n - 1, n and n + 1, and the work done.
pub(super) struct CentralInstants {
    parameters: NewmarkParameters,
    prev: InstantData,
    now: InstantData,
    next: InstantData,
    /// Bounds on `$U^{n+1,e}$`, in m; `None` where obstacles do not move.
    limits: Option<Bounds>,
    /// Accumulated work `$W_n$`, in J.
    pub work: f64,
    /// Increment `$w_n$`, in J.
    pub increment: f64,
}

impl CentralInstants {
    /// Evaluates the data at the start. Returns `None` where nothing depends on time.
    pub fn new<E: Engine>(
        system: &System<E>,
        parameters: NewmarkParameters,
    ) -> Result<Option<CentralInstants>> {
        if !system.drive.varies() {
            return Ok(None);
        }
        let now = system.instant(0.0)?;
        let next = system.instant(parameters.step)?;
        let mut prev = now.clone();
        prev.extrapolate(&now, &next, -1.0);
        // The ghost place s^{-1} is s^1 less two steps at the initial velocity.
        let travelled = system.drive.rates(0.0)?.into_iter().map(|rate| 2.0 * parameters.step * rate);
        let places: Vec<f64> = next.places.iter().zip(travelled).map(|(next, path)| next - path).collect();
        prev.carry(&system.drive, &places);
        let limits = now.bounds.clone();
        let mut instants = CentralInstants { parameters, prev, now, next, limits, work: 0.0, increment: 0.0 };
        instants.average_bounds();
        Ok(Some(instants))
    }

    /// Saves all data to an archive or restores them from it.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.work)?;
        archive.value(&mut self.increment)?;
        for instant in [&mut self.prev, &mut self.now, &mut self.next] {
            instant.archive(archive)?;
        }
        let Some(Bounds { lower, upper, .. }) = &mut self.limits else { return Ok(()) };
        archive.vector(VectorKind::Bounds, lower)?;
        archive.vector(VectorKind::Bounds, upper)
    }

    /// Moves one step ahead; `next` is the time of the new instant n + 1, in s.
    pub fn advance<E: Engine>(&mut self, system: &System<E>, next: f64) -> Result<()> {
        std::mem::swap(&mut self.prev, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.next);
        self.next.set(&system.drive, next)?;
        self.average_bounds();
        Ok(())
    }

    /// Sets the bounds on `$U^{n+1,e}$`. Where one of the two instants has no obstacle, the bound
    /// of n + 1 is used alone.
    fn average_bounds(&mut self) {
        let e = self.parameters.restitution;
        let average_of = |prev: f64, next: f64| {
            let average = (next + e * prev) / (1.0 + e);
            if prev.is_finite() && next.is_finite() { average } else { next }
        };
        if let (Some(limits), Some(prev), Some(next)) =
            (&mut self.limits, &self.prev.bounds, &self.next.bounds)
        {
            for i in 0..limits.len() {
                limits.lower[i] = average_of(prev.lower[i], next.lower[i]);
                limits.upper[i] = average_of(prev.upper[i], next.upper[i]);
            }
        }
    }

    /// Returns the bounds on `$U^{n+1,e}$`, in m; `None` where obstacles do not move.
    pub fn limits(&self) -> Option<&Bounds> {
        self.limits.as_ref()
    }

    /// Adds the beta-averaged load and subtracts the inertia of the support motions, in N.
    pub fn add_forces<E: Engine>(&self, system: &System<E>, b: &mut [f64]) {
        b.iter_mut().zip(self.load()).for_each(|(b, f)| *b += f);
        system.drive.subtract_inertia(&self.accelerations(), b);
    }

    /// Returns the beta-averaged load, in N, one entry per dof; empty where no load depends on
    /// time.
    fn load(&self) -> impl Iterator<Item = f64> {
        let loads = [&self.prev, &self.now, &self.next].map(|instant| instant.load.as_deref().unwrap_or(&[]));
        levels(loads).map(|values| self.parameters.average(values))
    }

    /// Returns the support places at the three instants, in m, one entry per motion.
    fn places(&self) -> impl Iterator<Item = [f64; 3]> {
        levels([&self.prev, &self.now, &self.next].map(|instant| &*instant.places))
    }

    /// Returns the beta-averages of the support places, in m, one entry per motion.
    pub fn mean_places(&self) -> Vec<f64> {
        self.places().map(|places| self.parameters.average(places)).collect()
    }

    /// Returns second differences of the support places over dt^2, in m/s^2, one entry per motion.
    pub fn accelerations(&self) -> Vec<f64> {
        self.places().map(|places| self.parameters.acceleration(places)).collect()
    }

    /// Returns central differences of the support places, in m/s, one entry per motion.
    pub fn support_rates(&self) -> Vec<f64> {
        let ends = self.prev.places.iter().zip(&self.next.places);
        ends.map(|(prev, next)| (next - prev) / (2.0 * self.parameters.step)).collect()
    }

    /// Adds the work up to instant n, for the displacement `$U^{n+1} - U^{n-1}$` (m) and the
    /// reactions (N). Collective.
    pub fn account<E: Engine>(
        &mut self,
        n: u64,
        system: &System<E>,
        displacement: impl Iterator<Item = f64> + Clone,
        reaction: &[f64],
    ) -> Result<()> {
        let by = |force: &mut dyn Iterator<Item = f64>| -> f64 {
            force.zip(displacement.clone()).map(|(f, du)| f * du).sum()
        };
        let mut sum = by(&mut self.load());
        for (motion, a) in system.drive.supports.iter().zip(self.accelerations()) {
            sum -= a * by(&mut motion.momentum.iter().copied());
        }
        sum += self.prev.boundary_work(&self.next, reaction);
        let increment = 0.5 * system.total(sum)?;
        if n > 0 {
            self.work += 0.5 * (self.increment + increment);
        }
        self.increment = increment;
        Ok(())
    }
}
