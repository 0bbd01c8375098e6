//! Blocks of vectors: matrices with one vector per column, whose rows are the dofs of this rank.

use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::{Engine, Form};
use crate::random::random_vector;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use std::ops::Range;

/// Number of random vectors that a rank can draw before its seeds meet those of the next rank.
const SEEDS_PER_RANK: usize = 1 << 32;

/// Returns a block of pseudo-random numbers, different on each rank and for each first number.
pub(super) fn random_block<E: Engine>(engine: &E, columns: usize, first: usize) -> Mat<f64> {
    let mut block = Mat::zeros(engine.dofs(), columns);
    for j in 0..columns {
        let seed = engine.comm().rank() * SEEDS_PER_RANK + first + j;
        block.col_as_slice_mut(j).copy_from_slice(&random_vector(engine.dofs(), seed as u64));
    }
    block
}

/// Returns A X and the quadratic forms x^T A x of the columns, summed cell by cell. Collective.
pub(super) fn multiply<E: Engine>(engine: &E, form: &Form, x: &Mat<f64>) -> Result<(Mat<f64>, Vec<f64>)> {
    let mut product = Mat::zeros(x.nrows(), x.ncols());
    let mut forms = Vec::with_capacity(x.ncols());
    for j in 0..x.ncols() {
        forms.push(engine.multiply(form, x.col_as_slice(j), product.col_as_slice_mut(j))?);
    }
    Ok((product, forms))
}

/// Returns the scalar products `$X_k^T Y$` of the columns of several blocks with those of one, over
/// all ranks and with one reduction. Collective.
pub(super) fn scalar_products<E: Engine, const N: usize>(
    engine: &E,
    blocks: [MatRef<f64>; N],
    y: MatRef<f64>,
) -> [Mat<f64>; N] {
    // The products are faster in this order, in which the long block is not rearranged.
    let products = blocks.map(|x| product(y.transpose(), x).transpose().to_owned());
    let packed: Vec<f64> = products.iter().flat_map(entries).collect();
    let mut sums = engine.comm().all_reduce_sum_slice(&packed).into_iter();
    products.map(|mut matrix| {
        fill(&mut matrix, &mut sums);
        matrix
    })
}

/// Returns some columns of a matrix.
pub(super) fn columns_of(matrix: &Mat<f64>, range: Range<usize>) -> Mat<f64> {
    matrix.subcols(range.start, range.len()).to_owned()
}

/// Returns A B.
pub(super) fn product(a: MatRef<f64>, b: MatRef<f64>) -> Mat<f64> {
    let mut product = Mat::zeros(a.nrows(), b.ncols());
    matmul(product.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    product
}

/// Computes Y = Y - A B.
pub(super) fn subtract_product(a: MatRef<f64>, b: MatRef<f64>, y: &mut Mat<f64>) {
    matmul(y.as_mut(), Accum::Add, a, b, -1.0, Par::Seq);
}

/// Returns the eigenvalues, ascending, and the eigenvectors of a symmetric matrix, given by its
/// lower triangle, the same on every rank. Collective.
pub(super) fn eigen<E: Engine>(engine: &E, matrix: MatRef<f64>) -> Result<(Vec<f64>, Mat<f64>)> {
    let (mut values, mut vectors) = engine.comm().all_ok(symmetric_eigen(matrix))?;
    // Processors may round differently.
    engine.comm().broadcast(&mut values);
    let mut packed = entries(&vectors);
    engine.comm().broadcast(&mut packed);
    fill(&mut vectors, packed);
    Ok((values, vectors))
}

/// Returns the entries of a matrix, column by column.
fn entries(matrix: &Mat<f64>) -> Vec<f64> {
    (0..matrix.ncols()).flat_map(|j| matrix.col_as_slice(j)).copied().collect()
}

/// Fills a matrix with entries, column by column.
fn fill(matrix: &mut Mat<f64>, entries: impl IntoIterator<Item = f64>) {
    let mut entries = entries.into_iter();
    for j in 0..matrix.ncols() {
        matrix.col_as_slice_mut(j).iter_mut().zip(&mut entries).for_each(|(place, entry)| *place = entry);
    }
}
