//! Bound-constrained problem of a step: its solvers, and the check that accepts their answers.
//!
//! Every step of every scheme finds x and the reactions r such that
//!
//! ```math
//! A x = b + G^T r, \qquad l \le G x \le u, \qquad
//! r \ge 0 \text{ at } l,\; r \le 0 \text{ at } u,\; r = 0 \text{ between},
//! ```
//!
//! where A is symmetric positive definite and the same for a whole run. Bounds may yield, see
//! [`obstacle`](crate::obstacle): there r is a function of x. [`CheckedSolver::solve`]
//! gives the problem to a [`Solver`] and measures the answer by [`kkt`], whatever the solver
//! reports about itself.

mod active_set;
pub mod compliance;
pub mod condensed;
mod hertz;
pub mod kkt;
pub mod registry;
#[cfg(feature = "petsc")]
pub mod scaled;
#[cfg(feature = "petsc")]
pub mod snes;
#[cfg(feature = "petsc")]
pub mod tao;

pub use active_set::{BoundStatus, DenseProblem};
pub use compliance::{ComplianceProblem, ComplianceSolver};
pub use condensed::Condensed;
pub use registry::ContactSolver;

use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, aypx};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use serde::{Deserialize, Serialize};

/// Bound-constrained problem of a step; see the [module page](self).
pub struct Problem<'a> {
    /// Matrix A as a weighted sum of forms.
    pub matrix: &'a LinearCombination<'a>,
    /// Right-hand side b, in N, one entry per dof.
    pub rhs: &'a [f64],
    /// Bounds l, u on G x, in m.
    pub bounds: &'a Bounds,
    /// Length scale of the deflections, against which gaps are measured, in m.
    pub length: f64,
}

/// Answer to a [`Problem`] or [`DenseProblem`].
pub struct Answer<'a> {
    /// Unknown x, in m for deflections, one entry per dof.
    pub x: &'a mut [f64],
    /// Reactions r, in N, one entry per bound.
    pub reaction: &'a mut [f64],
}

/// Solver of the bound-constrained problem, warm-started from its last answer.
pub trait Solver<E: Engine> {
    /// Solves for x and the reactions, one per bound. Returns the number of active-set or Newton
    /// iterations.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where a matrix cannot be factored. An answer that did not
    /// converge is not an error here, because [`CheckedSolver::solve`] measures it.
    fn solve(&mut self, engine: &E, problem: &Problem, answer: &mut Answer) -> Result<u32>;

    /// Returns the number of numeric factorisations so far.
    fn factorisations(&self) -> u64;

    /// Returns how many corrections by the residual an answer needs: none, unless rounding spoils
    /// the factored matrix.
    fn corrections(&self) -> u32 {
        0
    }

    /// Saves or restores all that the next answer depends on, so that a resumed run is bitwise
    /// identical. Only a solver that has not solved anything yet can be restored.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the archive does not fit and [`Error::Singular`] where a
    /// matrix cannot be factored.
    fn archive(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        archive: &mut Archive,
    ) -> Result<()>;

    /// Returns the KKT residual above which an answer is tried again with [`Solver::retry`].
    fn tolerance(&self) -> f64 {
        f64::INFINITY
    }

    /// Solves the same problem again by a safer method, the next one for each `attempt` from 0 on.
    /// Returns `None` if there is none left.
    ///
    /// # Errors
    /// Returns the errors of [`Solver::solve`].
    fn retry(
        &mut self,
        attempt: u32,
        engine: &E,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<Option<u32>> {
        let _ = (attempt, engine, problem, answer);
        Ok(None)
    }
}

/// Function that creates a solver from an engine, the matrix of a step and a number of bounds.
pub type SolverFactory<E> = dyn Fn(&E, &LinearCombination, usize) -> Result<Box<dyn Solver<E>>>;

/// Report on a solved step.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct StepReport {
    /// Iterations of the solver; 0 where nothing touched.
    pub iterations: u32,
    /// Relative KKT residual, dimensionless.
    pub kkt: f64,
    /// Number of attempts after the first one, by safer methods.
    pub retries: u32,
}

impl StepReport {
    /// Combines the reports of two successive solves: the total of iterations and retries, and the
    /// larger residual.
    pub fn and(self, other: StepReport) -> StepReport {
        let worse = other.kkt > self.kkt || other.kkt.is_nan();
        StepReport {
            iterations: self.iterations + other.iterations,
            kkt: if worse { other.kkt } else { self.kkt },
            retries: self.retries + other.retries,
        }
    }
}

/// Relative energy-norm error of an answer below which it needs no correction, dimensionless.
const MAX_FACTOR_ERROR: f64 = 3e-11;
/// Relative energy-norm error of a solve above which corrections do not converge in practice,
/// dimensionless.
const MAX_CORRECTABLE_ERROR: f64 = 0.1;

