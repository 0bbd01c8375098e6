//! Interval arithmetic.
//!
//! Source: R. E. Moore, R. B. Kearfott and M. J. Cloud, *Introduction to Interval Analysis*, 2009,
//! chapters 2 and 5.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Relative rounding error of a result.
pub(super) const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Largest magnitude that outward rounding may leave of 0, with a margin.
pub const NOTHING: f64 = 1e-290;

/// Interval of numbers, whose ends may be infinite. Every operation rounds them outwards, so that
/// the bounds are certain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Returns a lower bound on a number of which this is the rounded value.
#[inline]
fn below(value: f64) -> f64 {
    // An infinite value may be the overflow of any larger number.
    (value - ROUNDING * value.abs()).min(f64::MAX) - f64::MIN_POSITIVE
}

impl Interval {
    pub(super) const ALL: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
    /// Zero of either sign.
    pub(super) const ZERO: Interval = Interval { low: -0.0, high: 0.0 };
    pub(super) const ONE: Interval = Interval::point(1.0);
    pub(super) const UNIT: Interval = Interval { low: -1.0, high: 1.0 };

    /// Returns the interval of one number; all numbers if it is NaN.
    pub const fn point(value: f64) -> Interval {
        if value.is_nan() { Interval::ALL } else { Interval { low: value, high: value } }
    }

    /// Returns the interval of some numbers, enlarged by their rounding errors; all numbers if one
    /// of them is NaN.
    #[inline]
    pub(super) fn of<const K: usize>(values: [f64; K]) -> Interval {
        if values.iter().any(|value| value.is_nan()) {
            return Interval::ALL;
        }
        let low = values.into_iter().fold(f64::INFINITY, f64::min);
        let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max);
        Interval { low: below(low), high: -below(-high) }
    }

    /// Returns the width of the interval.
    pub fn width(self) -> f64 {
        self.high - self.low
    }

    /// Returns the largest magnitude.
    #[inline]
    pub fn magnitude(self) -> f64 {
        self.high.abs().max(self.low.abs())
    }

    pub(super) fn least_magnitude(self) -> f64 {
        if self.contains(0.0) { 0.0 } else { self.low.abs().min(self.high.abs()) }
    }

    pub(super) fn contains(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    pub(super) fn is_point(self) -> bool {
        self.low == self.high
    }

    /// Returns the smallest interval that contains both.
    pub(super) fn hull(self, other: Interval) -> Interval {
        Interval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Returns the intersection of both, or this interval where rounding leaves it empty.
    #[inline]
    pub(super) fn within(self, other: Interval) -> Interval {
        let (low, high) = (self.low.max(other.low), self.high.min(other.high));
        if low <= high { Interval { low, high } } else { self }
    }

    /// Returns the image under an exact function that increases.
    pub(super) fn ends(self, function: impl Fn(f64) -> f64) -> Interval {
        Interval { low: function(self.low), high: function(self.high) }
    }

    /// Returns the image of two intervals under an exact function that increases in both.
    pub(super) fn each(self, other: Interval, function: impl Fn(f64, f64) -> f64) -> Interval {
        Interval { low: function(self.low, other.low), high: function(self.high, other.high) }
    }

    /// Returns the image under a monotonic function.
    #[inline]
    pub(super) fn map(self, function: impl Fn(f64) -> f64) -> Interval {
        Interval::of([function(self.low), function(self.high)])
    }

    /// Returns the projection on the numbers from 0 on.
    pub(super) fn positive(self) -> Interval {
        self.ends(|end| end.max(0.0))
    }

    pub(super) fn negative(self) -> Interval {
        Interval { low: -self.high, high: -self.low }
    }

    /// Returns the sum.
    #[inline]
    pub fn plus(self, other: Interval) -> Interval {
        if self == Interval::ZERO {
            return other;
        }
        if other == Interval::ZERO {
            return self;
        }
        Interval::of([self.low + other.low, self.high + other.high])
    }

    /// Returns the product.
    #[inline]
    pub fn times(self, other: Interval) -> Interval {
        if self == Interval::ZERO || other == Interval::ZERO {
            return Interval::ZERO;
        }
        if self == Interval::ONE {
            return other;
        }
        if other == Interval::ONE {
            return self;
        }
        // Zero times an infinite end is zero: the other numbers of the interval are finite.
        let product = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let [a, b, c, d] = [self.low, self.high, other.low, other.high];
        Interval::of([product(a, c), product(a, d), product(b, c), product(b, d)])
    }

    /// Returns the inverses, with the infinity of its sign for a zero.
    pub(super) fn inverse(self) -> Interval {
        let has_one_sign = self.low.is_sign_positive() == self.high.is_sign_positive();
        if has_one_sign { self.map(f64::recip) } else { Interval::ALL }
    }

    /// Returns the image under u^n, as far as u has a power.
    pub(super) fn power(self, n: f64) -> Interval {
        if n < 0.0 {
            return self.power(-n).inverse();
        }
        if n == 1.0 {
            return self;
        }
        let raise = |u: f64| if n == 2.0 { u * u } else { u.powf(n) };
        if n % 2.0 == 1.0 {
            self.map(raise)
        } else if n % 2.0 == 0.0 {
            Interval::of([self.least_magnitude(), self.magnitude()].map(raise)).positive()
        } else {
            self.positive().map(raise).positive()
        }
    }

    pub(super) fn sin(self) -> Interval {
        self.wave(f64::sin, FRAC_PI_2)
    }

    pub(super) fn cos(self) -> Interval {
        self.wave(f64::cos, 0.0)
    }

    /// Returns the image under a sine with a maximum at `peak`.
    fn wave(self, function: impl Fn(f64) -> f64, peak: f64) -> Interval {
        let has = |shift: f64| self.has_turn(shift, TAU);
        let ends = self.map(function);
        Interval {
            low: if has(peak - PI) { -1.0 } else { ends.low.max(-1.0) },
            high: if has(peak) { 1.0 } else { ends.high.min(1.0) },
        }
    }

    /// Returns whether the interval may contain a multiple of the period plus a shift.
    pub(super) fn has_turn(self, shift: f64, period: f64) -> bool {
        let slack = ROUNDING * (1.0 + self.magnitude());
        let first = ((self.low - slack - shift) / period).ceil();
        first <= ((self.high + slack - shift) / period).floor()
    }
}
