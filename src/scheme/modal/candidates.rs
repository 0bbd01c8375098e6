//! Candidates for contact of the modal mass, which join as they come near.

use super::ModalScheme;
use super::contact_model::extended;
use super::data::ModalData;
use super::reach::{Check, Finding};
use super::state::kick;
use crate::error::Result;
use crate::kernels::lanes::norm;
use crate::linalg::Engine;
use faer::Mat;
use std::rc::Rc;
use std::time::Instant;

impl<E: Engine> ModalScheme<'_, E> {
    /// Evaluates the nodes of a tier and of all smaller ones at the present state.
    pub(super) fn check_reach(&mut self, tier: usize) -> Finding {
        let pull = self.now.pull(&self.modes.squares);
        let mut acceleration = pull.clone();
        kick(&self.rows, &self.now.reaction, 1.0, &mut acceleration);
        let acceleration = norm(&acceleration);
        self.reach.check(tier, &Check { model: &self.model, state: &self.now, pull, acceleration })
    }

    /// Adds candidates, ascending numbers of bounds. Collective.
    pub(super) fn add_candidates(&mut self, near: Vec<usize>) -> Result<()> {
        let clock = Instant::now();
        let old = self.model.candidates.clone();
        self.model.extend(&self.saddle, &self.all, &self.loads.limits, self.reach.rows(), &near)?;
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
        let same = Rc::ptr_eq(&self.now.data, &self.before.data);
        self.now.data = selected(&self.now.data);
        self.before.data = if same { self.now.data.clone() } else { selected(&self.before.data) };
        for state in [&mut self.now, &mut self.before] {
            state.extend(&self.model, &self.rows, &old);
        }
        self.extend_implicit(&selected, &old);
        self.contact = extended(&self.contact, &self.model, &old);
        let known = |i| old.binary_search(i).map_or(0.0, |k| self.mean[k]);
        self.mean = candidates.iter().map(known).collect();
        self.shown.forget();
        Ok(())
    }

    /// Extends the implicit rule, with data as they are `selected` for the present candidates.
    fn extend_implicit(&mut self, selected: &dyn Fn(&Rc<ModalData>) -> Rc<ModalData>, old: &[usize]) {
        let is_newmark = self.newmark_parameters().is_some();
        let ModalScheme { implicit, model, rows, before, now, .. } = self;
        let Some(implicit) = implicit else { return };
        implicit.extend(model, rows, old);
        // The first levels are not there yet while the start looks for candidates.
        if is_newmark && !implicit.next.q.is_empty() {
            implicit.next.data = selected(&implicit.next.data);
            implicit.next.extend(model, rows, old);
            for level in [before, now, &mut implicit.next] {
                level.respond(model, rows);
            }
        }
    }
}
