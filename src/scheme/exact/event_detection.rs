//! Event detection: finds the next event and certifies that none occurs before it.
//!
//! # Certification
//!
//! Each watched quantity is `$y(t) = c + \sum_k P_k q_k(t)$`, a sum of sinusoids of known
//! amplitudes `$A_k$` and frequencies `$w_k$`. On an interval of length h, with s in [0, 1], let H
//! be the cubic Hermite interpolant of y, and e = y - H. For each mode, with x = w h,
//!
//! ```math
//! |e| \le A\,\kappa(x)\, s^2 (1-s)^2, \qquad |h e'| \le A\,\kappa(x), \qquad
//!    \kappa(x) = \min\bigl(x^4 / 24,\; 2 (x^2 + 6 x + 12)\bigr).
//! ```
//!
//! The first bound is the remainder of Hermite interpolation,
//! `$y''''(\xi)\, h^4 s^2 (1-s)^2 / 24$`, with `$|e''| \le h^2 \max |y''''| / 12$` for the slope
//! (Birkhoff and Priver 1967). The second holds where the mode is too fast for the interval:
//! `$|h^2 e''| \le (x^2 + 6 x + 12) A$`, the sum of the bounds on y'' and H'', and e and e' vanish
//! at both ends. Rigid motions are quadratic, and H is exact for them.
//!
//! In Bernstein form of degree four the remainder changes the middle coefficient only, by at most
//! D/6, where D is the sum of `$|P_k| A_k \kappa$`. If all five coefficients stay inside the limit,
//! so does y on the whole interval, also where it starts on the limit. Otherwise, if all three
//! coefficients of h H' are below -D, y decreases strictly and crosses the limit once, and the
//! crossing is located to rounding. Otherwise the interval is halved. With damping, w is a mode's
//! growth factor of derivatives ([`ModalSolution::derivative_growth`]), and rigid motions, which
//! tend to uniform ones, have a remainder too. Where damping couples the modes, y depends on their
//! rates as well, which adds w times the coefficient of a rate to `$|P_k|$`. Each interval costs
//! one evaluation; after a certified interval the next may be twice as long.
//!
//! Limits are met to `roundings` times the rounding error of y, so that a plate resting on an
//! obstacle does not chatter.

use super::motion::ModalSolution;
use crate::archive::Archive;
use crate::error::Result;
use crate::vi::BoundStatus;
use faer::Mat;
use std::collections::HashMap;

/// Level of the interval length, 2^level strides, below which an undecided interval counts as an
/// event at its start.
const SHORTEST: i32 = -80;

/// Distance from a limit, relative to the slack, below which a quantity counts as at the limit.
const ZERO: f64 = 1.0 / 32.0;

/// Event search along one motion.
#[derive(Debug)]
pub(super) struct EventSearch {
    /// Distance by which each quantity may violate its limits, from rounding.
    slack: Vec<f64>,
    /// Time of the next event (s) and its candidate, once found.
    pub next: Option<(f64, usize)>,
    /// Sample before which no event occurs.
    certified: Sample,
    /// Samples beyond it, nearest last, each with the level of the interval that it ends.
    pending: Vec<(Sample, i32)>,
    /// Level of the next interval, whose length is 2^level strides.
    pub level: i32,
    stride: f64,
    /// Remainders D of each quantity, by level.
    remainders: HashMap<i32, Vec<f64>>,
    /// Work space for q, q'.
    state: Mat<f64>,
    /// Number of evaluations of all watched quantities.
    pub evaluations: u64,
}

/// Watched quantities at an instant: values and rates (columns).
#[derive(Debug)]
struct Sample {
    at: f64,
    values: Mat<f64>,
}

/// Result of the test of one limit on an interval.
enum Finding {
    Inside,
    Crosses,
    Unclear,
}

