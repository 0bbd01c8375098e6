//! The saddle point behind phi, solved once for all that a motion can ask of it.
//!
//! With z the coordinates of p in a [`Frame`] and `$\tilde B = Q^T C^{-1/2} B$`, the displacement U and the acceleration a that go with a position z and
//! forces f = F + G^T r on the structure, a = z'' + alpha z' where mass is damped, solve
//!
//! ```math
//! K U + \tilde B^T a = f, \qquad \tilde B U = z.
//! ```
//!
//! Both are linear in (f, z), and the operator is symmetric: U = U_F + R z + S G^T r, a = h_F - H z + R^T G^T r.

use super::frame::Frame;
use crate::error::{Error, Result};
use crate::linalg::{Engine, Factor};
use crate::obstacle::Bounds;
use crate::scheme::System;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side as Triangle};
use std::cell::RefCell;
use std::rc::Rc;

/// Corrections of the saddle point by its residual, K applied cell by cell.
const CORRECTIONS: usize = 2;

/// Of the compliance that a bounded dof has among its free neighbours, the constraint B U = C p must leave at least this part.
const INF_SUP: f64 = 1e-11;

/// The shift of a structure whose finite eigenvalues all vanish, relative to what a random motion sees.
const LEAST_SHIFT: f64 = 1e-6;

/// What a motion in p knows of the structure; N coordinates of velocities, n dofs, m bounds.
#[derive(Debug)]
pub(super) struct Reduction {
    /// Its N coordinates.
    pub frame: Rc<Frame>,
    /// alpha, in 1/s.
    pub damping: f64,
    /// H, N x N: the stiffness that z feels where nothing touches.
    pub stiffness: Mat<f64>,
    /// h_F, N.
    pub force: Mat<f64>,
    /// U_F, n.
    pub rest: Mat<f64>,
    /// R, n x N.
    pub lift: Mat<f64>,
    /// S G^T, n x m.
    pub push: Mat<f64>,
    /// G U_F, G R and G S G^T: m, m x N, m x m.
    pub rest_at: Mat<f64>,
    pub lift_at: Mat<f64>,
    pub compliance: Mat<f64>,
}

impl Reduction {
    /// Solves for all columns.
    ///
    /// # Errors
    /// [`Error::Singular`] where the inf-sup condition fails with these bounds.
    pub fn new<E: Engine>(saddle: &Saddle<E>) -> Result<Reduction> {
        let system = saddle.system;
        let (dofs, bounds) = (system.engine.dofs(), &system.bounds);
        let (cells, bounded) = (saddle.frame.size(), bounds.len());
        let load = Mat::from_fn(dofs, 1, |i, _| system.load.as_ref().map_or(0.0, |load| load[i]));
        let (rest, force) = saddle.solve(load, Mat::zeros(cells, 1))?;
        let (lift, acceleration) = saddle.solve(Mat::zeros(dofs, cells), Mat::identity(cells, cells))?;
        let unit_forces = Mat::from_fn(dofs, bounded, |i, j| f64::from(u8::from(bounds.dofs[j] == i)));
        let unbound = saddle.unbound(unit_forces.clone(), bounds)?;
        let (push, _) = saddle.solve(unit_forces, Mat::zeros(cells, bounded))?;
        let at = |of: &Mat<f64>| Mat::from_fn(bounded, of.ncols(), |i, j| of[(bounds.dofs[i], j)]);
        let reduction = Reduction {
            damping: system.damping.mass,
            stiffness: symmetric(&acceleration, -1.0),
            force,
            rest_at: at(&rest),
            lift_at: at(&lift),
            compliance: symmetric(&at(&push), 1.0),
            rest,
            lift,
            push,
            frame: saddle.frame.clone(),
        };
        reduction.check_inf_sup(&unbound)?;
        Ok(reduction)
    }

    /// Compares the pivots of the compliance G S G^T with those that it has without B U = C p.
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

/// (A + A^T) / 2 times a factor.
fn symmetric(a: &Mat<f64>, factor: f64) -> Mat<f64> {
    Mat::from_fn(a.nrows(), a.ncols(), |i, j| 0.5 * factor * (a[(i, j)] + a[(j, i)]))
}

/// The saddle point, by the factor of K + s M: definite where K and M share no rigid motion, and the same where B U is given.
pub(super) struct Saddle<'s, E: Engine> {
    system: &'s System<E>,
    frame: Rc<Frame>,
    shift: f64,
    factor: RefCell<E::Factor>,
    /// (K + s M)^-1 B~^T, n x N.
    columns: Mat<f64>,
    /// B~ (K + s M)^-1 B~^T, N x N.
    schur: Llt<f64>,
}

