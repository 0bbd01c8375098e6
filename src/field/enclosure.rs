//! Bounds on a formula and its slopes over ranges of its variables, and whether it may have a kink
//! or a jump there.
//!
//! Source: R. E. Moore, R. B. Kearfott and M. J. Cloud, *Introduction to Interval Analysis*, 2009,
//! chapter 6 (the mean value form).

use super::code::{Binary, Number, Unary};
use super::interval::{Interval, ROUNDING};
use std::array;
use std::f64::consts::{FRAC_PI_2, LN_10, PI};

/// Bounds on a number over ranges of N variables.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Enclosure<const N: usize> {
    /// Value at the middle of all ranges.
    pub(super) middle: f64,
    /// Bound on the rounding error of that value.
    error: f64,
    /// Bounds on the value.
    pub value: Interval,
    /// Bounds on the slope along each variable, where there is one, times half its range.
    pub slope: [Interval; N],
    course: Course,
}

/// Worst that may occur in the ranges.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Course {
    Smooth,
    /// Kink or pole.
    Kink,
    Jump,
}

impl<const N: usize> Enclosure<N> {
    /// The number 0.
    pub const ZERO: Self = Enclosure {
        middle: 0.0,
        error: 0.0,
        value: Interval::ZERO,
        slope: [Interval::ZERO; N],
        course: Course::Smooth,
    };

    /// Returns the variable of this index between bounds.
    pub(super) fn variable(index: usize, low: f64, high: f64) -> Self {
        let middle = 0.5 * (low + high);
        let mut variable = Enclosure { middle, value: Interval { low, high }, ..Self::ZERO };
        variable.slope[index] = Interval::point((middle - low).max(high - middle));
        variable
    }

    /// Returns a smooth number, given its value at the middle and its bounds.
    pub(super) fn smooth(middle: f64, value: Interval, slope: [Interval; N]) -> Self {
        let error = ROUNDING * value.magnitude();
        Enclosure { middle, error, value, slope, course: Course::Smooth }.tightened()
    }

    /// Returns whether there may be a jump.
    pub fn jumps(&self) -> bool {
        self.course == Course::Jump
    }

    /// Returns whether there may be a kink, a pole or a jump.
    pub(super) fn breaks(&self) -> bool {
        self.course != Course::Smooth
    }

    /// Returns the sum.
    pub fn plus(self, other: Self) -> Self {
        self.binary(Binary::Add, other)
    }

    /// Returns the product with a number.
    pub fn scaled(self, factor: f64) -> Self {
        self.binary(Binary::Multiply, Self::constant(factor))
    }

    fn is_constant(&self) -> bool {
        self.error == 0.0 && self.value.low.to_bits() == self.value.high.to_bits()
    }

    fn negative(self) -> Self {
        Enclosure {
            middle: -self.middle,
            value: self.value.negative(),
            slope: self.slope.map(Interval::negative),
            ..self
        }
    }

    /// Returns f(u, v), given its value at the middle and bounds on f and its partial derivatives.
    #[inline]
    fn combine(self, right: Self, middle: f64, value: Interval, partial: [Interval; 2]) -> Self {
        // Such as a product with 0.
        if value.is_point() {
            return Self::steps(middle, value);
        }
        let [u, v] = partial;
        let slope = array::from_fn(|k| match (self.slope[k], right.slope[k]) {
            (Interval::ZERO, Interval::ZERO) => Interval::ZERO,
            (a, b) => a.times(u).plus(b.times(v)),
        });
        let passed = |partial: Interval, error: f64| match error {
            0.0 => 0.0,
            _ => 2.0 * partial.magnitude() * error,
        };
        let rounded = ROUNDING * middle.abs() + f64::MIN_POSITIVE;
        let error = rounded + passed(u, self.error) + passed(v, right.error);
        Enclosure { middle, error, value, slope, course: self.course.max(right.course) }.tightened()
    }

    /// Returns f(u), given its value at the middle and bounds on f and f'.
    #[inline]
    fn chain(self, middle: f64, value: Interval, derivative: Interval) -> Self {
        self.combine(Self::ZERO, middle, value, [derivative, Interval::ZERO])
    }

    /// Tightens the bounds on a continuous number by its value at the middle and its slopes.
    #[inline]
    fn tightened(mut self) -> Self {
        let change: f64 = self.slope.iter().map(|slope| slope.magnitude()).sum();
        let way = (1.0 + ROUNDING) * (change + self.error);
        if !self.jumps() && way.is_finite() && self.middle.is_finite() {
            self.value = self.value.within(Interval::of([self.middle - way, self.middle + way]));
        }
        self
    }

