//! Rate of U(p), evaluated where velocities are reported: with the singular mass a scheme knows the
//! velocity only as means over cells.
//!
//! While the set A of active bounds does not change, U(p) is affine in p, the load and the bounds.
//! If p moves at the velocity V, its rate W is
//!
//! ```math
//! \text{the least of } \tfrac12 W^T K W - F'^T W \text{ with } B W = C V, \quad G_A W = l'_A .
//! ```
//!
//! The constraint B W = C V is met by the method of multipliers, as for U(p). In each round
//! conjugate gradients find the reactions that hold the nodes of A: with given cell means a force
//! at a node hardly moves its neighbours, and about twenty iterations suffice on any mesh. The
//! factor is used as it is, whatever its contact candidates, so that reporting a velocity does not
//! change later steps.
//!
//! Slopes that stick to an obstacle by friction follow its motion in the plane in the same way.
//!
//! A node on a bound that yields with the stiffness k at its present depth does not follow the
//! bound: the rate r' of its reaction gives it the rate W = l' - r' / k.

use super::{MEAN_TOLERANCE, Potential, ROUNDS};
use crate::contact_law::ContactLaw;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, axpy, aypx, dot, subtract, waxpy};
use crate::obstacle::Bounds;
use crate::scheme::System;
use crate::scheme::drive::InstantData;

/// Largest number of iterations for the reactions that hold nodes at the rates of their bounds, and
/// the error of these rates, relative to the first guess, at which the iteration ends.
const MAX_HOLD_ITERATIONS: usize = 200;
const BOUND_RATE_TOLERANCE: f64 = 1e-11;

/// Error of the cell means, relative to V, above which the nodes in contact are released.
const MAX_CONTACT_MEAN_ERROR: f64 = 1e-10;

/// Closure that solves A x = b, with x in place of b.
type Solve<'s> = dyn FnMut(&mut [f64]) -> Result<()> + 's;

impl<E: Engine> Potential<'_, E> {
    /// Returns the rate of U(p), in m/s, one entry per dof, where p moves at the velocity v, load
    /// and bounds change at the rates `change`, the nodes with a nonzero `reaction` follow their
    /// bounds, and dofs that are `stuck` have the rates beside them. If no rate satisfies both the
    /// cell means and the rates of the bounds, as is possible without the inf-sup condition, the
    /// cell means take precedence. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub(in crate::scheme) fn rate(
        &mut self,
        v: &[f64],
        reaction: &[f64],
        change: &InstantData,
        stuck: &[(usize, f64)],
    ) -> Result<Vec<f64>> {
        let (system, penalty) = (self.system, self.penalty);
        let mut held = Held::new(system, reaction, change, stuck)?;
        let search = Search { system, penalty, v, change };
        let speed = system.engine.mass_norm_squared(&system.mass, v)?.sqrt();
        self.solver.without_bounds(&system.bounds, |solve| {
            let (w, distance) = search.rounds(&mut held, solve)?;
            if distance <= MAX_CONTACT_MEAN_ERROR * speed || system.total(held.nodes.len() as f64)? == 0.0 {
                return Ok(w);
            }
            held.nodes.clear();
            let (free, distance_of_free) = search.rounds(&mut held, solve)?;
            Ok(if distance_of_free < distance { free } else { w })
        })
    }
}

/// Conditions on the rate of U(p).
struct Search<'a, 's, E: Engine> {
    system: &'s System<E>,
    penalty: f64,
    v: &'a [f64],
    change: &'a InstantData,
}

impl<E: Engine> Search<'_, '_, E> {
    /// Runs the multiplier rounds. Returns the rate and the distance of its cell means from V in
    /// the norm of C.
    fn rounds(&self, held: &mut Held<E>, solve: &mut Solve) -> Result<(Vec<f64>, f64)> {
        let Search { system: System { engine, mass, stiffness, .. }, penalty, v, change } = *self;
        let speed = engine.mass_norm_squared(mass, v)?.sqrt();
        let (mut residual, mut multiplier) = (v.to_vec(), vec![0.0; v.len()]);
        let (mut augmented, mut projected) = (multiplier.clone(), multiplier.clone());
        let mut w = vec![0.0; engine.dofs()];
        let (mut x, mut product) = (w.clone(), w.clone());
        let mut distance = f64::INFINITY;
        for round in 1..=*ROUNDS.end() {
            waxpy(penalty, &residual, &multiplier, &mut augmented);
            engine.project_transpose(mass, &augmented, &mut x)?;
            engine.multiply(stiffness, &w, &mut product)?;
            subtract(&product, &mut x);
            change.add_load(&mut x);
            held.add_reaction_rates(&mut x);
            solve(&mut x)?;
            held.hold(&w, &mut x, solve)?;
            add(&x, &mut w);
            engine.project(mass, &x, &mut projected)?;
            subtract(&projected, &mut residual);
            axpy(penalty, &residual, &mut multiplier);
            let before = std::mem::replace(&mut distance, engine.mass_norm_squared(mass, &residual)?.sqrt());
            if round >= *ROUNDS.start() && (distance <= MEAN_TOLERANCE * speed || distance > 0.5 * before) {
                break;
            }
        }
        Ok((w, distance))
    }
}

