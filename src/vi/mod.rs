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
use crate::error::{Error, Result};
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

    /// How often an answer is to be corrected by the residual it leaves: where rounding spoils the factored matrix.
    fn corrections(&self) -> u32 {
        0
    }

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

/// Error of an answer, in the norm of the energy, that needs no correction.
const SPOILT: f64 = 3e-11;
/// Error from which on corrections lead nowhere.
const LOST: f64 = 0.1;

/// How many corrections bring answers of a factor to [`SPOILT`].
fn corrections<E: Engine>(engine: &E, sum: &Sum<E>, factor: &mut E::Factor) -> Result<u32> {
    let spoilt = engine.spoilt(sum, factor)?;
    if spoilt <= SPOILT {
        return Ok(0);
    }
    if spoilt > LOST || spoilt.is_nan() {
        return Err(Error::Singular(format!(
            "rounding takes the matrix of {} dofs apart: it is singular, or its cells are too small for what they make up",
            engine.dofs()
        )));
    }
    Ok(((SPOILT.ln() / spoilt.ln()).ceil() - 1.0) as u32)
}

/// y = A x for a sum of forms.
fn apply<E: Engine>(engine: &E, sum: &Sum<E>, x: &[f64], product: &mut [f64], y: &mut [f64]) -> Result<()> {
    y.fill(0.0);
    for (scale, form) in sum {
        engine.multiply(form, x, product)?;
        for (y, p) in y.iter_mut().zip(product.iter()) {
            *y += scale * p;
        }
    }
    Ok(())
}

/// A solver and its judge.
pub struct Step<E: Engine> {
    solver: Box<dyn Solver<E>>,
    judge: kkt::Judge,
    correction: Correction,
}

/// What is left of a problem, and what it adds to the answer.
#[derive(Debug, Default)]
struct Correction {
    product: Vec<f64>,
    b: Vec<f64>,
    bounds: Bounds,
    x: Vec<f64>,
}

impl<E: Engine> Step<E> {
    /// Puts a solver of problems with the matrix of this sum under judgement.
    ///
    /// # Errors
    /// What the engine says.
    pub fn new(solver: Box<dyn Solver<E>>, engine: &E, sum: &Sum<E>) -> Result<Step<E>> {
        Ok(Step { solver, judge: kkt::Judge::new(engine, sum)?, correction: Correction::default() })
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
        let mut iterations = self.solver.solve(engine, sum, b, bounds, x, reaction)?;
        for _ in 0..self.solver.corrections() {
            iterations += self.correct(None, engine, sum, b, bounds, x, reaction)?;
        }
        let kkt = self.judge.residual(engine, sum, &[b], bounds, length, x, reaction)?;
        let mut verdict = Verdict { iterations, kkt, retries: 0 };
        while verdict.kkt.is_nan() || verdict.kkt > self.solver.tolerance() {
            let attempt = verdict.retries;
            let retried = self.solver.retry(attempt, engine, sum, b, bounds, x, reaction)?;
            let Some(iterations) = retried else { break };
            verdict.retries += 1;
            verdict.iterations += iterations;
            for _ in 0..self.solver.corrections() {
                verdict.iterations += self.correct(Some(attempt), engine, sum, b, bounds, x, reaction)?;
            }
            verdict.kkt = self.judge.residual(engine, sum, &[b], bounds, length, x, reaction)?;
        }
        Ok(verdict)
    }

    /// Solves for what x leaves of the problem, with A applied cell by cell, and adds it; in the way of an attempt, if x is its answer.
    /// An answer that is none is left as it is.
    fn correct(
        &mut self,
        attempt: Option<u32>,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<u32> {
        let Correction { product, b: left, bounds: within, x: more } = &mut self.correction;
        [&mut *product, left, more].into_iter().for_each(|v| v.resize(x.len(), 0.0));
        apply(engine, sum, x, product, left)?;
        left.iter_mut().zip(b).for_each(|(left, b)| *left = b - *left);
        let is_answer = left.iter().all(|left| left.is_finite());
        if engine.maximum(f64::from(u8::from(!is_answer)))? > 0.0 {
            return Ok(0);
        }
        within.clone_from(bounds);
        within.shift(bounds, |dof, bound| bound - x[dof]);
        let solved = match attempt {
            None => Some(self.solver.solve(engine, sum, left, within, more, reaction)?),
            Some(attempt) => self.solver.retry(attempt, engine, sum, left, within, more, reaction)?,
        };
        let Some(iterations) = solved else { return Ok(0) };
        x.iter_mut().zip(more).for_each(|(x, more)| *x += *more);
        Ok(iterations)
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
