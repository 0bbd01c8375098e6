//! Sparse Cholesky with the candidates for contact last.
//!
//! faer orders (approximate minimum degree), analyses and factors; the candidates are then moved to the end, the rest put in
//! postorder so that supernodes stay whole. The trailing block \(L_{cc} L_{cc}^T\) *is* the Schur complement of the candidates.
//! The triangular solves for one right-hand side are ours: they stop at the candidates, and four columns at a time they are
//! faster than the general ones.

use super::Factor;
use crate::error::{Error, Result};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Par, Side};
use pulp::Arch;

/// A sparse Cholesky factor \(P A P^T = L L^T\).
#[derive(Debug)]
pub struct Cholesky {
    matrix: SparseColMat<usize, f64>,
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    supernodes: Vec<Supernode>,
    patterns: Vec<u32>,
    /// Dof at each place of the elimination.
    order: Vec<u32>,
    /// Number of dofs that are no candidates.
    interior: usize,
    /// Factor and Schur complement of the candidates.
    tail: Mat<f64>,
    schur: Mat<f64>,
    arch: Arch,
    x: Vec<f64>,
    below: Vec<f64>,
}

/// Columns `start..end` of L: a dense triangle and the rows of `pattern` below it, column by column from `values` on.
#[derive(Debug, Clone, Copy)]
struct Supernode {
    start: usize,
    end: usize,
    values: usize,
    pattern: usize,
    rows: usize,
}

impl Cholesky {
    /// Factors the symmetric matrix whose lower triangle is the sum of `triplets`.
    ///
    /// # Errors
    /// [`Error::Singular`] where it is not positive definite.
    pub fn new(
        dofs: usize,
        triplets: &[Triplet<usize, usize, f64>],
        candidates: &[usize],
    ) -> Result<Cholesky> {
        let matrix = SparseColMat::try_new_from_triplets(dofs, dofs, triplets)
            .map_err(|why| Error::Singular(format!("the matrix of {dofs} dofs cannot be stored: {why:?}")))?;
        let order = elimination_order(&matrix, candidates)?;
        let symbolic = analyse(&matrix, &order)?;
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
        let below = supernodes.iter().map(|s| s.rows).max().unwrap_or(0);
        let mut cholesky = Cholesky {
            values: vec![0.0; symbolic.len_val()],
            supernodes,
            patterns,
            order: order.iter().map(|&dof| dof as u32).collect(),
            interior: dofs - candidates.len(),
            tail: Mat::zeros(0, 0),
            schur: Mat::zeros(0, 0),
            arch: Arch::new(),
            x: vec![0.0; dofs],
            below: vec![0.0; below],
            matrix,
            symbolic,
        };
        cholesky.factor(None)?;
        Ok(cholesky)
    }

    /// Number of stored entries of L.
    pub fn entries(&self) -> usize {
        self.values.len()
    }

