//! Block Lanczos iteration for (K + s M)^-1 M, with full reorthogonalisation.
//!
//! The basis V is orthonormal in the scalar product of M. All of it is one matrix, so that
//! orthogonalisation, which dominates the cost, consists of products of matrices.

use super::blocks::{columns_of, eigen, multiply, product, random_block, scalar_products, subtract_product};
use super::inverse::ShiftedInverse;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::memory;
use faer::Mat;
use std::ops::Range;

/// Number of vectors per block. Larger blocks make faster products and need more vectors.
pub(super) const BLOCK: usize = 8;

/// Squared norm, relative to that before orthogonalisation, below which a direction counts as
/// linearly dependent: in the first pass, which cancels digits, and in the second, which does not.
const DEPENDENT: [f64; 2] = [1e-14, 1e-2];

/// Residual bound, relative to the eigenvalue of the inverse, at which a Ritz pair has converged,
/// and rounding of all pairs relative to the largest eigenvalue.
const CONVERGED: f64 = 1e-10;
const ROUNDING: f64 = 1e-17;

/// Share of [`CONVERGED`] to which a residual bound is small enough relative to the eigenvalue of
/// `$K x = \lambda M x$` itself. Just above a negative shift, modes of a cluster that differ by
/// less are equal.
const RESOLUTION: f64 = 0.1;

/// Krylov space under construction.
pub(super) struct Krylov {
    /// Basis V in the first `size` columns.
    basis: Mat<f64>,
    size: usize,
    /// Lower triangle of V^T M (K + s M)^-1 M V.
    projected: Mat<f64>,
    /// Columns of the last block, which the operator has not been applied to, and of the one
    /// before. The last block is empty where the space is exhausted.
    last: Range<usize>,
    previous: Range<usize>,
    /// Number of random vectors drawn.
    drawn: usize,
}

/// Ritz pairs of a Krylov space, from the largest eigenvalue of the inverse on.
pub(super) struct RitzPairs {
    /// Eigenvalues of K x = w^2 M x that the pairs stand for, ascending, in (rad/s)^2.
    pub squares: Vec<f64>,
    /// Number of leading pairs that have converged.
    pub converged: usize,
    /// Coordinates in the basis, one column per pair.
    coordinates: Mat<f64>,
}

/// Orthonormal block Q with W = V C + Q R.
struct Orthonormal {
    block: Mat<f64>,
    /// Coefficients C, one row per vector of the basis.
    coefficients: Mat<f64>,
    /// Coefficients R, one row per vector of the block.
    rest: Mat<f64>,
}

impl Krylov {
    /// Starts from a block and from orthonormal known modes with the given eigenvalues, with room
    /// for an expected number of vectors. Collective.
    pub fn new<E: Engine>(
        inverse: &mut ShiftedInverse<E>,
        shapes: &Mat<f64>,
        squares: &[f64],
        start: Mat<f64>,
        expected: usize,
    ) -> Result<Krylov> {
        let (dofs, size) = (inverse.engine.dofs(), shapes.ncols());
        let mut krylov = Krylov {
            basis: Mat::zeros(dofs, 0),
            size,
            projected: Mat::zeros(0, 0),
            last: size..size,
            previous: size..size,
            drawn: 0,
        };
        krylov.reserve(inverse, expected.max(size) + 2 * BLOCK)?;
        krylov.basis.as_mut().subcols_mut(0, size).copy_from(shapes);
        for (i, square) in squares.iter().enumerate() {
            krylov.projected[(i, i)] = 1.0 / (square + inverse.shift);
        }
        krylov.start(inverse, start)?;
        Ok(krylov)
    }

    /// Returns the number of vectors that the operator has been applied to.
    pub fn size(&self) -> usize {
        self.last.start
    }

    /// Returns whether the basis spans all that moves with inertia.
    pub fn is_exhausted(&self) -> bool {
        self.last.is_empty()
    }

    /// Makes room for vectors in all.
    fn reserve<E: Engine>(&mut self, inverse: &ShiftedInverse<E>, vectors: usize) -> Result<()> {
        let (dofs, present) = (self.basis.nrows(), self.basis.ncols());
        if vectors <= present {
            return Ok(());
        }
        let bytes = size_of::<f64>() * (2 * dofs * vectors + 4 * vectors * vectors);
        let what = format!("a basis of {vectors} vectors for natural modes");
        let advice = |part: f64| format!("about {:.0} modes would fit", part * vectors as f64 / 2.0);
        let fits = memory::require_of_each(bytes as u64, memory::processes_here(), &what, advice);
        inverse.engine.comm().all_ok(fits)?;
        self.basis.resize_with(dofs, vectors, |_, _| 0.0);
        self.projected.resize_with(vectors, vectors, |_, _| 0.0);
        Ok(())
    }

    /// Appends a first block. The operator is applied, because in the kernel of a singular mass
    /// nothing has inertia, but to what is orthogonal to the basis: a stiff plate on soft springs
    /// answers almost by rigid motions alone.
    fn start<E: Engine>(&mut self, inverse: &mut ShiftedInverse<E>, block: Mat<f64>) -> Result<()> {
        let block = self.orthonormalise(inverse, block)?.block;
        let (mut answer, _) = multiply(inverse.engine, inverse.mass, &block)?;
        inverse.solve(&mut answer)?;
        let start = self.orthonormalise(inverse, answer)?;
        self.append(inverse, &start.block)
    }

