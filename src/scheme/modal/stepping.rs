//! Steps of the conserving scheme for the modal mass, from state to state.

use super::ModalScheme;
use super::data::ModalData;
use super::increments::Increments;
use super::reach::Finding;
use super::state::energy;
use super::state::{State, kick};
use crate::error::Result;
use crate::kernels::lanes::dot;
use crate::kernels::wide::widest;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::Approach;
use crate::vi::{ComplianceSolver, StepReport};
use std::rc::Rc;

/// Largest number of halvings of a step whose energy has no root in range; afterwards the whole
/// step is taken as it is, and later steps make up the difference. With data that change in time no
/// root may exist.
const ALL_HALVINGS: usize = 40;

impl<E: Engine> ModalScheme<'_, E> {
    /// Computes the bounded deflections and reactions of the present q, some time (s) after the
    /// state before.
    pub(super) fn settle(&mut self, seconds: f64) {
        self.now.settle_free(&self.rows);
        let ModalScheme { now, contact, model, tips, .. } = self;
        let data = now.data.clone();
        tips.solve(contact, model, now, &data.near, seconds);
        self.note_answer(answer(&self.contact));
    }

    /// Records iterations and residual of the contact problem of an implicit step.
    pub(super) fn note_implicit(&mut self) {
        self.note_answer(answer(&self.implicit.contact));
    }

    /// Returns whether no candidate can touch within `seconds` from the present state.
    fn flies(&mut self, seconds: f64) -> bool {
        if self.system.drive.varies() || self.now.touches() || self.stretching.is_there() {
            return false;
        }
        let ModalScheme { now, flight, reach, model, modes, .. } = self;
        flight.lasts(seconds, reach, &model.candidates, now, || now.pull(&modes.squares))
    }

    /// Records the iterations and the residual of a contact problem. `None` stands for a step
    /// without one, and changes nothing.
    fn note_answer(&mut self, answer: Option<(u32, f64)>) {
        let Some((iterations, residual)) = answer else { return };
        let scale = self.now.y.iter().fold(self.model.magnitude, |m, y| m.max(y.abs()));
        let kkt = if residual == 0.0 { 0.0 } else { residual / scale };
        self.record.report = self.record.report.and(StepReport { iterations, kkt, retries: 0 });
    }

    /// Measures the rates of the modes before the step in the frame that moves uniformly to the
    /// support places at its end. The change of kinetic energy counts as work.
    pub(super) fn follow_supports(&mut self, next: &ModalData, seconds: f64) {
        let supports = &self.loads.support_momenta;
        let State { v, frame_rates, data, .. } = &mut self.before;
        let kinetic = dot(v, v);
        for (k, rate) in frame_rates.iter_mut().enumerate() {
            let uniform = (next.places[k] - data.places[k]) / seconds;
            axpy(*rate - uniform, supports.col_as_slice(k), v);
            *rate = uniform;
        }
        self.balance.work += 0.5 * (dot(v, v) - kinetic);
        self.now.frame_rates.clone_from(frame_rates);
    }

    /// Makes a plain step from the state before to the present one, in free flight or with contact.
    /// Returns the energies received from the loads and dissipated by damping, in J.
    fn propose(&mut self, next: Option<&Rc<ModalData>>, seconds: f64, flies: bool) -> [f64; 2] {
        let State { v, reaction, frame_rates, data, .. } = &self.before;
        self.now.v.copy_from_slice(v);
        self.now.frame_rates.clone_from(frame_rates);
        self.now.data = next.unwrap_or(data).clone();
        self.tips.begin(&self.before);
        if flies {
            self.now.release();
            self.tips.fly(&mut self.now, seconds);
            return self.rotate(next, seconds);
        }
        kick(&self.rows, reaction, 0.5 * seconds, &mut self.now.v);
        self.stretching.kick_before(0.5 * seconds, &mut self.now.v);
        let [received, dissipated] = self.rotate(next, seconds);
        self.settle(seconds);
        kick(&self.rows, &self.now.reaction, 0.5 * seconds, &mut self.now.v);
        self.stretching.evaluate(&self.now.q);
        self.stretching.kick_now(0.5 * seconds, &mut self.now.v);
        [received, dissipated - self.dissipation_by_kicks(seconds)]
    }

    /// Returns the energy dissipated because kicks stand for a steady force, in J.
    ///
    /// The velocity within the step of `seconds` differs from that under the steady force by a
    /// sawtooth, from the kick k before the motion to -k before the kick after it. Damping takes
    /// `$\tfrac13 \Delta t\, k^T D\, k$` from the sawtooth, and the kicks do that much more work than
    /// the reactions on the way of the modes.
    fn dissipation_by_kicks(&self, seconds: f64) -> f64 {
        if !self.is_damped {
            return 0.0;
        }
        let mut mean = vec![0.0; self.decays.len()];
        for state in [&self.before, &self.now] {
            kick(&self.rows, &state.reaction, 0.25 * seconds, &mut mean);
        }
        self.stretching.kick_before(0.25 * seconds, &mut mean);
        self.stretching.kick_now(0.25 * seconds, &mut mean);
        let power: f64 = self.decays.iter().zip(&mean).map(|(decay, v)| decay * v * v).sum();
        seconds / 3.0 * power
    }

    /// Moves the modes exactly over a step, from the position before it and the present velocity.
    /// Returns the energies received from the loads and dissipated by damping, in J.
    fn rotate(&mut self, next: Option<&Rc<ModalData>>, seconds: f64) -> [f64; 2] {
        let ModalScheme { rotation, other, decays, modes, before, now, increments, is_damped, .. } = self;
        let Increments { q: dq, v: dv, .. } = increments;
        let squares = &modes.squares;
        if seconds != rotation.seconds && seconds != other.seconds {
            other.set(squares, decays, seconds);
        }
        let rotation = if seconds == rotation.seconds { rotation } else { other };
        let mean: Vec<f64>;
        let force = match next {
            Some(next) => {
                mean = before.data.force.iter().zip(&next.force).map(|(a, b)| 0.5 * (a + b)).collect();
                &mean
            }
            None => &before.data.force,
        };
        widest(
            self.arch,
            #[inline(always)]
            || {
                let start = if *is_damped { energy(squares, &before.q, &now.v) } else { 0.0 };
                rotation.increments(squares, force, [&before.q, &now.v], [dq, dv]);
                let received = dot(force, dq);
                for (k, q) in before.q.iter().enumerate() {
                    now.q[k] = q + dq[k];
                    now.v[k] += dv[k];
                }
                let gained = if *is_damped { energy(squares, &now.q, &now.v) - start } else { received };
                [received, received - gained]
            },
        )
    }

    /// Advances from the present state, at `time` (s), by a step of `seconds` or a part of it.
    pub(super) fn step_on(&mut self, time: f64, mut seconds: f64) -> Result<()> {
        let mut flies = self.flies(seconds);
        if !flies && !self.now.is_settled {
            self.now.settle_free(&self.rows);
        }
        std::mem::swap(&mut self.now, &mut self.before);
        self.stretching.begin_step();
        let (whole, mut halvings) = (seconds, 0);
        loop {
            let next = self.data_at(time + seconds)?;
            if let Some(next) = &next {
                self.follow_supports(next, seconds);
            }
            let exchanged = self.propose(next.as_ref(), seconds, flies);
            let touches = self.before.touches() || self.now.touches();
            let is_forced = touches || self.stretching.is_there();
            let taken = match is_forced {
                true => self.keep_energy(next.as_ref(), seconds, exchanged, halvings == ALL_HALVINGS)?,
                false => Some((1.0, 0.0)),
            };
            let Some((gamma, obstacles)) = taken else {
                self.relaxation.halved_steps += 1;
                halvings += 1;
                seconds = if halvings == ALL_HALVINGS { whole } else { 0.5 * seconds };
                continue;
            };
            self.span = gamma * seconds;
            if self.comes_late(is_forced)? {
                flies = false;
                continue;
            }
            self.presses = touches;
            self.keep_data(time, seconds, gamma);
            self.note_step(gamma, exchanged, obstacles);
            if is_forced {
                self.flight.end();
                self.length = self.rotation.seconds.min(2.0 * seconds);
            }
            if touches {
                self.note_approaches(time);
            }
            return Ok(());
        }
    }

    /// Returns the loads, obstacles and supports at the end of a step, at an instant (s); `None`
    /// where they are constant.
    pub(super) fn data_at(&self, time: f64) -> Result<Option<Rc<ModalData>>> {
        if !self.system.drive.varies() {
            return Ok(None);
        }
        let data = self.loads.at(self.system, &self.modes, &self.saddle, &self.model.candidates, time)?;
        Ok(Some(Rc::new(data)))
    }

    /// Adds the nodes that come near as candidates, after a step in which the modes moved under
    /// forces or freely. Returns whether some of them are beyond their obstacle, so that the step
    /// must be repeated.
    pub(super) fn comes_late(&mut self, is_forced: bool) -> Result<bool> {
        let Some(tier) = self.reach.advance(&self.now, self.span, !is_forced) else { return Ok(false) };
        let Finding { near, is_late } = self.check_reach(tier, None);
        if !near.is_empty() {
            self.add_candidates(near)?;
        }
        if is_late {
            self.reach.retreat(self.span, tier);
        }
        Ok(is_late)
    }

    /// Adds an accepted step to the work and the statistics.
    fn note_step(&mut self, gamma: f64, [received, dissipated]: [f64; 2], obstacles: f64) {
        let dashpots = self.tips.take(&self.now, self.span);
        self.balance.work += gamma * (received + obstacles);
        self.relaxation.note(gamma, gamma * dissipated + dashpots, true);
        self.relaxation.dissipated_by_stops += dashpots;
    }

    /// Keeps the last state before contact of nodes that begin to touch.
    pub(super) fn note_approaches(&mut self, time: f64) {
        let State { x, v, reaction, .. } = &self.before;
        for &(k, i) in &self.model.own {
            if reaction[k] == 0.0 && self.now.reaction[k] != 0.0 {
                let velocity = dot(self.rows.col_as_slice(k), v);
                self.free[i] = Approach { time, deflection: x[k], velocity };
            }
        }
    }
}

/// Returns iterations and residual of the last contact problem; `None` where nothing touches.
fn answer(contact: &ComplianceSolver) -> Option<(u32, f64)> {
    (!contact.active.is_empty()).then_some((contact.iterations, contact.residual))
}
