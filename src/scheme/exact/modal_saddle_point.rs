//! Saddle-point problem for the velocities of modes.
//!
//! With `$B = \Phi^T M_r$` for the lowest modes `$K \Phi = M_r \Phi \Omega^2$`, the displacement
//! splits into modes and rest, which K does not couple:
//!
//! ```math
//! U = \Phi z + h, \qquad a = \Phi^T f - \Omega^2 z, \qquad
//! K h = f - M_r \Phi\, \Phi^T f, \quad \Phi^T M_r h = 0 .
//! ```
//!
//! The right-hand side for h has no part along the modes, rigid motions among them, so that the
//! problem has a solution where K is singular. It is found by iteration with the factor of
//! S = K + s M_r, followed each time by the projection:
//! `$h \leftarrow P (h + S^{-1} (b - K h))$` with `$P = 1 - \Phi \Phi^T M_r$`. Each round leaves
//! the share `$s / (s + w^2)$` of the error, where w is the lowest frequency beyond the modes, and
//! corrects the rounding of the factor. The difference of the whole compliance and that of the
//! modes would lose up to half of the digits instead.

use super::saddle_point::SaddlePointSolver;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot, subtract};
use crate::linalg::{CellForm, Engine, Factor, Form, MassModes};
use crate::scheme::System;
use faer::Mat;
use std::cell::RefCell;
use std::rc::Rc;

/// Shift s of a mechanism, relative to the square of the highest kept frequency.
const SHIFT: f64 = 1e-3;

/// Relative size of the next increment at which the iteration ends, the share of the last one above
/// which an increment is rounding, and the largest number of rounds. Five rounds reach the end with
/// rigid motions, two or three without.
const SETTLED: f64 = 1e-15;
const STALLED: f64 = 0.25;
const MAX_ROUNDS: usize = 8;

/// Solver for velocities of modes; see the [module page](self).
pub(in crate::scheme) struct ModalSaddlePoint<'s, E: Engine> {
    system: &'s System<E>,
    modes: Rc<MassModes>,
    /// Number of dofs of all ranks.
    dofs: usize,
    factor: RefCell<E::Factor>,
}

impl<'s, E: Engine> ModalSaddlePoint<'s, E> {
    /// Factors K, or K + s M_r where the modes contain rigid motions. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the matrix is not positive definite.
    pub fn new(
        system: &'s System<E>,
        consistent: &CellForm,
        modes: &Rc<MassModes>,
    ) -> Result<ModalSaddlePoint<'s, E>> {
        let System { engine, stiffness, .. } = system;
        let squares = &modes.squares;
        let is_mechanism = squares.first().is_some_and(|square| *square == 0.0);
        let highest = squares.last().copied().unwrap_or(0.0);
        let consistent = Form::Cells(consistent.clone());
        let sum = match is_mechanism {
            true => stiffness + &consistent * (SHIFT * highest),
            false => stiffness.into(),
        };
        Ok(ModalSaddlePoint {
            system,
            modes: modes.clone(),
            dofs: engine.comm().all_reduce_sum(engine.dofs()),
            factor: engine.factor(&sum, &[])?.into(),
        })
    }

    /// Returns the part h of the displacements under forces (n x k) that the modes leave.
    /// Collective.
    pub fn rest(&self, forces: &Mat<f64>) -> Result<Mat<f64>> {
        let System { engine, stiffness, .. } = self.system;
        let (modes, comm) = (&self.modes, engine.comm());
        let mut h = Mat::<f64>::zeros(forces.nrows(), forces.ncols());
        if comm.all_reduce_max(forces.norm_max()) == 0.0 {
            return Ok(h);
        }
        let along = summed(comm, modes.shapes.transpose() * forces);
        let b = forces - &modes.momenta * along;
        if comm.all_reduce_max(b.norm_max()) == 0.0 {
            return Ok(h);
        }
        let mut factor = self.factor.borrow_mut();
        let mut product = vec![0.0; b.nrows()];
        let mut last = 1.0;
        for round in 0..MAX_ROUNDS {
            let mut increment = b.clone();
            if round > 0 {
                for j in 0..h.ncols() {
                    engine.multiply(stiffness, h.col_as_slice(j), &mut product)?;
                    subtract(&product, increment.col_as_slice_mut(j));
                }
            }
            factor.solve_columns(&mut increment)?;
            self.remove_modes(&mut increment);
            h += &increment;
            let square = |of: &Mat<f64>, j: usize| dot(of.col_as_slice(j), of.col_as_slice(j));
            let own: Vec<[f64; 2]> = (0..h.ncols()).map(|j| [square(&increment, j), square(&h, j)]).collect();
            let sums = comm.all_reduce_sum_slice(&own);
            let change = sums.iter().map(|[change, whole]| (change / whole).sqrt()).fold(0.0, f64::max);
            // The next change is about as much smaller as this one.
            if change * change <= SETTLED * last || round > 0 && change > STALLED * last {
                break;
            }
            last = change;
        }
        self.remove_modes(&mut h);
        Ok(h)
    }

    /// Projects displacements (n x k) on those that no mode carries, h <- P h. Collective.
    fn remove_modes(&self, h: &mut Mat<f64>) {
        let along = summed(self.system.engine.comm(), self.modes.momenta.transpose() * &*h);
        *h -= &self.modes.shapes * along;
    }
}

