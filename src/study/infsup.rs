//! Inf-sup constant between reactions and massless deflections.
//!
//! With the singular mass, the motion and the reactions are unique if the following holds for some
//! beta > 0 (section 3 of the paper):
//!
//! ```math
//! \inf_Q \sup_{W \in \ker B} \frac{Q \cdot G W}{|Q| \, |W|} \ge \beta .
//! ```
//!
//! Two choices of norms are computed:
//!
//! - *raw*: Euclidean norms of the dofs, m and rad alike. The constant is the smallest singular
//!   value of G on ker B, as in the paper. It shrinks as h^2 on quadrilaterals, faster on
//!   triangles, and depends on the units.
//! - *energy*: `$|W|_K = \sqrt{W^T K W}$` and the dual norm
//!   `$|Q|_* = \sup_{W \in V^h} Q \cdot G W / |W|_K$`. The constant has no unit and lies between 0
//!   and 1: it measures by how much the constraint B W = 0 stiffens the response of G.
//!
//! Both are one computation. With the bounded dofs g separated from the rest s, let E(g) be the
//! least `$|W|^2$` with G W = g, and H g the momentum B W of that minimiser. Cancelling H g by s
//! alone adds `$H^T (B_s K_{ss}^{-1} B_s^T)^{-1} H$`, so that
//!
//! ```math
//! \beta^{-2} = 1 + \lambda_{\max}\bigl(H^T (B_s K_{ss}^{-1} B_s^T)^{-1} H, \; E\bigr),
//! ```
//!
//! with K = 1 (E = 1, H = B_g) for the raw constant. This formula has no cancellation, however
//! small beta is. Where H g is outside the range of B_s, beta is 0.

use crate::error::Result;
use crate::linalg::{Cholesky, Factor, Form, SingularMassCell};
use crate::modes::lanczos;
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Mat, Par, Side};
use serde::Serialize;
use std::collections::BTreeMap;

/// Largest number of dofs for dense matrices, whose rank of B_s comes from a pivoted QR
/// factorisation.
///
/// Above it, only the raw constant is computed, and only where B_s B_s^T is safely regular.
pub const DENSE_LIMIT: usize = 1500;

/// Ratio of a pivot of B_s to the first, below which the pivot counts as zero.
const RANK: f64 = 1e-12;

/// Largest relative part of H outside the range of B_s that counts as rounding.
const REACH: f64 = 1e-9;

/// Smallest eigenvalue of B_s B_s^T, with rows of B of unit length, at which its rank is certain.
///
/// The relative error of the constant is about 1e-16 divided by that eigenvalue.
const REGULAR: f64 = 1e-13;

/// Limit on Lanczos steps for large meshes, and their relative tolerance.
const STEPS: usize = 400;
const TOLERANCE: f64 = 1e-9;

/// Inf-sup constants; `None` where they were not computed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct InfSup {
    /// Constant in Euclidean norms of the dofs.
    pub raw: Option<f64>,
    /// Constant in energy norms, dimensionless; also `None` where K is singular.
    pub energy: Option<f64>,
}

/// Computes the constants of some bounded dofs (the rows of G), of a stiffness and the rows of B.
///
/// `mechanism` says that K is singular.
///
/// # Errors
/// Returns an error where a factorisation lacks memory.
pub fn constants(
    dofs: usize,
    stiffness: &Form,
    mechanism: bool,
    rows: &[SingularMassCell],
    bounded: &[usize],
) -> Result<InfSup> {
    let split = Split::new(dofs, rows, bounded);
    if bounded.is_empty() {
        return Ok(InfSup { raw: None, energy: None });
    }
    if dofs > DENSE_LIMIT {
        return Ok(InfSup { raw: split.raw_sparse()?, energy: None });
    }
    let raw = split.dense(None);
    if mechanism {
        return Ok(InfSup { raw, energy: None });
    }
    let mut matrix = Mat::zeros(dofs, dofs);
    stiffness.for_each_lower(|i, j, entry| {
        let (i, j) = (split.place[i], split.place[j]);
        matrix[(i, j)] += entry;
        if i != j {
            matrix[(j, i)] += entry;
        }
    });
    Ok(InfSup { raw, energy: split.dense(Some(&matrix)) })
}

/// Raw constant below which the condition fails, because reactions are lost in rounding errors.
const FAILS: f64 = 1e-10;

/// Returns whether the raw constant of some bounded dofs is lost in rounding errors.
///
/// On a large mesh where the rank of B_s is uncertain, the condition counts as satisfied.
pub fn fails(dofs: usize, rows: &[SingularMassCell], bounded: &[usize]) -> bool {
    let split = Split::new(dofs, rows, bounded);
    let raw = match split.raw_sparse() {
        Ok(Some(raw)) => Some(raw),
        _ if dofs <= DENSE_LIMIT => split.dense(None),
        _ => None,
    };
    raw.is_some_and(|raw| raw < FAILS)
}

/// Matrix B with rows of unit length and columns in two groups: the rest s, then the bounded g.
struct Split {
    /// Column of each dof, with those of s first.
    place: Vec<usize>,
    rest: usize,
    bounded: usize,
    /// Entries (column, value) of each row.
    rows: Vec<Vec<(usize, f64)>>,
}

