//! Newmark-e-beta scheme with coefficient of restitution (paper, section 4.1; Paoli and Schatzman
//! 2007).
//!
//! The scheme finds `$U^{n+1,e} = (U^{n+1} + e\,U^{n-1}) / (1 + e)$` in `$K^h$` such that, with
//! `$F = \beta F^{n+1} + (1 - 2 \beta) F^n + \beta F^{n-1}$`,
//!
//! ```math
//! M \frac{U^{n+1} - 2 U^n + U^{n-1}}{\Delta t^2} + K\,(\beta U^{n+1} + (1 - 2 \beta) U^n + \beta U^{n-1}) = F + G^T r .
//! ```
//!
//! The unknown solved for is the second difference `$x = U^{n+1} - 2 U^n + U^{n-1}$`:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr) x = F - K U^n + G^T r, \qquad U^{n+1,e} = U^n + \frac{x + (1 - e)(U^n - U^{n-1})}{1 + e} .
//! ```
//!
//! The damping matrix D multiplies the central velocity `$V^n = (U^{n+1} - U^{n-1}) / 2 \Delta t$`,
//! which is the reported one. Two equations of successive instants add up to
//!
//! ```math
//! M\,(V^n - V^{n-1}) = \tfrac{\Delta t}{2} \bigl( f^{n-1} + G^T r^{n-1} + f^n + G^T r^n \bigr) ,
//! ```
//!
//! with f all other forces: the impulse of the obstacles over a step is the trapezoidal sum of the
//! reactions at its ends, which are those of the instants themselves. [`start`] tells the first
//! step, and [`instants`] how loads, obstacles and supports that depend on time enter.
//!
//! # Stretching
//!
//! The energy V of the mid-plane is quadratised (scalar auxiliary variable), with g at `$U^n$`. The
//! force is the mean of `$\psi\, g$` before and after the instant:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K + \tfrac14 g g^T\Bigr) x
//!    = F - K U^n - g\,\bigl(\psi^{n-1/2} + \tfrac12 g \cdot d\bigr) + G^T r, \qquad
//! \psi^{n+1/2} = \psi^{n-1/2} + \tfrac12\, g \cdot (U^{n+1} - U^{n-1}) .
//! ```
//!
//! The invariant of beta = 1/2 gains `$\tfrac12 (\psi^{n+1/2})^2$`, and never rises for e = 0 as
//! without stretching. At the start `$\psi^{1/2} = \sqrt{2 V} + \tfrac12\, g \cdot (U^1 - U^0)$`.
//!
//! A load that depends on the deflection is the one at `$U^n$`, and does the work
//! `$\tfrac12 F(U^n) \cdot (U^{n+1} - U^{n-1})$`.
//!
//! # Bounds that yield
//!
//! The reaction of a bound that yields is that of its law at `$U^{n+1,e}$`, which lies at the time
//! `$t^n + \theta \Delta t$` with `$\theta = (1 - e) / (1 + e)$`. The energy `$\varphi$` that it
//! stores at `$t^n$` is interpolated from those of two steps,
//! `$\varphi^n = \theta\, \varphi(U^{n,e}) + (1 - \theta)\, \varphi(U^{n+1,e})$`. For e = 0 that is
//! `$\varphi(U^n)$`, and since `$\varphi$` is convex,
//!
//! ```math
//! \tfrac12 r^n \cdot (U^{n+1} - U^{n-1}) = -\tfrac12 \nabla \varphi(U^{n+1}) \cdot (U^{n+1} - U^{n-1})
//!    \le \tfrac12 \varphi(U^{n-1}) - \tfrac12 \varphi(U^{n+1}) :
//! ```
//!
//! the invariant of beta = 1/2 with `$\tfrac12 (\varphi^n + \varphi^{n+1})$` never rises, at any step
//! and stiffness. The scheme then loses energy in proportion to the step, and is of second order
//! for e = 1 only. For infinite stiffness it is the scheme with rigid bounds.

pub mod instants;
mod scheme;
pub mod start;
mod stiffness_force;

use super::drive::ModalDamping;
use super::following_load::FollowedLoad;
use super::quadratisation::{Quadratisation, RankOne};
use super::sliding::Sliding;
use super::step_driver::{Formulas, StepDriver};
use super::{StepRecord, System};
use crate::error::Result;
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use instants::CentralInstants;
use std::cell::RefCell;
use std::ops::{Add, Mul, Sub};
use stiffness_force::StiffnessForce;

/// Parameters of [`Newmark`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewmarkParameters {
    /// Newmark parameter beta, at least 1/4 (unconditionally stable); 1/2 in the paper.
    pub beta: f64,
    /// Coefficient of restitution e, from 0 (absorbing) to 1 (perfect).
    pub restitution: f64,
    /// Time step `$\Delta t$`, in s.
    pub step: f64,
}

/// Formulas that the scheme has in common over dofs, over modes and over systems in lock step.
impl NewmarkParameters {
    /// Returns the weights of M, K and D in the step matrix (paper, section 4.1, with damping).
    pub(crate) fn matrix_weights(self) -> [f64; 3] {
        [1.0 / (self.step * self.step), self.beta, 0.5 / self.step]
    }

