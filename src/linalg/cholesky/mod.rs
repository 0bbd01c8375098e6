//! Sparse Cholesky factorisation that eliminates the contact dofs last.
//!
//! faer orders (approximate minimum degree), analyses and factors. The contact dofs are moved to
//! the end and the rest is put in postorder, so that supernodes stay whole. The trailing block
//! `$L_{cc} L_{cc}^T$` *is* the Schur complement on the contact dofs. The triangular solves for one
//! right-hand side are our own: they stop at the contact dofs and process four columns at a time,
//! which is faster than the general ones.

mod double;
mod inertia;
mod ordering;
mod size;
mod solve;
mod supernodes;

use crate::error::{Error, Result};
use crate::kernels::double_double::DoubleDouble;
use double::PanelFactorisation;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::SymbolicCholesky;
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Mat, Par, Side};
pub(super) use inertia::factor_indefinite;
use ordering::{analyse, analysis_failed, elimination_order};
use pulp::Arch;
pub use size::Size;
pub(super) use size::{require, would_fit};
use supernodes::Supernode;

/// Time of a multiplication with twice the digits, in the factorisation, in multiplications of a
/// solve. It is about 2 where the factor fits into the cache.
const COST_OF_DIGITS: f64 = 1.0;

/// Sparse Cholesky factor `$P A P^T = L L^T$`.
#[derive(Debug)]
pub struct Cholesky {
    matrix: SparseColMat<usize, f64>,
    /// Values of the matrix in double-double arithmetic, where it is factored in them.
    twice: Option<Vec<DoubleDouble>>,
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    supernodes: Vec<Supernode>,
    patterns: Vec<u32>,
    /// Dof at each position of the elimination order.
    order: Vec<u32>,
    /// Number of dofs that are not contact dofs.
    interior: usize,
    /// Factor L_cc of the Schur complement of the contact dofs.
    tail: Mat<f64>,
    schur: Mat<f64>,
    arch: Arch,
    /// Number of solves that take as long as a factorisation with twice the digits.
    cost_of_digits: u32,
    /// Reciprocals of the diagonal of L.
    pivots: Vec<f64>,
    x: Vec<f64>,
    work: Vec<f64>,
}

impl Cholesky {
    /// Factors the symmetric matrix with the given lower triangle.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where it is not positive definite and [`Error::Memory`] where
    /// the factor does not fit.
    pub fn new(matrix: SparseColMat<usize, f64>, contact_dofs: &[usize]) -> Result<Cholesky> {
        Cholesky::with_digits(matrix, None, contact_dofs)
    }

    /// Factors the matrix with the given double-double values, at two to three times the cost.
    ///
    /// # Errors
    /// Returns the errors of [`Cholesky::new`].
    pub(super) fn twice(
        symbolic: SymbolicSparseColMat<usize>,
        values: Vec<DoubleDouble>,
        contact_dofs: &[usize],
    ) -> Result<Cholesky> {
        let rounded = values.iter().map(|value| value.high).collect();
        Cholesky::with_digits(SparseColMat::new(symbolic, rounded), Some(values), contact_dofs)
    }

    fn with_digits(
        matrix: SparseColMat<usize, f64>,
        twice: Option<Vec<DoubleDouble>>,
        contact_dofs: &[usize],
    ) -> Result<Cholesky> {
        let dofs = matrix.nrows();
        let order = elimination_order(&matrix, contact_dofs)?;
        let symbolic = analyse(&matrix, &order)?;
        let size = Size::of(&symbolic, contact_dofs.len(), twice.is_some());
        require(&size, 1, dofs)?;
        let layout = supernodes::layout(&symbolic).or_else(|| (dofs == 0).then(Default::default));
        let (supernodes, patterns) = layout.ok_or_else(|| analysis_failed(dofs, "no supernodes"))?;
        let tallest = supernodes.iter().map(|s| s.end - s.start + s.rows).max().unwrap_or(0);
        let mut cholesky = Cholesky {
            values: vec![0.0; symbolic.len_val()],
            supernodes,
            patterns,
            order: order.iter().map(|&dof| dof as u32).collect(),
            interior: dofs - contact_dofs.len(),
            tail: Mat::zeros(0, 0),
            schur: Mat::zeros(0, 0),
            arch: Arch::new(),
            x: vec![0.0; dofs],
            pivots: vec![0.0; dofs],
            work: vec![0.0; tallest],
            matrix,
            twice,
            cost_of_digits: {
                let [factor, solve] = size.multiplications.map(|count| count as f64);
                (COST_OF_DIGITS * factor / solve.max(1.0)) as u32
            },
            symbolic,
        };
        cholesky.factor(None)?;
        Ok(cholesky)
    }

    /// Returns the size of the factor of a matrix with the given lower triangle and contact dofs,
    /// from the symbolic analysis alone.
    ///
    /// # Errors
    /// Returns [`Error::Memory`] where even the analysis does not fit.
    pub(super) fn size(matrix: &SparseColMat<usize, f64>, contact_dofs: &[usize]) -> Result<Size> {
        let order = elimination_order(matrix, contact_dofs)?;
        Ok(Size::of(&analyse(matrix, &order)?, contact_dofs.len(), false))
    }

