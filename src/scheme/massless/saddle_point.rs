//! Solvers of the saddle-point problem, for velocities of cells and of modes.

use super::velocity_basis::VelocityBasis;
use crate::error::{Error, Result};
use crate::linalg::vectors::subtract;
use crate::linalg::{Engine, Factor};
use crate::random::golden_vector;
use crate::scheme::System;
use faer::Mat;
use faer::linalg::solvers::{Llt, Solve};
use std::cell::RefCell;
use std::rc::Rc;

/// Number of corrections of the saddle-point solution by its residual, with K applied cell by cell.
const CORRECTIONS: usize = 2;

/// Shift used where all finite eigenvalues vanish, relative to the Rayleigh quotient of a random
/// vector.
const LEAST_SHIFT: f64 = 1e-6;

/// Returns the solutions for forces, column by column.
pub(crate) fn solved(factor: &mut dyn Factor, mut forces: Mat<f64>) -> Result<Mat<f64>> {
    for j in 0..forces.ncols() {
        factor.solve(forces.col_as_slice_mut(j))?;
    }
    Ok(forces)
}

/// Returns (A + A^T) / 2 times a factor.
pub(crate) fn symmetric(a: &Mat<f64>, factor: f64) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| 0.5 * factor * (a[(i, j)] + a[(j, i)]))
}

/// Solver of the saddle-point problem of displacements U and accelerations a, see
/// [`crate::scheme::exact`].
pub(in crate::scheme) trait SaddlePointSolver {
    /// Returns U and a for forces (n x k) and positions (N x k).
    fn solve(&self, forces: Mat<f64>, positions: Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)>;

    /// Returns the displacements (n x k) per unit force at k of n dofs, at N positions of zero.
    fn flexibility(&self, unit_forces: Mat<f64>, _dofs: &[usize], positions: usize) -> Result<Mat<f64>> {
        let none = Mat::zeros(positions, unit_forces.ncols());
        Ok(self.solve(unit_forces, none)?.0)
    }

    /// Returns displacements (n x k) under forces (n x k) without the constraint B U = z, those of
    /// K + s M where K is singular.
    fn unconstrained(&self, forces: Mat<f64>) -> Result<Mat<f64>>;

    /// Returns the shift s of the factored K + s M, in (rad/s)^2; 0 where K is regular.
    fn shift(&self) -> f64;

    /// Returns the error of a model in which some deflection has no compliance of its own, given
    /// the compliance (k x k, in m/N) of the deflections at some dofs.
    fn rigid_contact(&self, compliance: &Mat<f64>, dofs: &[usize]) -> Error;
}

/// Solver for velocities of cells, with the factor of K + s M, which is definite where K and M
/// share no rigid motion and gives the same solution where B U is prescribed.
pub(crate) struct CellSaddlePoint<'s, E: Engine> {
    system: &'s System<E>,
    pub basis: Rc<VelocityBasis>,
    shift: f64,
    factor: RefCell<Box<dyn Factor>>,
    /// Solution (K + s M)^-1 B~^T, n x N.
    columns: Mat<f64>,
    /// Cholesky factor of B~ (K + s M)^-1 B~^T, N x N.
    schur: Llt<f64>,
}

