//! Static equilibrium of a plate that stretches, on its mesh.
//!
//! The energy is `$\tfrac12 U^T K U + V(U) - F^T U$` within the bounds. Each step minimises the model
//!
//! ```math
//! \tfrac12 x^T (K + K_G + g g^T)\, x - (F - K U - V')^T x, \qquad l \le G (U + x) \le u,
//! ```
//!
//! with the geometric stiffness K_G of the membrane force at U and `$g = V' / \sqrt{2 V}$`. Along U,
//! where V grows with the fourth power, this is the second derivative of V; elsewhere it leaves out
//! how the membrane force changes. A search along the step finds an energy that is lower.

use super::Equilibrium;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, copy_scaled, scale, waxpy};
use crate::linalg::{Engine, Form};
use crate::obstacle::Bounds;
use crate::scheme::drive::StretchingEnergy;
use crate::scheme::quadratisation::RootSearch;
use crate::vi::kkt::KktCheck;
use crate::vi::{Answer, CheckedSolver, Condensed, Problem, StepReport};

/// Largest number of steps, and of halvings of one.
const STEPS: u32 = 200;
const HALVINGS: i32 = 30;

/// KKT residual at which the search ends, and the one up to which it may stall.
const SETTLED: f64 = 1e-13;
const STALLED: f64 = 1e-10;

/// Rounding error of an energy, relative to its parts.
const ROUNDING: f64 = 1e-14;

/// Plate that stretches, under a load.
pub struct StretchedPlate<'p, E: Engine> {
    /// Linear algebra backend.
    pub engine: &'p E,
    /// Stiffness K.
    pub stiffness: &'p Form,
    /// Energy V of stretching.
    pub stretching: &'p dyn StretchingEnergy,
    /// Geometric stiffness K_G of the membrane force at a displacement.
    pub geometric: &'p dyn Fn(&[f64]) -> Result<Form>,
    /// Load F, in N, one entry per dof.
    pub load: &'p [f64],
    /// Bounds on the deflections, in m.
    pub bounds: &'p Bounds,
}

impl<E: Engine + 'static> StretchedPlate<'_, E> {
    /// Finds the equilibrium from an admissible displacement on (m, one entry per dof). Returns U
    /// (m), r (N) and the accuracy by the KKT residual of the nonlinear problem. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Unfinished`] where the search ends elsewhere, and the errors of the engine.
    pub fn equilibrium(&self, start: Vec<f64>) -> Result<Equilibrium> {
        let StretchedPlate { engine, stiffness, bounds, .. } = *self;
        let alone = stiffness.into();
        let mut check = KktCheck::new(engine, &alone)?;
        let mut u = start;
        let (mut pull, mut x) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        let (mut b, mut reaction) = (vec![0.0; u.len()], vec![0.0; bounds.len()]);
        let mut remaining = bounds.clone();
        let mut last = f64::INFINITY;
        for iterations in 0..STEPS {
            let stretched = self.stretching.evaluate(&u, &mut pull)?;
            scale(-1.0, &mut pull);
            let length = engine.comm().all_reduce_max(bounds.magnitude().max(bounds.largest(&u)));
            let problem = Problem { matrix: &alone, rhs: self.load, bounds, length };
            let answer = Answer { x: &mut u, reaction: &mut reaction };
            let kkt = check.residual(engine, &problem, &[&pull], &answer)?;
            if kkt <= SETTLED || kkt <= STALLED && kkt > 0.9 * last {
                let report = StepReport { iterations, kkt, retries: 0 };
                return Ok((u, reaction, report));
            }
            last = kkt;
            // b = F - K U - V'
            let bent = engine.multiply(stiffness, &u, &mut b)?;
            b.iter_mut().zip(self.load.iter().zip(&pull)).for_each(|(b, (load, pull))| *b = load - *b + pull);
            let least = 0.5 * bent + self.energy_beyond(&u, stretched)?;
            self.step(
                [&b, &pull],
                stretched,
                &u,
                &mut remaining,
                &mut Answer { x: &mut x, reaction: &mut reaction },
            )?;
            // At the end rounding of these terms hides the descent.
            let most = least + ROUNDING * (0.5 * bent + stretched + engine.dot(self.load, &u)?.abs());
            let mut moved = u.clone();
            let mut lengths = (0..HALVINGS).map(|k| 0.5_f64.powi(k));
            let next = lengths.try_fold((), |(), length| {
                moved.copy_from_slice(&u);
                axpy(length, &x, &mut moved);
                match self.energy(&moved) {
                    Ok(energy) if energy <= most => Err(Ok(())),
                    Ok(_) => Ok(()),
                    Err(error) => Err(Err(error)),
                }
            });
            if let Err(descends) = next {
                descends?;
                u = moved;
            }
        }
        Err(Error::Unfinished("initial: no equilibrium of the plate that stretches was reached".into()))
    }

    /// Returns the energy of a displacement, in J. Collective.
    fn energy(&self, u: &[f64]) -> Result<f64> {
        let mut product = vec![0.0; u.len()];
        let stretched = self.stretching.evaluate(u, &mut product)?;
        let bent = self.engine.multiply(self.stiffness, u, &mut product)?;
        Ok(0.5 * bent + self.energy_beyond(u, stretched)?)
    }

    /// Returns the energy besides bending, given the one of stretching, in J. Collective.
    fn energy_beyond(&self, u: &[f64], stretched: f64) -> Result<f64> {
        let stored = self.bounds.stored_energy(|bound| u[self.bounds.dofs[bound]]);
        Ok(stretched + self.engine.comm().all_reduce_sum(stored) - self.engine.dot(self.load, u)?)
    }

    /// Minimises the model at a displacement, given b and -V', both in N, and V, in J.
    fn step(
        &self,
        [b, pull]: [&[f64]; 2],
        stretched: f64,
        u: &[f64],
        remaining: &mut Bounds,
        answer: &mut Answer,
    ) -> Result<()> {
        let StretchedPlate { engine, bounds, .. } = *self;
        let geometric = (self.geometric)(u)?;
        let tangent = self.stiffness + &geometric;
        let solver = Condensed::new(engine, &tangent, bounds.len())?;
        let mut solver = CheckedSolver::new(Box::new(solver), engine, &tangent)?;
        remaining.shift(bounds, u);
        let root = (2.0 * stretched).sqrt();
        let mut gradient = vec![0.0; u.len()];
        copy_scaled(if root > 0.0 { -1.0 / root } else { 0.0 }, pull, &mut gradient);
        let length = engine.comm().all_reduce_max(bounds.magnitude().max(bounds.largest(u)));
        let mut rhs = vec![0.0; u.len()];
        RootSearch::default().run(root, |share| {
            waxpy(-share, &gradient, b, &mut rhs);
            let problem = Problem { matrix: &tangent, rhs: &rhs, bounds: remaining, length };
            solver.solve(engine, &problem, &mut Answer { x: answer.x, reaction: answer.reaction })?;
            Ok(engine.dot(&gradient, answer.x)? - share)
        })?;
        Ok(())
    }
}