    /// Factors the matrix numerically, with some dofs pinned or with none.
    fn factor(&mut self, pinned: Option<&[bool]>) -> Result<()> {
        match &self.twice {
            None => self.factor_plainly(pinned)?,
            Some(_) => self.factor_twice(pinned)?,
        }
        for s in &self.supernodes {
            let height = s.end - s.start + s.rows;
            for (j, pivot) in self.pivots[s.start..s.end].iter_mut().enumerate() {
                *pivot = 1.0 / self.values[s.values + j * (height + 1)];
            }
        }
        self.tail = self.trailing_block();
        self.schur = &self.tail * self.tail.transpose();
        Ok(())
    }

    /// Returns the error for a matrix that is not positive definite.
    fn indefinite(&self) -> Error {
        Error::Singular(format!("the matrix of {} dofs is not positive definite", self.matrix.nrows()))
    }

    /// Returns the values of the matrix with the rows and columns of pinned dofs replaced by the
    /// identity's.
    fn pinned<V: Copy + From<f64>>(&self, values: &[V], pinned: &[bool]) -> Vec<V> {
        let mut values = values.to_vec();
        for column in 0..self.matrix.ncols() {
            let range = self.matrix.col_range(column);
            for (row, value) in self.matrix.row_idx_of_col(column).zip(&mut values[range]) {
                if pinned[row] || pinned[column] {
                    *value = f64::from(row == column).into();
                }
            }
        }
        values
    }

    /// Factors the matrix in double-double arithmetic and rounds the factor at the end.
    fn factor_twice(&mut self, pinned: Option<&[bool]>) -> Result<()> {
        let values = self.twice.as_deref().unwrap_or_default();
        let dofs = self.order.len();
        let held = pinned.map(|pinned| self.pinned(values, pinned));
        let (mut place, mut owner) = (vec![0; dofs], vec![0; dofs]);
        for (new, &old) in self.order.iter().enumerate() {
            place[old as usize] = new;
        }
        for (number, s) in self.supernodes.iter().enumerate() {
            owner[s.start..s.end].fill(number as u32);
        }
        let mut low = vec![0.0; self.values.len()];
        self.values.fill(0.0);
        for column in 0..dofs {
            let values = &held.as_deref().unwrap_or(values)[self.matrix.col_range(column)];
            for (row, &value) in self.matrix.row_idx_of_col(column).zip(values) {
                let (first, last) = (place[row].min(place[column]), place[row].max(place[column]));
                let s = &self.supernodes[owner[first] as usize];
                let pattern = &self.patterns[s.pattern..][..s.rows];
                let below = || pattern.iter().position(|&row| row as usize == last).unwrap_or(0);
                let row = if last < s.end { last - s.start } else { s.end - s.start + below() };
                let entry = s.values + (first - s.start) * (s.end - s.start + s.rows) + row;
                (self.values[entry], low[entry]) = (value.high, value.low);
            }
        }
        let Cholesky { supernodes, patterns, values: high, arch, .. } = &mut *self;
        let factor = PanelFactorisation { supernodes, patterns, owner: &owner, high, low: &mut low };
        let definite = arch.dispatch(factor);
        definite.then_some(()).ok_or_else(|| self.indefinite())
    }

    fn factor_plainly(&mut self, pinned: Option<&[bool]>) -> Result<()> {
        let held = pinned.map(|pinned| self.pinned(self.matrix.val(), pinned));
        let matrix = faer::sparse::SparseColMatRef::new(
            self.matrix.symbolic(),
            held.as_deref().unwrap_or_else(|| self.matrix.val()),
        );
        let scratch = self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| no_memory(self.matrix.nrows()))?;
        let definite = self
            .symbolic
            .factorize_numeric_llt(
                &mut self.values,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                faer::Spec::default(),
            )
            .is_ok();
        definite.then_some(()).ok_or_else(|| self.indefinite())
    }

    /// Returns the dense triangle `$L_{cc}$` of the contact dofs.
    fn trailing_block(&self) -> Mat<f64> {
        let size = self.order.len() - self.interior;
        let mut tail = Mat::zeros(size, size);
        for s in &self.supernodes {
            let width = s.end - s.start;
            let pattern = &self.patterns[s.pattern..][..s.rows];
            for column in s.start.max(self.interior)..s.end {
                let entries =
                    &self.values[s.values + (column - s.start) * (width + s.rows)..][..width + s.rows];
                let rows = (s.start..s.end).chain(pattern.iter().map(|&row| row as usize));
                for (row, &entry) in rows.zip(entries).filter(|(row, _)| *row >= column) {
                    tail[(row - self.interior, column - self.interior)] = entry;
                }
            }
        }
        tail
    }
}

/// Creates the error for an allocation that failed.
fn no_memory(dofs: usize) -> Error {
    Error::Memory(format!("there is not enough memory to factor the matrix of {dofs} dofs"))
}
