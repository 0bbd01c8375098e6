//! Midpoint scheme (paper, section 4.2, equation 6).
//!
//! The scheme finds `$U^{n+1/2}$` in `$K^h$`. The unknown solved for is the increment
//! `$x = U^{n+1/2} - U^n$`:
//!
//! ```math
//! \Bigl(\frac{4}{\Delta t^2} M + K\Bigr) x = \frac{2}{\Delta t} B^T V^n - K U^n + F + G^T r,
//! ```
//!
//! ```math
//! U^{n+1} = U^n + 2 x, \qquad V^{n+1} = \frac{4}{\Delta t} C^{-1} B\, x - V^n .
//! ```
//!
//! With the consistent mass, `$B = C = M_r$`, the scheme gains energy at impacts without bound.
//!
//! With the singular mass the scheme is the implicit midpoint rule for
//! `$C \ddot p = -\nabla \varphi(p)$`, see [`super::potential`]. A step depends on `$U^n$` only
//! through `$p^n = C^{-1} B U^n$`; the massless part of `$U^{n+1}$` is a choice of what to report,
//! see [`Massless`].
//!
//! The damping matrix D = alpha M + beta K adds `$2 D / \Delta t$` to the step matrix and nothing
//! to the right-hand side, since the midpoint velocity is `$2 x / \Delta t$`. Time-dependent loads
//! and obstacles enter as the mean of their values at the two ends of the step. This differs from
//! their value at the midpoint by `$O(\Delta t^2)$` and makes the energy balance exact while the
//! set of nodes in contact does not change: the energy grows by
//!
//! ```math
//! \tfrac12 (F^n + F^{n+1}) \cdot (U^{n+1} - U^n) + r \cdot (l^{n+1} - l^n) - \Delta t\, V^T D V, \qquad V = 2 x / \Delta t,
//! ```
//!
//! with l the obstacles in contact; the first two terms add up to the work in [`Energies`]. Modal
//! damping ([`super::ModalDamping`]) acts on the extrapolated velocity
//! `$\tfrac32 V^n - \tfrac12 V^{n-1}$`.
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

use super::half_step::{HalfStep, Images, State};
use super::{Approach, Potential, Scheme, Start, System};
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, StepReport};
use std::rc::Rc;

/// Choice of the massless part of U that the midpoint scheme reports.
///
/// Both choices give the same motion of p. They differ once there has been contact, which shows in
/// the energy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Massless {
    /// Takes `$U^n = U(p^n)$`, which is in equilibrium and admissible. At steps that resolve
    /// impacts the energy error is about ten times smaller than with the paper's choice: on the
    /// paper's quadrilaterals, over four impacts, 1e-2 instead of 8e-2 at 5e-5 s and 5e-4 instead
    /// of 1e-2 at 1e-5 s.
    Equilibrium,
    /// Takes the paper's `$U^{n+1} = 2 U^{n+1/2} - U^n$` (equation 6). Once disturbed by contact,
    /// the massless part changes sign at each step, undamped. This is the only choice with the
    /// consistent mass, which has no massless part.
    Reflected,
}

/// Midpoint scheme at instant n, with state `$U^n$`, `$V^n$`.
pub struct Midpoint<'s, E: Engine> {
    system: &'s System<E>,
    half: HalfStep<'s, E>,
    /// Minimiser U(p) for [`Massless::Equilibrium`].
    potential: Option<Potential<'s, E>>,
    /// Solver that recovers velocities for [`Massless::Reflected`] with the singular mass, built on
    /// first use.
    lift: Option<Potential<'s, E>>,
    n: u64,
    now: State,
    next: State,
    /// Initial deflections `$G U^0$`, in m, one entry per bound.
    start: Vec<f64>,
    images: Rc<Images>,
    /// Work of the time-dependent loads, obstacles and supports, in J.
    given: f64,
    /// Midpoint deflections `$G U^{n-1/2}$`, `$G U^{n-3/2}$` and `$G U^{n-5/2}$`, in m, one entry
    /// per bound.
    admissible: Vec<f64>,
    earlier: Vec<f64>,
    earliest: Vec<f64>,
    /// Impulses of the obstacles over the last step, in N s, one entry per bound.
    impulses: Vec<f64>,
    verdict: StepReport,
}

