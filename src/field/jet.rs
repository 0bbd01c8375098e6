//! Forward differentiation in time to second order (truncated Taylor arithmetic).

use super::code::{Binary, Number, Unary};
use std::f64::consts::LN_10;

/// Value with its first two time derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Derivatives {
    /// Value.
    pub value: f64,
    /// First derivative, per s.
    pub first: f64,
    /// Second derivative, per s^2.
    pub second: f64,
}

/// Returns a product in which a zero time derivative prevails over an infinite slope: `sqrt(x)` at
/// x = 0 does not depend on time.
fn product(slope: f64, motion: f64) -> f64 {
    if motion == 0.0 { 0.0 } else { slope * motion }
}

impl Derivatives {
    /// Returns the variable of differentiation, usually the time.
    pub(super) fn moving(value: f64) -> Derivatives {
        Derivatives { value, first: 1.0, second: 0.0 }
    }

    /// Returns whether the value is less than another, or equal and less just after.
    fn goes_below(self, other: Derivatives) -> bool {
        let [left, right] = [self, other].map(|jet| [jet.value, jet.first, jet.second]);
        left.partial_cmp(&right) == Some(std::cmp::Ordering::Less)
    }

    fn is_still(&self) -> bool {
        self.first == 0.0 && self.second == 0.0
    }

    /// Returns f(u), from f, f' and f'' at u.
    fn chain(self, f: f64, slope: f64, curvature: f64) -> Derivatives {
        Derivatives {
            value: f,
            first: product(slope, self.first),
            second: product(curvature, self.first * self.first) + product(slope, self.second),
        }
    }

    /// Returns the product.
    pub fn times(self, other: Derivatives) -> Derivatives {
        let (u, v) = (self, other);
        Derivatives {
            value: u.value * v.value,
            first: product(v.value, u.first) + product(u.value, v.first),
            second: product(v.value, u.second) + 2.0 * u.first * v.first + product(u.value, v.second),
        }
    }

    fn plus(self, other: Derivatives, sign: f64) -> Derivatives {
        Derivatives {
            value: self.value + sign * other.value,
            first: self.first + sign * other.first,
            second: self.second + sign * other.second,
        }
    }

    /// Returns u^v. For constant v, u may be negative or zero as far as the power has a derivative
    /// there.
    fn power(self, exponent: Derivatives, f: f64) -> Derivatives {
        let (u, n) = (self.value, exponent.value);
        if exponent.is_still() {
            let slope = product(u.powf(n - 1.0), n);
            let curvature = product(u.powf(n - 2.0), n * (n - 1.0));
            return self.chain(f, slope, curvature);
        }
        let log = exponent.times(self.unary(Unary::Ln));
        log.chain(f, f, f)
    }
}

impl Number for Derivatives {
    fn constant(value: f64) -> Self {
        Derivatives { value, first: 0.0, second: 0.0 }
    }

    fn unary(self, op: Unary) -> Self {
        let u = self.value;
        let f = u.unary(op);
        let (slope, curvature) = match op {
            Unary::Negate => (-1.0, 0.0),
            Unary::Sin => (u.cos(), -f),
            Unary::Cos => (-u.sin(), -f),
            Unary::Tan => (1.0 + f * f, 2.0 * f * (1.0 + f * f)),
            Unary::Asin => arcsine(u, 1.0),
            Unary::Acos => arcsine(u, -1.0),
            Unary::Atan => {
                let slope = 1.0 / (1.0 + u * u);
                (slope, -2.0 * u * slope * slope)
            }
            Unary::Sinh => (u.cosh(), f),
            Unary::Cosh => (u.sinh(), f),
            Unary::Tanh => (1.0 - f * f, -2.0 * f * (1.0 - f * f)),
            Unary::Exp => (f, f),
            Unary::Ln => (1.0 / u, -1.0 / (u * u)),
            Unary::Log10 => (1.0 / (u * LN_10), -1.0 / (u * u * LN_10)),
            Unary::Sqrt => (0.5 / f, -0.25 / (u * f)),
            Unary::Abs => (if self.goes_below(Derivatives::constant(0.0)) { -1.0 } else { 1.0 }, 0.0),
            Unary::Not | Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Step => (0.0, 0.0),
        };
        self.chain(f, slope, curvature)
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let (u, v) = (self, right);
        let f = u.value.binary(op, v.value);
        match op {
            Binary::Add => u.plus(v, 1.0),
            Binary::Subtract => u.plus(v, -1.0),
            Binary::Multiply => u.times(v),
            Binary::Divide => {
                let first = (u.first - product(f, v.first)) / v.value;
                let second = (u.second - 2.0 * first * v.first - product(f, v.second)) / v.value;
                Derivatives { value: f, first, second }
            }
            Binary::Power => u.power(v, f),
            Binary::Min if u.value.is_nan() || u.goes_below(v) => u,
            Binary::Max if u.value.is_nan() || v.goes_below(u) => u,
            Binary::Min | Binary::Max => v,
            Binary::Hypot | Binary::Atan2 if u.is_still() && v.is_still() => Derivatives::constant(f),
            Binary::Hypot => {
                let first = (u.value * u.first + v.value * v.first) / f;
                let speeds = u.first * u.first + v.first * v.first - first * first;
                let second = (speeds + u.value * u.second + v.value * v.second) / f;
                Derivatives { value: f, first, second }
            }
            Binary::Atan2 => {
                let square = u.value * u.value + v.value * v.value;
                let square_rate = 2.0 * (u.value * u.first + v.value * v.first);
                let first = (v.value * u.first - u.value * v.first) / square;
                let second = (v.value * u.second - u.value * v.second - first * square_rate) / square;
                Derivatives { value: f, first, second }
            }
            Binary::Mod => {
                let turns = ((u.value - f) / v.value).round();
                Derivatives { value: f, ..u.plus(v, -turns) }
            }
            _ => Derivatives::constant(f),
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        if self.value.is_nan() {
            self
        } else if self.value == 0.0 {
            no
        } else {
            yes
        }
    }
}

/// Returns the first and second derivatives of the arcsine, times a sign.
fn arcsine(u: f64, sign: f64) -> (f64, f64) {
    let slope = 1.0 / (1.0 - u * u).sqrt();
    (sign * slope, sign * u * slope * slope * slope)
}
