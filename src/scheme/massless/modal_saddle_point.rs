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
//! corrects the rounding of the factor. How much a round leaves is measured at the start, so that
//! the number of rounds is the same for all forces. The difference of the whole compliance and that
//! of the modes would lose up to half of the digits instead.

use super::contact_compliance::ContactCompliance;
use super::saddle_point::SaddlePointSolver;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot, subtract};
use crate::linalg::{Engine, Factor, Form, MassModes};
use crate::modes::{KeptColumns, current_store};
use crate::random::golden_vector;
use crate::scheme::System;
use faer::Mat;
use std::cell::RefCell;
use std::rc::Rc;

/// Shift s of a mechanism, relative to the square of the highest kept frequency.
const SHIFT: f64 = 1e-3;

/// Relative accuracy of the displacements, and the largest number of rounds. One or two rounds
/// reach it, and four with rigid motions.
const ACCURACY: f64 = 1e-11;
const MAX_ROUNDS: usize = 8;

/// Number of unit forces that are solved for together on an engine that
/// [repeats](Engine::REPEATS) its results. With blocks of one width the bits of a displacement do
/// not depend on the other forces, so that it may be kept for runs in which other nodes touch.
const WIDTH: usize = 8;

/// Solver for velocities of modes; see the [module page](self).
pub(crate) struct ModalSaddlePoint<'s, E: Engine> {
    pub system: &'s System<E>,
    pub modes: Rc<MassModes>,
    /// Shift s, in (rad/s)^2.
    pub shift: f64,
    factor: RefCell<Box<dyn Factor>>,
    /// Number of rounds of the iteration.
    rounds: usize,
    /// Displacements per unit force, kept between runs.
    kept: RefCell<KeptColumns>,
}

impl<'s, E: Engine> ModalSaddlePoint<'s, E> {
    /// Factors K, or K + s M_r where the modes contain rigid motions, given the form M_r of which
    /// they are modes. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the matrix is not positive definite.
    pub fn new(
        system: &'s System<E>,
        inertia: &Form,
        modes: &Rc<MassModes>,
    ) -> Result<ModalSaddlePoint<'s, E>> {
        let System { engine, stiffness, .. } = system;
        let squares = &modes.squares;
        let is_mechanism = squares.first().is_some_and(|square| *square == 0.0);
        let highest = squares.last().copied().unwrap_or(0.0);
        let shift = if is_mechanism { SHIFT * highest } else { 0.0 };
        let sum = match is_mechanism {
            true => stiffness + inertia * shift,
            false => stiffness.into(),
        };
        let mut saddle = ModalSaddlePoint {
            system,
            modes: modes.clone(),
            shift,
            factor: engine.factor(&sum, &[])?.into(),
            rounds: 1,
            kept: KeptColumns::new(current_store().zip(modes.key), engine.dofs(), 2 * modes.count()).into(),
        };
        saddle.rounds = saddle.rounds_needed()?;
        Ok(saddle)
    }

    /// Returns the part h of the displacements under forces (n x k) that the modes leave.
    /// Collective.
    pub fn rest(&self, forces: &Mat<f64>) -> Result<Mat<f64>> {
        let comm = self.system.engine.comm();
        if comm.all_reduce_max(forces.norm_max()) == 0.0 {
            return Ok(Mat::zeros(forces.nrows(), forces.ncols()));
        }
        let along = summed(comm, self.modes.shapes.transpose() * forces);
        self.rest_along(forces, &along)
    }

    /// Returns the displacements of [`Self::rest`] per unit force at some dofs, `None` for those of
    /// other ranks, given the modal forces (m x k). Collective.
    pub fn rest_of_units(&self, dofs: &[Option<usize>], along: &Mat<f64>) -> Result<Vec<Rc<[f64]>>> {
        let rows = self.system.engine.dofs();
        if !E::REPEATS {
            let forces = Mat::from_fn(rows, dofs.len(), |i, j| f64::from(dofs[j] == Some(i)));
            let h = self.rest_along(&forces, along)?;
            return Ok((0..h.ncols()).map(|j| h.col_as_slice(j).into()).collect());
        }
        let mut kept = self.kept.borrow_mut();
        let mut columns: Vec<Option<Rc<[f64]>>> = dofs.iter().map(|dof| kept.get((*dof)?)).collect();
        let missing: Vec<usize> = (0..dofs.len()).filter(|&j| columns[j].is_none()).collect();
        for part in missing.chunks(WIDTH) {
            let (mut forces, mut modal) = (Mat::zeros(rows, WIDTH), Mat::zeros(along.nrows(), WIDTH));
            for (k, &j) in part.iter().enumerate() {
                dofs[j].into_iter().for_each(|dof| forces[(dof, k)] = 1.0);
                modal.col_mut(k).copy_from(along.col(j));
            }
            let h = self.rest_along(&forces, &modal)?;
            for (k, &j) in part.iter().enumerate() {
                let column: Rc<[f64]> = h.col_as_slice(k).into();
                dofs[j].into_iter().for_each(|dof| kept.add(dof, &column));
                columns[j] = Some(column);
            }
        }
        Ok(columns.into_iter().flatten().collect())
    }

    /// Returns the displacements of [`Self::rest`], given the modal forces `$\Phi^T f$` (m x k).
    /// Collective.
    pub fn rest_along(&self, forces: &Mat<f64>, along: &Mat<f64>) -> Result<Mat<f64>> {
        let b = forces - &self.modes.momenta * along;
        let mut h = self.round(b.clone())?;
        for _ in 1..self.rounds {
            let mut residual = b.clone();
            self.subtract_forces(&h, &mut residual)?;
            h += self.round(residual)?;
        }
        Ok(h)
    }

    /// Returns P S^-1 b. Collective.
    fn round(&self, mut b: Mat<f64>) -> Result<Mat<f64>> {
        self.factor.borrow_mut().solve_columns(&mut b)?;
        self.remove_modes(&mut b);
        Ok(b)
    }

    /// Returns the number of rounds that lead to displacements of the wanted accuracy, from the
    /// share of the error that a round leaves under pseudo-random forces. Collective.
    fn rounds_needed(&self) -> Result<usize> {
        let comm = self.system.engine.comm();
        let force = golden_vector(self.system.engine.dofs());
        let mut b = Mat::from_fn(force.len(), 1, |i, _| force[i]);
        let along = summed(comm, self.modes.shapes.transpose() * &b);
        b -= &self.modes.momenta * along;
        let h = self.round(b.clone())?;
        self.subtract_forces(&h, &mut b)?;
        let square = |force: &Mat<f64>| dot(force.col_as_slice(0), force.col_as_slice(0));
        let [rest, whole] = comm.all_reduce_sum([square(&self.round(b)?), square(&h)]);
        let measured = if whole == 0.0 { 0.0 } else { (rest / whole).sqrt() };
        let share = if self.shift > 0.0 { SHIFT.max(measured) } else { measured };
        let enough = |rounds: &usize| share.powi(*rounds as i32) <= ACCURACY;
        Ok((1..MAX_ROUNDS).find(enough).unwrap_or(MAX_ROUNDS))
    }

    /// Subtracts the forces K h of displacements (n x k).
    fn subtract_forces(&self, h: &Mat<f64>, forces: &mut Mat<f64>) -> Result<()> {
        let System { engine, stiffness, .. } = self.system;
        let mut product = vec![0.0; h.nrows()];
        for j in 0..h.ncols() {
            engine.multiply(stiffness, h.col_as_slice(j), &mut product)?;
            subtract(&product, forces.col_as_slice_mut(j));
        }
        Ok(())
    }

    /// Projects displacements (n x k) on those that no mode carries, h <- P h. Collective.
    fn remove_modes(&self, h: &mut Mat<f64>) {
        // In this order the product does not rearrange the long matrix of the momenta.
        let along = (h.transpose() * &self.modes.momenta).transpose().to_owned();
        *h -= &self.modes.shapes * summed(self.system.engine.comm(), along);
    }
}

