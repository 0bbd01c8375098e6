//! The midpoint scheme (the paper's section 4.2, equation 6).
//!
//! Find U^{n+1/2} in K^h; its unknown here is the increment x = U^{n+1/2} - U^n:
//!
//! ```math
//! \Bigl(\frac{4}{\Delta t^2} M + K\Bigr) x = \frac{2}{\Delta t} B^T V^n - K U^n + F + G^T r,
//! ```
//!
//! ```math
//! U^{n+1} = U^n + 2 x, \qquad V^{n+1} = \frac{4}{\Delta t} C^{-1} B\, x - V^n .
//! ```
//!
//! With the consistent mass B = C = M_r, and the scheme gains energy at impacts without bound.
//!
//! With the singular mass this is the implicit midpoint rule of the equation `$C \ddot p = -\nabla \varphi(p)$` of
//! [`super::potential`]: the step sees U^n only through `$p^n = C^{-1} B U^n$`. The massless part of U^{n+1} is then a
//! matter of report, see [`Massless`].
//!
//! Damping D = alpha M + beta K adds 2 D / dt to the matrix of a step, and nothing else: the velocity in the middle is 2 x / dt. Of
//! loads and obstacles that change with time a step knows the means of its two ends. They do as well as those of the middle, which
//! they differ from by O(dt^2), and where the same nodes touch throughout they make the energy exact: it grows by
//!
//! ```math
//! \tfrac12 (F^n + F^{n+1}) \cdot (U^{n+1} - U^n) + r \cdot (l^{n+1} - l^n) - \Delta t\, V^T D V, \qquad V = 2 x / \Delta t,
//! ```
//!
//! with l the obstacles that are touched; the first two terms add up to the work that [`Energies`] carries. Damping of single modes
//! ([`super::ModalDamping`]) acts on the extrapolated velocity `$\tfrac32 V^n - \tfrac12 V^{n-1}$`.
//!
//! # Momentum
//!
//! A step changes the momentum by that of the forces in its middle,
//!
//! ```math
//! B^T (V^{n+1} - V^n) = \Delta t\,(F - K U^{n+1/2} - D V^{n+1/2} + G^T r) ,
//! ```
//!
//! and the obstacles' impulse is dt r. The reactions reported at an instant are those of the step that led there, their mean over it;
//! at the start those at U^0 where the scheme knows them, [`Massless::Equilibrium`], else none. The velocity reported is that of the instant: with the
//! singular mass the rate of U(p) where p moves at V^n and the nodes in contact keep to their obstacles.
//!
//! # Supports that move
//!
//! U is counted from the shape R s(t) that their motion s gives the plate, and during a step from a frame that goes evenly from s^n to
//! s^{n+1}: nothing is inertial in it. At each instant the frame's velocity changes, and V with it by the momentum M R times
//! that change. So the plate has the impulse of every kink of s, at its instant to second order, and U + R s is what the scheme makes
//! of the plate and its supports at rest in any frame. Between steps V is counted from s' just after the instant. The kinetic
//! energy that V gains where its frame changes is work.

use super::half_step::{HalfStep, Images, State};
use super::{Approach, Potential, Scheme, Start, System};
use crate::archive::{Archive, Over};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, Verdict};
use std::rc::Rc;

/// What the midpoint scheme takes for the part of U that has no mass.
///
/// The motion of p is the same; contact makes the difference, and the energy shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Massless {
    /// U^n = U(p^n), in equilibrium and admissible. At steps that resolve impacts its energy errs some ten times less than
    /// the paper's: on the paper's quadrilaterals, over four impacts, by 1e-2 instead of 8e-2 at 5e-5 s, by 5e-4 instead of 1e-2 at 1e-5 s.
    Equilibrium,
    /// The paper's U^{n+1} = 2 U^{n+1/2} - U^n: once disturbed by contact, the massless part flips from side to side at each
    /// step, undamped. The only choice with the consistent mass, which leaves nothing massless.
    Reflected,
}

