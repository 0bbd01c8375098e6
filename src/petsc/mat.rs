//! Distributed matrices: sparse matrices and dense blocks of columns.

#![allow(unsafe_code)]

use super::error::{call, get, int};
use super::handle::handle;
use super::vec::slice;
use super::{Context, Index, Vector, sys};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use std::ops::Range;
use std::rc::Rc;

/// Makes a call of PETSc create its result.
const NEW: sys::MatReuse = sys::MatReuse::MAT_INITIAL_MATRIX;

/// Expected fill of a product: PETSc's own estimate.
const FILL: f64 = sys::PETSC_DEFAULT as f64;

handle! {
    /// Matrix of which each rank owns a block of rows. Creating and dropping it is collective.
    Matrix, Mat, MatDestroy, triplets: Option<usize>
}

impl Matrix {
    /// Creates a square sparse matrix from triplets. Collective.
    ///
    /// This rank owns `local` rows, and as many columns. Triplets may name rows of other ranks;
    /// those with the same row and column add up, and a negative row or column drops the triplet.
    /// [`Matrix::set_values`] takes values in the order of these triplets.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where an index is too large.
    pub fn from_triplets(
        context: &Rc<Context>,
        local: usize,
        rows: &[Index],
        columns: &[Index],
        values: &[f64],
    ) -> Result<Self> {
        let mut matrix = Self::from_pattern(context, [local; 2], [rows, columns].map(<[_]>::to_vec), None)?;
        matrix.set_values(values)?;
        Ok(matrix)
    }

    /// Creates a sparse matrix of zeros with an entry for each pair of a row and a column.
    /// Collective.
    ///
    /// `local` are the numbers of rows and of columns that this rank owns; see
    /// [`Matrix::from_triplets`]. With `dofs` the matrix remains a sum of matrices, one for each
    /// rank: that of this rank has these rows and columns, given by their numbers in the sum, and
    /// other ranks may have some of them as well.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where an index is too large.
    pub fn from_pattern(
        context: &Rc<Context>,
        local: [usize; 2],
        [mut rows, mut columns]: [Vec<Index>; 2],
        dofs: Option<&[Index]>,
    ) -> Result<Self> {
        let ends = context.comm().all_reduce_sum(local);
        let within = |indices: &[Index], end: usize| indices.iter().all(|&i| i < 0 || (i as usize) < end);
        let good = rows.len() == columns.len() && within(&rows, ends[0]) && within(&columns, ends[1]);
        if !context.comm().all_reduce_all(good) {
            return Err(Error::Petsc(format!(
                "a pattern of {} rows and {} columns, or an index outside the {} x {} matrix",
                rows.len(),
                columns.len(),
                ends[0],
                ends[1]
            )));
        }
        let raw = get!(MatCreate(context.raw()))?;
        let mut matrix = Self::owning(raw, context);
        let end = sys::PETSC_DETERMINE;
        call!(MatSetSizes(raw, int(local[0])?, int(local[1])?, end, end))?;
        match dofs {
            None => call!(MatSetType(raw, c"aij".as_ptr()))?,
            Some(dofs) => {
                call!(MatSetType(raw, c"is".as_ptr()))?;
                let (count, copy) = (int(dofs.len())?, sys::PetscCopyMode::PETSC_COPY_VALUES);
                let comm = context.raw();
                let mut map = get!(ISLocalToGlobalMappingCreate(comm, 1, count, dofs.as_ptr(), copy))?;
                // The matrix keeps a reference of its own.
                let set = call!(MatSetLocalToGlobalMapping(raw, map, map));
                call!(ISLocalToGlobalMappingDestroy(&mut map))?;
                set?;
            }
        }
        // PETSc may reorder these arrays.
        call!(MatSetPreallocationCOO(raw, rows.len() as _, rows.as_mut_ptr(), columns.as_mut_ptr()))?;
        matrix.triplets = Some(rows.len());
        Ok(matrix)
    }

