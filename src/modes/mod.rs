//! Natural modes: `$K x = (2 \pi f)^2 M x$` with the consistent or the singular mass, at any mesh
//! size.
//!
//! [`lowest`], on any engine, is subspace iteration with a factored K. Rounding the entries of the
//! assembled K perturbs its low modes as h^-4. The assembled matrix therefore only proposes
//! directions: every solve is corrected once with the residual of the cell-by-cell operator, and
//! the eigenvalues are Rayleigh quotients of that operator. [`highest`] is Lanczos' method on a
//! factored `$K + \sigma M$`. Both find the finite modes only, because the kernel of a singular
//! mass moves without inertia.

mod basis;
mod blocks;
mod inverse;
mod krylov;
pub(crate) mod lanczos;

pub use basis::{ModalBasis, ModeRange, lowest_basis};

use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::random::random_vector;
use crate::linalg::vectors::{add, axpy, aypx, divide, hadamard, subtract};
use crate::linalg::{Engine, Factor, Form, Native};
use faer::{Mat, Side};
use std::f64::consts::TAU;

/// Relative change of an eigenvalue at which subspace iteration stops. The remaining error is
/// smaller, because each iteration gains a digit or two.
const SETTLED: f64 = 1e-11;

/// Rounding error of an eigenvalue, relative to the block's largest.
const ROUNDING: f64 = 1e-14;
const MAX_ITERATIONS: usize = 200;

/// Share of its length below which a direction, after orthogonalisation, counts as linearly
/// dependent.
const MIN_INDEPENDENT_PART: f64 = 1e-12;

/// Shift for a mechanism, relative to the largest eigenvalue of the block, and the factor by which
/// it may drift before K + shift M is factored again. The shift is small against the wanted
/// eigenvalues and large against rounding.
const SHIFT: f64 = 1e-4;
const SHIFT_DRIFT: f64 = 100.0;

/// Share of the block's largest eigenvalue below which an eigenvalue of a mechanism is rounding and
/// belongs to a rigid motion.
const RIGID: f64 = 1e-11;

/// Natural mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Frequency f, in Hz; 0 for a rigid motion.
    pub frequency: f64,
    /// Mode shape x with modal mass x^T M x = 1 kg, one entry per dof.
    pub shape: Vec<f64>,
}

/// Returns the `count` lowest natural frequencies, ascending and with their multiplicity, or fewer
/// if there are no more, in Hz.
///
/// # Errors
/// Returns the errors of [`shapes`].
pub fn lowest<E: Engine>(
    engine: &E,
    stiffness: &Form,
    mass: &Form,
    count: usize,
    mechanism: bool,
) -> Result<Vec<f64>> {
    let modes = shapes(engine, stiffness, mass, count, mechanism)?;
    Ok(modes.into_iter().map(|mode| mode.frequency).collect())
}

/// Returns the `count` lowest natural modes, ascending, or fewer if there are no more. The shapes
/// are accurate to about 1e-6.
///
/// `mechanism` says that K is singular: the rigid motions come first, at exactly 0 Hz.
///
/// # Errors
/// Returns [`Error::Singular`] where K is singular without `mechanism`, or the iteration does not
/// converge.
pub fn shapes<E: Engine>(
    engine: &E,
    stiffness: &Form,
    mass: &Form,
    count: usize,
    mechanism: bool,
) -> Result<Vec<Mode>> {
    let dofs = engine.dofs();
    let [all_dofs, all_velocities] = engine.comm().all_reduce_sum([dofs, engine.velocities(mass)]);
    let width = (2 * count + 8).min(all_velocities).min(all_dofs);
    // Each rank draws different numbers.
    let seed = |i: usize| (i + width * 2 * engine.comm().rank()) as u64;
    let mut block: Vec<Vec<f64>> = (0..width).map(|i| random_vector(dofs, seed(i))).collect();
    let mut pencil = Pencil::new(engine, stiffness, mass);
    let mut values = pencil.rayleigh_ritz(&mut block)?;
    for _ in 0..MAX_ITERATIONS {
        let largest = values.last().copied().unwrap_or(0.0);
        pencil.prepare(if mechanism { SHIFT * largest } else { 0.0 })?;
        for x in &mut block {
            pencil.invert(x)?;
        }
        let before = std::mem::replace(&mut values, pencil.rayleigh_ritz(&mut block)?);
        let largest = values.last().copied().unwrap_or(0.0);
        let rigid = if mechanism { RIGID * largest } else { 0.0 };
        let enough = |new: f64| SETTLED * new + ROUNDING * largest;
        let settled = |(new, old): (&f64, &f64)| *new <= rigid || (new - old).abs() <= enough(*new);
        if before.len() == values.len() && values.iter().zip(&before).take(count).all(settled) {
            let frequency = |value: f64| if value <= rigid { 0.0 } else { value.sqrt() / TAU };
            let modes = values.into_iter().zip(block).take(count);
            return Ok(modes.map(|(value, shape)| Mode { frequency: frequency(value), shape }).collect());
        }
    }
    Err(Error::Singular(format!(
        "the {count} lowest natural frequencies have not settled in {MAX_ITERATIONS} iterations"
    )))
}

