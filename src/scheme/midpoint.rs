//! Midpoint rule (paper, section 4.2, equation 6).
//!
//! The rule finds `$U^{n+1/2}$` in `$K^h$`. The unknown solved for is the increment
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
//! With the consistent mass, `$B = C = M_r$`, the rule gains energy at impacts without bound.
//! With the singular mass it is the implicit midpoint rule for `$C \ddot p = -\nabla \varphi(p)$`,
//! see [`super::Potential`]. A step depends on `$U^n$` only through `$p^n = C^{-1} B U^n$`; the
//! massless part of `$U^{n+1}$` is a choice of what to report, see [`Massless`].
//!
//! The damping matrix D = alpha M + beta K adds `$2 D / \Delta t$` to the step matrix and nothing
//! to the right-hand side, since the midpoint velocity is `$2 x / \Delta t$`. [`instants`] tells
//! how loads, obstacles and supports that depend on time enter.
//!
//! The energy of stretching is quadratised (scalar auxiliary variable), with g at the displacement
//! `$2 U^{n-1/2} - U^{n-3/2}$`, whose massless part no reflection disturbs: the step matrix gains
//! `$g g^T$` and the right-hand side `$-g\, \psi^n$`, and
//! `$\psi^{n+1} = \psi^n + 2\, g \cdot x$`. A load that depends on the deflection is taken there
//! too.

pub mod instants;
mod rule;
mod scheme;

pub use scheme::{Massless, Midpoint};

use super::System;
use super::drive::ModalDamping;
use super::following_load::FollowedLoad;
use super::quadratisation::{Quadratisation, RankOne};
use super::state::State;
use super::step_driver::{Formulas, StepDriver};
use crate::error::Result;
use crate::linalg::vectors::{aypx, waxpby, waxpy};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::vi::StepReport;
use instants::StepInstants;

/// Midpoint rule with one step length, and the increments of its last step.
pub(super) struct MidpointRule<'s, E: Engine> {
    pub driver: StepDriver<'s, E>,
    pub instants: StepInstants<'s, E>,
    pub dt: f64,
    /// Velocity `$V^n$` in the frame of the step, in m/s, one entry per velocity dof.
    v: Vec<f64>,
    /// Energy of stretching, with the variable `$\psi^n$`.
    pub stretching: Option<Quadratisation<'s, E>>,
    /// Load that depends on the deflection, at the middle of the step.
    pub followed: Option<FollowedLoad<'s, E>>,
    /// Displacements `$U^{n-1/2}$` and `$U^{n-3/2}$`, in m, one entry per dof, where forces need
    /// them.
    midpoints: [Vec<f64>; 2],
    /// Displacement at which g and the load are taken, in m, one entry per dof.
    ahead: Vec<f64>,
    /// Half the increment of p, `$C^{-1} B x$`, in m, one entry per velocity dof.
    pub half_dp: Vec<f64>,
    /// Increment `$V^{n+1} - V^n$`, in m/s, one entry per velocity dof.
    pub dv: Vec<f64>,
}

/// Terms of equation (6) for the step from one state.
struct Equation6<'a, 's, E: Engine> {
    from: &'a State,
    v: &'a [f64],
    dt: f64,
    system: &'s System<E>,
    instants: &'a StepInstants<'s, E>,
    stretching: Option<&'a Quadratisation<'s, E>>,
    followed: Option<&'a FollowedLoad<'s, E>>,
}

impl<E: Engine> Formulas<E> for Equation6<'_, '_, E> {
    fn displacement(&self) -> &[f64] {
        &self.from.u
    }

    fn limits(&self) -> &Bounds {
        self.instants.limits()
    }

    /// `$b = \frac{2}{\Delta t} B^T V^n - K U^n + F - g\, \psi^n$`
    fn right_hand_side(&mut self, b: &mut [f64]) -> Result<()> {
        self.system.engine.project_transpose(&self.system.mass, self.v, b)?;
        aypx(2.0 / self.dt, &self.from.force, b);
        self.instants.add_load(b);
        self.stretching.iter().for_each(|stretching| stretching.subtract_force(stretching.root, b));
        self.followed.iter().for_each(|followed| followed.add_force(b));
        Ok(())
    }

