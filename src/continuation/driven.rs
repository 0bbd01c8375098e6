//! Periodic motions of a driven plate over a key of its scene.
//!
//! The unknowns are the state z at the start of the period and the key p, and the equations are
//! `$P(z; p) - z = 0$` with the return map P. Where the key changes the modes, z belongs to the
//! modes of the first motion.

use super::family::{Family, ShootingEquations};
use super::orbit::{Orbit, Recorder};
use crate::error::{Error, Result};
use crate::linalg::{Engine, MassModes, Native};
use crate::scheme::{Passage, ReturnMap, System};
use crate::simulation::Model;
use faer::linalg::solvers::Solve;
use faer::{ColMut, ColRef, Mat};

/// Change of the key for the derivative by it, in ranges of the key.
const CHANGE: f64 = 1e-6;

/// Change of the key that counts as much as a whole change of the state, in ranges of the key.
const WEIGHT: f64 = 0.4;

/// Scene at a value of the key, ready to move.
pub struct DrivenScene {
    /// Model of the scene.
    pub model: Model,
    /// Period of the drive, in s.
    pub period: f64,
}

/// Driven motions over a key; see the [module page](self).
pub struct Driven<'b> {
    build: &'b dyn Fn(f64) -> Result<DrivenScene>,
    /// First and last value of the key.
    range: [f64; 2],
    /// Periods of the drive in one of the motion, and steps in one of the drive.
    periods: usize,
    steps: usize,
    /// Periods of the drive before the first motion is sought.
    settle: usize,
    reference: Option<ReferenceModes>,
    /// Candidates for contact so far, with which all motions have the same steps.
    candidates: Vec<usize>,
}

/// Modes in whose coordinates the state is given.
struct ReferenceModes {
    shapes: Mat<f64>,
    /// Factors of the coordinates that turn energies into sums of squares, in 1/s.
    factors: Vec<f64>,
}

impl<'b> Driven<'b> {
    /// Creates the family of a scene that `build` makes at each value of the key.
    pub fn new(
        build: &'b dyn Fn(f64) -> Result<DrivenScene>,
        range: [f64; 2],
        [periods, steps, settle]: [usize; 3],
    ) -> Driven<'b> {
        Driven { build, range, periods, steps, settle, reference: None, candidates: Vec::new() }
    }

    /// Prepares the return map of a scene, and returns its period (s) too.
    fn map<'s>(&self, scene: &'s DrivenScene) -> Result<(ReturnMap<'s>, f64)> {
        let (period, steps) = (scene.period * self.periods as f64, self.steps * self.periods);
        Ok((ReturnMap::new(&scene.model.system, period, steps, &self.candidates)?, period))
    }

    /// Goes through the return map at a value of the key. The derivative and the measures of the
    /// period are made if asked for.
    fn pass(&mut self, state: &[f64], key: f64, is_measured: bool) -> Result<(Passage, Option<Orbit>)> {
        let scene = (self.build)(key)?;
        let (mut map, period) = self.map(&scene)?;
        let turn = self.turn(&scene.model.system, &map.modes)?;
        let product = |turn: &Mat<f64>| (turn * ColRef::from_slice(state)).iter().copied().collect();
        let start = turn.as_ref().map_or_else(|| state.to_vec(), product);
        let (mut passage, orbit) = if is_measured {
            let probes = scene.model.framed_deflections();
            let (passage, orbit) = Recorder::new(&probes).pass(&mut map, &start, period)?;
            (passage, Some(orbit))
        } else {
            (map.pass(&start, false, &mut |_| {})?, None)
        };
        self.candidates = map.candidates().to_vec();
        if let Some(turn) = &turn {
            let back = turn.partial_piv_lu();
            back.solve_in_place(ColMut::from_slice_mut(&mut passage.end).as_mat_mut());
            passage.derivative = passage.derivative.map(|derivative| back.solve(derivative * turn));
        }
        Ok((passage, orbit))
    }

    /// Returns the matrix from states in the modes of the reference to those in other modes; `None`
    /// where the modes are the same.
    fn turn(&self, system: &System<Native>, modes: &MassModes) -> Result<Option<Mat<f64>>> {
        let others = self.reference.as_ref().filter(|reference| reference.shapes != modes.shapes);
        let Some(ReferenceModes { shapes, .. }) = others else { return Ok(None) };
        let count = shapes.ncols();
        if (shapes.nrows(), count) != (modes.shapes.nrows(), modes.shapes.ncols()) {
            let wrong = "the key changes the number of dofs or of modes";
            return Err(Error::Usage(format!("{wrong}; expected one that keeps mesh and supports")));
        }
        let mut turn = Mat::zeros(2 * count, 2 * count);
        for j in 0..count {
            system.engine.project(
                &system.mass,
                shapes.col_as_slice(j),
                &mut turn.col_as_slice_mut(j)[..count],
            )?;
            let column = turn.col_as_slice(j)[..count].to_vec();
            turn.col_as_slice_mut(count + j)[count..].copy_from_slice(&column);
        }
        Ok(Some(turn))
    }

    /// Returns the energy norm of a state, in the root of J.
    fn norm(&self, state: &[f64]) -> f64 {
        let factors = self.reference.iter().flat_map(|reference| &reference.factors);
        let (q, v) = state.split_at(state.len() / 2);
        let squares = q.iter().zip(factors).map(|(q, factor)| (q * factor).powi(2));
        squares.chain(v.iter().map(|v| v * v)).sum::<f64>().sqrt()
    }
}

