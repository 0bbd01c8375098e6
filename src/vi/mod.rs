//! Bound-constrained problem of a step: its solvers, and the check that accepts their answers.
//!
//! Every step of every scheme finds x and the reactions r such that
//!
//! ```math
//! A x = b + G^T r, \qquad l \le G x \le u, \qquad
//! r \ge 0 \text{ at } l,\; r \le 0 \text{ at } u,\; r = 0 \text{ between},
//! ```
//!
//! where A is symmetric positive definite and the same for a whole run. Bounds may yield by [laws
//! of contact](crate::contact_law): there r is a function of x. [`CheckedSolver::solve`]
//! gives the problem to a [`Solver`] and measures the answer by [`kkt`], whatever the solver
//! reports about itself.
//!
//! # Digits
//!
//! Rounding the entries of A costs as many digits as its condition number has: on fine meshes,
//! most digits of slow motions. Answers that lose too many are corrected by their residual,
//! at one solve each, or a scheme feeds their residuals forward, at some passes over vectors. Once
//! this has taken as long as a factorisation with twice the digits would, the matrix is factored
//! so. Both together then never take more than twice as long as the quicker one. Rounding the
//! entries of that factor costs only half as many digits, and its answers are not corrected.

mod active_set;
pub mod compliance;
pub mod condensed;
pub(crate) mod coulomb;
pub mod kkt;
mod laws;
pub mod registry;
#[cfg(feature = "petsc")]
pub mod scaled;
#[cfg(feature = "petsc")]
pub mod snes;
#[cfg(feature = "petsc")]
pub mod tao;

pub(crate) use active_set::SIGN_ROUNDINGS;
pub use active_set::{BoundStatus, DenseProblem};
pub use compliance::{ComplianceProblem, ComplianceSolver};
pub use condensed::Condensed;
pub use registry::ContactSolver;

use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, aypx};
use crate::linalg::{Engine, Form, LinearCombination, multiply_sum};
use crate::obstacle::Bounds;
use faer::Mat;
use serde::{Deserialize, Serialize};

/// Bound-constrained problem of a step; see the [module page](self).
pub struct Problem<'a> {
    /// Matrix A as a weighted sum of forms.
    pub matrix: &'a LinearCombination<'a>,
    /// Right-hand side b, in N, one entry per dof.
    pub rhs: &'a [f64],
    /// Bounds l, u on G x, in m.
    pub bounds: &'a Bounds,
    /// Length scale of the deflections, against which gaps are measured, in m. That of all ranks is
    /// the largest one.
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

    /// Solves A X = B in place without bounds, one system per column. Returns whether the factor is
    /// at hand, which it is not by default. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    fn solve_without_bounds(&mut self, x: &mut Mat<f64>) -> Result<bool> {
        let _ = x;
        Ok(false)
    }

    /// Returns the number of numeric factorisations so far.
    fn factorisations(&self) -> u64;

    /// Returns the relative energy-norm error of an answer caused by rounding the entries of the
    /// factored matrix, dimensionless; 0 where that needs no correction.
    fn factor_error(&self) -> f64 {
        0.0
    }

    /// Returns whether the matrix is factored with twice the digits.
    fn has_twice_the_digits(&self) -> bool {
        false
    }

    /// Returns the number of solves that take as long as [`Solver::add_digits`]; `None` where that
    /// is not possible.
    fn cost_of_digits(&self) -> Option<u32> {
        None
    }

    /// Factors the matrix again with twice the digits, where the memory for that is there.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn add_digits(&mut self, engine: &E, matrix: &LinearCombination) -> Result<()> {
        let _ = (engine, matrix);
        Ok(())
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
/// Relative energy-norm error of an answer up to which its residual may be fed forward into the
/// next steps in place of corrections, dimensionless: each factor is then good for six digits of
/// the residuals.
const MAX_FED_ERROR: f64 = 1e-6;
/// Number of steps whose feeding of residuals takes as long as one solve.
const FED_STEPS: u32 = 32;
/// Upper limit of the KKT residual that is reported in place of the residual, dimensionless.
const CLEAR_LIMIT: f64 = 1e-12;
/// Relative energy-norm error of a solve above which corrections do not converge in practice,
/// dimensionless.
const MAX_CORRECTABLE_ERROR: f64 = 0.1;