impl<'s, E: Engine> CellSaddlePoint<'s, E> {
    /// Factors the matrices.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the mass is not a singular one, or leaves some rigid
    /// motion without inertia.
    pub fn new(system: &'s System<E>) -> Result<CellSaddlePoint<'s, E>> {
        let System { engine, stiffness, mass, .. } = system;
        let mut basis = VelocityBasis::new(system)?;
        let (dofs, cells) = (engine.dofs(), basis.size());
        let shift = shift(system)?;
        let mut factor = engine.factor(&(stiffness + mass * shift), &[]).map_err(|error| match error {
            Error::Memory(_) => error,
            _ => Error::Singular(
                "time.scheme = \"exact\": some motion of the plate has neither stiffness nor inertia; \
                 refine the mesh or set time.mass = \"consistent\" with time.scheme = \"newmark\""
                    .into(),
            ),
        })?;
        let mut columns = Mat::zeros(dofs, cells);
        let mut unit = vec![0.0; cells];
        for k in 0..cells {
            unit[k] = 1.0;
            let column = columns.col_as_slice_mut(k);
            basis.momentum(system, &unit, column)?;
            factor.solve(column)?;
            unit[k] = 0.0;
        }
        let compliance = symmetric(&basis.of(system, &columns)?, 1.0);
        let schur = basis.reduce(&compliance).ok_or_else(|| {
            Error::Singular("time.scheme = \"exact\": no displacement moves any cell; refine the mesh".into())
        })?;
        // Each row of (K + s M)^-1 B~^T is a vector of velocities.
        let columns = basis.narrow(columns.transpose().to_owned()).transpose().to_owned();
        Ok(CellSaddlePoint { system, basis: Rc::new(basis), shift, factor: factor.into(), columns, schur })
    }

    /// Returns one solution with the factor, without correction.
    fn propose(&self, forces: Mat<f64>, positions: &Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
        let mut u = solved(self.factor.borrow_mut().as_mut(), forces)?;
        let mut acceleration = self.basis.of(self.system, &u)?;
        acceleration -= positions;
        self.schur.solve_in_place(&mut acceleration);
        u -= &self.columns * &acceleration;
        acceleration += positions * faer::Scale(self.shift);
        Ok((u, acceleration))
    }
}

impl<E: Engine> SaddlePointSolver for CellSaddlePoint<'_, E> {
    fn solve(&self, forces: Mat<f64>, positions: Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
        let System { engine, stiffness, .. } = self.system;
        let mut u = Mat::zeros(forces.nrows(), forces.ncols());
        let mut acceleration = Mat::zeros(positions.nrows(), positions.ncols());
        let (mut force, mut position) = (forces.clone(), positions.clone());
        let mut product = vec![0.0; engine.dofs()];
        for correction in 0..=CORRECTIONS {
            let (du, da) = self.propose(force, &position)?;
            u += du;
            acceleration += da;
            (force, position) = (forces.clone(), positions.clone());
            if correction == CORRECTIONS {
                break;
            }
            position -= self.basis.of(self.system, &u)?;
            for j in 0..u.ncols() {
                engine.multiply(stiffness, u.col_as_slice(j), &mut product)?;
                subtract(&product, force.col_as_slice_mut(j));
                self.basis.momentum(self.system, acceleration.col_as_slice(j), &mut product)?;
                subtract(&product, force.col_as_slice_mut(j));
            }
        }
        Ok((u, acceleration))
    }

    fn unconstrained(&self, forces: Mat<f64>) -> Result<Mat<f64>> {
        solved(self.factor.borrow_mut().as_mut(), forces)
    }

    fn shift(&self) -> f64 {
        self.shift
    }

    fn rigid_contact(&self, _compliance: &Mat<f64>, _dofs: &[usize]) -> Error {
        Error::Singular(
            "the inf-sup condition fails: the velocities see some deflection that only an obstacle could stop, so \
             that motion and reactions are not unique and time.scheme = \"exact\" has nothing to follow; \
             set time.scheme = \"newmark\""
                .into(),
        )
    }
}

/// Returns a shift of the order of the finite eigenvalues of K x = w^2 M x: their mean, estimated
/// from one vector.
fn shift<E: Engine>(system: &System<E>) -> Result<f64> {
    let System { engine, stiffness, mass, .. } = system;
    let mut product = vec![0.0; engine.dofs()];
    let mut x = golden_vector(product.len());
    let mut quotient = |x: &[f64]| -> Result<f64> {
        let elastic = engine.multiply(stiffness, x, &mut product)?;
        let quotient = elastic / engine.multiply(mass, x, &mut product)?;
        Ok(if quotient.is_normal() { quotient } else { 1.0 })
    };
    let first = quotient(&x)?;
    let Ok(mut factor) = engine.factor(&(stiffness + mass * first), &[]) else { return Ok(first) };
    let mut image = vec![0.0; x.len()];
    engine.multiply(mass, &x, &mut image)?;
    factor.solve(&mut image)?;
    x.copy_from_slice(&image);
    // Where only rigid motions have inertia, the mean is rounding.
    Ok(quotient(&x)?.max(LEAST_SHIFT * first))
}
