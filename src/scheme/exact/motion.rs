//! The motion of an active set: each mode by itself, in closed form.

use super::modes::Modes;
use faer::Mat;
use pulp::{Arch, Simd, WithSimd};
use std::rc::Rc;

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
        Motion { modes, start, place: state.col_as_slice(0).to_vec(), sine, versine, arch: Arch::new() }
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
        let rigid = self.modes.rigid;
        for k in 0..rigid {
            state[(k, 0)] = self.place[k] + at * (self.sine[k] + at * self.versine[k]);
            state[(k, 1)] = self.sine[k] + 2.0 * at * self.versine[k];
        }
        for (k, &w) in self.modes.frequencies.iter().enumerate().skip(rigid) {
            // 1 - cos wt = 2 sin^2(wt/2) keeps its digits near 0.
            let (s, c) = (0.5 * w * at).sin_cos();
            let (sine, versine) = (2.0 * s * c, 2.0 * s * s);
            state[(k, 0)] = self.place[k] + self.sine[k] * sine + self.versine[k] * versine;
            state[(k, 1)] = w * (self.sine[k] * (1.0 - versine) + self.versine[k] * sine);
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
        for k in 0..rows.ncols() {
            let (q, dq) = (places[k], rates[k]);
            for ((value, rate), p) in value.iter_mut().zip(rate.iter_mut()).zip(rows.col_as_slice(k)) {
                *value += p * q;
                *rate += p * dq;
            }
        }
    }
}
