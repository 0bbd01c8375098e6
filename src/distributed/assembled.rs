//! Assembly of a sum of forms into one matrix over all ranks.

use crate::error::Result;
use crate::linalg::LinearCombination;
use crate::petsc::{Context, Index, Matrix};
use std::ops::Range;
use std::rc::Rc;

/// Number of parts in which the rows of a matrix are added up.
const PARTS: usize = 8;

/// Assembles the matrix of a linear combination of forms, as a sum of the matrices of the ranks'
/// cells where a solver needs them by themselves. Collective.
///
/// Local dofs come with their positions among the dofs of all ranks, negative for a constrained
/// one, and with the number of dofs that this rank owns.
///
/// # Errors
/// Returns [`crate::Error::Petsc`] where PETSc reports an error.
pub(super) fn assembled(
    context: &Rc<Context>,
    (global, owned): (&[Index], usize),
    sum: &LinearCombination,
    of_subdomains: bool,
) -> Result<Matrix> {
    // The cells contribute many times as many entries as the matrix has, and PETSc keeps a record
    // of all that it is given. They are therefore added up, some rows at a time. Values follow once
    // PETSc has taken the places of all, so that both are not in memory at once.
    let local = global.len();
    let parts = (0..PARTS).map(|part| local * part / PARTS..local * (part + 1) / PARTS);
    let mut count = 0;
    let (mut rows, mut columns) = (Vec::new(), Vec::new());
    for range in parts.clone() {
        for (row, entries) in range.clone().zip(entries_of(global, sum, range)) {
            count += entries.len();
            rows.extend(std::iter::repeat_n(global[row], entries.len()));
            columns.extend(entries.into_iter().map(|(column, _)| column));
        }
    }
    let dofs: Vec<Index> = global.iter().copied().filter(|&dof| dof >= 0).collect();
    let (sizes, dofs) = ([owned; 2], of_subdomains.then_some(&dofs[..]));
    let mut matrix = Matrix::from_pattern(context, sizes, [rows, columns], dofs)?;
    let mut values = Vec::with_capacity(count);
    for range in parts {
        values.extend(entries_of(global, sum, range).into_iter().flatten().map(|(_, value)| value));
    }
    matrix.set_values(&values)?;
    drop(values);
    matrix.without_triplets()
}

/// Returns the contributions of this rank's cells to some rows of a linear combination of forms,
/// given by local dofs: columns in global vectors, ascending, and values.
fn entries_of(global: &[Index], sum: &LinearCombination, range: Range<usize>) -> Vec<Vec<(Index, f64)>> {
    let mut entries = vec![Vec::new(); range.len()];
    for (scale, form) in sum.terms() {
        form.for_each_lower(|row, column, value| {
            let mut add = |row: usize, column: usize| {
                if range.contains(&row) && global[row] >= 0 && global[column] >= 0 {
                    entries[row - range.start].push((global[column], scale * value));
                }
            };
            add(row, column);
            if row != column {
                add(column, row);
            }
        });
    }
    for row in &mut entries {
        // Equal columns stay in the order of the terms and cells.
        row.sort_by_key(|(column, _)| *column);
        row.dedup_by(|next, kept| {
            let is_same = next.0 == kept.0;
            if is_same {
                kept.1 += next.1;
            }
            is_same
        });
        row.shrink_to_fit();
    }
    entries
}
