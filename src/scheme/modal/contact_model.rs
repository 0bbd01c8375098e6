//! Compliance of the rest of the displacement at the candidates for contact.

use super::all_bounds::AllBounds;
use super::limits::Limits;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::System;
use crate::scheme::exact::modal_saddle_point::ModalSaddlePoint;
use crate::scheme::exact::reduction::remains;
use crate::scheme::exact::saddle_point::SaddlePointSolver;
use faer::Mat;

/// Candidates for contact and the displacements that their reactions cause. All but those
/// displacements are the same on every rank.
#[derive(Debug)]
pub(super) struct ContactModel {
    /// Numbers of the candidates among all bounds, ascending.
    pub candidates: Vec<usize>,
    /// Position in `candidates`, and index among this rank's bounds, of each candidate that this
    /// rank has; in the order of the indices.
    pub own: Vec<(usize, usize)>,
    /// Largest finite magnitude of the candidates' bounds at rest, in m, or the size of the bounded
    /// motions if that is larger.
    pub magnitude: f64,
    /// Displacements H per unit reaction, one column per candidate with one entry per dof of this
    /// rank, in m/N.
    pub flexibility: Mat<f64>,
    /// Values of H at all bounds, and the compliance R at the candidates.
    pub at_bounds: Mat<f64>,
    pub compliance: Mat<f64>,
    /// Compliance of modes and rest together.
    whole: Mat<f64>,
}

impl ContactModel {
    /// Creates a model without candidates. `magnitude` is the size of the bounded motions, in m.
    pub fn new(magnitude: f64) -> ContactModel {
        ContactModel {
            candidates: Vec::new(),
            own: Vec::new(),
            magnitude,
            flexibility: Mat::new(),
            at_bounds: Mat::new(),
            compliance: Mat::new(),
            whole: Mat::new(),
        }
    }

    /// Adds candidates, ascending numbers of bounds with given limits at rest. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] where so many modes leave the candidates no compliance of
    /// their own, and the errors of the engine.
    pub fn extend<E: Engine>(
        &mut self,
        system: &System<E>,
        all: &AllBounds,
        limits: &Limits,
        saddle: &ModalSaddlePoint<E>,
        more: &[usize],
    ) -> Result<()> {
        let (dofs, comm) = (system.engine.dofs(), system.engine.comm());
        let forces = Mat::from_fn(dofs, more.len(), |i, j| f64::from(all.dof(more[j]) == Some(i)));
        let whole = all.rows(comm, &saddle.unconstrained(forces.clone())?);
        let flexibility = saddle.rest(&forces)?;
        let at_bounds = all.rows(comm, &flexibility);

        let known = self.candidates.len();
        let numbers: Vec<usize> = self.candidates.iter().chain(more).copied().collect();
        // Columns in the order of the candidates: the known ones, then the new ones.
        let mut order: Vec<usize> = (0..numbers.len()).collect();
        order.sort_unstable_by_key(|&k| numbers[k]);
        self.candidates = order.iter().map(|&k| numbers[k]).collect();
        self.list_own(all);
        self.note_magnitude(limits);
        let joined = |old: &Mat<f64>, new: &Mat<f64>| {
            let mut all = Mat::zeros(new.nrows(), order.len());
            for (j, &k) in order.iter().enumerate() {
                let column =
                    k.checked_sub(known).map_or_else(|| old.col_as_slice(k), |k| new.col_as_slice(k));
                all.col_as_slice_mut(j).copy_from_slice(column);
            }
            all
        };
        self.flexibility = joined(&self.flexibility, &flexibility);
        self.at_bounds = joined(&self.at_bounds, &at_bounds);
        let (candidates, at_bounds) = (&self.candidates, &self.at_bounds);
        self.whole = Mat::from_fn(order.len(), order.len(), |i, j| {
            match [order[i].checked_sub(known), order[j].checked_sub(known)] {
                [_, Some(k)] => whole[(candidates[i], k)],
                [Some(k), _] => whole[(candidates[j], k)],
                [None, None] => self.whole[(order[i], order[j])],
            }
        });
        self.compliance = Mat::from_fn(order.len(), order.len(), |i, j| {
            0.5 * (at_bounds[(candidates[i], j)] + at_bounds[(candidates[j], i)])
        });
        if remains(&self.compliance, &self.whole) { Ok(()) } else { Err(saddle.rigid_contact()) }
    }

    /// Lists the candidates of this rank.
    fn list_own(&mut self, all: &AllBounds) {
        let own = |(k, &number): (usize, &usize)| all.own(number).map(|i| (k, i));
        self.own = self.candidates.iter().enumerate().filter_map(own).collect();
        self.own.sort_unstable_by_key(|&(_, i)| i);
    }

    /// Computes the magnitude of the candidates' bounds.
    fn note_magnitude(&mut self, limits: &Limits) {
        let both = |&i: &usize| [limits.lower[i].abs(), limits.upper[i].abs()];
        let finite = self.candidates.iter().flat_map(both).filter(|bound| bound.is_finite());
        self.magnitude = finite.fold(self.magnitude, f64::max);
    }
}