/// Returns the sum of a matrix over all ranks, the same on each. Collective.
pub(in crate::scheme) fn summed(comm: &impl Communicator, own: Mat<f64>) -> Mat<f64> {
    if comm.size() == 1 {
        return own;
    }
    let rows = own.nrows();
    let entries: Vec<f64> = (0..own.ncols()).flat_map(|j| own.col_as_slice(j)).copied().collect();
    let sums = comm.all_reduce_sum_slice(&entries);
    Mat::from_fn(rows, own.ncols(), |i, j| sums[rows * j + i])
}

impl<E: Engine> SaddlePointSolver for ModalSaddlePoint<'_, E> {
    fn solve(&self, forces: Mat<f64>, positions: Mat<f64>) -> Result<(Mat<f64>, Mat<f64>)> {
        let modes = &self.modes;
        let mut u = self.rest(&forces)?;
        let entries = |j: usize| {
            let column = positions.col_as_slice(j).iter().copied().enumerate();
            column.filter(|(_, z)| *z != 0.0)
        };
        // Most positions are single modes, or zero.
        if (0..positions.ncols()).all(|j| entries(j).nth(1).is_none()) {
            for j in 0..positions.ncols() {
                entries(j).for_each(|(k, z)| axpy(z, modes.shapes.col_as_slice(k), u.col_as_slice_mut(j)));
            }
        } else {
            u = &modes.shapes * &positions + u;
        }
        let comm = self.system.engine.comm();
        let mut acceleration = match comm.all_reduce_max(forces.norm_max()) == 0.0 {
            true => Mat::zeros(modes.count(), forces.ncols()),
            false => summed(comm, modes.shapes.transpose() * &forces),
        };
        for j in 0..acceleration.ncols() {
            for (k, square) in modes.squares.iter().enumerate() {
                acceleration[(k, j)] -= square * positions[(k, j)];
            }
        }
        Ok((u, acceleration))
    }

    fn unconstrained(&self, forces: Mat<f64>) -> Result<Mat<f64>> {
        let mut solutions = forces;
        self.factor.borrow_mut().solve_columns(&mut solutions)?;
        Ok(solutions)
    }

    fn rigid_contact(&self) -> Error {
        Error::Usage(format!(
            "time.modes = {}: so many modes leave the nodes in contact no compliance of their own; expected at most {}",
            self.modes.count(),
            self.dofs / 3
        ))
    }
}
