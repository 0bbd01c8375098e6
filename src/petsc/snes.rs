//! Nonlinear equations and complementarity problems.

use super::callback::{Callback, Failure, guard, settle};
use super::error::{c_string, call, int, text};
use super::ksp::direct_defaults;
use super::options::Prefix;
use super::{Comm, Context, Ksp, Matrix, Reason, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Residual<'a> = dyn FnMut(&Vector, &mut Vector) -> Result<()> + 'a;
type Jacobian<'a> = dyn FnMut(&Vector, &mut Matrix) -> Result<()> + 'a;

/// A solver of f(x) = 0, or, between bounds l and u, of the complementarity problem where f may point out of the box at a bound.
///
/// The closures may borrow for `'a`. An error or a panic in one of them ends the solve with that error; with several
/// ranks every rank must return the error, and a panic ends the program. Creating and dropping it is collective.
pub struct Snes<'a> {
    raw: sys::SNES,
    context: Rc<Context>,
    prefix: String,
    failure: Failure,
    residual: *mut Callback<Residual<'a>>,
    jacobian: *mut Callback<Jacobian<'a>>,
}

impl<'a> Snes<'a> {
    /// A solver that listens to the options `-<prefix>snes_...`, `-<prefix>ksp_...`, `-<prefix>pc_...`. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
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

    /// Sets the method, `vinewtonrsls` for instance; `-snes_type` goes before if [`Snes::set_from_options`] comes later. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`] where there is no such method.
    pub fn set_type(&mut self, name: &str) -> Result<()> {
        call!(SNESSetType(self.raw, c_string(name)?.as_ptr()))
    }

    /// As [`Ksp::default_to_cholesky`], for the solver's linear systems. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn default_to_cholesky(&mut self) -> Result<()> {
        direct_defaults(&self.context, &self.prefix, true)
    }

    /// Sets f, as the closure that computes f(x) into its second argument, a vector like `like`. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
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

    /// Sets the derivative of f: `matrix` holds its value for the first step, the closure updates it for another x. Collective.
    ///
    /// A constant derivative needs a closure that does nothing, except for `vinewtonssls`, which scales the matrix in place.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
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

    /// Sets the bounds; none is minus or plus [`super::INFINITY`]. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn set_bounds(&mut self, lower: &Vector, upper: &Vector) -> Result<()> {
        call!(SNESVISetVariableBounds(self.raw, lower.raw, upper.raw))
    }

    /// Sets tolerances on f (absolute, relative to its start) and on the step relative to x, and the largest number of iterations.
    /// Options go before if [`Snes::set_from_options`] comes later. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`] where one is negative or not a number.
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

    /// Whether to take one iteration at least, even from a start that meets the tolerances. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn force_iteration(&mut self, force: bool) -> Result<()> {
        call!(SNESSetForceIteration(self.raw, sys::truth(force)))
    }

    /// Reads the options. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`] where an option has an impossible value.
    pub fn set_from_options(&mut self) -> Result<()> {
        call!(SNESSetFromOptions(self.raw))
    }

    /// Solves from the start in `x`, and leaves the last iterate there. Whether it converged is [`Snes::reason`]'s answer. Collective.
    ///
    /// # Errors
    /// A callback's own error; [`crate::Error::Petsc`].
    pub fn solve(&mut self, x: &mut Vector) -> Result<()> {
        let result = call!(SNESSolve(self.raw, std::ptr::null_mut(), x.raw));
        settle(&self.failure, result)
    }

    /// Why the last solve ended.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn reason(&self) -> Result<Reason> {
        let (mut code, mut name) = (sys::SNESConvergedReason(0), std::ptr::null());
        call!(SNESGetConvergedReason(self.raw, &mut code))?;
        call!(SNESGetConvergedReasonString(self.raw, &mut name))?;
        // SAFETY: PETSc lends a constant string.
        Ok(Reason { code: code.0, text: unsafe { text(name) } })
    }

    /// Number of iterations of the last solve.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(SNESGetIterationNumber(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// Number of linear iterations of the last solve: of linear solves, where a factorisation makes them.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn linear_iterations(&self) -> Result<usize> {
        let mut iterations = 0;
        call!(SNESGetLinearSolveIterations(self.raw, &mut iterations))?;
        Ok(iterations as usize)
    }

    /// The linear solver inside.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn linear_solver(&self) -> Result<Ksp> {
        let mut raw = std::ptr::null_mut();
        call!(SNESGetKSP(self.raw, &mut raw))?;
        let mut solver = Ksp::sharing(raw, &self.context)?;
        solver.prefix.clone_from(&self.prefix);
        Ok(solver)
    }

    /// Name of the method.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn kind(&self) -> Result<String> {
        let mut name = std::ptr::null();
        call!(SNESGetType(self.raw, &mut name))?;
        // SAFETY: PETSc lends the name, or null before one is set.
        Ok(unsafe { text(name) })
    }

    /// Prints the solver. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
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

/// Frees a callback that PETSc no longer knows.
pub(super) fn release<F: ?Sized>(callback: *mut Callback<F>) {
    if !callback.is_null() {
        // SAFETY: it came from `Box::into_raw` and PETSc has dropped its address.
        drop(unsafe { Box::from_raw(callback) });
    }
}

unsafe extern "C" fn call_residual(
    _: sys::SNES,
    x: sys::Vec,
    f: sys::Vec,
    state: *mut c_void,
) -> sys::PetscErrorCode {
    // SAFETY: `state` is the callback that `set_residual` registered; it lives while the solver does, and only this function
    // borrows it, never twice: a residual that solves with its own solver cannot reach it.
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
