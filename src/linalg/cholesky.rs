//! Sparse Cholesky factorisation that eliminates the contact dofs last.
//!
//! faer orders (approximate minimum degree), analyses and factors. The contact dofs are moved to
//! the end and the rest is put in postorder, so that supernodes stay whole. The trailing block
//! `$L_{cc} L_{cc}^T$` *is* the Schur complement on the contact dofs. The triangular solves for one
//! right-hand side are our own: they stop at the contact dofs and process four columns at a time,
//! which is faster than the general ones.

use super::Factor;
use super::simd::{dot4, subtract4};
use super::twice::{self, DoubleDouble};
use crate::error::{Error, Result};
use crate::memory;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Mat, Par, Side};
use pulp::{Arch, Simd, WithSimd};

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
    /// Reciprocals of the diagonal of L.
    pivots: Vec<f64>,
    x: Vec<f64>,
    work: Vec<f64>,
}

/// Columns `start..end` of L as a panel: a dense triangle above the rows of `pattern`, stored
/// column by column from `values` on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Supernode {
    pub start: usize,
    pub end: usize,
    pub values: usize,
    pub pattern: usize,
    pub rows: usize,
}

impl Supernode {
    /// Returns the panel's width, its height, and the number of its columns before `limit`.
    #[inline(always)]
    fn shape(&self, limit: usize) -> (usize, usize, usize) {
        let width = self.end - self.start;
        (width, width + self.rows, width.min(limit - self.start))
    }
}

/// Memory of a factor, known from its pattern.
#[derive(Debug, Clone, Copy)]
pub struct Size {
    /// Number of stored entries of L.
    pub entries: usize,
    /// Memory that the factor keeps in addition to the matrix, in bytes.
    pub kept: u64,
    /// Additional memory needed only during the factorisation, in bytes.
    pub passing: u64,
}

impl Size {
    fn of(symbolic: &SymbolicCholesky<usize>, contact_dofs: usize, twice: bool) -> Size {
        let (entries, dofs) = (symbolic.len_val(), symbolic.ncols());
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        let tail = 2 * contact_dofs * contact_dofs;
        let kept = size_of::<f64>() * (entries + tail + 4 * dofs);
        let passing = if twice {
            size_of::<DoubleDouble>() * entries + size_of::<f64>() * entries
        } else {
            scratch.unaligned_bytes_required()
        };
        Size { entries, kept: kept as u64, passing: passing as u64 }
    }
}

/// Checks that some factors of one size fit into memory together.
///
/// # Errors
/// Returns [`Error::Memory`] where they do not.
pub(super) fn require(size: &Size, factors: u64, dofs: usize) -> Result<()> {
    let number = if factors > 1 { format!("{factors} times ") } else { String::new() };
    let what = format!("factoring the matrix of {dofs} dofs {number}({} entries)", size.entries);
    memory::require(factors * size.kept + size.passing, &what, |part| would_fit(part, dofs))
}

