//! Midpoint rule as a [`Scheme`].
//!
//! # Momentum
//!
//! A step changes the momentum by the impulse of the forces at the midpoint,
//!
//! ```math
//! B^T (V^{n+1} - V^n) = \Delta t\,(F - K U^{n+1/2} - D V^{n+1/2} + G^T r) ,
//! ```
//!
//! and the impulse of the obstacles is `$\Delta t\, r$`. The reactions reported at an instant are
//! the mean over the step that led there. At the start they are those at `$U^0$` with
//! [`Massless::Equilibrium`], and zero otherwise. The reported velocity is that of the instant:
//! with the singular mass it is the rate of U(p) where p moves at `$V^n$` and the nodes in contact
//! follow their obstacles.

use super::MidpointRule;
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::scheme::quadratisation::Quadratisation;
use crate::scheme::sliding::Sliding;
use crate::scheme::state::{State, SupportVelocities};
use crate::scheme::{
    Approach, Friction, NodalFriction, Potential, Scheme, Solution, Start, Statistics, StepBalance,
    StepRecord, System,
};
use crate::vi::{Condensed, Solver};
use std::rc::Rc;

/// Choice of the massless part of U that the midpoint scheme reports.
///
/// Both choices give the same motion of p. They differ once there has been contact, which shows in
/// the energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Massless {
    /// Corrects the paper's `$U^{n+1}$` to `$U(p^{n+1})$`, which is in equilibrium and admissible.
    /// This corrector is not in the paper. At steps that resolve
    /// impacts the energy error is about ten times smaller than with the paper's choice: on the
    /// paper's quadrilaterals, over four impacts, 1e-2 instead of 8e-2 at 5e-5 s and 5e-4 instead
    /// of 1e-2 at 1e-5 s.
    Equilibrium,
    /// Takes `$U^{n+1} = 2 U^{n+1/2} - U^n$`, which is the paper's scheme (equation 6). Once
    /// disturbed by contact, the massless part changes sign at each step, undamped. This is the
    /// only choice with the consistent mass, which has no massless part.
    Reflected,
}

/// Midpoint scheme at instant n, with state `$U^n$`, `$V^n$`.
pub struct Midpoint<'s, E: Engine> {
    system: &'s System<E>,
    rule: MidpointRule<'s, E>,
    /// Corrector of [`Massless::Equilibrium`].
    potential: Option<Potential<'s, E>>,
    /// Solver that recovers velocities for [`Massless::Reflected`] with the singular mass, built on
    /// first use.
    recovery: Option<Potential<'s, E>>,
    now: State,
    next: State,
    support_velocities: Rc<SupportVelocities>,
    /// Work of the time-dependent loads, obstacles and supports, in J.
    work: f64,
    /// Midpoint deflections `$G U^{n-1/2}$`, `$G U^{n-3/2}$` and `$G U^{n-5/2}$`, in m, one entry
    /// per bound.
    midpoints: [Vec<f64>; 3],
    record: StepRecord,
    /// Balance of the last step, if it is kept.
    balance: Option<StepBalance>,
}