    /// Marks a kink or pole where a condition holds.
    fn kinked(mut self, condition: bool) -> Self {
        if condition {
            self.course = self.course.max(Course::Kink);
        }
        self
    }

    /// Returns one of two numbers, with a possible kink between them.
    fn either(self, other: Self, middle: f64, value: Interval) -> Self {
        Enclosure {
            middle,
            error: self.error + other.error,
            value,
            slope: array::from_fn(|k| self.slope[k].hull(other.slope[k])),
            course: self.course.max(other.course),
        }
        .kinked(true)
    }

    /// Returns a piecewise constant number: one value, or a jump between the values of an interval.
    fn steps(middle: f64, value: Interval) -> Self {
        if value.is_point() {
            return Enclosure { middle: value.low, value, ..Self::ZERO };
        }
        Enclosure { middle, value, course: Course::Jump, ..Self::ZERO }
    }

    /// Returns whether the number has no value on an area: it is constant at most along lines of
    /// the plane of the first two variables.
    fn is_nowhere_flat(&self) -> bool {
        N > 1 && !self.jumps() && self.slope.iter().take(2).any(|slope| !slope.contains(0.0))
    }
}

impl<const N: usize> Number for Enclosure<N> {
    fn constant(value: f64) -> Self {
        Enclosure { middle: value, value: Interval::point(value), ..Self::ZERO }
    }

