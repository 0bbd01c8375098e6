//! Solver of nonlinear equations and complementarity problems.

#![allow(unsafe_code)]

use super::callback::{Callback, Failure, guard, release, settle};
use super::error::{c_string, call, int, text};
use super::ksp::direct_defaults;
use super::options::Prefix;
use super::{Comm, Context, Ksp, Matrix, Reason, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Residual<'a> = dyn FnMut(&Vector, &mut Vector) -> Result<()> + 'a;
type Jacobian<'a> = dyn FnMut(&Vector, &mut Matrix) -> Result<()> + 'a;

/// Solver of f(x) = 0, or of the mixed complementarity problem between bounds l <= x <= u.
///
/// The closures may borrow for `'a`. An error or a panic in one of them ends the solve with that
/// error. With several ranks, every rank must return the error, and a panic ends the program.
/// Creating and dropping the solver is collective.
pub struct Snes<'a> {
    raw: sys::SNES,
    context: Rc<Context>,
    prefix: String,
    failure: Failure,
    residual: *mut Callback<Residual<'a>>,
    jacobian: *mut Callback<Jacobian<'a>>,
}

impl<'a> Snes<'a> {
    /// Creates a solver that reads the options `-<prefix>snes_...`, `-<prefix>ksp_...` and
    /// `-<prefix>pc_...`. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(context: &Rc<Context>, comm: Comm, prefix: &str) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(SNESCreate(context.raw(comm), &mut raw))?;
        let solver = Self {
            raw,
            context: context.clone(),
            prefix: prefix.into(),
            failure: Failure::default(),
            residual: std::ptr::null_mut(),
            jacobian: std::ptr::null_mut(),
        };
        call!(SNESSetOptionsPrefix(raw, Prefix::new(prefix)?.pointer()))?;
        context.note_prefix(prefix);
        Ok(solver)
    }

    /// Sets the method, for instance `vinewtonrsls`. Collective.
    ///
    /// The option `-snes_type` overrides it if [`Snes::set_from_options`] comes later.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where there is no such method.
    pub fn set_type(&mut self, name: &str) -> Result<()> {
        call!(SNESSetType(self.raw, c_string(name)?.as_ptr()))
    }

    /// Works as [`Ksp::default_to_cholesky`] for the solver's linear systems. Collective.
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
        let result = like.duplicate()?;
        let callback =
            Box::into_raw(Callback::new(&self.context, &self.failure, Box::new(residual) as Box<Residual>));
        let old = std::mem::replace(&mut self.residual, callback);
        let set =
            call!(SNESSetFunction(self.raw, result.raw, Some(call_residual), callback.cast::<c_void>()));
        release(old);
        set
    }

    /// Sets the Jacobian of f, which the closure updates for a new x. Collective.
    ///
    /// `matrix` holds its value for the first step. A constant Jacobian needs a closure that does
    /// nothing, except with `vinewtonssls`, which scales the matrix in place.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_jacobian(
        &mut self,
        matrix: &Matrix,
        jacobian: impl FnMut(&Vector, &mut Matrix) -> Result<()> + 'a,
    ) -> Result<()> {
        let callback =
            Box::into_raw(Callback::new(&self.context, &self.failure, Box::new(jacobian) as Box<Jacobian>));
        let old = std::mem::replace(&mut self.jacobian, callback);
        let (raw, state) = (matrix.raw, callback.cast::<c_void>());
        let set = call!(SNESSetJacobian(self.raw, raw, raw, Some(call_jacobian), state));
        release(old);
        set
    }

    /// Sets the bounds; an absent one is minus or plus [`super::INFINITY`]. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn set_bounds(&mut self, lower: &Vector, upper: &Vector) -> Result<()> {
        call!(SNESVISetVariableBounds(self.raw, lower.raw, upper.raw))
    }

    /// Sets tolerances and the iteration limit. Collective.
    ///
    /// The tolerances are on the norm of f (absolute, and relative to its start) and on the step
    /// relative to x. Options override them if [`Snes::set_from_options`] comes later.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where one is negative or not a number.
    pub fn set_tolerances(
        &mut self,
        absolute: f64,
        relative: f64,
        step: f64,
        iterations: usize,
    ) -> Result<()> {
        // PETSc 3.18 lets a NaN pass.
        super::refuse_nan(&[absolute, relative, step])?;
        call!(SNESSetTolerances(self.raw, absolute, relative, step, int(iterations)?, -1))
    }

    /// Sets whether to take at least one iteration, even if the start meets the tolerances.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn force_iteration(&mut self, force: bool) -> Result<()> {
        call!(SNESSetForceIteration(self.raw, sys::truth(force)))
    }

    /// Reads the options. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where an option has an impossible value.
    pub fn set_from_options(&mut self) -> Result<()> {
        call!(SNESSetFromOptions(self.raw))
    }

    /// Solves from the start in `x`, which then holds the last iterate. Collective.
    ///
    /// [`Snes::reason`] tells whether the solve converged.
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
        let (mut code, mut name) = (sys::SNESConvergedReason(0), std::ptr::null());
        call!(SNESGetConvergedReason(self.raw, &mut code))?;
        call!(SNESGetConvergedReasonString(self.raw, &mut name))?;
        // SAFETY: PETSc returns a constant string.
        Ok(Reason { code: code.0, text: unsafe { text(name) } })
    }

    /// Returns the number of iterations of the last solve.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(SNESGetIterationNumber(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// Returns the number of linear iterations of the last solve; each direct solve counts as one.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn linear_iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(SNESGetLinearSolveIterations(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// Returns the linear solver of the Newton steps.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn linear_solver(&self) -> Result<Ksp> {
        let mut raw = std::ptr::null_mut();
        call!(SNESGetKSP(self.raw, &mut raw))?;
        let mut solver = Ksp::sharing(raw, &self.context)?;
        solver.prefix.clone_from(&self.prefix);
        Ok(solver)
    }

    /// Returns the name of the method.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn kind(&self) -> Result<String> {
        let mut name = std::ptr::null();
        call!(SNESGetType(self.raw, &mut name))?;
        // SAFETY: the name belongs to PETSc; it is null before one is set.
        Ok(unsafe { text(name) })
    }

    /// Prints the solver. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn view(&self) -> Result<()> {
        call!(SNESView(self.raw, std::ptr::null_mut()))
    }
}

impl std::fmt::Debug for Snes<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Snes").field("prefix", &self.prefix).finish_non_exhaustive()
    }
}

impl Drop for Snes<'_> {
    fn drop(&mut self) {
        let _ = call!(SNESDestroy(&mut self.raw));
        release(self.residual);
        release(self.jacobian);
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

unsafe extern "C" fn call_jacobian(
    _: sys::SNES,
    x: sys::Vec,
    _: sys::Mat,
    matrix: sys::Mat,
    state: *mut c_void,
) -> sys::PetscErrorCode {
    // SAFETY: as in `call_residual`.
    let callback = unsafe { &mut *state.cast::<Callback<Jacobian>>() };
    let Callback { context, failure, run } = callback;
    guard(failure, || run(&Vector::sharing(x, context)?, &mut Matrix::sharing(matrix, context)?))
}