/// Nodes in contact and the reaction rates that make them follow their obstacles.
struct Held<'s, E: Engine> {
    system: &'s System<E>,
    nodes: Vec<Node>,
    /// Square of the norm of the first error of the rates.
    first: Option<f64>,
}

/// Node in contact.
struct Node {
    dof: usize,
    /// Rate of the bound, in m/s.
    rate: f64,
    /// Stiffness of the node and its bound in series, in N/m, used as preconditioner, from the
    /// diagonal entry of K.
    weight: f64,
    /// Compliance of its bound, in m/N; 0 for a rigid one.
    compliance: f64,
    /// Rate of the reaction, in N/s.
    reaction_rate: f64,
}

impl<'s, E: Engine> Held<'s, E> {
    fn new(
        system: &'s System<E>,
        reaction: &[f64],
        change: &InstantData,
        stuck: &[(usize, f64)],
    ) -> Result<Held<'s, E>> {
        let System { engine, stiffness, bounds, .. } = system;
        let diagonal = engine.diagonal(&stiffness.into())?;
        let node = |i: usize| {
            let rate_of = |rates: &Bounds| if reaction[i] > 0.0 { rates.lower[i] } else { rates.upper[i] };
            let (dof, rate) = (bounds.dofs[i], change.bounds.as_ref().map_or(0.0, rate_of));
            let law = bounds.laws.pressed(i, reaction[i]);
            let compliance = law.map_or(0.0, |law| {
                let force = reaction[i].abs();
                1.0 / law.linearised(law.depth(force), force).stiffness
            });
            let weight = match compliance {
                0.0 => diagonal[dof],
                of_bound => 1.0 / (1.0 / diagonal[dof] + of_bound),
            };
            Node { dof, rate, weight, compliance, reaction_rate: 0.0 }
        };
        let slope = |&(dof, rate): &(usize, f64)| Node {
            dof,
            rate,
            weight: diagonal[dof],
            compliance: 0.0,
            reaction_rate: 0.0,
        };
        let touching = (0..bounds.len()).filter(|&i| reaction[i] != 0.0).map(node);
        let nodes = touching.chain(stuck.iter().map(slope)).collect();
        Ok(Held { system, nodes, first: None })
    }

    /// Adds the reaction rates found so far to `force`.
    fn add_reaction_rates(&self, force: &mut [f64]) {
        self.nodes.iter().for_each(|node| force[node.dof] += node.reaction_rate);
    }

    /// Adds to x the response to further reaction rates, so that w + x has the rates of the bounds.
    fn hold(&mut self, w: &[f64], x: &mut [f64], solve: &mut Solve) -> Result<()> {
        let Held { system, nodes, first } = self;
        let total = |a: &[f64], b: &[f64]| system.total(dot(a, b));
        let precondition = |nodes: &[Node], lags: &[f64]| -> Vec<f64> {
            nodes.iter().zip(lags).map(|(node, lag)| node.weight * lag).collect()
        };
        let lag = |node: &Node| {
            let rate = node.rate - w[node.dof] - x[node.dof];
            if node.compliance == 0.0 { rate } else { rate - node.compliance * node.reaction_rate }
        };
        let mut lags: Vec<f64> = nodes.iter().map(lag).collect();
        let mut direction = precondition(nodes, &lags);
        let mut size = total(&lags, &direction)?;
        let end = BOUND_RATE_TOLERANCE * BOUND_RATE_TOLERANCE * *first.get_or_insert(size);
        let mut answer = vec![0.0; x.len()];
        for _ in 0..MAX_HOLD_ITERATIONS {
            if size.is_nan() || size <= end {
                break;
            }
            answer.fill(0.0);
            nodes.iter().zip(&direction).for_each(|(node, d)| answer[node.dof] = *d);
            solve(&mut answer)?;
            let of_node = |(node, d): (&Node, &f64)| {
                if node.compliance == 0.0 { answer[node.dof] } else { answer[node.dof] + node.compliance * d }
            };
            let response: Vec<f64> = nodes.iter().zip(&direction).map(of_node).collect();
            let step = size / total(&response, &direction)?;
            axpy(step, &answer, x);
            nodes.iter_mut().zip(&direction).for_each(|(node, d)| node.reaction_rate += step * d);
            axpy(-step, &response, &mut lags);
            let preconditioned = precondition(nodes, &lags);
            let before = std::mem::replace(&mut size, total(&lags, &preconditioned)?);
            aypx(size / before, &preconditioned, &mut direction);
        }
        Ok(())
    }
}
