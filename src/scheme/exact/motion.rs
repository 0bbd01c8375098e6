//! Motion of an active set: each mode in closed form.
//!
//! The motion of a mode is expressed by its responses to a unit impulse and to a unit step of
//! force, g and its integral, with g(0) = 0 and g'(0) = 1 and its decay rate `$\alpha$`:
//!
//! ```math
//! q = q_0 + q_0' g + (f - w^2 q_0) \int g, \qquad s = w g, \quad v = w^2 \int g, \quad g' = 1 - v - \tfrac{\alpha}{w} s .
//! ```
//!
//! Without damping s = sin wt and v = 1 - cos wt. With a = alpha/2 < w and
//! `$\omega^2 = w^2 - a^2$`,
//!
//! ```math
//! g = e^{-at} \frac{\sin \omega t}{\omega}, \qquad v = 1 - e^{-at} + e^{-at} (1 - \cos \omega t) - a g,
//! ```
//!
//! and with a >= w, `$\omega^2 = a^2 - w^2$` and the slow rate `$\sigma = w^2 / (a + \omega)$`,
//! which avoids the cancellation in a - omega,
//!
//! ```math
//! g = e^{-\sigma t} \frac{1 - e^{-2 \omega t}}{2 \omega}, \qquad v = 1 - e^{-\sigma t} - \sigma g .
//! ```
//!
//! Reactions are linear in q, and their impulse over an interval follows from the integral of q,
//! from the state at the start of the interval:
//!
//! ```math
//! \int q = q_0 t + q_0' \int g + (f - w^2 q_0) \iint g, \qquad \int s = \frac{v}{w}, \quad \int v = t - \frac{s}{w} - \frac{\alpha v}{w^2},
//! ```
//!
//! and, where the difference in the last formula would lose digits, the integral of v is taken from
//! the power series of v and `$\int_0^{2t} v = 2 \int_0^t v + v\,(t - \int_0^t v) + s \int_0^t s$`.
//!
//! Along a time grid s and v are advanced by recurrence: with `$s_h$` and `$v_h$` of one step,
//!
//! ```math
//! s(t+h) = s + s_h - s v_h - v s_h - \tfrac{\alpha}{w} s s_h, \qquad v(t+h) = v + v_h - v v_h + s s_h.
//! ```
//!
//! Each recurrence step is a rotation or a contraction: it does not amplify errors, and adds at
//! most four roundings. With s and v evaluated directly every [`ANCHOR`] instants, phases are
//! accurate to 4 ANCHOR roundings plus w times the rounding of the instants, which sin and cos have
//! as well.

use super::modes::Modes;
use super::responses::{phase, rigid_response, rigid_response_sums, sums};
use crate::archive::Archive;
use crate::error::Result;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use std::rc::Rc;

/// Number of grid instants between direct evaluations of sin and cos.
const ANCHOR: u32 = 32;

/// Motion of one active set from a known initial state.
#[derive(Debug)]
pub(super) struct ModalSolution {
    /// Modes of the active set.
    pub modes: Rc<Modes>,
    /// Time at which the motion began, in s; instants below are relative to it.
    pub start: f64,
    /// Initial q(0), then the coefficients of s and v; for rigid motions those of t and t^2, or
    /// their damped equivalents.
    place: Vec<f64>,
    sine: Vec<f64>,
    versine: Vec<f64>,
    /// Phases s and v at the last grid instant, and of one grid step.
    phases: [Vec<f64>; 2],
    turn: [Vec<f64>; 2],
    /// Number of grid instants so far.
    walked: u32,
    /// Integrals of s and v over one grid step, computed on request from the modes alone.
    sums: Vec<[f64; 2]>,
}

impl ModalSolution {
    /// Builds the motion from the state (q, q'), in columns.
    pub fn new(modes: Rc<Modes>, start: f64, state: &Mat<f64>) -> ModalSolution {
        let count = modes.frequencies.len();
        let (mut sine, mut versine) = (vec![0.0; count], vec![0.0; count]);
        for (k, &w) in modes.frequencies.iter().enumerate() {
            let (q, rate, force) = (state[(k, 0)], state[(k, 1)], modes.force[k]);
            (sine[k], versine[k]) =
                if k < modes.rigid { (rate, 0.5 * force) } else { (rate / w, force / (w * w) - q) };
        }
        let place = state.col_as_slice(0).to_vec();
        let (phases, turn) = Default::default();
        ModalSolution { modes, start, place, sine, versine, phases, turn, walked: 0, sums: Vec::new() }
    }

