//! Energy of stretching in modes.
//!
//! The strain of w = sum q_i phi_i is a quadratic form of the modal coordinates q, once the
//! displacement in the plane follows each pair of modes. Its energy is a quartic form,
//!
//! ```math
//! V = \tfrac12 \sum_k s_k^2, \qquad s_k = q^T H_k\, q, \qquad \nabla V = 2 \sum_k s_k H_k\, q .
//! ```
//!
//! Forces in the plane that buckle the plate add their geometric energy `$\tfrac12 q^T G q$`. The
//! energy of bending and V together then count from their least value.
//!
//! The matrices H_k are the principal directions of the weighted strains of all pairs, each pair
//! scaled to modes of equal energy. Directions of less than a millionth of the largest are left
//! out.

use super::{Membrane, MembraneCell, StrainPoint};
use crate::error::Result;
use crate::kernels::wide::widest;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::{axpy, dot, scale};
use faer::{ColRef, Mat, MatRef, Scale};
use nalgebra::Vector3;
use pulp::Arch;
use serde::{Deserialize, Serialize};

/// Singular value below which a direction is left out, relative to the largest.
const LEAST: f64 = 1e-6;

/// Number of cells whose strains are kept at once.
const CELLS: usize = 64;

/// Energy of stretching as a quartic form of modal coordinates, `$V = \tfrac12 \sum_k (q^T H_k\, q)^2$`.
#[derive(Debug, Clone, PartialEq)]
pub struct QuarticForm {
    modes: usize,
    /// Matrices H_k, one after the other, symmetric, in the root of J per square of a coordinate.
    forms: Vec<f64>,
    /// Geometric stiffness G of forces that buckle the plate, in 1/s^2, by columns; empty without.
    geometric: Vec<f64>,
    /// Energy that counts as zero, in J.
    least: f64,
}

/// Values of a [`QuarticForm`] at a position.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Stretch {
    /// Strains s_k, in the root of J.
    strains: Vec<f64>,
    /// Products H_k q, one after the other.
    products: Vec<f64>,
    /// Product G q; empty without.
    pull: Vec<f64>,
    /// Geometric energy, less the one that counts as zero, in J.
    geometric: f64,
}

impl QuarticForm {
    /// Returns the form for modes with squared frequencies ((rad/s)^2), given by their deflections
    /// and slopes at all nodes, three per node.
    ///
    /// # Errors
    /// Returns the errors of the factor of the membrane.
    pub fn new(membrane: &mut Membrane, shapes: &[Vec<f64>], squares: &[f64]) -> Result<QuarticForm> {
        let modes = shapes.len();
        let pairs: Vec<[usize; 2]> = (0..modes).flat_map(|i| (i..modes).map(move |j| [i, j])).collect();
        let mut displacements = Mat::zeros(membrane.dofs, pairs.len());
        for cell in &membrane.cells {
            let slopes: Vec<_> = shapes.iter().map(|shape| cell.slopes(shape)).collect();
            for (p, &pair) in pairs.iter().enumerate() {
                let strains = cell.pair_strains(&slopes, pair);
                cell.add_force(&cell.points, &strains, displacements.col_as_slice_mut(p));
            }
        }
        membrane.solver.solve_columns(&mut displacements)?;
        let mut gram = Mat::zeros(pairs.len(), pairs.len());
        for cells in membrane.cells.chunks(CELLS) {
            let strains = strains(cells, shapes, &pairs, &displacements);
            gram += strains.transpose() * &strains;
        }
        let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
        let scale = |i: usize| 1.0 / squares[i].max(lowest).sqrt();
        let scales: Vec<f64> = pairs.iter().map(|&[i, j]| scale(i) * scale(j)).collect();
        let scaled = Mat::from_fn(pairs.len(), pairs.len(), |a, b| scales[a] * scales[b] * gram[(a, b)]);
        let (values, vectors) = symmetric_eigen(scaled.as_ref())?;
        let largest = values.last().copied().unwrap_or(0.0);
        let mut forms = Vec::new();
        for k in (0..values.len()).rev().filter(|&k| values[k] > LEAST * LEAST * largest) {
            let mut form = vec![0.0; modes * modes];
            for (p, &[i, j]) in pairs.iter().enumerate() {
                let coefficient = values[k].sqrt() * vectors[(p, k)] / scales[p];
                // A pair of two modes stands for both orders.
                form[i * modes + j] += 0.5 * coefficient;
                form[j * modes + i] += 0.5 * coefficient;
            }
            forms.extend(form);
        }
        Ok(QuarticForm { modes, forms, geometric: Vec::new(), least: 0.0 })
    }

