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

use super::saddle_point::{SaddlePointSolver, symmetric};
use super::velocity_basis::VelocityBasis;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::System;
use faer::{Mat, Side as Triangle};
use std::rc::Rc;

/// Least part of a bounded dof's compliance among its free neighbours that must remain under the
/// constraint B U = C p.
const INF_SUP: f64 = 1e-11;

/// Reduced model of the structure; N velocity coordinates, n dofs, m bounds.
#[derive(Debug)]
pub(in crate::scheme) struct ReducedModel {
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
    pub fn new<E: Engine>(
        system: &System<E>,
        basis: Rc<VelocityBasis>,
        saddle: &dyn SaddlePointSolver,
    ) -> Result<ReducedModel> {
        let (dofs, bounds) = (system.engine.dofs(), &system.bounds);
        let (cells, bounded) = (basis.size(), bounds.len());
        let load = Mat::from_fn(dofs, 1, |i, _| system.load.as_ref().map_or(0.0, |load| load[i]));
        let (rest, force) = saddle.solve(load, Mat::zeros(cells, 1))?;
        let (lift, acceleration) = saddle.solve(Mat::zeros(dofs, cells), Mat::identity(cells, cells))?;
        let at = |of: &Mat<f64>| Mat::from_fn(bounded, of.ncols(), |i, j| of[(bounds.dofs[i], j)]);
        let unit_forces = Mat::from_fn(dofs, bounded, |i, j| f64::from(bounds.dofs[j] == i));
        let unbound = at(&saddle.unconstrained(unit_forces.clone())?);
        let (flexibility, _) = saddle.solve(unit_forces, Mat::zeros(cells, bounded))?;
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
            basis,
        };
        if reduction.is_compliant(&unbound) { Ok(reduction) } else { Err(saddle.rigid_contact()) }
    }

    /// Returns whether the inf-sup condition holds: the pivots of the compliance G S G^T are those
    /// of the compliance without the constraint B U = C p, but for a part.
    fn is_compliant(&self, unbound: &Mat<f64>) -> bool {
        let pivots = |of: &Mat<f64>| -> Option<Vec<f64>> {
            let llt = of.llt(Triangle::Lower).ok()?;
            Some((0..of.nrows()).map(|i| llt.L()[(i, i)].powi(2)).collect())
        };
        let (Some(left), Some(whole)) = (pivots(&self.compliance), pivots(unbound)) else { return false };
        left.iter().zip(&whole).all(|(left, whole)| *left > INF_SUP * whole)
    }
}
