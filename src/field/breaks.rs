//! Kinks and jumps of functions of time, located to rounding.

use super::code::Stack;
use super::{Enclosure, Field, Name, Names, Point, Table, code};

/// Instant at which a function of time or its derivative jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Break {
    /// Time, in s.
    pub time: f64,
    /// Value just after the instant less the value just before.
    pub jump: f64,
    /// Derivative just after the instant less the derivative just before, per s; infinite where
    /// there is none.
    pub kink: f64,
}

/// Kinks and jumps of a function of time, in ascending order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Breaks {
    /// Kinks and jumps found.
    pub found: Vec<Break>,
    /// Whether `found` is known to be complete; otherwise part of it comes from a comparison of
    /// single instants, which may miss some.
    pub complete: bool,
}

/// Number of intervals that a thorough search evaluates; about a hundred per kink.
pub const MOST_LOOKS: usize = 200_000;

/// Change of the value or of the derivative, relative to the largest seen, that may be rounding of
/// the formula's numbers.
const ROUNDED: f64 = 1e-6;

/// Number of adjacent suspect intervals from which two branches are taken to coincide over a time:
/// interval arithmetic cannot distinguish them.
const SAME_BRANCHES: u32 = 16;
/// Number of instants at which branches are compared where interval arithmetic is not conclusive.
const SAMPLES: usize = 4096;

impl Field {
    /// Returns the kinks and jumps at a point (m) between two instants (s), with at most `looks`
    /// evaluations of intervals.
    ///
    /// By interval arithmetic the formula is smooth in an interval in which no branch can change;
    /// any other interval is halved until no number lies between its ends. No break is missed,
    /// however the branches are nested. Where this is not conclusive (two branches coincide over a
    /// time, or there are too many intervals) the branches taken at many instants are compared, and
    /// the breaks found may be incomplete.
    pub fn breaks(&self, point: Point, from: f64, to: f64, looks: usize) -> Breaks {
        if !self.depends_on(Names::T) || from >= to {
            return Breaks { found: Vec::new(), complete: true };
        }
        let mut stack = Stack::new();
        let least = 4.0 * f64::EPSILON * from.abs().max(to.abs());
        let mut search = Search { from, length: to - from, least, ..Search::default() };
        search.pending.push((from, to));
        while let Some((low, high)) = search.pending.pop() {
            search.looks += 1;
            if search.looks > looks {
                return search.judged(self, point, Some((low, to)));
            }
            search.look(self.span(&mut stack, point, low, high), low, high);
        }
        search.judged(self, point, None)
    }

    /// Returns bounds on value and derivative at a point between two instants (s).
    pub(super) fn span(
        &self,
        stack: &mut Stack<Enclosure<1>>,
        point: Point,
        from: f64,
        to: f64,
    ) -> Enclosure<1> {
        code::run(&self.code, stack, |name| match name {
            Name::X => code::Number::constant(point.x),
            Name::Y => code::Number::constant(point.y),
            Name::T => Enclosure::variable(0, from, to),
            Name::W => code::Number::constant(super::FLAT),
        })
    }
}

#[derive(Default)]
struct Search {
    /// Start and length of the search, in s.
    from: f64,
    length: f64,
    /// Intervals still to evaluate, the first one last.
    pending: Vec<(f64, f64)>,
    looks: usize,
    /// Length at which intervals are no longer halved, in s.
    least: f64,
    /// Intervals that may contain breaks, ascending.
    suspects: Vec<(f64, f64)>,
    /// Number of the last suspects that are adjacent.
    adjoining: u32,
    /// Largest value and derivative seen.
    largest: f64,
    fastest: f64,
}

/// Sample of a formula at an instant.
#[derive(Debug, Clone, Copy)]
struct Sample {
    /// Time, in s.
    time: f64,
    /// Number that differs across jumps and kinks.
    side: u64,
    value: f64,
}

impl Search {
    fn look(&mut self, span: Enclosure<1>, low: f64, high: f64) {
        if span.middle.is_finite() {
            self.largest = self.largest.max(span.middle.abs());
        }
        // Next to a break this still bounds the derivatives on both sides.
        let middle = 0.5 * (low + high);
        let rate = span.slope[0].magnitude() / (middle - low).max(high - middle);
        let is_settled = !span.breaks() || high - low <= ROUNDED * self.length;
        if is_settled && rate.is_finite() {
            self.fastest = self.fastest.max(rate);
        }
        if !span.breaks() {
            return;
        }
        let last = self.suspects.last_mut().filter(|(_, end)| low - *end <= 4.0 * self.least);
        let adjoins = last.is_some();
        if let Some((begin, end)) = last
            && high - low <= (*end - *begin).max(self.least)
            && (high - *begin <= ROUNDED * self.length || self.adjoining >= SAME_BRANCHES)
        {
            // Rounding hides where in this neighbourhood the break is, so the interval is not
            // halved.
            *end = high;
        } else if high - low <= self.least || middle <= low || middle >= high {
            self.adjoining = if adjoins { self.adjoining + 1 } else { 0 };
            self.suspects.push((low, high));
        } else {
            self.pending.extend([(middle, high), (low, middle)]);
        }
    }

