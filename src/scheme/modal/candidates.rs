//! Candidates for contact of the modal mass, which join as they come near.

use super::ModalConserving;
use super::data::ModalData;
use super::reach::Finding;
use super::state::{State, kick};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::dot;
use crate::vi::ComplianceSolver;
use std::rc::Rc;

impl<E: Engine> ModalConserving<'_, E> {
    /// Evaluates all nodes that are no candidates at the present state.
    pub(super) fn check_reach(&mut self) -> Finding {
        let State { q, reaction, data, .. } = &self.now;
        let mut pull = data.force.clone();
        for (pull, (square, q)) in pull.iter_mut().zip(self.modes.squares.iter().zip(q)) {
            *pull -= square * q;
        }
        kick(&self.model.lift_at, reaction, 1.0, &mut pull);
        self.reach.check(&self.model, &self.now, dot(&pull, &pull).sqrt())
    }

    /// Adds candidates, ascending indices of bounds.
    pub(super) fn add_candidates(&mut self, near: Vec<usize>) -> Result<()> {
        let old = self.model.candidates.clone();
        self.model.extend(self.system, &self.saddle, &near)?;
        let candidates = self.model.candidates.clone();
        self.grown.push(near);
        self.record.candidates = Some(candidates.clone());
        let selected = |data: &Rc<ModalData>| {
            let mut data = (**data).clone();
            data.select(&candidates);
            Rc::new(data)
        };
        let same = Rc::ptr_eq(&self.now.data, &self.before.data);
        self.now.data = selected(&self.now.data);
        self.before.data = if same { self.now.data.clone() } else { selected(&self.before.data) };
        for state in [&mut self.now, &mut self.before] {
            state.extend(&self.model, &old);
        }
        self.contact = extended(&self.contact, &candidates, &old);
        self.shown_contact = extended(&self.shown_contact, &candidates, &old);
        let mut mean = vec![0.0; candidates.len()];
        for (&of, r) in old.iter().zip(&self.mean) {
            if let Ok(k) = candidates.binary_search(&of) {
                mean[k] = *r;
            }
        }
        self.mean = mean;
        self.shown = self.now.clone();
        self.reach.update_weights(&self.model);
        self.reach.expire();
        Ok(())
    }
}

/// Returns a contact solver for more candidates, those that are new without contact.
fn extended(solver: &ComplianceSolver, candidates: &[usize], old: &[usize]) -> ComplianceSolver {
    let mut more = ComplianceSolver::new(candidates.len());
    more.factorisations = solver.factorisations;
    for (of, side) in old.iter().zip(&solver.sides) {
        if let Ok(k) = candidates.binary_search(of) {
            more.sides[k] = *side;
        }
    }
    more
}
