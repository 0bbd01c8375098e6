//! Interval arithmetic in space: bounds on a formula and its slopes over a rectangle, and whether
//! it may jump there.
//!
//! The bounds hold up to rounding. Source: R. E. Moore, R. B. Kearfott and M. J. Cloud,
//! *Introduction to Interval Analysis*, 2009, chapters 2, 5 and 6 (the mean value form).

use super::code::{Binary, Number, Unary};
use crate::hash;
use std::f64::consts::{FRAC_PI_2, LN_10, PI, TAU};

/// Interval of numbers, up to rounding; its ends may be infinite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

impl Interval {
    const ALL: Interval = Interval { low: f64::NEG_INFINITY, high: f64::INFINITY };
    const ZERO: Interval = Interval::point(0.0);
    const ONE: Interval = Interval::point(1.0);

    /// Returns the interval between two numbers, in any order; all numbers if one of them is NaN.
    pub fn new(a: f64, b: f64) -> Interval {
        if a.is_nan() || b.is_nan() { Interval::ALL } else { Interval { low: a.min(b), high: a.max(b) } }
    }

    /// Returns the interval of one number.
    pub const fn point(value: f64) -> Interval {
        Interval { low: value, high: value }
    }

    /// Returns the width of the interval.
    pub fn width(self) -> f64 {
        self.high - self.low
    }

    /// Returns the largest magnitude.
    pub fn magnitude(self) -> f64 {
        self.high.abs().max(self.low.abs())
    }

    /// Returns whether the interval contains a number.
    pub fn contains(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    fn is_point(self) -> bool {
        self.low == self.high
    }

    fn least_magnitude(self) -> f64 {
        if self.contains(0.0) { 0.0 } else { self.low.abs().min(self.high.abs()) }
    }

    /// Returns the smallest interval that contains both.
    pub fn hull(self, other: Interval) -> Interval {
        Interval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Returns the intersection of both, or this interval where rounding leaves it empty.
    fn within(self, other: Interval) -> Interval {
        let (low, high) = (self.low.max(other.low), self.high.min(other.high));
        if low <= high { Interval { low, high } } else { self }
    }

    /// Returns the sum.
    pub fn plus(self, other: Interval) -> Interval {
        Interval::new(self.low + other.low, self.high + other.high)
    }

    fn negative(self) -> Interval {
        Interval { low: -self.high, high: -self.low }
    }

    /// Returns the product with a number.
    pub fn scaled(self, factor: f64) -> Interval {
        self.times(Interval::point(factor))
    }

    /// Returns the product; zero times anything is zero.
    /// Returns the product.
    pub fn times(self, other: Interval) -> Interval {
        let product = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let corners = [
            product(self.low, other.low),
            product(self.low, other.high),
            product(self.high, other.low),
            product(self.high, other.high),
        ];
        Interval::new(
            corners.into_iter().fold(f64::INFINITY, f64::min),
            corners.into_iter().fold(f64::NEG_INFINITY, f64::max),
        )
    }

    fn square(self) -> Interval {
        Interval::new(self.least_magnitude().powi(2), self.magnitude().powi(2))
    }

    fn inverse(self) -> Interval {
        if self.low == 0.0 && self.high > 0.0 {
            return Interval::new(1.0 / self.high, f64::INFINITY);
        }
        if self.high == 0.0 && self.low < 0.0 {
            return Interval::new(f64::NEG_INFINITY, 1.0 / self.low);
        }
        if self.contains(0.0) { Interval::ALL } else { Interval::new(1.0 / self.low, 1.0 / self.high) }
    }

    /// Returns the image under an increasing function.
    fn rising(self, function: impl Fn(f64) -> f64) -> Interval {
        Interval::new(function(self.low), function(self.high))
    }

    /// Returns the image under the cosine.
    fn cos(self) -> Interval {
        if self.width().is_nan() || self.width() >= TAU {
            return Interval { low: -1.0, high: 1.0 };
        }
        let ends = Interval::new(self.low.cos(), self.high.cos());
        // Whether the interval contains a shifted multiple of a full turn.
        let has = |shift: f64| ((self.high - shift) / TAU).floor() >= ((self.low - shift) / TAU).ceil();
        Interval { low: if has(PI) { -1.0 } else { ends.low }, high: if has(0.0) { 1.0 } else { ends.high } }
    }

    fn sin(self) -> Interval {
        self.plus(Interval::point(-FRAC_PI_2)).cos()
    }

    /// Returns the image under u^n, n a number.
    fn power(self, n: f64) -> Interval {
        if n == 0.0 {
            return Interval::ONE;
        }
        if n < 0.0 {
            return self.power(-n).inverse();
        }
        let raise = |u: f64| u.powf(n);
        if n.fract() == 0.0 {
            return if n % 2.0 == 0.0 {
                Interval::new(raise(self.least_magnitude()), raise(self.magnitude()))
            } else {
                self.rising(raise)
            };
        }
        Interval { low: self.low.max(0.0), high: self.high.max(0.0) }.rising(raise)
    }
}

/// Bounds on a formula over a rectangle: its value, its slopes along x and y, and whether it may
/// jump.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enclosure {
    /// Bounds on the value.
    pub value: Interval,
    /// Bounds on the slopes along x and y, meaningless where it may jump.
    pub slope: [Interval; 2],
    /// Whether the formula may jump: a condition or step is not constant on the rectangle.
    pub jumps: bool,
}

impl Enclosure {
    /// The number 0.
    pub const ZERO: Enclosure = Enclosure { value: Interval::ZERO, slope: [Interval::ZERO; 2], jumps: false };