    /// Returns the breaks in the suspect intervals and, if the search ended early, those found in
    /// the rest.
    fn judged(mut self, formula: &Field, point: Point, rest: Option<(f64, f64)>) -> Breaks {
        let tells = |(low, high): &(f64, f64)| high - low <= ROUNDED * self.length;
        let (suspects, untold): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.suspects).into_iter().partition(tells);
        let complete = rest.is_none() && untold.is_empty();
        let sought =
            untold.into_iter().chain(rest).flat_map(|(low, high)| self.changes(formula, point, low, high));
        let suspects: Vec<(f64, f64)> = suspects.into_iter().chain(sought).collect();
        let mut breaks: Vec<Break> =
            suspects.into_iter().filter_map(|suspect| self.judge(formula, point, suspect)).collect();
        breaks.sort_by(|a, b| a.time.total_cmp(&b.time));
        Breaks { found: breaks, complete }
    }

    /// Returns intervals in which the formula changes its branch, or changes faster than in any
    /// smooth part, as far as a comparison of instants shows: at most one per each of [`SAMPLES`]
    /// intervals.
    fn changes(&self, formula: &Field, point: Point, low: f64, high: f64) -> Vec<(f64, f64)> {
        let look = |t: f64| Sample {
            time: t,
            side: formula.side(point, t),
            value: formula.value(point, t).unwrap_or(f64::INFINITY),
        };
        let leaps =
            |a: &Sample, b: &Sample| (b.value - a.value).abs() > 2.0 * self.fastest * (b.time - a.time);
        let samples: Vec<Sample> =
            (0..=SAMPLES).map(|k| look(low + (high - low) * k as f64 / SAMPLES as f64)).collect();
        let change = |pair: &[Sample]| {
            let [mut a, mut b] = [pair[0], pair[1]];
            if a.side == b.side && !leaps(&a, &b) {
                return None;
            }
            loop {
                let middle = 0.5 * (a.time + b.time);
                if b.time - a.time <= self.least || middle <= a.time || middle >= b.time {
                    return Some((a.time, b.time));
                }
                let middle = look(middle);
                let first = if leaps(&a, &b) {
                    (middle.value - a.value).abs() >= (b.value - middle.value).abs()
                } else {
                    middle.side != a.side
                };
                if first { b = middle } else { a = middle }
            }
        };
        samples.windows(2).filter_map(change).collect()
    }

    /// Returns the break between two adjacent instants; `None` where value and derivative change by
    /// no more than rounding.
    fn judge(&self, formula: &Field, point: Point, (low, high): (f64, f64)) -> Option<Break> {
        let side = |t: f64| {
            let value = formula.value(point, t).unwrap_or(f64::INFINITY);
            (value, formula.jet(point, t).map_or(f64::INFINITY, |jet| jet.first))
        };
        let way = self.least.max(high - low);
        let (after, rate_after) = side(high + way);
        // At the start there is a value before, and no derivative.
        let starts = low <= self.from;
        let (before, rate_before) =
            if starts { (side(self.from).0, rate_after) } else { side((low - way).max(self.from)) };
        let jump = after - before;
        let kink = if rate_after.is_finite() && rate_before.is_finite() {
            rate_after - rate_before
        } else {
            f64::INFINITY
        };
        // Changes that a smooth function can make in between are no jumps.
        let smooth = 2.0 * self.fastest * (high - low + 2.0 * way);
        let jumps = jump.is_nan() || jump.abs() > ROUNDED * self.largest + smooth;
        let kinks = kink.abs() > ROUNDED * self.fastest;
        let time = if starts { self.from } else { shortest(low - way, high + way) };
        (jumps || kinks).then_some(Break { time, jump: if jumps { jump } else { 0.0 }, kink })
    }
}

/// Returns the number with the fewest digits between two.
fn shortest(low: f64, high: f64) -> f64 {
    let middle = 0.5 * (low + high);
    let rounded = (0..17).filter_map(|digits| format!("{middle:.digits$e}").parse::<f64>().ok());
    rounded.into_iter().find(|time| (low..=high).contains(time)).unwrap_or(middle)
}

impl Table {
    /// Returns the kinks between two instants (s): the rows at which the slopes of the lines
    /// change.
    pub fn breaks(&self, from: f64, to: f64) -> Breaks {
        let rows = self.times.iter().filter(|time| (from..=to).contains(*time));
        let kink = |&time: &f64| {
            let after = self.times.partition_point(|row| *row < time);
            let before = after.checked_sub(1).and_then(|piece| self.pieces.get(piece));
            let h = before.map_or(0.0, |_| time - self.times[after - 1]);
            let slope = before.map_or(0.0, |[_, b, c, d]| b + h * (2.0 * c + 3.0 * h * d));
            Break { time, jump: 0.0, kink: self.jet(time).first - slope }
        };
        let steepest = self.pieces.iter().fold(0.0, |m: f64, piece| m.max(piece[1].abs()));
        let kinks = rows.map(kink).filter(|row| row.kink.abs() > ROUNDED * steepest).collect();
        Breaks { found: kinks, complete: true }
    }
}
