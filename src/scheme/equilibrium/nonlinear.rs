//! Static equilibrium of a plate that stretches, or whose load depends on the deflection, on its
//! mesh.
//!
//! The energy is `$\tfrac12 U^T K U + V(U) - W(U) - F^T U$` within the bounds, with the energy V of
//! stretching and the work W of the load that depends on the deflection. Each step minimises the
//! model
//!
//! ```math
//! \tfrac12 x^T (K + K_G + K_W + g g^T)\, x - (F + W' - K U - V')^T x, \qquad l \le G (U + x) \le u,
//! ```
//!
//! with the geometric stiffness K_G of the membrane force at U, `$K_W = -W''$`, and
//! `$g = V' / \sqrt{2 V}$`. Along U, where V grows with the fourth power, `$K_G + g g^T$` is the
//! second derivative of V; elsewhere it leaves out how the membrane force changes. A search along the
//! step finds an energy that is lower.
//!
//! A load that grows as the plate follows it has no equilibrium beyond some size: the plate is
//! *pulled in*. There the matrix stays indefinite. Steps then use the part of K_W that stiffens the
//! plate, and lead to an obstacle, if there is one.

use super::Equilibrium;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, copy_scaled, scale, waxpy};
use crate::linalg::{Engine, Form};
use crate::obstacle::Bounds;
use crate::scheme::drive::StretchingEnergy;
use crate::scheme::following_load::FollowingLoad;
use crate::scheme::quadratisation::RootSearch;
use crate::vi::kkt::KktCheck;
use crate::vi::{Answer, CheckedSolver, Condensed, Problem, StepReport};

/// Largest number of steps, and of halvings of one.
const STEPS: u32 = 200;
const HALVINGS: i32 = 30;

/// Number of steps with an indefinite matrix after which a plate without obstacles is pulled in.
const INDEFINITE: u32 = 20;

/// KKT residual at which the search ends, and the one up to which it may stall.
const SETTLED: f64 = 1e-13;
const STALLED: f64 = 1e-10;

/// Rounding error of an energy, relative to its parts.
const ROUNDING: f64 = 1e-14;

/// Relative accuracy of the load that pulls a plate in, and the largest one that is sought.
const PULL_IN: f64 = 1e-5;
const STRONGEST: f64 = 1e9;

/// Plate that stretches, or whose load depends on the deflection, under a load.
pub struct NonlinearPlate<'p, E: Engine> {
    /// Linear algebra backend.
    pub engine: &'p E,
    /// Stiffness K.
    pub stiffness: &'p Form,
    /// Energy V of stretching.
    pub stretching: Option<&'p dyn StretchingEnergy>,
    /// Load that depends on the deflection, at its first instant.
    pub following: Option<&'p dyn FollowingLoad>,
    /// Factor of that load.
    pub share: f64,
    /// Stiffness `$K_G + K_W$` at a displacement, given the factor of K_W, with all of K_W or the
    /// part that stiffens the plate.
    pub tangent: &'p dyn Fn(&[f64], f64, bool) -> Result<Form>,
    /// Load F, in N, one entry per dof.
    pub load: &'p [f64],
    /// Bounds on the deflections, in m.
    pub bounds: &'p Bounds,
}

/// Forces and energies at a displacement.
struct Sample {
    /// Force W' - V', in N, one entry per dof, and its part -V'.
    force: Vec<f64>,
    pull: Vec<f64>,
    /// Energies V and W, in J.
    stretched: f64,
    work: f64,
}

impl<E: Engine + 'static> NonlinearPlate<'_, E> {
    /// Finds the equilibrium from an admissible displacement on (m, one entry per dof). Returns U
    /// (m), r (N) and the accuracy by the KKT residual of the nonlinear problem. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Unfinished`] where there is none or the search ends elsewhere, and the
    /// errors of the engine.
    pub fn equilibrium(&self, start: Vec<f64>) -> Result<Equilibrium> {
        let NonlinearPlate { engine, stiffness, bounds, .. } = *self;
        let alone = stiffness.into();
        let mut check = KktCheck::new(engine, &alone)?;
        let mut u = start;
        let (mut x, mut b) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let mut reaction = vec![0.0; bounds.len()];
        let mut remaining = bounds.clone();
        let (mut last, mut indefinite) = (f64::INFINITY, 0);
        for iterations in 0..STEPS {
            let now = self.sample(&u)?;
            let length = self.length(&u);
            let problem = Problem { matrix: &alone, rhs: self.load, bounds, length };
            let answer = Answer { x: &mut u, reaction: &mut reaction };
            let kkt = check.residual(engine, &problem, &[&now.force], &answer)?;
            if kkt <= SETTLED || kkt <= STALLED && kkt > 0.9 * last {
                return Ok((u, reaction, StepReport { iterations, kkt, retries: 0 }));
            }
            last = kkt;
            // b = F - K U + W' - V'
            let bent = engine.multiply(stiffness, &u, &mut b)?;
            b.iter_mut().zip(self.load.iter().zip(&now.force)).for_each(|(b, (load, force))| *b = load - *b + force);
            let pushed = engine.dot(self.load, &u)?;
            let least = 0.5 * bent + now.stretched - now.work - pushed + self.stored(&u);
            // At the end rounding of these terms hides the descent.
            let most = least + ROUNDING * (0.5 * bent + now.stretched + now.work.abs() + pushed.abs());
            let mut answer = Answer { x: &mut x, reaction: &mut reaction };
            match self.step([&b, &now.pull], now.stretched, &u, true, &mut remaining, &mut answer) {
                Err(Error::Singular(_)) if self.following.is_some() => {
                    indefinite += 1;
                    if indefinite > INDEFINITE && engine.comm().all_reduce_all(bounds.is_empty()) {
                        break;
                    }
                    self.step([&b, &now.pull], now.stretched, &u, false, &mut remaining, &mut answer)?;
                }
                solved => solved?,
            }
            let mut moved = u.clone();
            for length in (0..HALVINGS).map(|k| 0.5_f64.powi(k)) {
                moved.copy_from_slice(&u);
                axpy(length, &x, &mut moved);
                // Beyond an electrode the load has no value.
                match self.energy(&moved) {
                    Ok(energy) if energy <= most => {
                        u.copy_from_slice(&moved);
                        break;
                    }
                    Err(error) if self.following.is_none() => return Err(error),
                    _ => {}
                }
            }
        }
        Err(Error::Unfinished("the search for the equilibrium of the plate ended without one".into()))
    }

