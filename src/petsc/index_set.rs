//! Distributed sets of indices.

#![allow(unsafe_code)]

use super::error::{call, get, int};
use super::handle::handle;
use super::vec::slice;
use super::{Comm, Context, Index, sys};
use crate::error::Result;
use std::rc::Rc;

handle! {
    /// Ordered indices of each rank. Creating and dropping the set is collective.
    IndexSet, IS, ISDestroy
}

impl IndexSet {
    /// Creates a set from the indices of each rank. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(context: &Rc<Context>, comm: Comm, indices: &[Index]) -> Result<Self> {
        let mode = sys::PetscCopyMode::PETSC_COPY_VALUES;
        let raw = get!(ISCreateGeneral(context.raw(comm), int(indices.len())?, indices.as_ptr(), mode))?;
        Ok(Self::owning(raw, context))
    }

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
