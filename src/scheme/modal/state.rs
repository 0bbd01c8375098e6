//! State of the modes and of the candidates for contact.

use super::contact_model::ContactModel;
use super::coordinates::Coordinates;
use super::data::ModalData;
use super::limits::Limits;
use crate::archive::Archive;
use crate::contact_law::ContactLaw;
use crate::error::Result;
use crate::kernels::lanes::{dot, dots, sum};
use crate::kernels::wide::widest;
use crate::linalg::Engine;
use crate::linalg::vectors::axpy;
use crate::scheme::{Start, System};
use faer::Mat;
use pulp::Arch;
use std::rc::Rc;

/// Number of candidates whose deflections are computed at once.
const ROWS: usize = 4;

/// State of the modes and of the candidates.
#[derive(Debug, Clone, Default)]
pub(super) struct State {
    /// Modal coordinates and their rates, in m and m/s times the root of kg.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    /// Whether y and x are those of q. Otherwise the candidates fly freely, without reactions.
    pub is_settled: bool,
    /// Deflections of the candidates without reactions and with them, in m.
    pub y: Vec<f64>,
    pub x: Vec<f64>,
    /// Reactions, in N.
    pub reaction: Vec<f64>,
    /// Distances of damped tips below those of undamped stops, in m; empty where no stop is damped.
    pub lags: Vec<f64>,
    /// Velocities of the support frame, in m/s, one entry per motion.
    pub frame_rates: Vec<f64>,
    pub data: Rc<ModalData>,
}

impl State {
    /// Creates the initial state of the modes, settled and without candidates and data. Collective.
    pub fn at_start<E: Engine>(system: &System<E>, start: &Start) -> Result<State> {
        let (q, v) = (system.projected(&start.displacement)?, system.projected(&start.velocity)?);
        let frame_rates = system.drive.rates(0.0)?;
        Ok(State { q, v, is_settled: true, frame_rates, ..State::default() })
    }

    /// Computes the deflections of new candidates, without reactions so far.
    pub fn extend(&mut self, model: &ContactModel, rows: &Mat<f64>, old: &[usize]) {
        let mut reaction = vec![0.0; model.candidates.len()];
        for (&number, r) in old.iter().zip(&self.reaction) {
            if let Ok(k) = model.candidates.binary_search(&number) {
                reaction[k] = *r;
            }
        }
        self.reaction = reaction;
        self.respond(model, rows);
        let Limits { lower, upper, .. } = &self.data.near;
        for (k, r) in self.reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            let depth = model.laws.pressed(k, *r).map_or(0.0, |law| law.depth(r.abs()));
            self.x[k] = if *r > 0.0 { lower[k] - depth } else { upper[k] + depth };
        }
    }

    /// Computes the deflections of the candidates without and with the reactions, whether or not
    /// these hold the bounds.
    pub fn respond(&mut self, model: &ContactModel, rows: &Mat<f64>) {
        self.settle_free(rows);
        for (k, r) in self.reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            axpy(*r, model.compliance.col_as_slice(k), &mut self.x);
        }
    }

    /// Computes the deflections of the candidates without reactions, given their rows of the mode
    /// shapes in columns.
    pub fn settle_free(&mut self, rows: &Mat<f64>) {
        let State { q, y, x, data, .. } = self;
        y.resize(rows.ncols(), 0.0);
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                // Several products at once fill the pipelines of the processor.
                let whole = y.len() - y.len() % ROWS;
                for i in (0..whole).step_by(ROWS) {
                    let products = dots(q, std::array::from_fn::<_, ROWS, _>(|k| rows.col_as_slice(i + k)));
                    for k in 0..ROWS {
                        y[i + k] = data.near.shift[i + k] + products[k];
                    }
                }
                for i in whole..y.len() {
                    y[i] = data.near.shift[i] + dot(rows.col_as_slice(i), q);
                }
            },
        );
        x.clone_from(y);
        x.iter_mut().zip(&self.lags).for_each(|(x, lag)| *x -= lag);
        self.is_settled = true;
    }

    /// Lets the candidates fly, without deflections.
    pub fn release(&mut self) {
        // A state that is not settled has no reactions.
        if self.is_settled {
            self.reaction.fill(0.0);
        }
        self.is_settled = false;
    }

    /// Returns whether any candidate is in contact.
    pub fn touches(&self) -> bool {
        self.is_settled && self.reaction.iter().any(|r| *r != 0.0)
    }

    /// Returns the pull h - w^2 q on the modes, without reactions.
    pub fn pull(&self, squares: &[f64]) -> Vec<f64> {
        let pairs = self.q.iter().zip(squares);
        self.data.force.iter().zip(pairs).map(|(h, (q, square))| h - square * q).collect()
    }

    /// Returns kinetic energy and elastic energy of the modes and reactions, in J, without that in
    /// bounds that yield.
    pub fn energies(&self, squares: &[f64]) -> [f64; 2] {
        let modes: f64 = self.q.iter().zip(squares).map(|(q, square)| square * q * q).sum();
        let rest: f64 =
            self.reaction.iter().zip(self.x.iter().zip(&self.y)).map(|(r, (x, y))| r * (x - y)).sum();
        [0.5 * dot(&self.v, &self.v), 0.5 * (modes + rest)]
    }

    /// Saves or restores the state. Collective.
    pub fn archive<E: Engine>(&mut self, archive: &mut Archive, modal: &Coordinates<E>) -> Result<()> {
        modal.archive(&mut self.q, archive)?;
        modal.archive(&mut self.v, archive)?;
        for vector in [&mut self.y, &mut self.x, &mut self.reaction] {
            archive.value(vector)?;
        }
        if !self.lags.is_empty() {
            archive.value(&mut self.lags)?;
        }
        archive.value(&mut self.is_settled)?;
        archive.value(&mut self.frame_rates)?;
        let mut data = (*self.data).clone();
        data.archive(archive, modal)?;
        if !archive.saves() {
            self.data = Rc::new(data);
        }
        Ok(())
    }
}

/// Adds A^T r over a duration (s) to the rates of the modes, with the rows of A in columns.
pub(super) fn kick(rows: &Mat<f64>, reaction: &[f64], seconds: f64, v: &mut [f64]) {
    for (i, r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
        axpy(seconds * r, rows.col_as_slice(i), v);
    }
}

/// Returns the kinetic and elastic energy of the modes, in J.
#[inline(always)]
pub(super) fn energy(squares: &[f64], q: &[f64], v: &[f64]) -> f64 {
    let size = squares.len();
    let (q, v) = (&q[..size], &v[..size]);
    0.5 * sum(size, |k| v[k] * v[k] + squares[k] * q[k] * q[k])
}
