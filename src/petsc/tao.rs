//! Solver of bound-constrained minimisation problems.

#![allow(unsafe_code)]

use super::callback::{Callback, Failure, guard, release, settle};
use super::error::{c_string, call, int, text};
use super::ksp::direct_defaults;
use super::options::Prefix;
use super::{Comm, Context, Ksp, Matrix, Reason, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Objective<'a> = dyn FnMut(&Vector, &mut Vector) -> Result<f64> + 'a;
type Hessian<'a> = dyn FnMut(&Vector, &mut Matrix) -> Result<()> + 'a;

/// Solver that minimises a function between bounds.
///
/// The closures may borrow for `'a`. An error or a panic in one of them ends the solve with that
/// error. With several ranks, every rank must return the error, and a panic ends the program.
/// Creating and dropping the solver is collective.
pub struct Tao<'a> {
    raw: sys::Tao,
    context: Rc<Context>,
    prefix: String,
    failure: Failure,
    objective: *mut Callback<Objective<'a>>,
    hessian: *mut Callback<Hessian<'a>>,
}

impl<'a> Tao<'a> {
    /// Creates a solver that reads the options `-<prefix>tao_...`, `-<prefix>ksp_...` and
    /// `-<prefix>pc_...`. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(context: &Rc<Context>, comm: Comm, prefix: &str) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(TaoCreate(context.raw(comm), &mut raw))?;
        let solver = Self {
            raw,
            context: context.clone(),
            prefix: prefix.into(),
            failure: Failure::default(),
            objective: std::ptr::null_mut(),
            hessian: std::ptr::null_mut(),
        };
        call!(TaoSetOptionsPrefix(raw, Prefix::new(prefix)?.pointer()))?;
        context.note_prefix(prefix);
        Ok(solver)
    }

    /// Sets the method, for instance `tron`. Collective.
    ///
    /// The option `-tao_type` overrides it if [`Tao::set_from_options`] comes later.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where there is no such method.
    pub fn set_type(&mut self, name: &str) -> Result<()> {
        call!(TaoSetType(self.raw, c_string(name)?.as_ptr()))
    }

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
        let gradient = like.duplicate()?;
        let callback =
            Box::into_raw(Callback::new(&self.context, &self.failure, Box::new(objective) as Box<Objective>));
        let old = std::mem::replace(&mut self.objective, callback);
        let state = callback.cast::<c_void>();
        let set = call!(TaoSetObjectiveAndGradient(self.raw, gradient.raw, Some(call_objective), state));
        release(old);
        set
    }

    /// Sets the Hessian, which the closure updates for a new x. Collective.
    ///
    /// `matrix` holds its value for the first step.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_hessian(
        &mut self,
        matrix: &Matrix,
        hessian: impl FnMut(&Vector, &mut Matrix) -> Result<()> + 'a,
    ) -> Result<()> {
        let callback =
            Box::into_raw(Callback::new(&self.context, &self.failure, Box::new(hessian) as Box<Hessian>));
        let old = std::mem::replace(&mut self.hessian, callback);
        let (raw, state) = (matrix.raw, callback.cast::<c_void>());
        let set = call!(TaoSetHessian(self.raw, raw, raw, Some(call_hessian), state));
        release(old);
        set
    }

    /// Sets the bounds; an absent one is minus or plus [`super::INFINITY`]. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_bounds(&mut self, lower: &Vector, upper: &Vector) -> Result<()> {
        call!(TaoSetVariableBounds(self.raw, lower.raw, upper.raw))
    }

    /// Sets tolerances and the iteration limit. Collective.
    ///
    /// The tolerances are on the norm of the projected gradient: absolute, relative to the
    /// function's value, relative to its start. Options override them if [`Tao::set_from_options`]
    /// comes later.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where one is not a number.
    pub fn set_tolerances(
        &mut self,
        absolute: f64,
        to_value: f64,
        to_start: f64,
        iterations: usize,
    ) -> Result<()> {
        super::refuse_nan(&[absolute, to_value, to_start])?;
        call!(TaoSetTolerances(self.raw, absolute, to_value, to_start))?;
        call!(TaoSetMaximumIterations(self.raw, int(iterations)?))
    }

    /// Reads the options. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where an option has an impossible value.
    pub fn set_from_options(&mut self) -> Result<()> {
        call!(TaoSetFromOptions(self.raw))
    }

    /// Solves from the start in `x`, which then holds the last iterate. Collective.
    ///
    /// [`Tao::reason`] tells whether the solve converged.
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
        let mut code = sys::TaoConvergedReason(0);
        call!(TaoGetConvergedReason(self.raw, &mut code))?;
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

    /// Returns the number of iterations of the last solve.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(TaoGetIterationNumber(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// Returns the number of linear iterations of the last solve.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn linear_iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(TaoGetLinearSolveIterations(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// Returns the linear solver of the method, or `None` if it has none.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn linear_solver(&self) -> Result<Option<Ksp>> {
        let mut raw = std::ptr::null_mut();
        call!(TaoGetKSP(self.raw, &mut raw))?;
        if raw.is_null() {
            return Ok(None);
        }
        let mut solver = Ksp::sharing(raw, &self.context)?;
        solver.prefix.clone_from(&self.prefix);
        Ok(Some(solver))
    }

    /// Returns the name of the method.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn kind(&self) -> Result<String> {
        let mut name = std::ptr::null();
        call!(TaoGetType(self.raw, &mut name))?;
        // SAFETY: the name belongs to PETSc; it is null before one is set.
        Ok(unsafe { text(name) })
    }

    /// Prints the solver. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn view(&self) -> Result<()> {
        call!(TaoView(self.raw, std::ptr::null_mut()))
    }
}

impl std::fmt::Debug for Tao<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tao").field("prefix", &self.prefix).finish_non_exhaustive()
    }
}

impl Drop for Tao<'_> {
    fn drop(&mut self) {
        let _ = call!(TaoDestroy(&mut self.raw));
        release(self.objective);
        release(self.hessian);
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

unsafe extern "C" fn call_hessian(
    _: sys::Tao,
    x: sys::Vec,
    _: sys::Mat,
    matrix: sys::Mat,
    state: *mut c_void,
) -> sys::PetscErrorCode {
    // SAFETY: as in `call_objective`.
    let callback = unsafe { &mut *state.cast::<Callback<Hessian>>() };
    let Callback { context, failure, run } = callback;
    guard(failure, || run(&Vector::sharing(x, context)?, &mut Matrix::sharing(matrix, context)?))
}