/// Returns how many corrections bring the answers of a factor of `dofs` dofs with this relative
/// energy-norm error to an error of [`MAX_FACTOR_ERROR`].
fn corrections(error: f64, dofs: usize) -> Result<u32> {
    if error <= MAX_FACTOR_ERROR {
        return Ok(0);
    }
    if error > MAX_CORRECTABLE_ERROR || error.is_nan() {
        return Err(Error::Singular(format!(
            "the step matrix ({dofs} dofs) is singular to working precision; the cells may be too small for the plate"
        )));
    }
    Ok(((MAX_FACTOR_ERROR.ln() / error.ln()).ceil() - 1.0) as u32)
}

/// Computes y = A x.
fn apply<E: Engine>(
    engine: &E,
    matrix: &LinearCombination,
    x: &[f64],
    product: &mut [f64],
    y: &mut [f64],
) -> Result<()> {
    y.fill(0.0);
    for (scale, form) in matrix.terms() {
        engine.multiply(form, x, product)?;
        axpy(*scale, product, y);
    }
    Ok(())
}

/// Solver together with the check of its answers.
pub struct CheckedSolver<E: Engine> {
    solver: Box<dyn Solver<E>>,
    check: kkt::KktCheck,
    correction: Correction,
}

/// Problem that a correction solves: the residual of an answer, and the bounds relative to it.
#[derive(Debug, Default)]
struct Correction {
    product: Vec<f64>,
    /// Residual b - A x, in N, one entry per dof.
    residual: Vec<f64>,
    bounds: Bounds,
    x: Vec<f64>,
}

impl<E: Engine> CheckedSolver<E> {
    /// Pairs a solver with the check of problems that have this matrix.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new(
        solver: Box<dyn Solver<E>>,
        engine: &E,
        matrix: &LinearCombination,
    ) -> Result<CheckedSolver<E>> {
        Ok(CheckedSolver {
            solver,
            check: kkt::KktCheck::new(engine, matrix)?,
            correction: Correction::default(),
        })
    }

    /// Solves a step and measures the answer; safer methods follow until the solver's tolerance is
    /// met or none is left.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where a matrix cannot be factored.
    pub fn solve(&mut self, engine: &E, problem: &Problem, answer: &mut Answer) -> Result<StepReport> {
        let mut iterations = self.solver.solve(engine, problem, answer)?;
        for _ in 0..self.solver.corrections() {
            iterations += self.correct(None, engine, problem, answer)?;
        }
        let kkt = self.check.residual(engine, problem, &[], answer)?;
        let mut report = StepReport { iterations, kkt, retries: 0 };
        while report.kkt.is_nan() || report.kkt > self.solver.tolerance() {
            let attempt = report.retries;
            let retried = self.solver.retry(attempt, engine, problem, answer)?;
            let Some(iterations) = retried else { break };
            report.retries += 1;
            report.iterations += iterations;
            for _ in 0..self.solver.corrections() {
                report.iterations += self.correct(Some(attempt), engine, problem, answer)?;
            }
            report.kkt = self.check.residual(engine, problem, &[], answer)?;
        }
        Ok(report)
    }

    /// Solves for the residual problem of x, with A applied cell by cell, and adds the solution to
    /// x.
    ///
    /// `attempt` names the retry whose answer x is, and the same method then solves the correction.
    /// An answer that is not finite stays unchanged.
    fn correct(
        &mut self,
        attempt: Option<u32>,
        engine: &E,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<u32> {
        let Answer { x, reaction } = answer;
        let Correction { product, residual, bounds, x: increment } = &mut self.correction;
        [&mut *product, residual, increment].into_iter().for_each(|v| v.resize(x.len(), 0.0));
        apply(engine, problem.matrix, x, product, residual)?;
        aypx(-1.0, problem.rhs, residual);
        let is_answer = residual.iter().all(|r| r.is_finite());
        if !engine.comm().all_reduce_all(is_answer) {
            return Ok(0);
        }
        bounds.clone_from(problem.bounds);
        bounds.shift(problem.bounds, |dof, bound| bound - x[dof]);
        let problem = Problem { rhs: residual, bounds, ..*problem };
        let mut correction = Answer { x: increment, reaction };
        let solved = match attempt {
            None => Some(self.solver.solve(engine, &problem, &mut correction)?),
            Some(attempt) => self.solver.retry(attempt, engine, &problem, &mut correction)?,
        };
        let Some(iterations) = solved else { return Ok(0) };
        add(increment, x);
        Ok(iterations)
    }

    /// Returns the number of numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }

    /// Saves or restores the solver, like [`Solver::archive`].
    ///
    /// # Errors
    /// Returns the errors of [`Solver::archive`].
    pub fn archive(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        archive: &mut Archive,
    ) -> Result<()> {
        self.solver.archive(engine, matrix, bounds, archive)
    }
}
