//! Cholesky factorisation in double-double arithmetic, for matrices too ill-conditioned for
//! doubles.
//!
//! The condition number of the factor L is the square root of that of A, so that rounding L at the
//! end costs half as many digits as rounding A. Rounding A itself, or anything on the way, may take
//! all stiffness from a slow motion.

use super::cholesky::Supernode;
use pulp::{Simd, WithSimd};
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number as the unevaluated sum of two doubles, the lower one below the rounding of the higher:
/// about 32 decimal digits.
///
/// Sources: T. J. Dekker, *A floating-point technique for extending the available precision*, 1971;
/// D. E. Knuth, *The Art of Computer Programming 2*, section 4.2.2.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct DoubleDouble {
    high: f64,
    low: f64,
}

impl DoubleDouble {
    /// Returns the sum of a number and a much smaller one.
    #[inline(always)]
    fn new(high: f64, low: f64) -> DoubleDouble {
        let sum = high + low;
        DoubleDouble { high: sum, low: low - (sum - high) }
    }

    /// Returns a b exactly.
    #[inline(always)]
    pub fn product(a: f64, b: f64) -> DoubleDouble {
        let high = a * b;
        DoubleDouble { high, low: a.mul_add(b, -high) }
    }

    /// Returns the nearest double.
    #[inline(always)]
    pub fn round(self) -> f64 {
        self.high
    }

    #[inline(always)]
    fn sqrt(self) -> DoubleDouble {
        let root = self.high.sqrt();
        DoubleDouble::new(root, 0.5 * (self - DoubleDouble::product(root, root)).high / root)
    }
}

impl From<f64> for DoubleDouble {
    fn from(high: f64) -> DoubleDouble {
        DoubleDouble { high, low: 0.0 }
    }
}

impl Add for DoubleDouble {
    type Output = DoubleDouble;

    #[inline(always)]
    fn add(self, other: DoubleDouble) -> DoubleDouble {
        let sum = self.high + other.high;
        let part = sum - self.high;
        let rest = (self.high - (sum - part)) + (other.high - part);
        DoubleDouble::new(sum, rest + (self.low + other.low))
    }
}

impl Neg for DoubleDouble {
    type Output = DoubleDouble;

    #[inline(always)]
    fn neg(self) -> DoubleDouble {
        DoubleDouble { high: -self.high, low: -self.low }
    }
}

impl Sub for DoubleDouble {
    type Output = DoubleDouble;

    #[inline(always)]
    fn sub(self, other: DoubleDouble) -> DoubleDouble {
        self + -other
    }
}

impl Mul for DoubleDouble {
    type Output = DoubleDouble;

    #[inline(always)]
    fn mul(self, other: DoubleDouble) -> DoubleDouble {
        let DoubleDouble { high, low } = DoubleDouble::product(self.high, other.high);
        DoubleDouble::new(high, low + (self.high * other.low + self.low * other.high))
    }
}

impl Div for DoubleDouble {
    type Output = DoubleDouble;

    #[inline(always)]
    fn div(self, other: DoubleDouble) -> DoubleDouble {
        let ratio = self.high / other.high;
        DoubleDouble::new(ratio, (self - other * ratio.into()).high / other.high)
    }
}

impl Sum for DoubleDouble {
    fn sum<I: Iterator<Item = DoubleDouble>>(terms: I) -> DoubleDouble {
        terms.fold(DoubleDouble::default(), Add::add)
    }
}

/// Factors the panels of a matrix in place and returns whether it is positive definite.
pub(super) struct Factor<'a> {
    pub supernodes: &'a [Supernode],
    pub patterns: &'a [u32],
    /// Supernode of each position.
    pub owner: &'a [u32],
    pub values: &'a mut [DoubleDouble],
}

impl WithSimd for Factor<'_> {
    type Output = bool;

    /// Dispatches the loops below without intrinsics: the widest registers come with the fused
    /// multiply-add that exact products need.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let Factor { supernodes, patterns, owner, values } = self;
        let mut row_of = vec![0; owner.len()];
        let mut update = Vec::new();
        for s in supernodes {
            let (width, height) = (s.end - s.start, s.end - s.start + s.rows);
            if !factor_panel(&mut values[s.values..][..width * height], width, height) {
                return false;
            }
            // The update that each row below takes from the panel goes into that row's own column.
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
                update.clear();
                update.resize(s.rows, DoubleDouble::default());
                for panel in values[s.values..][..width * height].chunks_exact(height) {
                    let factor = -panel[width + k];
                    for (sum, entry) in update.iter_mut().zip(&panel[width..]) {
                        *sum = *sum + *entry * factor;
                    }
                }
                let tall = target.end - target.start + target.rows;
                let values = &mut values[target.values + (column as usize - target.start) * tall..][..tall];
                for (&row, sum) in pattern.iter().zip(&update).filter(|(row, _)| **row >= column) {
                    let entry = &mut values[row_of[row as usize]];
                    *entry = *entry + *sum;
                }
            }
        }
        true
    }
}

/// Factors the columns of one panel among themselves and returns whether all pivots are positive.
#[inline(always)]
fn factor_panel(panel: &mut [DoubleDouble], width: usize, height: usize) -> bool {
    for j in 0..width {
        let (done, rest) = panel.split_at_mut((j + 1) * height);
        let column = &mut done[j * height..];
        let pivot = column[j];
        if !(pivot.high > 0.0 && pivot.high.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        column[j] = root;
        for entry in &mut column[j + 1..] {
            *entry = *entry / root;
        }
        for (k, other) in rest.chunks_exact_mut(height).take(width - 1 - j).enumerate() {
            let first = j + 1 + k;
            let factor = -column[first];
            for (sum, entry) in other[first..].iter_mut().zip(&column[first..]) {
                *sum = *sum + *entry * factor;
            }
        }
    }
    true
}