    /// Returns the beta-average of the values at the instants n - 1, n and n + 1.
    #[inline(always)]
    pub(crate) fn average<T>(self, [before, now, next]: [T; 3]) -> T
    where
        T: Copy + Add<Output = T> + Sub<Output = T>,
        f64: Mul<T, Output = T>,
    {
        now + self.beta * ((next - 2.0 * now) + before)
    }

    /// Returns the second difference of the values at three instants over dt^2.
    pub(crate) fn acceleration(self, [before, now, next]: [f64; 3]) -> f64 {
        ((next - now) - (now - before)) / (self.step * self.step)
    }

    /// Returns the weight `$\theta = (1 - e) / (1 + e)$` of `$U^n - U^{n-1}$` in `$U^{n+1,e}$`.
    pub(crate) fn theta(self) -> f64 {
        (1.0 - self.restitution) / (1.0 + self.restitution)
    }

    /// Returns the weight e / (1 + e) of the instant n - 1 in the bounds on `$U^{n+1,e}$`.
    pub(crate) fn share_of_last(self) -> f64 {
        self.restitution / (1.0 + self.restitution)
    }

    /// Returns the energy stored in bounds that yield at instant n, in J, given those stored in
    /// `$U^{n,e}$` and `$U^{n+1,e}$`.
    pub(crate) fn stored_now(self, [last, next]: [f64; 2]) -> f64 {
        self.theta() * last + (1.0 - self.theta()) * next
    }

    /// Returns the instants (s) of the load of step n, with their weights. At the start the
    /// extrapolated load leaves that of the instant alone.
    pub(crate) fn times(self, n: u64) -> Vec<(f64, f64)> {
        let time = |n: u64| n as f64 * self.step;
        match n {
            0 => vec![(0.0, 1.0)],
            n => vec![(time(n - 1), self.beta), (time(n), 1.0 - 2.0 * self.beta), (time(n + 1), self.beta)],
        }
    }
}

/// Returns the values of each entry at the instants n - 1, n and n + 1.
#[inline(always)]
pub(crate) fn levels<T: Copy>([before, now, next]: [&[T]; 3]) -> impl Iterator<Item = [T; 3]> {
    before.iter().zip(now.iter().zip(next)).map(|(before, (now, next))| [*before, *now, *next])
}

/// Newmark-e-beta scheme at instant n, with the step to `$U^{n+1}$` already solved.
pub struct Newmark<'s, E: Engine> {
    driver: StepDriver<'s, E>,
    levels: Levels<'s, E>,
    record: StepRecord,
    /// Work space of the energies: central velocity, one entry per dof, and velocity.
    work: RefCell<[Vec<f64>; 2]>,
}

/// Displacements at two successive instants; the unknown x of the step leads to the next one.
struct Levels<'s, E: Engine> {
    system: &'s System<E>,
    parameters: NewmarkParameters,
    /// `$U^n$` and `$U^n - U^{n-1}$`, in m, one entry per dof.
    u_n: Vec<f64>,
    d_n: Vec<f64>,
    /// Force `$K U^n$` and its increments.
    force: StiffnessForce,
    /// Energy of stretching, with the variable `$\psi^{n-1/2}$` before a step and `$\psi^{n+1/2}$`
    /// after it.
    stretching: Option<Quadratisation<'s, E>>,
    /// Load that depends on the deflection, at `$U^n$`.
    followed: Option<FollowedLoad<'s, E>>,
    /// Energies stored in bounds that yield, at `$U^{n,e}$` and `$U^{n+1,e}$`, in J.
    stored: [f64; 2],
    /// Initial velocity `$v_0$` at the bounded dofs, in m/s.
    v0: Vec<f64>,
    instants: Option<CentralInstants>,
    /// Work space for D times a vector; empty without damping.
    product: Vec<f64>,
}

impl<'s, E: Engine> Newmark<'s, E> {
    /// Returns the step matrix `$M / \Delta t^2 + \beta K + D / 2 \Delta t$` (paper, section 4.1,
    /// with damping).
    pub fn matrix(system: &'s System<E>, parameters: NewmarkParameters) -> LinearCombination<'s> {
        let (m, k, d) = system.matrices();
        let [of_mass, of_stiffness, of_damping] = parameters.matrix_weights();
        m * of_mass + k * of_stiffness + d * of_damping
    }
}

impl<E: Engine> Formulas<E> for Levels<'_, E> {
    fn displacement(&self) -> &[f64] {
        &self.u_n
    }

    fn limits(&self) -> &Bounds {
        self.instants.as_ref().and_then(CentralInstants::limits).unwrap_or(&self.system.bounds)
    }

    /// `$b = F - K U^n - D (U^n - U^{n-1}) / \Delta t - g\,(\psi^{n-1/2} + \tfrac12 g \cdot d)$`
    fn right_hand_side(&mut self, b: &mut [f64]) -> Result<()> {
        self.force(b);
        if let Some(stretching) = &self.stretching {
            stretching.subtract_force(stretching.root + 0.5 * stretching.along(&self.d_n)?, b);
        }
        let product = self.force.of_increment();
        self.system.damp(&self.d_n, product, 1.0 / self.parameters.step, b, &mut self.product)
    }

