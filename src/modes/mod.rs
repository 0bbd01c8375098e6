//! Natural modes: K x = (2 pi f)^2 M x, with the consistent or the singular mass, at any mesh size.
//!
//! [`lowest`], on any engine, is subspace iteration with a factored K. Rounding the entries of the assembled K spoils its low modes as h^-4;
//! here the assembled matrix only proposes directions: every solve is corrected once with the residual of the
//! cell-by-cell operator, and the values are Rayleigh quotients of that operator. [`highest`] is Lanczos' method on a
//! factored K + sigma M. Both see the finite modes only: the kernel of a singular mass moves at no cost of inertia.

pub(crate) mod lanczos;

use crate::error::{Error, Result};
use crate::linalg::{Engine, Factor, Form, Native};
use faer::{Mat, Side};
use lanczos::scatter;
use std::f64::consts::TAU;

/// Change of an eigenvalue, relative to it, at which subspace iteration stops. What is left is smaller: each iteration
/// gains a digit or two.
const SETTLED: f64 = 1e-11;

/// What rounding leaves of an eigenvalue, relative to the block's largest.
const ROUNDING: f64 = 1e-14;
const MOST_ITERATIONS: usize = 200;

/// A direction that keeps less than this of its length when those before it are taken out adds none.
const DEPENDENT: f64 = 1e-12;

/// Shift of a mechanism relative to the largest eigenvalue of the block, and how far it may drift before K + shift M is
/// factored again. Small against the wanted eigenvalues, large against rounding.
const SHIFT: f64 = 1e-4;
const SHIFT_DRIFT: f64 = 100.0;

/// An eigenvalue of a mechanism below this part of the block's largest is a rigid motion's: it is rounding.
const RIGID: f64 = 1e-11;

/// A natural mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// f, in Hz; 0 of a rigid motion.
    pub frequency: f64,
    /// x, of modal mass x^T M x = 1 kg.
    pub shape: Vec<f64>,
}

/// The `count` lowest natural frequencies, in Hz, ascending and with their multiplicity; fewer if there are no more.
///
/// # Errors
/// As [`shapes`].
pub fn lowest<E: Engine>(
    engine: &E,
    stiffness: &E::Form,
    mass: &E::Form,
    count: usize,
    mechanism: bool,
) -> Result<Vec<f64>> {
    let modes = shapes(engine, stiffness, mass, count, mechanism)?;
    Ok(modes.into_iter().map(|mode| mode.frequency).collect())
}

/// The `count` lowest natural modes, ascending; fewer if there are no more. Shapes are right to some 1e-6.
///
/// `mechanism` says that K is singular: the rigid motions come first, at exactly 0.
///
/// # Errors
/// [`Error::Singular`] where K is singular and was not said to be, or the iteration does not settle.
pub fn shapes<E: Engine>(
    engine: &E,
    stiffness: &E::Form,
    mass: &E::Form,
    count: usize,
    mechanism: bool,
) -> Result<Vec<Mode>> {
    let dofs = engine.dofs();
    let (sizes, before) = engine.concatenate(&[dofs as f64, engine.velocities(mass) as f64])?;
    let all = |which: usize| sizes.iter().skip(which).step_by(2).sum::<f64>() as usize;
    let width = (2 * count + 8).min(all(1)).min(all(0));
    // Each process scatters numbers of its own.
    let seed = |i: usize| (i + width * before) as u64;
    let mut block: Vec<Vec<f64>> = (0..width).map(|i| scatter(dofs, seed(i))).collect();
    let mut pencil = Pencil::new(engine, stiffness, mass);
    let mut values = pencil.rayleigh_ritz(&mut block)?;
    for _ in 0..MOST_ITERATIONS {
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
        "the {count} lowest natural frequencies have not settled in {MOST_ITERATIONS} iterations"
    )))
}

/// K and M with what subspace iteration needs of them.
struct Pencil<'e, E: Engine> {
    engine: &'e E,
    stiffness: &'e E::Form,
    mass: &'e E::Form,
    /// K + shift M, factored, and the shift.
    factor: Option<(E::Factor, f64)>,
    product: Vec<f64>,
    right: Vec<f64>,
}