    fn unary(self, op: Unary) -> Self {
        let (u, middle) = (self.value, self.middle.unary(op));
        if self.is_constant() {
            return Self::constant(middle);
        }
        let one = Interval::ONE;
        let monotonic = |u: Interval| u.map(|u| u.unary(op));
        match op {
            Unary::Negate => self.negative(),
            Unary::Not => Self::steps(middle, u.negative().ends(|end| 1.0 + end)),
            Unary::Sin => self.chain(middle, u.sin(), u.cos()),
            Unary::Cos => self.chain(middle, u.cos(), u.sin().negative()),
            Unary::Tan => {
                let pole = u.has_turn(FRAC_PI_2, PI);
                let value = if pole { Interval::ALL } else { monotonic(u) };
                self.chain(middle, value, one.plus(value.power(2.0))).kinked(pole)
            }
            Unary::Asin | Unary::Acos => {
                let inside = u.ends(|end| end.clamp(-1.0, 1.0));
                let slope = one.plus(inside.power(2.0).negative()).power(-0.5);
                let slope = if op == Unary::Asin { slope } else { slope.negative() };
                self.chain(middle, monotonic(inside), slope).kinked(u.low <= -1.0 || u.high >= 1.0)
            }
            Unary::Atan => self.chain(middle, monotonic(u), one.plus(u.power(2.0)).inverse()),
            Unary::Sinh | Unary::Cosh => {
                let sinh = u.map(f64::sinh);
                let cosh = Interval::of([u.least_magnitude(), u.magnitude()].map(f64::cosh));
                let (value, slope) = if op == Unary::Sinh { (sinh, cosh) } else { (cosh, sinh) };
                self.chain(middle, value, slope)
            }
            Unary::Tanh => {
                let value = monotonic(u);
                self.chain(middle, value, one.plus(value.power(2.0).negative()))
            }
            Unary::Exp => {
                let value = monotonic(u).positive();
                self.chain(middle, value, value)
            }
            Unary::Ln | Unary::Log10 => {
                let scale = if op == Unary::Ln { one } else { Interval::of([LN_10]).inverse() };
                let inside = u.positive();
                self.chain(middle, monotonic(inside), inside.inverse().times(scale)).kinked(u.low <= 0.0)
            }
            Unary::Sqrt => {
                let slope = u.power(-0.5).times(Interval::point(0.5));
                self.chain(middle, u.power(0.5), slope).kinked(u.low <= 0.0)
            }
            Unary::Abs if u.low >= 0.0 => self,
            Unary::Abs if u.high <= 0.0 => self.negative(),
            Unary::Abs => self.either(self.negative(), middle, Interval { low: 0.0, high: u.magnitude() }),
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Step => {
                Self::steps(middle, u.ends(|end| end.unary(op)))
            }
        }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let (u, v) = (self.value, right.value);
        let middle = self.middle.binary(op, right.middle);
        if self.is_constant() && right.is_constant() {
            return Self::constant(middle);
        }
        let one = Interval::ONE;
        let condition = |surely: bool, possibly: bool| {
            Self::steps(middle, Interval { low: f64::from(surely), high: f64::from(possibly) })
        };
        match op {
            Binary::Add => self.combine(right, middle, u.plus(v), [one, one]),
            Binary::Subtract => self.binary(Binary::Add, right.negative()),
            Binary::Multiply => self.combine(right, middle, u.times(v), [v, u]),
            Binary::Divide => {
                let inverse = v.inverse();
                let value = u.times(inverse);
                let partial = [inverse, value.times(inverse).negative()];
                self.combine(right, middle, value, partial).kinked(v.contains(0.0))
            }
            Binary::Power if v.is_point() => {
                let n = v.low;
                let smooth = u.low > 0.0 || n.fract() == 0.0 && (n >= 0.0 || u.high < 0.0);
                let slope = u.power(n - 1.0).times(v);
                self.chain(middle, u.power(n), slope).kinked(!smooth)
            }
            Binary::Power => {
                // The magnitude is exp(v ln |u|). Whole powers of a negative u have either sign.
                let log = self.unary(Unary::Abs).unary(Unary::Ln);
                let size = right.binary(Binary::Multiply, log).unary(Unary::Exp);
                if u.low >= 0.0 {
                    return size;
                }
                let value = size.value.hull(size.value.negative());
                Enclosure { course: Course::Jump, ..size.either(size.negative(), middle, value) }
            }
            Binary::Min | Binary::Max => {
                let (less, more) = if op == Binary::Min { (u, v) } else { (v, u) };
                if less.high <= more.low {
                    return self;
                }
                if more.high <= less.low {
                    return right;
                }
                self.either(right, middle, u.each(v, |a, b| a.binary(op, b)))
            }
            Binary::Atan2 if u.contains(0.0) && v.low <= 0.0 => {
                let turn = Interval { low: -PI, high: PI };
                Enclosure { slope: [Interval::ALL; N], ..Self::steps(middle, turn) }
            }
            Binary::Atan2 => {
                let corner = |u: f64, v: f64| u.atan2(v);
                let low = [corner(u.low, v.low), corner(u.low, v.high)];
                let high = [corner(u.high, v.low), corner(u.high, v.high)];
                let value = Interval::of(low).hull(Interval::of(high));
                let inverse = u.power(2.0).plus(v.power(2.0)).inverse();
                self.combine(right, middle, value, [v.times(inverse), u.times(inverse).negative()])
            }
            Binary::Hypot => {
                let least = u.least_magnitude().hypot(v.least_magnitude());
                let value = Interval::of([least, u.magnitude().hypot(v.magnitude())]).positive();
                let inverse = value.inverse();
                let partial = [u, v].map(|side| side.times(inverse).within(Interval::UNIT));
                self.combine(right, middle, value, partial).kinked(least == 0.0)
            }
            Binary::Mod => {
                let turns = self.binary(Binary::Divide, right).unary(Unary::Floor);
                let rest = self.binary(Binary::Subtract, right.binary(Binary::Multiply, turns));
                let range = Interval { low: v.low.min(0.0), high: v.high.max(0.0) };
                Enclosure { middle, value: rest.value.within(range), ..rest }
            }
            Binary::Less => condition(u.high < v.low, u.low < v.high),
            Binary::LessEqual => condition(u.high <= v.low, u.low <= v.high),
            Binary::Greater | Binary::GreaterEqual => {
                let mirrored = if op == Binary::Greater { Binary::Less } else { Binary::LessEqual };
                right.binary(mirrored, self)
            }
            Binary::Equal => {
                let flat = !self.binary(Binary::Subtract, right).is_nowhere_flat();
                condition(u.is_point() && u == v, u.low <= v.high && v.low <= u.high && flat)
            }
            Binary::NotEqual => self.binary(Binary::Equal, right).unary(Unary::Not),
            Binary::And => Self::steps(middle, u.each(v, f64::min)),
            Binary::Or => Self::steps(middle, u.each(v, f64::max)),
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        if self.value.low == 1.0 {
            return yes;
        }
        // Where both branches are the same number, the condition does not matter.
        if self.value.high == 0.0 || yes.is_constant() && yes == no {
            return no;
        }
        let middle = self.middle.select(yes.middle, no.middle);
        Enclosure { course: Course::Jump, ..yes.either(no, middle, yes.value.hull(no.value)) }
    }
}
