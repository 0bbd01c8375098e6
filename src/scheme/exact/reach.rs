//! Reach of the nodes that are not watched, with velocities of modes.
//!
//! Only the candidates are watched by the event detection; every other bounded node is out of
//! reach, and a check tells until when. At an instant of the present motion its displacement and
//! velocity follow from the coordinates z and from the reactions r of the nodes in contact A,
//!
//! ```math
//! y_i = u_i + \Phi_i z + H_{iA} r, \qquad
//! |y_i''| \le b_i = |\Phi_i|\, |z''|_{\max} + \sum_{k \in A} |H_{ik}|\, |r_k''|_{\max},
//! ```
//!
//! where `$\Phi_i$` is the node's row of the mode shapes and H has the displacements per reaction.
//! The maxima hold as long as the motion does: with a bound `$a_j$` of the acceleration of each
//! coordinate, `$w_j^2$` times its amplitude where nothing damps it,
//!
//! ```math
//! |z''|_{\max} = \Bigl( \sum_j a_j^2 \Bigr)^{1/2}, \qquad |r_k''|_{\max} = \sum_j |P_{kj}|\, a_j ,
//! ```
//!
//! since the eigenvectors of the motion are orthonormal and `$r_k = c_k + P_k q$`; where damping
//! couples the modes, the norm of the matrix that decouples them comes in. A node at the
//! distance g from its obstacle with the rate g' does not touch it before the root of
//! `$g + g' t - b_i t^2 / 2 = 0$`. Nodes whose root is nearer than a horizon become candidates, all
//! at once; the least root of the others is the time of the next check. The bound ends with the
//! motion, so that each event calls for a check as well. A check costs the number of bounded nodes
//! times that of modes, a step between checks nothing.

use super::motion::{ModalSolution, affine};
use super::options::ExactOptions;
use super::reduction::ReducedModel;
use crate::archive::Archive;
use crate::error::Result;
use crate::obstacle::Bounds;
use crate::vi::BoundStatus;
use faer::Mat;
use std::f64::consts::TAU;

/// Nodes out of reach; see the [module page](self).
#[derive(Debug)]
pub(super) struct Reach {
    /// Time of the next check, in s.
    pub next: f64,
    /// Candidates in the order in which they came into reach, each time ascending.
    pub grown: Vec<Vec<usize>>,
    /// Deflections (m) and rates (m/s) of all bounded nodes at the last check, in columns; those of
    /// candidates mean nothing.
    pub values: Mat<f64>,
    horizon: f64,
    /// Multiple of the rounding error of a deflection that is no distance.
    roundings: f64,
    /// Mode shapes at all bounds, one row each, with their norms.
    shapes: Mat<f64>,
    sizes: Vec<f64>,
    /// Deflections at z = 0 without reactions, in m, one entry per bound.
    rest: Vec<f64>,
}

impl Reach {
    /// Creates the reach of all bounds. A plate whose motions are all rigid has the period `dt`, in
    /// s.
    pub fn new(reduction: &ReducedModel, bounds: &Bounds, options: &ExactOptions, dt: f64) -> Reach {
        let ReducedModel { lift, rest, stiffness, .. } = reduction;
        let shapes = Mat::from_fn(bounds.len(), lift.ncols(), |i, k| lift[(bounds.dofs[i], k)]);
        let sizes = (0..bounds.len()).map(|i| shapes.row(i).norm_l2()).collect();
        let highest = (0..stiffness.nrows()).map(|k| stiffness[(k, k)]).fold(0.0, f64::max).sqrt();
        Reach {
            next: 0.0,
            grown: Vec::new(),
            values: Mat::zeros(bounds.len(), 2),
            horizon: options.horizon * if highest > 0.0 { TAU / highest } else { dt },
            roundings: options.roundings,
            shapes,
            sizes,
            rest: bounds.dofs.iter().map(|&dof| rest[(dof, 0)]).collect(),
        }
    }

    /// Saves or restores what the matrices do not tell.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.next)?;
        archive.value(&mut self.grown)
    }

    /// Checks all nodes but the candidates at an instant of a motion, and sets the time of the next
    /// check. Returns the nodes that come into reach before it, ascending.
    pub fn check(
        &mut self,
        reduction: &ReducedModel,
        bounds: &Bounds,
        motion: &ModalSolution,
        time: f64,
    ) -> Vec<usize> {
        let modes = &motion.modes;
        let mut state = Mat::zeros(modes.frequencies.len(), 2);
        let mut watched = Mat::zeros(modes.sides.len(), 2);
        motion.state(time, &mut state);
        motion.watch(&state, &mut watched);
        let place = modes.place(&state);
        affine(&self.rest, &self.shapes, &place, &mut self.values);

        let accelerations: Vec<f64> = (0..modes.frequencies.len()).map(|k| motion.acceleration(k)).collect();
        let growth = |k| motion.derivative_growth(k);
        let of_modes = modes.largest_acceleration(&accelerations, growth);
        let of_watched = motion.weighted(|k| accelerations[k]);
        let mut limits: Vec<f64> = self.sizes.iter().map(|size| size * of_modes).collect();
        for (k, _) in modes.sides.iter().enumerate().filter(|(_, side)| **side != BoundStatus::Free) {
            let column = reduction.flexibility.col_as_slice(k);
            let of_reaction = of_watched[k];
            let (reaction, rate) = (watched[(k, 0)], watched[(k, 1)]);
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                self.values[(i, 0)] += column[dof] * reaction;
                self.values[(i, 1)] += column[dof] * rate;
                limits[i] += column[dof].abs() * of_reaction;
            }
        }

        let now = motion.start + time;
        let place = place.col(0).norm_l2();
        let mut candidates = reduction.candidates.iter().peekable();
        let (mut near, mut least) = (Vec::new(), f64::INFINITY);
        for (i, limit) in limits.into_iter().enumerate() {
            if candidates.next_if_eq(&&i).is_some() {
                continue;
            }
            let (y, rate) = (self.values[(i, 0)], self.values[(i, 1)]);
            let slack = self.roundings * f64::EPSILON * (self.rest[i].abs() + self.sizes[i] * place);
            let below = safe_time(y - bounds.lower[i] - slack, rate, limit);
            let time = below.min(safe_time(bounds.upper[i] - y - slack, -rate, limit));
            // The time of the next check must differ from the present one.
            if time < self.horizon || now + time <= now {
                near.push(i);
            } else {
                least = least.min(time);
            }
        }
        self.next = now + least;
        near
    }
}

/// Returns a time (s) until which a distance (m) stays positive, given its rate (m/s) and a bound
/// of its acceleration (m/s^2).
fn safe_time(distance: f64, rate: f64, acceleration: f64) -> f64 {
    if distance.is_nan() || distance <= 0.0 {
        return 0.0;
    }
    let root = (rate * rate + 2.0 * acceleration * distance).sqrt();
    match rate {
        _ if rate < 0.0 => 2.0 * distance / (root - rate),
        _ if acceleration == 0.0 => f64::INFINITY,
        _ => (rate + root) / acceleration,
    }
}
