//! Compliance of the rest of the displacement at the candidates for contact.

use super::all_bounds::AllBounds;
use super::limits::Limits;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::exact::modal_saddle_point::ModalSaddlePoint;
use crate::scheme::exact::reduction::remains;
use crate::scheme::exact::saddle_point::SaddlePointSolver;
use crate::vi::ComplianceSolver;
use faer::Mat;
use std::rc::Rc;

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
    /// Displacements H per unit reaction, one vector per candidate with one entry per dof of this
    /// rank, in m/N.
    pub flexibility: Vec<Rc<[f64]>>,
    /// Values of H at all bounds, one vector per candidate.
    pub at_bounds: Vec<Vec<f64>>,
    /// Compliance R at the candidates, in m/N.
    pub compliance: Mat<f64>,
}

impl ContactModel {
    /// Creates a model without candidates. `magnitude` is the size of the bounded motions, in m.
    pub fn new(magnitude: f64) -> ContactModel {
        ContactModel {
            candidates: Vec::new(),
            own: Vec::new(),
            magnitude,
            flexibility: Vec::new(),
            at_bounds: Vec::new(),
            compliance: Mat::new(),
        }
    }

    /// Adds candidates, ascending numbers of bounds, given the limits at rest of all bounds and the
    /// mode shapes there, in columns. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] where so many modes leave the candidates no compliance of
    /// their own, and the errors of the engine.
    pub fn extend<E: Engine>(
        &mut self,
        saddle: &ModalSaddlePoint<E>,
        all: &AllBounds,
        limits: &Limits,
        shapes: &Mat<f64>,
        more: &[usize],
    ) -> Result<()> {
        let engine = &saddle.system.engine;
        let dofs: Vec<Option<usize>> = more.iter().map(|&number| all.dof(number)).collect();
        let along = Mat::from_fn(shapes.nrows(), more.len(), |k, j| shapes[(k, more[j])]);
        let flexibility = saddle.rest_of_units(&dofs, &along)?;
        for (column, &number) in flexibility.into_iter().zip(more) {
            let at = self.candidates.partition_point(|known| *known < number);
            self.candidates.insert(at, number);
            self.at_bounds.insert(at, all.values(engine.comm(), &column));
            self.flexibility.insert(at, column);
        }
        self.list_own(all);
        self.note_magnitude(limits);
        let (candidates, at_bounds) = (&self.candidates, &self.at_bounds);
        self.compliance = Mat::from_fn(candidates.len(), candidates.len(), |i, j| {
            0.5 * (at_bounds[j][candidates[i]] + at_bounds[i][candidates[j]])
        });
        let whole = self.whole(shapes, &saddle.modes.squares, saddle.shift);
        if remains(&self.compliance, &whole) { Ok(()) } else { Err(saddle.rigid_contact()) }
    }

    /// Returns the compliance of modes and rest together, in m/N. Where there are rigid motions, it
    /// is that of K + s M with the shift s, in (rad/s)^2.
    fn whole(&self, shapes: &Mat<f64>, squares: &[f64], shift: f64) -> Mat<f64> {
        let rows = Mat::from_fn(self.candidates.len(), squares.len(), |i, k| {
            shapes[(k, self.candidates[i])] / (squares[k] + shift).sqrt()
        });
        &rows * rows.transpose() + &self.compliance
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

/// Returns a contact solver for more candidates, those that are new without contact.
pub(super) fn extended(solver: &ComplianceSolver, candidates: &[usize], old: &[usize]) -> ComplianceSolver {
    let mut more = ComplianceSolver::new(candidates.len());
    more.factorisations = solver.factorisations;
    for (of, side) in old.iter().zip(&solver.sides) {
        if let Ok(k) = candidates.binary_search(of) {
            more.sides[k] = *side;
        }
    }
    more
}
