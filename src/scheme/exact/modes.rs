//! Vibration modes of an active set.
//!
//! While the set of nodes in contact does not change, the motion is linear,
//! `$z'' + \alpha z' = h - H_A z$` with the stiffness of the page [`super::spectrum`] and
//! `$h = h_F + R_A^T \rho$`. In the eigenvectors V of `$H_A$` the coordinates `$q = V^T z$` are
//! decoupled.

use super::reduction::ReducedModel;
use super::spectrum::{Held, Spectrum};
use crate::vi::BoundStatus;
use faer::Mat;
use std::rc::Rc;

/// Multiple of the rounding error of the largest eigenvalue below which an eigenvalue is that of a
/// rigid motion.
const RIGID: f64 = 4.0;
/// Part of |x|^T |K| |x| that replaces the largest eigenvalue where all motions are rigid and it is
/// rounding itself.
const STIFF: f64 = 1e-4;

/// Modes of one active set.
#[derive(Debug)]
pub(super) struct Modes {
    /// Contact status of each candidate.
    pub sides: Vec<BoundStatus>,
    /// Angular frequencies, in rad/s, ascending; rigid motions come first with 0.
    pub frequencies: Vec<f64>,
    /// Number of rigid motions.
    pub rigid: usize,
    /// Damping coefficient alpha, in 1/s.
    pub damping: f64,
    /// Eigenvalues and eigenvectors V.
    pub spectrum: Rc<Spectrum>,
    /// Modal forces V^T h, N entries.
    pub force: Vec<f64>,
    /// Watched quantity `offset + rows q` per candidate: the deflection (m) where the node is free,
    /// the reaction (N) where it is in contact.
    pub offset: Vec<f64>,
    pub rows: Mat<f64>,
    /// Interval in which the quantity must stay: between the obstacles, or the admissible sign of
    /// the reaction.
    pub limits: Vec<[f64; 2]>,
}

impl Modes {
    /// Computes the modes from the eigenvectors.
    pub fn new(reduction: &ReducedModel, held: Held, spectrum: Rc<Spectrum>) -> Modes {
        let ReducedModel { damping, force, bounds, rest_at, lift_at, compliance, .. } = reduction;
        let Spectrum { values, magnitude, vectors, .. } = &*spectrum;
        let (w, rho, active) = (held.w(), held.rho(), &held.active);
        let bounded = held.sides.len();
        let h = force + held.lift.transpose() * rho;
        let largest = values.iter().copied().fold(STIFF * magnitude, f64::max);
        let floor = RIGID * f64::EPSILON * largest;
        let rigid = values.iter().take_while(|value| **value <= floor).count();
        let frequencies =
            values.iter().map(|value| if *value <= floor { 0.0 } else { value.sqrt() }).collect();
        // Watched quantities as functions of z.
        let coupling = Mat::from_fn(bounded, active.len(), |i, k| compliance[(i, active[k])]);
        let mut rows = lift_at - &coupling * w;
        let mut offset = rest_at + &coupling * rho;
        for (k, &i) in active.iter().enumerate() {
            rows.row_mut(i).copy_from(-w.row(k));
            offset[(i, 0)] = rho[(k, 0)];
        }
        let limit = |i: usize| match held.sides[i] {
            _ if bounds.holds(i) => [f64::NEG_INFINITY, f64::INFINITY],
            BoundStatus::Free => [bounds.lower[i], bounds.upper[i]],
            BoundStatus::Lower => [0.0, f64::INFINITY],
            BoundStatus::Upper => [f64::NEG_INFINITY, 0.0],
        };
        Modes {
            frequencies,
            rigid,
            damping: *damping,
            force: (vectors.transpose() * h).col_as_slice(0).to_vec(),
            offset: offset.col_as_slice(0).to_vec(),
            rows: rows * vectors,
            limits: (0..bounded).map(limit).collect(),
            sides: held.sides,
            spectrum,
        }
    }

    /// Returns the memory of the arrays, in bytes.
    pub fn bytes(&self) -> usize {
        let vectors = &self.spectrum.vectors;
        let entries = vectors.nrows() * vectors.ncols() + self.rows.nrows() * self.rows.ncols();
        let vectors = 2 * self.frequencies.len() + 3 * self.sides.len();
        (entries + vectors) * size_of::<f64>() + self.sides.len()
    }
}
