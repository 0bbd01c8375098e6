//! Schemes for the modal mass on the grid of the output.

use super::ModalScheme;
use super::data::ModalData;
use super::implicit::StepRule;
use super::limits::Limits;
use super::state::State;
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::Result;
use crate::kernels::lanes::dot;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::obstacle::Bounds;
use crate::scheme::relaxation::SAME_TIME;
use crate::scheme::{Approach, Scheme, Solution, Statistics, StepBalance, StepRecord};
use crate::vi::{BoundStatus, ComplianceSolver, StepReport};
use std::rc::Rc;

/// Rates of the parts of a displacement.
pub(super) struct Rates<'a> {
    /// Rates of the modes.
    pub modes: &'a [f64],
    /// Rates of the data that the rest follows; `None` where they count as constant.
    pub data: Option<ModalData>,
    /// Candidates with the rates of their reactions, in N/s.
    pub reactions: Vec<(usize, f64)>,
}

impl<E: Engine> ModalScheme<'_, E> {
    /// Adds the impulses of the reactions of the last step over a duration, in s.
    fn add_impulses(&mut self, seconds: f64) {
        if self.presses {
            self.list_candidates();
            for &(k, i) in &self.model.own {
                self.record.impulses[i] += seconds * self.mean[k];
            }
        }
        if let Some(balance) = &mut self.mean_balance {
            balance.add(seconds / self.record.dt);
        }
    }

    /// Lists the candidates in the record, as those that may be in contact.
    pub(super) fn list_candidates(&mut self) {
        let listed = self.record.candidates.get_or_insert_default();
        listed.clear();
        listed.extend(self.model.own.iter().map(|&(_, i)| i));
        self.is_listed = true;
    }

    /// Begins the record of a step. Only listed candidates have had reactions.
    pub(super) fn begin_record(&mut self) {
        let StepRecord { step, reaction, impulses, candidates, report, .. } = &mut self.record;
        *step += 1;
        *report = StepReport::default();
        let listed = candidates.get_or_insert_default();
        for &i in &*listed {
            (reaction[i], impulses[i]) = (0.0, 0.0);
        }
        listed.clear();
        self.is_listed = false;
    }

    /// Completes the record of a step, unless all candidates have flown.
    fn end_record(&mut self) {
        let is_between = self.ahead > 0.0;
        if self.now.touches() || is_between && self.before.touches() {
            self.list_candidates();
        }
        if !self.is_listed {
            return;
        }
        let share = self.share();
        let ModalScheme { now, before, rows, model, record, .. } = self;
        if !now.is_settled {
            now.settle_free(rows);
        }
        if is_between && !before.is_settled {
            before.settle_free(rows);
        }
        let StepRecord { dt, admissible, reaction, impulses, .. } = record;
        for &(k, i) in &model.own {
            admissible[i] =
                if is_between { before.x[k] + share * (now.x[k] - before.x[k]) } else { now.x[k] };
            reaction[i] = impulses[i] / *dt;
        }
    }

    /// Returns the part of the last step up to the grid instant.
    fn share(&self) -> f64 {
        if self.ahead > 0.0 { 1.0 - self.ahead / self.span } else { 1.0 }
    }

    /// Returns the state at the grid instant.
    pub(super) fn shown(&self) -> &State {
        if self.ahead > 0.0 { &self.between().0 } else { &self.now }
    }

    /// Returns the state at the grid instant between two steps, and the solver of its reactions.
    fn between(&self) -> &(State, ComplianceSolver) {
        self.shown.between.get_or_init(|| self.interpolate())
    }

    /// Returns the loads, obstacles and supports at the grid instant.
    fn shown_data(&self) -> Rc<ModalData> {
        let [before, now] = [&self.before.data, &self.now.data];
        match self.ahead <= 0.0 || Rc::ptr_eq(before, now) {
            true => now.clone(),
            false => ModalData::between(before, now, self.share()).into(),
        }
    }

    /// Goes on to the state at the grid instant.
    pub(super) fn show(&mut self) {
        self.shown.forget();
        if self.system.drive.moves_bounds() {
            let data = self.shown_data();
            self.show_limits(&data.all);
        }
        self.end_record();
    }

    /// Shows the limits of this rank's bounds, given those of all.
    pub(super) fn show_limits(&mut self, limits: &Limits) {
        self.global.restrict(&limits.lower, &mut self.shown.limits.lower);
        self.global.restrict(&limits.upper, &mut self.shown.limits.upper);
    }

    /// Interpolates q between the states around the grid instant, and computes the reactions.
    fn interpolate(&self) -> (State, ComplianceSolver) {
        let share = self.share();
        let (left, right) = (1.0 - share, share);
        // Cubic Hermite interpolation of q.
        let [of_before, of_now] = [left * left * (1.0 + 2.0 * share), right * right * (1.0 + 2.0 * left)];
        let [of_rate_before, of_rate_now] =
            [share * left * left * self.span, -left * share * share * self.span];
        let (before, now) = (&self.before, &self.now);
        let mut shown = State { data: self.shown_data(), ..now.clone() };
        for k in 0..now.q.len() {
            shown.q[k] = of_before * before.q[k]
                + of_now * now.q[k]
                + of_rate_before * before.v[k]
                + of_rate_now * now.v[k];
            shown.v[k] = left * before.v[k] + right * now.v[k];
        }
        shown.settle_free(&self.rows);
        let mut contact = self.contact.clone();
        let data = shown.data.clone();
        self.tips.solve(&mut contact, &self.model, &mut shown, &data.near, share * self.span);
        (shown, contact)
    }

    /// Returns the energy stored in bounds that yield and in the stretched mid-plane, at or just
    /// after the instant, in J.
    fn stored_energy(&self) -> f64 {
        let of_stops = || self.model.laws.stored_under(&self.now.reaction) + self.tips.stored(&self.now);
        self.newmark_parameters().map_or_else(
            || of_stops() + self.stretching.energy(),
            |parameters| parameters.stored_now(self.implicit.stored),
        )
    }

    /// Returns the displacement of the shown state, in m, one entry per dof.
    fn shape(&self) -> Vec<f64> {
        let State { q, x, reaction, data, is_settled, .. } = self.shown();
        let mut u = vec![0.0; self.system.engine.dofs()];
        self.modes.add_shapes(q, &mut u);
        self.loads.add_response(data, &mut u);
        self.model.add_response(reaction, &mut u);
        if *is_settled {
            self.model.own.iter().for_each(|&(k, i)| u[self.system.bounds.dofs[i]] = x[k]);
        }
        u
    }

    /// Returns the displacement of one dof, in m, by the sums of [`Self::shape`] in their order.
    fn shape_at(&self, dof: usize) -> f64 {
        let State { q, x, reaction, data, is_settled, .. } = self.shown();
        let ModalScheme { system, model, loads, .. } = self;
        let mut shown = model.own.iter().filter(|_| *is_settled);
        if let Some(&(k, _)) = shown.find(|(_, i)| system.bounds.dofs[*i] == dof) {
            return x[k];
        }
        let row = self.row(dof);
        let inertial = q.iter().zip(&*row).map(|(q, shape)| q * *shape);
        let acting = reaction.iter().enumerate().filter(|(_, r)| **r != 0.0);
        let pressed = acting.map(|(i, r)| r * model.flexibility[i][dof]);
        inertial.chain(loads.response_at(data, dof)).chain(pressed).fold(0.0, |sum, term| sum + term)
    }

    /// Returns the values of the mode shapes at a dof.
    fn row(&self, dof: usize) -> Rc<[f64]> {
        let row = || self.modes.shapes.row(dof).iter().copied().collect();
        self.shown.dof_rows.borrow_mut().entry(dof).or_insert_with(row).clone()
    }

    /// Returns the rates of the parts of the reported displacement.
    fn rates_of_parts(&self) -> Rates<'_> {
        if self.newmark_parameters().is_some() {
            return self.central_rates();
        }
        let v = &self.shown().v;
        let mut rates = Rates { modes: v, data: None, reactions: Vec::new() };
        let contact = if self.ahead > 0.0 { &self.between().1 } else { &self.contact };
        let active = &contact.active;
        if active.is_empty() || self.record.step == 0 {
            return rates;
        }
        if self.tips.are_there() {
            let reactions = self.now.reaction.iter().zip(&self.before.reaction).enumerate();
            rates.reactions = reactions.map(|(k, (now, before))| (k, (now - before) / self.span)).collect();
            rates.reactions.retain(|(_, rate)| *rate != 0.0);
            return rates;
        }
        let (now, before) = (&self.now.data, &self.before.data);
        let limit = |i: usize| {
            let [from, to] = match contact.sides[i] {
                BoundStatus::Upper => [before.near.upper[i], now.near.upper[i]],
                _ => [before.near.lower[i], now.near.lower[i]],
            };
            ((to - from) - (now.near.shift[i] - before.near.shift[i])) / self.span
        };
        let missing = |i: usize| limit(i) - dot(self.rows.col_as_slice(i), v);
        let mut forces: Vec<f64> = active.iter().map(|&i| missing(i)).collect();
        contact.solve_active(&mut forces);
        rates.reactions = active.iter().copied().zip(forces).collect();
        rates
    }

    /// Advances the conserving scheme to the next instant of the grid.
    fn advance_exactly(&mut self) -> Result<()> {
        self.begin_mean();
        let dt = self.record.dt;
        self.add_impulses(self.ahead.min(dt));
        self.ahead -= dt;
        while self.ahead < 0.0 {
            let time = self.time() + self.ahead;
            let (rest, part) = (-self.ahead, self.rotation.seconds);
            // A step in flight is exact whatever its length, and returns to the grid.
            let seconds = match self.now.touches() || self.stretching.is_there() {
                true => self.length,
                false if rest < (1.0 - SAME_TIME) * part => rest,
                false => part,
            };
            self.step_on(time, seconds)?;
            self.ahead += self.span;
            if self.ahead.abs() <= SAME_TIME * part {
                self.ahead = 0.0;
            }
            self.add_impulses(self.span - self.ahead.max(0.0));
        }
        self.show();
        Ok(())
    }
}

