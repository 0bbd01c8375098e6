//! Vibration modes of an active set.
//!
//! While the set of nodes in contact does not change, the motion is linear,
//! `$z'' + D z' = h - H_A z$` with the stiffness of the page [`super::spectrum`], the diagonal
//! matrix D of the decay rates, and `$h = h_F + R_A^T \rho$`. In the eigenvectors V of `$H_A$` the
//! coordinates `$q = V^T z$` are decoupled where all rates are alike, `$D = \alpha$`, and where
//! nothing touches modes that have rates of their own.
//!
//! Otherwise contact couples the modes by the matrix `$V^T D V$`. The elastic ones then are
//! those of the page [`decoupling`](super::decoupling): with the equilibrium
//! `$q_s = W^{-2} V^T h$`,
//!
//! ```math
//! q = q_s + S p + T \dot p, \qquad \ddot p + c\,\dot p + w^2 p = 0 .
//! ```
//!
//! A rigid motion of a set moves no node in contact and has no part along the elastic modes of the
//! structure, so that nothing couples it.

use super::decoupling::Decoupling;
use super::reduction::ReducedModel;
use super::spectrum::{Held, Spectrum};
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::System;
use crate::vi::BoundStatus;
use faer::Mat;
use std::borrow::Cow;
use std::rc::Rc;

/// Entry of V^T D V off the diagonal, relative to the largest decay rate, below which it is
/// rounding.
const UNCOUPLED: f64 = 4.0 * f64::EPSILON;

/// Modes of one active set.
#[derive(Debug)]
pub(super) struct Modes {
    /// Contact status of each candidate.
    pub sides: Vec<BoundStatus>,
    /// Angular frequencies, in rad/s, ascending; rigid motions come first with 0.
    pub frequencies: Vec<f64>,
    /// Number of rigid motions.
    pub rigid: usize,
    /// Decay rates, in 1/s.
    pub damping: Vec<f64>,
    /// Eigenvalues and eigenvectors V.
    pub spectrum: Rc<Spectrum>,
    /// Modal forces, N entries: V^T h, or 0 for modes that damping couples.
    pub force: Vec<f64>,
    /// Watched quantity `offset + rows q` per candidate: the deflection (m) where the node is free,
    /// the reaction (N) where it is in contact.
    pub offset: Vec<f64>,
    pub rows: Mat<f64>,
    /// Interval in which the quantity must stay: between the obstacles, or the admissible sign of
    /// the reaction.
    pub limits: Vec<[f64; 2]>,
    /// Equations that damping couples; `None` where it couples no modes.
    pub coupling: Option<Coupling>,
}

/// Elastic modes that damping couples.
#[derive(Debug)]
pub(super) struct Coupling {
    pub decoupling: Rc<Decoupling>,
    /// Matrix that takes the rates of the modes to further terms of the watched quantities.
    pub rows: Mat<f64>,
    /// Forces V^T h, N entries.
    force: Vec<f64>,
    /// Equilibrium q_s of the elastic modes.
    equilibrium: Vec<f64>,
}

impl Modes {
    /// Computes the modes from the eigenvectors, and from the decoupled equations where they are
    /// known already.
    ///
    /// # Errors
    /// Returns the errors of [`Decoupling::new`] and [`Held::modal_force`].
    pub fn new<E: Engine>(
        system: &System<E>,
        reduction: &ReducedModel,
        held: Held,
        spectrum: Rc<Spectrum>,
        decoupling: Option<Rc<Decoupling>>,
    ) -> Result<Modes> {
        let ReducedModel { damping, bounds, rest_at, lift_at, compliance, .. } = reduction;
        let Spectrum { values, vectors, .. } = &*spectrum;
        let (w, rho, active) = (held.w(), held.rho(), &held.active);
        let bounded = held.sides.len();
        let floor = spectrum.floor();
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
        let modes = Modes {
            frequencies,
            rigid,
            damping: damping.clone(),
            force: held.modal_force(system, reduction, &spectrum)?.col_as_slice(0).to_vec(),
            offset: offset.col_as_slice(0).to_vec(),
            rows: rows * vectors,
            limits: (0..bounded).map(limit).collect(),
            sides: held.sides,
            spectrum: spectrum.clone(),
            coupling: None,
        };
        modes.with_damping(damping, decoupling)
    }