/// Describes how many dofs would fit into a part of the memory that `dofs` dofs need.
pub(super) fn would_fit(part: f64, dofs: usize) -> String {
    // The entries per row of the factor grow with the logarithm of the number of rows.
    let fits = (dofs as f64 * part.powf(0.9)) as usize;
    let digit = 10_usize.pow(fits.max(10).ilog10() - 1);
    format!("a mesh of about {} dofs would fit", fits / digit * digit)
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

    /// Factors the matrix with the given double-double values, at about twenty times the cost.
    ///
    /// # Errors
    /// Returns the errors of [`Cholesky::new`].
    pub(super) fn twice(
        symbolic: SymbolicSparseColMat<usize>,
        values: Vec<DoubleDouble>,
        contact_dofs: &[usize],
    ) -> Result<Cholesky> {
        let rounded = values.iter().map(|value| value.round()).collect();
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
        require(&Size::of(&symbolic, contact_dofs.len(), twice.is_some()), 1, dofs)?;
        let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.raw() else {
            return Err(analysis_failed(dofs, "no supernodes"));
        };
        let mut supernodes = Vec::with_capacity(raw.n_supernodes());
        let mut patterns = Vec::new();
        for s in 0..raw.n_supernodes() {
            let rows = raw.supernode(s).pattern();
            supernodes.push(Supernode {
                start: raw.supernode_begin()[s],
                end: raw.supernode_end()[s],
                values: raw.col_ptr_for_val()[s],
                pattern: patterns.len(),
                rows: rows.len(),
            });
            patterns.extend(rows.iter().map(|&row| row as u32));
        }
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
            symbolic,
        };
        cholesky.factor(None)?;
        Ok(cholesky)
    }

    /// Returns the size of the factor, without contact dofs, of a matrix with the given lower
    /// triangle, from the symbolic analysis alone.
    ///
    /// # Errors
    /// Returns [`Error::Memory`] where even the analysis does not fit.
    pub(super) fn size(matrix: &SparseColMat<usize, f64>) -> Result<Size> {
        let order = elimination_order(matrix, &[])?;
        Ok(Size::of(&analyse(matrix, &order)?, 0, false))
    }

    /// Returns the number of stored entries of L.
    pub fn entries(&self) -> usize {
        self.values.len()
    }

    /// Factors the matrix numerically, with some dofs pinned or with none.
    fn factor(&mut self, pinned: Option<&[bool]>) -> Result<()> {
        match &self.twice {
            None => self.factor_plainly(pinned)?,
            Some(twice) => self.values = self.factored_twice(twice, pinned)?,
        }
        for s in &self.supernodes {
            let height = s.end - s.start + s.rows;
            for (j, pivot) in self.pivots[s.start..s.end].iter_mut().enumerate() {
                *pivot = 1.0 / self.values[s.values + j * (height + 1)];
            }
        }
        if pinned.is_none() {
            self.tail = self.trailing_block();
            self.schur = &self.tail * self.tail.transpose();
        }
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

    /// Returns the factor's values, computed in double-double arithmetic and rounded at the end.
    fn factored_twice(&self, values: &[DoubleDouble], pinned: Option<&[bool]>) -> Result<Vec<f64>> {
        let dofs = self.order.len();
        let held = pinned.map(|pinned| self.pinned(values, pinned));
        let (mut place, mut owner) = (vec![0; dofs], vec![0; dofs]);
        for (new, &old) in self.order.iter().enumerate() {
            place[old as usize] = new;
        }
        for (number, s) in self.supernodes.iter().enumerate() {
            owner[s.start..s.end].fill(number as u32);
        }
        let mut panels = vec![DoubleDouble::default(); self.values.len()];
        for column in 0..dofs {
            let values = &held.as_deref().unwrap_or(values)[self.matrix.col_range(column)];
            for (row, &value) in self.matrix.row_idx_of_col(column).zip(values) {
                let (first, last) = (place[row].min(place[column]), place[row].max(place[column]));
                let s = &self.supernodes[owner[first] as usize];
                let pattern = &self.patterns[s.pattern..][..s.rows];
                let below = || pattern.iter().position(|&row| row as usize == last).unwrap_or(0);
                let at = if last < s.end { last - s.start } else { s.end - s.start + below() };
                panels[s.values + (first - s.start) * (s.end - s.start + s.rows) + at] = value;
            }
        }
        let Cholesky { supernodes, patterns, .. } = self;
        let factor = twice::Factor { supernodes, patterns, owner: &owner, values: &mut panels };
        let definite = self.arch.dispatch(factor);
        definite.then(|| panels.iter().map(|value| value.round()).collect()).ok_or_else(|| self.indefinite())
    }

    fn factor_plainly(&mut self, pinned: Option<&[bool]>) -> Result<()> {
        let dofs = self.matrix.nrows();
        let held = pinned.map(|pinned| self.pinned(self.matrix.val(), pinned));
        let matrix = faer::sparse::SparseColMatRef::new(
            self.matrix.symbolic(),
            held.as_deref().unwrap_or_else(|| self.matrix.val()),
        );
        let scratch = self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| {
            Error::Memory(format!("there is not enough memory to factor the matrix of {dofs} dofs"))
        })?;
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

    fn permute(&mut self, b: &[f64]) {
        for (x, &dof) in self.x.iter_mut().zip(&self.order) {
            *x = b[dof as usize];
        }
    }

    fn unpermute(&self, x: &mut [f64]) {
        for (value, &dof) in self.x.iter().zip(&self.order) {
            x[dof as usize] = *value;
        }
    }

    fn forward(&mut self, limit: usize) {
        self.arch.dispatch(Sweep::<true> {
            supernodes: &self.supernodes,
            patterns: &self.patterns,
            values: &self.values,
            pivots: &self.pivots,
            limit,
            x: &mut self.x,
            work: &mut self.work,
        });
    }

    fn backward(&mut self, limit: usize) {
        self.arch.dispatch(Sweep::<false> {
            supernodes: &self.supernodes,
            patterns: &self.patterns,
            values: &self.values,
            pivots: &self.pivots,
            limit,
            x: &mut self.x,
            work: &mut self.work,
        });
    }
}

