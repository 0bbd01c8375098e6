//! Candidates for contact of the modal mass, which join as they come near.

use super::ModalScheme;
use super::contact_model::extended;
use super::data::ModalData;
use super::reach::{Check, Finding};
use super::state::{State, kick};
use crate::error::Result;
use crate::kernels::lanes::norm;
use crate::linalg::Engine;
use faer::Mat;
use std::rc::Rc;
use std::time::Instant;

impl<E: Engine> ModalScheme<'_, E> {
    /// Evaluates the nodes of a tier and of all smaller ones, at the present state or another one.
    pub(super) fn check_reach(&mut self, tier: usize, probe: Option<&State>) -> Finding {
        let state = probe.unwrap_or(&self.now);
        let mut pull = state.pull(&self.modes.squares);
        self.stretching.kick_now(1.0, &mut pull);
        let mut acceleration = pull.clone();
        kick(&self.rows, &state.reaction, 1.0, &mut acceleration);
        let acceleration = norm(&acceleration);
        self.reach.check(tier, &Check { model: &self.model, state, pull, acceleration })
    }

    /// Adds the nodes that come near at the present state. Returns whether there are any.
    /// Collective.
    pub(super) fn admit_near(&mut self) -> Result<bool> {
        let near = self.check_reach(0, None).near;
        let has_some = !near.is_empty();
        if has_some {
            self.add_candidates(near)?;
        }
        Ok(has_some)
    }

    /// Adds candidates, ascending numbers of bounds. Collective.
    pub(super) fn add_candidates(&mut self, near: Vec<usize>) -> Result<()> {
        let clock = Instant::now();
        let old = self.model.candidates.clone();
        self.model.extend(&self.saddle, &self.global, &self.loads.limits, self.reach.rows(), &near)?;
        self.compliance_seconds += clock.elapsed().as_secs_f64();
        let candidates = self.model.candidates.clone();
        let shapes = &self.reach.shapes;
        self.rows = Mat::from_fn(shapes.nrows(), candidates.len(), |k, i| shapes[(k, candidates[i])]);
        self.reach.remove(&self.model, &old, &near);
        self.flight.end();
        self.grown.push(near);
        let selected = |data: &Rc<ModalData>| {
            let mut data = (**data).clone();
            data.select(&candidates);
            Rc::new(data)
        };
        self.tips.extend(&candidates, &old, [&mut self.now, &mut self.before]);
        let same = Rc::ptr_eq(&self.now.data, &self.before.data);
        self.now.data = selected(&self.now.data);
        self.before.data = if same { self.now.data.clone() } else { selected(&self.before.data) };
        for state in [&mut self.now, &mut self.before] {
            state.extend(&self.model, &self.rows, &old);
        }
        self.tips.begin(&self.before);
        let is_newmark = self.newmark_parameters().is_some();
        let ModalScheme { implicit, model, rows, before, now, .. } = self;
        implicit.extend(model, rows, &old);
        // The first levels are not there yet while the start looks for candidates.
        if is_newmark && !implicit.next.q.is_empty() {
            implicit.next.data = selected(&implicit.next.data);
            implicit.next.extend(model, rows, &old);
            for level in [before, now, &mut implicit.next] {
                level.respond(model, rows);
            }
        }
        self.contact = extended(&self.contact, &self.model, &old);
        if self.tips.are_there() {
            self.contact.prepare_softness();
        }
        let last_mean = |i| old.binary_search(i).map_or(0.0, |k| self.mean[k]);
        self.mean = candidates.iter().map(last_mean).collect();
        self.shown.forget();
        Ok(())
    }
}
