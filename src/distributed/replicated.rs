//! Factor that every rank has in full.

use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::{Cholesky, Factor, PreciseEntry, SchurFactor, factor_precise};
use crate::memory;
use crate::petsc::Context;
use faer::Mat;
use std::ops::Range;
use std::rc::Rc;

/// Factor of the matrix of all ranks with twice the digits of a double, in full on each rank.
///
/// It replaces a factor in doubles that rounding has made useless for slow motions, as on cells a
/// thousand times as long as wide. How many digits MUMPS loses also depends on the kernels of BLAS.
pub struct ReplicatedFactor {
    context: Rc<Context>,
    factor: Cholesky,
    /// Range of this rank's dofs among the dofs of all ranks.
    range: Range<usize>,
    dofs: usize,
}

impl ReplicatedFactor {
    /// Factors the matrix to whose lower triangle the ranks contribute, with the contact dofs of
    /// each rank (ascending, counted from its first dof) last. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Memory`] on all ranks where the entries do not fit on one of them,
    /// and the errors of [`Cholesky::new`].
    pub(super) fn new(
        context: &Rc<Context>,
        entries: &[PreciseEntry],
        range: Range<usize>,
        contact_dofs: &[usize],
    ) -> Result<ReplicatedFactor> {
        let comm = context.comm();
        let [dofs, count] = comm.all_reduce_sum([range.len(), entries.len()]);
        let bytes = (3 * count * size_of::<PreciseEntry>()) as u64;
        let room = memory::require_of_each(bytes, comm.size(), "the entries of the whole matrix", |_| {
            "cells that are less slender need no factor with twice the digits".into()
        });
        comm.all_ok(room)?;
        let entries = comm.all_gather(entries);
        let contact_dofs: Vec<usize> = contact_dofs.iter().map(|dof| range.start + dof).collect();
        let factor = factor_precise(dofs, &entries, &comm.all_gather(&contact_dofs));
        Ok(ReplicatedFactor { context: context.clone(), factor: comm.all_ok(factor)?, range, dofs })
    }

    /// Returns the values of all ranks. Collective.
    fn gather(&self, values: &[f64]) -> Vec<f64> {
        self.context.comm().all_gather(values)
    }
}

impl Factor for ReplicatedFactor {
    fn schur_factor(&mut self) -> Option<&mut dyn SchurFactor> {
        Some(self)
    }

    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        let mut values = self.gather(x);
        self.factor.solve(&mut values)?;
        x.copy_from_slice(&values[self.range.clone()]);
        Ok(())
    }

    fn has_twice_the_digits(&self) -> bool {
        true
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        let dofs: Vec<usize> = dofs.iter().map(|dof| self.range.start + dof).collect();
        self.factor.pin(&self.context.comm().all_gather(&dofs))
    }
}

impl SchurFactor for ReplicatedFactor {
    fn schur(&mut self) -> &Mat<f64> {
        self.factor.schur()
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], more: &mut [f64]) -> Result<()> {
        self.context.comm().all_reduce_sum_slice_unordered(more);
        let values = self.gather(b);
        self.factor.forward_to_schur(&values, h, &mut [])
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        let mut solution = vec![0.0; self.dofs];
        self.factor.back_substitute(values, &mut solution)?;
        x.copy_from_slice(&solution[self.range.clone()]);
        Ok(())
    }

    fn solve_schur(&mut self, h: &mut [f64]) {
        self.factor.solve_schur(h);
    }
}