/// Returns how many corrections bring the answers of a factor with this relative energy-norm error
/// to an error of [`MAX_FACTOR_ERROR`].
fn corrections(error: f64) -> u32 {
    if error <= MAX_FACTOR_ERROR {
        return 0;
    }
    ((MAX_FACTOR_ERROR.ln() / error.ln()).ceil() - 1.0) as u32
}

/// Checks that corrections converge with a factor of `dofs` dofs and this relative energy-norm
/// error.
fn require_convergence(error: f64, dofs: usize) -> Result<()> {
    if error > MAX_CORRECTABLE_ERROR || error.is_nan() {
        return Err(Error::Singular(format!(
            "the step matrix ({dofs} dofs) is singular to working precision; the cells may be too small for the plate"
        )));
    }
    Ok(())
}

/// Solver together with the check of its answers.
pub struct CheckedSolver<E: Engine> {
    solver: Box<dyn Solver<E>>,
    check: kkt::KktCheck,
    /// Whether products with the matrix lose few digits.
    pub has_accurate_products: bool,
    /// Whether the caller feeds residuals forward, so that no answer needs a correction.
    feeds: bool,
    /// Time that corrections and feeding residuals have taken since digits were last added, or
    /// since the start. The unit is the feeding of one step's residuals, so that one
    /// correction takes [`FED_STEPS`].
    spent: u32,
    correction: Correction,
}

/// Product K x of an answer with the stiffness, which its check may give without further cost.
#[derive(Debug)]
pub struct StiffnessProduct<'a> {
    /// Stiffness K, one of the forms of the matrix.
    pub stiffness: &'a Form,
    /// Product K x, in N, one entry per dof.
    pub product: &'a mut [f64],
    /// Whether the last check gave the product.
    pub is_known: bool,
}