    /// Adds the geometric stiffness of forces that buckle the plate, in 1/s^2.
    pub fn add_geometric(&mut self, stiffness: &Mat<f64>) {
        self.geometric = (0..self.modes).flat_map(|j| stiffness.col_as_slice(j).to_vec()).collect();
    }

    /// Counts energies from a value, in J.
    pub fn count_from(&mut self, least: f64) {
        self.least = least;
    }

    /// Returns the energy of the flat plate above the buckled one, in J; 0 for a plate that does
    /// not buckle.
    pub fn depth(&self) -> f64 {
        -self.least
    }

    /// Returns whether forces in the plane buckle the plate.
    pub fn is_buckled(&self) -> bool {
        !self.geometric.is_empty()
    }

    /// Evaluates the form at a position.
    pub fn evaluate(&self, q: &[f64], stretch: &mut Stretch) {
        let Stretch { strains, products, pull, geometric } = stretch;
        pull.clear();
        if self.is_buckled() {
            pull.resize(self.modes, 0.0);
            let columns = self.geometric.chunks_exact(self.modes);
            columns.zip(q).for_each(|(column, q)| axpy(*q, column, pull));
        }
        *geometric = 0.5 * dot(pull, &q[..pull.len()]) - self.least;
        products.resize(self.forms.len() / self.modes, 0.0);
        strains.resize(products.len() / self.modes, 0.0);
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                let size = self.modes;
                for k in 0..strains.len() {
                    let product = &mut products[k * size..(k + 1) * size];
                    product.fill(0.0);
                    for j in 0..size {
                        let first = (k * size + j) * size;
                        let (factor, column) = (q[j], &self.forms[first..first + size]);
                        for i in 0..size {
                            product[i] += factor * column[i];
                        }
                    }
                    let mut strain = 0.0;
                    for i in 0..size {
                        strain += product[i] * q[i];
                    }
                    strains[k] = strain;
                }
            },
        );
    }

    /// Moves an evaluation to q, `gamma` of the way from another one: the products with q are
    /// linear, and need no product of matrices.
    pub fn interpolate(&self, q: &[f64], gamma: f64, from: &Stretch, to: &mut Stretch) {
        for (to, from) in [(&mut to.products, &from.products), (&mut to.pull, &from.pull)] {
            scale(gamma, to);
            axpy(1.0 - gamma, from, to);
        }
        to.geometric = 0.5 * dot(&to.pull, &q[..to.pull.len()]) - self.least;
        let products = to.products.chunks_exact(self.modes);
        to.strains.iter_mut().zip(products).for_each(|(strain, product)| *strain = dot(product, q));
    }

    /// Returns the Hessian of V at an evaluated position, in 1/s^2.
    pub fn hessian(&self, stretch: &Stretch) -> Mat<f64> {
        let (size, rank) = (self.modes, stretch.strains.len());
        let products = MatRef::from_column_major_slice(&stretch.products, size, rank);
        let mut hessian = (products * products.transpose()) * Scale(4.0);
        let forms = MatRef::from_column_major_slice(&self.forms, size * size, rank);
        let bent = forms * ColRef::from_slice(&stretch.strains);
        for j in 0..size {
            let column = hessian.col_as_slice_mut(j);
            column.iter_mut().enumerate().for_each(|(i, entry)| *entry += 2.0 * bent[j * size + i]);
        }
        for (j, column) in self.geometric.chunks_exact(self.modes).enumerate() {
            axpy(1.0, column, hessian.col_as_slice_mut(j));
        }
        hessian
    }
}

