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
use super::reach::{Check, Finding};
use super::state::{State, kick};
use crate::error::Result;
use crate::kernels::lanes::{dot, norm};
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::Approach;

impl<E: Engine> ModalScheme<'_, E> {
    /// Returns the parameters beta and e of the Newmark scheme; `None` for another scheme.
    pub(super) fn newmark_parameters(&self) -> Option<[f64; 2]> {
        match self.implicit.as_ref()?.rule {
            StepRule::Newmark { beta, restitution } => Some([beta, restitution]),
            StepRule::Midpoint => None,
        }
    }

    /// Solves the first step, from the state at the start.
    pub(super) fn begin_newmark(&mut self) -> Result<()> {
        let velocity = self.now.v.clone();
        self.before = self.now.clone();
        if let Some(implicit) = &mut self.implicit {
            implicit.next = self.now.clone();
        }
        self.balance.start = dot(self.loads.constant_force(), &self.now.q);
        let stored = self.model.laws.stored_under(&self.now.reaction);
        if let Some(implicit) = &mut self.implicit {
            implicit.stored[1] = stored;
        }
        self.solve_newmark(Some(&velocity))?;
        self.report_newmark();
        Ok(())
    }

    /// Advances by one step: the state of the last instant becomes the one before, and the new
    /// state solves the problem of the step.
    pub(super) fn newmark_step(&mut self) -> Result<()> {
        let ModalScheme { model, record, implicit, before, now, .. } = self;
        let Some(implicit) = implicit else { return Ok(()) };
        let half = 0.5 * record.dt;
        for &(k, i) in &model.own {
            record.impulses[i] += half * implicit.reaction[k];
        }
        let (known, pressed) = (model.candidates.clone(), implicit.reaction.clone());
        std::mem::swap(before, now);
        std::mem::swap(now, &mut implicit.next);
        self.solve_newmark(None)?;
        self.report_newmark();
        let ModalScheme { model, record, implicit, before, now, free, .. } = self;
        let Some(implicit) = implicit else { return Ok(()) };
        for &(k, i) in &model.own {
            record.impulses[i] += half * implicit.reaction[k];
            let last = known.binary_search(&model.candidates[k]).map_or(0.0, |k| pressed[k]);
            if last == 0.0 && implicit.reaction[k] != 0.0 {
                let velocity = (now.x[k] - before.x[k]) / record.dt;
                free[i] = Approach { time: record.time(), deflection: now.x[k], velocity };
            }
        }
        Ok(())
    }

    /// Solves for the level n + 1, until no other node can touch; at the start given the initial
    /// rates of the modes.
    fn solve_newmark(&mut self, first: Option<&[f64]>) -> Result<()> {
        let (dt, instant) = (self.record.dt, self.record.time());
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
        if let Some(implicit) = &mut self.implicit {
            implicit.next.data = next;
        }
        loop {
            self.solve_level(first);
            self.note_implicit();
            let probe = self.bounded_state();
            let Some(tier) = self.reach.advance(&probe, dt, false) else { break };
            let pull = probe.pull(&self.modes.squares);
            let mut acceleration = pull.clone();
            kick(&self.rows, &probe.reaction, 1.0, &mut acceleration);
            let acceleration = norm(&acceleration);
            let check = Check { model: &self.model, state: &probe, pull, acceleration };
            let Finding { near, .. } = self.reach.check(tier, &check);
            if near.is_empty() {
                break;
            }
            self.reach.retreat(dt, tier);
            self.add_candidates(near)?;
        }
        let stored = self.implicit.as_ref().map_or(0.0, |of| self.model.laws.stored_under(&of.reaction));
        if let Some(implicit) = &mut self.implicit {
            implicit.stored = [implicit.stored[1], stored];
        }
        self.note_levels();
        Ok(())
    }

    /// Solves for the level n + 1 with the present candidates, and at the start for the ghost level
    /// before it.
    fn solve_level(&mut self, first: Option<&[f64]>) {
        let Some([beta, e]) = self.newmark_parameters() else { return };
        let dt = self.record.dt;
        let force = self.mean_force(beta);
        let limits = self.mean_limits(e);
        let ModalScheme { before, now, modes, decays, rows, model, implicit, .. } = self;
        let Some(implicit) = implicit else { return };
        implicit.force = force;
        let mut pull = implicit.force.clone();
        // Share of the unknown in the bounded configuration and in the new level, and the rest of
        // either.
        let (share, part) = if first.is_some() { (0.5, 0.5) } else { (1.0 / (1.0 + e), 1.0) };
        let moved = |now: f64, before: f64| if first.is_some() { 0.0 } else { now - before };
        for (k, pull) in pull.iter_mut().enumerate() {
            let rate = first.map_or(-decays[k] * (now.q[k] - before.q[k]), |velocity| 2.0 * velocity[k]) / dt;
            *pull += rate - modes.squares[k] * now.q[k];
            let drift = first.map_or(0.0, |velocity| -2.0 * dt * velocity[k] * e / (1.0 + e));
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

    /// Returns the beta-average of the modal force, less the inertia of the support motions.
    fn mean_force(&self, beta: f64) -> Vec<f64> {
        let mut force = self.now.data.force.clone();
        let Some(Implicit { next, .. }) = &self.implicit else { return force };
        if !self.system.drive.varies() {
            return force;
        }
        let ends = self.before.data.force.iter().zip(&next.data.force);
        for (force, (before, next)) in force.iter_mut().zip(ends) {
            *force += beta * (next - 2.0 * *force + before);
        }
        for (k, acceleration) in self.support_accelerations().into_iter().enumerate() {
            axpy(-acceleration, self.loads.support_momenta.col_as_slice(k), &mut force);
        }
        force
    }

    /// Returns the second differences of the support places over dt^2, in m/s^2.
    pub(super) fn support_accelerations(&self) -> Vec<f64> {
        let Some(Implicit { next, .. }) = &self.implicit else { return Vec::new() };
        let [before, now, next] = [&self.before, &self.now, next].map(|level| &level.data.places);
        let levels = now.iter().zip(before.iter().zip(next));
        let square = self.record.dt * self.record.dt;
        levels.map(|(now, (before, next))| ((next - now) - (now - before)) / square).collect()
    }

    /// Returns the limits of the bounded configuration at the candidates.
    fn mean_limits(&self, e: f64) -> Limits {
        let mut limits = self.now.data.near.clone();
        if let (Some(Implicit { next, .. }), true) = (&self.implicit, self.system.drive.varies()) {
            limits.between(&next.data.near, &self.before.data.near, e / (1.0 + e));
        }
        limits
    }

    /// Returns the bounded configuration as a state.
    fn bounded_state(&self) -> State {
        let (Some([_, e]), Some(Implicit { next, .. })) = (self.newmark_parameters(), &self.implicit) else {
            return self.now.clone();
        };
        let before = &self.before;
        let mean = |next: &[f64], before: &[f64]| -> Vec<f64> {
            next.iter().zip(before).map(|(next, before)| (next + e * before) / (1.0 + e)).collect()
        };
        let rate = |(next, before)| (next - before) / (2.0 * self.record.dt);
        State {
            q: mean(&next.q, &before.q),
            v: next.q.iter().zip(&before.q).map(rate).collect(),
            reaction: mean(&next.reaction, &before.reaction),
            is_settled: true,
            data: match self.system.drive.varies() {
                true => ModalData::between(&next.data, &before.data, e / (1.0 + e)).into(),
                false => self.now.data.clone(),
            },
            ..State::default()
        }
    }

    /// Computes the velocities of the instant n, and the work up to it.
    fn note_levels(&mut self) {
        let ModalScheme { before, now, loads, implicit, balance, record, .. } = self;
        let Some(implicit) = implicit else { return };
        let Implicit { next, force, reaction, work, .. } = implicit;
        let constant = loads.constant_force();
        let twice = 2.0 * record.dt;
        let mut increment = 0.0;
        for (k, v) in now.v.iter_mut().enumerate() {
            let moved = next.q[k] - before.q[k];
            *v = moved / twice;
            increment += 0.5 * (force[k] - constant[k]) * moved;
        }
        let (from, to) = (&before.data.near, &next.data.near);
        for (i, r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            let bound = |of: &Limits| if *r > 0.0 { of.lower[i] } else { of.upper[i] } - of.shift[i];
            increment += 0.5 * r * (bound(to) - bound(from));
        }
        let places = next.data.places.iter().zip(&before.data.places);
        now.frame_rates = places.map(|(next, before)| (next - before) / twice).collect();
        let [sum, last] = *work;
        *work = if record.step == 0 { [0.0, increment] } else { [sum + 0.5 * (last + increment), increment] };
        balance.work = dot(constant, &now.q) - balance.start + work[0];
    }

    /// Completes the record of the instant n.
    fn report_newmark(&mut self) {
        self.list_candidates();
        let ModalScheme { model, record, implicit, .. } = self;
        let Some(implicit) = implicit else { return };
        for &(k, i) in &model.own {
            (record.admissible[i], record.reaction[i]) = (implicit.x[k], implicit.reaction[k]);
        }
        self.show_newmark();
    }

    /// Shows the instant n and the limits of its bounded configuration.
    pub(super) fn show_newmark(&mut self) {
        self.shown.forget();
        if self.system.drive.moves_bounds() {
            let Limits { lower, upper, .. } = &self.bounded_state().data.all;
            self.all.restrict(lower, &mut self.shown.limits.lower);
            self.all.restrict(upper, &mut self.shown.limits.upper);
        }
    }

    /// Returns data whose response is the change of that of the loads from n - 1 to n + 1 per
    /// second.
    fn data_rate(&self, next: &State) -> ModalData {
        let twice = 2.0 * self.record.dt;
        let rate = |next: &[f64], before: &[f64]| -> Vec<f64> {
            next.iter().zip(before).map(|(next, before)| (next - before) / twice).collect()
        };
        let (next, before) = (&next.data, &self.before.data);
        ModalData {
            factors: rate(&next.factors, &before.factors),
            wave: rate(&next.wave, &before.wave),
            ..ModalData::default()
        }
    }

    /// Returns the central velocity `$(U^{n+1} - U^{n-1}) / 2 \Delta t$`, in m/s.
    pub(super) fn central_velocity(&self) -> Vec<f64> {
        let mut rates = vec![0.0; self.system.engine.dofs()];
        let Some(Implicit { next, .. }) = &self.implicit else { return rates };
        self.modes.add_shapes(&self.now.v, &mut rates);
        self.loads.add_response(&self.data_rate(next), &mut rates);
        let twice = 2.0 * self.record.dt;
        for (k, (next, before)) in next.reaction.iter().zip(&self.before.reaction).enumerate() {
            if next != before {
                axpy((next - before) / twice, &self.model.flexibility[k], &mut rates);
            }
        }
        rates
    }

    /// Returns the discrete invariant between n and n + 1, in J, as
    /// [`crate::scheme::Newmark::invariant`] has it.
    pub(super) fn newmark_invariant(&self, implicit: &Implicit) -> f64 {
        let Implicit { next, work: [sum, increment], .. } = implicit;
        let squares = &self.modes.squares;
        let ends = next.q.iter().zip(&self.now.q);
        let kinetic: f64 = ends.map(|(next, now)| ((next - now) / self.record.dt).powi(2)).sum();
        let ([_, now], [_, later]) = (self.now.energies(squares), next.energies(squares));
        let constant = self.loads.constant_force();
        let work = 0.5 * (dot(constant, &self.now.q) + dot(constant, &next.q)) - self.balance.start;
        let e = self.newmark_parameters().map_or(0.0, |[_, e]| e);
        let stored = 0.5 * (implicit.stored_now(e) + implicit.stored[1]);
        self.balance.offset + 0.5 * kinetic + 0.5 * (now + later) + stored - work - sum - 0.5 * increment
    }
}
