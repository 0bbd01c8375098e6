//! Relaxed steps, in contact or of a plate that stretches.
//!
//! The energy of a convex potential has one gamma near 1. The potential of a buckled plate is not
//! convex between its states, where the energy may hardly change with gamma. There the rates of
//! the elastic modes are scaled instead, so that the kinetic energy makes up for the error of the
//! step, which is of third order in its length. Rigid motions keep the momentum of the plate.

use super::contact_model::ContactModel;
use super::data::ModalData;
use super::increments::Increments;
use super::limits::Limits;
use super::state::State;
use super::state::energy;
use super::viscous_tips::ViscousTips;
use super::{Balance, ModalScheme};
use crate::error::Result;
use crate::kernels::lanes::sum;
use crate::linalg::Engine;
use crate::linalg::vectors::{waxpby, waxpy};
use crate::scheme::relaxation::{RelaxedStep, root};
use crate::vi::{BoundStatus, ComplianceSolver};
use std::ops::Range;
use std::rc::Rc;

/// Range of gamma that is accepted.
const RANGE: Range<f64> = 0.5..2.0;
/// Relative change of energy above which a step is relaxed, and at which the search ends.
const MOVED: f64 = 1e-13;
/// Relative change of energy by a step itself up to which the step is taken as it is where the
/// search fails. The shorter a step, the less can it make up for what earlier steps have left.
const LEFT: f64 = 4.0 * MOVED;
const KEPT: f64 = 4.0 * f64::EPSILON;
/// Distance of gamma from 1 beyond which the rates of a plate that stretches are scaled, and the
/// largest relative change of their kinetic energy.
const FAR: f64 = 0.05;
const SCALED: f64 = 0.05;

/// States along a step, whose deflections without reactions and bounds are linear in gamma.
struct ContactStep<'a> {
    contact: &'a mut ComplianceSolver,
    model: &'a ContactModel,
    tips: &'a ViscousTips,
    now: &'a mut State,
    /// Deflections of the candidates without reactions before the step, and their change, in m.
    y: &'a [f64],
    dy: &'a [f64],
    /// Bounds before the step, their change where they move, and the present ones.
    from: &'a Limits,
    change: Option<&'a Limits>,
    present: &'a mut Limits,
    gamma: f64,
    /// Length of the whole step, in s.
    seconds: f64,
    /// Coefficients of 1, gamma, ..., gamma^4 of the excess without the rest, in J.
    energy: [f64; 5],
    /// Error at which the search ends, in J.
    enough: f64,
}

impl RelaxedStep for ContactStep<'_> {
    fn move_to(&mut self, gamma: f64) -> Result<()> {
        let ContactStep { now, from, change, present, .. } = self;
        self.gamma = gamma;
        waxpy(gamma, self.dy, self.y, &mut now.y);
        let limits = match change {
            Some(change) => {
                waxpy(gamma, &change.lower, &from.lower, &mut present.lower);
                waxpy(gamma, &change.upper, &from.upper, &mut present.upper);
                &**present
            }
            None => *from,
        };
        self.tips.solve(self.contact, self.model, now, limits, gamma * self.seconds);
        Ok(())
    }

    fn excess(&self) -> Result<[f64; 2]> {
        let ContactStep { now, gamma, .. } = self;
        let active = self.contact.active.iter();
        let rest: f64 = active.map(|&i| 0.5 * now.reaction[i] * (now.x[i] - now.y[i])).sum();
        let stored = self.model.laws.stored_under(&now.reaction) + self.tips.stored(now);
        let dissipated = self.tips.dissipated(now, gamma * self.seconds);
        let of_modes = self.energy.iter().rev().fold(0.0, |sum, coefficient| coefficient + gamma * sum);
        let excess = of_modes + rest + stored + dissipated;
        Ok([excess, self.enough])
    }

    fn slope(&mut self) -> Result<f64> {
        let powers = self.energy.iter().enumerate().skip(1).rev();
        let of_modes =
            powers.fold(0.0, |sum, (power, coefficient)| power as f64 * coefficient + self.gamma * sum);
        let moved = |i: usize| match (self.change, self.contact.sides[i]) {
            (Some(change), BoundStatus::Upper) => change.upper[i],
            (Some(change), _) => change.lower[i],
            (None, _) => 0.0,
        };
        let active = &self.contact.active;
        let rises: Vec<f64> = active.iter().map(|&i| moved(i) - self.dy[i]).collect();
        let rest: f64 = active.iter().zip(&rises).map(|(&i, rise)| self.now.reaction[i] * rise).sum();
        let dashpots = self.tips.slope(self.contact, self.now, rises, self.seconds, self.gamma);
        Ok(of_modes + rest + dashpots)
    }
}