impl Split {
    fn new(dofs: usize, rows: &[SingularMassCell], bounded: &[usize]) -> Split {
        let rest = dofs - bounded.len();
        let mut place = vec![usize::MAX; dofs];
        for (i, &dof) in bounded.iter().enumerate() {
            place[dof] = rest + i;
        }
        place.iter_mut().filter(|place| **place == usize::MAX).enumerate().for_each(|(i, place)| *place = i);
        let unit = |row: &SingularMassCell| -> Vec<(usize, f64)> {
            let free =
                || row.dofs.iter().zip(row.row.iter()).filter_map(|(dof, value)| Some(((*dof)?, *value)));
            let length = free().map(|(_, value)| value * value).sum::<f64>().sqrt();
            free().filter(|_| length > 0.0).map(|(dof, value)| (place[dof], value / length)).collect()
        };
        let rows = rows.iter().map(unit).filter(|row| !row.is_empty()).collect();
        Split { place, rest, bounded: bounded.len(), rows }
    }

    /// Computes the constant in the norm of K (in the order of columns), or in the Euclidean norm.
    ///
    /// The result is `None` where K cannot be factored.
    fn dense(&self, stiffness: Option<&Mat<f64>>) -> Option<f64> {
        let (rest, bounded, cells) = (self.rest, self.bounded, self.rows.len());
        // This is B^T, with s above g.
        let mut b = Mat::zeros(rest + bounded, cells);
        for (cell, row) in self.rows.iter().enumerate() {
            for &(place, value) in row {
                b[(place, cell)] += value;
            }
        }
        if let Some(stiffness) = stiffness {
            // K = L L^T with s first: L^-1 B^T holds L_ss^-1 B_s^T above and L_E^-1 H^T below,
            // where E = L_E L_E^T.
            let factor = stiffness.llt(Side::Lower).ok()?;
            solve_lower_triangular_in_place(factor.L(), b.as_mut(), Par::Seq);
        }
        let (reaching, target) = b.as_ref().split_at_row(rest);
        if cells == 0 {
            return Some(1.0);
        }
        if rest == 0 {
            return Some(0.0);
        }
        // B_s^T P = Q R, hence (B_s B_s^T)^-1 = P (R^T R)^-1 P^T.
        let qr = reaching.col_piv_qr();
        let r = qr.thin_R();
        let places = qr.P().arrays().0;
        let pivots = r.nrows().min(cells);
        let rank = (0..pivots).take_while(|&i| r[(i, i)].abs() > RANK * r[(0, 0)].abs()).count();
        // X = R^-T P^T H, with one column per bounded dof.
        let mut excess = Mat::from_fn(rank, bounded, |i, g| target[(g, places[i])]);
        let leading = r.submatrix(0, 0, rank, rank);
        solve_lower_triangular_in_place(leading.transpose(), excess.as_mut(), Par::Seq);
        if rank < cells {
            let reached = r.submatrix(0, rank, rank, cells - rank).transpose() * &excess;
            let missed = Mat::from_fn(cells - rank, bounded, |i, g| target[(g, places[rank + i])]) - reached;
            if missed.norm_max() > REACH * target.norm_max() {
                return Some(0.0);
            }
        }
        let largest = excess.singular_values().ok()?.first().copied().unwrap_or(0.0);
        Some(1.0 / 1.0_f64.hypot(largest))
    }

    /// Computes the raw constant from the sparse B_s B_s^T; `None` where that is not safely
    /// regular.
    fn raw_sparse(&self) -> Result<Option<f64>> {
        let cells = self.rows.len();
        let mut columns: BTreeMap<usize, Vec<(usize, f64)>> = BTreeMap::new();
        for (cell, row) in self.rows.iter().enumerate() {
            for &(place, value) in row.iter().filter(|(place, _)| *place < self.rest) {
                columns.entry(place).or_default().push((cell, value));
            }
        }
        let mut triplets = Vec::new();
        for column in columns.values() {
            for &(i, a) in column {
                for &(j, b) in column.iter().filter(|(j, _)| *j <= i) {
                    triplets.push(Triplet::new(i, j, a * b));
                }
            }
        }
        let Ok(matrix) = SparseColMat::try_new_from_triplets(cells, cells, &triplets) else {
            return Ok(None);
        };
        let Ok(mut factor) = Cholesky::new(matrix, &[]) else { return Ok(None) };
        let euclid = |x: &[f64], y: &mut [f64]| {
            y.copy_from_slice(x);
            Ok(())
        };
        let inverse = |x: &[f64], y: &mut [f64]| {
            y.copy_from_slice(x);
            factor.solve(y)
        };
        if lanczos::largest(cells, (STEPS, 0.1), f64::INFINITY, inverse, euclid)? > 1.0 / REGULAR {
            return Ok(None);
        }
        let mut p = vec![0.0; cells];
        let bounded = |row: &Vec<(usize, f64)>| -> Vec<(usize, f64)> {
            row.iter().filter(|(place, _)| *place >= self.rest).map(|&(g, b)| (g - self.rest, b)).collect()
        };
        let rows: Vec<_> = self.rows.iter().map(bounded).collect();
        let excess = |g: &[f64], result: &mut [f64]| {
            for (p, row) in p.iter_mut().zip(&rows) {
                *p = row.iter().map(|&(i, b)| b * g[i]).sum();
            }
            factor.solve(&mut p)?;
            result.fill(0.0);
            for (p, row) in p.iter().zip(&rows) {
                row.iter().for_each(|&(i, b)| result[i] += b * p);
            }
            Ok(())
        };
        let largest = lanczos::largest(self.bounded, (STEPS, TOLERANCE), f64::INFINITY, excess, euclid)?;
        Ok(Some(1.0 / (1.0 + largest).sqrt()))
    }
}
