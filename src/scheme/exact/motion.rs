//! The motion of an active set: each mode by itself, in closed form.
//!
//! Along a grid of instants the sines are not taken anew: with s = sin wt, v = 1 - cos wt and the same of a step, s_h and v_h,
//! \[ \sin w(t+h) = s + s_h - s v_h - v s_h, \qquad 1 - \cos w(t+h) = v + v_h - v v_h + s s_h. \]
//! A step is a rotation: it passes errors on unchanged in size, and adds at most four roundings. Taken anew every [`ANCHOR`] instants,
//! phases are right to 4 ANCHOR roundings, and to w times the rounding of the instants, as they are from sin and cos.

use super::modes::Modes;
use crate::archive::Archive;
use crate::error::Result;
use faer::Mat;
use pulp::{Arch, Simd, WithSimd};
use std::rc::Rc;

/// Instants of a grid from one at which sines are taken to the next.
const ANCHOR: u32 = 32;

/// A motion that began at a known instant.
#[derive(Debug)]
pub(super) struct Motion {
    /// The active set.
    pub modes: Rc<Modes>,
    /// When it began, in s; instants below count from there.
    pub start: f64,
    /// q(0), then the factors of sin wt and 1 - cos wt; for rigid motions those of t and t^2.
    place: Vec<f64>,
    sine: Vec<f64>,
    versine: Vec<f64>,
    /// sin wt and 1 - cos wt at the last instant of the grid, and of one of its steps.
    phases: [Vec<f64>; 2],
    turn: [Vec<f64>; 2],
    /// Instants of the grid so far.
    walked: u32,
    arch: Arch,
}

impl Motion {
    /// The motion from the state q, q' (columns) on.
    pub fn new(modes: Rc<Modes>, start: f64, state: &Mat<f64>) -> Motion {
        let count = modes.frequencies.len();
        let (mut sine, mut versine) = (vec![0.0; count], vec![0.0; count]);
        for (k, &w) in modes.frequencies.iter().enumerate() {
            let (q, rate, force) = (state[(k, 0)], state[(k, 1)], modes.force[k]);
            (sine[k], versine[k]) =
                if k < modes.rigid { (rate, 0.5 * force) } else { (rate / w, force / (w * w) - q) };
        }
        let place = state.col_as_slice(0).to_vec();
        let (phases, turn) = Default::default();
        Motion { modes, start, place, sine, versine, phases, turn, walked: 0, arch: Arch::new() }
    }

