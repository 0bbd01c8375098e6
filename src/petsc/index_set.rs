//! Distributed sets of indices.

#![allow(unsafe_code)]

use super::Index;
use super::error::{call, get};
use super::handle::handle;
use super::vec::slice;
use crate::error::Result;

handle! {
    /// Ordered indices of each rank. Creating and dropping the set is collective.
    IndexSet, IS, ISDestroy
}

impl IndexSet {
    /// Returns this rank's indices.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn to_vec(&self) -> Result<Vec<Index>> {
        let (length, mut array) = (get!(ISGetLocalSize(self.raw))? as usize, get!(ISGetIndices(self.raw))?);
        // SAFETY: PETSc's array has the local size.
        let indices = unsafe { slice(array, length) }.to_vec();
        call!(ISRestoreIndices(self.raw, &mut array))?;
        Ok(indices)
    }
}
