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
//! second derivative of V; elsewhere it leaves out how the membrane force changes. A search along
//! the step finds an energy that is lower.
//!
//! A load that grows as the plate follows it has no equilibrium beyond some size: the plate is
//! *pulled in*. There the matrix stays indefinite. Steps then use the part of K_W that stiffens the
//! plate, and lead to an obstacle, if there is one.

use super::Equilibrium;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, copy_scaled, largest, scale, waxpy};
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

/// Numbers of steps with an indefinite matrix after which a plate without obstacles is pulled in:
/// of a search from any displacement, and of one from an equilibrium under less load.
const INDEFINITE: [u32; 2] = [20, 2];

/// KKT residual at which the search ends, and the one up to which it may stall.
const SETTLED: f64 = 1e-13;
const STALLED: f64 = 1e-10;

/// Step, relative to the deflections, at which the search may end, and the one at which it may
/// stall: a stiff plate on soft springs has small residuals long before.
const STILL: f64 = 1e-8;
const CREEPING: f64 = 1e-4;

/// KKT residual below which a rise of it shortens the steps, and the least part of a step.
const NEAR: f64 = 1e-4;
const LEAST_SHARE: f64 = 0.125;

/// Rounding error of an energy, relative to its parts.
const ROUNDING: f64 = 1e-14;

/// Relative accuracy of the load that pulls a plate in, and the largest one that is sought.
const PULL_IN: f64 = 1e-4;
const STRONGEST: f64 = 1e9;

/// Function that returns a part of a stiffness at a displacement (m), given a factor.
pub type TangentOf<'t> = dyn Fn(&[f64], f64, TangentPart) -> Result<Form> + 't;

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
    /// Stiffness `$K_G + K_W$` at a displacement, or a part of it, given the factor of K_W.
    pub tangent: &'p TangentOf<'p>,
    /// Load F, in N, one entry per dof.
    pub load: &'p [f64],
    /// Bounds on the deflections, in m.
    pub bounds: &'p Bounds,
}

