//! Stretching of the mid-plane during a step of the conserving scheme.
//!
//! The force `$-\nabla V$` of the [quartic form](QuarticForm) acts in kicks, as contact does, and
//! every step is relaxed so that the energy with V is kept. V is a polynomial of degree four in
//! the relaxation gamma. The massless rest of the displacement does not stretch the plate.

use super::super::System;
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::membrane::{QuarticForm, Stretch};
use std::rc::Rc;

/// Stretching before a step and at the present position; without a form the plate only bends.
#[derive(Default)]
pub(super) struct Stretching {
    form: Option<Rc<QuarticForm>>,
    before: Stretch,
    now: Stretch,
}

impl Stretching {
    /// Prepares the stretching of a system.
    pub fn new<E: Engine>(system: &System<E>) -> Stretching {
        Stretching { form: system.drive.stretching.clone(), ..Stretching::default() }
    }

    /// Returns whether the plate stretches.
    pub fn is_there(&self) -> bool {
        self.form.is_some()
    }

    /// Makes the present position the one before a new step.
    pub fn begin_step(&mut self) {
        std::mem::swap(&mut self.now, &mut self.before);
    }

    /// Evaluates the present position.
    pub fn evaluate(&mut self, q: &[f64]) {
        if let Some(form) = &self.form {
            form.evaluate(q, &mut self.now);
        }
    }

    /// Moves the evaluation of the present position to q, `gamma` of the way from the one before.
    pub fn interpolate(&mut self, q: &[f64], gamma: f64) {
        if let Some(form) = &self.form {
            form.interpolate(q, gamma, &self.before, &mut self.now);
        }
    }

    /// Saves or restores the evaluation of the present position.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        if self.is_there() { archive.value(&mut self.now) } else { Ok(()) }
    }

    /// Returns the energy V of the present position, in J.
    pub fn energy(&self) -> f64 {
        self.now.energy()
    }

    /// Returns the size of the energies that add up to V before the step, in J.
    pub fn size(&self) -> f64 {
        self.before.size() + self.form.as_ref().map_or(0.0, |form| 2.0 * form.depth())
    }

    /// Adds the force before the step, times a duration (s), to the rates of the modes.
    pub fn kick_before(&self, seconds: f64, v: &mut [f64]) {
        self.before.add_gradient(-seconds, v);
    }

    /// Adds the present force, times a duration (s), to the rates of the modes.
    pub fn kick_now(&self, seconds: f64, v: &mut [f64]) {
        self.now.add_gradient(-seconds, v);
    }

    /// Returns the coefficients of 1, gamma, ..., gamma^4 of V over a step with an increment, in J.
    pub fn along(&self, increment: &[f64]) -> [f64; 5] {
        self.before.along(increment, &self.now)
    }
}