    /// Returns a variable between bounds, along x (0) or y (1).
    pub(super) fn along(axis: usize, value: Interval) -> Enclosure {
        let mut slope = [Interval::ZERO; 2];
        slope[axis] = Interval::ONE;
        Enclosure { value, slope, jumps: false }
    }

    /// Returns whether the value is constant at most along lines, which have no area.
    fn is_nowhere_flat(&self) -> bool {
        !self.jumps && self.slope.iter().any(|slope| !slope.contains(0.0))
    }

    /// Returns f(u), from bounds on f and on f'.
    fn chain(self, value: Interval, derivative: Interval) -> Enclosure {
        Enclosure { value, slope: self.slope.map(|slope| slope.times(derivative)), ..self }
    }

    /// Returns a piecewise constant function: one value, or a jump between the values of an
    /// interval.
    fn steps(self, value: Interval) -> Enclosure {
        let jumps = !value.is_point();
        let slope = if jumps { Interval::ALL } else { Interval::ZERO };
        Enclosure { value, slope: [slope; 2], jumps }
    }

    fn times(self, other: Enclosure) -> Enclosure {
        let slope = |k: usize| self.slope[k].times(other.value).plus(other.slope[k].times(self.value));
        Enclosure {
            value: self.value.times(other.value),
            slope: [slope(0), slope(1)],
            jumps: self.jumps || other.jumps,
        }
    }

    /// Returns the sum.
    pub fn plus(self, other: Enclosure) -> Enclosure {
        Enclosure {
            value: self.value.plus(other.value),
            slope: [0, 1].map(|k| self.slope[k].plus(other.slope[k])),
            jumps: self.jumps || other.jumps,
        }
    }

    /// Returns the product with a number.
    pub fn scaled(self, factor: f64) -> Enclosure {
        Enclosure {
            value: self.value.scaled(factor),
            slope: self.slope.map(|slope| slope.scaled(factor)),
            ..self
        }
    }

    fn negative(self) -> Enclosure {
        Enclosure { value: self.value.negative(), slope: self.slope.map(Interval::negative), ..self }
    }

