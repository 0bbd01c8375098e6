//! Distributed vectors.

#![allow(unsafe_code)]

use super::error::{call, get, int};
use super::handle::handle;
use super::{Context, Index, sys};
use crate::error::Result;
use std::ops::Range;
use std::rc::Rc;

handle! {
    /// Vector of which each rank owns a contiguous part. Creating and dropping it is collective.
    Vector, Vec, VecDestroy
}

impl Vector {
    /// Creates a vector of zeros of which this rank owns `local` entries. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(context: &Rc<Context>, local: usize) -> Result<Self> {
        let raw = get!(VecCreate(context.raw()))?;
        let vector = Self::owning(raw, context);
        call!(VecSetSizes(raw, int(local)?, sys::PETSC_DETERMINE))?;
        call!(VecSetType(raw, c"standard".as_ptr()))?;
        vector.zeroed()
    }

    /// Creates a vector of zeros with the same layout. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn duplicate(&self) -> Result<Self> {
        Self::owning(get!(VecDuplicate(self.raw))?, &self.context).zeroed()
    }

    /// Sets every entry to 0. Collective.
    pub(super) fn zeroed(mut self) -> Result<Self> {
        self.fill(0.0)?;
        Ok(self)
    }

    /// Returns the number of entries that this rank owns.
    pub fn local_size(&self) -> usize {
        // This call cannot fail: the vector has sizes.
        get!(VecGetLocalSize(self.raw)).unwrap_or_default() as usize
    }

    /// Returns the global positions of this rank's entries.
    pub fn range(&self) -> Range<Index> {
        // This call cannot fail: the vector has a layout.
        get!(VecGetOwnershipRange(self.raw; start, end)).map_or(0..0, |(start, end)| start..end)
    }

    /// Reads this rank's entries.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn with_local<T>(&self, read: impl FnOnce(&[f64]) -> T) -> Result<T> {
        let mut array = get!(VecGetArrayRead(self.raw))?;
        // SAFETY: PETSc's array has the local size; it is null only where that is 0.
        let result = read(unsafe { slice(array, self.local_size()) });
        call!(VecRestoreArrayRead(self.raw, &mut array))?;
        Ok(result)
    }

    /// Reads and writes this rank's entries. Collective.
    ///
    /// Every rank must make the call, because PETSc discards its cached norms on the ranks that
    /// make it.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn with_local_mut<T>(&mut self, write: impl FnOnce(&mut [f64]) -> T) -> Result<T> {
        let mut array = get!(VecGetArray(self.raw))?;
        // SAFETY: PETSc's array has the local size, and the exclusive borrow prevents aliases.
        let result = write(unsafe { slice_mut(array, self.local_size()) });
        call!(VecRestoreArray(self.raw, &mut array))?;
        Ok(result)
    }

    /// Sets this rank's entries, [`Vector::local_size`] in number. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_local(&mut self, values: &[f64]) -> Result<()> {
        self.with_local_mut(|local| local.copy_from_slice(values))
    }

    /// Copies this rank's entries into `values`, [`Vector::local_size`] in number.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn copy_to(&self, values: &mut [f64]) -> Result<()> {
        self.with_local(|local| values.copy_from_slice(local))
    }

    /// Returns this rank's entries.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn to_vec(&self) -> Result<Vec<f64>> {
        self.with_local(<[f64]>::to_vec)
    }

    /// Sets every entry. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn fill(&mut self, value: f64) -> Result<()> {
        call!(VecSet(self.raw, value))
    }

    /// Multiplies the vector by a factor. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn scale(&mut self, factor: f64) -> Result<()> {
        call!(VecScale(self.raw, factor))
    }

    /// Adds `factor` times a vector of the same layout. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where the layouts differ.
    pub fn add_scaled(&mut self, factor: f64, other: &Vector) -> Result<()> {
        call!(VecAXPY(self.raw, factor, other.raw))
    }

    /// Returns the scalar product. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where the layouts differ.
    pub fn dot(&self, other: &Vector) -> Result<f64> {
        get!(VecDot(self.raw, other.raw))
    }
}

/// Converts a C array into a slice; a null pointer gives an empty slice.
///
/// # Safety
/// The pointer is null or points to `length` values that live as long as the slice.
pub(super) unsafe fn slice<'a, T>(pointer: *const T, length: usize) -> &'a [T] {
    if pointer.is_null() || length == 0 {
        &[]
    } else {
        // SAFETY: guaranteed by the caller.
        unsafe { std::slice::from_raw_parts(pointer, length) }
    }
}

/// Converts a C array into a slice to write to; a null pointer gives an empty slice.
///
/// # Safety
/// As for [`slice`], and nothing else has access to the values meanwhile.
pub(super) unsafe fn slice_mut<'a, T>(pointer: *mut T, length: usize) -> &'a mut [T] {
    if pointer.is_null() || length == 0 {
        &mut []
    } else {
        // SAFETY: guaranteed by the caller.
        unsafe { std::slice::from_raw_parts_mut(pointer, length) }
    }
}