impl Stretch {
    /// Returns the sum of the squares of all strains s_k, in J.
    pub fn strain_square(&self) -> f64 {
        self.strains.iter().map(|strain| strain * strain).sum()
    }

    /// Returns the energy V, in J.
    pub fn energy(&self) -> f64 {
        0.5 * self.strain_square() + self.geometric
    }

    /// Returns the sum of the magnitudes of the energies of strain and of the forces in the plane,
    /// in J.
    pub fn size(&self) -> f64 {
        0.5 * self.strain_square() + self.geometric.abs()
    }

    /// Adds a multiple of the gradient of V to `y`.
    pub fn add_gradient(&self, factor: f64, y: &mut [f64]) {
        if !self.pull.is_empty() {
            axpy(factor, &self.pull, y);
        }
        let size = y.len();
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for (k, s) in self.strains.iter().enumerate() {
                    let (weight, product) = (2.0 * factor * s, &self.products[k * size..(k + 1) * size]);
                    for i in 0..size {
                        y[i] += weight * product[i];
                    }
                }
            },
        );
    }

    /// Returns the coefficients of 1, gamma, ..., gamma^4 of V on the line from this position by
    /// gamma times an increment, in J; `end` has the values at gamma = 1.
    pub fn along(&self, increment: &[f64], end: &Stretch) -> [f64; 5] {
        let first = dot(&self.pull, &increment[..self.pull.len()]);
        let mut sum = [self.geometric, first, end.geometric - self.geometric - first, 0.0, 0.0];
        let products = self.products.chunks_exact(increment.len().max(1));
        for ((a, last), product) in self.strains.iter().zip(&end.strains).zip(products) {
            let b =
                2.0 * product.iter().zip(increment).map(|(product, change)| product * change).sum::<f64>();
            let c = last - a - b;
            let terms = [0.5 * a * a, a * b, 0.5 * b * b + a * c, b * c, 0.5 * c * c];
            sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
        }
        sum
    }
}

impl MembraneCell {
    /// Returns the weighted strains at the points by the slopes of a pair of modes, both orders of
    /// two different modes, given the slopes of all modes.
    fn pair_strains(&self, slopes: &[Vec<[f64; 2]>], [i, j]: [usize; 2]) -> Vec<Vector3<f64>> {
        let share = if i == j { 0.5 } else { 1.0 };
        let strain = |(point, ([ax, ay], [bx, by])): (&StrainPoint, (&[f64; 2], &[f64; 2]))| {
            point.weighted([ax * bx, 0.5 * (ax * by + ay * bx), ay * by]) * share
        };
        self.points.iter().zip(slopes[i].iter().zip(&slopes[j])).map(strain).collect()
    }
}

/// Returns the weighted strains of all pairs in some cells: three rows per point, a column per
/// pair.
fn strains(
    cells: &[MembraneCell],
    shapes: &[Vec<f64>],
    pairs: &[[usize; 2]],
    displacements: &Mat<f64>,
) -> Mat<f64> {
    let rows = cells.iter().map(|cell| 3 * cell.points.len()).sum();
    let mut result = Mat::zeros(rows, pairs.len());
    let mut first = 0;
    for cell in cells {
        let slopes: Vec<_> = shapes.iter().map(|shape| cell.slopes(shape)).collect();
        for (p, &pair) in pairs.iter().enumerate() {
            let local = cell.local(displacements.col_as_slice(p));
            let of_slopes = cell.pair_strains(&slopes, pair);
            let column = result.col_as_slice_mut(p);
            for (k, (point, of_slopes)) in cell.points.iter().zip(&of_slopes).enumerate() {
                let strain = point.weighted_strain(&local) + of_slopes;
                column[first + 3 * k..first + 3 * (k + 1)].copy_from_slice(strain.as_slice());
            }
        }
        first += 3 * cell.points.len();
    }
    result
}