    /// Returns one of the two, with a possible kink between them but no jump.
    fn either(self, other: Enclosure, value: Interval) -> Enclosure {
        Enclosure {
            value,
            slope: [0, 1].map(|k| self.slope[k].hull(other.slope[k])),
            jumps: self.jumps || other.jumps,
        }
    }

    /// Returns whether this is less than `other`, if the answer is the same everywhere except on
    /// lines.
    fn is_less(self, other: Enclosure) -> Option<bool> {
        let gap = self.plus(other.negative());
        let touches = || gap.is_nowhere_flat();
        if self.value.high < other.value.low || self.value.high == other.value.low && touches() {
            return Some(true);
        }
        if self.value.low > other.value.high || self.value.low == other.value.high && touches() {
            return Some(false);
        }
        (self.value.is_point() && other.value.is_point()).then_some(self.value.low < other.value.low)
    }

    fn is_equal(self, other: Enclosure) -> Option<bool> {
        if self.value.is_point() && other.value.is_point() {
            return Some(self.value == other.value);
        }
        let apart = self.value.high < other.value.low || self.value.low > other.value.high;
        (apart || self.plus(other.negative()).is_nowhere_flat()).then_some(false)
    }

    /// Returns the enclosure of a condition that is known, or not.
    fn condition(known: Option<bool>) -> Enclosure {
        let value = known.map_or(Interval { low: 0.0, high: 1.0 }, |holds| Interval::point(f64::from(holds)));
        Enclosure::constant(0.0).steps(value)
    }

    /// Returns the image under floor: a single integer where it is constant except on lines.
    fn floor(self) -> Interval {
        let Interval { low, high } = self.value;
        if self.is_nowhere_flat() && high == high.floor() && low.floor() == high - 1.0 {
            return Interval::point(high - 1.0);
        }
        self.value.rising(f64::floor)
    }

    /// Returns the remainder u - v floor(u / v).
    fn remainder(self, divisor: Enclosure) -> Enclosure {
        let turns = self.binary(Binary::Divide, divisor).unary(Unary::Floor);
        let rest = self.plus(divisor.times(turns).negative());
        let most = divisor.value.magnitude();
        let range = Interval {
            low: if divisor.value.low < 0.0 { -most } else { 0.0 },
            high: if divisor.value.high > 0.0 { most } else { 0.0 },
        };
        Enclosure { value: rest.value.within(range), ..rest }
    }

    /// Returns the angle of (v, u) from the axis v, which jumps where u changes its sign at a
    /// negative v.
    fn angle(self, across: Enclosure) -> Enclosure {
        let (u, v) = (self.value, across.value);
        if u.contains(0.0) && v.low <= 0.0 {
            return Enclosure::constant(0.0).steps(Interval { low: -PI, high: PI });
        }
        let corners = [u.low, u.high].map(|u| [v.low, v.high].map(|v| u.atan2(v)));
        let all = corners.as_flattened().iter().copied();
        let value = Interval::new(all.clone().fold(f64::MAX, f64::min), all.fold(f64::MIN, f64::max));
        let square = u.square().plus(v.square()).inverse();
        let slope = |k: usize| {
            let rate = self.slope[k].times(v).plus(across.slope[k].times(u).negative());
            rate.times(square)
        };
        Enclosure { value, slope: [slope(0), slope(1)], jumps: self.jumps || across.jumps }
    }
}

impl Number for Enclosure {
    fn constant(value: f64) -> Self {
        Enclosure { value: Interval::point(value), slope: [Interval::ZERO; 2], jumps: false }
    }

