//! Newmark scheme with restitution for the modal mass (paper, section 4.1).
//!
//! The formulas are those of [`crate::scheme::newmark`]. The displacement splits into the modes,
//! the response W of the rest to the loads, which follows them at once, and the displacements H of
//! the rest by reactions,
//!
//! ```math
//! U^n = \Phi q^n + W^n + H s^n .
//! ```
//!
//! With the second difference x of q, the beta-average h of the modal force and the reactions r of
//! the instant n,
//!
//! ```math
//! \Bigl( \frac{1}{\Delta t^2} + \beta\, \Omega^2 + \frac{D}{2 \Delta t} \Bigr) x
//!    = h - \Omega^2 q^n - D\, \frac{q^n - q^{n-1}}{\Delta t} + A^T r, \qquad
//!    \beta (s^{n+1} - 2 s^n + s^{n-1}) = r - s^n .
//! ```
//!
//! The rest has no inertia: once disturbed by contact, s oscillates about r without decay, as the
//! massless part does with the singular mass. With beta = 1/4 the oscillation would grow. The rest
//! starts in equilibrium; the ghost values are `$q^{-1} = q^1 - 2 \Delta t\, \dot q_0$` and
//! `$s^{-1} = s^1$`, as [`crate::scheme::newmark::start`] tells.

use super::ModalScheme;
use super::data::ModalData;
use super::implicit::{Implicit, StepRule};
use super::limits::Limits;
use super::scheme::Rates;
use super::state::{State, kick};
use crate::error::Result;
use crate::kernels::lanes::dot;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::newmark::levels;
use crate::scheme::{Approach, NewmarkParameters};
use std::rc::Rc;