/// Part of the stiffness `$K_G + K_W$`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TangentPart {
    /// All of it.
    Whole,
    /// K_G, and K_W where it stiffens the plate.
    Hardening,
    /// K_W where it stiffens the plate.
    Supporting,
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
        self.search(start, INDEFINITE[0])
    }

    /// Finds the equilibrium in a search that ends after so many steps with an indefinite matrix,
    /// where there are no obstacles.
    fn search(&self, start: Vec<f64>, most_indefinite: u32) -> Result<Equilibrium> {
        let NonlinearPlate { engine, stiffness, bounds, .. } = *self;
        let alone = stiffness.into();
        let mut check = KktCheck::new(engine, &alone)?;
        let mut u = start;
        let (mut x, mut b) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let mut reaction = vec![0.0; bounds.len()];
        let (mut residuals, mut moves, mut indefinite) = ([f64::INFINITY; 2], [f64::INFINITY; 3], 0);
        let mut longest = 1.0;
        for iterations in 0..STEPS {
            let now = self.sample(&u)?;
            let length = self.length(&u);
            let problem = Problem { matrix: &alone, rhs: self.load, bounds, length };
            let answer = Answer { x: &mut u, reaction: &mut reaction };
            let kkt = check.residual(engine, &problem, &[&now.force], &answer)?;
            // Steps and residuals fall by turns: the last but one tells whether they still do.
            let ([last, earlier], [step, _, before]) = (residuals, moves);
            let rests = step <= STILL * length || step <= CREEPING * length && step > 0.5 * before;
            if rests && (kkt <= SETTLED || kkt <= STALLED && kkt > 0.9 * earlier) {
                return Ok((u, reaction, StepReport { iterations, kkt, retries: 0 }));
            }
            // Where rounding hides the energy, residuals tell that the model is too soft.
            if kkt > last && kkt <= NEAR && self.following.is_none() {
                longest = LEAST_SHARE.max(0.5 * longest);
            }
            residuals = [kkt, last];
            // b = F - K U + W' - V'
            let bent = engine.multiply(stiffness, &u, &mut b)?;
            b.iter_mut()
                .zip(self.load.iter().zip(&now.force))
                .for_each(|(b, (load, force))| *b = load - *b + force);
            let pushed = engine.dot(self.load, &u)?;
            let least = 0.5 * bent + now.stretched - now.work - pushed + self.stored(&u);
            // At the end rounding of these terms hides the descent.
            let most = least + ROUNDING * (0.5 * bent + now.stretched + now.work.abs() + pushed.abs());
            let mut answer = Answer { x: &mut x, reaction: &mut reaction };
            for part in [TangentPart::Whole, TangentPart::Hardening, TangentPart::Supporting] {
                match self.step(&b, &now, &u, part, &mut answer) {
                    Err(Error::Singular(_)) if part != TangentPart::Supporting => {}
                    solved => {
                        solved?;
                        indefinite += u32::from(part != TangentPart::Whole && self.following.is_some());
                        break;
                    }
                }
            }
            if indefinite > most_indefinite && engine.comm().all_reduce_all(bounds.is_empty()) {
                break;
            }
            moves = [engine.comm().all_reduce_max(largest(x.iter().copied())), moves[0], moves[1]];
            let mut moved = u.clone();
            let reach = self.following.map_or(Ok(1.0), |following| following.reach(0.0, &u, &x))?;
            let mut descends = false;
            for length in (0..HALVINGS).map(|k| reach.min(longest) * 0.5_f64.powi(k)) {
                moved.copy_from_slice(&u);
                axpy(length, &x, &mut moved);
                // Beyond an electrode the load has no value.
                let energy = self.energy(&moved);
                descends = energy.as_ref().is_ok_and(|energy| *energy <= most);
                if descends || self.following.is_none() && energy.is_err() {
                    energy?;
                    break;
                }
            }
            if !descends {
                break;
            }
            u.copy_from_slice(&moved);
        }
        Err(Error::Unfinished("initial: no equilibrium of the plate was reached".into()))
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
        let rests = |share: f64, from: &mut Vec<f64>| match (NonlinearPlate { share, bounds: &free, ..*self })
            .search(from.clone(), INDEFINITE[1])
        {
            Ok((u, _, _)) => {
                *from = u;
                Ok(true)
            }
            Err(Error::Unfinished(_) | Error::Singular(_) | Error::Scene(_)) => Ok(false),
            Err(error) => Err(error),
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

    /// Minimises the model at a displacement, given b, in N.
    fn step(
        &self,
        b: &[f64],
        Sample { pull, stretched, .. }: &Sample,
        u: &[f64],
        part: TangentPart,
        answer: &mut Answer,
    ) -> Result<()> {
        let NonlinearPlate { engine, bounds, .. } = *self;
        let tangent = (self.tangent)(u, self.share, part)?;
        let tangent = self.stiffness + &tangent;
        let solver = Condensed::new(engine, &tangent, bounds.len())?;
        let mut solver = CheckedSolver::new(Box::new(solver), engine, &tangent)?;
        let mut remaining = bounds.clone();
        remaining.shift(bounds, u);
        let root = (2.0 * stretched).sqrt();
        let mut gradient = vec![0.0; u.len()];
        copy_scaled(if root > 0.0 { -1.0 / root } else { 0.0 }, pull, &mut gradient);
        let (length, mut rhs) = (self.length(u), vec![0.0; u.len()]);
        RootSearch::default().run(root, |share| {
            waxpy(-share, &gradient, b, &mut rhs);
            let problem = Problem { matrix: &tangent, rhs: &rhs, bounds: &remaining, length };
            solver.solve(engine, &problem, &mut Answer { x: answer.x, reaction: answer.reaction })?;
            Ok(engine.dot(&gradient, answer.x)? - share)
        })?;
        Ok(())
    }
}
