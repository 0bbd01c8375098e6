//! Eigenvalues of dense symmetric matrices.

use crate::error::{Error, Result};
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{
    ComputeEigenvectors, SelfAdjointEvdParams, self_adjoint_evd, self_adjoint_evd_scratch,
};
use faer::{Auto, Mat, MatRef, Par};

/// Returns the eigenvalues, ascending, and the eigenvectors of a symmetric matrix, given by its
/// lower triangle, by implicit QR of the tridiagonal form. The divide and conquer method that faer
/// uses from 128 rows on leaves residuals of up to 2e-5 of the largest eigenvalue on matrices that
/// are nearly diagonal and graded.
///
/// # Errors
/// Returns [`Error::Singular`] where the iteration does not converge and [`Error::Memory`] where
/// the work does not fit.
pub(crate) fn symmetric_eigen(matrix: MatRef<f64>) -> Result<(Vec<f64>, Mat<f64>)> {
    let size = matrix.nrows();
    if size == 0 {
        return Ok((Vec::new(), Mat::zeros(0, 0)));
    }
    let params = SelfAdjointEvdParams {
        recursion_threshold: usize::MAX,
        ..<SelfAdjointEvdParams as Auto<f64>>::auto()
    };
    let scratch = self_adjoint_evd_scratch::<f64>(size, ComputeEigenvectors::Yes, Par::Seq, params.into());
    let (mut values, mut vectors) = (Diag::zeros(size), Mat::zeros(size, size));
    let mut memory = MemBuffer::try_new(scratch)
        .map_err(|_| Error::Memory(format!("there is not enough memory for {size} eigenvectors")))?;
    self_adjoint_evd(
        matrix,
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        params.into(),
    )
    .map_err(|why| Error::Singular(format!("the eigenvalues of a dense matrix were not found: {why:?}")))?;
    Ok((values.column_vector().iter().copied().collect(), vectors))
}
