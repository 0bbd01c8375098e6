//! Conjugate gradients on an operator that is applied cell by cell, with a factor that rounding has
//! spoilt as the preconditioner.
//!
//! The assembled matrix of a fine mesh loses the stiffness of its few softest modes to rounding, so
//! that corrections by the residual no longer converge. To conjugate gradients these modes are a
//! few eigenvalues apart from all others, which are 1, and each costs one iteration.

use crate::error::Result;
use crate::linalg::vectors::{axpy, aypx, waxpy};
use crate::linalg::{Engine, Factor, Form};

/// Largest number of iterations per restart; a factor that needs more is no preconditioner.
const MOST_ITERATIONS: usize = 100;

/// Number of restarts from the residual of the answer so far, which removes what rounding added to
/// the recurrences.
const RESTARTS: usize = 2;

/// Relative size of the residual, in the norm of the preconditioner, at which iterations end.
const REDUCTION: f64 = 1e-8;

/// Solves A x = b, with `factor` an approximate factor of A. Returns `None` where the iterations do
/// not converge. Collective.
///
/// # Errors
/// Returns the errors of the engine and of the factor.
pub(super) fn solve<E: Engine>(
    engine: &E,
    matrix: &Form,
    factor: &mut dyn Factor,
    b: &[f64],
) -> Result<Option<Vec<f64>>> {
    let mut x = vec![0.0; b.len()];
    let (mut residual, mut product) = (b.to_vec(), vec![0.0; b.len()]);
    for _ in 0..=RESTARTS {
        let Some(correction) = descend(engine, matrix, factor, &residual)? else { return Ok(None) };
        axpy(1.0, &correction, &mut x);
        engine.multiply(matrix, &x, &mut product)?;
        waxpy(-1.0, &product, b, &mut residual);
    }
    Ok(Some(x))
}

/// Solves A x = b from x = 0 by one sequence of conjugate gradients.
fn descend<E: Engine>(
    engine: &E,
    matrix: &Form,
    factor: &mut dyn Factor,
    b: &[f64],
) -> Result<Option<Vec<f64>>> {
    let mut x = vec![0.0; b.len()];
    let (mut residual, mut product) = (b.to_vec(), vec![0.0; b.len()]);
    let mut direction = vec![0.0; b.len()];
    let (mut first, mut last) = (0.0, f64::INFINITY);
    for iteration in 0..MOST_ITERATIONS {
        let mut preconditioned = residual.clone();
        factor.solve(&mut preconditioned)?;
        let size = engine.dot(&residual, &preconditioned)?;
        if iteration == 0 {
            first = size;
        }
        if size.is_nan() || size < 0.0 {
            return Ok(None);
        }
        if size <= REDUCTION * REDUCTION * first {
            return Ok(Some(x));
        }
        aypx(size / last, &preconditioned, &mut direction);
        last = size;
        let curvature = engine.multiply(matrix, &direction, &mut product)?;
        let step = size / curvature;
        axpy(step, &direction, &mut x);
        axpy(-step, &product, &mut residual);
    }
    Ok(None)
}