impl Factor for Cholesky {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        let dofs = x.len();
        self.permute(x);
        self.forward(dofs);
        self.backward(dofs);
        self.unpermute(x);
        Ok(())
    }

    fn schur(&self) -> &Mat<f64> {
        &self.schur
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64]) -> Result<()> {
        self.permute(b);
        self.forward(self.interior);
        h.copy_from_slice(&self.x[self.interior..]);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        self.x[self.interior..].copy_from_slice(values);
        self.backward(self.interior);
        self.unpermute(x);
        Ok(())
    }

    fn solve_schur(&self, h: &mut [f64]) {
        let size = h.len();
        for j in 0..size {
            let column = self.tail.col(j);
            h[j] /= column[j];
            for i in j + 1..size {
                h[i] -= column[i] * h[j];
            }
        }
        for j in (0..size).rev() {
            let column = self.tail.col(j);
            let known: f64 = (j + 1..size).map(|i| column[i] * h[i]).sum();
            h[j] = (h[j] - known) / column[j];
        }
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        if dofs.is_empty() {
            return self.factor(None);
        }
        let mut pinned = vec![false; self.matrix.nrows()];
        for &dof in dofs {
            pinned[dof] = true;
        }
        self.factor(Some(&pinned))
    }
}

/// Triangular solve with the columns before `limit`: forward with L, or backward with its
/// transpose.
struct Sweep<'a, const FORWARD: bool> {
    supernodes: &'a [Supernode],
    patterns: &'a [u32],
    values: &'a [f64],
    pivots: &'a [f64],
    limit: usize,
    x: &'a mut [f64],
    work: &'a mut [f64],
}

impl<const FORWARD: bool> WithSimd for Sweep<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (supernodes, limit) = (self.supernodes, self.limit);
        if FORWARD {
            for s in supernodes {
                if s.start < limit {
                    self.eliminate(simd, s);
                }
            }
        } else {
            for s in supernodes.iter().rev() {
                if s.start < limit {
                    self.substitute(simd, s);
                }
            }
        }
    }
}

