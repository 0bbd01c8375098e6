//! Bounds of all ranks, which every rank has.
//!
//! The state of the modes, the candidates for contact and their reactions are the same on every
//! rank, and each decides alike from the same numbers, so that steps need no communication. For
//! that the bounds of all ranks have one numbering, which does not depend on the partition, and
//! every rank has the mode shapes at all of them: 8 bytes per mode and bound. In a single process
//! without a partition the numbers are the indices of the system's bounds.

use super::limits::Limits;
use crate::communicator::Communicator;
use crate::contact_law::Laws;
use crate::error::Result;
use crate::linalg::{Engine, MassModes};
use crate::memory;
use crate::obstacle::Bounds;
use crate::scheme::System;
use faer::Mat;

/// Bounds of all ranks; see the [module page](self).
#[derive(Debug)]
pub(crate) struct AllBounds {
    /// Number of bounds of all ranks.
    count: usize,
    /// Indices of this rank's bounded dofs.
    dofs: Vec<usize>,
    /// Laws by which they yield.
    pub laws: Laws,
    /// Numbers of the bounds; `None` where they are those of the only process.
    partition: Option<GlobalNumbers>,
}

/// Numbers of bounds.
#[derive(Debug)]
struct GlobalNumbers {
    /// Numbers of this rank's bounds.
    own: Vec<usize>,
    /// Index among this rank's bounds, one entry per number; `None` for those of other ranks.
    index: Vec<Option<usize>>,
    /// Numbers of the bounds of all ranks, in the order of the ranks.
    order: Vec<usize>,
}

impl AllBounds {
    /// Numbers the bounds of a system. Collective.
    pub fn new<E: Engine>(system: &System<E>) -> AllBounds {
        let System { engine, bounds, bound_numbers, .. } = system;
        let partition = bound_numbers.as_ref().map(|numbers| {
            let mut index = vec![None; numbers.total];
            numbers.own.iter().enumerate().for_each(|(i, &number)| index[number] = Some(i));
            GlobalNumbers { own: numbers.own.clone(), index, order: engine.comm().all_gather(&numbers.own) }
        });
        let count = partition.as_ref().map_or(bounds.len(), |numbers| numbers.order.len());
        let mut global = AllBounds { count, dofs: bounds.dofs.to_vec(), laws: Laws::default(), partition };
        if !bounds.laws.are_rigid() {
            let of_side =
                |side: usize| (0..bounds.len()).map(move |i| f64::from(bounds.laws.numbers(i)[side]));
            let [lower, upper] = [0, 1].map(|side| global.gather(engine.comm(), of_side(side).collect()));
            let numbers = lower.into_iter().zip(upper).map(|(lower, upper)| [lower as u32, upper as u32]);
            global.laws = bounds.laws.with(numbers.collect());
        }
        global
    }

    /// Returns whether there may be several ranks.
    pub fn is_partitioned(&self) -> bool {
        self.partition.is_some()
    }

    /// Returns the index of a bound among those of this rank, if it has the bound.
    pub fn own(&self, number: usize) -> Option<usize> {
        self.partition.as_ref().map_or(Some(number), |numbers| numbers.index[number])
    }

    /// Returns the dof of a bound, if this rank has it.
    pub fn dof(&self, number: usize) -> Option<usize> {
        self.own(number).map(|i| self.dofs[i])
    }

    /// Copies the values of this rank's bounds.
    pub fn restrict(&self, values: &[f64], restricted: &mut [f64]) {
        match &self.partition {
            None => restricted.copy_from_slice(values),
            Some(GlobalNumbers { own: numbers, .. }) => {
                restricted
                    .iter_mut()
                    .zip(numbers)
                    .for_each(|(restricted, &number)| *restricted = values[number]);
            }
        }
    }

    /// Returns the values at all bounds, given those at this rank's. Collective.
    pub fn gather(&self, comm: &impl Communicator, shares: Vec<f64>) -> Vec<f64> {
        let Some(GlobalNumbers { order, .. }) = &self.partition else { return shares };
        let mut values = vec![0.0; self.count];
        order.iter().zip(comm.all_gather(&shares)).for_each(|(&number, value)| values[number] = value);
        values
    }

    /// Returns the limits of all bounds, without loads. Collective.
    pub fn limits(&self, comm: &impl Communicator, bounds: &Bounds) -> Limits {
        let [lower, upper] = [&bounds.lower, &bounds.upper].map(|side| self.gather(comm, side.clone()));
        Limits { shift: vec![0.0; self.count], lower, upper }
    }

    /// Returns the values of vectors of dofs, in columns, at all bounds. Collective.
    pub fn rows(&self, comm: &impl Communicator, vectors: &Mat<f64>) -> Mat<f64> {
        let mut rows = Mat::zeros(self.count, vectors.ncols());
        for j in 0..vectors.ncols() {
            rows.col_as_slice_mut(j).copy_from_slice(&self.values(comm, vectors.col_as_slice(j)));
        }
        rows
    }

    /// Returns the values of a vector of dofs at all bounds. Collective.
    pub fn values(&self, comm: &impl Communicator, vector: &[f64]) -> Vec<f64> {
        self.gather(comm, self.dofs.iter().map(|&dof| vector[dof]).collect())
    }

    /// Returns the mode shapes at all bounds, one column per bound. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Memory`] where they do not fit.
    pub fn shapes(&self, comm: &impl Communicator, modes: &MassModes) -> Result<Mat<f64>> {
        let count = modes.count();
        // The rows are transposed.
        let bytes = 2 * 8 * (count * self.count) as u64;
        let what = format!("{count} modes at {} bounded dofs, on each rank,", self.count);
        let here = memory::processes_here();
        comm.all_ok(memory::require_of_each(bytes, here, &what, |part| {
            format!("time.modes = {} would fit", (count as f64 * part) as usize)
        }))?;
        Ok(self.rows(comm, &modes.shapes).transpose().to_owned())
    }
}