    fn modal_velocities(&self, modal: &ModalDamping) -> Result<Vec<f64>> {
        let System { engine, mass, .. } = self.system;
        let mut momentum = vec![0.0; engine.dofs()];
        engine.project_transpose(mass, &self.from.v, &mut momentum)?;
        modal.of_momentum(engine, &momentum)
    }

    /// `$d = U^n$`, whose weight is 0 in both formulas.
    fn known(&self) -> &[f64] {
        &self.from.u
    }

    /// `$U^{n+1/2} = U^n + x$`
    fn bounded_configuration(&self) -> [f64; 2] {
        [1.0, 0.0]
    }

    /// `$U^{n+1} - U^n = 2 x$`
    fn displacement_of_forces(&self) -> [f64; 2] {
        [2.0, 0.0]
    }

    fn stretching(&self) -> Option<RankOne<'_>> {
        self.stretching.map(|stretching| stretching.term(1.0))
    }
}

impl<'s, E: Engine> MidpointRule<'s, E> {
    /// Returns the step matrix `$4 M / \Delta t^2 + K + 2 D / \Delta t$` (equation 6, with
    /// damping).
    pub fn matrix(system: &'s System<E>, dt: f64) -> LinearCombination<'s> {
        let (m, k, d) = system.matrices();
        m * (4.0 / (dt * dt)) + k + d * (2.0 / dt)
    }

    /// Solves the step from a state at `time` (s).
    pub fn solve(&mut self, from: &State, time: f64) -> Result<StepReport> {
        let system @ System { engine, mass, .. } = self.driver.system;
        self.instants.enter(from, time, &mut self.v)?;
        if !self.ahead.is_empty() {
            let [last, before] = &self.midpoints;
            waxpby(2.0, last, -1.0, before, &mut self.ahead);
            self.stretching.as_mut().map_or(Ok(()), |stretching| stretching.linearise(&self.ahead))?;
            let middle = time + 0.5 * self.dt;
            self.followed.as_mut().map_or(Ok(()), |followed| followed.take(middle, &self.ahead))?;
        }
        self.driver.set_obstacle_paths([time, time + self.dt])?;
        let MidpointRule { v, dt, instants, stretching, followed, .. } = self;
        let (stretching, followed) = (stretching.as_ref(), followed.as_ref());
        self.driver.solve(&mut Equation6 { from, v, dt: *dt, system, instants, stretching, followed })?;
        if let Some(stretching) = &mut self.stretching {
            let path = stretching.along(&self.driver.x)?;
            stretching.applied = stretching.root + path;
            stretching.root += 2.0 * path;
        }
        if let Some(followed) = &mut self.followed {
            followed.increment = 2.0 * followed.along(&self.driver.x)?;
            followed.work += followed.increment;
        }
        if !self.ahead.is_empty() {
            self.midpoints.rotate_right(1);
            waxpy(1.0, &self.driver.x, &from.u, &mut self.midpoints[0]);
        }
        engine.project(mass, &self.driver.x, &mut self.half_dp)?;
        waxpby(4.0 / self.dt, &self.half_dp, -2.0, &self.v, &mut self.dv);
        Ok(self.driver.report)
    }

    /// Sets the bounded configuration `$G U^{n+1/2}$`, in m, one entry per bound.
    pub fn restrict_midpoint(&self, from: &State, admissible: &mut [f64]) {
        let MidpointRule { driver, instants, v, dt, .. } = self;
        let formulas =
            Equation6 { from, v, dt: *dt, system: driver.system, instants, stretching: None, followed: None };
        driver.restrict(&formulas, admissible);
    }

    /// Sets `to` to `$(U^n + 2 \gamma x, V^n + \gamma (V^{n+1} - V^n))$`: (6) for gamma = 1.
    pub fn update(&self, from: &State, gamma: f64, to: &mut State) {
        waxpy(2.0 * gamma, &self.driver.x, &from.u, &mut to.u);
        waxpy(gamma, &self.dv, &self.v, &mut to.v);
        to.frame_rates.copy_from_slice(&self.instants.frame_rates);
    }
}