impl<const FORWARD: bool> Sweep<'_, FORWARD> {
    /// Eliminates forward with the columns of one supernode. `work` holds the supernode's part of x
    /// and below it the updates to other rows of x.
    #[inline(always)]
    fn eliminate<S: Simd>(&mut self, simd: S, s: &Supernode) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&self.x[s.start..s.end]);
        work[width..].fill(0.0);
        let mut j = 0;
        while j + 4 <= columns {
            let a = four(values, j, height);
            let (head, rest) = work[j..].split_at_mut(4);
            head[0] *= pivots[j];
            head[1] = (head[1] - a[0][1] * head[0]) * pivots[j + 1];
            head[2] = (head[2] - a[0][2] * head[0] - a[1][2] * head[1]) * pivots[j + 2];
            head[3] = (head[3] - a[0][3] * head[0] - a[1][3] * head[1] - a[2][3] * head[2]) * pivots[j + 3];
            subtract4(simd, below(a), head, rest);
            j += 4;
        }
        for j in j..columns {
            let (head, rest) = work[j..].split_at_mut(1);
            head[0] *= pivots[j];
            for (y, a) in rest.iter_mut().zip(&values[j * height + j + 1..]) {
                *y -= a * head[0];
            }
        }
        self.x[s.start..s.end].copy_from_slice(&work[..width]);
        for (loss, &row) in work[width..].iter().zip(&self.patterns[s.pattern..]) {
            self.x[row as usize] += loss;
        }
    }

    /// Substitutes backward with the columns of one supernode.
    #[inline(always)]
    fn substitute<S: Simd>(&mut self, simd: S, s: &Supernode) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&self.x[s.start..s.end]);
        for (value, &row) in work[width..].iter_mut().zip(&self.patterns[s.pattern..]) {
            *value = self.x[row as usize];
        }
        let whole = columns / 4 * 4;
        for j in (whole..columns).rev() {
            let (head, rest) = work[j..].split_at_mut(1);
            let mut known = 0.0;
            for (y, a) in rest.iter().zip(&values[j * height + j + 1..]) {
                known += a * y;
            }
            head[0] = (head[0] - known) * pivots[j];
        }
        for j in (0..whole).step_by(4).rev() {
            let a = four(values, j, height);
            let (head, rest) = work[j..].split_at_mut(4);
            let known = dot4(simd, below(a), rest);
            head[3] = (head[3] - known[3]) * pivots[j + 3];
            head[2] = (head[2] - known[2] - a[2][3] * head[3]) * pivots[j + 2];
            head[1] = (head[1] - known[1] - a[1][2] * head[2] - a[1][3] * head[3]) * pivots[j + 1];
            head[0] =
                (head[0] - known[0] - a[0][1] * head[1] - a[0][2] * head[2] - a[0][3] * head[3]) * pivots[j];
        }
        self.x[s.start..s.end].copy_from_slice(&work[..width]);
    }
}

/// Returns columns j to j + 3 of a panel, from row j on.
#[inline(always)]
fn four(values: &[f64], j: usize, height: usize) -> [&[f64]; 4] {
    let (from, to) = (j * height + j, (j + 1) * height);
    [
        &values[from..to],
        &values[from + height..to + height],
        &values[from + 2 * height..to + 2 * height],
        &values[from + 3 * height..to + 3 * height],
    ]
}

/// Returns the columns of [`four`] below their triangle.
#[inline(always)]
fn below(a: [&[f64]; 4]) -> [&[f64]; 4] {
    [&a[0][4..], &a[1][4..], &a[2][4..], &a[3][4..]]
}

fn analysis_failed(dofs: usize, why: impl std::fmt::Debug) -> Error {
    Error::Singular(format!("the matrix of {dofs} dofs cannot be analysed: {why:?}"))
}