    fn unary(self, op: Unary) -> Self {
        let u = self.value;
        let one = Interval::ONE;
        match op {
            Unary::Negate => self.negative(),
            Unary::Not => self.steps(one.plus(u.negative())),
            Unary::Sin => self.chain(u.sin(), u.cos()),
            Unary::Cos => self.chain(u.cos(), u.sin().negative()),
            Unary::Tan => {
                let same_branch = ((u.low - FRAC_PI_2) / PI).floor() == ((u.high - FRAC_PI_2) / PI).floor();
                let value = if same_branch { u.rising(f64::tan) } else { Interval::ALL };
                self.chain(value, one.plus(value.square()))
            }
            Unary::Asin | Unary::Acos => {
                let inside = Interval { low: u.low.clamp(-1.0, 1.0), high: u.high.clamp(-1.0, 1.0) };
                let slope = one.plus(inside.square().negative()).power(0.5).inverse();
                if op == Unary::Asin {
                    self.chain(inside.rising(f64::asin), slope)
                } else {
                    self.chain(inside.rising(f64::acos), slope.negative())
                }
            }
            Unary::Atan => self.chain(u.rising(f64::atan), one.plus(u.square()).inverse()),
            Unary::Sinh | Unary::Cosh => {
                let sinh = u.rising(f64::sinh);
                let cosh = Interval::new(u.least_magnitude().cosh(), u.magnitude().cosh());
                if op == Unary::Sinh { self.chain(sinh, cosh) } else { self.chain(cosh, sinh) }
            }
            Unary::Tanh => {
                let value = u.rising(f64::tanh);
                self.chain(value, one.plus(value.square().negative()))
            }
            Unary::Exp => {
                let value = u.rising(f64::exp);
                self.chain(value, value)
            }
            Unary::Ln | Unary::Log10 => {
                let scale = if op == Unary::Ln { 1.0 } else { 1.0 / LN_10 };
                let inside = Interval { low: u.low.max(0.0), high: u.high.max(0.0) };
                self.chain(inside.rising(f64::ln).scaled(scale), inside.inverse().scaled(scale))
            }
            Unary::Sqrt => {
                let value = u.power(0.5);
                self.chain(value, value.inverse().scaled(0.5))
            }
            Unary::Abs if u.low >= 0.0 => self,
            Unary::Abs if u.high <= 0.0 => self.negative(),
            Unary::Abs => self.either(self.negative(), Interval::new(0.0, u.magnitude())),
            Unary::Sign => match (self.is_less(Self::constant(0.0)), Self::constant(0.0).is_less(self)) {
                (Some(true), _) => self.steps(Interval::point(-1.0)),
                (_, Some(true)) => self.steps(one),
                (Some(false), Some(false)) => self.steps(Interval::ZERO),
                _ => self.steps(u.rising(|u| if u == 0.0 { 0.0 } else { u.signum() })),
            },
            Unary::Floor => self.steps(self.floor()),
            Unary::Ceil => self.steps(self.negative().floor().negative()),
            Unary::Round => self.steps(u.rising(f64::round)),
            Unary::Step => match self.is_less(Self::constant(0.0)) {
                Some(negative) => self.steps(Interval::point(f64::from(!negative))),
                None if u.low >= 0.0 => self.steps(one),
                None => self.steps(Interval { low: 0.0, high: 1.0 }),
            },
        }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let (u, v) = (self.value, right.value);
        let negated = |known: Option<bool>| known.map(|known| !known);
        match op {
            Binary::Add => self.plus(right),
            Binary::Subtract => self.plus(right.negative()),
            Binary::Multiply => self.times(right),
            Binary::Divide => {
                let inverse = v.inverse();
                self.times(right.chain(inverse, inverse.square().negative()))
            }
            Binary::Power if v.is_point() => {
                let n = v.low;
                self.chain(u.power(n), u.power(n - 1.0).scaled(n))
            }
            // The power u^v is computed as exp(v ln u).
            Binary::Power => right.times(self.unary(Unary::Ln)).unary(Unary::Exp),
            Binary::Min if u.high <= v.low => self,
            Binary::Min if v.high <= u.low => right,
            Binary::Min => self.either(right, Interval { low: u.low.min(v.low), high: u.high.min(v.high) }),
            Binary::Max if u.low >= v.high => self,
            Binary::Max if v.low >= u.high => right,
            Binary::Max => self.either(right, Interval { low: u.low.max(v.low), high: u.high.max(v.high) }),
            Binary::Atan2 => self.angle(right),
            Binary::Hypot => {
                let least = u.least_magnitude().hypot(v.least_magnitude());
                let value = Interval::new(least, u.magnitude().hypot(v.magnitude()));
                let unit = Interval { low: -1.0, high: 1.0 };
                let share = |of: Interval| of.times(value.inverse()).within(unit);
                let slope = |k: usize| self.slope[k].times(share(u)).plus(right.slope[k].times(share(v)));
                Enclosure { value, slope: [slope(0), slope(1)], jumps: self.jumps || right.jumps }
            }
            Binary::Mod => self.remainder(right),
            Binary::Less => Enclosure::condition(self.is_less(right)),
            Binary::GreaterEqual => Enclosure::condition(negated(self.is_less(right))),
            Binary::Greater => Enclosure::condition(right.is_less(self)),
            Binary::LessEqual => Enclosure::condition(negated(right.is_less(self))),
            Binary::Equal => Enclosure::condition(self.is_equal(right)),
            Binary::NotEqual => Enclosure::condition(negated(self.is_equal(right))),
            Binary::And => self.steps(Interval { low: u.low.min(v.low), high: u.high.min(v.high) }),
            Binary::Or => self.steps(Interval { low: u.low.max(v.low), high: u.high.max(v.high) }),
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        if self.value.is_point() {
            return if self.value.low == 0.0 { no } else { yes };
        }
        let value = yes.value.hull(no.value);
        // Where both branches are the same number, the condition does not matter.
        if value.is_point() { yes } else { Enclosure { value, slope: [Interval::ALL; 2], jumps: true } }
    }
}

/// Number with a record of the branch taken at every jump and kink.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sided {
    value: f64,
    side: u64,
}

impl Sided {
    pub(super) fn side(self) -> u64 {
        self.side
    }