impl<'s, E: Engine + 'static> Midpoint<'s, E>
where
    E::Factor: 'static,
{
    /// Starts the scheme with the condensed solver and a step of `dt` seconds.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the step matrix is not positive definite, and
    /// [`crate::Error::Usage`] for [`Massless::Equilibrium`] with stiffness-proportional damping.
    pub fn new(system: &'s System<E>, dt: f64, massless: Massless, start: Start) -> Result<Midpoint<'s, E>> {
        let solver = Condensed::new(&system.engine, &Self::sum(system, dt), system.bounds.len())?;
        Midpoint::with_solver(system, dt, massless, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Midpoint<'s, E> {
    /// Returns the step matrix `$4 M / \Delta t^2 + K + 2 D / \Delta t$` (paper, equation 6, with
    /// damping).
    pub fn sum(system: &'s System<E>, dt: f64) -> [(f64, &'s E::Form); 2] {
        HalfStep::sum(system, dt)
    }

    /// Starts the scheme with a given solver for the matrix [`Midpoint::sum`].
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
        let before = |steps: f64| {
            let at = |&dof: &usize| start.displacement[dof] - steps * dt * start.velocity[dof];
            system.bounds.dofs.iter().map(at).collect::<Vec<f64>>()
        };
        let (admissible, earlier, earliest) = (before(0.5), before(1.5), before(2.5));
        let mut now = State::new(system, start.displacement, &start.velocity)?;
        let mut verdict = StepReport::default();
        let images = Potential::images(system)?;
        let potential = match massless {
            Massless::Reflected => None,
            Massless::Equilibrium => {
                let mut potential = Potential::new(system)?;
                verdict = potential.settle_state(&mut now)?;
                Some(potential)
            }
        };
        let mut half = HalfStep::new(system, dt, solver, images.clone())?;
        half.begin(&start.velocity, &now.moment)?;
        let start = system.bounds.dofs.iter().map(|&dof| now.u[dof]).collect();
        Ok(Midpoint {
            system,
            half,
            potential,
            lift: None,
            n: 0,
            start,
            next: now.clone(),
            now,
            images,
            given: 0.0,
            admissible,
            earlier,
            earliest,
            impulses: vec![0.0; system.bounds.len()],
            verdict,
        })
    }
}

impl<E: Engine> Scheme for Midpoint<'_, E> {
    fn advance(&mut self) -> Result<()> {
        let time = self.time();
        self.verdict = self.half.solve(&self.now, time)?;
        let (dt, reactions) = (self.half.dt, &self.half.reaction);
        self.impulses.iter_mut().zip(reactions).for_each(|(impulse, r)| *impulse = dt * r);
        std::mem::swap(&mut self.earliest, &mut self.earlier);
        std::mem::swap(&mut self.earlier, &mut self.admissible);
        for (z, &dof) in self.admissible.iter_mut().zip(&self.system.bounds.dofs) {
            *z = self.now.u[dof] + self.half.x[dof];
        }
        match &mut self.potential {
            None => {
                self.half.extend(&self.now, 1.0, &mut self.next);
                self.half.reach(&self.now, time, 1.0, &mut self.next.moment)?;
                self.next.weigh(self.system)?;
            }
            Some(potential) => {
                let mut line = potential.line(&self.now, &self.half, time)?;
                line.at(1.0, &mut self.next)?;
                self.verdict = self.verdict.and(line.verdict);
            }
        }
        self.given += self.half.given(&self.now, &self.next)?;
        std::mem::swap(&mut self.now, &mut self.next);
        self.n += 1;
        self.given += self.now.ride(self.system, &self.images, self.time())?;
        Ok(())
    }

    fn step(&self) -> u64 {
        self.n
    }

    fn time(&self) -> f64 {
        self.n as f64 * self.half.dt
    }

    fn displacement(&self) -> &[f64] {
        &self.now.u
    }

    /// Returns the velocity at the present instant, in m/s. With the consistent mass this is
    /// `$V^n$`. With the singular mass `$V^n$` has values per cell only; the result is then the
    /// rate of U(p) with these cell values that follows the obstacles at the nodes in contact
    /// during the last step. At the start it is `$v_0$`.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let Midpoint { system, half, potential, lift, now, n, .. } = self;
        if *n == 0 {
            return Ok(half.first_velocity());
        }
        if !system.engine.is_singular(&system.mass) {
            return Ok(now.v.clone());
        }
        let change = system.change(*n as f64 * half.dt, half.dt, &now.rates)?;
        match potential {
            Some(potential) => potential.rate(&now.v, &now.reaction, &change),
            None => {
                let lift = match lift {
                    Some(lift) => lift,
                    none => none.insert(Potential::factor(system)?),
                };
                lift.rate(&now.v, &half.reaction, &change)
            }
        }
    }

    /// Returns the support velocities just after the instant, in m/s, one entry per motion.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.now.rates.clone())
    }

    fn admissible(&self) -> &[f64] {
        if self.n == 0 { &self.start } else { &self.admissible }
    }

    fn limits(&self) -> &Bounds {
        self.half.limits()
    }

    /// Returns the mean reactions over the last step, in N, one entry per bound. At the start they
    /// are those at `$U^0$`, or zero with [`Massless::Reflected`].
    fn reaction(&self) -> &[f64] {
        if self.n == 0 { &self.now.reaction } else { &self.half.reaction }
    }

    fn impulses(&self) -> &[f64] {
        &self.impulses
    }

    fn energies(&self) -> Result<Energies> {
        let energies = self.now.energies;
        Ok(Energies { work: energies.work + self.given, ..energies })
    }

    fn step_report(&self) -> StepReport {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        // The present step was solved for the middle of the last interval.
        let dt = self.half.dt;
        let velocity = (self.earlier[bound] - self.earliest[bound]) / dt;
        Approach { time: (self.n as f64 - 1.5) * dt, deflection: self.earlier[bound], velocity }
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.n)?;
        archive.value(&mut self.given)?;
        archive.value(&mut self.verdict)?;
        self.now.archive(archive)?;
        for vector in [&mut self.admissible, &mut self.earlier, &mut self.earliest, &mut self.impulses] {
            archive.vector(VectorKind::Bounds, vector)?;
        }
        self.half.archive(archive)?;
        if self.system.drive.modal.is_some() && self.n > 0 {
            archive.vector(VectorKind::Velocities, &mut self.next.v)?;
            if !archive.saves() {
                self.half.recall(&self.next)?;
            }
        }
        self.potential.as_mut().map_or(Ok(()), |potential| potential.archive(archive))
    }

    fn factorisations(&self) -> u64 {
        self.half.factorisations() + self.potential.as_ref().map_or(0, Potential::factorisations)
    }
}