impl<'s, E: Engine + 'static> Midpoint<'s, E> {
    /// Starts the scheme with the condensed solver and a step of `dt` seconds.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the step matrix is not positive definite, and
    /// [`crate::Error::Usage`] for [`Massless::Equilibrium`] with stiffness-proportional damping.
    pub fn new(system: &'s System<E>, dt: f64, massless: Massless, start: Start) -> Result<Midpoint<'s, E>> {
        let solver = Condensed::new(&system.engine, &Self::matrix(system, dt), system.bounds.len())?;
        Midpoint::with_solver(system, dt, massless, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Midpoint<'s, E> {
    /// Returns the step matrix `$4 M / \Delta t^2 + K + 2 D / \Delta t$` (paper, equation 6, with
    /// damping).
    pub fn matrix(system: &'s System<E>, dt: f64) -> LinearCombination<'s> {
        MidpointRule::matrix(system, dt)
    }

    /// Starts the scheme with a given solver for the matrix [`Midpoint::matrix`].
    ///
    /// # Errors
    /// Returns the same errors as [`Midpoint::new`].
    pub fn with_solver(
        system: &'s System<E>,
        dt: f64,
        massless: Massless,
        start: Start,
        solver: Box<dyn Solver<E>>,
    ) -> Result<Midpoint<'s, E>> {
        // The deflections before the start are extrapolated with the initial velocity.
        let midpoints = [0.5, 1.5, 2.5].map(|steps| {
            let place = |&dof: &usize| start.displacement[dof] - steps * dt * start.velocity[dof];
            system.bounds.dofs.iter().map(place).collect()
        });
        let mut record = StepRecord::new(dt, system.bounds.len());
        let mut now = State::new(system, start.displacement, &start.velocity)?;
        let support_velocities = Potential::support_velocities(system)?;
        let potential = match massless {
            Massless::Reflected => None,
            Massless::Equilibrium => {
                let mut potential = Potential::new(system)?;
                record.report = potential.settle_state(&mut now)?;
                Some(potential)
            }
        };
        system.bounds.restrict(&now.u, &mut record.admissible);
        record.reaction.copy_from_slice(&now.reaction);
        let mut rule = MidpointRule::new(system, dt, solver, support_velocities.clone())?;
        rule.driver.begin_sliding(&now.u, 2.0);
        rule.begin(&start.velocity, &now)?;
        rule.follow_deflection(&start.velocity, &now)?;
        if let Some(stretching) = &rule.stretching {
            now.stretching = stretching.stored;
            now.update_energies(system)?;
        }
        Ok(Midpoint {
            system,
            rule,
            potential,
            recovery: None,
            next: now.clone(),
            now,
            support_velocities,
            work: 0.0,
            midpoints,
            record,
            balance: None,
        })
    }
}

impl<E: Engine> Solution for Midpoint<'_, E> {
    /// Returns the record of the last step. Its reactions are the mean over that step; at the start
    /// they are those at `$U^0$`, or zero with [`Massless::Reflected`].
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        &self.now.u
    }

    fn limits(&self) -> &Bounds {
        self.rule.instants.limits()
    }

    /// Returns the velocity at the present instant, in m/s. With the consistent mass this is
    /// `$V^n$`. With the singular mass `$V^n$` has values per cell only; the result is then the
    /// rate of U(p) with these cell values that follows the obstacles at the nodes in contact
    /// during the last step. At the start it is `$v_0$`.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let Midpoint { system, rule, potential, recovery, now, record, .. } = self;
        if record.step == 0 {
            return Ok(rule.mean_rate());
        }
        if !system.mass.is_singular() {
            return Ok(now.v.clone());
        }
        let rates = system.data_rates(record.time(), rule.dt, &now.frame_rates)?;
        let stuck = rule.driver.stuck_slopes(rule.dt);
        match potential {
            Some(potential) => potential.rate(&now.v, &now.reaction, &rates, &stuck),
            None => {
                let recovery = match recovery {
                    Some(recovery) => recovery,
                    none => none.insert(Potential::factor(system)?),
                };
                recovery.rate(&now.v, &record.reaction, &rates, &stuck)
            }
        }
    }

    /// Returns the support velocities just after the instant, in m/s, one entry per motion.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.now.frame_rates.clone())
    }

    fn energies(&self) -> Result<Energies> {
        let energies = self.now.energies;
        let stored = self.rule.driver.sliding.as_ref().map(Sliding::stored);
        let stored = stored.map_or(Ok(0.0), |stored| self.system.total(stored))?;
        let followed = self.rule.followed.as_ref().map_or(0.0, |followed| followed.work);
        let [by_friction, _] = self.rule.driver.friction_work();
        Ok(Energies {
            work: energies.work + self.work + followed + by_friction,
            elastic: energies.elastic + stored,
            ..energies
        })
    }

    fn friction_at_nodes(&self) -> Vec<NodalFriction> {
        self.rule.driver.friction_at_nodes()
    }

    fn approach(&self, bound: usize) -> Approach {
        // The present step was solved for the middle of the last interval.
        let dt = self.rule.dt;
        let [_, last, before] = &self.midpoints;
        let time = (self.record.step as f64 - 1.5) * dt;
        Approach { time, deflection: last[bound], velocity: (last[bound] - before[bound]) / dt }
    }
}