    /// Returns the largest multiple of the load that depends on the deflection for which the plate
    /// has an equilibrium without obstacles, reached from the flat plate; `None` without such a
    /// load, or where every multiple has one. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn pull_in(&self) -> Result<Option<f64>> {
        if self.following.is_none() {
            return Ok(None);
        }
        let free = Bounds::default();
        let rests = |share: f64, from: &mut Vec<f64>| {
            match (NonlinearPlate { share, bounds: &free, ..*self }).equilibrium(from.clone()) {
                Ok((u, _, _)) => {
                    *from = u;
                    Ok(true)
                }
                Err(Error::Unfinished(_) | Error::Singular(_) | Error::Scene(_)) => Ok(false),
                Err(error) => Err(error),
            }
        };
        let mut u = vec![0.0; self.load.len()];
        let (mut low, mut high) = (0.0, 1.0);
        while rests(high, &mut u)? {
            (low, high) = (high, 2.0 * high);
            if high > STRONGEST {
                return Ok(None);
            }
        }
        while high - low > PULL_IN * high {
            let middle = 0.5 * (low + high);
            *(if rests(middle, &mut u)? { &mut low } else { &mut high }) = middle;
            if high < 1.0 / STRONGEST {
                break;
            }
        }
        Ok(Some(low))
    }

    /// Returns forces and energies at a displacement. Collective.
    fn sample(&self, u: &[f64]) -> Result<Sample> {
        let (mut pull, mut force) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let (mut stretched, mut work) = (0.0, 0.0);
        if let Some(stretching) = self.stretching {
            stretched = stretching.evaluate(u, &mut pull)?;
            scale(-1.0, &mut pull);
        }
        if let Some(following) = self.following {
            following.force(0.0, u, &mut force)?;
            scale(self.share, &mut force);
            work = self.share * following.work(0.0, u)?;
        }
        add(&pull, &mut force);
        Ok(Sample { force, pull, stretched, work })
    }

    /// Returns the length scale of the deflections, in m. Collective.
    fn length(&self, u: &[f64]) -> f64 {
        let NonlinearPlate { engine, bounds, .. } = *self;
        let largest = u.iter().fold(bounds.magnitude(), |most, u| most.max(u.abs()));
        engine.comm().all_reduce_max(largest)
    }

    /// Returns the energy of a displacement, in J. Collective.
    fn energy(&self, u: &[f64]) -> Result<f64> {
        let Sample { stretched, work, .. } = self.sample(u)?;
        let bent = self.engine.multiply(self.stiffness, u, &mut vec![0.0; u.len()])?;
        Ok(0.5 * bent + stretched - work - self.engine.dot(self.load, u)? + self.stored(u))
    }

    /// Returns the energy that bounds which yield store, in J. Collective.
    fn stored(&self, u: &[f64]) -> f64 {
        let NonlinearPlate { engine, bounds, .. } = *self;
        engine.comm().all_reduce_sum(bounds.stored_energy(|bound| u[bounds.dofs[bound]]))
    }

    /// Minimises the model at a displacement, given b and -V', both in N, and V, in J.
    fn step(
        &self,
        [b, pull]: [&[f64]; 2],
        stretched: f64,
        u: &[f64],
        softens: bool,
        remaining: &mut Bounds,
        answer: &mut Answer,
    ) -> Result<()> {
        let NonlinearPlate { engine, bounds, .. } = *self;
        let tangent = (self.tangent)(u, self.share, softens)?;
        let tangent = self.stiffness + &tangent;
        let solver = Condensed::new(engine, &tangent, bounds.len())?;
        let mut solver = CheckedSolver::new(Box::new(solver), engine, &tangent)?;
        remaining.shift(bounds, u);
        let root = (2.0 * stretched).sqrt();
        let mut gradient = vec![0.0; u.len()];
        copy_scaled(if root > 0.0 { -1.0 / root } else { 0.0 }, pull, &mut gradient);
        let (length, mut rhs) = (self.length(u), vec![0.0; u.len()]);
        RootSearch::default().run(root, |share| {
            waxpy(-share, &gradient, b, &mut rhs);
            let problem = Problem { matrix: &tangent, rhs: &rhs, bounds: remaining, length };
            solver.solve(engine, &problem, &mut Answer { x: answer.x, reaction: answer.reaction })?;
            Ok(engine.dot(&gradient, answer.x)? - share)
        })?;
        Ok(())
    }
}
