//! Supernodes: columns of the factor with the same rows below them, stored as dense panels.

use faer::sparse::linalg::cholesky::{SymbolicCholesky, SymbolicCholeskyRaw};

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
    pub fn shape(&self, limit: usize) -> (usize, usize, usize) {
        let width = self.end - self.start;
        (width, width + self.rows, width.min(limit - self.start))
    }
}

/// Returns the supernodes of a symbolic factor, and the rows below each of them one after the
/// other; `None` where it is stored column by column.
pub(super) fn layout(symbolic: &SymbolicCholesky<usize>) -> Option<(Vec<Supernode>, Vec<u32>)> {
    let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.raw() else { return None };
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
    Some((supernodes, patterns))
}