impl<E: Engine> Solution for ModalScheme<'_, E> {
    /// Returns the record of the last step. Its bounded configuration is that of the reported
    /// state, and its reactions are the mean over the last dt; at the start they are those at rest.
    /// For the Newmark scheme both are those of the step from the instant.
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        self.shown.shape.get_or_init(|| self.shape())
    }

    fn displacement_of(&self, dof: usize) -> f64 {
        self.shown.shape.get().map_or_else(|| self.shape_at(dof), |shape| shape[dof])
    }

    /// Returns the rate of the displacement, with the nodes in contact following their obstacles,
    /// in m/s; the central velocity for the Newmark scheme. With damped stops the rest follows the
    /// reactions over the last step.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let mut rates = vec![0.0; self.system.engine.dofs()];
        let Rates { modes, data, reactions } = self.rates_of_parts();
        self.modes.add_shapes(modes, &mut rates);
        data.iter().for_each(|data| self.loads.add_response(data, &mut rates));
        reactions.iter().for_each(|(k, rate)| axpy(*rate, &self.model.flexibility[*k], &mut rates));
        Ok(rates)
    }

    fn velocity_of(&mut self, dofs: &[usize]) -> Result<Vec<f64>> {
        let Rates { modes, data, reactions } = self.rates_of_parts();
        let rate = |&dof: &usize| {
            let pressed = reactions.iter().map(|(k, rate)| rate * self.model.flexibility[*k][dof]);
            let loaded = data.iter().flat_map(|data| self.loads.response_at(data, dof));
            let row = self.row(dof);
            row.iter().zip(modes).map(|(shape, v)| shape * v).chain(loaded).chain(pressed).sum()
        };
        Ok(dofs.iter().map(rate).collect())
    }

    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.shown().frame_rates.clone())
    }

    fn limits(&self) -> &Bounds {
        &self.shown.limits
    }

    /// Returns the energies of the state at or just after the instant.
    fn energies(&self) -> Result<Energies> {
        let State { reaction, data, .. } = &self.now;
        let [kinetic, elastic] = self.now.energies(&self.modes.squares);
        let elastic = elastic + self.stored_energy();
        let total = self.balance.offset + kinetic + elastic - self.balance.work;
        let elastic = elastic + self.loads.elastic(data) + dot(reaction, &data.near.shift);
        Ok(Energies { kinetic, elastic, work: kinetic + elastic - total })
    }

    fn invariant(&self) -> Result<f64> {
        match self.newmark_parameters() {
            Some(parameters) => Ok(self.newmark_invariant(parameters)),
            None => Ok(self.energies()?.total()),
        }
    }

    fn approach(&self, bound: usize) -> Approach {
        self.free[bound]
    }
}