    /// Applies the operator to the last block. Collective.
    pub fn expand<E: Engine>(&mut self, inverse: &mut ShiftedInverse<E>) -> Result<()> {
        let last = self.last.clone();
        let block = self.basis.subcols(last.start, last.len()).to_owned();
        let (mut next, _) = multiply(inverse.engine, inverse.mass, &block)?;
        inverse.solve(&mut next)?;
        let Orthonormal { block, coefficients, rest } = self.orthonormalise(inverse, next)?;
        for (j, column) in last.clone().enumerate() {
            for (i, row) in last.clone().enumerate() {
                self.projected[(row, column)] = 0.5 * (coefficients[(row, j)] + coefficients[(column, i)]);
            }
        }
        self.append(inverse, &block)?;
        for (i, row) in self.last.clone().enumerate() {
            for (j, column) in last.clone().enumerate() {
                self.projected[(row, column)] = rest[(i, j)];
            }
        }
        if self.is_exhausted() {
            // The space is invariant, but need not be all.
            self.drawn += BLOCK;
            self.start(inverse, random_block(inverse.engine, BLOCK, self.drawn))?;
        }
        Ok(())
    }

    /// Appends a block to the basis.
    fn append<E: Engine>(&mut self, inverse: &ShiftedInverse<E>, block: &Mat<f64>) -> Result<()> {
        let after = self.size + block.ncols();
        if after > self.basis.ncols() {
            self.reserve(inverse, after + after / 4)?;
        }
        self.basis.as_mut().subcols_mut(self.size, block.ncols()).copy_from(block);
        self.previous = std::mem::replace(&mut self.last, self.size..after);
        self.size = after;
        Ok(())
    }

    /// Makes a block M-orthonormal to the basis and within itself, by classical Gram-Schmidt done
    /// twice. Linearly dependent directions are dropped.
    fn orthonormalise<E: Engine>(&self, inverse: &ShiftedInverse<E>, block: Mat<f64>) -> Result<Orthonormal> {
        let (engine, basis) = (inverse.engine, self.basis.subcols(0, self.size));
        let columns = block.ncols();
        let mut result = Orthonormal {
            block,
            coefficients: Mat::zeros(self.size, columns),
            rest: Mat::identity(columns, columns),
        };
        for dependent in DEPENDENT {
            let (momenta, squares) = multiply(engine, inverse.mass, &result.block)?;
            let [shares, mut gram] =
                scalar_products(engine, [basis, result.block.as_ref()], momenta.as_ref());
            subtract_product(basis, shares.as_ref(), &mut result.block);
            subtract_product(shares.transpose(), shares.as_ref(), &mut gram);
            let (values, vectors) = eigen(engine, gram.as_ref())?;
            let least = dependent * squares.iter().fold(0.0, |most: f64, square| most.max(*square));
            let first = values.iter().take_while(|value| **value <= least || value.is_nan()).count();
            let kept = columns_of(&vectors, first..values.len());
            let scaled = |power: f64| {
                Mat::from_fn(kept.nrows(), kept.ncols(), |i, j| kept[(i, j)] * values[first + j].powf(power))
            };
            result.coefficients += product(shares.as_ref(), result.rest.as_ref());
            result.rest = product(scaled(0.5).transpose(), result.rest.as_ref());
            result.block = product(result.block.as_ref(), scaled(-0.5).as_ref());
        }
        Ok(result)
    }

    /// Returns the Ritz pairs, and how many of the first have converged. Collective.
    pub fn ritz_pairs<E: Engine>(&self, inverse: &ShiftedInverse<E>) -> Result<RitzPairs> {
        let size = self.size();
        let (values, vectors) = eigen(inverse.engine, self.projected.submatrix(0, 0, size, size))?;
        // The modes below the shift have the negative values of largest magnitude.
        let below = inverse.below.min(size);
        let descending: Vec<usize> = (0..size).rev().collect();
        let order = [&descending[size - below..], &descending[..size - below]].concat();
        let coordinates = Mat::from_fn(size, size, |row, k| vectors[(row, order[k])]);
        let values: Vec<f64> = order.iter().map(|&k| values[k]).collect();
        let coupling = self.projected.submatrix(
            self.last.start,
            self.previous.start,
            self.last.len(),
            self.previous.len(),
        );
        let rest = product(coupling, coordinates.subrows(self.previous.start, self.previous.len()));
        let largest = values.iter().fold(0.0, |most: f64, value| most.max(*value));
        let enough = |(j, value): (usize, &f64)| {
            let bound = rest.col_as_slice(j).iter().map(|x| x * x).sum::<f64>().sqrt();
            // The eigenvalue of K x = lambda M x over its distance from the shift.
            let nearness = (1.0 - inverse.shift * value).abs();
            let tolerance = CONVERGED * value.abs() * (RESOLUTION * nearness).max(1.0);
            (*value > 0.0 || j < below) && bound <= tolerance + ROUNDING * largest
        };
        let converged = values.iter().enumerate().take_while(|pair| enough(*pair)).count();
        let squares = values.iter().map(|value| 1.0 / value - inverse.shift).collect();
        Ok(RitzPairs { squares, converged, coordinates })
    }

    /// Returns the first Ritz vectors, one column per pair.
    pub fn vectors(&self, pairs: &RitzPairs, count: usize) -> Mat<f64> {
        product(self.basis.subcols(0, self.size()), pairs.coordinates.subcols(0, count))
    }
}
