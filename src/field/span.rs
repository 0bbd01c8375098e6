//! Interval arithmetic in time: bounds on a number and its derivative over an interval of time, and
//! whether it may have a kink or a jump there.

use super::Interval;
use super::code::{Binary, Number, Unary};
use std::f64::consts::{FRAC_PI_2, LN_10, PI, TAU};

/// Interval whose ends every operation rounds outwards, so that its bounds are certain.
///
/// The bounds of [`super::Interval`] hold up to rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct OutwardInterval {
    pub low: f64,
    pub high: f64,
}

const NOUGHT: OutwardInterval = OutwardInterval { low: 0.0, high: 0.0 };
const ALL: OutwardInterval = OutwardInterval { low: f64::NEG_INFINITY, high: f64::INFINITY };

/// Relative rounding error of a result.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

impl OutwardInterval {
    fn point(value: f64) -> OutwardInterval {
        if value.is_nan() { ALL } else { OutwardInterval { low: value, high: value } }
    }

    /// Returns the interval of some numbers, enlarged by their rounding errors.
    fn of(values: impl IntoIterator<Item = f64>) -> OutwardInterval {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values {
            if value.is_nan() {
                return ALL;
            }
            low = low.min(value);
            high = high.max(value);
        }
        OutwardInterval {
            low: low - ROUNDING * low.abs() - f64::MIN_POSITIVE,
            high: high + ROUNDING * high.abs() + f64::MIN_POSITIVE,
        }
    }

    /// Returns the interval of some numbers, at least one.
    pub fn hull_of(values: impl IntoIterator<Item = f64>) -> OutwardInterval {
        OutwardInterval::of(values)
    }

    /// Returns the least magnitude.
    pub fn least_magnitude(self) -> f64 {
        if self.contains(0.0) { 0.0 } else { self.low.abs().min(self.high.abs()) }
    }

