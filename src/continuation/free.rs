//! Free vibrations over their energy: nonlinear normal modes.
//!
//! The unknowns are the state z, the period T and a factor x, and the equations are
//! `$(1 + x) P(z; T) - z = 0$` and `$f(z_0) \cdot (z - z_0) = 0$` with the rate f of the state at
//! the motion before, which takes the shift along the motion out (Muñoz-Almaraz and others, Physica
//! D 181 (2003) 1-38). The energy is kept, so that the first equations depend on each other: x
//! makes up for that and comes out as the error of the steps.

use super::driven::factors;
use super::family::{Family, ShootingEquations};
use super::orbit::{Orbit, Recorder};
use crate::assembly::Probe;
use crate::error::{Error, Result};
use crate::linalg::vectors::{dot, scale};
use crate::scheme::ReturnMap;
use crate::simulation::Model;
use faer::Mat;
use std::f64::consts::TAU;

/// Relative change of the period for the derivative by it.
const CHANGE: f64 = 1e-6;

/// Free vibrations of a plate; see the [module page](self).
pub struct Free<'s> {
    map: ReturnMap<'s>,
    probes: Vec<(Probe, Vec<f64>)>,
    steps: usize,
    /// Energy of the first motion, in J.
    energy: f64,
    /// Index of the natural mode that the first motion is near.
    mode: usize,
    factors: Vec<f64>,
    /// State of the motion before, in roots of energies, and the direction of its rate.
    before: [Vec<f64>; 2],
}

impl<'s> Free<'s> {
    /// Creates the family of a model that begins near a natural mode, counted from 1, with an
    /// energy in J. A period has as many steps as one of the natural mode has of `step` seconds.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a plate that is driven, damped or buckled, or that lacks the
    /// mode.
    pub fn new(model: &'s Model, step: f64, energy: f64, mode: usize) -> Result<Free<'s>> {
        let refused = |what: &str, expected: &str| {
            Error::Usage(format!("the plate {what}, and has no free vibrations; expected {expected}"))
        };
        if model.system.drive.varies() {
            return Err(refused("is driven", "--over and --period, or no formulas of t"));
        }
        if model.system.drive.stretching.as_ref().is_some_and(|form| form.is_buckled()) {
            return Err(refused("is buckled", "forces in the plane below the buckling load"));
        }
        let map = ReturnMap::new(&model.system, 1.0, 1, &[])?;
        if map.is_damped() {
            return Err(refused("is damped", "no [damping]"));
        }
        let squares = &map.modes.squares;
        let elastic = squares.iter().filter(|square| **square > 0.0).count();
        if mode == 0 || mode > elastic {
            return Err(Error::Usage(format!("--mode {mode}: expected a number from 1 to {elastic}")));
        }
        let (factors, mode) = (factors(squares), squares.len() - elastic + mode - 1);
        let (probes, steps) = (model.framed_deflections(), (TAU / factors[mode] / step).ceil() as usize);
        Ok(Free { map, probes, steps, energy, mode, factors, before: [Vec::new(), Vec::new()] })
    }

    /// Returns a state whose coordinates are roots of energies in modal coordinates, or back.
    fn scaled(&self, state: &[f64], back: bool) -> Vec<f64> {
        let one = |(k, value): (usize, &f64)| match self.factors.get(k) {
            Some(factor) if back => value * factor,
            Some(factor) => value / factor,
            None => *value,
        };
        state.iter().enumerate().map(one).collect()
    }

    /// Returns the state after a period (s), in roots of energies.
    fn end(&mut self, start: &[f64], period: f64) -> Result<Vec<f64>> {
        self.map.set_period(period, self.steps)?;
        let end = self.map.pass(start, false, &mut |_| {})?.end;
        Ok(self.scaled(&end, true))
    }
}

impl Family for Free<'_> {
    fn begin(&mut self) -> Result<Vec<f64>> {
        let mut state = self.scaled(&self.map.rest(), true);
        state[self.mode] += (2.0 * self.energy).sqrt();
        state.extend([TAU / self.factors[self.mode], 0.0]);
        self.accept(&state)?;
        Ok(state)
    }

    fn equations(&mut self, unknowns: &[f64]) -> Result<ShootingEquations> {
        let count = unknowns.len() - 2;
        let (state, period, factor) = (&unknowns[..count], unknowns[count], 1.0 + unknowns[count + 1]);
        let start = self.scaled(state, false);
        self.map.set_period(period, self.steps)?;
        let (passage, mut orbit) = Recorder::new(&self.probes).pass(&mut self.map, &start, period)?;
        let derivative = passage.derivative.unwrap_or_else(Mat::new);
        orbit.set_multipliers(&derivative, true)?;
        let end = self.scaled(&passage.end, true);
        let change = CHANGE * period;
        let [after, before] = [self.end(&start, period + change)?, self.end(&start, period - change)?];
        let [anchor, rate] = &self.before;
        let root = |k: usize| self.factors.get(k).copied().unwrap_or(1.0);
        let jacobian = Mat::from_fn(count + 1, count + 2, |i, j| match (i < count, j.checked_sub(count)) {
            (true, None) => factor * derivative[(i, j)] * root(i) / root(j) - f64::from(i == j),
            (true, Some(0)) => factor * (after[i] - before[i]) / (2.0 * change),
            (true, Some(_)) => end[i],
            (false, None) => rate[j],
            (false, Some(_)) => 0.0,
        });
        let mut residuals: Vec<f64> =
            end.iter().zip(state).map(|(end, state)| factor * end - state).collect();
        residuals
            .push(state.iter().zip(anchor).zip(rate).map(|((z, anchor), rate)| rate * (z - anchor)).sum());
        Ok(ShootingEquations { residuals, jacobian, scale: dot(state, state).sqrt(), orbit })
    }

    fn magnitudes(&self, unknowns: &[f64]) -> Vec<f64> {
        let count = unknowns.len() - 2;
        let mut magnitudes = vec![dot(&unknowns[..count], &unknowns[..count]).sqrt(); count];
        magnitudes.extend([unknowns[count], 1.0]);
        magnitudes
    }

    fn accept(&mut self, unknowns: &[f64]) -> Result<()> {
        let state = &unknowns[..unknowns.len() - 2];
        let start = self.scaled(state, false);
        let rate = self.map.rate(&start)?;
        let mut rate = self.scaled(&rate, true);
        let size = dot(&rate, &rate).sqrt();
        scale(1.0 / size, &mut rate);
        self.before = [state.to_vec(), rate];
        Ok(())
    }

    fn parameter(&self, _: &[f64], orbit: &Orbit) -> f64 {
        orbit.energy
    }

    fn held(&self) -> usize {
        self.mode
    }

    fn folds(&self) -> bool {
        false
    }
}