impl<E: Engine> Scheme for Midpoint<'_, E> {
    fn advance(&mut self) -> Result<()> {
        let Midpoint { rule, now, next, record, .. } = self;
        let time = record.time();
        record.begin_step();
        record.report = rule.solve(now, time)?;
        match &mut self.potential {
            None => {
                rule.update(now, 1.0, next);
                rule.instants.reach(now, time, 1.0, &mut next.instant)?;
                if let Some(stretching) = &mut rule.stretching {
                    next.stretching = stretching.energy(&next.u)?;
                    stretching.compare(stretching.root, next.stretching);
                }
                next.update_energies(self.system)?;
            }
            Some(potential) => {
                let mut line = potential.line(now, rule, time)?;
                line.at(1.0, next)?;
                record.report = record.report.and(line.report);
            }
        }
        record.reaction.copy_from_slice(&rule.driver.reaction);
        rule.restrict_midpoint(now, &mut record.admissible);
        record.add_impulses(rule.dt);
        self.midpoints.rotate_right(1);
        self.midpoints[0].copy_from_slice(&record.admissible);
        self.work += rule.work(now, next)?;
        rule.driver.add_friction(1.0, [&now.u, &next.u]);
        rule.driver.add_dashpots(rule.dt, [&now.u, &next.u]);
        std::mem::swap(now, next);
        self.work += now.follow_supports(self.system, &self.support_velocities, record.time())?;
        if let Some(balance) = &mut self.balance {
            // The state before the step is in `next` now.
            *balance = rule.balance(&next.u, time)?;
            balance.change_frame(rule.dt, [&next.frame_rates, &now.frame_rates], &self.support_velocities);
        }
        Ok(())
    }

    fn friction(&self) -> Vec<Friction> {
        self.rule.driver.sliding.as_ref().map_or(Vec::new(), |sliding| sliding.friction(0))
    }

    fn dissipated_by_obstacles(&self) -> Vec<f64> {
        self.rule.driver.heat()
    }

    /// Keeps the balance at the start: that of [`Massless::Equilibrium`] at `$U^0$`, or of the
    /// plate at rest there.
    fn keep_balance(&mut self) -> Result<()> {
        let balance = self.balance.insert(StepBalance::at_start(self.system, &self.now)?);
        if let Some(potential) = &self.potential {
            potential.set_acceleration(balance);
        }
        Ok(())
    }

    /// Returns the balance at the middle of the step.
    fn balance(&mut self) -> Result<StepBalance> {
        Ok(self.balance.clone().unwrap_or_default())
    }

    fn has_mean_reactions(&self) -> bool {
        true
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        self.balance.as_mut().map_or(Ok(()), |balance| balance.archive(archive))?;
        archive.value(&mut self.work)?;
        self.now.archive(archive)?;
        for vector in &mut self.midpoints {
            archive.vector(VectorKind::Bounds, vector)?;
        }
        self.rule.archive(archive)?;
        self.potential.as_mut().map_or(Ok(()), |potential| potential.archive(archive))
    }

    fn statistics(&self) -> Statistics {
        let of_corrector = self.potential.as_ref().map_or(0, Potential::factorisations);
        let factorisations = self.rule.driver.factorisations() + of_corrector;
        let stretching_gap = self.rule.stretching.as_ref().map(Quadratisation::gap);
        Statistics { factorisations, stretching_gap, ..Statistics::default() }
    }
}
