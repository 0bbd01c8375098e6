//! The bound-constrained problem of a step, in one verb.
//!
//! Every step of every scheme is: find x and the reactions r such that
//! \[ A x = b + G^T r, \qquad l \le G x \le u, \qquad r \ge 0 \text{ at } l,\; r \le 0 \text{ at } u,\; r = 0 \text{ between}, \]
//! with A symmetric positive definite and the same for a whole run. [`Step::solve`] hands it to a [`Solver`] and has
//! the answer judged by [`kkt`], whatever the solver says of itself.

mod active_set;
pub mod condensed;
pub mod kkt;
#[cfg(feature = "petsc")]
pub mod scaled;
#[cfg(feature = "petsc")]
pub mod snes;
#[cfg(feature = "petsc")]
pub mod tao;

pub use active_set::{Side, dense};
pub use condensed::Condensed;

use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;
use serde::{Deserialize, Serialize};

/// A solver of the bound-constrained problem, warm-started from its last answer.
pub trait Solver<E: Engine> {
    /// Solves for x and the reactions (one a bound). Returns the number of active-set or Newton iterations.
    ///
    /// # Errors
    /// Where a matrix cannot be factored. An answer that did not converge is no error here: it is judged outside.
    fn solve(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<u32>;

    /// Numeric factorisations so far.
    fn factorisations(&self) -> u64;

    /// Shows an archive all that its next answer depends on, down to the last digit. Restores a solver that has not solved anything yet.
    ///
    /// # Errors
    /// [`crate::Error::Checkpoint`], and where a matrix cannot be factored.
    fn state(&mut self, engine: &E, sum: &Sum<E>, bounds: &Bounds, archive: &mut Archive) -> Result<()>;

    /// Residual above which an answer is worth another attempt with [`Solver::retry`].
    fn tolerance(&self) -> f64 {
        f64::INFINITY
    }

    /// Solves the same problem again in the next safer way, from attempt 0 on; `None` if there is none left.
    ///
    /// # Errors
    /// As [`Solver::solve`].
    fn retry(
        &mut self,
        attempt: u32,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<Option<u32>> {
        let _ = (attempt, engine, sum, b, bounds, x, reaction);
        Ok(None)
    }
}

/// Makes the solver of a matrix and a number of bounds.
pub type SolverFactory<E> = dyn Fn(&E, &Sum<E>, usize) -> Result<Box<dyn Solver<E>>>;

/// What a solved step has to say.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct Verdict {
    /// Iterations of the solver; 0 where nothing touched.
    pub iterations: u32,
    /// Relative KKT residual, dimensionless.
    pub kkt: f64,
    /// Attempts after the first one, in safer ways.
    pub retries: u32,
}

impl Verdict {
    /// What two solves in a row have to say: all iterations, the worse residual.
    pub fn and(self, other: Verdict) -> Verdict {
        let worse = other.kkt > self.kkt || other.kkt.is_nan();
        Verdict {
            iterations: self.iterations + other.iterations,
            kkt: if worse { other.kkt } else { self.kkt },
            retries: self.retries + other.retries,
        }
    }
}

/// A solver and its judge.
pub struct Step<E: Engine> {
    solver: Box<dyn Solver<E>>,
    judge: kkt::Judge,
}

impl<E: Engine> Step<E> {
    /// Puts a solver of problems with the matrix of this sum under judgement.
    ///
    /// # Errors
    /// What the engine says.
    pub fn new(solver: Box<dyn Solver<E>>, engine: &E, sum: &Sum<E>) -> Result<Step<E>> {
        Ok(Step { solver, judge: kkt::Judge::new(engine, sum)? })
    }

    /// Solves and judges; where the solver knows safer ways, they follow until its tolerance is met. `length` is the scale of the deflection, in m, that gaps are measured against.
    ///
    /// # Errors
    /// Where a matrix cannot be factored.
    pub fn solve(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        length: f64,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<Verdict> {
        let iterations = self.solver.solve(engine, sum, b, bounds, x, reaction)?;
        let kkt = self.judge.residual(engine, sum, &[b], bounds, length, x, reaction)?;
        let mut verdict = Verdict { iterations, kkt, retries: 0 };
        while verdict.kkt.is_nan() || verdict.kkt > self.solver.tolerance() {
            let retried = self.solver.retry(verdict.retries, engine, sum, b, bounds, x, reaction)?;
            let Some(iterations) = retried else { break };
            verdict.retries += 1;
            verdict.iterations += iterations;
            verdict.kkt = self.judge.residual(engine, sum, &[b], bounds, length, x, reaction)?;
        }
        Ok(verdict)
    }

    /// Numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }

    /// As [`Solver::state`].
    ///
    /// # Errors
    /// As [`Solver::state`].
    pub fn state(&mut self, engine: &E, sum: &Sum<E>, bounds: &Bounds, archive: &mut Archive) -> Result<()> {
        self.solver.state(engine, sum, bounds, archive)
    }
}
