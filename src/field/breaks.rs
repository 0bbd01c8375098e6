//! Kinks and jumps of functions of time, located to rounding.

use super::span::Span;
use super::{Field, Name, Names, Point, Table, code};

/// An instant at which a function of time jumps, or its rate does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Break {
    /// The instant, in s.
    pub time: f64,
    /// Value after it less that before it.
    pub jump: f64,
    /// Rate after it less that before it, per s; infinite where there is none.
    pub kink: f64,
}

/// Kinks and jumps of a function of time, ascending.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Breaks {
    /// Those found.
    pub found: Vec<Break>,
    /// Whether these are all; else the search ended before `to`.
    pub complete: bool,
}

/// Intervals that a thorough search looks at; some hundred for each kink.
pub const MOST_LOOKS: usize = 200_000;

/// A change of the value, over the largest value seen, that may be rounding of the formula's own numbers, and of its rate.
const ROUNDED: f64 = 1e-6;

/// Suspects side by side after which two branches count as the same for a while: no search by intervals tells them apart.
const SAME_BRANCHES: u32 = 16;
/// Instants at which the branches of the formula are asked for where intervals do not tell.
const SAMPLES: usize = 4096;

impl Field {
    /// The kinks and jumps at a point (m) from one instant to another (s), found in at most so many looks at intervals.
    ///
    /// An interval in which no branch of the formula can change is smooth, by interval arithmetic; any other is halved until
    /// nothing lies between its ends. So none is missed, however the branches are nested. Where that does not tell (two branches have
    /// the same values for a while, or there is too much to look at) the branches taken at many instants are compared, and the breaks
    /// found are not known to be all.
    pub fn breaks(&self, at: Point, from: f64, to: f64, looks: usize) -> Breaks {
        if !self.depends_on(Names::T) || from >= to {
            return Breaks { found: Vec::new(), complete: true };
        }
        let mut stack = Vec::new();
        let least = 4.0 * f64::EPSILON * from.abs().max(to.abs());
        let mut search = Search { from, length: to - from, least, ..Search::default() };
        search.pending.push((from, to));
        while let Some((low, high)) = search.pending.pop() {
            search.looks += 1;
            if search.looks > looks {
                return search.judged(self, at, Some((low, to)));
            }
            search.look(self.span(&mut stack, at, low, high), low, high);
        }
        search.judged(self, at, None)
    }

    /// What can be said of all values at a point between two instants.
    pub(super) fn span(&self, stack: &mut Vec<Span>, at: Point, from: f64, to: f64) -> Span {
        code::run(&self.code, stack, |name| match name {
            Name::X => code::Number::constant(at.x),
            Name::Y => code::Number::constant(at.y),
            Name::T => Span::moving(from, to),
        })
    }
}

#[derive(Default)]
struct Search {
    /// Where it began, and how far it goes, in s.
    from: f64,
    length: f64,
    /// Intervals yet to look at, the first last.
    pending: Vec<(f64, f64)>,
    looks: usize,
    /// Length of an interval that is not halved any more, in s.
    least: f64,
    /// Where breaks may be, ascending.
    suspects: Vec<(f64, f64)>,
    /// How many of the last suspects are side by side.
    adjoining: u32,
    /// Largest value and rate seen.
    largest: f64,
    fastest: f64,
}

/// A formula at an instant.
#[derive(Debug, Clone, Copy)]
struct Sample {
    /// The instant, in s.
    time: f64,
    /// A number that differs across jumps and kinks.
    side: u64,
    value: f64,
}

