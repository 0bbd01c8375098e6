//! Solver of bound-constrained minimisation problems.

#![allow(unsafe_code)]

use super::bounded::bounded_solver;
use super::callback::{Callback, CallbackSlot, Failure, guard, settle};
use super::error::{c_string, call, get};
use super::ksp::direct_defaults;
use super::options::Prefix;
use super::{Context, Matrix, Reason, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Objective<'a> = dyn FnMut(&Vector, &mut Vector) -> Result<f64> + 'a;

bounded_solver! {
    /// Solver that minimises a function between bounds.
    Tao, Tao, Objective<'a>, set_hessian,
    TaoCreate, TaoDestroy, TaoSetOptionsPrefix, TaoSetType, TaoSetHessian, TaoSetVariableBounds,
    TaoSetFromOptions, TaoGetIterationNumber
}

impl<'a> Tao<'a> {
    /// Makes a Cholesky factorisation by MUMPS the default preconditioner. Collective.
    ///
    /// The user's options override it. The Krylov method stays that of the minimiser, because TRON
    /// and GPCG need one with a trust region.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn default_to_cholesky(&mut self) -> Result<()> {
        // The bounded Newton methods (BNLS and its relatives) have a linear solver with a prefix of
        // its own, and no trust-region radius.
        direct_defaults(&self.context, &format!("{}tao_bnk_", self.prefix), true)?;
        direct_defaults(&self.context, &self.prefix, false)
    }

    /// Sets the objective function and its gradient. Collective.
    ///
    /// The closure returns the value at x and writes the gradient into its second argument, a
    /// vector like `like`.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_objective(
        &mut self,
        like: &Vector,
        objective: impl FnMut(&Vector, &mut Vector) -> Result<f64> + 'a,
    ) -> Result<()> {
        let (gradient, raw) = (like.duplicate()?, self.raw);
        self.function.set(&self.context, &self.failure, Box::new(objective), |state| {
            call!(TaoSetObjectiveAndGradient(raw, gradient.raw, Some(call_objective), state))
        })
    }

    /// Solves from the start in `x`, which then holds the last iterate. Collective.
    ///
    /// [`Self::reason`] tells whether the solve converged.
    ///
    /// # Errors
    /// Returns the error of a callback, or [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn solve(&mut self, x: &mut Vector) -> Result<()> {
        call!(TaoSetSolution(self.raw, x.raw))?;
        let result = call!(TaoSolve(self.raw));
        settle(&self.failure, result)
    }

    /// Returns why the last solve ended.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn reason(&self) -> Result<Reason> {
        let code = get!(TaoGetConvergedReason(self.raw))?;
        let text = match code {
            sys::TaoConvergedReason::TAO_CONVERGED_GATOL => "CONVERGED_GATOL",
            sys::TaoConvergedReason::TAO_CONVERGED_GRTOL => "CONVERGED_GRTOL",
            sys::TaoConvergedReason::TAO_CONVERGED_GTTOL => "CONVERGED_GTTOL",
            sys::TaoConvergedReason::TAO_CONVERGED_STEPTOL => "CONVERGED_STEPTOL",
            sys::TaoConvergedReason::TAO_CONVERGED_MINF => "CONVERGED_MINF",
            sys::TaoConvergedReason::TAO_CONVERGED_USER => "CONVERGED_USER",
            sys::TaoConvergedReason::TAO_DIVERGED_MAXITS => "DIVERGED_MAXITS",
            sys::TaoConvergedReason::TAO_DIVERGED_NAN => "DIVERGED_NAN",
            sys::TaoConvergedReason::TAO_DIVERGED_MAXFCN => "DIVERGED_MAXFCN",
            sys::TaoConvergedReason::TAO_DIVERGED_LS_FAILURE => "DIVERGED_LS_FAILURE",
            sys::TaoConvergedReason::TAO_DIVERGED_TR_REDUCTION => "DIVERGED_TR_REDUCTION",
            sys::TaoConvergedReason::TAO_DIVERGED_USER => "DIVERGED_USER",
            _ => "CONTINUE_ITERATING",
        };
        Ok(Reason { code: code.0, text: text.into() })
    }
}

unsafe extern "C" fn call_objective(
    _: sys::Tao,
    x: sys::Vec,
    value: *mut sys::PetscReal,
    gradient: sys::Vec,
    state: *mut c_void,
) -> sys::PetscErrorCode {
    // SAFETY: `state` is the callback that `set_objective` registered, and lives as long as the
    // solver. Only this function borrows it, never twice: an objective cannot reach its own solver.
    let callback = unsafe { &mut *state.cast::<Callback<Objective>>() };
    let Callback { context, failure, run } = callback;
    guard(failure, || {
        let result = run(&Vector::sharing(x, context)?, &mut Vector::sharing(gradient, context)?)?;
        // SAFETY: PETSc passes a pointer to its own variable.
        unsafe { *value = result };
        Ok(())
    })
}
