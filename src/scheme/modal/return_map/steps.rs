//! Steps of the return map, divided where contacts begin and end.

use super::super::limits::Limits;
use super::super::state::kick;
use super::variation::Variation;
use super::{Phase, ReturnMap};
use crate::linalg::vectors::{axpy, dot};
use crate::membrane::Stretch;
use faer::Mat;
use faer::linalg::solvers::Solve;
use std::borrow::Cow;

/// Largest number of parts that a step is divided into.
const MOST_PARTS: usize = 40;

/// Accuracy of an instant within a step, as a share of the step, and of a clearance there, relative
/// to those at the ends.
const INSTANT: f64 = 1e-12;
const CLOSED: f64 = 1e-14;
const TRIALS: usize = 60;

impl Phase {
    /// Returns which candidates touch.
    pub(super) fn touching(&self) -> Vec<bool> {
        self.state.reaction.iter().map(|r| *r != 0.0).collect()
    }

    /// Returns the sum of the magnitudes of all reactions, in N.
    pub(super) fn force(&self) -> f64 {
        self.state.reaction.iter().map(|r| r.abs()).sum()
    }
}

impl ReturnMap<'_> {
    /// Makes a step. Returns the largest sum of the magnitudes of the reactions, in N.
    pub(super) fn make_step(
        &mut self,
        moment: &mut Phase,
        step: usize,
        variation: &mut Option<Variation>,
    ) -> f64 {
        let (mut from, mut ends, mut parts) = (0.0, vec![1.0], 0);
        let mut touching = moment.touching();
        let mut force = moment.force();
        while let Some(&end) = ends.last() {
            let start = moment.clone();
            self.move_on(moment, step, [from, end]);
            parts += 1;
            let switch = match parts < MOST_PARTS {
                true => self.first_switch(&start, moment, &touching, step, [from, end]),
                false => None,
            };
            let mut to = end;
            let before = touching.clone();
            if let Some((candidate, share)) = switch {
                moment.clone_from(&start);
                self.move_on(moment, step, [from, share]);
                touching[candidate] = !touching[candidate];
                to = share;
            } else if let Some(nearest) = self.nearest(&start, moment, step, [from, end]) {
                moment.clone_from(&start);
                ends.push(nearest);
                continue;
            } else {
                touching = moment.touching();
                ends.pop();
            }
            let seconds = (to - from) * self.rotation.seconds;
            self.kick(moment, 0.5 * seconds);
            if let Some(variation) = variation {
                self.prepare(seconds);
                let rotation = if seconds == self.rotation.seconds { &self.rotation } else { &self.part };
                // The stiffness jumps where a contact begins or ends.
                variation.advance(rotation, &self.modes.squares, self.stiffness(&moment.stretch, &before));
                if touching != before {
                    variation.change(self.stiffness(&moment.stretch, &touching));
                }
            }
            force = force.max(moment.force());
            from = to;
        }
        force
    }

    /// Moves a state over a part of a step, up to the kick at its end.
    fn move_on(&mut self, moment: &mut Phase, step: usize, [from, to]: [f64; 2]) {
        let seconds = (to - from) * self.rotation.seconds;
        self.kick(moment, 0.5 * seconds);
        self.prepare(seconds);
        let rotation = if seconds == self.rotation.seconds { &self.rotation } else { &self.part };
        let [before, after] = [self.data(step), self.data(step + 1)].map(|data| &data.force);
        let share = 0.5 * (from + to);
        let force: Vec<f64> = before.iter().zip(after).map(|(a, b)| a + share * (b - a)).collect();
        let state = &mut moment.state;
        let (mut dq, mut dv) = (vec![0.0; state.q.len()], vec![0.0; state.q.len()]);
        rotation.increments(&self.modes.squares, &force, [&state.q, &state.v], [&mut dq, &mut dv]);
        axpy(1.0, &dq, &mut state.q);
        axpy(1.0, &dv, &mut state.v);
        self.settle(moment, step, to);
    }

    /// Prepares the motion over a duration, in s.
    fn prepare(&mut self, seconds: f64) {
        if seconds != self.rotation.seconds && seconds != self.part.seconds {
            self.part.set(&self.modes.squares, &self.decays, seconds);
        }
    }

    /// Returns the limits of the candidates within a step.
    fn near(&self, step: usize, share: f64) -> Cow<'_, Limits> {
        let [before, after] = [self.data(step), self.data(step + 1)].map(|data| &data.near);
        if share == 0.0 || self.data.len() == 1 {
            return Cow::Borrowed(before);
        }
        if share == 1.0 {
            return Cow::Borrowed(after);
        }
        let mut near = before.clone();
        near.between(before, after, share);
        Cow::Owned(near)
    }

    /// Computes reactions and stretching within a step.
    pub(super) fn settle(&mut self, moment: &mut Phase, step: usize, share: f64) {
        let Phase { state, stretch } = moment;
        let near = self.near(step, share).into_owned();
        state.y.clear();
        let free = |i: usize| near.shift[i] + dot(self.rows.col_as_slice(i), &state.q);
        state.y.extend((0..self.rows.ncols()).map(free));
        let problem = self.model.problem(&state.y, &near.lower, &near.upper);
        self.contact.solve(problem, &mut state.x, &mut state.reaction);
        if let Some(form) = &self.form {
            form.evaluate(&state.q, stretch);
        }
    }

    /// Adds the forces of contact and stretching over a duration (s) to the rates.
    pub(super) fn kick(&self, moment: &mut Phase, seconds: f64) {
        let Phase { state, stretch } = moment;
        kick(&self.rows, &state.reaction, seconds, &mut state.v);
        if self.form.is_some() {
            stretch.add_gradient(-seconds, &mut state.v);
        }
    }

    /// Returns the stiffness of stretching and of contact where some candidates touch, in 1/s^2;
    /// `None` where there is neither. Bounds that yield have the tangents of the state that was
    /// settled last.
    pub(super) fn stiffness(&self, stretch: &Stretch, touching: &[bool]) -> Option<Mat<f64>> {
        let count = self.modes.count();
        let stretched = self.form.as_ref().map(|form| form.hessian(stretch));
        let is_solved = !self.model.laws.are_rigid();
        let active: Vec<usize> = match is_solved {
            true => self.contact.active.clone(),
            false => (0..touching.len()).filter(|&i| touching[i]).collect(),
        };
        if active.is_empty() {
            return stretched;
        }
        let rows = Mat::from_fn(active.len(), count, |a, k| self.rows[(k, active[a])]);
        let mut forces = rows.clone();
        if is_solved {
            (0..count).for_each(|k| self.contact.solve_active(forces.col_as_slice_mut(k)));
        } else {
            let compliance = &self.model.compliance;
            let block = Mat::from_fn(active.len(), active.len(), |a, b| compliance[(active[a], active[b])]);
            block.partial_piv_lu().solve_in_place(&mut forces);
        }
        let pressed = rows.transpose() * forces;
        Some(stretched.map_or_else(|| pressed.clone(), |stretched| stretched + &pressed))
    }

    /// Returns how far a candidate is from its bounds, in m: negative in contact, by the depth
    /// beyond a bound that yields, or else by the compliance times the reaction.
    fn clearance(&self, moment: &Phase, near: &Limits, candidate: usize) -> f64 {
        let (x, r) = (moment.state.x[candidate], moment.state.reaction[candidate]);
        let distance = (x - near.lower[candidate]).min(near.upper[candidate] - x);
        match r == 0.0 || distance < 0.0 {
            true => distance,
            false => -r.abs() * self.model.compliance[(candidate, candidate)],
        }
    }

    /// Returns the first candidate whose contact begins or ends in a part of a step, and the share
    /// of the step at which it does.
    fn first_switch(
        &mut self,
        start: &Phase,
        end: &Phase,
        touching: &[bool],
        step: usize,
        [from, to]: [f64; 2],
    ) -> Option<(usize, f64)> {
        let now = end.touching();
        let changed = (0..now.len()).filter(|&i| now[i] != touching[i]).collect::<Vec<_>>();
        let instants = changed.into_iter().filter_map(|candidate| {
            let ends = [(start, from), (end, to)];
            let values =
                ends.map(|(moment, share)| self.clearance(moment, &self.near(step, share), candidate));
            Some((candidate, self.switch(start, candidate, values, step, [from, to])?))
        });
        instants.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Returns the share of a step at which a clearance is zero, given its values at both ends of a
    /// part of it, by false position in the manner of Illinois.
    fn switch(
        &mut self,
        start: &Phase,
        candidate: usize,
        mut values: [f64; 2],
        step: usize,
        [from, to]: [f64; 2],
    ) -> Option<f64> {
        let size = values[0].abs().max(values[1].abs());
        let (mut ends, mut moved, mut share) = ([from, to], None, to);
        if values[0] * values[1] >= 0.0 {
            return None;
        }
        for _ in 0..TRIALS {
            share = ends[0] + (ends[1] - ends[0]) * values[0] / (values[0] - values[1]);
            let mut moment = start.clone();
            self.move_on(&mut moment, step, [from, share]);
            let value = self.clearance(&moment, &self.near(step, share), candidate);
            if value.abs() <= CLOSED * size || ends[1] - ends[0] <= INSTANT {
                break;
            }
            let side = usize::from(value * values[1] > 0.0);
            (ends[side], values[side]) = (share, value);
            if moved.replace(side) == Some(side) {
                values[1 - side] *= 0.5;
            }
        }
        (share - from > INSTANT && to - share > INSTANT).then_some(share)
    }

    /// Returns the share of a step at which a candidate that is free at both ends of a part of it
    /// is beyond its bound between them, where it has turned back: by the cubic through places and
    /// velocities, where nothing touches.
    fn nearest(&self, start: &Phase, end: &Phase, step: usize, [from, to]: [f64; 2]) -> Option<f64> {
        if start.force() > 0.0 || end.force() > 0.0 {
            return None;
        }
        let [before, after] = [from, to].map(|share| self.near(step, share));
        let seconds = (to - from) * self.rotation.seconds;
        let candidates = 0..start.state.x.len();
        let turn = |(candidate, sign): (usize, f64)| {
            let bound =
                |near: &Limits| if sign > 0.0 { near.lower[candidate] } else { near.upper[candidate] };
            let places = [(start, &before), (end, &after)]
                .map(|(moment, near)| sign * (moment.state.x[candidate] - bound(near)));
            let drift = sign * (after.shift[candidate] - before.shift[candidate])
                - sign * (bound(&after) - bound(&before));
            let rates = [start, end].map(|moment| {
                sign * seconds * dot(self.rows.col_as_slice(candidate), &moment.state.v) + drift
            });
            let turns = rates[0] < 0.0 && rates[1] > 0.0 && places[0] < -rates[0] && places[1] < rates[1];
            let (share, least) = turns.then(|| least_of_cubic(places, rates))?;
            (least < 0.0 && places[0] > 0.0 && places[1] > 0.0).then_some(from + share * (to - from))
        };
        candidates.flat_map(|i| [(i, 1.0), (i, -1.0)]).find_map(turn)
    }
}

/// Returns place and value of the least of a cubic on [0, 1] that falls at 0 and rises at 1, given
/// its values and slopes there.
fn least_of_cubic([a, b]: [f64; 2], [slope, last]: [f64; 2]) -> (f64, f64) {
    let [square, cube] = [3.0 * (b - a) - 2.0 * slope - last, 2.0 * (a - b) + slope + last];
    let (mut low, mut high) = (0.0, 1.0);
    while high - low > INSTANT {
        let t = 0.5 * (low + high);
        *(if slope + t * (2.0 * square + 3.0 * t * cube) < 0.0 { &mut low } else { &mut high }) = t;
    }
    (low, a + low * (slope + low * (square + low * cube)))
}
