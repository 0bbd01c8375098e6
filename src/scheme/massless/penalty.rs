//! Stiffness with a penalty on the means over cells.

use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{divide, scale, subtract};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::random::golden_vector;
use crate::scheme::System;
use crate::vi::{Answer, Condensed, Problem, Solver};

/// Penalty s relative to the square of the highest angular frequency: target and accepted range.
const PENALTY: f64 = 1e4;
const PENALTY_RANGE: std::ops::Range<f64> = 1e3..1e6;

/// Square of the highest angular frequency relative to the harmonic mean of the ratios of the
/// diagonals of K and M, between 3 and 1600 on grids.
const OF_DIAGONALS: f64 = 30.0;

/// Largest number of attempts at a penalty, and power iterations of each; the order of magnitude
/// suffices.
const MAX_ATTEMPTS: usize = 8;
const POWER_ITERATIONS: usize = 6;

/// Ratio of a motion's strain to the strain of its parts below which it counts as rigid. On a few
/// cells all motions with inertia may be rigid; no highest frequency exists then, and the first
/// penalty is used. Cells n times as long as wide have ratios of n^-2; rounding is below 1e-12.
const RIGID: f64 = 1e-10;

/// Matrix K + s M with its factor; see [`super::potential`].
pub(in crate::scheme) struct PenalisedStiffness<'s> {
    /// Penalty s, in 1/s^2.
    pub penalty: f64,
    pub sum: LinearCombination<'s>,
    pub solver: Condensed,
    /// Number of factorisations beside the one of the solver.
    pub factorisations: u64,
}

impl<'s> PenalisedStiffness<'s> {
    /// Chooses the penalty and factors K + s M. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where K + s M is not positive definite or the highest frequency
    /// cannot be estimated.
    pub fn new<E: Engine>(system: &'s System<E>) -> Result<PenalisedStiffness<'s>> {
        let System { engine, stiffness, mass, bounds, .. } = system;
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        let (mut b, mut x) = (vec![0.0; dofs], vec![0.0; dofs]);
        let mut projected = vec![0.0; velocities];
        // The diagonals give the first guess of the highest frequency, the same on any number of
        // ranks; each factor then yields an estimate.
        let alone = LinearCombination::from(stiffness);
        let [of_stiffness, of_mass] = [engine.diagonal(&alone)?, engine.diagonal(&mass.into())?];
        let ratio = |(k, m): (&f64, &f64)| if *k > 0.0 { [1.0, m / k] } else { [0.0; 2] };
        let ratios = of_stiffness.iter().zip(&of_mass).map(ratio);
        let sums = ratios.fold([0.0; 2], |sums, ratio| [sums[0] + ratio[0], sums[1] + ratio[1]]);
        let [count, sum] = engine.comm().all_reduce_sum(sums);
        let first = PENALTY * OF_DIAGONALS * count / sum;
        let (mut penalty, mut all_rigid) = (first, false);
        let (mut sizes, mut factorisations) = (vec![0.0; dofs], 0);
        for _ in 0..MAX_ATTEMPTS {
            let sum = stiffness + mass * penalty;
            let mut solver = Condensed::new(engine, &sum, bounds.len())?;
            factorisations += 1;
            // The operator T = s C^-1 B (K + s M)^-1 B^T has the eigenvalues s / (w^2 + s) on
            // velocities that displacements can attain, and 0 on the others, such as a checkerboard
            // on a uniform grid held all around. T (1 - T) excludes the latter.
            let mut apply = |v: &[f64], image: &mut [f64]| -> Result<()> {
                engine.project_transpose(mass, v, &mut b)?;
                let problem = Problem { matrix: &sum, rhs: &b, bounds: &Bounds::default(), length: 0.0 };
                solver.solve(engine, &problem, &mut Answer { x: &mut x, reaction: &mut [] })?;
                engine.project(mass, &x, image)?;
                scale(penalty, image);
                Ok(())
            };
            let mut velocity = golden_vector(velocities);
            let mut largest = 0.0;
            for _ in 0..POWER_ITERATIONS {
                let norm = engine.mass_norm_squared(mass, &velocity)?.sqrt();
                if norm == 0.0 {
                    break;
                }
                divide(norm, &mut velocity);
                apply(&velocity, &mut projected)?;
                subtract(&projected, &mut velocity);
                apply(&velocity, &mut projected)?;
                std::mem::swap(&mut velocity, &mut projected);
                largest = engine.mass_norm_squared(mass, &velocity)?.sqrt();
            }
            // Rayleigh quotient of the displacement with this velocity.
            engine.multiply_with_magnitude(&alone, &x, [&mut b, &mut sizes])?;
            let elastic = engine.multiply(stiffness, &x, &mut b)?;
            x.iter_mut().for_each(|x| *x = x.abs());
            all_rigid |= elastic <= RIGID * RIGID * engine.dot(&x, &sizes)?;
            let fastest = elastic * (penalty / largest).powi(2);
            if all_rigid && penalty == first || PENALTY_RANGE.contains(&(penalty / fastest)) {
                return Ok(PenalisedStiffness { penalty, sum, solver, factorisations: factorisations - 1 });
            }
            penalty = if all_rigid { first } else { PENALTY * fastest };
            if !(penalty.is_finite() && penalty > 0.0) {
                break;
            }
        }
        Err(Error::Singular("the highest natural frequency cannot be estimated".into()))
    }

    /// Solves (K + s M) x = b in place, given the bounds that the solver has. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn solve(&mut self, bounds: &Bounds, x: &mut [f64]) -> Result<()> {
        self.solver.without_bounds(bounds, |solve| solve(x))
    }
}