    /// Shows an archive all but the modes.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.start)?;
        archive.value(&mut self.walked)?;
        for vector in [&mut self.place, &mut self.sine, &mut self.versine] {
            archive.value(vector)?;
        }
        archive.value(&mut self.phases)?;
        archive.value(&mut self.turn)
    }

    /// Amplitude of a mode; 0 for a rigid motion.
    pub fn amplitude(&self, k: usize) -> f64 {
        if k < self.modes.rigid { 0.0 } else { self.sine[k].hypot(self.versine[k]) }
    }

    /// A bound of what a mode's coordinate is made of (of a rigid motion's, at the start).
    pub fn magnitude(&self, k: usize) -> f64 {
        self.place[k].abs() + 2.0 * self.amplitude(k)
    }

    /// q and q' (columns) at an instant.
    pub fn state(&self, at: f64, state: &mut Mat<f64>) {
        self.rigid_state(at, state);
        for (k, &w) in self.modes.frequencies.iter().enumerate().skip(self.modes.rigid) {
            let (sine, versine) = phase(w * at);
            state[(k, 0)] = self.place[k] + self.sine[k] * sine + self.versine[k] * versine;
            state[(k, 1)] = w * (self.sine[k] * (1.0 - versine) + self.versine[k] * sine);
        }
    }

    /// As [`Motion::state`], at the next instant of a grid of this step.
    pub fn walk(&mut self, at: f64, step: f64, state: &mut Mat<f64>) {
        let rigid = self.modes.rigid;
        let frequencies = &self.modes.frequencies[rigid..];
        let all = |time: f64| frequencies.iter().map(|w| phase(w * time)).unzip();
        if self.walked.is_multiple_of(ANCHOR) {
            self.phases = all(at).into();
        } else {
            if self.walked == 1 {
                self.turn = all(step).into();
            }
            let [sines, versines] = &mut self.phases;
            let [turn_sines, turn_versines] = &self.turn;
            let turns = turn_sines.iter().zip(turn_versines);
            for ((s, v), (sh, vh)) in sines.iter_mut().zip(versines).zip(turns) {
                (*s, *v) = (*s + (sh - *s * vh - *v * sh), *v + (vh - *v * vh + *s * sh));
            }
        }
        self.walked += 1;
        self.rigid_state(at, state);
        let (places, rates) = state.two_cols_mut(0, 1);
        let [sines, versines] = &self.phases;
        let phases = sines.iter().zip(versines).zip(frequencies);
        let factors = self.place.iter().zip(&self.sine).zip(&self.versine).skip(rigid);
        let state = places.iter_mut().zip(rates.iter_mut()).skip(rigid);
        for (((q, rate), ((s, v), w)), ((place, sine), versine)) in state.zip(phases).zip(factors) {
            *q = place + sine * s + versine * v;
            *rate = w * (sine * (1.0 - v) + versine * s);
        }
    }

    /// The rigid motions' part of the state.
    fn rigid_state(&self, at: f64, state: &mut Mat<f64>) {
        for k in 0..self.modes.rigid {
            state[(k, 0)] = self.place[k] + at * (self.sine[k] + at * self.versine[k]);
            state[(k, 1)] = self.sine[k] + 2.0 * at * self.versine[k];
        }
    }

    /// The watched quantities of a state, and their rates (columns).
    pub fn watch(&self, state: &Mat<f64>, values: &mut Mat<f64>) {
        let Modes { offset, rows, .. } = &*self.modes;
        let (value, rate) = values.two_cols_mut(0, 1);
        let (Some(value), Some(rate)) = (value.try_as_col_major_mut(), rate.try_as_col_major_mut()) else {
            return;
        };
        let (value, rate) = (value.as_slice_mut(), rate.as_slice_mut());
        value.copy_from_slice(offset);
        rate.fill(0.0);
        self.arch.dispatch(Watch { rows, state, value, rate });
    }
}

/// sin and 1 - cos of an angle: the latter is 2 sin^2 of the half, which keeps its digits near 0.
fn phase(angle: f64) -> (f64, f64) {
    let (s, c) = (0.5 * angle).sin_cos();
    (2.0 * s * c, 2.0 * s * s)
}

/// Columns of P taken together: fewer passes over the sums.
const TOGETHER: usize = 4;

/// value += P q, rate += P q' in the widest registers of the processor, in one pass over P.
struct Watch<'a> {
    rows: &'a Mat<f64>,
    state: &'a Mat<f64>,
    value: &'a mut [f64],
    rate: &'a mut [f64],
}

impl WithSimd for Watch<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Watch { rows, state, value, rate } = self;
        let (places, rates) = (state.col_as_slice(0), state.col_as_slice(1));
        let whole = rows.ncols() - rows.ncols() % TOGETHER;
        for k in (0..whole).step_by(TOGETHER) {
            let p: [&[f64]; TOGETHER] = std::array::from_fn(|j| &rows.col_as_slice(k + j)[..value.len()]);
            let (q, dq) = (&places[k..][..TOGETHER], &rates[k..][..TOGETHER]);
            for (i, (value, rate)) in value.iter_mut().zip(rate.iter_mut()).enumerate() {
                for j in 0..TOGETHER {
                    *value += p[j][i] * q[j];
                    *rate += p[j][i] * dq[j];
                }
            }
        }
        for k in whole..rows.ncols() {
            let (q, dq) = (places[k], rates[k]);
            for ((value, rate), p) in value.iter_mut().zip(rate.iter_mut()).zip(rows.col_as_slice(k)) {
                *value += p * q;
                *rate += p * dq;
            }
        }
    }
}
