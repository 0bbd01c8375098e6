//! Residuals of past steps, which the next step makes up for.
//!
//! Rounding the entries of A spoils the slow motions of fine meshes: the answer to a right-hand
//! side leaves a residual `$\delta = A x - b - G^T r$`, with a relative error `$\varepsilon$` of x
//! that [`estimate_factor_error`](crate::linalg::estimate_factor_error) tells. In
//! place of a correction within the step, the step from `$U^n$` is solved for
//! `$b^n - 2 \delta^{n-1} + \delta^{n-2}$`. What its equation misses is then
//!
//! ```math
//! m^n = A x - b^n - G^T r = \delta^n - 2 \delta^{n-1} + \delta^{n-2} .
//! ```
//!
//! The sums of these impulses, and the sums of the sums, do not grow with the number of steps: a
//! motion of frequency `$\omega$` keeps `$(\omega \Delta t)^2 \varepsilon$` of the error, and at
//! most `$4 \varepsilon$` where `$\omega \Delta t$` is large.
//!
//! # Limits
//!
//! The energy of the scheme changes by the work of `$m^n$`. Smooth motions give back what they
//! take; impacts, after which fast motions hold part of the energy, may not. The sum of that work
//! therefore has a budget of [`MAX_FED_WORK`] times the energy of the plate. A step that would
//! exceed it is solved again by itself, as is one whose forces are so much smaller than those
//! before it that its residual is above [`MAX_FED_RESIDUAL`], as in rigid flight. The [`PAUSE`]
//! steps after it are corrected within the step, too, as are the first ones of a run. A corrected
//! step leaves the residual of its answer before the correction, so that feeding begins without a
//! jump.
//!
//! Nothing is fed forward where doubles lose so many digits that A is factored with twice as many
//! from the start: there rounding errors of the products themselves, fed forward, change the energy
//! by 5e-8 in a step (cells of aspect ratio 1000). Nor is there anything to feed once corrections
//! have cost so much that digits were added, see [`crate::vi`].

use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::vectors::add;

/// KKT residual above which a step that fed residuals forward is solved again without them,
/// dimensionless.
const MAX_FED_RESIDUAL: f64 = 1e-11;
/// Largest sum of the work of missing forces over a run, relative to the energy of the plate.
const MAX_FED_WORK: f64 = 5e-12;
/// Number of steps that are corrected after one that had to be solved again.
const PAUSE: u32 = 8;
/// Number of steps that are corrected before feeding begins: the residuals of two are needed, and
/// the first step of a run has an equation of its own.
const FIRST_PAUSE: u32 = 3;

/// Residuals of the last two steps, and the work of what the steps so far have missed.
#[derive(Debug)]
pub(super) struct Feedback {
    /// Residuals `$\delta_{n-1}$` and `$\delta_{n-2}$`, each of the right-hand side that was solved
    /// for, before any correction, in N, one entry per dof. During a step whose right-hand side is
    /// reduced, the second vector holds the term `$2 \delta_{n-1} - \delta_{n-2}$` instead: a third
    /// vector would have to be read from memory too.
    residuals: [Vec<f64>; 2],
    /// Whether the step in hand is corrected within the step, and not reduced.
    is_corrected: bool,
    /// Number of steps that are still corrected.
    pause: u32,
    /// Work of the missing forces so far, in J.
    pub work: f64,
    /// Largest energy of the plate so far, in J.
    energy: f64,
}

impl Feedback {
    /// Creates the feedback of a plate with an energy, in J, before its first step.
    pub fn new(dofs: usize, energy: f64) -> Feedback {
        let zeros = vec![0.0; dofs];
        Feedback {
            residuals: [zeros.clone(), zeros],
            is_corrected: false,
            pause: FIRST_PAUSE,
            work: 0.0,
            energy,
        }
    }

    /// Takes note of an energy of the plate, in J.
    pub fn note_energy(&mut self, energy: f64) {
        self.energy = self.energy.max(energy);
    }