    fn modal_velocities(&self, modal: &ModalDamping) -> Result<Vec<f64>> {
        let displacements = modal.of_rate(&self.system.engine, &self.d_n)?;
        Ok(displacements.into_iter().map(|d| d / self.parameters.step).collect())
    }

    /// `$d = U^n - U^{n-1}$`
    fn known(&self) -> &[f64] {
        &self.d_n
    }

    /// `$U^{n+1,e} = U^n + \frac{1}{1+e}\,x + \frac{1-e}{1+e}\,d$`
    fn bounded_configuration(&self) -> [f64; 2] {
        [1.0 / (1.0 + self.parameters.restitution), self.parameters.theta()]
    }

    /// `$\tfrac12 (U^{n+1} - U^{n-1}) = \tfrac12 x + d$`
    fn displacement_of_forces(&self) -> [f64; 2] {
        [0.5, 1.0]
    }

    fn stretching(&self) -> Option<RankOne<'_>> {
        self.stretching.as_ref().map(|stretching| stretching.term(0.25))
    }
}

impl<E: Engine> Levels<'_, E> {
    /// Sets b to `$F - K U^n$`, in N.
    fn force(&self, b: &mut [f64]) {
        self.system.subtract_from_load(&self.force.of_u, b);
        self.instants.iter().for_each(|instants| instants.add_forces(self.system, b));
        self.followed.iter().for_each(|followed| followed.add_force(b));
    }

    /// Makes `$U^{n+1} = 2 U^n - U^{n-1} + x$` the present level; `next` is the time of the new
    /// instant n + 1, in s.
    fn shift(&mut self, x: &[f64], next: f64) -> Result<()> {
        for (u, (d, x)) in self.u_n.iter_mut().zip(self.d_n.iter_mut().zip(x)) {
            *d += x;
            *u += *d;
        }
        self.force.advance(self.system, &self.u_n, &self.d_n)?;
        self.stretching.as_mut().map_or(Ok(()), |stretching| stretching.linearise(&self.u_n))?;
        let now = next - self.parameters.step;
        self.followed.as_mut().map_or(Ok(()), |followed| followed.take(now, &self.u_n))?;
        self.instants.as_mut().map_or(Ok(()), |instants| instants.advance(self.system, next))
    }

    /// Advances the variable of stretching to `$\psi^{n+1/2}$`, given x and the weights of x and of
    /// d in the displacement `$U^{n+1} - U^{n-1}$`, or `$U^1 - U^0$` in the first step. Collective.
    fn stretch(&mut self, x: &[f64], [of_x, of_d]: [f64; 2]) -> Result<()> {
        let Some(stretching) = &mut self.stretching else { return Ok(()) };
        let path = of_x * stretching.along(x)? + of_d * stretching.along(&self.d_n)?;
        stretching.applied = stretching.root + 0.25 * path;
        stretching.root += 0.5 * path;
        stretching.compare(stretching.applied, stretching.stored);
        Ok(())
    }

    /// Sets the energy that bounds which yield, and the springs of sliders, store in the bounded
    /// configuration of the step. Collective.
    fn store(&mut self, admissible: &[f64], sliding: Option<&Sliding>) -> Result<()> {
        if !self.system.bounds.laws.are_rigid() {
            let of_bounds = self.limits().stored_energy(|bound| admissible[bound]);
            let of_sliders = sliding.map_or(0.0, Sliding::stored);
            self.stored = [self.stored[1], self.system.total(of_bounds + of_sliders)?];
        }
        Ok(())
    }

    /// Adds work and heat of the friction and of the dashpots of obstacles up to instant n, given
    /// its step. Collective.
    fn add_heat(&self, n: u64, driver: &mut StepDriver<E>) {
        let StepDriver { friction, dashpots, x, .. } = driver;
        let (engine, twice) = (&self.system.engine, |dof: usize| self.d_n[dof] + (self.d_n[dof] + x[dof]));
        friction.iter_mut().for_each(|friction| friction.add_instant(n, engine, twice));
        let shares = if n > 0 { [0.5; 2] } else { [0.0; 2] };
        let mean = |dof| 0.5 * twice(dof);
        dashpots.iter_mut().for_each(|dashpots| dashpots.add(engine, mean, self.parameters.step, shares));
    }

    /// Adds the work of the time-dependent data up to instant n, given the unknown of its step.
    fn account(&mut self, n: u64, x: &[f64], reaction: &[f64]) -> Result<()> {
        if let Some(followed) = &mut self.followed {
            let increment = 0.5 * followed.along(x)? + followed.along(&self.d_n)?;
            if n > 0 {
                followed.work += 0.5 * (followed.increment + increment);
            }
            followed.increment = increment;
        }
        let Some(instants) = &mut self.instants else { return Ok(()) };
        let displacement = self.d_n.iter().zip(x).map(|(d, x)| d + (d + x));
        instants.account(n, self.system, displacement, reaction)
    }
}