impl<E: Engine> ModalScheme<'_, E> {
    /// Relaxes a step in contact so that it keeps the energy, and sets the present state to it.
    /// Returns gamma and the work of the obstacles over the whole step (J); `None` if no gamma in
    /// range does, unless this is the last trial.
    pub(super) fn keep_energy(
        &mut self,
        next: Option<&Rc<ModalData>>,
        seconds: f64,
        [received, dissipated]: [f64; 2],
        is_last: bool,
    ) -> Result<Option<(f64, f64)>> {
        let (now, before) = (&self.now, &self.before);
        waxpby(0.5, &before.reaction, 0.5, &now.reaction, &mut self.mean);
        let Increments { v: dv, y: dy, .. } = &mut self.increments;
        waxpy(-1.0, &before.v, &now.v, dv);
        dy.resize(now.y.len(), 0.0);
        waxpy(-1.0, &before.y, &now.y, dy);
        let obstacles = next.map_or(0.0, |next| self.obstacle_work(next));
        let (energy, size) = self.excess(received + obstacles - dissipated);
        let State { reaction, x, y, .. } = &self.before;
        let rest: f64 = reaction.iter().zip(x.iter().zip(y)).map(|(r, (x, y))| 0.5 * r * (x - y)).sum();
        let stored = self.model.laws.stored_under(reaction) + self.tips.stored(&self.before);
        let start = energy[0] + rest + stored;
        let increments = &self.increments;
        let mut step = ContactStep {
            contact: &mut self.contact,
            model: &self.model,
            tips: &self.tips,
            now: &mut self.now,
            y,
            dy: &increments.y,
            from: &self.before.data.near,
            change: next.map(|_| &increments.limits),
            present: &mut self.present,
            gamma: 1.0,
            seconds,
            energy,
            enough: KEPT * size,
        };
        step.move_to(1.0)?;
        let [moved, _] = step.excess()?;
        let gamma = match moved.abs() <= MOVED * size {
            true => Some(1.0),
            false => root(&mut step, RANGE)?,
        };
        let is_near = gamma.is_some_and(|gamma| (gamma - 1.0).abs() <= FAR);
        if self.stretching.is_there() && !is_near {
            let rates = self.before.v.iter().zip(&increments.v).map(|(v, dv)| v + dv);
            let elastic = rates.zip(&self.modes.squares).filter(|(_, square)| **square > 0.0);
            let share = moved / elastic.map(|(rate, _)| 0.5 * rate * rate).sum::<f64>();
            if share.abs() <= SCALED {
                step.move_to(1.0)?;
                self.take(1.0, next);
                let rates = self.now.v.iter_mut().zip(&self.modes.squares);
                let factor = (1.0 - share).sqrt();
                rates.filter(|(_, square)| **square > 0.0).for_each(|(rate, _)| *rate *= factor);
                return Ok(Some((1.0, obstacles)));
            }
        }
        let gamma = match gamma {
            None if is_last || (moved - start).abs() <= LEFT * size => {
                step.move_to(1.0)?;
                Some(1.0)
            }
            gamma => gamma,
        };
        let Some(gamma) = gamma else { return Ok(None) };
        self.take(gamma, next);
        Ok(Some((gamma, obstacles)))
    }

    /// Sets the present modes and data to those at gamma.
    fn take(&mut self, gamma: f64, next: Option<&Rc<ModalData>>) {
        waxpy(gamma, &self.increments.q, &self.before.q, &mut self.now.q);
        waxpy(gamma, &self.increments.v, &self.before.v, &mut self.now.v);
        if gamma != 1.0 {
            self.stretching.interpolate(&self.now.q, gamma);
        }
        if let Some(next) = next {
            self.now.data = ModalData::between(&self.before.data, next, gamma).into();
        }
    }

    /// Returns the coefficients of 1, gamma, ..., gamma^4 of the energy beyond its target, without
    /// that of the rest, and the scale of its rounding errors, in J. `gain` is the energy received
    /// over the whole step.
    fn excess(&self, gain: f64) -> ([f64; 5], f64) {
        let squares = &self.modes.squares;
        let State { q, v, .. } = &self.before;
        let Increments { q: dq, v: dv, .. } = &self.increments;
        let constant = energy(squares, q, v);
        let linear = sum(squares.len(), |k| v[k] * dv[k] + squares[k] * q[k] * dq[k]);
        let Balance { start, work, .. } = self.balance;
        let target = start + work - self.relaxation.dissipated;
        let mut coefficients = [constant - target, linear - gain, energy(squares, dq, dv), 0.0, 0.0];
        let stretching = self.stretching.along(dq);
        coefficients.iter_mut().zip(stretching).for_each(|(sum, term)| *sum += term);
        (coefficients, start.abs() + constant + self.stretching.size())
    }

    /// Computes the change of the bounds over the whole step. Returns the work of the mean
    /// reactions on the obstacles, in J.
    pub(super) fn obstacle_work(&mut self, next: &ModalData) -> f64 {
        let from = &self.before.data.near;
        self.increments.limits.difference(from, &next.near);
        self.present.clone_from(from);
        let Limits { shift, lower, upper } = &self.increments.limits;
        let pressed = |r: f64, i: usize| if r > 0.0 { lower[i] - shift[i] } else { upper[i] - shift[i] };
        self.mean.iter().enumerate().filter(|(_, r)| **r != 0.0).map(|(i, r)| r * pressed(*r, i)).sum()
    }
}