    /// Replaces the values, in the order of the triplets that made the pattern. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the matrix was not made from triplets or their number
    /// differs.
    pub fn set_values(&mut self, values: &[f64]) -> Result<()> {
        if self.triplets != Some(values.len()) {
            let made = self.triplets.map_or("no triplets".into(), |n| format!("{n} triplets"));
            return Err(Error::Petsc(format!("{} values for a matrix made from {made}", values.len())));
        }
        call!(MatSetValuesCOO(self.raw, values.as_ptr(), sys::InsertMode::INSERT_VALUES))
    }

    /// Returns the matrix without the record of its triplets, of 16 bytes each. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn without_triplets(self) -> Result<Self> {
        self.duplicate()
    }

    /// Returns the numbers of rows and columns that this rank owns.
    pub fn local_size(&self) -> [usize; 2] {
        // This call cannot fail: the matrix has sizes.
        get!(MatGetLocalSize(self.raw; rows, columns)).map_or([0; 2], |(m, n)| [m as usize, n as usize])
    }

    /// Returns the range of this rank's rows.
    pub fn range(&self) -> Range<Index> {
        // This call cannot fail: the matrix has a layout.
        get!(MatGetOwnershipRange(self.raw; start, end)).map_or(0..0, |(start, end)| start..end)
    }

    /// Creates a vector of zeros that the matrix can multiply. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn vector(&self) -> Result<Vector> {
        let mut raw = std::ptr::null_mut();
        call!(MatCreateVecs(self.raw, &mut raw, std::ptr::null_mut()))?;
        Vector::owning(raw, &self.context).zeroed()
    }

    /// Declares the matrix symmetric positive definite, also after changes of its values.
    /// Collective.
    ///
    /// Factorisations exploit this, and fail where it does not hold.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn set_positive_definite(&mut self) -> Result<()> {
        for option in [sys::MatOption::MAT_SPD, sys::MatOption::MAT_SPD_ETERNAL] {
            call!(MatSetOption(self.raw, option, sys::truth(true)))?;
        }
        Ok(())
    }

    /// Sets the near null space for multigrid: motions of little energy. Collective.
    ///
    /// The vectors, one per motion, are orthonormalised here.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn set_near_null_space(&mut self, mut motions: Vec<Vector>) -> Result<()> {
        for i in 0..motions.len() {
            let (before, rest) = motions.split_at_mut(i);
            let motion = &mut rest[0];
            for other in before {
                let share = other.dot(motion)?;
                motion.add_scaled(-share, other)?;
            }
            let norm = motion.dot(motion)?.sqrt();
            motion.scale(if norm > 0.0 { 1.0 / norm } else { 0.0 })?;
        }
        let comm = self.context.raw();
        let vectors: Vec<sys::Vec> = motions.iter().map(|motion| motion.raw).collect();
        let none = sys::truth(false);
        let mut space = get!(MatNullSpaceCreate(comm, none, int(vectors.len())?, vectors.as_ptr()))?;
        let set = call!(MatSetNearNullSpace(self.raw, space));
        call!(MatNullSpaceDestroy(&mut space))?;
        set
    }

    /// Copies the near null space of another matrix of the same layout, if it has one. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn share_near_null_space(&mut self, other: &Matrix) -> Result<()> {
        let space = get!(MatGetNearNullSpace(other.raw))?;
        call!(MatSetNearNullSpace(self.raw, space))
    }

    /// Sets the block size, such as the number of dofs per node. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the size does not divide the number of rows on a rank.
    pub fn set_block_size(&mut self, size: usize) -> Result<()> {
        call!(MatSetBlockSize(self.raw, int(size)?))
    }

    /// Computes y = A x. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn multiply(&self, x: &Vector, y: &mut Vector) -> Result<()> {
        call!(MatMult(self.raw, x.raw, y.raw))
    }

    /// Computes y = A^T x. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn multiply_transposed(&self, x: &Vector, y: &mut Vector) -> Result<()> {
        call!(MatMultTranspose(self.raw, x.raw, y.raw))
    }

    /// Replaces A by D A D, where D is the diagonal matrix of these entries. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn scale_symmetrically(&mut self, diagonal: &Vector) -> Result<()> {
        call!(MatDiagonalScale(self.raw, diagonal.raw, diagonal.raw))
    }

    /// Returns a second handle to the same matrix.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn share(&self) -> Result<Self> {
        Self::sharing(self.raw, &self.context)
    }

    /// Returns P^T A P, which is positive definite where A is. Collective.
    ///
    /// A column of P that is zero leaves an unknown without an equation, which becomes x = 0.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes do not fit.
    pub fn galerkin(&self, interpolation: &Matrix) -> Result<Self> {
        let mut product = self.congruent(interpolation)?;
        product.complete_diagonal()?;
        product.set_positive_definite()?;
        Ok(product)
    }

    /// Returns P^T A P, of any matrix. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes do not fit.
    pub(super) fn congruent(&self, p: &Matrix) -> Result<Self> {
        self.product(get!(MatPtAP(self.raw, p.raw, NEW, FILL))?)
    }

    /// Creates the matrix of two blocks on the diagonal. Each rank owns its rows and columns of the
    /// first block, then its rows and columns of the second one. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn block_diagonal(first: &Matrix, second: &Matrix) -> Result<Self> {
        let (context, none) = (&first.context, std::ptr::null_mut());
        let blocks = [first.raw, none, none, second.raw];
        let (comm, rows) = (context.raw(), std::ptr::null());
        let nest = get!(MatCreateNest(comm, 2, rows, 2, rows, blocks.as_ptr()))?;
        let nest = Self::owning(nest, context);
        Ok(Self::owning(get!(MatConvert(nest.raw, c"aij".as_ptr(), NEW))?, context))
    }

    /// Returns the product A B. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes do not fit.
    pub(super) fn times(&self, b: &Matrix) -> Result<Self> {
        self.product(get!(MatMatMult(self.raw, b.raw, NEW, FILL))?)
    }

    /// Returns the product A^T B. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes do not fit.
    pub(super) fn transposed_times(&self, b: &Matrix) -> Result<Self> {
        self.product(get!(MatTransposeMatMult(self.raw, b.raw, NEW, FILL))?)
    }

    /// Returns a product that no longer keeps its factors and work space for a second computation.
    /// Collective.
    fn product(&self, raw: sys::Mat) -> Result<Self> {
        let product = Self::owning(raw, &self.context);
        call!(MatProductClear(raw))?;
        Ok(product)
    }

    /// Returns A^T. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub(super) fn transposed(&self) -> Result<Self> {
        Ok(Self::owning(get!(MatTranspose(self.raw, NEW))?, &self.context))
    }

    /// Returns a matrix of the same size with only some of the rows, given by their numbers on this
    /// rank. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub(super) fn only_rows(&self, rows: &[usize]) -> Result<Self> {
        let first = self.range().start;
        let (mut of_rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for &row in rows {
            let row = first + row as Index;
            let (in_row, entries) = self.row(row)?;
            of_rows.extend(std::iter::repeat_n(row, in_row.len()));
            columns.extend(in_row);
            values.extend(entries);
        }
        let mut matrix = Self::from_pattern(&self.context, self.local_size(), [of_rows, columns], None)?;
        matrix.set_values(&values)?;
        Ok(matrix)
    }

    /// Replaces zeros on the diagonal by ones. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the diagonal is not in the pattern.
    pub(super) fn complete_diagonal(&mut self) -> Result<()> {
        let mut diagonal = self.vector()?;
        self.diagonal(&mut diagonal)?;
        let first = self.range().start;
        let missing = diagonal.with_local(|entries| {
            let zeros = (first..).zip(entries).filter(|(_, entry)| **entry == 0.0);
            zeros.map(|(row, _)| (row, 1.0)).collect::<Vec<_>>()
        })?;
        self.set_diagonal_entries(&missing)
    }

    /// Replaces some entries of the diagonal in rows that this rank owns. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where an entry is not in the pattern.
    pub fn set_diagonal_entries(&mut self, entries: &[(Index, f64)]) -> Result<()> {
        for (row, value) in entries {
            call!(MatSetValues(self.raw, 1, row, 1, row, value, sys::InsertMode::INSERT_VALUES))?;
        }
        // This also has the next sweep invert the blocks on the diagonal again.
        self.assemble()
    }

    /// Ends the entering of values. Collective.
    fn assemble(&mut self) -> Result<()> {
        call!(MatAssemblyBegin(self.raw, sys::MatAssemblyType::MAT_FINAL_ASSEMBLY))?;
        call!(MatAssemblyEnd(self.raw, sys::MatAssemblyType::MAT_FINAL_ASSEMBLY))
    }

    /// Replaces A by D A, where D is the diagonal matrix of these entries. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn scale_rows(&mut self, diagonal: &Vector) -> Result<()> {
        call!(MatDiagonalScale(self.raw, diagonal.raw, std::ptr::null_mut()))
    }

    /// Adds `factor` times B, whose pattern must be a subset of that of A. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes differ.
    pub fn add_scaled(&mut self, factor: f64, other: &Matrix) -> Result<()> {
        call!(MatAXPY(self.raw, factor, other.raw, sys::MatStructure::SUBSET_NONZERO_PATTERN))
    }

    /// Returns a copy. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn duplicate(&self) -> Result<Self> {
        let raw = get!(MatDuplicate(self.raw, sys::MatDuplicateOption::MAT_COPY_VALUES))?;
        Ok(Self::owning(raw, &self.context))
    }

    /// Copies the values of a matrix of the same pattern. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the sizes differ.
    pub fn copy_from(&mut self, other: &Matrix) -> Result<()> {
        call!(MatCopy(other.raw, self.raw, sys::MatStructure::SAME_NONZERO_PATTERN))
    }

    /// Adds a vector to the diagonal. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn add_to_diagonal(&mut self, diagonal: &Vector) -> Result<()> {
        call!(MatDiagonalSet(self.raw, diagonal.raw, sys::InsertMode::ADD_VALUES))
    }

    /// Copies the diagonal into a vector. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the layouts differ.
    pub fn diagonal(&self, diagonal: &mut Vector) -> Result<()> {
        call!(MatGetDiagonal(self.raw, diagonal.raw))
    }

    /// Returns the largest row sum of magnitudes. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn norm_infinity(&self) -> Result<f64> {
        get!(MatNorm(self.raw, sys::NormType::NORM_INFINITY))
    }

    /// Has entries that are zeroed stay in the pattern. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn keep_pattern(&mut self) -> Result<()> {
        call!(MatSetOption(self.raw, sys::MatOption::MAT_KEEP_NONZERO_PATTERN, sys::truth(true)))
    }

    /// Zeroes rows and columns, with `diagonal` on their diagonal. Collective.
    ///
    /// Each rank may name rows of any rank.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where a row does not exist.
    pub fn zero_rows_columns(&mut self, rows: &[Index], diagonal: f64) -> Result<()> {
        let null = std::ptr::null_mut();
        call!(MatZeroRowsColumns(self.raw, int(rows.len())?, rows.as_ptr(), diagonal, null, null))
    }

    /// Returns the columns and values of a row that this rank owns.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where another rank owns it.
    pub fn row(&self, row: Index) -> Result<(Vec<Index>, Vec<f64>)> {
        let (mut length, mut columns, mut values) = get!(MatGetRow(self.raw, row; length, columns, values))?;
        // SAFETY: PETSc's arrays have this length.
        let copy =
            unsafe { (slice(columns, length as usize).to_vec(), slice(values, length as usize).to_vec()) };
        call!(MatRestoreRow(self.raw, row, &mut length, &mut columns, &mut values))?;
        Ok(copy)
    }
}