    /// Records one more branch, by a number of its own (FNV-1a hash).
    fn choose(self, value: f64, choice: f64) -> Sided {
        Sided { value, side: hash::extend(self.side, choice.to_bits()) }
    }

    fn mix(self, other: Sided) -> u64 {
        if other.side == 0 { self.side } else { self.side.rotate_left(17) ^ other.side }
    }
}

impl Number for Sided {
    fn constant(value: f64) -> Self {
        Sided { value, side: 0 }
    }

    fn unary(self, op: Unary) -> Self {
        let value = self.value.unary(op);
        match op {
            Unary::Abs => self.choose(value, f64::from(self.value.is_sign_negative())),
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Step => {
                self.choose(value, value)
            }
            // Only the outcome of a condition counts.
            Unary::Not => Sided { value, side: 0 },
            _ => Sided { value, ..self },
        }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let value = self.value.binary(op, right.value);
        let both = Sided { value, side: self.mix(right) };
        match op {
            Binary::Min => if self.value < right.value { self } else { right }
                .choose(value, f64::from(self.value < right.value)),
            Binary::Max => if self.value > right.value { self } else { right }
                .choose(value, f64::from(self.value > right.value)),
            Binary::Mod => both.choose(value, (self.value / right.value).floor()),
            Binary::Atan2 if right.value < 0.0 => {
                both.choose(value, f64::from(self.value.is_sign_negative()))
            }
            Binary::Less
            | Binary::LessEqual
            | Binary::Greater
            | Binary::GreaterEqual
            | Binary::Equal
            | Binary::NotEqual
            | Binary::And
            | Binary::Or => Sided { value, side: 0 },
            _ => both,
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        let branch = if self.value == 0.0 { no } else { yes };
        branch.choose(self.value.select(yes.value, no.value), f64::from(self.value != 0.0))
    }
}
