//! Reach of the bounded nodes that are no candidates for contact.
//!
//! Only candidates enter the contact problem. At a check all other nodes are evaluated; their
//! deflections at a state (q, r), a time t later, differ from `$y_i + \dot y_i t$` by at most
//!
//! ```math
//! |\Phi_i|\, \delta, \qquad \delta = |q - q_0 - \dot q_0 t| + \sum_k c_k |r_k - r_{k0}|, \qquad
//!    c_k = \max_i |H_{ik}| / |\Phi_i| ,
//! ```
//!
//! with the rows of the mode shapes and the displacements H per reaction. Until a horizon, no node
//! touches as long as `$\delta$` stays below the *radius*, the least of
//! `$\min(g_i, g_i + \dot g_i t) / |\Phi_i|$` over all distances g from the obstacles. This costs
//! as many operations per step as there are modes. Beyond the radius or the horizon, a new check
//! follows, which costs the number of bounded nodes times that of modes. Nodes that would keep the
//! radius below the change of the next steps become candidates.

use super::data::ModalData;
use super::state::State;
use crate::archive::Archive;
use crate::error::Result;
use crate::scheme::exact::reduction::ReducedModel;
use faer::Mat;
use std::rc::Rc;

/// Time in which nodes come near, in steps of the longest length that resolves the fastest mode.
const NEAR: f64 = 8.0;
/// Horizons of a check in such steps, and the share of the first one's radius that the radius of a
/// longer one must have.
const HORIZONS: [f64; 4] = [16.0, 64.0, 256.0, 1024.0];
const SHARE: f64 = 0.5;

/// Nodes out of reach; see the [module page](self).
#[derive(Debug)]
pub(super) struct Reach {
    /// Dofs of all bounds.
    dofs: Vec<usize>,
    /// Mode shapes at all bounds, one row each, with their norms.
    shapes: Mat<f64>,
    sizes: Vec<f64>,
    /// Weights c of the reactions, one entry per candidate.
    weights: Vec<f64>,
    /// Step, in s, that the horizon is measured in.
    step: f64,
    /// Deflections of all bounded nodes at the last check, in m; those of candidates mean nothing.
    pub deflections: Vec<f64>,
    /// State of the last check, and the time since, in s.
    q: Vec<f64>,
    v: Vec<f64>,
    reaction: Vec<f64>,
    data: Rc<ModalData>,
    seconds: f64,
    radius: f64,
    /// Horizon of the last check, in s.
    horizon: f64,
}

/// Result of a check.
pub(super) struct Finding {
    /// Nodes that come near, ascending indices of bounds.
    pub near: Vec<usize>,
    /// Whether some of them are beyond their obstacle.
    pub is_late: bool,
}

impl Reach {
    /// Creates the reach of all bounds, for steps of at most `step` seconds.
    pub fn new(model: &ReducedModel, dofs: &[usize], data: &Rc<ModalData>, step: f64) -> Reach {
        let shapes = Mat::from_fn(dofs.len(), model.lift.ncols(), |i, k| model.lift[(dofs[i], k)]);
        Reach {
            sizes: (0..dofs.len()).map(|i| shapes.row(i).norm_l2()).collect(),
            shapes,
            dofs: dofs.to_vec(),
            weights: Vec::new(),
            step,
            deflections: vec![0.0; dofs.len()],
            q: Vec::new(),
            v: Vec::new(),
            reaction: Vec::new(),
            data: data.clone(),
            seconds: f64::INFINITY,
            radius: 0.0,
            horizon: 0.0,
        }
    }

    /// Returns whether the last check was at the last state.
    pub fn is_fresh(&self) -> bool {
        self.seconds == 0.0
    }

    /// Forgets the last check.
    pub fn expire(&mut self) {
        self.seconds = f64::INFINITY;
    }

