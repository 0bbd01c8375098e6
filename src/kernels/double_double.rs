//! Double-double arithmetic: numbers of about 32 decimal digits.

use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Number as the unevaluated sum of two doubles, the lower one below the rounding of the higher:
/// about 32 decimal digits.
///
/// Sources: T. J. Dekker, *A floating-point technique for extending the available precision*, 1971;
/// D. E. Knuth, *The Art of Computer Programming 2*, section 4.2.2.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct DoubleDouble {
    /// The nearest double, and what it leaves.
    pub high: f64,
    pub low: f64,
}

impl DoubleDouble {
    /// Returns the sum of a number and a much smaller one.
    #[inline(always)]
    pub fn new(high: f64, low: f64) -> DoubleDouble {
        let sum = high + low;
        DoubleDouble { high: sum, low: low - (sum - high) }
    }

    /// Returns a b exactly.
    #[inline(always)]
    pub fn product(a: f64, b: f64) -> DoubleDouble {
        let high = a * b;
        DoubleDouble { high, low: a.mul_add(b, -high) }
    }

    /// Returns a + b exactly.
    #[inline(always)]
    pub fn sum(a: f64, b: f64) -> DoubleDouble {
        let high = a + b;
        let part = high - a;
        DoubleDouble { high, low: (a - (high - part)) + (b - part) }
    }

    /// Returns the square root.
    #[inline(always)]
    pub fn sqrt(self) -> DoubleDouble {
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
        let DoubleDouble { high, low } = DoubleDouble::sum(self.high, other.high);
        DoubleDouble::new(high, low + (self.low + other.low))
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
