//! Rust closures as PETSc callbacks; neither panics nor errors unwind through C.

#![allow(unsafe_code)]

use super::error::raise;
use super::{Context, sys};
use crate::error::{Error, Result};
use std::cell::RefCell;
use std::ffi::c_void;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

/// CallbackSlot in which the callbacks of one solver leave an error for the caller of the solve.
pub(super) type Failure = Rc<RefCell<Option<Error>>>;

/// Rust closure with the context and the error slot that its C trampoline needs.
pub(super) struct Callback<F: ?Sized> {
    pub context: Rc<Context>,
    pub failure: Failure,
    pub run: Box<F>,
}

/// Place of a callback whose address PETSc holds; the owner destroys the PETSc object first.
pub(super) struct CallbackSlot<F: ?Sized>(*mut Callback<F>);

impl<F: ?Sized> Default for CallbackSlot<F> {
    fn default() -> Self {
        Self(std::ptr::null_mut())
    }
}

impl<F: ?Sized> CallbackSlot<F> {
    /// Registers a closure with PETSc in place of an earlier one.
    pub fn set<T>(
        &mut self,
        context: &Rc<Context>,
        failure: &Failure,
        run: Box<F>,
        register: impl FnOnce(*mut c_void) -> Result<T>,
    ) -> Result<T> {
        let callback = Callback { context: context.clone(), failure: failure.clone(), run };
        let new = Self(Box::into_raw(Box::new(callback)));
        // The earlier callback is freed at the end of this function.
        let _old = std::mem::replace(self, new);
        register(self.0.cast())
    }
}

impl<F: ?Sized> Drop for CallbackSlot<F> {
    fn drop(&mut self) {
        if !self.0.is_null() {
            // SAFETY: it came from `Box::into_raw`, and PETSc no longer holds its address.
            drop(unsafe { Box::from_raw(self.0) });
        }
    }
}

/// Runs the body of a callback and turns an error or a panic into a PETSc error code.
///
/// The error itself is left in `failure`, from where [`settle`] takes it.
pub(super) fn guard(failure: &Failure, body: impl FnOnce() -> Result<()>) -> sys::PetscErrorCode {
    let error = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => return 0,
        Ok(Err(error)) => error,
        Err(panic) => {
            let said = panic
                .downcast_ref::<&str>()
                .map(ToString::to_string)
                .or_else(|| panic.downcast_ref::<String>().cloned())
                .unwrap_or_default();
            Error::Petsc(format!("a function given to the solver panicked: {said}"))
        }
    };
    let code = raise(&error.to_string());
    *failure.borrow_mut() = Some(error);
    code
}

/// Returns the callback's own error if there is one, otherwise the result of PETSc's solve.
pub(super) fn settle(failure: &Failure, result: Result<()>) -> Result<()> {
    match failure.borrow_mut().take() {
        Some(error) => Err(error),
        None => result,
    }
}
