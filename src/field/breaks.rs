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

impl Field {
    /// The kinks and jumps at a point (m) from one instant to another (s), found in at most so many looks at intervals.
    ///
    /// An interval in which no branch of the formula can change is smooth, by interval arithmetic; any other is halved until
    /// nothing lies between its ends. So none is missed, however the branches are nested.
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
                return search.judged(self, at, false);
            }
            search.look(self.span(&mut stack, at, low, high), low, high);
        }
        search.judged(self, at, true)
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
    /// Largest value and rate seen.
    largest: f64,
    fastest: f64,
}

impl Search {
    fn look(&mut self, span: Span, low: f64, high: f64) {
        if span.middle.is_finite() {
            self.largest = self.largest.max(span.middle.abs());
        }
        if !span.breaks {
            let rate = span.rate.magnitude();
            if rate.is_finite() {
                self.fastest = self.fastest.max(rate);
            }
            return;
        }
        let middle = 0.5 * (low + high);
        let last = self.suspects.last_mut().filter(|(_, end)| low - *end <= 4.0 * self.least);
        if let Some((begin, end)) = last
            && high - low <= (*end - *begin).max(self.least)
        {
            // Rounding hides where in a neighbourhood the break is: it is not taken apart.
            *end = high;
        } else if high - low <= self.least || middle <= low || middle >= high {
            self.suspects.push((low, high));
        } else {
            self.pending.extend([(middle, high), (low, middle)]);
        }
    }

    /// The breaks that the suspects are: those across which value or rate change by more than rounding.
    fn judged(self, of: &Field, at: Point, complete: bool) -> Breaks {
        // Where two branches are the same throughout, no break can be told from none.
        let told = |(low, high): &&(f64, f64)| high - low <= ROUNDED * self.length;
        let complete = complete && self.suspects.iter().all(|suspect| told(&suspect));
        let found = self.suspects.iter().filter(told).filter_map(|&(low, high)| {
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
            let jumps = jump.is_nan() || jump.abs() > ROUNDED * self.largest;
            let kinks = kink.abs() > ROUNDED * self.fastest;
            let time = if starts { self.from } else { shortest(low - way, high + way) };
            (jumps || kinks).then_some(Break { time, jump: if jumps { jump } else { 0.0 }, kink })
        });
        Breaks { found: found.collect(), complete }
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