    /// Takes the decay rates of the coordinates z into account.
    fn with_damping(mut self, rates: &[f64], decoupling: Option<Rc<Decoupling>>) -> Result<Modes> {
        let least = rates.iter().copied().fold(f64::INFINITY, f64::min);
        let largest = rates.iter().copied().fold(0.0, f64::max);
        if least == largest || rates.is_empty() {
            return Ok(self);
        }
        let vectors = &self.spectrum.vectors;
        let weighted = Mat::from_fn(rates.len(), rates.len(), |i, k| rates[i] * vectors[(i, k)]);
        let matrix = vectors.transpose() * weighted;
        // Rigid motions have the decay rate of those of the structure, which is the least of all.
        let (size, rigid) = (rates.len(), self.rigid);
        self.damping = (0..size).map(|k| if k < rigid { least } else { matrix[(k, k)] }).collect();
        let elastic = matrix.get(rigid.., rigid..);
        let beside = |k: usize| (0..k).map(move |i| (i, k));
        let mut pairs = (0..elastic.ncols()).flat_map(beside);
        if pairs.all(|place| elastic[place].abs() <= UNCOUPLED * largest) {
            return Ok(self);
        }
        let decoupling = match decoupling {
            Some(decoupling) => decoupling,
            None => Rc::new(Decoupling::new(self.frequencies[rigid..].to_vec(), elastic)?),
        };
        let frequencies = &self.frequencies[rigid..];
        let equilibrium: Vec<f64> =
            self.force[rigid..].iter().zip(frequencies).map(|(force, w)| force / (w * w)).collect();
        let rows = self.rows.get(.., rigid..).to_owned();
        let shift = &rows * Mat::from_fn(equilibrium.len(), 1, |k, _| equilibrium[k]);
        self.offset.iter_mut().zip(shift.col_as_slice(0)).for_each(|(offset, shift)| *offset += shift);
        self.rows.get_mut(.., rigid..).copy_from(&rows * &decoupling.of_place);
        let mut rate_rows = Mat::zeros(rows.nrows(), size);
        rate_rows.get_mut(.., rigid..).copy_from(&rows * &decoupling.of_rate);
        let force = self.force.clone();
        self.force[rigid..].fill(0.0);
        self.frequencies[rigid..].copy_from_slice(&decoupling.frequencies);
        self.damping[rigid..].copy_from_slice(&decoupling.decays);
        self.coupling = Some(Coupling { decoupling, rows: rate_rows, force, equilibrium });
        Ok(self)
    }

    /// Returns q and q' (columns) of a state.
    pub fn coordinates<'a>(&self, state: &'a Mat<f64>) -> Cow<'a, Mat<f64>> {
        let Some(Coupling { decoupling, equilibrium, .. }) = &self.coupling else {
            return Cow::Borrowed(state);
        };
        let mut q = state.clone();
        q.get_mut(self.rigid.., ..).copy_from(decoupling.coupled(state.get(self.rigid.., ..)));
        for (k, place) in equilibrium.iter().enumerate() {
            q[(self.rigid + k, 0)] += place;
        }
        Cow::Owned(q)
    }

    /// Returns z and z' (columns) of a state.
    pub fn place(&self, state: &Mat<f64>) -> Mat<f64> {
        &self.spectrum.vectors * &*self.coordinates(state)
    }

    /// Returns the state of z and z' (columns).
    pub fn state(&self, place: &Mat<f64>) -> Mat<f64> {
        let mut q = self.spectrum.vectors.transpose() * place;
        let Some(Coupling { decoupling, equilibrium, .. }) = &self.coupling else { return q };
        for (k, place) in equilibrium.iter().enumerate() {
            q[(self.rigid + k, 0)] -= place;
        }
        let p = decoupling.decoupled(q.get(self.rigid.., ..));
        q.get_mut(self.rigid.., ..).copy_from(p);
        q
    }

    /// Returns `$h - H_A z$`, the accelerations with the damping added, of a state.
    pub fn pull(&self, state: &Mat<f64>) -> Mat<f64> {
        let q = self.coordinates(state);
        let pull = |k: usize| match &self.coupling {
            None => self.force[k] - self.frequencies[k].powi(2) * q[(k, 0)],
            Some(_) if k < self.rigid => self.force[k],
            Some(coupling) => coupling.force[k] - self.spectrum.values[k] * q[(k, 0)],
        };
        &self.spectrum.vectors * Mat::from_fn(self.frequencies.len(), 1, |k, _| pull(k))
    }

    /// Returns a bound of the norm of q'' from those of the accelerations of the modes, since that
    /// of a matrix N is at most the root of the product of its largest row and column sums.
    pub fn largest_acceleration(&self, of_modes: &[f64], growth: impl Fn(usize) -> f64) -> f64 {
        let norm = of_modes.iter().map(|a| a * a).sum::<f64>().sqrt();
        let Some(Coupling { decoupling, .. }) = &self.coupling else { return norm };
        let Decoupling { of_place, of_rate, .. } = &**decoupling;
        let size = of_place.ncols();
        let (mut of_rows, mut of_columns) = (vec![0.0_f64; size], vec![0.0_f64; size]);
        for k in 0..size {
            let growth = growth(self.rigid + k);
            for i in 0..size {
                let entry = of_place[(i, k)].abs() + growth * of_rate[(i, k)].abs();
                of_rows[i] += entry;
                of_columns[k] += entry;
            }
        }
        let largest = |sums: Vec<f64>| sums.into_iter().fold(1.0, f64::max);
        norm * (largest(of_rows) * largest(of_columns)).sqrt()
    }

    /// Returns the memory of the arrays, in bytes.
    pub fn bytes(&self) -> usize {
        let vectors = &self.spectrum.vectors;
        let watched = self.rows.nrows() * self.rows.ncols();
        let entries = vectors.nrows() * vectors.ncols() + watched;
        let vectors = 2 * self.frequencies.len() + 3 * self.sides.len();
        let coupling = self.coupling.as_ref();
        let coupling =
            coupling.map_or(0, |coupling| coupling.decoupling.bytes() + watched * size_of::<f64>());
        (entries + vectors) * size_of::<f64>() + self.sides.len() + coupling
    }
}
