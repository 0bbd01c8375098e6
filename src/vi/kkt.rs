//! The judge of every solver: one relative residual of the optimality conditions.
//!
//! Stationarity is measured as a componentwise backward error (Oettli and Prager 1964): by how much, relative to themselves,
//! the entries of the cells' matrices and of b would have to change for x to satisfy its rows exactly,
//! \[ \max_i \frac{|A x - b - G^T r|_i}{(|A||x| + |b| + |G^T r|)_i}. \]
//! A row all of whose terms are negligible is measured against a share of the largest that A, which is positive definite, allows
//! it. The measure does not depend on units or on the scaling of the dofs. Violated bounds are measured against the scale of
//! the deflection, reactions against the magnitude of their row; complementarity is the smaller of relative gap and
//! relative reaction. A is applied cell by cell, without the assembled matrix that the solvers work on.

use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;

/// Rows whose magnitude is below this share of the largest possible, sqrt(A_ii) max_j of sqrt(A_jj) |x_j| and |b_j| / sqrt(A_jj),
/// are measured against that share: where all terms of a row vanish in the answer, rounding elsewhere is all it has.
const NEGLIGIBLE: f64 = 1e-4;

/// The parts of the residual, each dimensionless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Componentwise backward error of A x = b + G^T r.
    pub stationarity: f64,
    /// Largest violation of a bound over the scale of the deflection.
    pub penetration: f64,
    /// Largest reaction of the wrong sign over the magnitude of its row.
    pub adhesion: f64,
    /// Largest of min(relative gap, relative reaction).
    pub complementarity: f64,
}

impl Residual {
    /// The largest part; NaN if any is.
    pub fn worst(&self) -> f64 {
        let parts = [self.stationarity, self.penetration, self.adhesion, self.complementarity];
        parts.into_iter().fold(0.0, larger)
    }
}

/// The larger of two numbers, and NaN if one is: a comparison must not hide it.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// The largest of some numbers that are not negative, and NaN if one is: they are ordered as their bits are, NaN last.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    f64::from_bits(values.map(|value| value.abs().to_bits()).max().unwrap_or(0))
}

/// A ratio that is 0 for nothing over nothing.
fn ratio(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a / b }
}

/// Work vectors of the judge.
#[derive(Debug)]
pub struct Judge {
    /// sqrt(A_ii).
    scale: Vec<f64>,
    residual: Vec<f64>,
    magnitude: Vec<f64>,
}

impl Judge {
    /// A judge of problems with the matrix of this sum.
    ///
    /// # Errors
    /// What the engine says.
    pub fn new<E: Engine>(engine: &E, sum: &Sum<E>) -> Result<Judge> {
        let scale: Vec<f64> = engine.diagonal(sum)?.into_iter().map(f64::sqrt).collect();
        Ok(Judge { residual: vec![0.0; scale.len()], magnitude: vec![0.0; scale.len()], scale })
    }

    /// The worst part of the residual of (x, reaction) on all processes; see the [module page](self). b comes as the terms that it
    /// is the sum of: each counts with its own magnitude. Where the deflection has no scale yet, at rest on obstacles at 0, it is that of x.
    ///
    /// # Errors
    /// What the engine says.
    pub fn residual<E: Engine>(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[&[f64]],
        bounds: &Bounds,
        length: f64,
        x: &[f64],
        reaction: &[f64],
    ) -> Result<f64> {
        let length = match length {
            0.0 => engine.maximum(largest(bounds.dofs.iter().map(|&dof| x[dof])))?,
            length => length,
        };
        engine.maximum(self.parts(engine, sum, b, bounds, length, x, reaction)?.worst())
    }

    /// The parts of the residual on this process, with b as a sum of terms.
    ///
    /// # Errors
    /// What the engine says.
    pub fn parts<E: Engine>(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[&[f64]],
        bounds: &Bounds,
        length: f64,
        x: &[f64],
        reaction: &[f64],
    ) -> Result<Residual> {
        let Judge { scale, residual, magnitude } = self;
        engine.multiply_with_magnitude(sum, x, residual, magnitude)?;
        for term in b {
            for ((r, m), b) in residual.iter_mut().zip(magnitude.iter_mut()).zip(*term) {
                *r -= b;
                *m += b.abs();
            }
        }
        for (&dof, &r) in bounds.dofs.iter().zip(reaction).filter(|(_, r)| **r != 0.0) {
            residual[dof] -= r;
            magnitude[dof] += r.abs();
        }
        let moved = largest(x.iter().zip(scale.iter()).map(|(x, scale)| scale * x.abs()));
        let loaded =
            b.iter().map(|b| largest(b.iter().zip(scale.iter()).map(|(b, scale)| ratio(*b, *scale))));
        let size = engine.maximum(loaded.fold(moved, larger))?;
        // Without any magnitude there is no residual either.
        let floor = (NEGLIGIBLE * size).max(f64::MIN_POSITIVE);
        let rows = residual.iter().zip(magnitude.iter_mut()).zip(scale.iter());
        let stationarity = largest(rows.map(|((r, m), scale)| {
            *m = m.max(floor * scale).max(f64::MIN_POSITIVE);
            r / *m
        }));
        let mut parts = Residual { stationarity, penetration: 0.0, adhesion: 0.0, complementarity: 0.0 };
        for (i, (&dof, &r)) in bounds.dofs.iter().zip(reaction).enumerate() {
            let (below, above) = (x[dof] - bounds.lower[i], bounds.upper[i] - x[dof]);
            if r == 0.0 && below >= 0.0 && above >= 0.0 {
                continue; // Free, within its bounds.
            }
            let force = magnitude[dof];
            // A positive reaction pushes up, off the lower bound.
            let gap = if r >= 0.0 { below } else { above };
            let pull = if gap.is_infinite() { r.abs() } else { 0.0 };
            let outside = larger(0.0, larger(-below, -above));
            parts.penetration = larger(parts.penetration, ratio(outside, length));
            parts.adhesion = larger(parts.adhesion, ratio(pull, force));
            parts.complementarity =
                larger(parts.complementarity, ratio(gap.abs(), length).min(ratio(r.abs(), force)));
        }
        Ok(parts)
    }
}
