//! Steps of the conserving scheme for the modal mass, from state to state.

use super::ModalConserving;
use super::data::{Limits, ModalData};
use super::reach::Finding;
use super::relaxation;
use super::rotation::Rotation;
use super::state::{State, add_product, kick};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, axpy, difference, divide, dot, sum, waxpy};
use crate::scheme::Approach;
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver, StepReport};
use std::ops::Range;
use std::rc::Rc;

/// Range of gamma that is accepted.
const RANGE: Range<f64> = 0.5..2.0;
/// Relative change of energy above which a step is relaxed, and at which the search ends.
const MOVED: f64 = 1e-13;
const KEPT: f64 = 4.0 * f64::EPSILON;
/// Largest number of halvings of a step whose energy has no root in range; afterwards the step is
/// taken as it is, and later steps make up the difference. With data that change in time no root
/// may exist.
const ALL_HALVINGS: usize = 40;

impl<E: Engine> ModalConserving<'_, E> {
    /// Computes the bounded deflections and reactions of the present q.
    pub(super) fn settle(&mut self) {
        let State { q, y, x, reaction, data, .. } = &mut self.now;
        let Limits { shift, lower, upper } = &data.near;
        y.copy_from_slice(shift);
        add_product(&self.model.lift_at, q, y);
        let problem = ComplianceProblem { compliance: &self.model.compliance, free: y, lower, upper };
        self.contact.solve(problem, x, reaction);
        self.note_answer();
    }

    /// Records iterations and residual of the last contact problem.
    fn note_answer(&mut self) {
        let ComplianceSolver { iterations, residual, .. } = self.contact;
        if self.contact.active().is_empty() {
            return;
        }
        let scale = self.now.y.iter().fold(self.model.bounds.magnitude(), |m, y| m.max(y.abs()));
        let kkt = if residual == 0.0 { 0.0 } else { residual / scale };
        self.record.report = self.record.report.and(StepReport { iterations, kkt, retries: 0 });
    }

    /// Measures the rates of the modes before the step in the frame that moves uniformly to the
    /// support places at its end. The change of kinetic energy counts as work.
    fn follow_supports(&mut self, next: &ModalData, seconds: f64) {
        let supports = &self.loads.support_momenta;
        let State { v, frame_rates, data, .. } = &mut self.before;
        let kinetic = dot(v, v);
        for (k, rate) in frame_rates.iter_mut().enumerate() {
            let uniform = (next.places[k] - data.places[k]) / seconds;
            axpy(*rate - uniform, supports.col_as_slice(k), v);
            *rate = uniform;
        }
        self.work += 0.5 * (dot(v, v) - kinetic);
        self.now.frame_rates.clone_from(frame_rates);
    }

    /// Makes a plain step from the state before to the present one. Returns the energies received
    /// from the loads and dissipated by damping, in J.
    fn propose(&mut self, next: Option<&Rc<ModalData>>, seconds: f64) -> [f64; 2] {
        let squares = &self.modes.squares;
        let lift_at = &self.model.lift_at;
        let State { q, v, reaction, data, .. } = &self.before;
        self.now.v.copy_from_slice(v);
        kick(lift_at, reaction, 0.5 * seconds, &mut self.now.v);
        let mean: Vec<f64>;
        let force = match next {
            Some(next) => {
                mean = data.force.iter().zip(&next.force).map(|(a, b)| 0.5 * (a + b)).collect();
                &mean
            }
            None => &data.force,
        };
        let other: Rotation;
        let rotation = if seconds == self.rotation.seconds {
            &self.rotation
        } else {
            other = Rotation::new(squares, &self.decays, seconds);
            &other
        };
        rotation.increments(squares, force, [q, &self.now.v], [&mut self.dq, &mut self.dv]);
        let received = dot(force, &self.dq);
        let is_damped = self.decays.iter().any(|decay| *decay > 0.0);
        let before = if is_damped { energy(squares, q, &self.now.v) } else { 0.0 };
        add(&self.dv, &mut self.now.v);
        waxpy(1.0, &self.dq, q, &mut self.now.q);
        let dissipated = match is_damped {
            true => received - (energy(squares, &self.now.q, &self.now.v) - before),
            false => 0.0,
        };
        self.now.data = next.unwrap_or(data).clone();
        self.settle();
        kick(&self.model.lift_at, &self.now.reaction, 0.5 * seconds, &mut self.now.v);
        [received, dissipated]
    }

    /// Finds the step length that keeps the energy, and sets the present state to it. Returns gamma
    /// and the work of the obstacles over the whole step (J); `None` if no gamma in range does.
    fn relax(&mut self, next: Option<&Rc<ModalData>>, received: f64, dissipated: f64) -> Option<(f64, f64)> {
        let squares = &self.modes.squares;
        let State { q, v, y, data, .. } = &self.before;
        let (lift, rate) = (&self.dq, &self.dv);
        let stiff = |a: &[f64], b: &[f64]| -> f64 {
            a.iter().zip(b).zip(squares).map(|((a, b), square)| square * a * b).sum()
        };
        let constant = energy(squares, q, v);
        let linear = dot(v, rate) + stiff(q, lift);
        let quadratic = 0.5 * (dot(rate, rate) + stiff(lift, lift));
        let zeros = vec![0.0; y.len()];
        let of = |next: Option<&Rc<ModalData>>, part: fn(&Limits) -> &[f64]| match next {
            // An absent obstacle has infinite bounds.
            Some(next) => part(&next.near)
                .iter()
                .zip(part(&data.near))
                .map(|(b, a)| if a.is_finite() { b - a } else { 0.0 })
                .collect(),
            None => zeros.clone(),
        };
        let [dlower, dupper, dshift] =
            [of(next, |data| &data.lower), of(next, |data| &data.upper), of(next, |data| &data.shift)];
        let bound = |side: BoundStatus, i: usize| match side {
            BoundStatus::Upper => dupper[i],
            _ => dlower[i],
        };
        let pressed = |r: f64, i: usize| if r > 0.0 { dlower[i] - dshift[i] } else { dupper[i] - dshift[i] };
        let obstacles: f64 =
            self.mean.iter().enumerate().filter(|(_, r)| **r != 0.0).map(|(i, r)| r * pressed(*r, i)).sum();
        let gain = received + obstacles - dissipated;
        let target = self.start + self.work - self.relaxation.dissipated;
        let size = self.start.abs() + constant;
        let (mut lower, mut upper) = (data.near.lower.clone(), data.near.upper.clone());
        let (contact, now, compliance, dy) =
            (&mut self.contact, &mut self.now, &self.model.compliance, &self.dy);
        let mut at = |gamma: f64| {
            waxpy(gamma, dy, y, &mut now.y);
            if next.is_some() {
                waxpy(gamma, &dlower, &data.near.lower, &mut lower);
                waxpy(gamma, &dupper, &data.near.upper, &mut upper);
            }
            let problem = ComplianceProblem { compliance, free: &now.y, lower: &lower, upper: &upper };
            contact.solve(problem, &mut now.x, &mut now.reaction);
            let (mut rest, mut slope) = (0.0, 0.0);
            for &i in contact.active() {
                let r = now.reaction[i];
                rest += 0.5 * r * (now.x[i] - now.y[i]);
                slope += r * (bound(contact.sides[i], i) - dy[i]);
            }
            let value = constant + gamma * (linear + gamma * quadratic) + rest - (target + gamma * gain);
            (value, linear + 2.0 * gamma * quadratic + slope - gain)
        };
        let (moved, _) = at(1.0);
        let gamma = match moved.abs() <= MOVED * size {
            true => Some(1.0),
            false => relaxation::root(&mut at, RANGE, KEPT * size),
        };
        at(gamma.unwrap_or(1.0));
        let gamma = gamma?;
        waxpy(gamma, &self.dq, &self.before.q, &mut self.now.q);
        waxpy(gamma, &self.dv, &self.before.v, &mut self.now.v);
        if let Some(next) = next {
            self.now.data = ModalData::between(&self.before.data, next, gamma).into();
        }
        Some((gamma, obstacles))
    }

    /// Advances from the present state, at `time` (s), by a step of `seconds` or a part of it.
    pub(super) fn step_on(&mut self, time: f64, mut seconds: f64) -> Result<()> {
        self.before.clone_from(&self.now);
        let varies = self.system.drive.varies();
        let mut halvings = 0;
        loop {
            let next = match varies {
                true => Some(Rc::new(self.loads.at(
                    self.system,
                    &self.modes,
                    &self.saddle,
                    &self.model.candidates,
                    time + seconds,
                )?)),
                false => None,
            };
            if let Some(next) = &next {
                self.follow_supports(next, seconds);
            }
            let exchanged = self.propose(next.as_ref(), seconds);
            let touches = self.before.touches() || self.now.touches();
            let taken = match touches {
                true => self.keep_energy(next.as_ref(), exchanged, halvings == ALL_HALVINGS),
                false => {
                    self.mean.fill(0.0);
                    Some((1.0, 0.0))
                }
            };
            let Some((gamma, obstacles)) = taken else {
                self.relaxation.halved_steps += 1;
                self.now.clone_from(&self.before);
                halvings += 1;
                seconds *= 0.5;
                continue;
            };
            self.span = gamma * seconds;
            if !self.reach.is_safe(&self.now, self.span) {
                let Finding { near, is_late } = self.check_reach();
                if !near.is_empty() {
                    self.add_candidates(near)?;
                }
                if is_late {
                    self.now.clone_from(&self.before);
                    continue;
                }
            }
            let [received, dissipated] = exchanged;
            self.work += gamma * (received + obstacles);
            let relaxation = &mut self.relaxation;
            relaxation.dissipated += gamma * dissipated;
            relaxation.states += 1;
            relaxation.relaxed_steps += u64::from(gamma != 1.0);
            relaxation.least_gamma = relaxation.least_gamma.min(gamma);
            relaxation.largest_gamma = relaxation.largest_gamma.max(gamma);
            if touches {
                self.length = self.rotation.seconds.min(2.0 * seconds);
                self.note_approaches(time);
            }
            return Ok(());
        }
    }

    /// Relaxes a step in contact so that it keeps the energy. Returns gamma and the work of the
    /// obstacles over the whole step (J); `None` if no gamma in range does, unless this is the last
    /// trial.
    fn keep_energy(
        &mut self,
        next: Option<&Rc<ModalData>>,
        [received, dissipated]: [f64; 2],
        is_last: bool,
    ) -> Option<(f64, f64)> {
        self.mean = sum(&self.before.reaction, &self.now.reaction);
        divide(2.0, &mut self.mean);
        self.dv = difference(&self.now.v, &self.before.v);
        self.dy = difference(&self.now.y, &self.before.y);
        let plain = is_last.then(|| self.now.clone());
        let taken = self.relax(next, received, dissipated);
        match (taken, plain) {
            (None, Some(plain)) => {
                self.now = plain;
                Some((1.0, 0.0))
            }
            _ => taken,
        }
    }

    /// Keeps the last state before contact of nodes that begin to touch.
    fn note_approaches(&mut self, time: f64) {
        let State { x, v, reaction, .. } = &self.before;
        for (k, &i) in self.model.candidates.iter().enumerate() {
            if reaction[k] == 0.0 && self.now.reaction[k] != 0.0 {
                let velocity = self.model.lift_at.row(k).iter().zip(v).map(|(a, v)| a * v).sum();
                self.free[i] = Approach { time, deflection: x[k], velocity };
            }
        }
    }
}

/// Returns the kinetic and elastic energy of the modes, in J.
fn energy(squares: &[f64], q: &[f64], v: &[f64]) -> f64 {
    let elastic: f64 = q.iter().zip(squares).map(|(q, square)| square * q * q).sum();
    0.5 * (dot(v, v) + elastic)
}