/// Problem that a correction solves: the residual of an answer, and the bounds relative to it.
#[derive(Debug, Default)]
struct Correction {
    product: Vec<f64>,
    /// Residual b - A x, in N, one entry per dof.
    residual: Vec<f64>,
    /// Residual A x - b - G^T r before the first correction of an answer, in N, one entry per dof;
    /// empty where there was none.
    uncorrected: Vec<f64>,
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
            check: kkt::KktCheck::new(engine, matrix)?,
            has_accurate_products: !solver.has_twice_the_digits() && solver.factor_error() <= MAX_FED_ERROR,
            feeds: false,
            spent: 0,
            correction: Correction::default(),
            solver,
        })
    }

    /// Returns whether rounding spoils the factored matrix, but so little that residuals fed
    /// forward take the place of corrections.
    pub fn may_feed(&self) -> bool {
        self.has_accurate_products && self.solver.factor_error() > MAX_FACTOR_ERROR
    }

    /// Sets whether the caller feeds residuals forward, so that no answer needs a correction.
    pub fn set_feeding(&mut self, feeds: bool) {
        self.feeds = feeds;
    }

    /// Returns the number of corrections that an answer needs.
    fn needed_corrections(&self) -> u32 {
        if self.feeds { 0 } else { corrections(self.solver.factor_error()) }
    }

    /// Solves a step like [`Solver::solve_without_bounds`] where an answer needs no correction.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn solve_without_bounds(&mut self, x: &mut Mat<f64>) -> Result<bool> {
        Ok(self.needed_corrections() == 0 && self.solver.solve_without_bounds(x)?)
    }

    /// Returns the largest KKT residual of a good answer.
    pub fn tolerance(&self) -> f64 {
        self.solver.tolerance()
    }

    /// Returns the residual A x - b - G^T r of the last answer, in N, one entry per dof.
    pub fn residual(&self) -> &[f64] {
        self.check.forces()
    }

    /// Returns the residual A x - b - G^T r of the last answer before its first correction, or
    /// without any correction, in N, one entry per dof.
    pub fn uncorrected_residual(&self) -> &[f64] {
        let Correction { uncorrected, .. } = &self.correction;
        if uncorrected.is_empty() { self.residual() } else { uncorrected }
    }

    /// Solves a problem and measures the answer; safer methods follow until the solver's tolerance
    /// is met or none is left.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where a matrix cannot be factored.
    pub fn solve(&mut self, engine: &E, problem: &Problem, answer: &mut Answer) -> Result<StepReport> {
        self.solve_step(engine, problem, &[], answer, None)
    }

    /// Solves a step like [`CheckedSolver::solve`].
    ///
    /// The answer is measured with `more`, further terms of the right-hand side that the solver
    /// leaves out. With a product to compute, the report may contain an upper limit of the residual
    /// in its place, of at most 1e-12.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where a matrix cannot be factored.
    pub fn solve_step(
        &mut self,
        engine: &E,
        problem: &Problem,
        more: &[&[f64]],
        answer: &mut Answer,
        mut product: Option<&mut StiffnessProduct>,
    ) -> Result<StepReport> {
        self.correction.uncorrected.clear();
        let mut iterations = self.solver.solve(engine, problem, answer)?;
        for _ in 0..self.needed_corrections() {
            iterations += self.correct(None, engine, problem, answer)?;
        }
        let kkt = self.measure(engine, problem, more, answer, product.as_deref_mut())?;
        let mut report = StepReport { iterations, kkt, retries: 0 };
        while report.kkt.is_nan() || report.kkt > self.solver.tolerance() {
            let attempt = report.retries;
            let retried = self.solver.retry(attempt, engine, problem, answer)?;
            let Some(iterations) = retried else { break };
            report.retries += 1;
            report.iterations += iterations;
            for _ in 0..self.needed_corrections() {
                report.iterations += self.correct(Some(attempt), engine, problem, answer)?;
            }
            report.kkt = self.measure(engine, problem, more, answer, product.as_deref_mut())?;
        }
        if report.kkt > self.solver.tolerance() {
            // Rounding of large rows remains in small ones; a correction removes it.
            let before = (answer.x.to_vec(), answer.reaction.to_vec());
            let iterations = self.correct(None, engine, problem, answer)?;
            let kkt = self.measure(engine, problem, more, answer, product.as_deref_mut())?;
            if kkt < report.kkt {
                (report.kkt, report.iterations) = (kkt, report.iterations + iterations);
            } else {
                answer.x.copy_from_slice(&before.0);
                answer.reaction.copy_from_slice(&before.1);
                self.measure(engine, problem, more, answer, product)?;
            }
        }
        self.spent = self.spent.saturating_add(u32::from(self.feeds));
        if self.spent > 0 && self.solver.cost_of_digits().is_some_and(|cost| self.spent / FED_STEPS >= cost) {
            self.spent = 0;
            self.solver.add_digits(engine, problem.matrix)?;
        }
        Ok(report)
    }

    /// Returns the KKT residual of an answer, or an upper limit where that is clear enough.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn measure(
        &mut self,
        engine: &E,
        problem: &Problem,
        more: &[&[f64]],
        answer: &Answer,
        product: Option<&mut StiffnessProduct>,
    ) -> Result<f64> {
        if let Some(StiffnessProduct { stiffness, product, is_known }) = product {
            let limit = self.check.limit(engine, problem, more, answer, (*stiffness, &mut **product))?;
            *is_known = limit.is_some();
            if let Some(limit) = limit.filter(|limit| *limit <= CLEAR_LIMIT) {
                return Ok(limit);
            }
        }
        self.check.residual(engine, problem, more, answer)
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
        let Correction { product, residual, uncorrected, bounds, x: increment } = &mut self.correction;
        [&mut *product, residual, increment].into_iter().for_each(|v| v.resize(x.len(), 0.0));
        multiply_sum(engine, problem.matrix, x, product, residual)?;
        aypx(-1.0, problem.rhs, residual);
        let is_answer = residual.iter().all(|r| r.is_finite());
        if !engine.comm().all_reduce_all(is_answer) {
            return Ok(0);
        }
        self.spent = self.spent.saturating_add(FED_STEPS);
        if uncorrected.is_empty() {
            uncorrected.extend(residual.iter().map(|r| -r));
            problem.bounds.dofs.iter().zip(&**reaction).for_each(|(&dof, r)| uncorrected[dof] -= r);
        }
        bounds.clone_from(problem.bounds);
        bounds.shift(problem.bounds, x);
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
        archive.value(&mut self.spent)?;
        self.solver.archive(engine, matrix, bounds, archive)
    }
}
