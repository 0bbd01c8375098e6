//! Solver of nonlinear equations and complementarity problems.

#![allow(unsafe_code)]

use super::bounded::bounded_solver;
use super::callback::{Callback, CallbackSlot, Failure, guard, settle};
use super::error::{c_string, call, get, text};
use super::ksp::direct_defaults;
use super::options::Prefix;
use super::{Context, Matrix, Reason, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Residual<'a> = dyn FnMut(&Vector, &mut Vector) -> Result<()> + 'a;

bounded_solver! {
    /// Solver of f(x) = 0, or of the mixed complementarity problem between bounds l <= x <= u.
    Snes, SNES, Residual<'a>, set_jacobian,
    SNESCreate, SNESDestroy, SNESSetOptionsPrefix, SNESSetType, SNESSetJacobian, SNESVISetVariableBounds,
    SNESSetFromOptions, SNESGetIterationNumber
}

impl<'a> Snes<'a> {
    /// Works as [`super::Ksp::default_to_cholesky`] for the solver's linear systems. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn default_to_cholesky(&mut self) -> Result<()> {
        direct_defaults(&self.context, &self.prefix, true)
    }

    /// Sets the closure that writes f(x) into its second argument, a vector like `like`.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_residual(
        &mut self,
        like: &Vector,
        residual: impl FnMut(&Vector, &mut Vector) -> Result<()> + 'a,
    ) -> Result<()> {
        let (result, raw) = (like.duplicate()?, self.raw);
        self.function.set(&self.context, &self.failure, Box::new(residual), |state| {
            call!(SNESSetFunction(raw, result.raw, Some(call_residual), state))
        })
    }

    /// Sets whether to take at least one iteration, even if the start meets the tolerances.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn force_iteration(&mut self, force: bool) -> Result<()> {
        call!(SNESSetForceIteration(self.raw, sys::truth(force)))
    }

    /// Solves from the start in `x`, which then holds the last iterate. Collective.
    ///
    /// [`Self::reason`] tells whether the solve converged.
    ///
    /// # Errors
    /// Returns the error of a callback, or [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn solve(&mut self, x: &mut Vector) -> Result<()> {
        let result = call!(SNESSolve(self.raw, std::ptr::null_mut(), x.raw));
        settle(&self.failure, result)
    }

    /// Returns why the last solve ended.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn reason(&self) -> Result<Reason> {
        let (code, name) =
            (get!(SNESGetConvergedReason(self.raw))?, get!(SNESGetConvergedReasonString(self.raw))?);
        // SAFETY: PETSc returns a constant string.
        Ok(Reason { code: code.0, text: unsafe { text(name) } })
    }
}

unsafe extern "C" fn call_residual(
    _: sys::SNES,
    x: sys::Vec,
    f: sys::Vec,
    state: *mut c_void,
) -> sys::PetscErrorCode {
    // SAFETY: `state` is the callback that `set_residual` registered, and lives as long as the
    // solver. Only this function borrows it, never twice: a residual cannot reach its own solver.
    let callback = unsafe { &mut *state.cast::<Callback<Residual>>() };
    let Callback { context, failure, run } = callback;
    guard(failure, || run(&Vector::sharing(x, context)?, &mut Vector::sharing(f, context)?))
}
