//! Mean balance of forces over a step of the grid.
//!
//! With the means h of the modal force and r of the reactions over the step, and with the mean
//! acceleration a from the reported velocities, damping included, the modes have the mean
//! displacement
//!
//! ```math
//! \bar q = \Omega^{-2} (h + A^T r - a) ,
//! ```
//!
//! and the rest follows loads and reactions. Rigid motions have no restoring force, and their mean
//! displacement does not count. The balance then holds at every free dof.

use super::ModalScheme;
use super::data::ModalData;
use super::implicit::Implicit;
use super::mean_balance::MeanBalance;
use super::state::kick;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::{NewmarkParameters, Solution, StepBalance};

impl<E: Engine> ModalScheme<'_, E> {
    /// Begins to keep the balance.
    pub(super) fn begin_balance(&mut self) {
        let data = (*self.now.data).clone();
        let held = vec![(0.0, 1.0)];
        self.mean_balance =
            Some(MeanBalance { last: data.clone(), mean: data, held, ..MeanBalance::default() });
    }

    /// Begins a step of the grid.
    pub(super) fn begin_mean(&mut self) {
        let Some(mut balance) = self.mean_balance.take() else { return };
        let shown = self.shown();
        balance.q.clone_from(&shown.q);
        balance.v.clone_from(&shown.v);
        balance.frame_rates.clone_from(&shown.frame_rates);
        balance.begin();
        self.mean_balance = Some(balance);
    }

    /// Keeps the mean data of an accepted step, the part `gamma` of one of `seconds` from an
    /// instant (s) on.
    pub(super) fn keep_data(&mut self, time: f64, seconds: f64, gamma: f64) {
        let Some(balance) = &mut self.mean_balance else { return };
        if self.system.drive.varies() {
            balance.keep_loads(time + seconds, gamma);
            balance.last = ModalData::between(&self.before.data, &self.now.data, 0.5 / gamma);
        }
    }

    /// Returns the balance of the equation of the Newmark step from the present instant.
    pub(super) fn newmark_balance(&self, parameters: NewmarkParameters) -> StepBalance {
        let mut result = StepBalance::zero(self.system);
        let Implicit { next, reaction, .. } = &self.implicit;
        let beta = parameters.beta;
        let (before, now, dt) = (&self.before, &self.now, self.record.dt);
        let is_start = self.record.step == 0;
        let mut place = now.q.clone();
        for (k, place) in place.iter_mut().enumerate() {
            let difference = (next.q[k] - now.q[k]) - (now.q[k] - before.q[k]);
            // The unknown and the damped rate of the first step are those of its own equation.
            let (x, rate) = match is_start {
                true => (2.0 * (next.q[k] - now.q[k]), (next.q[k] - now.q[k]) / dt),
                false => (difference, now.v[k]),
            };
            *place += beta * x;
            result.acceleration[k] = difference / (dt * dt) + self.decays[k] * rate;
        }
        let ends = ModalData::between(&before.data, &next.data, 0.5);
        let mean = ModalData::between(&now.data, &ends, 2.0 * beta);
        self.modes.add_shapes(&place, &mut result.displacement);
        self.loads.add_response(&mean, &mut result.displacement);
        self.model.add_response(reaction, &mut result.displacement);
        result.loads = parameters.times(self.record.step);
        result.places = mean.places;
        result.support_rates.clone_from(&now.frame_rates);
        result.support_accelerations = self.support_accelerations(parameters);
        result
    }

    /// Returns the mean balance over the last step of the grid. Collective.
    pub(super) fn mean_balance(&mut self) -> Result<StepBalance> {
        let mut result = StepBalance::zero(self.system);
        if self.record.step == 0 {
            result.displacement.copy_from_slice(self.displacement());
            result.acceleration = self.now.pull(&self.modes.squares);
            kick(&self.rows, &self.now.reaction, 1.0, &mut result.acceleration);
            result.loads.push((0.0, 1.0));
            result.places.clone_from(&self.now.data.places);
            return Ok(result);
        }
        let Some(MeanBalance { q, v, frame_rates, mean, loads, .. }) = &self.mean_balance else {
            return Ok(result);
        };
        let (dt, shown) = (self.record.dt, self.shown());
        for (k, acceleration) in result.acceleration.iter_mut().enumerate() {
            *acceleration = ((shown.v[k] - v[k]) + self.decays[k] * (shown.q[k] - q[k])) / dt;
        }
        result.loads.clone_from(loads);
        result.places.clone_from(&mean.places);
        let mut pull = mean.force.clone();
        axpy(-1.0, &result.acceleration, &mut pull);
        for (k, (to, from)) in shown.frame_rates.iter().zip(frame_rates).enumerate() {
            let change = (to - from) / dt;
            result.support_accelerations[k] = change;
            axpy(-change, self.loads.support_momenta.col_as_slice(k), &mut pull);
        }
        let mut reaction = vec![0.0; self.model.candidates.len()];
        self.model.own.iter().for_each(|&(k, i)| reaction[k] = self.record.impulses[i] / dt);
        let reaction = self.system.engine.comm().all_reduce_sum_slice(&reaction);
        kick(&self.rows, &reaction, 1.0, &mut pull);
        for (pull, square) in pull.iter_mut().zip(&self.modes.squares) {
            *pull = if *square > 0.0 { *pull / square } else { 0.0 };
        }
        self.modes.add_shapes(&pull, &mut result.displacement);
        self.loads.add_response(mean, &mut result.displacement);
        self.model.add_response(&reaction, &mut result.displacement);
        Ok(result)
    }
}