    /// Returns whether no node but candidates can touch at a state, `seconds` after the last one.
    pub fn is_safe(&mut self, state: &State, seconds: f64) -> bool {
        self.seconds += seconds;
        if self.seconds.is_nan() || self.seconds > self.horizon {
            return false;
        }
        let t = self.seconds;
        let strayed = state.q.iter().zip(self.q.iter().zip(&self.v)).map(|(q, (from, v))| q - from - v * t);
        let mut size = strayed.map(|d| d * d).sum::<f64>().sqrt();
        for (k, weight) in self.weights.iter().enumerate() {
            size += weight * (state.reaction[k] - self.reaction[k]).abs();
        }
        if !Rc::ptr_eq(&self.data, &state.data) {
            let (from, to) = (&self.data.all, &state.data.all);
            for (i, shape) in self.sizes.iter().enumerate() {
                let shift = to.shift[i] - from.shift[i];
                let closing = [to.lower[i] - from.lower[i] - shift, from.upper[i] - to.upper[i] + shift];
                // Absent obstacles have infinite bounds.
                let closing = closing.into_iter().filter(|c| c.is_finite()).fold(0.0, f64::max);
                if size + closing / shape > self.radius {
                    return false;
                }
            }
        }
        size <= self.radius
    }

    /// Evaluates all nodes but the candidates at a state, with the acceleration of its modes.
    pub fn check(&mut self, model: &ReducedModel, state: &State, acceleration: f64) -> Finding {
        let bounded = self.sizes.len();
        self.seconds = 0.0;
        self.q.clone_from(&state.q);
        self.v.clone_from(&state.v);
        self.reaction.clone_from(&state.reaction);
        self.data = state.data.clone();
        let limits = &state.data.all;
        let mut rates = vec![0.0; bounded];
        let y = &mut self.deflections;
        y.copy_from_slice(&limits.shift);
        for (k, (q, v)) in state.q.iter().zip(&state.v).enumerate() {
            let column = self.shapes.col_as_slice(k);
            for ((y, rate), shape) in y.iter_mut().zip(&mut rates).zip(column) {
                *y += shape * q;
                *rate += shape * v;
            }
        }
        let is_candidate = |i: usize| model.candidates.binary_search(&i).is_ok();
        for (k, r) in state.reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            let column = model.flexibility.col_as_slice(k);
            y.iter_mut().zip(&self.dofs).for_each(|(y, &dof)| *y += r * column[dof]);
        }
        let near_time = NEAR * self.step;
        let near_size = 0.5 * acceleration * near_time * near_time;
        let horizons = HORIZONS.map(|steps| steps * self.step);
        let mut finding = Finding { near: Vec::new(), is_late: false };
        let mut radii = [f64::INFINITY; HORIZONS.len()];
        for i in (0..bounded).filter(|&i| !is_candidate(i)) {
            let distances = [(y[i] - limits.lower[i], rates[i]), (limits.upper[i] - y[i], -rates[i])];
            for (distance, rate) in distances {
                let least = horizons.map(|time| distance.min(distance + rate * time) / self.sizes[i]);
                if least[0].is_nan() || least[0] <= near_size {
                    finding.near.push(i);
                    finding.is_late |= distance < 0.0;
                    break;
                }
                radii.iter_mut().zip(least).for_each(|(radius, least)| *radius = radius.min(least));
            }
        }
        let longest = (0..radii.len()).rev().find(|&k| radii[k] >= SHARE * radii[0]).unwrap_or(0);
        (self.horizon, self.radius) = (horizons[longest], radii[longest]);
        finding
    }

    /// Updates the weights of the reactions for new candidates.
    pub fn update_weights(&mut self, model: &ReducedModel) {
        let weight = |k: usize| {
            let column = model.flexibility.col_as_slice(k);
            let others = self.dofs.iter().zip(&self.sizes).enumerate();
            let others = others.filter(|(i, _)| model.candidates.binary_search(i).is_err());
            others.map(|(_, (&dof, size))| column[dof].abs() / size).fold(0.0, f64::max)
        };
        self.weights = (0..model.candidates.len()).map(weight).collect();
    }

    /// Saves or restores the last check. The weights follow from the candidates.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        for vector in [&mut self.deflections, &mut self.q, &mut self.v, &mut self.reaction] {
            archive.value(vector)?;
        }
        let mut data = (*self.data).clone();
        archive.value(&mut data)?;
        if !archive.saves() {
            self.data = Rc::new(data);
        }
        archive.value(&mut self.seconds)?;
        archive.value(&mut self.horizon)?;
        archive.value(&mut self.radius)
    }

    /// Replaces the data of the last check by equal ones that a state has.
    pub fn share_data(&mut self, data: &Rc<ModalData>) {
        self.data = data.clone();
    }
}