    fn contains(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    pub fn hull(self, other: OutwardInterval) -> OutwardInterval {
        OutwardInterval { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Returns the intersection of both; the first where rounding leaves it empty.
    fn meet(self, other: OutwardInterval) -> OutwardInterval {
        let (low, high) = (self.low.max(other.low), self.high.min(other.high));
        if low <= high { OutwardInterval { low, high } } else { self }
    }

    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    fn map(self, of: impl Fn(f64) -> f64) -> OutwardInterval {
        OutwardInterval::of([of(self.low), of(self.high)])
    }

    fn plus(self, other: OutwardInterval) -> OutwardInterval {
        if self == NOUGHT || other == NOUGHT {
            return if self == NOUGHT { other } else { self };
        }
        OutwardInterval::of([self.low + other.low, self.high + other.high])
    }

    fn minus(self, other: OutwardInterval) -> OutwardInterval {
        OutwardInterval::of([self.low - other.high, self.high - other.low])
    }

    fn times(self, other: OutwardInterval) -> OutwardInterval {
        if self == NOUGHT || other == NOUGHT {
            return NOUGHT;
        }
        let product = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let [a, b, c, d] = [self.low, self.high, other.low, other.high];
        OutwardInterval::of([product(a, c), product(a, d), product(b, c), product(b, d)])
    }

    fn over(self, other: OutwardInterval) -> OutwardInterval {
        if other.contains(0.0) {
            return if self == OutwardInterval::point(0.0) { self } else { ALL };
        }
        let inverse = OutwardInterval::of([1.0 / other.low, 1.0 / other.high]);
        self.times(inverse)
    }

    fn squared(self) -> OutwardInterval {
        let OutwardInterval { low, high } = self.map(|u| u * u);
        if self.contains(0.0) { OutwardInterval { low: 0.0, high } } else { OutwardInterval { low, high } }
    }

    /// Returns the sine of the interval plus a shift.
    fn sine(self, shift: f64) -> OutwardInterval {
        if !self.low.is_finite() || !self.high.is_finite() || self.high - self.low >= TAU {
            return OutwardInterval { low: -1.0, high: 1.0 };
        }
        let shifted = self.plus(OutwardInterval::point(shift));
        let mut sine = OutwardInterval::of([shifted.low.sin(), shifted.high.sin()]);
        // Rounding error of a large argument.
        let slack = ROUNDING * shifted.magnitude();
        let has = |peak: f64| {
            let turns = ((shifted.low - slack - peak) / TAU).ceil();
            peak + turns * TAU <= shifted.high + slack
        };
        if has(FRAC_PI_2) {
            sine.high = 1.0;
        }
        if has(-FRAC_PI_2) {
            sine.low = -1.0;
        }
        OutwardInterval { low: (sine.low - slack).max(-1.0), high: (sine.high + slack).min(1.0) }
    }
}

impl From<OutwardInterval> for Interval {
    fn from(bounds: OutwardInterval) -> Interval {
        Interval { low: bounds.low, high: bounds.high }
    }
}

/// Bounds on a number at all times of an interval.
#[derive(Debug, Clone, Copy)]
pub(super) struct Span {
    /// Value at the middle of the interval.
    pub middle: f64,
    /// Bound on the rounding error of that value.
    error: f64,
    pub value: OutwardInterval,
    /// Bounds on the derivative, where there is one.
    pub rate: OutwardInterval,
    /// Half the length of the interval, in s; 0 for constants.
    half: f64,
    /// Whether there may be a kink or a jump in the interval.
    pub breaks: bool,
}

impl Span {
    /// Returns the time itself.
    pub fn moving(from: f64, to: f64) -> Span {
        let middle = 0.5 * (from + to);
        let value = OutwardInterval { low: from, high: to };
        let half = (middle - from).max(to - middle);
        Span { middle, error: 0.0, value, rate: OutwardInterval::point(1.0), half, breaks: false }
    }

    /// Returns a number of given bounds.
    pub fn smooth(middle: f64, value: OutwardInterval, rate: OutwardInterval, half: f64) -> Span {
        let error = ROUNDING * value.magnitude();
        Span { middle, error, value, rate, half, breaks: false }.tightened()
    }

    /// Returns a smooth function of this number, given its value at the middle and the ranges of
    /// its values and of its derivative.
    fn chain(self, middle: f64, value: OutwardInterval, slope: OutwardInterval) -> Span {
        let still = self.rate == OutwardInterval::point(0.0);
        let rate = if still { self.rate } else { slope.times(self.rate) };
        let error = rounded(middle, [(slope.magnitude(), self.error), NONE]);
        Span { middle, error, value, rate, ..self }.tightened()
    }

    /// Returns bounds that hold for either of two numbers.
    fn either(self, other: Span, middle: f64) -> Span {
        Span {
            middle,
            error: self.error.max(other.error),
            value: self.value.hull(other.value),
            rate: self.rate.hull(other.rate),
            half: self.half.max(other.half),
            breaks: true,
        }
    }

    /// Tightens the bounds on the value by its value at the middle and the derivative, where it
    /// exists throughout.
    fn tightened(mut self) -> Span {
        let way = (1.0 + ROUNDING) * (self.half * self.rate.magnitude() + self.error);
        if !self.breaks && way.is_finite() && self.middle.is_finite() {
            self.value = self.value.meet(OutwardInterval::of([self.middle - way, self.middle + way]));
        }
        self
    }

    /// Returns a piecewise constant function. Where it cannot jump, its value at the middle is free
    /// of rounding.
    fn stepped(self, middle: f64, value: OutwardInterval) -> Span {
        let breaks = value.low != value.high;
        let middle = if breaks { middle } else { value.low };
        Span { middle, error: 0.0, value, rate: OutwardInterval::point(0.0), breaks, ..self }
    }

    /// Returns a condition, given whether it certainly holds or certainly fails.
    fn condition(self, other: Span, middle: f64, holds: bool, fails: bool) -> Span {
        let value = match (holds, fails) {
            (true, _) => OutwardInterval::point(1.0),
            (_, true) => OutwardInterval::point(0.0),
            _ => OutwardInterval { low: 0.0, high: 1.0 },
        };
        let half = self.half.max(other.half);
        Span { half, ..self }.stepped(middle, value)
    }

    fn broken(mut self) -> Span {
        self.breaks = true;
        self
    }

    /// Marks a kink or pole where a condition holds.
    fn broken_where(self, condition: bool) -> Span {
        if condition && self.rate != OutwardInterval::point(0.0) { self.broken() } else { self }
    }

    fn power(self, exponent: Span, middle: f64) -> Span {
        let still = OutwardInterval::point(0.0);
        if exponent.rate != still {
            // The power u^v is computed as exp(v ln u).
            return exponent.binary(Binary::Multiply, self.unary(Unary::Ln)).unary(Unary::Exp);
        }
        let n = exponent.middle;
        if self.rate == still {
            return Span { middle, error: 0.0, value: OutwardInterval::point(middle), ..self };
        }
        let u = self.value;
        let (value, slope) = if n == 2.0 {
            (u.squared(), u.times(OutwardInterval::point(2.0)))
        } else if n == n.round() && n >= 0.0 {
            let range = |n: f64| {
                let ends = u.map(|u| u.powf(n));
                if u.contains(0.0) { ends.hull(OutwardInterval::point(0.0)) } else { ends }
            };
            let slope = if n == 0.0 { still } else { range(n - 1.0).times(OutwardInterval::point(n)) };
            (if n == 0.0 { OutwardInterval::point(1.0) } else { range(n) }, slope)
        } else if u.low > 0.0 || n == n.round() && u.high < 0.0 {
            (u.map(|u| u.powf(n)), u.map(|u| u.powf(n - 1.0)).times(OutwardInterval::point(n)))
        } else if n > 0.0 && u.low >= 0.0 {
            (u.map(|u| u.powf(n)), ALL)
        } else {
            (ALL, ALL)
        };
        let smooth = n == n.round() && n >= 0.0 || u.low > 0.0 || n == n.round() && u.high < 0.0;
        self.chain(middle, value, slope).broken_where(!smooth)
    }
}

/// Absent operand.
const NONE: (f64, f64) = (0.0, 0.0);

/// Returns a bound on the error of a result, given its value and, for each operand, bounds on its
/// slope and on the operand's error.
fn rounded(value: f64, operands: [(f64, f64); 2]) -> f64 {
    let passed = operands.iter().filter(|(_, error)| *error > 0.0).map(|(slope, error)| 2.0 * slope * error);
    ROUNDING * value.abs() + f64::MIN_POSITIVE + passed.sum::<f64>()
}

impl Number for Span {
    fn constant(value: f64) -> Self {
        let rate = OutwardInterval::point(0.0);
        Span {
            middle: value,
            error: 0.0,
            value: OutwardInterval::point(value),
            rate,
            half: 0.0,
            breaks: false,
        }
    }

    fn unary(self, op: Unary) -> Self {
        let u = self.value;
        let middle = self.middle.unary(op);
        if self.half == 0.0 {
            return Span::constant(middle);
        }
        let monotone = || u.map(|u| u.unary(op));
        let unit = OutwardInterval { low: -1.0, high: 1.0 };
        match op {
            Unary::Negate => Span {
                middle,
                value: OutwardInterval { low: -u.high, high: -u.low },
                rate: OutwardInterval { low: -self.rate.high, high: -self.rate.low },
                ..self
            },
            Unary::Not => self.stepped(middle, OutwardInterval { low: 1.0 - u.high, high: 1.0 - u.low }),
            Unary::Sin => self.chain(middle, u.sine(0.0), u.sine(FRAC_PI_2)),
            Unary::Cos => {
                let slope = u.sine(0.0);
                self.chain(middle, u.sine(FRAC_PI_2), OutwardInterval { low: -slope.high, high: -slope.low })
            }
            Unary::Tan => {
                // There is a pole between two multiples of pi.
                let turn = |u: f64| ((u + FRAC_PI_2) / PI).floor();
                let pole = u.high - u.low >= PI || turn(u.low) != turn(u.high);
                let value = if pole { ALL } else { monotone() };
                let slope = value.squared().plus(OutwardInterval::point(1.0));
                self.chain(middle, value, slope).broken_where(pole)
            }
            Unary::Asin | Unary::Acos => {
                let inside = u.low > -1.0 && u.high < 1.0;
                let value = u.meet(unit).map(|u| u.clamp(-1.0, 1.0).unary(op));
                let slope = if inside {
                    let one = OutwardInterval::point(1.0).minus(u.squared());
                    OutwardInterval::of([1.0 / one.low.max(0.0).sqrt(), 1.0 / one.high.sqrt()])
                } else {
                    ALL
                };
                let slope = if op == Unary::Acos { OutwardInterval::point(0.0).minus(slope) } else { slope };
                self.chain(middle, value, slope).broken_where(!inside)
            }
            Unary::Atan => {
                let slope = OutwardInterval::point(1.0).over(u.squared().plus(OutwardInterval::point(1.0)));
                self.chain(middle, monotone(), slope)
            }
            Unary::Sinh => {
                let slope = OutwardInterval::of([u.low.cosh(), u.high.cosh(), self.middle.cosh()]);
                let slope = if u.contains(0.0) { slope.hull(OutwardInterval::point(1.0)) } else { slope };
                self.chain(middle, monotone(), slope)
            }
            Unary::Cosh => {
                let value = OutwardInterval::of([u.low.cosh(), u.high.cosh()]);
                let value = if u.contains(0.0) { value.hull(OutwardInterval::point(1.0)) } else { value };
                self.chain(middle, value, u.map(f64::sinh))
            }
            Unary::Tanh => {
                let value = monotone();
                self.chain(middle, value, OutwardInterval::point(1.0).minus(value.squared()))
            }
            Unary::Exp => {
                let value = monotone();
                self.chain(middle, value, value)
            }
            Unary::Ln | Unary::Log10 => {
                let scale = if op == Unary::Ln { 1.0 } else { LN_10 };
                let inside = u.low > 0.0;
                let value = if inside { monotone() } else { ALL };
                let slope = if inside { u.map(|u| 1.0 / (u * scale)) } else { ALL };
                self.chain(middle, value, slope).broken_where(!inside)
            }
            Unary::Sqrt => {
                let value = u.map(|u| u.max(0.0).sqrt());
                let slope = if u.low > 0.0 { u.map(|u| 0.5 / u.sqrt()) } else { ALL };
                self.chain(middle, value, slope).broken_where(u.low <= 0.0)
            }
            Unary::Abs if u.low >= 0.0 => self,
            Unary::Abs if u.high <= 0.0 => self.unary(Unary::Negate),
            Unary::Abs => {
                let rate = self.rate.magnitude();
                let value = OutwardInterval { low: 0.0, high: u.magnitude() };
                let rate = OutwardInterval { low: -rate, high: rate };
                Span { middle, value, rate, ..self }.broken_where(true)
            }
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Step => {
                let value = OutwardInterval { low: u.low.unary(op), high: u.high.unary(op) };
                self.stepped(middle, value)
            }
        }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let (u, v) = (self.value, right.value);
        let middle = self.middle.binary(op, right.middle);
        let half = self.half.max(right.half);
        if half == 0.0 {
            return Span::constant(middle);
        }
        let breaks = self.breaks || right.breaks;
        let of = |value: OutwardInterval, rate: OutwardInterval, slopes: [f64; 2]| {
            let error = rounded(middle, [(slopes[0], self.error), (slopes[1], right.error)]);
            Span { middle, error, value, rate, half, breaks }.tightened()
        };
        let still = self.rate == OutwardInterval::point(0.0) && right.rate == OutwardInterval::point(0.0);
        match op {
            Binary::Add => of(u.plus(v), self.rate.plus(right.rate), [1.0, 1.0]),
            Binary::Subtract => of(u.minus(v), self.rate.minus(right.rate), [1.0, 1.0]),
            Binary::Multiply => {
                let rate = self.rate.times(v).plus(u.times(right.rate));
                of(u.times(v), rate, [v.magnitude(), u.magnitude()])
            }
            Binary::Divide => {
                let value = u.over(v);
                let rate = self.rate.minus(value.times(right.rate)).over(v);
                // A varying number divided by one that may be 0 has a pole.
                let pole = v.contains(0.0) && right.rate != OutwardInterval::point(0.0);
                let least = v.least_magnitude();
                let of = of(value, rate, [1.0 / least, value.magnitude() / least]);
                if pole { of.broken() } else { of }
            }
            Binary::Power => self.power(right, middle),
            Binary::Min | Binary::Max => {
                let (less, more) = if op == Binary::Min { (u, v) } else { (v, u) };
                if less.high <= more.low {
                    return self;
                }
                if less.low >= more.high {
                    return right;
                }
                let choose = |a: f64, b: f64| a.binary(op, b);
                let value = OutwardInterval { low: choose(u.low, v.low), high: choose(u.high, v.high) };
                let either = self.either(right, middle);
                Span { value, breaks: breaks || !still, ..either }
            }
            Binary::Hypot => {
                let root = self.binary(Binary::Multiply, self);
                let other = right.binary(Binary::Multiply, right);
                root.binary(Binary::Add, other).unary(Unary::Sqrt)
            }
            Binary::Atan2 => {
                let all = OutwardInterval { low: -PI, high: PI };
                let cut = v.low <= 0.0 && u.contains(0.0) && !still;
                if cut || v.contains(0.0) && u.contains(0.0) {
                    let error = f64::INFINITY;
                    return Span { middle, error, value: all, rate: ALL, half, breaks: breaks || !still };
                }
                let square = u.squared().plus(v.squared());
                let rate = self.rate.times(v).minus(right.rate.times(u)).over(square);
                of(all, rate, [v, u].map(|side| side.magnitude() / square.low))
            }
            Binary::Mod => {
                let turns = self.binary(Binary::Divide, right).unary(Unary::Floor);
                let rest = self.binary(Binary::Subtract, turns.binary(Binary::Multiply, right));
                let bound = OutwardInterval { low: v.low.min(0.0), high: v.high.max(0.0) };
                if rest.breaks { Span { middle, value: bound, ..rest } } else { rest }
            }
            Binary::Less => self.condition(right, middle, u.high < v.low, u.low >= v.high),
            Binary::LessEqual => self.condition(right, middle, u.high <= v.low, u.low > v.high),
            Binary::Greater => self.condition(right, middle, u.low > v.high, u.high <= v.low),
            Binary::GreaterEqual => self.condition(right, middle, u.low >= v.high, u.high < v.low),
            Binary::Equal | Binary::NotEqual => {
                let apart = u.high < v.low || u.low > v.high;
                let same = still && u == v;
                let equal = op == Binary::Equal;
                self.condition(
                    right,
                    middle,
                    if equal { same } else { apart },
                    if equal { apart } else { same },
                )
            }
            Binary::And => {
                let (holds, fails) = (u.low == 1.0 && v.low == 1.0, u.high == 0.0 || v.high == 0.0);
                self.condition(right, middle, holds, fails)
            }
            Binary::Or => {
                let (holds, fails) = (u.low == 1.0 || v.low == 1.0, u.high == 0.0 && v.high == 0.0);
                self.condition(right, middle, holds, fails)
            }
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        if self.value.low == 1.0 {
            return yes;
        }
        if self.value.high == 0.0 {
            return no;
        }
        let half = self.half.max(yes.half).max(no.half);
        Span { half, ..yes.either(no, self.middle.select(yes.middle, no.middle)) }
    }
}