impl<'e, E: Engine> Pencil<'e, E> {
    fn new(engine: &'e E, stiffness: &'e E::Form, mass: &'e E::Form) -> Pencil<'e, E> {
        let zeros = || vec![0.0; engine.dofs()];
        Pencil { engine, stiffness, mass, factor: None, product: zeros(), right: zeros() }
    }

    /// Factors K + shift M, unless the factor at hand is of a shift near enough.
    fn prepare(&mut self, shift: f64) -> Result<()> {
        let near = |old: f64| old <= shift * SHIFT_DRIFT && shift <= old * SHIFT_DRIFT;
        if self.factor.as_ref().is_none_or(|(_, old)| !near(*old)) {
            let sum = [(1.0, self.stiffness), (shift, self.mass)];
            let sum = if shift > 0.0 { &sum[..] } else { &sum[..1] };
            self.factor = Some((self.engine.factor(sum, &[])?, shift));
        }
        Ok(())
    }

    /// x becomes (K + shift M)^-1 M x, corrected once.
    fn invert(&mut self, x: &mut [f64]) -> Result<()> {
        let Some((factor, shift)) = &mut self.factor else { return Ok(()) };
        self.engine.multiply(self.mass, x, &mut self.right)?;
        x.copy_from_slice(&self.right);
        factor.solve(x)?;
        self.engine.multiply(self.stiffness, x, &mut self.product)?;
        self.right.iter_mut().zip(&self.product).for_each(|(r, k)| *r -= k);
        if *shift > 0.0 {
            self.engine.multiply(self.mass, x, &mut self.product)?;
            self.right.iter_mut().zip(&self.product).for_each(|(r, m)| *r -= *shift * m);
        }
        factor.solve(&mut self.right)?;
        x.iter_mut().zip(&self.right).for_each(|(x, r)| *x += r);
        Ok(())
    }

    /// Replaces the block by the M-orthonormal Ritz vectors of its span; returns their values (rad/s)^2, ascending.
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
        self.engine.agree(&mut values)?;
        self.engine.agree(&mut vectors)?;
        let mut rotated = vec![vec![0.0; self.engine.dofs()]; size];
        for (j, new) in rotated.iter_mut().enumerate() {
            for (i, old) in block.iter().enumerate() {
                let share = vectors[i * size + j];
                new.iter_mut().zip(old).for_each(|(x, y)| *x += share * y);
            }
        }
        *block = rotated;
        Ok(values)
    }

    /// Gram-Schmidt, twice, in the scalar product of M; directions that add nothing are dropped.
    fn orthonormalise(&mut self, block: &mut Vec<Vec<f64>>) -> Result<()> {
        let (mut basis, mut duals) = (Vec::<Vec<f64>>::new(), Vec::<Vec<f64>>::new());
        for mut x in std::mem::take(block) {
            let whole = self.engine.multiply(self.mass, &x, &mut self.product)?.sqrt();
            for _ in 0..2 {
                for (v, dual) in basis.iter().zip(&duals) {
                    let share = self.engine.dot(&x, dual)?;
                    x.iter_mut().zip(v).for_each(|(x, v)| *x -= share * v);
                }
            }
            let norm = self.engine.multiply(self.mass, &x, &mut self.product)?.sqrt();
            if norm > DEPENDENT * whole {
                x.iter_mut().for_each(|x| *x /= norm);
                duals.push(self.product.iter().map(|m| m / norm).collect());
                basis.push(x);
            }
        }
        *block = basis;
        Ok(())
    }
}

/// Steps of Lanczos' method for the highest frequency and the accuracy it asks for (a bound, often met by its square): while
/// sigma is found, and then.
const ROUGHLY: (usize, f64) = (20, 0.1);
const HIGHEST: (usize, f64) = (400, 1e-6);

/// The highest natural frequency, in Hz: the fastest motion that a step of time has to follow.
///
/// Velocities v see the operator 1 - sigma W (K + sigma M)^-1 W^T, where W^T v is the momentum of v: its eigenvalues are
/// lambda / (lambda + sigma). With sigma near the largest lambda nothing is lost to rounding.
///
/// # Errors
/// [`Error::Singular`] where K + sigma M is: the mass does not see some rigid motion.
pub fn highest(engine: &Native, stiffness: &Form, mass: &Form) -> Result<f64> {
    let dofs = engine.dofs();
    let x = scatter(dofs, 1);
    let mut product = vec![0.0; dofs];
    let elastic = engine.multiply(stiffness, &x, &mut product)?;
    let mut sigma = elastic / engine.multiply(mass, &x, &mut product)?;
    let (mut steps, mut tolerance) = ROUGHLY;
    loop {
        let mut factor = engine.factor(&[(1.0, stiffness), (sigma, mass)], &[])?;
        let mut u = vec![0.0; dofs];
        let operator = |v: &[f64], w: &mut [f64]| {
            engine.momentum(mass, v, &mut u)?;
            factor.solve(&mut u)?;
            engine.velocity(mass, &u, w)?;
            w.iter_mut().zip(v).for_each(|(w, v)| *w = v - sigma * *w);
            Ok(())
        };
        let metric = |v: &[f64], w: &mut [f64]| match mass {
            Form::Cells(_) => engine.momentum(mass, v, w),
            Form::Averages(averages) => {
                w.iter_mut().zip(averages.masses().iter().zip(v)).for_each(|(w, (c, v))| *w = c * v);
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
