//! Largest eigenvalue of an operator that is known only by its products.

use crate::error::Result;
use crate::linalg::vectors::{axpy, dot};
use crate::random::random_vector;
use faer::{Mat, Side};

/// Number of steps between computations of the eigenvalues of the tridiagonal matrix.
const LOOK_EVERY: usize = 10;

/// Returns the largest eigenvalue below a limit of an operator that is self-adjoint in the scalar
/// product of a positive definite metric.
///
/// This is Lanczos' method with full reorthogonalisation (twice), from a fixed start. It stops when
/// the residual bound of the eigenvalue is below `tolerance` times the eigenvalue, or after `steps`
/// steps. The result is a Rayleigh quotient and, up to rounding, never exceeds the eigenvalue. It
/// is NaN if none lies below the limit.
///
/// # Errors
/// Returns the errors of the operator and of the metric.
pub fn largest(
    size: usize,
    (steps, tolerance): (usize, f64),
    limit: f64,
    mut operator: impl FnMut(&[f64], &mut [f64]) -> Result<()>,
    mut metric: impl FnMut(&[f64], &mut [f64]) -> Result<()>,
) -> Result<f64> {
    let steps = steps.min(size);
    let (mut basis, mut duals) = (Vec::<Vec<f64>>::new(), Vec::<Vec<f64>>::new());
    let (mut diagonal, mut off_diagonal) = (Vec::new(), Vec::new());
    let mut next = random_vector(size, 1);
    let mut dual = vec![0.0; size];
    let mut value = 0.0;
    while basis.len() < steps {
        metric(&next, &mut dual)?;
        let norm = dot(&next, &dual).max(0.0).sqrt();
        let scale = diagonal.iter().fold(0.0_f64, |m, a: &f64| m.max(a.abs()));
        let exhausted = norm <= f64::EPSILON * scale;
        if !basis.is_empty() {
            if exhausted || basis.len().is_multiple_of(LOOK_EVERY) {
                let (largest, last) = top(&diagonal, &off_diagonal, limit);
                value = largest;
                if norm * last.abs() <= tolerance * value.abs() {
                    return Ok(value);
                }
            }
            off_diagonal.push(norm);
        }
        if exhausted {
            return Ok(value);
        }
        basis.push(next.iter().map(|x| x / norm).collect());
        duals.push(dual.iter().map(|x| x / norm).collect());
        operator(&basis[basis.len() - 1], &mut next)?;
        diagonal.push(dot(&next, &duals[duals.len() - 1]));
        for _ in 0..2 {
            for (v, dual) in basis.iter().zip(&duals) {
                let share = dot(&next, dual);
                axpy(-share, v, &mut next);
            }
        }
    }
    Ok(if diagonal.is_empty() { 0.0 } else { top(&diagonal, &off_diagonal[..diagonal.len() - 1], limit).0 })
}

/// Returns the largest eigenvalue below a limit of a symmetric tridiagonal matrix and the last
/// entry of its eigenvector, or NaN.
fn top(diagonal: &[f64], off_diagonal: &[f64], limit: f64) -> (f64, f64) {
    let size = diagonal.len();
    let matrix = Mat::from_fn(size, size, |i, j| match i.abs_diff(j) {
        0 => diagonal[i],
        1 => off_diagonal[i.min(j)],
        _ => 0.0,
    });
    let Ok(eigen) = matrix.self_adjoint_eigen(Side::Lower) else { return (f64::NAN, f64::NAN) };
    let below = (0..size).rev().find(|&k| eigen.S()[k] < limit);
    below.map_or((f64::NAN, f64::NAN), |k| (eigen.S()[k], eigen.U()[(size - 1, k)]))
}