impl<E: Engine> ModalScheme<'_, E> {
    /// Returns the parameters of the Newmark scheme; `None` for another scheme.
    pub(super) fn newmark_parameters(&self) -> Option<NewmarkParameters> {
        match self.implicit.rule {
            StepRule::Newmark(parameters) => Some(parameters),
            _ => None,
        }
    }

    /// Solves the first step, from the state at the start.
    pub(super) fn begin_newmark(&mut self, parameters: NewmarkParameters) -> Result<()> {
        let velocity = self.now.v.clone();
        self.before = self.now.clone();
        self.implicit.next = self.now.clone();
        self.balance.start = dot(self.loads.constant_force(), &self.now.q);
        self.implicit.stored[1] = self.model.laws.stored_under(&self.now.reaction);
        self.solve_newmark(parameters, Some(&velocity))
    }

    /// Advances by one step: the state of the last instant becomes the one before, and the new
    /// state solves the problem of the step.
    pub(super) fn newmark_step(&mut self, parameters: NewmarkParameters) -> Result<()> {
        let half = 0.5 * parameters.step;
        let (old, pressed) = (self.model.candidates.clone(), self.implicit.reaction.clone());
        self.model.own.iter().for_each(|&(k, i)| self.record.impulses[i] += half * pressed[k]);
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.implicit.next);
        self.solve_newmark(parameters, None)?;
        let ModalScheme { model, record, implicit, before, now, free, .. } = self;
        for &(k, i) in &model.own {
            record.impulses[i] += half * implicit.reaction[k];
            let last = old.binary_search(&model.candidates[k]).map_or(0.0, |k| pressed[k]);
            if last == 0.0 && implicit.reaction[k] != 0.0 {
                let velocity = (now.x[k] - before.x[k]) / record.dt;
                free[i] = Approach { time: record.time(), deflection: now.x[k], velocity };
            }
        }
        Ok(())
    }

    /// Solves for the level n + 1, until no other node can touch, and completes the record of the
    /// instant n; at the start given the initial rates of the modes.
    fn solve_newmark(&mut self, parameters: NewmarkParameters, first: Option<&[f64]>) -> Result<()> {
        let (dt, instant) = (parameters.step, self.record.time());
        let next = self.data_at(instant + dt)?.unwrap_or_else(|| self.now.data.clone());
        if first.is_some() && self.system.drive.varies() {
            // Data are extrapolated to the instant before the start. The ghost place of a support
            // is s^1 less two steps at its initial velocity.
            let mut ghost = ModalData::between(&self.now.data, &next, -1.0);
            let rates = self.system.drive.rates(0.0)?;
            ghost.places =
                next.places.iter().zip(rates).map(|(place, rate)| place - 2.0 * dt * rate).collect();
            self.before.data = ghost.into();
        }
        self.implicit.next.data = next;
        loop {
            self.solve_level(parameters, first);
            self.note_implicit();
            let probe = self.bounded_state(parameters);
            let Some(tier) = self.reach.advance(&probe, dt, false) else { break };
            let near = self.check_reach(tier, Some(&probe)).near;
            if near.is_empty() {
                break;
            }
            self.reach.retreat(dt, tier);
            self.add_candidates(near)?;
        }
        let Implicit { stored, reaction, .. } = &mut self.implicit;
        *stored = [stored[1], self.model.laws.stored_under(reaction)];
        self.note_levels();
        self.list_candidates();
        for &(k, i) in &self.model.own {
            self.record.admissible[i] = self.implicit.x[k];
            self.record.reaction[i] = self.implicit.reaction[k];
        }
        self.show_newmark(parameters);
        Ok(())
    }

    /// Solves for the level n + 1 with the present candidates, and at the start for the ghost level
    /// before it.
    fn solve_level(&mut self, parameters: NewmarkParameters, first: Option<&[f64]>) {
        let NewmarkParameters { beta, restitution: e, step: dt } = parameters;
        let limits = self.mean_limits(parameters);
        self.implicit.force = self.mean_force(parameters);
        let ModalScheme { before, now, modes, decays, rows, model, implicit, .. } = self;
        let mut pull = implicit.force.clone();
        // Share of the unknown in the bounded configuration and in the new level, and the rest of
        // either.
        let (share, part) = if first.is_some() { (0.5, 0.5) } else { (1.0 / (1.0 + e), 1.0) };
        let moved = |now: f64, before: f64| if first.is_some() { 0.0 } else { now - before };
        for (k, pull) in pull.iter_mut().enumerate() {
            let rate = first.map_or(-decays[k] * (now.q[k] - before.q[k]), |velocity| 2.0 * velocity[k]) / dt;
            *pull += rate - modes.squares[k] * now.q[k];
            let drift = first.map_or(0.0, |velocity| -2.0 * dt * velocity[k] * parameters.share_of_last());
            let old = share * (1.0 - e) * moved(now.q[k], before.q[k]);
            implicit.next.q[k] = now.q[k] + share * implicit.inverse[k] * *pull + old + drift;
        }
        let mut free: Vec<f64> = (0..rows.ncols())
            .map(|i| limits.shift[i] + dot(rows.col_as_slice(i), &implicit.next.q))
            .collect();
        for (k, s) in now.reaction.iter().enumerate() {
            let s = s - share * (s / beta - (1.0 - e) * moved(*s, before.reaction[k]));
            if s != 0.0 {
                axpy(s, model.compliance.col_as_slice(k), &mut free);
            }
        }
        implicit.solve(share, model, free, &limits);
        let Implicit { inverse, reaction, next, .. } = implicit;
        kick(rows, reaction, 1.0, &mut pull);
        for (k, pull) in pull.iter().enumerate() {
            next.q[k] = now.q[k] + moved(now.q[k], before.q[k]) + part * inverse[k] * pull;
        }
        next.reaction.resize(reaction.len(), 0.0);
        for (k, r) in reaction.iter().enumerate() {
            let s = now.reaction[k];
            next.reaction[k] = s + moved(s, before.reaction[k]) + part * (r - s) / beta;
        }
        next.respond(model, rows);
        if let Some(velocity) = first {
            for (k, rate) in velocity.iter().enumerate() {
                before.q[k] = next.q[k] - 2.0 * dt * rate;
            }
            before.reaction.clone_from(&next.reaction);
            before.respond(model, rows);
        }
    }

    /// Returns the data of the instants n - 1, n and n + 1.
    fn data_of_levels(&self) -> [&ModalData; 3] {
        [&self.before, &self.now, &self.implicit.next].map(|level| &*level.data)
    }

    /// Returns the beta-average of the modal force, less the inertia of the support motions.
    fn mean_force(&self, parameters: NewmarkParameters) -> Vec<f64> {
        if !self.system.drive.varies() {
            return self.now.data.force.clone();
        }
        let forces = levels(self.data_of_levels().map(|data| &*data.force));
        let mut force: Vec<f64> = forces.map(|force| parameters.average(force)).collect();
        for (k, acceleration) in self.support_accelerations(parameters).into_iter().enumerate() {
            axpy(-acceleration, self.loads.support_momenta.col_as_slice(k), &mut force);
        }
        force
    }

    /// Returns the second differences of the support places over dt^2, in m/s^2.
    pub(super) fn support_accelerations(&self, parameters: NewmarkParameters) -> Vec<f64> {
        let places = levels(self.data_of_levels().map(|data| &*data.places));
        places.map(|places| parameters.acceleration(places)).collect()
    }

    /// Returns the limits of the bounded configuration at the candidates.
    fn mean_limits(&self, parameters: NewmarkParameters) -> Limits {
        let mut limits = self.now.data.near.clone();
        if self.system.drive.varies() {
            let [before, _, next] = self.data_of_levels();
            limits.between(&next.near, &before.near, parameters.share_of_last());
        }
        limits
    }

    /// Returns the bounded configuration as a state.
    fn bounded_state(&self, parameters: NewmarkParameters) -> State {
        let (before, next) = (&self.before, &self.implicit.next);
        let e = parameters.restitution;
        let mean = |next: &[f64], before: &[f64]| -> Vec<f64> {
            next.iter().zip(before).map(|(next, before)| (next + e * before) / (1.0 + e)).collect()
        };
        State {
            q: mean(&next.q, &before.q),
            v: self.rates(&next.q, &before.q),
            reaction: mean(&next.reaction, &before.reaction),
            is_settled: true,
            data: match self.system.drive.varies() {
                true => ModalData::between(&next.data, &before.data, parameters.share_of_last()).into(),
                false => self.now.data.clone(),
            },
            ..State::default()
        }
    }

    /// Returns the central differences of values at the instants n + 1 and n - 1, per second.
    fn rates(&self, next: &[f64], before: &[f64]) -> Vec<f64> {
        let twice = 2.0 * self.record.dt;
        next.iter().zip(before).map(|(next, before)| (next - before) / twice).collect()
    }

    /// Computes the velocities of the instant n, and the work up to it.
    fn note_levels(&mut self) {
        let [last, _, ahead] = self.data_of_levels();
        let frame_rates = self.rates(&ahead.places, &last.places);
        let v = self.rates(&self.implicit.next.q, &self.before.q);
        let ModalScheme { before, now, loads, implicit, balance, record, .. } = self;
        let Implicit { next, force, reaction, work, .. } = implicit;
        let constant = loads.constant_force();
        let mut increment = 0.0;
        for (k, force) in force.iter().enumerate() {
            increment += 0.5 * (force - constant[k]) * (next.q[k] - before.q[k]);
        }
        (now.v, now.frame_rates) = (v, frame_rates);
        let (from, to) = (&before.data.near, &next.data.near);
        for (i, r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            let bound =
                |limits: &Limits| if *r > 0.0 { limits.lower[i] } else { limits.upper[i] } - limits.shift[i];
            increment += 0.5 * r * (bound(to) - bound(from));
        }
        let [sum, last] = *work;
        *work = if record.step == 0 { [0.0, increment] } else { [sum + 0.5 * (last + increment), increment] };
        balance.work = dot(constant, &now.q) - balance.start + work[0];
    }

    /// Shows the instant n and the limits of its bounded configuration.
    pub(super) fn show_newmark(&mut self, parameters: NewmarkParameters) {
        self.shown.forget();
        if self.system.drive.moves_bounds() {
            let data: Rc<ModalData> = self.bounded_state(parameters).data;
            self.show_limits(&data.all);
        }
    }

    /// Returns the rates of the parts in the central velocity
    /// `$(U^{n+1} - U^{n-1}) / 2 \Delta t$`.
    pub(super) fn central_rates(&self) -> Rates<'_> {
        let (before, next) = (&self.before, &self.implicit.next);
        let data = ModalData {
            factors: self.rates(&next.data.factors, &before.data.factors),
            wave: self.rates(&next.data.wave, &before.data.wave),
            ..ModalData::default()
        };
        let reactions = self.rates(&next.reaction, &before.reaction).into_iter().enumerate();
        let reactions = reactions.filter(|(_, rate)| *rate != 0.0).collect();
        Rates { modes: &self.now.v, data: Some(data), reactions }
    }

    /// Returns the discrete invariant between n and n + 1, in J, as
    /// [`crate::scheme::Newmark::invariant`] has it.
    pub(super) fn newmark_invariant(&self, parameters: NewmarkParameters) -> f64 {
        let Implicit { next, work: [sum, increment], stored, .. } = &self.implicit;
        let squares = &self.modes.squares;
        let ends = next.q.iter().zip(&self.now.q);
        let kinetic: f64 = ends.map(|(next, now)| ((next - now) / self.record.dt).powi(2)).sum();
        let ([_, now], [_, later]) = (self.now.energies(squares), next.energies(squares));
        let constant = self.loads.constant_force();
        let work = 0.5 * (dot(constant, &self.now.q) + dot(constant, &next.q)) - self.balance.start;
        let stored = 0.5 * (parameters.stored_now(*stored) + stored[1]);
        self.balance.offset + 0.5 * kinetic + 0.5 * (now + later) + stored - work - sum - 0.5 * increment
    }
}