impl Search {
    fn look(&mut self, span: Span, low: f64, high: f64) {
        if span.middle.is_finite() {
            self.largest = self.largest.max(span.middle.abs());
        }
        // Beside a break too it bounds the rates on both sides.
        let rate = span.rate.magnitude();
        let is_settled = !span.breaks || high - low <= ROUNDED * self.length;
        if is_settled && rate.is_finite() {
            self.fastest = self.fastest.max(rate);
        }
        if !span.breaks {
            return;
        }
        let middle = 0.5 * (low + high);
        let last = self.suspects.last_mut().filter(|(_, end)| low - *end <= 4.0 * self.least);
        let adjoins = last.is_some();
        if let Some((begin, end)) = last
            && high - low <= (*end - *begin).max(self.least)
            && (high - *begin <= ROUNDED * self.length || self.adjoining >= SAME_BRANCHES)
        {
            // Rounding hides where in a neighbourhood the break is: it is not taken apart.
            *end = high;
        } else if high - low <= self.least || middle <= low || middle >= high {
            self.adjoining = if adjoins { self.adjoining + 1 } else { 0 };
            self.suspects.push((low, high));
        } else {
            self.pending.extend([(middle, high), (low, middle)]);
        }
    }

    /// The breaks that the suspects are, those in what was not looked at, if anything was left, included.
    fn judged(mut self, of: &Field, at: Point, left: Option<(f64, f64)>) -> Breaks {
        let tells = |(low, high): &(f64, f64)| high - low <= ROUNDED * self.length;
        let (suspects, untold): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.suspects).into_iter().partition(tells);
        let complete = left.is_none() && untold.is_empty();
        let sought = untold.into_iter().chain(left).flat_map(|(low, high)| self.changes(of, at, low, high));
        let suspects: Vec<(f64, f64)> = suspects.into_iter().chain(sought).collect();
        let mut found: Vec<Break> =
            suspects.into_iter().filter_map(|suspect| self.judge(of, at, suspect)).collect();
        found.sort_by(|a, b| a.time.total_cmp(&b.time));
        Breaks { found, complete }
    }

    /// Where the formula takes another branch, or changes faster than any smooth part of it seen, as far as instants between two
    /// tell: one place at most for each of [`SAMPLES`] intervals.
    fn changes(&self, of: &Field, at: Point, low: f64, high: f64) -> Vec<(f64, f64)> {
        let look = |t: f64| Sample {
            time: t,
            side: of.side(at, t),
            value: of.value(at, t).unwrap_or(f64::INFINITY),
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

    /// The break between two instants next to each other; `None` where value and rate change by no more than rounding.
    fn judge(&self, of: &Field, at: Point, (low, high): (f64, f64)) -> Option<Break> {
        let side = |t: f64| {
            let value = of.value(at, t).unwrap_or(f64::INFINITY);
            (value, of.jet(at, t).map_or(f64::INFINITY, |jet| jet.first))
        };
        let way = self.least.max(high - low);
        let (after, rate_after) = side(high + way);
        // At the start there is a value before, and no rate.
        let starts = low <= self.from;
        let (before, rate_before) =
            if starts { (side(self.from).0, rate_after) } else { side((low - way).max(self.from)) };
        let jump = after - before;
        let kink = if rate_after.is_finite() && rate_before.is_finite() {
            rate_after - rate_before
        } else {
            f64::INFINITY
        };
        // What a smooth function may change by in between is none.
        let smooth = 2.0 * self.fastest * (high - low + 2.0 * way);
        let jumps = jump.is_nan() || jump.abs() > ROUNDED * self.largest + smooth;
        let kinks = kink.abs() > ROUNDED * self.fastest;
        let time = if starts { self.from } else { shortest(low - way, high + way) };
        (jumps || kinks).then_some(Break { time, jump: if jumps { jump } else { 0.0 }, kink })
    }
}

/// The number of fewest digits between two.
fn shortest(low: f64, high: f64) -> f64 {
    let middle = 0.5 * (low + high);
    let rounded = (0..17).filter_map(|digits| format!("{middle:.digits$e}").parse::<f64>().ok());
    rounded.into_iter().find(|time| (low..=high).contains(time)).unwrap_or(middle)
}

impl Table {
    /// The kinks from one instant to another (s): those at the rows, where the lines between them change their slopes.
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
        let found = rows.map(kink).filter(|of| of.kink.abs() > ROUNDED * steepest).collect();
        Breaks { found, complete: true }
    }
}
