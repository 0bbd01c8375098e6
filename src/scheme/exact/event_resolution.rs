//! Active set after an event: which nodes are in contact just after a change of contact.
//!
//! Since `$\varphi$` is piecewise quadratic, the motion enters, at a border of several pieces, the
//! piece selected by its first non-vanishing derivative. With `$U_c = u + R z + S r$` and
//! `$S = G S G^T$` positive definite, the k-th derivatives of gaps and reactions of the undecided
//! nodes solve, order by order,
//!
//! ```math
//! U^{(k)}_c = R z^{(k)} + S r^{(k)}, \qquad 0 \le U^{(k)}_i \perp r^{(k)}_i \ge 0,
//! ```
//!
//! a linear complementarity problem with a unique solution. Nodes for which both vanish pass to the
//! next order, for which `$z^{(k+2)} = -H z^{(k)} - D z^{(k+1)} + R^T r^{(k)}$` is then known.
//! Grazing contact, simultaneous contacts and a start at rest in contact are thus decided by the
//! same rule. A solution changes its active set finitely often in finite time (Shen and Pang, SIAM
//! J. Control Optim. 44, 2005): events do not accumulate.

use super::reduction::ReducedModel;
use crate::vi::{Answer, BoundStatus, DenseProblem};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side as Triangle};

/// Number of derivatives evaluated. A node for which all vanish neither separates nor presses, and
/// counts as free.
const ORDERS: usize = 6;

/// Returns the contact status of all candidates just after an instant.
///
/// Arguments are the `sides` before, the `undecided` candidates with the side of the limit they are
/// at, position and velocity z, z' (columns), and the reactions of all candidates at that instant.
pub(super) fn next_sides(
    reduction: &ReducedModel,
    sides: &[BoundStatus],
    undecided: &[(usize, BoundStatus)],
    state: &Mat<f64>,
    reactions: &[f64],
    roundings: f64,
) -> Vec<BoundStatus> {
    let mut next = sides.to_vec();
    for &(i, _) in undecided {
        next[i] = BoundStatus::Free;
    }
    // The nodes in contact come first, then the undecided ones.
    let touching: Vec<usize> = (0..sides.len()).filter(|&i| next[i] != BoundStatus::Free).collect();
    let places: Vec<usize> = touching.iter().copied().chain(undecided.iter().map(|(i, _)| *i)).collect();
    let size = places.len();
    let compliance = Mat::from_fn(size, size, |i, j| reduction.compliance[(places[i], places[j])]);
    // This block of a factored matrix is positive definite.
    let Ok(llt) = compliance.llt(Triangle::Lower) else { return next };
    let stiffness = llt.inverse();
    let lift = Mat::from_fn(size, state.nrows(), |i, k| reduction.lift_at[(places[i], k)]);
    let mut lower = vec![0.0; size];
    let mut upper = vec![0.0; size];
    for (k, (_, side)) in undecided.iter().enumerate() {
        match side {
            BoundStatus::Upper => lower[touching.len() + k] = f64::NEG_INFINITY,
            _ => upper[touching.len() + k] = f64::INFINITY,
        }
    }
    let acceleration = |position: &Mat<f64>, velocity: &Mat<f64>, forces: &Mat<f64>| {
        let rates = &reduction.damping;
        let damped = Mat::from_fn(rates.len(), 1, |k, _| velocity[(k, 0)] * rates[k]);
        lift.transpose() * forces - &reduction.stiffness * position - damped
    };
    let forces = Mat::from_fn(size, 1, |k, _| if k < touching.len() { reactions[places[k]] } else { 0.0 });
    let position = state.get(.., ..1).to_owned();
    // Current derivative, and the one after it.
    let mut derivative = state.get(.., 1..2).to_owned();
    let mut following = acceleration(&position, &derivative, &forces) + &reduction.force;
    let mut open: Vec<usize> = (0..undecided.len()).collect();
    for _ in 0..ORDERS {
        if open.is_empty() {
            break;
        }
        let free = &lift * &derivative;
        let wanted = &stiffness * &free;
        let mut where_now = vec![BoundStatus::Lower; size];
        for k in 0..undecided.len() {
            where_now[touching.len() + k] = next[undecided[k].0];
        }
        let (mut rates, mut forces) = (vec![0.0; size], vec![0.0; size]);
        let rhs = wanted.col_as_slice(0);
        let mut answer = Answer { x: &mut rates, reaction: &mut forces };
        DenseProblem { matrix: &stiffness, rhs, lower: &lower, upper: &upper }
            .solve(&mut where_now, &mut answer);
        open.retain(|&k| {
            let (row, (i, side)) = (touching.len() + k, undecided[k]);
            let rounding = |matrix: &Mat<f64>, times: &Mat<f64>| -> f64 {
                let terms = (0..matrix.ncols()).map(|j| (matrix[(row, j)] * times[(j, 0)]).abs());
                roundings * f64::EPSILON * terms.sum::<f64>()
            };
            if rates[row].abs() > rounding(&lift, &derivative) {
                (lower[row], upper[row]) = (f64::NEG_INFINITY, f64::INFINITY);
            } else if forces[row].abs() > rounding(&stiffness, &free) {
                (lower[row], upper[row]) = (0.0, 0.0);
                next[i] = side;
            } else {
                return true;
            }
            false
        });
        let forces = Mat::from_fn(size, 1, |k, _| forces[k]);
        let after = acceleration(&derivative, &following, &forces);
        derivative = std::mem::replace(&mut following, after);
    }
    next
}