impl<'s, E: Engine> Saddle<'s, E> {
    /// Factors it.
    ///
    /// # Errors
    /// [`Error::Singular`] where the mass is not a singular one, or leaves some rigid motion without inertia.
    pub fn new(system: &'s System<E>) -> Result<Saddle<'s, E>> {
        let System { engine, stiffness, mass, .. } = system;
        let mut frame = Frame::new(system)?;
        let (dofs, cells) = (engine.dofs(), frame.size());
        let shift = shift(system)?;
        let mut factor =
            engine.factor(&[(1.0, stiffness), (shift, mass)], &[]).map_err(|error| match error {
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
            frame.momentum(system, &unit, column)?;
            factor.solve(column)?;
            unit[k] = 0.0;
        }
        let compliance = symmetric(&frame.of(system, &columns)?, 1.0);
        let schur = frame.reduce(&compliance).ok_or_else(|| {
            Error::Singular("time.scheme = \"exact\": no displacement moves any cell; refine the mesh".into())
        })?;
        // Each row of (K + s M)^-1 B~^T is one of velocities.
        let columns = frame.narrow(columns.transpose().to_owned()).transpose().to_owned();
        Ok(Saddle { system, frame: Rc::new(frame), shift, factor: factor.into(), columns, schur })
    }

    /// U and a of forces (n x k) and positions (N x k).
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
            position -= self.frame.of(self.system, &u)?;
            for j in 0..u.ncols() {
                engine.multiply(stiffness, u.col_as_slice(j), &mut product)?;
                force.col_as_slice_mut(j).iter_mut().zip(&product).for_each(|(f, k)| *f -= k);
                self.frame.momentum(self.system, acceleration.col_as_slice(j), &mut product)?;
                force.col_as_slice_mut(j).iter_mut().zip(&product).for_each(|(f, b)| *f -= b);
            }
        }
        Ok((u, acceleration))
    }

    /// One solution with the factor.
    fn propose(&self, forces: Mat<f64>, positions: &Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
        let mut u = forces;
        for j in 0..u.ncols() {
            self.factor.borrow_mut().solve(u.col_as_slice_mut(j))?;
        }
        let mut acceleration = self.frame.of(self.system, &u)?;
        acceleration -= positions;
        self.schur.solve_in_place(&mut acceleration);
        u -= &self.columns * &acceleration;
        acceleration += positions * faer::Scale(self.shift);
        Ok((u, acceleration))
    }

    /// G (K + s M)^-1 G^T: the compliance of bounded dofs without the constraint.
    fn unbound(&self, mut unit_forces: Mat<f64>, bounds: &Bounds) -> Result<Mat<f64>> {
        for j in 0..unit_forces.ncols() {
            self.factor.borrow_mut().solve(unit_forces.col_as_slice_mut(j))?;
        }
        Ok(Mat::from_fn(bounds.len(), bounds.len(), |i, j| unit_forces[(bounds.dofs[i], j)]))
    }
}

/// A shift of the order of the finite eigenvalues of K x = w^2 M x: their mean, by two looks at one vector.
fn shift<E: Engine>(system: &System<E>) -> Result<f64> {
    let System { engine, stiffness, mass, .. } = system;
    let mut product = vec![0.0; engine.dofs()];
    // Entries without pattern: the golden ratio's multiples modulo 1.
    let mut x: Vec<f64> =
        (1..=product.len()).map(|i| (i as f64 * 0.618_033_988_749_895).fract() - 0.5).collect();
    let mut quotient = |x: &[f64]| -> Result<f64> {
        let elastic = engine.multiply(stiffness, x, &mut product)?;
        let quotient = elastic / engine.multiply(mass, x, &mut product)?;
        Ok(if quotient.is_normal() { quotient } else { 1.0 })
    };
    let first = quotient(&x)?;
    let Ok(mut factor) = engine.factor(&[(1.0, stiffness), (first, mass)], &[]) else { return Ok(first) };
    let mut image = vec![0.0; x.len()];
    engine.multiply(mass, &x, &mut image)?;
    factor.solve(&mut image)?;
    x.copy_from_slice(&image);
    // Where only rigid motions have inertia the mean is rounding.
    Ok(quotient(&x)?.max(LEAST_SHIFT * first))
}
