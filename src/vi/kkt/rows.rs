//! Rows of a matrix, with parts of their magnitudes that cost no product.

use crate::kernels::wide::widest;
use crate::linalg::RowCoupling;
use crate::linalg::vectors::largest;
use pulp::Arch;

/// Returns the magnitude against which a row is measured: its own, or `floor` times its scale. A
/// row without any magnitude has no residual either.
#[inline(always)]
pub(super) fn raised(magnitude: f64, floor: f64, scale: f64) -> f64 {
    magnitude.max(floor * scale).max(f64::MIN_POSITIVE)
}

/// Vectors over all rows of which the magnitudes consist.
#[derive(Clone, Copy)]
pub(super) struct RowTerms<'a> {
    pub x: &'a [f64],
    /// Square roots of the diagonal.
    pub scale: &'a [f64],
    /// Coupling of each row to another dof.
    pub couplings: &'a [RowCoupling],
    /// Terms of the right-hand side, of which an empty one is zero.
    pub terms: [&'a [f64]; 2],
}

impl RowTerms<'_> {
    /// Returns the magnitude of a row, which consists of its diagonal entry, its coupling and the
    /// terms of the right-hand side.
    #[inline(always)]
    pub fn magnitude(&self, row: usize) -> f64 {
        let RowTerms { x, scale, couplings, terms } = self;
        let RowCoupling { to, magnitude } = couplings[row];
        let terms: f64 = terms.iter().filter_map(|term| term.get(row)).map(|term| term.abs()).sum();
        scale[row] * (scale[row] * x[row].abs()) + terms + magnitude * x[to as usize].abs()
    }

    /// Subtracts the terms of the right-hand side from the residual, and returns its largest entry
    /// relative to the magnitude of its row, raised to a floor. `work` has one entry per row.
    pub fn compare(&self, floor: f64, residual: &mut [f64], work: &mut [f64]) -> f64 {
        let RowTerms { x, scale, couplings, terms } = *self;
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for (m, coupling) in work.iter_mut().zip(couplings) {
                    *m = coupling.magnitude * x[coupling.to as usize].abs();
                }
                for term in terms {
                    for ((r, m), b) in residual.iter_mut().zip(&mut *work).zip(term) {
                        *r -= b;
                        *m += b.abs();
                    }
                }
                let rows = residual.iter().zip(&*work).zip(x.iter().zip(scale));
                largest(rows.map(
                    #[inline(always)]
                    |((r, m), (x, scale))| r / raised(m + scale * (scale * x.abs()), floor, *scale),
                ))
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::number;

    /// Rows one by one have the same largest ratio, and a NaN is found wherever it stands.
    #[test]
    fn rows_are_compared_with_their_magnitudes() {
        let rows = 17;
        let vector = |seed: usize| (0..rows).map(|row| number(seed + row)).collect::<Vec<f64>>();
        let coupling = |row: usize| match row % 3 {
            0 => RowCoupling::default(),
            in_node => RowCoupling { to: (row - in_node) as u32, magnitude: 2.0 + number(row) },
        };
        let couplings: Vec<RowCoupling> = (0..rows).map(coupling).collect();
        let (x, rhs, more) = (vector(100), vector(300), vector(500));
        let scale: Vec<f64> = vector(700).iter().map(|entry| 1.5 + entry).collect();
        for term in [&[][..], &more] {
            let terms = RowTerms { x: &x, scale: &scale, couplings: &couplings, terms: [&rhs, term] };
            let ratio = |row: usize| {
                let RowCoupling { to, magnitude } = couplings[row];
                let b = [rhs[row], term.get(row).copied().unwrap_or(0.0)];
                let whole = scale[row].powi(2) * x[row].abs() + magnitude * x[to as usize].abs();
                let whole = whole + b[0].abs() + b[1].abs();
                (vector(900)[row] - b[0] - b[1]).abs() / whole.max(2.0 * scale[row])
            };
            let largest = (0..rows).map(ratio).fold(0.0, f64::max);
            assert!((terms.compare(2.0, &mut vector(900), &mut vector(0)) / largest - 1.0).abs() < 1e-14);
            for row in 0..rows {
                let mut product = vector(900);
                product[row] = f64::NAN;
                assert!(terms.compare(2.0, &mut product, &mut vector(0)).is_nan(), "{row}");
            }
        }
    }
}