/// Returns the sum of a matrix over all ranks, the same on each. Collective.
pub(crate) fn summed(comm: &impl Communicator, share: Mat<f64>) -> Mat<f64> {
    if comm.size() == 1 {
        return share;
    }
    let rows = share.nrows();
    let entries: Vec<f64> = (0..share.ncols()).flat_map(|j| share.col_as_slice(j)).copied().collect();
    let sums = comm.all_reduce_sum_slice(&entries);
    Mat::from_fn(rows, share.ncols(), |i, j| sums[rows * j + i])
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

    fn flexibility(&self, unit_forces: Mat<f64>, dofs: &[usize], _positions: usize) -> Result<Mat<f64>> {
        let bounded: Vec<Option<usize>> = dofs.iter().copied().map(Some).collect();
        let shapes = &self.modes.shapes;
        let along = Mat::from_fn(shapes.ncols(), dofs.len(), |k, j| shapes[(dofs[j], k)]);
        let columns = self.rest_of_units(&bounded, &along)?;
        Ok(Mat::from_fn(unit_forces.nrows(), dofs.len(), |i, j| columns[j][i]))
    }

    fn unconstrained(&self, forces: Mat<f64>) -> Result<Mat<f64>> {
        let mut solutions = forces;
        self.factor.borrow_mut().solve_columns(&mut solutions)?;
        Ok(solutions)
    }

    fn shift(&self) -> f64 {
        self.shift
    }

    fn rigid_contact(&self, compliance: &Mat<f64>, dofs: &[usize]) -> Error {
        let MassModes { squares, shapes, .. } = &*self.modes;
        let shapes = Mat::from_fn(dofs.len(), squares.len(), |i, k| shapes[(dofs[i], k)]);
        ContactCompliance { compliance: compliance.clone(), shapes, squares: squares.clone() }.refusal()
    }
}

impl ContactCompliance {
    /// Computes the compliance at some deflection dofs of a system with the modal mass.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for another mass, and the errors of the engine.
    pub fn new<E: Engine>(system: &System<E>, dofs: &[usize]) -> Result<ContactCompliance> {
        let Form::Modal { consistent, modes } = &system.mass else {
            return Err(Error::Usage("this compliance needs time.mass = \"modal\"".into()));
        };
        let saddle = ModalSaddlePoint::new(system, &Form::Cells(consistent.clone()), modes)?;
        let bounded: Vec<Option<usize>> = dofs.iter().copied().map(Some).collect();
        let along = Mat::from_fn(modes.count(), dofs.len(), |k, j| modes.shapes[(dofs[j], k)]);
        let responses = saddle.rest_of_units(&bounded, &along)?;
        let mean = |i: usize, j: usize| 0.5 * (responses[j][dofs[i]] + responses[i][dofs[j]]);
        Ok(ContactCompliance {
            compliance: Mat::from_fn(dofs.len(), dofs.len(), mean),
            shapes: Mat::from_fn(dofs.len(), modes.count(), |i, k| modes.shapes[(dofs[i], k)]),
            squares: modes.squares.clone(),
        })
    }
}