    /// Saves or restores all but the modes.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.start)?;
        archive.value(&mut self.walked)?;
        for vector in [&mut self.place, &mut self.sine, &mut self.versine] {
            archive.value(vector)?;
        }
        archive.value(&mut self.phases)?;
        archive.value(&mut self.turn)
    }

    /// Returns a bound, for all time, of a mode's distance from its equilibrium: the amplitude of
    /// the undamped motion from the same start, whose energy is no less. For a rigid motion the
    /// distance is that from its limit; 0 without damping.
    pub fn amplitude(&self, k: usize) -> f64 {
        match self.modes.damping[k] {
            _ if k >= self.modes.rigid => self.sine[k].hypot(self.versine[k]),
            0.0 => 0.0,
            damping => (self.sine[k] - 2.0 * self.versine[k] / damping).abs() / damping,
        }
    }

    /// Returns a growth factor of a mode's derivatives: the j-th derivative is at most the
    /// amplitude times the j-th power of it, in 1/s. It is the norm of the matrix of y' = w z, z' =
    /// -w y - alpha z.
    pub fn derivative_growth(&self, k: usize) -> f64 {
        let (w, decay) = (self.modes.frequencies[k], 0.5 * self.modes.damping[k]);
        if decay == 0.0 { w } else { decay + decay.hypot(w) }
    }

    /// Returns a bound, for all time, of the magnitude of a mode's acceleration.
    pub fn acceleration(&self, k: usize) -> f64 {
        match self.modes.damping[k] {
            0.0 if k < self.modes.rigid => 2.0 * self.versine[k].abs(),
            _ => self.amplitude(k) * self.derivative_growth(k).powi(2),
        }
    }

    /// Returns a bound on the magnitude of the terms that add up to a modal coordinate (for a rigid
    /// motion, at the start).
    pub fn magnitude(&self, k: usize) -> f64 {
        let swing = if k < self.modes.rigid { 0.0 } else { 2.0 * self.amplitude(k) };
        self.place[k].abs() + swing
    }

    /// Computes q and q' (columns) at an instant.
    pub fn state(&self, time: f64, state: &mut Mat<f64>) {
        self.rigid_state(time, state);
        let Modes { frequencies, damping, rigid, .. } = &*self.modes;
        for (k, (&w, &damping)) in frequencies.iter().zip(damping).enumerate().skip(*rigid) {
            let (s, v) = phase(w, damping, time);
            state[(k, 0)] = self.place[k] + self.sine[k] * s + self.versine[k] * v;
            state[(k, 1)] = w * (self.sine[k] * (1.0 - v - damping / w * s) + self.versine[k] * s);
        }
    }

    /// Computes q and q' like [`ModalSolution::state`], at the next instant of a grid with this
    /// step.
    pub fn walk(&mut self, time: f64, step: f64, state: &mut Mat<f64>) {
        let rigid = self.modes.rigid;
        let (frequencies, damping) = (&self.modes.frequencies[rigid..], &self.modes.damping[rigid..]);
        let phases_at = |time: f64| frequencies.iter().zip(damping).map(|(w, c)| phase(*w, *c, time)).unzip();
        if self.walked.is_multiple_of(ANCHOR) {
            self.phases = phases_at(time).into();
        } else {
            if self.walked == 1 {
                self.turn = phases_at(step).into();
            }
            let [sines, versines] = &mut self.phases;
            let [turn_sines, turn_versines] = &self.turn;
            let turns = turn_sines.iter().zip(turn_versines).zip(frequencies.iter().zip(damping));
            for ((s, v), ((sh, vh), (w, damping))) in sines.iter_mut().zip(versines).zip(turns) {
                let drag = damping / w * *s * sh;
                (*s, *v) = (*s + (sh - *s * vh - *v * sh - drag), *v + (vh - *v * vh + *s * sh));
            }
        }
        self.walked += 1;
        self.rigid_state(time, state);
        let (places, rates) = state.two_cols_mut(0, 1);
        let [sines, versines] = &self.phases;
        let phases = sines.iter().zip(versines).zip(frequencies.iter().zip(damping));
        let factors = self.place.iter().zip(&self.sine).zip(&self.versine).skip(rigid);
        let state = places.iter_mut().zip(rates.iter_mut()).skip(rigid);
        for (((q, rate), ((s, v), (w, damping))), ((place, sine), versine)) in state.zip(phases).zip(factors)
        {
            *q = place + sine * s + versine * v;
            *rate = w * (sine * (1.0 - v - damping / w * s) + versine * s);
        }
    }

    /// Returns the integral of q over a duration (s) from a state on; `step` tells that the
    /// duration is a grid step.
    pub fn integral(&mut self, state: &Mat<f64>, seconds: f64, step: bool) -> Vec<f64> {
        let Modes { frequencies, force, rigid, damping, .. } = &*self.modes;
        let elastic = || frequencies.iter().zip(damping).skip(*rigid);
        let all_sums = || elastic().map(|(w, c)| sums(*w, *c, seconds)).collect();
        let fresh: Vec<[f64; 2]>;
        let sums = match step {
            true if self.sums.len() + rigid < frequencies.len() => {
                self.sums = all_sums();
                &self.sums
            }
            true => &self.sums,
            false => {
                fresh = all_sums();
                &fresh
            }
        };
        let [of_rate, of_force] = match rigid {
            0 => [0.0; 2],
            _ => rigid_response_sums(damping[0], seconds),
        };
        let integral = |k: usize| {
            let (q, rate, force) = (state[(k, 0)], state[(k, 1)], force[k]);
            let [of_sine, of_versine] = match k.checked_sub(*rigid) {
                None => return q * seconds + rate * of_rate + force * of_force,
                Some(k) => sums[k],
            };
            let w = frequencies[k];
            q * seconds + rate / w * of_sine + (force / (w * w) - q) * of_versine
        };
        (0..frequencies.len()).map(integral).collect()
    }

    /// Computes the part of the state in rigid motions.
    fn rigid_state(&self, time: f64, state: &mut Mat<f64>) {
        if self.modes.rigid == 0 {
            return;
        }
        let damping = self.modes.damping[0];
        let (g, mean) = rigid_response(damping, time);
        let share = 1.0 - damping * g;
        for k in 0..self.modes.rigid {
            state[(k, 0)] = self.place[k] + g * (self.sine[k] + mean * self.versine[k]);
            state[(k, 1)] = share * self.sine[k] + 2.0 * g * self.versine[k];
        }
    }

    /// Computes the watched quantities of a state and their rates (columns).
    pub fn watch(&self, state: &Mat<f64>, values: &mut Mat<f64>) {
        let Modes { offset, rows, coupling, .. } = &*self.modes;
        affine(offset, rows, state, values);
        if let Some(coupling) = coupling {
            matmul(values.as_mut(), Accum::Add, &coupling.rows, self.rates(state), 1.0, Par::Seq);
        }
    }

    /// Returns the distance of a watched quantity of a state from a limit, and its rate.
    pub fn watch_one(&self, i: usize, limit: f64, state: &Mat<f64>) -> [f64; 2] {
        let Modes { offset, rows, coupling, .. } = &*self.modes;
        let [mut value, mut rate] = [offset[i] - limit, 0.0];
        let mut add = |rows: &Mat<f64>, state: &Mat<f64>| {
            for (k, &p) in rows.row(i).iter().enumerate() {
                value += p * state[(k, 0)];
                rate += p * state[(k, 1)];
            }
        };
        add(rows, state);
        if let Some(coupling) = coupling {
            add(&coupling.rows, &self.rates(state));
        }
        [value, rate]
    }

    /// Returns, for each watched quantity, a bound of the sum over the modes of a weight, which the
    /// place of a mode contributes, and of that times the growth factor of its derivatives, which
    /// its rate contributes where damping couples the modes.
    pub fn weighted(&self, weight: impl Fn(usize) -> f64) -> Vec<f64> {
        let Modes { rows, coupling, .. } = &*self.modes;
        let mut sums = vec![0.0; rows.nrows()];
        let mut add = |rows: &Mat<f64>, k: usize, weight: f64| {
            if weight != 0.0 {
                sums.iter_mut().zip(rows.col_as_slice(k)).for_each(|(sum, p)| *sum += weight * p.abs());
            }
        };
        for k in 0..rows.ncols() {
            add(rows, k, weight(k));
            if let Some(coupling) = coupling {
                add(&coupling.rows, k, weight(k) * self.derivative_growth(k));
            }
        }
        sums
    }

    /// Returns the rates and accelerations (columns) of a state.
    fn rates(&self, state: &Mat<f64>) -> Mat<f64> {
        let Modes { frequencies, damping, force, .. } = &*self.modes;
        Mat::from_fn(state.nrows(), 2, |k, j| match j {
            0 => state[(k, 1)],
            _ => force[k] - frequencies[k].powi(2) * state[(k, 0)] - damping[k] * state[(k, 1)],
        })
    }

    /// Returns the increments of q over a duration (s) from a state on.
    pub fn increments(&self, state: &Mat<f64>, seconds: f64) -> Vec<f64> {
        let mut after = Mat::zeros(state.nrows(), 2);
        ModalSolution::new(self.modes.clone(), 0.0, state).state(seconds, &mut after);
        (0..state.nrows()).map(|k| after[(k, 0)] - state[(k, 0)]).collect()
    }
}

/// Computes `offset + rows q` and `rows q'` (columns) from q and q' (columns).
pub(super) fn affine(offset: &[f64], rows: &Mat<f64>, state: &Mat<f64>, values: &mut Mat<f64>) {
    values.col_as_slice_mut(0).copy_from_slice(offset);
    values.col_as_slice_mut(1).fill(0.0);
    matmul(values.as_mut(), Accum::Add, rows, state, 1.0, Par::Seq);
}
