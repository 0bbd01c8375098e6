//! Detection of functions of time that the time steps do not resolve.

use super::code::{Binary, Number, Stack};
use super::{Enclosure, Field, Interval, NOTHING, Names, Point, Table};
use std::collections::VecDeque;

/// Worst resolution of a function by the values at the ends of the time steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Missed {
    /// End of the step with the largest error, in s.
    pub time: f64,
    /// Error of the integral, relative to the integral of the magnitude, over [`WINDOW`] steps
    /// around it.
    pub share: f64,
}

/// Number of steps that are judged together.
pub const WINDOW: u64 = 3 * BLOCK;
const BLOCK: u64 = 10;
/// Least relative error that is reported.
pub const TOLD: f64 = 0.1;
/// Errors are not reported below this fraction of the largest value over as many steps.
const LITTLE: f64 = 1e-3;

/// Largest numbers of spans of steps that are bounded, and of blocks of steps that are integrated.
const MOST_LOOKS: usize = 40_000;
const MOST_BLOCKS: usize = 600;
/// Largest number of subintervals that the integral over one time step is divided into.
const MOST_PARTS: usize = 400;
/// Largest number of times that one such subinterval is halved.
const MOST_HALVINGS: u32 = 40;
/// Error of a part's integral relative to that of its magnitude.
const CLOSE: f64 = 1e-3;

/// Function of time with known bounds over any interval.
trait Bounded {
    fn value(&self, t: f64) -> f64;
    fn span(&self, from: f64, to: f64) -> Enclosure<1>;
}

struct At<'f>(&'f Field, Point);

impl Bounded for At<'_> {
    fn value(&self, t: f64) -> f64 {
        self.0.value(self.1, t).unwrap_or(f64::NAN)
    }

    fn span(&self, from: f64, to: f64) -> Enclosure<1> {
        self.0.span(&mut Stack::new(), self.1, from, to)
    }
}

impl Bounded for Table {
    fn value(&self, t: f64) -> f64 {
        Table::value(self, t)
    }

    /// Returns the hull of the cubics between the rows, from their coefficients.
    fn span(&self, from: f64, to: f64) -> Enclosure<1> {
        let middle = Table::value(self, 0.5 * (from + to));
        let first = self.times.partition_point(|time| *time <= from);
        let last = self.times.partition_point(|time| *time < to);
        let ends = [from, to].map(|t| self.jet(t));
        let mut value = Interval::of(ends.map(|jet| jet.value));
        let mut rate = Interval::of(ends.map(|jet| jet.first));
        for piece in first.saturating_sub(1)..last.min(self.pieces.len()) {
            let [a, b, c, d] = self.pieces[piece];
            let low = (from - self.times[piece]).max(0.0);
            let high = to.min(self.times[piece + 1]) - self.times[piece];
            let turn = if d == 0.0 { low } else { (-c / (3.0 * d)).clamp(low, high) };
            let slope = |s: f64| b + s * (2.0 * c + s * 3.0 * d);
            rate = rate.hull(Interval::of([low, high, turn].map(slope)));
            let cubic = |s: f64| a + s * (b + s * (c + s * d));
            let way = 0.5 * (high - low) * rate.magnitude();
            let centre = cubic(0.5 * (low + high));
            value = value.hull(Interval::of([centre - way, centre + way]));
        }
        Enclosure::smooth(middle, value, [rate.times(Interval::point(0.5 * (to - from)))])
    }
}

impl Field {
    /// Returns bounds on the values at a point (m) between two instants (s).
    pub fn range(&self, point: Point, from: f64, to: f64) -> Interval {
        At(self, point).span(from, to).value
    }

    /// Returns where steps from 0 on resolve the values, less a number, worst at a point (m);
    /// `None` where they resolve nearly all.
    pub fn missed(&self, point: Point, less: f64, step: f64, steps: u64) -> Option<Missed> {
        let depends = self.depends_on(Names::T);
        depends.then(|| missed(&Less { of: &At(self, point), less }, step, steps)).flatten()
    }
}

impl Table {
    /// Returns bounds on the values between two instants (s).
    pub fn range(&self, from: f64, to: f64) -> Interval {
        Bounded::span(self, from, to).value
    }

    /// Returns where steps resolve the values worst, like [`Field::missed`].
    pub fn missed(&self, less: f64, step: f64, steps: u64) -> Option<Missed> {
        missed(&Less { of: self, less }, step, steps)
    }
}

/// Function less a constant.
struct Less<'f> {
    of: &'f dyn Bounded,
    less: f64,
}

impl Bounded for Less<'_> {
    fn value(&self, t: f64) -> f64 {
        self.of.value(t) - self.less
    }

    fn span(&self, from: f64, to: f64) -> Enclosure<1> {
        self.of.span(from, to).binary(Binary::Subtract, Enclosure::constant(self.less))
    }
}

