//! Elimination order with the contact dofs last, and the symbolic analysis in that order.

use super::size::would_fit;
use crate::error::{Error, Result};
use crate::memory;
use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::SparseColMat;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, amd};

/// Returns an approximate minimum degree order with the contact dofs last (ascending) and the other
/// dofs in postorder of the elimination tree.
pub(super) fn elimination_order(
    matrix: &SparseColMat<usize, f64>,
    contact_dofs: &[usize],
) -> Result<Vec<usize>> {
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
    let (dofs, place) = (order.len(), places(order));
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

/// Returns the position of each dof in an order.
pub(super) fn places(order: &[usize]) -> Vec<usize> {
    let mut places = vec![0; order.len()];
    order.iter().enumerate().for_each(|(new, &old)| places[old] = new);
    places
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

/// Analyses the factor of a matrix in the given elimination order.
pub(super) fn analyse(matrix: &SparseColMat<usize, f64>, order: &[usize]) -> Result<SymbolicCholesky<usize>> {
    let (dofs, place) = (order.len(), places(order));
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

/// Creates the error for an analysis that failed.
pub(super) fn analysis_failed(dofs: usize, why: impl std::fmt::Debug) -> Error {
    Error::Singular(format!("the matrix of {dofs} dofs cannot be analysed: {why:?}"))
}
