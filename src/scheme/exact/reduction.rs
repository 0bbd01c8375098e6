//! Saddle-point problem behind `$\varphi$`, reduced to the coordinates of velocities.
//!
//! Let z be the coordinates of p in a [`VelocityBasis`] and `$\tilde B = Q^T C^{-1/2} B$`. For a position z
//! and forces `$f = F + G^T r$` the displacement U and the acceleration a (with mass damping,
//! `$a = z'' + \alpha z'$`) solve
//!
//! ```math
//! K U + \tilde B^T a = f, \qquad \tilde B U = z.
//! ```
//!
//! Both are linear in (f, z), and the operator is symmetric: `$U = U_F + R z + S G^T r$`,
//! `$a = h_F - H z + R^T G^T r$`.

use super::velocity_basis::VelocityBasis;
use crate::error::{Error, Result};
use crate::linalg::random::golden_vector;
use crate::linalg::vectors::subtract;
use crate::linalg::{Engine, Factor};
use crate::obstacle::Bounds;
use crate::scheme::System;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side as Triangle};
use std::cell::RefCell;
use std::rc::Rc;

/// Number of corrections of the saddle-point solution by its residual, with K applied cell by cell.
const CORRECTIONS: usize = 2;

/// Least part of a bounded dof's compliance among its free neighbours that must remain under the
/// constraint B U = C p.
const INF_SUP: f64 = 1e-11;

/// Shift used where all finite eigenvalues vanish, relative to the Rayleigh quotient of a random
/// vector.
const LEAST_SHIFT: f64 = 1e-6;

/// Reduced model of the structure; N velocity coordinates, n dofs, m bounds.
#[derive(Debug)]
pub(super) struct ReducedModel {
    /// Basis of the N velocity coordinates.
    pub basis: Rc<VelocityBasis>,
    /// Damping coefficient alpha, in 1/s.
    pub damping: f64,
    /// Stiffness H in z without contact, N x N.
    pub stiffness: Mat<f64>,
    /// Force h_F, N entries.
    pub force: Mat<f64>,
    /// Displacement U_F at z = 0, n entries.
    pub rest: Mat<f64>,
    /// Displacements R per unit z, n x N.
    pub lift: Mat<f64>,
    /// Displacements S G^T per unit reaction, n x m.
    pub flexibility: Mat<f64>,
    /// Values at the bounds: G U_F (m entries), G R (m x N) and the compliance G S G^T (m x m).
    pub rest_at: Mat<f64>,
    pub lift_at: Mat<f64>,
    pub compliance: Mat<f64>,
}

impl ReducedModel {
    /// Solves the saddle-point problem for all columns.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the inf-sup condition fails with these bounds.
    pub fn new<E: Engine>(saddle: &SaddlePointSolver<E>) -> Result<ReducedModel> {
        let system = saddle.system;
        let (dofs, bounds) = (system.engine.dofs(), &system.bounds);
        let (cells, bounded) = (saddle.basis.size(), bounds.len());
        let load = Mat::from_fn(dofs, 1, |i, _| system.load.as_ref().map_or(0.0, |load| load[i]));
        let (rest, force) = saddle.solve(load, Mat::zeros(cells, 1))?;
        let (lift, acceleration) = saddle.solve(Mat::zeros(dofs, cells), Mat::identity(cells, cells))?;
        let unit_forces = Mat::from_fn(dofs, bounded, |i, j| f64::from(bounds.dofs[j] == i));
        let unbound = saddle.unbound(unit_forces.clone(), bounds)?;
        let (flexibility, _) = saddle.solve(unit_forces, Mat::zeros(cells, bounded))?;
        let at = |of: &Mat<f64>| Mat::from_fn(bounded, of.ncols(), |i, j| of[(bounds.dofs[i], j)]);
        let reduction = ReducedModel {
            damping: system.damping.mass,
            stiffness: symmetric(&acceleration, -1.0),
            force,
            rest_at: at(&rest),
            lift_at: at(&lift),
            compliance: symmetric(&at(&flexibility), 1.0),
            rest,
            lift,
            flexibility,
            basis: saddle.basis.clone(),
        };
        reduction.check_inf_sup(&unbound)?;
        Ok(reduction)
    }

    /// Compares the pivots of the compliance G S G^T with those of the compliance without the
    /// constraint B U = C p.
    fn check_inf_sup(&self, unbound: &Mat<f64>) -> Result<()> {
        let fails = || {
            Error::Singular(
                "the inf-sup condition fails: the velocities see some deflection that only an obstacle could stop, so \
                 that motion and reactions are not unique and time.scheme = \"exact\" has nothing to follow; \
                 set time.scheme = \"newmark\""
                    .into(),
            )
        };
        let pivots = |of: &Mat<f64>| -> Result<Vec<f64>> {
            let llt = of.llt(Triangle::Lower).map_err(|_| fails())?;
            Ok((0..of.nrows()).map(|i| llt.L()[(i, i)].powi(2)).collect())
        };
        let (left, whole) = (pivots(&self.compliance)?, pivots(unbound)?);
        let fine = left.iter().zip(&whole).all(|(left, whole)| *left > INF_SUP * whole);
        if fine { Ok(()) } else { Err(fails()) }
    }
}

/// Returns (A + A^T) / 2 times a factor.
fn symmetric(a: &Mat<f64>, factor: f64) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| 0.5 * factor * (a[(i, j)] + a[(j, i)]))
}

/// Saddle-point solver with the factor of K + s M, which is definite where K and M share no rigid
/// motion and gives the same solution where B U is prescribed.
pub(super) struct SaddlePointSolver<'s, E: Engine> {
    system: &'s System<E>,
    basis: Rc<VelocityBasis>,
    shift: f64,
    factor: RefCell<E::Factor>,
    /// Solution (K + s M)^-1 B~^T, n x N.
    columns: Mat<f64>,
    /// Cholesky factor of B~ (K + s M)^-1 B~^T, N x N.
    schur: Llt<f64>,
}

impl<'s, E: Engine> SaddlePointSolver<'s, E> {
    /// Factors the matrices.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the mass is not a singular one, or leaves some rigid
    /// motion without inertia.
    pub fn new(system: &'s System<E>) -> Result<SaddlePointSolver<'s, E>> {
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
        Ok(SaddlePointSolver { system, basis: Rc::new(basis), shift, factor: factor.into(), columns, schur })
    }

    /// Returns U and a for forces (n x k) and positions (N x k).
    pub fn solve(&self, forces: Mat<f64>, positions: Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
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

    /// Returns one solution with the factor, without correction.
    fn propose(&self, forces: Mat<f64>, positions: &Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
        let mut u = forces;
        for j in 0..u.ncols() {
            self.factor.borrow_mut().solve(u.col_as_slice_mut(j))?;
        }
        let mut acceleration = self.basis.of(self.system, &u)?;
        acceleration -= positions;
        self.schur.solve_in_place(&mut acceleration);
        u -= &self.columns * &acceleration;
        acceleration += positions * faer::Scale(self.shift);
        Ok((u, acceleration))
    }

    /// Returns the compliance G (K + s M)^-1 G^T of the bounded dofs without the constraint, m x m.
    fn unbound(&self, mut unit_forces: Mat<f64>, bounds: &Bounds) -> Result<Mat<f64>> {
        for j in 0..unit_forces.ncols() {
            self.factor.borrow_mut().solve(unit_forces.col_as_slice_mut(j))?;
        }
        Ok(Mat::from_fn(bounds.len(), bounds.len(), |i, j| unit_forces[(bounds.dofs[i], j)]))
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