/// Bounds spans of blocks, the longest first, and integrates the blocks in which the error may be
/// large.
///
/// The error of the trapezoidal rule over a step dt is at most dt^2 / 8 times the range of the
/// derivative. The work is bounded for any number of steps: of a function with too many blocks to
/// bound, blocks spread over the whole time are integrated.
fn missed(function: &dyn Bounded, step: f64, steps: u64) -> Option<Missed> {
    let blocks = steps.div_ceil(BLOCK);
    let instant = |block: u64| (block * BLOCK).min(steps) as f64 * step;
    let mut pending = VecDeque::from([(0, blocks)]);
    let (mut doubtful, mut largest, mut looks) = (Vec::new(), 0.0_f64, 0);
    while let Some((first, end)) = pending.pop_front() {
        looks += 1;
        if looks > MOST_LOOKS {
            doubtful.push(first + (end - first) / 2);
            continue;
        }
        let span = function.span(instant(first), instant(end));
        if span.middle.is_finite() {
            largest = largest.max(span.middle.abs());
        }
        let least = span.value.least_magnitude();
        let half = 0.5 * (instant(end) - instant(first));
        let most = if span.breaks() { f64::INFINITY } else { 0.125 * step * span.slope[0].width() / half };
        if span.value.magnitude() <= NOTHING {
            continue;
        }
        if most <= 0.5 * TOLD * least || most.min(2.0 * span.value.magnitude()) <= LITTLE * largest {
            continue;
        }
        if end - first == 1 {
            doubtful.push(first);
            continue;
        }
        let middle = first + (end - first) / 2;
        pending.extend([(first, middle), (middle, end)]);
    }
    doubtful.sort_unstable();
    let every = doubtful.len().div_ceil(MOST_BLOCKS).max(1);
    let mut sums = Sums { of: function, step, steps, known: Vec::new() };
    let mut worst: Option<Missed> = None;
    let mut most = 0.0_f64;
    let judged: Vec<_> = doubtful.iter().step_by(every).map(|&block| (block, sums.judged(block))).collect();
    for (_, judged) in &judged {
        most = most.max(judged.impulse);
    }
    for (_, Judged { share, missed, time, .. }) in judged {
        let is_worst = worst.is_none_or(|worst| share > worst.share);
        if share > TOLD && missed > LITTLE * most && is_worst {
            worst = Some(Missed { time, share });
        }
    }
    worst
}

/// Integrals over blocks, each computed once while its neighbours need it.
struct Sums<'f> {
    of: &'f dyn Bounded,
    step: f64,
    steps: u64,
    /// Most recent blocks.
    known: Vec<(u64, Sum)>,
}

/// Integrals over the steps of a block.
#[derive(Clone, Copy, Default)]
struct Sum {
    /// Integral of the magnitude.
    impulse: f64,
    /// Sum of the magnitudes of the errors of the steps, the largest of them, and the end of that
    /// step.
    missed: f64,
    most: f64,
    time: f64,
}

struct Judged {
    impulse: f64,
    missed: f64,
    share: f64,
    time: f64,
}

impl Sums<'_> {
    /// Returns the error of a block relative to its neighbourhood, in the window where it is
    /// smallest: the edge of a long load is negligible beside the load.
    fn judged(&mut self, block: u64) -> Judged {
        let around: Vec<Sum> =
            (0..5).map(|k| (block + k).checked_sub(2)).map(|block| self.sum(block)).collect();
        let Sum { missed, time, .. } = around[2];
        let mut judged = Judged { impulse: 0.0, missed, share: f64::INFINITY, time };
        for window in around.windows(3) {
            let total = |part: fn(&Sum) -> f64| window.iter().map(part).sum::<f64>();
            let (impulse, missed) = (total(|sum| sum.impulse), total(|sum| sum.missed));
            judged.impulse = judged.impulse.max(impulse);
            // Functions that vanish have no error.
            judged.share = judged.share.min(if missed > 0.0 { missed / impulse } else { 0.0 });
        }
        judged
    }

    fn sum(&mut self, block: Option<u64>) -> Sum {
        let Some(block) = block.filter(|block| block * BLOCK < self.steps) else { return Sum::default() };
        if let Some((_, sum)) = self.known.iter().find(|(number, _)| *number == block) {
            return *sum;
        }
        let mut sum = Sum::default();
        for n in block * BLOCK..((block + 1) * BLOCK).min(self.steps) {
            let [from, to] = [n, n + 1].map(|n| n as f64 * self.step);
            let [integral, magnitude] = integral(self.of, from, to);
            let seen = 0.5 * self.step * (self.of.value(from) + self.of.value(to));
            let missed = (integral - seen).abs();
            sum.impulse += magnitude;
            sum.missed += missed;
            if missed > sum.most {
                (sum.most, sum.time) = (missed, to);
            }
        }
        if self.known.len() >= 5 {
            self.known.remove(0);
        }
        self.known.push((block, sum));
        sum
    }
}

/// Returns the integrals of a function and of its magnitude, by halving where its derivative
/// changes.
fn integral(function: &dyn Bounded, from: f64, to: f64) -> [f64; 2] {
    let mut pending = VecDeque::from([(from, to, 0)]);
    let [mut sum, mut magnitude] = [0.0, 0.0];
    let mut parts = 0;
    while let Some((low, high, halvings)) = pending.pop_front() {
        let span = function.span(low, high);
        let length = high - low;
        parts += 1;
        let error = if span.breaks() { f64::INFINITY } else { 0.25 * span.slope[0].width() };
        let scale = span.middle.abs().max(magnitude / (to - from));
        let still = span.value.magnitude() <= NOTHING;
        if still || error <= CLOSE * scale || halvings == MOST_HALVINGS || parts > MOST_PARTS {
            sum += length * span.middle;
            magnitude += length * span.middle.abs();
            continue;
        }
        let middle = 0.5 * (low + high);
        pending.extend([(low, middle, halvings + 1), (middle, high, halvings + 1)]);
    }
    [sum, magnitude]
}
