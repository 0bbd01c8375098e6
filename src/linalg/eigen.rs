//! Eigenvalues of dense matrices.

use crate::error::{Error, Result};
use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::evd::{
    ComputeEigenvectors, EvdParams, SelfAdjointEvdParams, evd_real, evd_scratch, self_adjoint_evd,
    self_adjoint_evd_scratch,
};
use faer::{Auto, Mat, MatRef, Par};
use std::fmt::Debug;

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
    let mut memory = work(scratch, size)?;
    self_adjoint_evd(
        matrix,
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        params.into(),
    )
    .map_err(not_found)?;
    Ok((values.column_vector().iter().copied().collect(), vectors))
}

/// Returns the eigenvalues, as real and imaginary parts, and the eigenvectors of a matrix.
///
/// Conjugate eigenvalues are neighbours, that with the positive imaginary part first; its column
/// has the real parts of the eigenvector, and the next column the imaginary parts.
///
/// # Errors
/// Returns the errors of [`symmetric_eigen`].
pub(crate) fn general_eigen(matrix: MatRef<f64>) -> Result<(Vec<[f64; 2]>, Mat<f64>)> {
    let size = matrix.nrows();
    let params = <EvdParams as Auto<f64>>::auto();
    let (left, right) = (ComputeEigenvectors::No, ComputeEigenvectors::Yes);
    let scratch = evd_scratch::<f64>(size, left, right, Par::Seq, params.into());
    let (mut real, mut imaginary) = (Diag::zeros(size), Diag::zeros(size));
    let mut vectors = Mat::zeros(size, size);
    let mut memory = work(scratch, size)?;
    let stack = MemStack::new(&mut memory);
    let (re, im) = (real.as_mut(), imaginary.as_mut());
    evd_real(matrix, re, im, None, Some(vectors.as_mut()), Par::Seq, stack, params.into())
        .map_err(not_found)?;
    let values = (0..size).map(|k| [real[k], imaginary[k]]).collect();
    Ok((values, vectors))
}

fn work(scratch: StackReq, size: usize) -> Result<MemBuffer> {
    let refused = |_| Error::Memory(format!("there is not enough memory for {size} eigenvectors"));
    MemBuffer::try_new(scratch).map_err(refused)
}

fn not_found(why: impl Debug) -> Error {
    Error::Singular(format!("the eigenvalues of a dense matrix were not found: {why:?}"))
}