    /// Numeric factorisation, of the matrix itself or of the one with other values on its pattern.
    fn factor(&mut self, values: Option<&[f64]>) -> Result<()> {
        let dofs = self.matrix.nrows();
        let matrix = faer::sparse::SparseColMatRef::new(
            self.matrix.symbolic(),
            values.unwrap_or_else(|| self.matrix.val()),
        );
        let scratch =
            self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, faer::Spec::default());
        let mut memory = MemBuffer::try_new(scratch)
            .map_err(|_| Error::Singular(format!("not enough memory to factor a matrix of {dofs} dofs")))?;
        self.symbolic
            .factorize_numeric_llt(
                &mut self.values,
                matrix,
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                faer::Spec::default(),
            )
            .map_err(|_| Error::Singular(format!("the matrix of {dofs} dofs is not positive definite")))?;
        if values.is_none() {
            self.tail = self.trailing_block();
            self.schur = &self.tail * self.tail.transpose();
        }
        Ok(())
    }

    /// The dense triangle \(L_{cc}\) of the candidates.
    fn trailing_block(&self) -> Mat<f64> {
        let size = self.order.len() - self.interior;
        let mut tail = Mat::zeros(size, size);
        for s in &self.supernodes {
            let width = s.end - s.start;
            let pattern = &self.patterns[s.pattern..][..s.rows];
            for column in s.start.max(self.interior)..s.end {
                let entries = &self.values[s.values + (column - s.start) * (width + s.rows)..][..width + s.rows];
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
        let Cholesky { supernodes, patterns, values, x, below, arch, .. } = self;
        arch.dispatch(
            #[inline(always)]
            || {
                for s in supernodes.iter().take_while(|s| s.start < limit) {
                    eliminate(s, limit, values, patterns, x, below);
                }
            },
        );
    }

    fn backward(&mut self, limit: usize) {
        let Cholesky { supernodes, patterns, values, x, below, arch, .. } = self;
        arch.dispatch(
            #[inline(always)]
            || {
                for s in supernodes.iter().rev().skip_while(|s| s.start >= limit) {
                    substitute(s, limit, values, patterns, x, below);
                }
            },
        );
    }
}

impl Factor for Cholesky {
    fn solve(&mut self, x: &mut [f64]) {
        let dofs = x.len();
        self.permute(x);
        self.forward(dofs);
        self.backward(dofs);
        self.unpermute(x);
    }

    fn schur(&self) -> &Mat<f64> {
        &self.schur
    }

    fn condense(&mut self, b: &[f64], h: &mut [f64]) {
        self.permute(b);
        self.forward(self.interior);
        h.copy_from_slice(&self.x[self.interior..]);
    }

    fn expand(&mut self, candidates: &[f64], x: &mut [f64]) {
        self.x[self.interior..].copy_from_slice(candidates);
        self.backward(self.interior);
        self.unpermute(x);
    }

    fn solve_candidates(&self, h: &mut [f64]) {
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
        let mut values = self.matrix.val().to_vec();
        for column in 0..self.matrix.ncols() {
            let range = self.matrix.col_range(column);
            for (row, value) in self.matrix.row_idx_of_col(column).zip(&mut values[range]) {
                if pinned[row] || pinned[column] {
                    *value = f64::from(row == column);
                }
            }
        }
        self.factor(Some(&values))
    }
}

/// Forward elimination with the columns of one supernode before `limit`.
#[inline(always)]
fn eliminate(s: &Supernode, limit: usize, values: &[f64], patterns: &[u32], x: &mut [f64], below: &mut [f64]) {
    let width = s.end - s.start;
    let height = width + s.rows;
    let columns = width.min(limit - s.start);
    let values = &values[s.values..][..width * height];
    let top = &mut x[s.start..s.end];
    for (j, column) in values.chunks_exact(height).take(columns).enumerate() {
        let value = top[j] / column[j];
        top[j] = value;
        for (x, a) in top[j + 1..].iter_mut().zip(&column[j + 1..width]) {
            *x -= a * value;
        }
    }
    let below = &mut below[..s.rows];
    below.fill(0.0);
    let mut j = 0;
    while j + 4 <= columns {
        let (a, x) = (four(values, j, height, width), &top[j..j + 4]);
        for i in 0..below.len() {
            below[i] += a[0][i] * x[0] + a[1][i] * x[1] + a[2][i] * x[2] + a[3][i] * x[3];
        }
        j += 4;
    }
    for j in j..columns {
        for (sum, a) in below.iter_mut().zip(&values[j * height + width..][..s.rows]) {
            *sum += a * top[j];
        }
    }
    for (sum, &row) in below.iter().zip(&patterns[s.pattern..][..s.rows]) {
        x[row as usize] -= sum;
    }
}

/// Back substitution for the columns of one supernode before `limit`.
#[inline(always)]
fn substitute(s: &Supernode, limit: usize, values: &[f64], patterns: &[u32], x: &mut [f64], below: &mut [f64]) {
    let width = s.end - s.start;
    let height = width + s.rows;
    let columns = width.min(limit - s.start);
    let values = &values[s.values..][..width * height];
    let below = &mut below[..s.rows];
    for (value, &row) in below.iter_mut().zip(&patterns[s.pattern..][..s.rows]) {
        *value = x[row as usize];
    }
    let top = &mut x[s.start..s.end];
    let mut j = 0;
    while j + 4 <= columns {
        let a = four(values, j, height, width);
        let mut sums = [[0.0; 4]; 4];
        let whole = below.len() / 4 * 4;
        for i in (0..whole).step_by(4) {
            for (sums, a) in sums.iter_mut().zip(&a) {
                for lane in 0..4 {
                    sums[lane] += a[i + lane] * below[i + lane];
                }
            }
        }
        for (k, (sums, a)) in sums.iter().zip(&a).enumerate() {
            let rest: f64 = (whole..below.len()).map(|i| a[i] * below[i]).sum();
            top[j + k] -= (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest;
        }
        j += 4;
    }
    for j in j..columns {
        let a = &values[j * height + width..][..s.rows];
        top[j] -= a.iter().zip(below.iter()).map(|(a, b)| a * b).sum::<f64>();
    }
    for (j, column) in values.chunks_exact(height).take(columns).enumerate().rev() {
        let (head, tail) = top.split_at_mut(j + 1);
        let known: f64 = column[j + 1..width].iter().zip(&*tail).map(|(a, x)| a * x).sum();
        head[j] = (head[j] - known) / column[j];
    }
}

/// The parts below the triangle of four columns.
#[inline(always)]
fn four(values: &[f64], j: usize, height: usize, width: usize) -> [&[f64]; 4] {
    std::array::from_fn(|k| &values[(j + k) * height + width..(j + k + 1) * height])
}

fn analysis_failed(dofs: usize, why: impl std::fmt::Debug) -> Error {
    Error::Singular(format!("the matrix of {dofs} dofs cannot be analysed: {why:?}"))
}

/// Minimum degree, then the candidates last (ascending), then the rest in postorder of the elimination tree.
fn elimination_order(matrix: &SparseColMat<usize, f64>, candidates: &[usize]) -> Result<Vec<usize>> {
    let dofs = matrix.nrows();
    let (mut order, mut place) = (vec![0; dofs], vec![0; dofs]);
    let scratch = amd::order_maybe_unsorted_scratch::<usize>(dofs, matrix.compute_nnz());
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
    for &dof in candidates {
        last[dof] = true;
    }
    // Ascending among themselves: the order in which the caller numbers them.
    order.sort_by_key(|&dof| if last[dof] { 1 + dof } else { 0 });
    let interior = dofs - candidates.len();
    let tree = elimination_tree(matrix, &order);
    let postorder = postorder(&tree[..interior]);
    Ok(postorder.into_iter().chain(interior..dofs).map(|place| order[place]).collect())
}

/// Parent of each place of the elimination (Liu 1990); its own number past the end for a root.
fn elimination_tree(matrix: &SparseColMat<usize, f64>, order: &[usize]) -> Vec<usize> {
    let dofs = order.len();
    let mut place = vec![0; dofs];
    for (new, &old) in order.iter().enumerate() {
        place[old] = new;
    }
    let mut earlier = vec![Vec::new(); dofs];
    for column in 0..dofs {
        for row in matrix.row_idx_of_col(column).filter(|&row| row != column) {
            let (a, b) = (place[row], place[column]);
            earlier[a.max(b)].push(a.min(b));
        }
    }
    let mut parent = vec![usize::MAX; dofs];
    let mut ancestor = vec![usize::MAX; dofs];
    for (j, earlier) in earlier.iter().enumerate() {
        for &i in earlier {
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

/// Children before parents, subtree by subtree; a parent past the end makes a root.
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