/// Returns the factors that turn modal coordinates into roots of energies, in 1/s: the frequencies,
/// and the lowest of them for rigid motions.
pub(super) fn factors(squares: &[f64]) -> Vec<f64> {
    let lowest = squares.iter().copied().find(|square| *square > 0.0).unwrap_or(1.0);
    squares.iter().map(|square| square.max(lowest).sqrt()).collect()
}

impl Family for Driven<'_> {
    /// Lets the plate of the first value settle from the start of the scene.
    fn begin(&mut self) -> Result<Vec<f64>> {
        let key = self.range[0];
        let scene = (self.build)(key)?;
        let (mut map, _) = self.map(&scene)?;
        if !scene.model.system.drive.varies() {
            let wrong = "nothing in the scene changes in time; --energy FROM..TO follows its free vibrations";
            return Err(Error::Usage(wrong.into()));
        }
        let mut state = map.project(&scene.model.start)?;
        for _ in 0..self.settle.div_ceil(self.periods) {
            state = map.pass(&state, false, &mut |_| {})?.end;
        }
        self.candidates = map.candidates().to_vec();
        let modes = &map.modes;
        self.reference =
            Some(ReferenceModes { shapes: modes.shapes.clone(), factors: factors(&modes.squares) });
        state.push(key);
        Ok(state)
    }

    fn equations(&mut self, unknowns: &[f64]) -> Result<ShootingEquations> {
        let count = unknowns.len() - 1;
        let (state, key) = (&unknowns[..count], unknowns[count]);
        let (Passage { end, derivative: Some(mut jacobian) }, Some(mut orbit)) =
            self.pass(state, key, true)?
        else {
            return Err(Error::Singular("no derivative of a period".into()));
        };
        orbit.set_multipliers(&jacobian, false)?;
        // The change stays within the range.
        let change = CHANGE * (self.range[1] - self.range[0]);
        let change = if (key - self.range[0]) / change > 0.5 / CHANGE { -change } else { change };
        let beside = self.pass(state, key + change, false)?.0.end;
        (0..count).for_each(|k| jacobian[(k, k)] -= 1.0);
        jacobian.resize_with(count, count + 1, |i, _| (beside[i] - end[i]) / change);
        let mut residuals: Vec<f64> = end.iter().zip(state).map(|(end, state)| end - state).collect();
        // All equations are in roots of energies.
        for (k, factor) in self.reference.iter().flat_map(|reference| &reference.factors).enumerate() {
            residuals[k] *= factor;
            jacobian.row_mut(k).iter_mut().for_each(|entry| *entry *= factor);
        }
        Ok(ShootingEquations { residuals, jacobian, scale: self.norm(state).max(self.norm(&end)), orbit })
    }

    fn magnitudes(&self, unknowns: &[f64]) -> Vec<f64> {
        let state = &unknowns[..unknowns.len() - 1];
        let size = self.norm(state);
        let factors = self.reference.iter().flat_map(|reference| &reference.factors);
        let mut magnitudes: Vec<f64> = factors.map(|factor| size / factor).collect();
        magnitudes.resize(state.len(), size);
        magnitudes.push(WEIGHT * (self.range[1] - self.range[0]).abs());
        magnitudes
    }

    fn accept(&mut self, _: &[f64]) -> Result<()> {
        Ok(())
    }

    fn parameter(&self, unknowns: &[f64], _: &Orbit) -> f64 {
        unknowns[unknowns.len() - 1]
    }

    fn held(&self) -> usize {
        self.reference.as_ref().map_or(0, |reference| 2 * reference.factors.len())
    }

    fn folds(&self) -> bool {
        true
    }
}