/// Returns an approximate minimum degree order with the contact dofs last (ascending) and the other
/// dofs in postorder of the elimination tree.
fn elimination_order(matrix: &SparseColMat<usize, f64>, contact_dofs: &[usize]) -> Result<Vec<usize>> {
    let dofs = matrix.nrows();
    let (mut order, mut place) = (vec![0; dofs], vec![0; dofs]);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(dofs, matrix.compute_nnz());
    // The symbolic analysis that follows takes about as much.
    let needed = scratch.unaligned_bytes_required() as u64;
    memory::require(needed, &format!("analysing the matrix of {dofs} dofs"), |part| would_fit(part, dofs))?;
    let mut memory = MemBuffer::try_new(scratch).map_err(|why| analysis_failed(dofs, why))?;
    amd::order_maybe_unsorted(
        &mut order,
        &mut place,
        matrix.symbolic(),
        amd::Control::default(),
        MemStack::new(&mut memory),
    )
    .map_err(|why| analysis_failed(dofs, why))?;
    let mut last = vec![false; dofs];
    for &dof in contact_dofs {
        last[dof] = true;
    }
    order.retain(|&dof| !last[dof]);
    let interior = order.len();
    order.extend_from_slice(contact_dofs);
    let tree = elimination_tree(matrix, &order);
    let postorder = postorder(&tree[..interior]);
    Ok(postorder.into_iter().chain(interior..dofs).map(|place| order[place]).collect())
}

/// Returns the parent of each position in the elimination tree (Liu 1990); `usize::MAX` for a root.
fn elimination_tree(matrix: &SparseColMat<usize, f64>, order: &[usize]) -> Vec<usize> {
    let dofs = order.len();
    let mut place = vec![0; dofs];
    for (new, &old) in order.iter().enumerate() {
        place[old] = new;
    }
    // The off-diagonal entries before each position, one position after the other.
    let mut starts = vec![0; dofs + 1];
    for_each_pair(matrix, &place, |_, later| starts[later + 1] += 1);
    for place in 0..dofs {
        starts[place + 1] += starts[place];
    }
    let mut next = starts.clone();
    let mut earlier = vec![0; starts[dofs]];
    for_each_pair(matrix, &place, |before, later| {
        earlier[next[later]] = before;
        next[later] += 1;
    });
    let mut parent = vec![usize::MAX; dofs];
    let mut ancestor = vec![usize::MAX; dofs];
    for j in 0..dofs {
        for &i in &earlier[starts[j]..starts[j + 1]] {
            let mut i = i;
            while ancestor[i] != j {
                let next = std::mem::replace(&mut ancestor[i], j);
                if next == usize::MAX {
                    parent[i] = j;
                    break;
                }
                i = next;
            }
        }
    }
    parent
}

/// Visits the positions (earlier, later) of the off-diagonal entries.
fn for_each_pair(matrix: &SparseColMat<usize, f64>, place: &[usize], mut visit: impl FnMut(usize, usize)) {
    for column in 0..matrix.ncols() {
        for row in matrix.row_idx_of_col(column).filter(|&row| row != column) {
            let (a, b) = (place[row], place[column]);
            visit(a.min(b), a.max(b));
        }
    }
}

/// Returns a postorder, children before parents; a parent past the end marks a root.
fn postorder(parent: &[usize]) -> Vec<usize> {
    let size = parent.len();
    let mut children = vec![Vec::new(); size];
    let mut stack = Vec::new();
    for (node, &parent) in parent.iter().enumerate().rev() {
        match children.get_mut(parent) {
            Some(children) => children.push(node),
            None => stack.push((node, false)),
        }
    }
    let mut order = Vec::with_capacity(size);
    while let Some((node, done)) = stack.pop() {
        if done {
            order.push(node);
        } else {
            stack.push((node, true));
            stack.extend(children[node].iter().map(|&child| (child, false)));
        }
    }
    order
}

fn analyse(matrix: &SparseColMat<usize, f64>, order: &[usize]) -> Result<SymbolicCholesky<usize>> {
    let dofs = order.len();
    let mut place = vec![0; dofs];
    for (new, &old) in order.iter().enumerate() {
        place[old] = new;
    }
    factorize_symbolic_cholesky(
        matrix.symbolic(),
        Side::Lower,
        SymmetricOrdering::Custom(PermRef::new_checked(order, &place, dofs)),
        CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        },
    )
    .map_err(|why| analysis_failed(dofs, why))
}
