//! Distributed matrices: sparse ones, and dense blocks of columns.

use super::error::{call, int};
use super::handle::handle;
use super::vec::slice;
use super::{Comm, Context, Index, IndexSet, Vector, sys};
use crate::error::{Error, Result};
use std::ops::Range;
use std::rc::Rc;

handle! {
    /// A matrix of which each rank owns a block of rows. Creating and dropping it is collective.
    Matrix, Mat, MatDestroy, triplets: Option<usize>
}

impl Matrix {
    /// A square sparse matrix from triplets, of which this rank owns `local` rows and the same columns.
    ///
    /// Triplets may name rows of other ranks; those of the same place add up; a negative row or column drops the triplet.
    /// The order of the triplets is kept for [`Matrix::set_values`]. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where an index is too large.
    pub fn from_triplets(
        context: &Rc<Context>,
        comm: Comm,
        local: usize,
        rows: &[Index],
        columns: &[Index],
        values: &[f64],
    ) -> Result<Self> {
        let mut matrix = Self::from_pattern(context, comm, [local; 2], rows, columns)?;
        matrix.set_values(values)?;
        Ok(matrix)
    }

    /// A sparse matrix of zeros with a place for each pair of a row and a column; see [`Matrix::from_triplets`].
    ///
    /// `local` are the numbers of rows and of columns that this rank owns. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where an index is too large.
    pub fn from_pattern(
        context: &Rc<Context>,
        comm: Comm,
        local: [usize; 2],
        rows: &[Index],
        columns: &[Index],
    ) -> Result<Self> {
        // PETSc 3.18 does not look at every index, so we do; and ranks give up together or not at all.
        let ends = local.map(|n| if comm == Comm::World { context.sum_count(n) } else { n });
        let within = |indices: &[Index], end: usize| indices.iter().all(|&i| i < 0 || (i as usize) < end);
        let good = rows.len() == columns.len() && within(rows, ends[0]) && within(columns, ends[1]);
        if !(if comm == Comm::World { context.all(good) } else { good }) {
            return Err(Error::Petsc(format!(
                "a pattern of {} rows and {} columns, or an index out of the {} x {} matrix",
                rows.len(),
                columns.len(),
                ends[0],
                ends[1]
            )));
        }
        let mut raw = std::ptr::null_mut();
        call!(MatCreate(context.raw(comm), &mut raw))?;
        let mut matrix = Self::owning(raw, context);
        let end = sys::PETSC_DETERMINE;
        call!(MatSetSizes(raw, int(local[0])?, int(local[1])?, end, end))?;
        call!(MatSetType(raw, c"aij".as_ptr()))?;
        // PETSc may reorder what it is given.
        let (mut rows, mut columns) = (rows.to_vec(), columns.to_vec());
        call!(MatSetPreallocationCOO(raw, rows.len() as _, rows.as_mut_ptr(), columns.as_mut_ptr()))?;
        matrix.triplets = Some(rows.len());
        Ok(matrix)
    }

    /// Replaces the values, in the order of the triplets that made the pattern. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the matrix was not made from triplets or their number is another.
    pub fn set_values(&mut self, values: &[f64]) -> Result<()> {
        if self.triplets != Some(values.len()) {
            let made = self.triplets.map_or("no triplets".into(), |n| format!("{n} triplets"));
            return Err(Error::Petsc(format!("{} values for a matrix made from {made}", values.len())));
        }
        call!(MatSetValuesCOO(self.raw, values.as_ptr(), sys::InsertMode::INSERT_VALUES))
    }