/// Matrices K and M, with the factor and the work vectors of subspace iteration.
struct Pencil<'e, E: Engine> {
    engine: &'e E,
    stiffness: &'e Form,
    mass: &'e Form,
    /// Factor of K + shift M, and the shift.
    factor: Option<(E::Factor, f64)>,
    product: Vec<f64>,
    right: Vec<f64>,
}

impl<'e, E: Engine> Pencil<'e, E> {
    fn new(engine: &'e E, stiffness: &'e Form, mass: &'e Form) -> Pencil<'e, E> {
        let zeros = || vec![0.0; engine.dofs()];
        Pencil { engine, stiffness, mass, factor: None, product: zeros(), right: zeros() }
    }

    /// Factors K + shift M, unless the present factor has a shift near enough.
    fn prepare(&mut self, shift: f64) -> Result<()> {
        let near = |old: f64| old <= shift * SHIFT_DRIFT && shift <= old * SHIFT_DRIFT;
        if self.factor.as_ref().is_none_or(|(_, old)| !near(*old)) {
            let (k, m) = (self.stiffness, self.mass);
            let sum = if shift > 0.0 { k + m * shift } else { k.into() };
            self.factor = Some((self.engine.factor(&sum, &[])?, shift));
        }
        Ok(())
    }

    /// Replaces x by (K + shift M)^-1 M x, corrected once by its residual.
    fn invert(&mut self, x: &mut [f64]) -> Result<()> {
        let Some((factor, shift)) = &mut self.factor else { return Ok(()) };
        self.engine.multiply(self.mass, x, &mut self.right)?;
        x.copy_from_slice(&self.right);
        factor.solve(x)?;
        self.engine.multiply(self.stiffness, x, &mut self.product)?;
        subtract(&self.product, &mut self.right);
        if *shift > 0.0 {
            self.engine.multiply(self.mass, x, &mut self.product)?;
            axpy(-*shift, &self.product, &mut self.right);
        }
        factor.solve(&mut self.right)?;
        add(&self.right, x);
        Ok(())
    }

    /// Replaces the block by the M-orthonormal Ritz vectors of its span. Returns their eigenvalues,
    /// ascending, in (rad/s)^2.
    fn rayleigh_ritz(&mut self, block: &mut Vec<Vec<f64>>) -> Result<Vec<f64>> {
        self.orthonormalise(block)?;
        let size = block.len();
        let mut reduced = Mat::zeros(size, size);
        for j in 0..size {
            reduced[(j, j)] = self.engine.multiply(self.stiffness, &block[j], &mut self.product)?;
            for i in j + 1..size {
                reduced[(i, j)] = self.engine.dot(&block[i], &self.product)?;
            }
        }
        let eigen = reduced
            .self_adjoint_eigen(Side::Lower)
            .map_err(|why| Error::Singular(format!("a Rayleigh-Ritz step failed: {why:?}")))?;
        let mut values: Vec<f64> = (0..size).map(|i| eigen.S()[i]).collect();
        let mut vectors: Vec<f64> = (0..size * size).map(|i| eigen.U()[(i / size, i % size)]).collect();
        self.engine.comm().broadcast(&mut values);
        self.engine.comm().broadcast(&mut vectors);
        let mut rotated = vec![vec![0.0; self.engine.dofs()]; size];
        for (j, new) in rotated.iter_mut().enumerate() {
            for (i, old) in block.iter().enumerate() {
                axpy(vectors[i * size + j], old, new);
            }
        }
        *block = rotated;
        Ok(values)
    }

    /// Orthonormalises a block by Gram-Schmidt, twice, in the scalar product of M. Linearly
    /// dependent directions are dropped.
    fn orthonormalise(&mut self, block: &mut Vec<Vec<f64>>) -> Result<()> {
        let (mut basis, mut duals) = (Vec::<Vec<f64>>::new(), Vec::<Vec<f64>>::new());
        for mut x in std::mem::take(block) {
            let whole = self.engine.multiply(self.mass, &x, &mut self.product)?.sqrt();
            for _ in 0..2 {
                for (v, dual) in basis.iter().zip(&duals) {
                    let share = self.engine.dot(&x, dual)?;
                    axpy(-share, v, &mut x);
                }
            }
            let norm = self.engine.multiply(self.mass, &x, &mut self.product)?.sqrt();
            if norm > MIN_INDEPENDENT_PART * whole {
                divide(norm, &mut x);
                duals.push(self.product.iter().map(|m| m / norm).collect());
                basis.push(x);
            }
        }
        *block = basis;
        Ok(())
    }
}

/// Steps and tolerance of Lanczos' method for the highest frequency: first while sigma is sought,
/// then for the result. The tolerance is a bound, and the actual error is often near its square.
const SHIFT_SEARCH: (usize, f64) = (20, 0.1);
const HIGHEST: (usize, f64) = (400, 1e-6);

/// Returns the highest natural frequency, of the fastest motion that a time step has to follow, in
/// Hz.
///
/// Velocities v see the operator `$1 - \sigma W (K + \sigma M)^{-1} W^T$`, where `$W^T v$` is the
/// momentum of v; its eigenvalues are `$\lambda / (\lambda + \sigma)$`. With sigma near the largest
/// lambda, rounding does no harm.
///
/// # Errors
/// Returns [`Error::Singular`] where K + sigma M is singular, because the mass does not see some
/// rigid motion.
pub fn highest(engine: &Native, stiffness: &Form, mass: &Form) -> Result<f64> {
    let dofs = engine.dofs();
    let x = random_vector(dofs, 1);
    let mut product = vec![0.0; dofs];
    let elastic = engine.multiply(stiffness, &x, &mut product)?;
    let mut sigma = elastic / engine.multiply(mass, &x, &mut product)?;
    let (mut steps, mut tolerance) = SHIFT_SEARCH;
    loop {
        let mut factor = engine.factor(&(stiffness + mass * sigma), &[])?;
        let mut u = vec![0.0; dofs];
        let operator = |v: &[f64], w: &mut [f64]| {
            engine.project_transpose(mass, v, &mut u)?;
            factor.solve(&mut u)?;
            engine.project(mass, &u, w)?;
            aypx(-sigma, v, w);
            Ok(())
        };
        let metric = |v: &[f64], w: &mut [f64]| match mass {
            Form::Cells(_) => engine.project_transpose(mass, v, w),
            Form::SingularMassCells(averages) => {
                w.copy_from_slice(v);
                hadamard(averages.masses(), w);
                Ok(())
            }
        };
        let part = lanczos::largest(engine.velocities(mass), steps, tolerance, operator, metric)?;
        let value = sigma * part / (1.0 - part);
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Singular("the highest natural frequency is not a positive number".into()));
        }
        if (steps, tolerance) == HIGHEST {
            return Ok(value.sqrt() / TAU);
        }
        if value <= 10.0 * sigma && sigma <= 10.0 * value {
            (steps, tolerance) = HIGHEST;
        }
        sigma = value;
    }
}
