//! Factor of an indefinite sparse matrix, which counts its negative eigenvalues.

use super::ordering::{analyse, analysis_failed, elimination_order};
use super::size::{Size, require};
use super::{no_memory, supernodes};
use crate::error::Result;
use crate::linalg::Indefinite;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::perm::PermRef;
use faer::sparse::SparseColMat;
use faer::sparse::linalg::cholesky::IntranodeLbltRef;
use faer::{Conj, Mat, Par, Side, Spec};

/// Factors the symmetric matrix with the given lower triangle as `$L D L^T$`, with pivots chosen
/// inside the supernodes (Bunch and Kaufman 1977).
///
/// # Errors
/// Returns [`crate::Error::Memory`] where the factor does not fit.
pub(in crate::linalg) fn factor_indefinite(matrix: &SparseColMat<usize, f64>) -> Result<Indefinite> {
    let dofs = matrix.nrows();
    let order = elimination_order(matrix, &[])?;
    let symbolic = analyse(matrix, &order)?;
    require(&Size::of(&symbolic, 0, false), 1, dofs)?;
    let (supernodes, _) =
        supernodes::layout(&symbolic).ok_or_else(|| analysis_failed(dofs, "no supernodes"))?;
    let mut values = vec![0.0; symbolic.len_val()];
    let mut off_diagonal = vec![0.0; dofs];
    let (mut forward, mut inverse) = (vec![0; dofs], vec![0; dofs]);
    let scratch = symbolic.factorize_numeric_intranode_lblt_scratch::<f64>(Par::Seq, Spec::default());
    let mut memory = MemBuffer::try_new(scratch).map_err(|_| no_memory(dofs))?;
    symbolic.factorize_numeric_intranode_lblt(
        &mut values,
        &mut off_diagonal,
        &mut forward,
        &mut inverse,
        matrix.as_ref(),
        Side::Lower,
        Par::Seq,
        MemStack::new(&mut memory),
        Spec::default(),
    );
    let mut negative = 0;
    for s in &supernodes {
        let height = s.end - s.start + s.rows;
        let diagonal = |place: usize| values[s.values + (place - s.start) * (height + 1)];
        let mut place = s.start;
        while place < s.end {
            let (first, coupling) = (diagonal(place), off_diagonal[place]);
            if coupling == 0.0 {
                negative += usize::from(first < 0.0);
                place += 1;
            } else {
                negative += negative_of_two(first, coupling, diagonal(place + 1));
                place += 2;
            }
        }
    }
    let solve = move |x: &mut Mat<f64>| {
        let pivots = PermRef::new_checked(&forward, &inverse, dofs);
        let factor = IntranodeLbltRef::new(&symbolic, &values, &off_diagonal, pivots);
        let scratch = symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| no_memory(dofs))?;
        factor.solve_in_place_with_conj(Conj::No, x.as_mut(), Par::Seq, MemStack::new(&mut memory));
        Ok(())
    };
    Ok(Indefinite { negative, solve: Box::new(solve) })
}

/// Returns the number of negative eigenvalues of a symmetric 2 x 2 matrix.
fn negative_of_two(first: f64, coupling: f64, second: f64) -> usize {
    let determinant = first * second - coupling * coupling;
    if determinant < 0.0 { 1 } else { 2 * usize::from(first < 0.0) }
}

#[cfg(test)]
mod tests {
    use super::factor_indefinite;
    use faer::Mat;
    use faer::sparse::{SparseColMat, Triplet};

    /// Entry 0 on the diagonal, with which a factor without pivots would fail.
    #[test]
    fn an_indefinite_matrix_is_counted_and_solved() {
        let entries = [(0, 0, 0.0), (1, 0, 1.0), (1, 1, 0.0), (2, 2, -3.0), (3, 2, 1.0), (3, 3, 5.0)];
        let triplets = entries.map(|(row, column, value)| Triplet::new(row, column, value));
        let matrix = SparseColMat::try_new_from_triplets(4, 4, &triplets).unwrap();
        let mut factor = factor_indefinite(&matrix).unwrap();
        assert_eq!(factor.negative, 2);
        let mut x = Mat::from_fn(4, 1, |row, _| [2.0, 1.0, 1.0, 21.0][row]);
        (factor.solve)(&mut x).unwrap();
        (0..4).for_each(|row| assert!((x[(row, 0)] - [1.0, 2.0, 1.0, 4.0][row]).abs() < 1e-14, "{x:?}"));
    }
}
