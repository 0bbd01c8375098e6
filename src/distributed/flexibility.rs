//! Flexibility of the contact dofs over all ranks.

use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::axpy;
use crate::petsc::{Comm, Context, Ksp, Matrix};
use faer::Mat;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use std::collections::BTreeSet;
use std::rc::Rc;

/// Number of columns of the inverse that are computed at once.
const BLOCK: usize = 64;

/// Largest number of contact dofs for which this rank's part of the columns of A^-1 is kept: a
/// product with more of them takes as long as a solve.
const MOST_COLUMNS: usize = 300;

/// Block of A^-1 at the contact dofs, and its inverse, the Schur complement of A on them.
///
/// The columns of A^-1 come from solves with many right-hand sides at once. They are kept, so that
/// the displacement by forces at the contact dofs is a product, not a solve.
pub(super) struct Flexibility {
    context: Rc<Context>,
    /// Number of dofs that this rank owns.
    owned: usize,
    /// Contact dofs of this rank (ascending), and the number of contact dofs of lower ranks.
    dofs: Vec<usize>,
    before: usize,
    /// Number of the lot in which each contact dof of all ranks was added.
    lots: Vec<u32>,
    /// Block of A^-1, in m/N, and its inverse.
    block: Mat<f64>,
    schur: Mat<f64>,
    /// Columns of A^-1 for the contact dofs of all ranks, at the dofs that this rank owns, in m/N.
    columns: Option<Mat<f64>>,
}

impl Flexibility {
    /// Creates the flexibility of no contact dofs, for a rank that owns `owned` dofs.
    pub fn new(context: &Rc<Context>, owned: usize) -> Flexibility {
        let none = || Mat::zeros(0, 0);
        Flexibility {
            context: context.clone(),
            owned,
            dofs: Vec::new(),
            before: 0,
            lots: Vec::new(),
            block: none(),
            schur: none(),
            columns: Some(Mat::zeros(owned, 0)),
        }
    }

    /// Returns the Schur complement.
    pub fn schur(&self) -> &Mat<f64> {
        &self.schur
    }

    /// Returns the values at the contact dofs of all ranks, given a vector over the dofs of this
    /// rank. Collective.
    pub fn gather(&self, x: &[f64]) -> Vec<f64> {
        self.context.comm().all_gather(&self.dofs.iter().map(|&dof| x[dof]).collect::<Vec<_>>())
    }

    /// Returns the product of the Schur complement with values at the contact dofs.
    pub fn times_schur(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (j, x) in x.iter().enumerate() {
            axpy(*x, self.schur.col_as_slice(j), &mut product);
        }
        product
    }

    /// Solves H x = h in place with the Schur complement H.
    pub fn solve_schur(&self, h: &mut [f64]) {
        let mut right = Mat::from_fn(h.len(), 1, |i, _| h[i]);
        if let Ok(llt) = self.schur.llt(faer::Side::Lower) {
            llt.solve_in_place(&mut right);
        }
        h.iter_mut().enumerate().for_each(|(i, h)| *h = right[(i, 0)]);
    }

    /// Sets x to forces at the contact dofs of all ranks, in N.
    pub fn put_forces(&self, forces: &[f64], x: &mut [f64]) {
        x.fill(0.0);
        for (&dof, force) in self.dofs.iter().zip(&forces[self.before..]) {
            x[dof] = *force;
        }
    }

    /// Adds the displacement by forces at the contact dofs to x. Returns `false`, and changes
    /// nothing, where the columns are not kept.
    pub fn add_displacement(&self, forces: &[f64], x: &mut [f64]) -> bool {
        let Some(columns) = &self.columns else { return false };
        for (j, force) in forces.iter().enumerate().filter(|(_, force)| **force != 0.0) {
            axpy(*force, columns.col_as_slice(j), x);
        }
        true
    }

