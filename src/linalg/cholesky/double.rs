//! Cholesky factorisation in double-double arithmetic, for matrices too ill-conditioned for
//! doubles.
//!
//! The condition number of A is the square of the condition number of its factor L, so that
//! rounding L at the end costs half as many digits as rounding A. Rounding A itself, or anything on
//! the way, may take all stiffness from a slow motion.
//!
//! The higher and the lower doubles of the entries lie in two arrays, so that whole registers of
//! each are multiplied.

use super::supernodes::Supernode;
use crate::kernels::double_double::DoubleDouble;
use pulp::{Simd, WithSimd};

/// Number of registers of rows whose products are summed at a time: sums that do not wait for each
/// other.
const REGISTERS: usize = 4;

/// Factors the panels of a matrix in place and returns whether it is positive definite.
pub(super) struct PanelFactorisation<'a> {
    pub supernodes: &'a [Supernode],
    pub patterns: &'a [u32],
    /// Supernode of each position.
    pub owner: &'a [u32],
    /// Higher doubles of the entries, which become the rounded entries of L.
    pub high: &'a mut [f64],
    /// Lower doubles of the entries.
    pub low: &'a mut [f64],
}

impl WithSimd for PanelFactorisation<'_> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let PanelFactorisation { supernodes, patterns, owner, high, low } = self;
        let mut row_of = vec![0; owner.len()];
        let mut products = Products::default();
        for s in supernodes {
            let (width, height) = (s.end - s.start, s.end - s.start + s.rows);
            let panel = s.values..s.values + width * height;
            let columns = (&mut high[panel.clone()], &mut low[panel.clone()]);
            if !factor_panel(simd, columns, (width, height), &mut products) {
                return false;
            }
            // The products of each row below the panel with itself and the rows after it are
            // subtracted from that row's own column.
            let pattern = &patterns[s.pattern..][..s.rows];
            let mut last = None;
            for (k, &column) in pattern.iter().enumerate() {
                let target = supernodes[owner[column as usize] as usize];
                if last.replace(target.start) != Some(target.start) {
                    let below = patterns[target.pattern..][..target.rows].iter().map(|&row| row as usize);
                    for (row, place) in (target.start..target.end).chain(below).enumerate() {
                        row_of[place] = row;
                    }
                }
                let columns = Columns { high: &high[panel.clone()], low: &low[panel.clone()], height };
                products.sum(simd, columns, width + k);
                let tall = target.end - target.start + target.rows;
                let start = target.values + (column as usize - target.start) * tall;
                let sums = products.high.iter().zip(&products.low);
                for (&row, (more, less)) in pattern[k..].iter().zip(sums) {
                    let place = start + row_of[row as usize];
                    let entry = DoubleDouble::sum(high[place], -more);
                    high[place] = entry.high;
                    low[place] += entry.low - less;
                }
            }
        }
        true
    }
}

/// Factors the columns of one panel among themselves and returns whether all pivots are positive.
#[inline(always)]
fn factor_panel<S: Simd>(
    simd: S,
    (high, low): (&mut [f64], &mut [f64]),
    (width, height): (usize, usize),
    products: &mut Products,
) -> bool {
    for j in 0..width {
        let (done, high) = high.split_at_mut(j * height);
        let (done_low, low) = low.split_at_mut(j * height);
        products.sum(simd, Columns { high: done, low: done_low, height }, j);
        let entries = high[j..height].iter_mut().zip(&mut low[j..height]);
        let mut root = DoubleDouble::default();
        for (i, ((high, low), sums)) in entries.zip(products.high.iter().zip(&products.low)).enumerate() {
            let entry = DoubleDouble::sum(*high, -sums.0);
            let mut entry = DoubleDouble::sum(entry.high, entry.low + (*low - sums.1));
            if i > 0 {
                entry = entry / root;
            } else {
                if !(entry.high > 0.0 && entry.high.is_finite()) {
                    return false;
                }
                entry = entry.sqrt();
                root = entry;
            }
            (*high, *low) = (entry.high, entry.low);
        }
    }
    true
}

/// Columns of a panel, one after the other.
#[derive(Clone, Copy)]
struct Columns<'a> {
    high: &'a [f64],
    low: &'a [f64],
    height: usize,
}

/// Products of a row of a panel with itself and all rows below it, summed over columns.
#[derive(Debug, Default)]
struct Products {
    high: Vec<f64>,
    low: Vec<f64>,
}

impl Products {
    /// Computes the products of row `first`.
    #[inline(always)]
    fn sum<S: Simd>(&mut self, simd: S, columns: Columns, first: usize) {
        self.high.resize(columns.height - first, 0.0);
        self.low.resize(columns.height - first, 0.0);
        let mut row = first;
        while row + REGISTERS * S::F64_LANES <= columns.height {
            self.sum_rows::<S, REGISTERS>(simd, columns, first, row);
            row += REGISTERS * S::F64_LANES;
        }
        while row < columns.height {
            self.sum_rows::<S, 1>(simd, columns, first, row);
            row += S::F64_LANES;
        }
    }

    /// Computes the products with N registers of rows from `row` on.
    #[inline(always)]
    fn sum_rows<S: Simd, const N: usize>(&mut self, simd: S, columns: Columns, first: usize, row: usize) {
        let Columns { high, low, height } = columns;
        let rows = |i: usize| row + i * S::F64_LANES..(row + (i + 1) * S::F64_LANES).min(height);
        let mut sums = [(simd.splat_f64s(0.0), simd.splat_f64s(0.0)); N];
        for (high, low) in high.chunks_exact(height).zip(low.chunks_exact(height)) {
            let b = (simd.splat_f64s(high[first]), simd.splat_f64s(low[first]));
            for (i, sum) in sums.iter_mut().enumerate() {
                let a = (simd.partial_load_f64s(&high[rows(i)]), simd.partial_load_f64s(&low[rows(i)]));
                *sum = add_product(simd, *sum, a, b);
            }
        }
        for (i, (sum, rest)) in sums.into_iter().enumerate() {
            let rows = rows(i).start - first..rows(i).end - first;
            simd.partial_store_f64s(&mut self.high[rows.clone()], sum);
            simd.partial_store_f64s(&mut self.low[rows], rest);
        }
    }
}

/// Adds a product to a sum, both as higher and lower doubles. The lower one of the sum collects all
/// roundings of the higher one, and may become larger than one of them.
#[inline(always)]
fn add_product<S: Simd>(
    simd: S,
    (sum, rest): (S::f64s, S::f64s),
    (a, a_low): (S::f64s, S::f64s),
    (b, b_low): (S::f64s, S::f64s),
) -> (S::f64s, S::f64s) {
    let product = simd.mul_f64s(a, b);
    let lost = simd.mul_add_f64s(a, b, simd.neg_f64s(product));
    let lost = simd.mul_add_f64s(a_low, b, simd.mul_add_f64s(a, b_low, lost));
    let total = simd.add_f64s(sum, product);
    let part = simd.sub_f64s(total, sum);
    let rounded = simd.add_f64s(simd.sub_f64s(sum, simd.sub_f64s(total, part)), simd.sub_f64s(product, part));
    (total, simd.add_f64s(rest, simd.add_f64s(rounded, lost)))
}