    /// A dense matrix of zeros: `local` of its rows are this rank's, and it has `columns` columns in all. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn dense(context: &Rc<Context>, comm: Comm, local: usize, columns: usize) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        let (end, null) = (sys::PETSC_DETERMINE, std::ptr::null_mut());
        call!(MatCreateDense(context.raw(comm), int(local)?, end, end, int(columns)?, null, &mut raw))?;
        let matrix = Self::owning(raw, context);
        call!(MatAssemblyBegin(raw, sys::MatAssemblyType::MAT_FINAL_ASSEMBLY))?;
        call!(MatAssemblyEnd(raw, sys::MatAssemblyType::MAT_FINAL_ASSEMBLY))?;
        Ok(matrix)
    }

    /// Numbers of rows and columns over all ranks.
    pub fn size(&self) -> [usize; 2] {
        let (mut rows, mut columns) = (0, 0);
        // It cannot fail: the matrix has sizes.
        let _ = call!(MatGetSize(self.raw, &mut rows, &mut columns));
        [rows as usize, columns as usize]
    }

    /// Numbers of rows and columns that this rank owns.
    pub fn local_size(&self) -> [usize; 2] {
        let (mut rows, mut columns) = (0, 0);
        // It cannot fail: the matrix has sizes.
        let _ = call!(MatGetLocalSize(self.raw, &mut rows, &mut columns));
        [rows as usize, columns as usize]
    }

    /// This rank's rows.
    pub fn range(&self) -> Range<Index> {
        let (mut start, mut end) = (0, 0);
        // It cannot fail: the matrix has a layout.
        let _ = call!(MatGetOwnershipRange(self.raw, &mut start, &mut end));
        start..end
    }

    /// A vector of zeros that the matrix can multiply. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn vector(&self) -> Result<Vector> {
        let mut raw = std::ptr::null_mut();
        call!(MatCreateVecs(self.raw, &mut raw, std::ptr::null_mut()))?;
        let mut vector = Vector::owning(raw, &self.context);
        vector.fill(0.0)?;
        Ok(vector)
    }

    /// Says that the matrix is symmetric positive definite, now and after every change of its values. Collective.
    ///
    /// Factorisations then use it, and fail where it is not so.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn set_positive_definite(&mut self) -> Result<()> {
        for option in [sys::MatOption::MAT_SPD, sys::MatOption::MAT_SPD_ETERNAL] {
            call!(MatSetOption(self.raw, option, sys::truth(true)))?;
        }
        Ok(())
    }

    /// Tells multigrid which motions cost little energy: vectors, one per motion, that become orthonormal here. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the layouts differ.
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
        let comm = self.context.raw(Comm::World);
        let vectors: Vec<sys::Vec> = motions.iter().map(|motion| motion.raw).collect();
        let mut space = std::ptr::null_mut();
        let none = sys::truth(false);
        call!(MatNullSpaceCreate(comm, none, int(vectors.len())?, vectors.as_ptr(), &mut space))?;
        let set = call!(MatSetNearNullSpace(self.raw, space));
        call!(MatNullSpaceDestroy(&mut space))?;
        set
    }

    /// Takes over what [`Matrix::set_near_null_space`] told another matrix of the same layout, if anything. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn share_near_null_space(&mut self, other: &Matrix) -> Result<()> {
        let mut space = std::ptr::null_mut();
        call!(MatGetNearNullSpace(other.raw, &mut space))?;
        call!(MatSetNearNullSpace(self.raw, space))
    }

    /// Says that rows and columns come in groups of this size, such as the dofs of a node. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where it does not divide the number of rows of a rank.
    pub fn set_block_size(&mut self, size: usize) -> Result<()> {
        call!(MatSetBlockSize(self.raw, int(size)?))
    }

    /// y = A x. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the layouts differ.
    pub fn multiply(&self, x: &Vector, y: &mut Vector) -> Result<()> {
        call!(MatMult(self.raw, x.raw, y.raw))
    }

    /// A = factor A. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn scale(&mut self, factor: f64) -> Result<()> {
        call!(MatScale(self.raw, factor))
    }

    /// A = D A D for the diagonal matrix D of these entries. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the layouts differ.
    pub fn scale_symmetrically(&mut self, diagonal: &Vector) -> Result<()> {
        call!(MatDiagonalScale(self.raw, diagonal.raw, diagonal.raw))
    }

    /// A += factor B, where B has the places of A and no others. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the sizes differ.
    pub fn add_scaled(&mut self, factor: f64, other: &Matrix) -> Result<()> {
        call!(MatAXPY(self.raw, factor, other.raw, sys::MatStructure::SUBSET_NONZERO_PATTERN))
    }

    /// A copy. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn duplicate(&self) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(MatDuplicate(self.raw, sys::MatDuplicateOption::MAT_COPY_VALUES, &mut raw))?;
        Ok(Self::owning(raw, &self.context))
    }

    /// Copies the values of a matrix of the same pattern. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the sizes differ.
    pub fn copy_from(&mut self, other: &Matrix) -> Result<()> {
        call!(MatCopy(other.raw, self.raw, sys::MatStructure::SAME_NONZERO_PATTERN))
    }

    /// The diagonal. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the layouts differ.
    pub fn diagonal(&self, diagonal: &mut Vector) -> Result<()> {
        call!(MatGetDiagonal(self.raw, diagonal.raw))
    }

    /// Largest sum of a row's magnitudes. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn norm_infinity(&self) -> Result<f64> {
        let mut norm = 0.0;
        call!(MatNorm(self.raw, sys::NormType::NORM_INFINITY, &mut norm))?;
        Ok(norm)
    }

    /// Replaces rows and columns by those of `diagonal` times the identity; each rank names rows of any rank. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where a row does not exist.
    pub fn zero_rows_columns(&mut self, rows: &[Index], diagonal: f64) -> Result<()> {
        let null = std::ptr::null_mut();
        call!(MatZeroRowsColumns(self.raw, int(rows.len())?, rows.as_ptr(), diagonal, null, null))
    }

    /// The block of some rows and columns; each rank names those that it shall own in the block. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn submatrix(&self, rows: &IndexSet, columns: &IndexSet) -> Result<Matrix> {
        let mut raw = std::ptr::null_mut();
        call!(MatCreateSubMatrix(
            self.raw,
            rows.raw,
            columns.raw,
            sys::MatReuse::MAT_INITIAL_MATRIX,
            &mut raw
        ))?;
        Ok(Self::owning(raw, &self.context))
    }

    /// Columns and values of a row that this rank owns.
    ///
    /// # Errors
    /// [`Error::Petsc`] where another rank owns it.
    pub fn row(&self, row: Index) -> Result<(Vec<Index>, Vec<f64>)> {
        let (mut length, mut columns, mut values) = (0, std::ptr::null(), std::ptr::null());
        call!(MatGetRow(self.raw, row, &mut length, &mut columns, &mut values))?;
        // SAFETY: PETSc's arrays have this length.
        let copy =
            unsafe { (slice(columns, length as usize).to_vec(), slice(values, length as usize).to_vec()) };
        call!(MatRestoreRow(self.raw, row, &mut length, &mut columns, &mut values))?;
        Ok(copy)
    }

    /// Reads a dense matrix: this rank's rows of every column, column by column.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the matrix is not dense.
    pub fn with_columns<T>(&self, read: impl FnOnce(&[f64]) -> T) -> Result<T> {
        let length = self.dense_length()?;
        let mut array = std::ptr::null();
        call!(MatDenseGetArrayRead(self.raw, &mut array))?;
        // SAFETY: PETSc's array has this length.
        let result = read(unsafe { slice(array, length) });
        call!(MatDenseRestoreArrayRead(self.raw, &mut array))?;
        Ok(result)
    }

    /// Reads and writes a dense matrix: this rank's rows of every column, column by column. All ranks do it.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the matrix is not dense.
    pub fn with_columns_mut<T>(&mut self, write: impl FnOnce(&mut [f64]) -> T) -> Result<T> {
        let length = self.dense_length()?;
        let mut array = std::ptr::null_mut();
        call!(MatDenseGetArray(self.raw, &mut array))?;
        let result = if length == 0 {
            write(&mut [])
        } else {
            // SAFETY: PETSc's array has this length, and the exclusive borrow keeps others off.
            write(unsafe { std::slice::from_raw_parts_mut(array, length) })
        };
        call!(MatDenseRestoreArray(self.raw, &mut array))?;
        Ok(result)
    }

    /// Number of a dense matrix's values on this rank, which must leave no room between columns.
    fn dense_length(&self) -> Result<usize> {
        let mut stride = 0;
        call!(MatDenseGetLDA(self.raw, &mut stride))?;
        let (rows, columns) = (self.local_size()[0], self.size()[1]);
        if rows > 0 && stride as usize != rows {
            return Err(Error::Petsc(format!("a dense matrix of {rows} rows with columns {stride} apart")));
        }
        Ok(rows * columns)
    }

    /// Prints the matrix. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn view(&self) -> Result<()> {
        call!(MatView(self.raw, std::ptr::null_mut()))
    }
}