    /// Prepares a step with this right-hand side, and returns whether it is reduced, in place of
    /// corrections. Where residuals may not be fed forward, none of the step is taken, and feeding
    /// begins anew after that.
    pub fn begin_step(&mut self, may_feed: bool, b: &mut [f64]) -> bool {
        if !may_feed {
            self.pause = FIRST_PAUSE + 1;
        }
        self.is_corrected = self.pause > 0;
        if self.is_corrected {
            self.pause -= 1;
            return false;
        }
        let [last, earlier] = &mut self.residuals;
        for ((earlier, b), last) in earlier.iter_mut().zip(b).zip(last) {
            let term = 2.0 * *last - *earlier;
            *earlier = term;
            *b -= term;
        }
        true
    }

    /// Returns the term that the right-hand side of the step is reduced by, in N, one entry per
    /// dof; `None` for 0.
    pub fn term(&self) -> Option<&[f64]> {
        (!self.is_corrected).then_some(&self.residuals[1])
    }

    /// Returns whether a step with this KKT residual has to be solved again, where what it misses
    /// does the given work, in J.
    pub fn fails(&self, kkt: f64, work: f64) -> bool {
        let within = MAX_FED_WORK * self.energy;
        let spends = work.abs() > within || (self.work + work).abs() > within.max(self.work.abs());
        kkt.is_nan() || kkt > MAX_FED_RESIDUAL || spends
    }

    /// Restores the right-hand side of a step, given what the step missed, in N: it and those after
    /// it are corrected.
    pub fn withdraw(&mut self, missing: &[f64], b: &mut [f64]) {
        add(&self.residuals[1], b);
        self.take(missing);
        self.is_corrected = true;
        self.pause = PAUSE;
    }

    /// Takes what the answer to a step missed before any correction, in N.
    pub fn take(&mut self, missing: &[f64]) {
        self.residuals.swap(0, 1);
        let [last, _] = &mut self.residuals;
        if self.is_corrected {
            last.copy_from_slice(missing);
        } else {
            add(missing, last);
        }
    }

    /// Saves or restores all that the next step depends on.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.pause)?;
        archive.value(&mut self.work)?;
        archive.value(&mut self.energy)?;
        for residual in &mut self.residuals {
            archive.vector(VectorKind::Dofs, residual)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_work_of_missing_forces_stays_within_its_budget() {
        let mut feedback = Feedback::new(1, 1.0);
        assert!(!feedback.fails(0.0, 0.9 * MAX_FED_WORK));
        assert!(feedback.fails(0.0, -1.1 * MAX_FED_WORK));
        feedback.work += 0.9 * MAX_FED_WORK;
        assert!(feedback.fails(0.0, 0.2 * MAX_FED_WORK));
        assert!(!feedback.fails(0.0, -0.2 * MAX_FED_WORK));
        feedback.note_energy(2.0);
        assert!(!feedback.fails(0.0, 0.2 * MAX_FED_WORK));
        assert!(feedback.fails(f64::NAN, 0.0) && feedback.fails(2.0 * MAX_FED_RESIDUAL, 0.0));
    }

    #[test]
    fn a_withdrawn_step_is_followed_by_corrected_ones() {
        let mut feedback = Feedback::new(1, 1.0);
        for _ in 0..FIRST_PAUSE {
            let mut b = [1.0];
            assert!(!feedback.begin_step(true, &mut b) && feedback.term().is_none() && b == [1.0]);
            feedback.take(&[0.25]);
        }
        let mut b = [1.0];
        // 1 - 2 * 0.25 + 0.25
        assert!(feedback.begin_step(true, &mut b) && b == [0.75]);
        feedback.withdraw(&[0.125], &mut b);
        assert!(feedback.term().is_none() && b == [1.0]);
        assert!((0..PAUSE).all(|_| !feedback.begin_step(true, &mut b)));
        // The step that was withdrawn would have left 0.125 + 0.25; no other one has been taken.
        assert!(feedback.begin_step(true, &mut b) && b == [1.0 - 2.0 * 0.375 + 0.25]);
    }
}