    /// Replaces the contact dofs, given the solver of A; columns of those that stay are kept.
    /// Collective.
    pub fn set(&mut self, dofs: &[usize], solver: &mut Ksp) -> Result<()> {
        // Whether each contact dof is an old one, and its index among them.
        let place = |dof: &usize| {
            let old = self.dofs.binary_search(dof);
            (old.is_ok(), old.map_or(0, |k| self.before + k))
        };
        let places: Vec<(bool, usize)> = dofs.iter().map(place).collect();
        let owned = self.owned;
        let (places, before) = self.context.comm().all_gather_with_offset(&places);
        (self.dofs, self.before) = (dofs.to_vec(), before);
        let count = places.len();
        let old = |i: usize| places[i].0.then_some(places[i].1);

        let latest = (0..count).filter_map(old).map(|i| self.lots[i]).max();
        let lot = latest.map_or(0, |lot| lot + 1);
        self.lots = (0..count).map(|i| old(i).map_or(lot, |i| self.lots[i])).collect();
        let kept = |i: usize, j: usize| old(i).zip(old(j)).map_or(0.0, |entry| self.block[entry]);
        self.block = Mat::from_fn(count, count, kept);
        self.columns = self.columns.take().filter(|_| count <= MOST_COLUMNS).map(|columns| {
            let column = |j: usize| old(j).map(|j| columns.col_as_slice(j));
            Mat::from_fn(owned, count, |row, j| column(j).map_or(0.0, |column| column[row]))
        });
        if count == 0 {
            self.columns = Some(Mat::zeros(owned, 0));
        }
        self.add(lot, solver)?;
        self.invert()
    }

    /// Solves for the columns of the contact dofs of a lot, the last one so far. Collective.
    fn add(&mut self, lot: u32, solver: &mut Ksp) -> Result<()> {
        let count = self.lots.len();
        let new: Vec<usize> = (0..count).filter(|&j| self.lots[j] == lot).collect();
        for some in new.chunks(BLOCK) {
            self.solve_for_columns(some, solver)?;
        }
        for (&j, i) in new.iter().flat_map(|j| (0..count).map(move |i| (j, i))) {
            // Both columns were solved for: take their mean.
            let both = self.lots[i] == lot;
            let value =
                if both { 0.5 * (self.block[(i, j)] + self.block[(j, i)]) } else { self.block[(i, j)] };
            (self.block[(i, j)], self.block[(j, i)]) = (value, value);
        }
        Ok(())
    }

    /// Solves for some columns of A^-1. Collective.
    fn solve_for_columns(&mut self, some: &[usize], solver: &mut Ksp) -> Result<()> {
        let owned = self.owned;
        let mut right = Matrix::dense(&self.context, Comm::World, owned, some.len())?;
        let mut solution = Matrix::dense(&self.context, Comm::World, owned, some.len())?;
        right.with_columns_mut(|values| {
            for (number, column) in some.iter().enumerate() {
                let mine = column.checked_sub(self.before).and_then(|k| self.dofs.get(k));
                if let Some(dof) = mine {
                    values[number * owned + dof] = 1.0;
                }
            }
        })?;
        solver.solve_columns(&right, &mut solution)?;

        let count = self.lots.len();
        let mut rows = vec![0.0; count * some.len()];
        solution.with_columns(|values| {
            for (number, &column) in some.iter().enumerate() {
                let values = &values[number * owned..][..owned];
                for (k, &dof) in self.dofs.iter().enumerate() {
                    rows[number * count + self.before + k] = values[dof];
                }
                if let Some(columns) = &mut self.columns {
                    columns.col_as_slice_mut(column).copy_from_slice(values);
                }
            }
        })?;
        self.context.comm().all_reduce_sum_slice_unordered(&mut rows);
        for (&column, rows) in some.iter().zip(rows.chunks_exact(count)) {
            self.block.col_as_slice_mut(column).copy_from_slice(rows);
        }
        Ok(())
    }

    /// Computes the Schur complement.
    fn invert(&mut self) -> Result<()> {
        let count = self.block.nrows();
        self.schur = Mat::zeros(0, 0);
        if count > 0 {
            let llt = self.block.llt(faer::Side::Lower).map_err(|_| {
                Error::Singular(format!("the flexibility of {count} contact dofs is not positive definite"))
            })?;
            self.schur = llt.inverse();
        }
        Ok(())
    }

    /// Saves or restores in which lots the contact dofs were added, on which the last digits of the
    /// columns depend. Collective.
    pub fn archive(&mut self, solver: &mut Ksp, archive: &mut Archive) -> Result<()> {
        let mut lots = self.lots.clone();
        if archive.value_of_same(&mut lots)? && lots != self.lots {
            let dofs = std::mem::take(&mut self.dofs);
            let dofs: Vec<(usize, u32)> = dofs.into_iter().zip(lots[self.before..].iter().copied()).collect();
            self.set(&[], solver)?;
            for last in lots.iter().copied().collect::<BTreeSet<u32>>() {
                let so_far = dofs.iter().filter(|(_, lot)| *lot <= last);
                self.set(&so_far.map(|(dof, _)| *dof).collect::<Vec<_>>(), solver)?;
            }
            self.lots = lots;
        }
        Ok(())
    }
}
