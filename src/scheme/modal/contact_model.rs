//! Compliance of the rest of the displacement at the candidates for contact.

use super::all_bounds::AllBounds;
use super::limits::Limits;
use crate::contact_law::{Laws, RIGID};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::exact::reduction::remains;
use crate::scheme::massless::contact_compliance::ContactCompliance;
use crate::scheme::massless::modal_saddle_point::ModalSaddlePoint;
use crate::vi::{ComplianceProblem, ComplianceSolver};
use faer::Mat;
use std::rc::Rc;

/// Candidates for contact and the displacements that their reactions cause. All but those
/// displacements are the same on every rank.
#[derive(Debug)]
pub(crate) struct ContactModel {
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
    /// Values of H at all bounds, one vector per candidate, in the order of [`BoundRows::places`].
    pub at_bounds: Vec<Vec<f64>>,
    /// Compliance R at the candidates, in m/N.
    pub compliance: Mat<f64>,
    /// Laws by which the bounds of the candidates yield.
    pub laws: Laws,
}

/// Mode shapes at all bounds, and the order in which values at them are kept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BoundRows<'a> {
    /// Mode shapes, one column per bound.
    pub shapes: &'a Mat<f64>,
    /// Place of each bound in an order in which neighbours are together, and the number of places.
    pub places: &'a [usize],
    pub lanes: usize,
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
            laws: Laws::default(),
        }
    }

    /// Returns the contact problem of the candidates, given their deflections without reactions and
    /// their bounds, in m.
    pub fn problem<'a>(
        &'a self,
        free: &'a [f64],
        lower: &'a [f64],
        upper: &'a [f64],
    ) -> ComplianceProblem<'a> {
        let (compliance, laws) = (&self.compliance, Some(&self.laws));
        ComplianceProblem { compliance, free, lower, upper, laws, softness: &[] }
    }

    /// Adds the displacement (m) of the rest under reactions of the candidates (N).
    pub fn add_response(&self, reaction: &[f64], u: &mut [f64]) {
        for (column, r) in self.flexibility.iter().zip(reaction).filter(|(_, r)| **r != 0.0) {
            axpy(*r, column, u);
        }
    }

    /// Adds candidates, ascending numbers of bounds, given the limits at rest of all bounds and the
    /// mode shapes there. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] where so many modes leave the candidates no compliance of
    /// their own, and the errors of the engine.
    pub fn extend<E: Engine>(
        &mut self,
        saddle: &ModalSaddlePoint<E>,
        global: &AllBounds,
        limits: &Limits,
        rows: BoundRows,
        more: &[usize],
    ) -> Result<()> {
        let engine = &saddle.system.engine;
        let BoundRows { shapes, places, lanes } = rows;
        let dofs: Vec<Option<usize>> = more.iter().map(|&number| global.dof(number)).collect();
        let along = Mat::from_fn(shapes.nrows(), more.len(), |k, j| shapes[(k, more[j])]);
        let flexibility = saddle.rest_of_units(&dofs, &along)?;
        for (column, &number) in flexibility.into_iter().zip(more) {
            let place = self.candidates.partition_point(|candidate| *candidate < number);
            self.candidates.insert(place, number);
            let mut placed = vec![0.0; lanes];
            let values = global.values(engine.comm(), &column);
            places.iter().zip(values).for_each(|(&place, value)| placed[place] = value);
            self.at_bounds.insert(place, placed);
            self.flexibility.insert(place, column);
        }
        self.list_own(global);
        self.note_magnitude(limits);
        let (candidates, at_bounds) = (&self.candidates, &self.at_bounds);
        self.compliance = Mat::from_fn(candidates.len(), candidates.len(), |i, j| {
            let [row, column] = [i, j].map(|k| places[candidates[k]]);
            0.5 * (at_bounds[j][row] + at_bounds[i][column])
        });
        if !global.laws.are_rigid() {
            self.laws =
                global.laws.with(candidates.iter().map(|&number| global.laws.numbers(number)).collect());
        }
        let whole = self.whole(shapes, &saddle.modes.squares, saddle.shift);
        let rigid = self.rigid(limits);
        let [compliance, whole] = [&self.compliance, &whole].map(|compliance| {
            Mat::from_fn(rigid.len(), rigid.len(), |i, j| compliance[(rigid[i], rigid[j])])
        });
        if remains(&compliance, &whole) {
            return Ok(());
        }
        let squares = saddle.modes.squares.clone();
        let shape = |i: usize, k: usize| shapes[(k, self.candidates[rigid[i]])];
        let shapes = Mat::from_fn(rigid.len(), squares.len(), shape);
        Err(ContactCompliance { compliance, shapes, squares }.refusal())
    }

    /// Returns the candidates with a rigid bound. Bounds that yield have a compliance of their own.
    fn rigid(&self, limits: &Limits) -> Vec<usize> {
        let has_rigid = |k: &usize| {
            let (number, [lower, upper]) = (self.candidates[*k], self.laws.numbers(*k));
            let [below, above] = [limits.lower[number], limits.upper[number]].map(f64::is_finite);
            below && lower == RIGID || above && upper == RIGID
        };
        (0..self.candidates.len()).filter(has_rigid).collect()
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
    fn list_own(&mut self, global: &AllBounds) {
        let indexed = |(k, &number): (usize, &usize)| global.own(number).map(|i| (k, i));
        self.own = self.candidates.iter().enumerate().filter_map(indexed).collect();
        self.own.sort_unstable_by_key(|&(_, i)| i);
    }

    /// Computes the magnitude of the candidates' bounds.
    fn note_magnitude(&mut self, limits: &Limits) {
        let both = |&i: &usize| [limits.lower[i].abs(), limits.upper[i].abs()];
        let finite = self.candidates.iter().flat_map(both).filter(|bound| bound.is_finite());
        self.magnitude = finite.fold(self.magnitude, f64::max);
    }
}

/// Returns a contact solver for the candidates of a model. Those that are not among the `old` ones
/// begin without contact.
pub(crate) fn extended(solver: &ComplianceSolver, model: &ContactModel, old: &[usize]) -> ComplianceSolver {
    let candidates = &model.candidates;
    let mut more = ComplianceSolver::new(candidates.len());
    if !model.laws.are_rigid() {
        more.prepare_softness();
    }
    more.factorisations = solver.factorisations;
    for (number, side) in old.iter().zip(&solver.sides) {
        if let Ok(k) = candidates.binary_search(number) {
            more.sides[k] = *side;
        }
    }
    more
}
