//! Saddle-point problem behind `$\varphi$`, reduced to the coordinates of velocities.
//!
//! Let z be the coordinates of p in a [`VelocityBasis`] and `$\tilde B = Q^T C^{-1/2} B$`. For a
//! position z and forces `$f = F + G^T r$` the displacement U and the acceleration a (with a
//! diagonal matrix D of decay rates, `$a = z'' + D z'$`) solve
//!
//! ```math
//! K U + \tilde B^T a = f, \qquad \tilde B U = z.
//! ```
//!
//! Both are linear in (f, z), and the operator is symmetric: `$U = U_F + R z + S G^T r$`,
//! `$a = h_F - H z + R^T G^T r$`.

use crate::error::Result;
use crate::linalg::{Engine, Form};
use crate::obstacle::Bounds;
use crate::scheme::System;
use crate::scheme::massless::saddle_point::{SaddlePointSolver, symmetric};
use crate::scheme::massless::velocity_basis::VelocityBasis;
use faer::{Mat, Side as Triangle};
use std::rc::Rc;

/// Least part of a bounded dof's compliance among its free neighbours that must remain under the
/// constraint B U = C p.
const INF_SUP: f64 = 1e-11;

/// Reduced model of the structure; N velocity coordinates, n dofs, m candidates.
///
/// Candidates are the bounds that the event detection watches. With velocities of cells they are
/// all bounds of the system, with velocities of modes those in reach (see [`super::reach`]).
#[derive(Debug)]
pub(in crate::scheme) struct ReducedModel {
    /// Basis of the N velocity coordinates.
    pub basis: Rc<VelocityBasis>,
    /// Decay rates of the velocity coordinates, in 1/s.
    pub damping: Vec<f64>,
    /// Stiffness H in z without contact, N x N.
    pub stiffness: Mat<f64>,
    /// Force h_F, N entries.
    pub force: Mat<f64>,
    /// Displacement U_F at z = 0, n entries.
    pub rest: Mat<f64>,
    /// Displacements R per unit z, n x N.
    pub lift: Mat<f64>,
    /// Candidates as indices into the bounds of the system, ascending.
    pub candidates: Vec<usize>,
    /// Bounds on the candidates, which G selects below.
    pub bounds: Bounds,
    /// Displacements S G^T per unit reaction, n x m.
    pub flexibility: Mat<f64>,
    /// Values at the candidates: G U_F (m entries), G R (m x N) and the compliance G S G^T (m x m).
    pub rest_at: Mat<f64>,
    pub lift_at: Mat<f64>,
    pub compliance: Mat<f64>,
    /// Compliance without the constraint B U = C p, m x m.
    unbound: Mat<f64>,
}

/// Column of a candidate after an extension.
#[derive(Clone, Copy)]
enum Column {
    /// Column before the extension.
    Known(usize),
    /// Column among the new ones.
    New(usize),
}

impl ReducedModel {
    /// Solves the saddle-point problem for all columns with candidates, ascending indices into the
    /// bounds of the system.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the inf-sup condition fails with these bounds.
    pub fn new<E: Engine>(
        system: &System<E>,
        basis: Rc<VelocityBasis>,
        saddle: &dyn SaddlePointSolver,
        candidates: &[usize],
    ) -> Result<ReducedModel> {
        let (dofs, cells) = (system.engine.dofs(), basis.size());
        let load = Mat::from_fn(dofs, 1, |i, _| system.load.as_ref().map_or(0.0, |load| load[i]));
        let (rest, force) = saddle.solve(load, Mat::zeros(cells, 1))?;
        let (lift, acceleration) = saddle.solve(Mat::zeros(dofs, cells), Mat::identity(cells, cells))?;
        let mut reduction = ReducedModel {
            damping: match &system.mass {
                Form::Modal { modes, .. } => system.decay_rates(modes),
                _ => vec![system.damping.mass; cells],
            },
            stiffness: symmetric(&acceleration, -1.0),
            force,
            rest,
            lift,
            basis,
            candidates: Vec::new(),
            bounds: Bounds { size: system.bounds.size, ..Bounds::default() },
            flexibility: Mat::new(),
            rest_at: Mat::new(),
            lift_at: Mat::new(),
            compliance: Mat::new(),
            unbound: Mat::new(),
        };
        reduction.extend(system, saddle, candidates)?;
        Ok(reduction)
    }

    /// Adds candidates, ascending indices into the bounds of the system.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the inf-sup condition fails with the candidates.
    pub fn extend<E: Engine>(
        &mut self,
        system: &System<E>,
        saddle: &dyn SaddlePointSolver,
        more: &[usize],
    ) -> Result<()> {
        let System { engine, bounds, .. } = system;
        let dofs = engine.dofs();
        let places: Vec<usize> = more.iter().map(|&bound| bounds.dofs[bound]).collect();
        let unit_forces = Mat::from_fn(dofs, more.len(), |i, j| f64::from(places[j] == i));
        let unconstrained = saddle.unconstrained(unit_forces.clone())?;
        let flexibility = saddle.flexibility(unit_forces, &places, self.basis.size())?;
        let old = self.candidates.iter().enumerate().map(|(k, &bound)| (bound, Column::Known(k)));
        let new = more.iter().enumerate().map(|(k, &bound)| (bound, Column::New(k)));
        let mut columns: Vec<(usize, Column)> = old.chain(new).collect();
        columns.sort_unstable_by_key(|(bound, _)| *bound);
        let count = columns.len();
        self.candidates = columns.iter().map(|(bound, _)| *bound).collect();
        let each = |values: &[f64]| self.candidates.iter().map(|&i| values[i]).collect();
        self.bounds.dofs = self.candidates.iter().map(|&i| bounds.dofs[i]).collect();
        (self.bounds.lower, self.bounds.upper) = (each(&bounds.lower), each(&bounds.upper));
        let held = &self.bounds.dofs;
        self.unbound = Mat::from_fn(count, count, |i, j| match (columns[i].1, columns[j].1) {
            (_, Column::New(k)) => unconstrained[(held[i], k)],
            (Column::New(k), _) => unconstrained[(held[j], k)],
            (Column::Known(k), Column::Known(l)) => self.unbound[(k, l)],
        });
        self.flexibility = Mat::from_fn(dofs, count, |i, j| match columns[j].1 {
            Column::Known(k) => self.flexibility[(i, k)],
            Column::New(k) => flexibility[(i, k)],
        });
        let rows = |matrix: &Mat<f64>| Mat::from_fn(count, matrix.ncols(), |i, j| matrix[(held[i], j)]);
        self.rest_at = rows(&self.rest);
        self.lift_at = rows(&self.lift);
        self.compliance = symmetric(&rows(&self.flexibility), 1.0);
        match remains(&self.compliance, &self.unbound) {
            true => Ok(()),
            false => Err(saddle.rigid_contact(&self.compliance, &self.bounds.dofs)),
        }
    }
}

/// Returns whether the inf-sup condition holds: the pivots of the compliance under the constraint
/// B U = C p are those of the compliance without it, but for a part.
pub(in crate::scheme) fn remains(constrained: &Mat<f64>, unbound: &Mat<f64>) -> bool {
    let pivots = |matrix: &Mat<f64>| -> Option<Vec<f64>> {
        let llt = matrix.llt(Triangle::Lower).ok()?;
        Some((0..matrix.nrows()).map(|i| llt.L()[(i, i)].powi(2)).collect())
    };
    let (Some(held), Some(whole)) = (pivots(constrained), pivots(unbound)) else {
        return false;
    };
    held.iter().zip(&whole).all(|(held, whole)| *held > INF_SUP * whole)
}