impl<E: Engine> Scheme for ModalScheme<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.begin_record();
        match self.implicit.rule {
            StepRule::Splitting => self.advance_exactly(),
            StepRule::Midpoint => {
                self.begin_mean();
                self.midpoint_step(self.record.time())?;
                self.add_impulses(self.record.dt);
                self.show();
                Ok(())
            }
            StepRule::Newmark(parameters) => self.newmark_step(parameters),
        }
    }

    fn keep_balance(&mut self) -> Result<()> {
        self.begin_balance();
        Ok(())
    }

    /// Returns the mean balance over the last dt; at the start, and for the Newmark scheme, that of
    /// the instant.
    fn balance(&mut self) -> Result<StepBalance> {
        match self.newmark_parameters() {
            Some(parameters) => Ok(self.newmark_balance(parameters)),
            None => self.mean_balance(),
        }
    }

    fn dissipated_by_obstacles(&self) -> Vec<f64> {
        self.tips.taken.clone()
    }

    fn has_mean_reactions(&self) -> bool {
        self.newmark_parameters().is_none()
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.save_or_restore(archive)
    }

    fn statistics(&self) -> Statistics {
        Statistics {
            factorisations: self.contact.factorisations + self.implicit.contact.factorisations,
            relaxation: (self.implicit.rule == StepRule::Splitting).then_some(self.relaxation),
            ..Statistics::default()
        }
    }

    fn take_compliance_seconds(&mut self) -> f64 {
        std::mem::take(&mut self.compliance_seconds)
    }
}