/// The scheme at an instant n: U^n and V^n.
pub struct Midpoint<'s, E: Engine> {
    system: &'s System<E>,
    half: HalfStep<'s, E>,
    /// Of [`Massless::Equilibrium`].
    potential: Option<Potential<'s, E>>,
    /// What finds velocities for [`Massless::Reflected`] with the singular mass, once asked for.
    lift: Option<Potential<'s, E>>,
    n: u64,
    now: State,
    next: State,
    /// G U^0.
    start: Vec<f64>,
    images: Rc<Images>,
    /// Work of what changes with time, in J.
    given: f64,
    /// G U^{n-1/2} of the last step, and of the two before it.
    admissible: Vec<f64>,
    earlier: Vec<f64>,
    earliest: Vec<f64>,
    /// Impulses of the obstacles over the last step, in N s.
    impulses: Vec<f64>,
    verdict: Verdict,
}

impl<'s, E: Engine + 'static> Midpoint<'s, E>
where
    E::Factor: 'static,
{
    /// Starts with the condensed solver and a step of `dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where the matrix of a step is not positive definite; [`crate::Error::Usage`] where
    /// [`Massless::Equilibrium`] meets damping by stiffness.
    pub fn new(system: &'s System<E>, dt: f64, massless: Massless, start: Start) -> Result<Midpoint<'s, E>> {
        let solver = Condensed::new(&system.engine, &Self::sum(system, dt), system.bounds.len())?;
        Midpoint::with_solver(system, dt, massless, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Midpoint<'s, E> {
    /// The matrix of a step, 4 M / dt^2 + K + 2 D / dt.
    pub fn sum(system: &'s System<E>, dt: f64) -> [(f64, &'s E::Form); 2] {
        HalfStep::sum(system, dt)
    }

    /// Starts with a given solver of [`Midpoint::sum`].
    ///
    /// # Errors
    /// As [`Midpoint::new`].
    pub fn with_solver(
        system: &'s System<E>,
        dt: f64,
        massless: Massless,
        start: Start,
        solver: Box<dyn Solver<E>>,
    ) -> Result<Midpoint<'s, E>> {
        // The plate comes to U^0 at its first velocity.
        let before = |steps: f64| {
            let at = |&dof: &usize| start.displacement[dof] - steps * dt * start.velocity[dof];
            system.bounds.dofs.iter().map(at).collect::<Vec<f64>>()
        };
        let (admissible, earlier, earliest) = (before(0.5), before(1.5), before(2.5));
        let mut now = State::new(system, start.displacement, &start.velocity)?;
        let mut verdict = Verdict::default();
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

    /// V^n with the consistent mass. With the singular one V^n has values in cells only: the rate of U(p) that has these, and the rates
    /// of the obstacles at the nodes that they pushed in the last step. At the start v_0.
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

    /// Those just after the instant.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.now.rates.clone())
    }

    fn admissible(&self) -> &[f64] {
        if self.n == 0 { &self.start } else { &self.admissible }
    }

    fn limits(&self) -> &Bounds {
        self.half.limits()
    }

    /// Their mean over the last step; at the start those at U^0, or none with [`Massless::Reflected`].
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

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        // The present step solved for the middle of the last interval.
        let dt = self.half.dt;
        let velocity = (self.earlier[bound] - self.earliest[bound]) / dt;
        Approach { time: (self.n as f64 - 1.5) * dt, deflection: self.earlier[bound], velocity }
    }

    fn state(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.n)?;
        archive.value(&mut self.given)?;
        archive.value(&mut self.verdict)?;
        self.now.archive(archive)?;
        for vector in [&mut self.admissible, &mut self.earlier, &mut self.earliest, &mut self.impulses] {
            archive.vector(Over::Bounds, vector)?;
        }
        self.half.archive(archive)?;
        if self.system.drive.modal.is_some() && self.n > 0 {
            archive.vector(Over::Velocities, &mut self.next.v)?;
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