impl EventSearch {
    /// Starts a search along a motion, with a stride in units of 1/w of the fastest mode, at the
    /// interval length `level`.
    pub fn new(motion: &ModalSolution, stride: f64, roundings: f64, level: i32) -> EventSearch {
        let modes = &motion.modes;
        let mut slack = motion.weighted(|k| motion.magnitude(k));
        for (slack, offset) in slack.iter_mut().zip(&modes.offset) {
            *slack = roundings * f64::EPSILON * (*slack + offset.abs());
        }
        let fastest = modes.frequencies.last().copied().filter(|w| *w > 0.0).unwrap_or(1.0);
        let mut search = EventSearch {
            slack,
            next: None,
            certified: Sample { at: 0.0, values: Mat::zeros(0, 0) },
            pending: Vec::new(),
            level,
            stride: stride / fastest,
            remainders: HashMap::new(),
            state: Mat::zeros(modes.frequencies.len(), 2),
            evaluations: 0,
        };
        search.certified = search.sample(motion, 0.0);
        // The start respects the limits up to the rounding of its computation.
        for i in 0..search.slack.len() {
            let missed = -search.depth(motion, i, &search.certified);
            search.slack[i] = search.slack[i].max(2.0 * missed);
        }
        search
    }

    /// Saves or restores the progress of the search along its motion; samples are evaluated anew.
    pub fn archive(&mut self, motion: &ModalSolution, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.next)?;
        archive.value(&mut self.level)?;
        let mut pending: Vec<(f64, i32)> =
            self.pending.iter().map(|(sample, level)| (sample.at, *level)).collect();
        let (mut certified, mut evaluations) = (self.certified.at, self.evaluations);
        archive.value(&mut certified)?;
        archive.value(&mut pending)?;
        archive.value(&mut evaluations)?;
        if !archive.saves() {
            self.certified = self.sample(motion, certified);
            self.pending =
                pending.into_iter().map(|(time, level)| (self.sample(motion, time), level)).collect();
            self.evaluations = evaluations;
        }
        Ok(())
    }

    fn sample(&mut self, motion: &ModalSolution, time: f64) -> Sample {
        let mut values = Mat::zeros(motion.modes.sides.len(), 2);
        motion.state(time, &mut self.state);
        motion.watch(&self.state, &mut values);
        self.evaluations += 1;
        Sample { at: time, values }
    }

    /// Returns the candidates whose quantity is at a limit at an instant, given its values there,
    /// with the side of that limit.
    pub fn at_limit(&self, motion: &ModalSolution, values: &Mat<f64>) -> Vec<(usize, BoundStatus)> {
        let mut limited = Vec::new();
        for (i, &side) in motion.modes.sides.iter().enumerate() {
            let [lower, upper] = motion.modes.limits[i];
            let (y, slack) = (values[(i, 0)], self.slack[i]);
            match side {
                BoundStatus::Free if y <= lower + slack => limited.push((i, BoundStatus::Lower)),
                BoundStatus::Free if y >= upper - slack => limited.push((i, BoundStatus::Upper)),
                BoundStatus::Lower if y <= lower + slack => limited.push((i, BoundStatus::Lower)),
                BoundStatus::Upper if y >= upper - slack => limited.push((i, BoundStatus::Upper)),
                _ => {}
            }
        }
        limited
    }

    /// Searches for the next event until it is found, or certified not to occur before an instant.
    pub fn extend(&mut self, motion: &ModalSolution, until: f64) {
        while self.next.is_none() && self.certified.at < until {
            if self.pending.is_empty() {
                let end = self.certified.at + self.length(self.level);
                let sample = self.sample(motion, end);
                self.pending.push((sample, self.level));
            }
            self.examine(motion);
        }
    }

    fn length(&self, level: i32) -> f64 {
        self.stride * 2.0_f64.powi(level)
    }

    /// Certifies the interval up to the nearest pending sample, finds the event in it, or halves
    /// it.
    fn examine(&mut self, motion: &ModalSolution) {
        let Some((end, level)) = self.pending.pop() else { return };
        if end.at <= self.certified.at || level < SHORTEST {
            // The interval is as short as rounding allows: the quantity nearest to leaving its
            // limits does so now.
            let worst = (0..self.slack.len()).min_by(|&i, &j| {
                (self.depth(motion, i, &end) / self.slack[i])
                    .total_cmp(&(self.depth(motion, j, &end) / self.slack[j]))
            });
            self.next = worst.map(|i| (self.certified.at, i));
            return;
        }
        if !self.remainders.contains_key(&level) {
            let h = self.length(level);
            let remainder = motion.weighted(|k| motion.amplitude(k) * kappa(motion.derivative_growth(k) * h));
            self.remainders.insert(level, remainder);
        }
        let mut crossings = Vec::new();
        for i in 0..self.slack.len() {
            for (sign, limit) in finite_limits(motion, i) {
                match self.find(i, sign, limit, level, &end) {
                    Finding::Inside => {}
                    Finding::Crosses => crossings.push((i, sign, limit)),
                    Finding::Unclear => {
                        let middle = self.certified.at + self.length(level - 1);
                        self.pending.push((end, level - 1));
                        let middle = self.sample(motion, middle);
                        self.pending.push((middle, level - 1));
                        return;
                    }
                }
            }
        }
        let zeros =
            crossings.into_iter().map(|(i, sign, limit)| (self.zero(motion, i, sign, limit, end.at), i));
        self.next = zeros.min_by(|a, b| a.0.total_cmp(&b.0));
        if self.next.is_none() {
            self.level = if self.pending.is_empty() { level + 1 } else { level };
            self.certified = end;
        }
    }

    /// Returns the distance to the nearest limit at a sample, positive inside.
    fn depth(&self, motion: &ModalSolution, i: usize, sample: &Sample) -> f64 {
        let y = sample.values[(i, 0)];
        finite_limits(motion, i).map(|(sign, limit)| sign * (y - limit)).fold(f64::INFINITY, f64::min)
    }

    /// Tests one limit on an interval; see the [module page](self).
    fn find(&self, i: usize, sign: f64, limit: f64, level: i32, end: &Sample) -> Finding {
        let (a, b) = (&self.certified.values, &end.values);
        let h = end.at - self.certified.at;
        let (f0, f1) = (sign * (a[(i, 0)] - limit), sign * (b[(i, 0)] - limit));
        let (d0, d1) = (sign * h * a[(i, 1)], sign * h * b[(i, 1)]);
        let remainder = self.remainders[&level][i];
        let middle = 0.5 * (f0 + f1) + (d0 - d1) / 6.0 - remainder / 6.0;
        let least = f0.min(f0 + 0.25 * d0).min(middle).min(f1 - 0.25 * d1).min(f1);
        let slowest = d0.max(3.0 * (f1 - f0) - d0 - d1).max(d1);
        if least >= -self.slack[i] {
            Finding::Inside
        } else if f0 < -self.slack[i] || (f1 < 0.0 && slowest < -remainder) {
            Finding::Crosses
        } else {
            Finding::Unclear
        }
    }

    /// Returns the instant at which a decreasing quantity crosses its limit, to rounding, by
    /// Newton's method within the bracket.
    fn zero(&mut self, motion: &ModalSolution, i: usize, sign: f64, limit: f64, end: f64) -> f64 {
        let (mut inside, mut outside) = (self.certified.at, end);
        let state = &mut self.state;
        let mut time = inside;
        loop {
            motion.state(time, state);
            let [value, rate] = motion.watch_one(i, limit, state);
            if sign * value >= 0.0 {
                inside = time
            } else {
                outside = time
            }
            let newton = time - value / rate;
            if time == outside && outside == self.certified.at {
                break; // The quantity is outside from the start.
            }
            let next = if newton > inside && newton < outside { newton } else { 0.5 * (inside + outside) };
            let settled = value.abs() <= ZERO * self.slack[i] || (newton - time).abs() <= f64::EPSILON * time;
            if settled || next <= inside || next >= outside {
                break;
            }
            time = next;
        }
        time
    }
}

/// Returns the remainder bound kappa(x); see the [module page](self).
fn kappa(x: f64) -> f64 {
    (x.powi(4) / 24.0).min(2.0 * (x * x + 6.0 * x + 12.0))
}

/// Returns the finite limits of a quantity, each with the sign for which `sign (y - limit) >= 0` is
/// inside.
fn finite_limits(motion: &ModalSolution, i: usize) -> impl Iterator<Item = (f64, f64)> + use<> {
    let [lower, upper] = motion.modes.limits[i];
    [(1.0, lower), (-1.0, upper)].into_iter().filter(|(_, limit)| limit.is_finite())
}
