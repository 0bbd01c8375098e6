//! Closures that PETSc calls back: panics and errors stop at the border.

use super::error::raise;
use super::{Context, sys};
use crate::error::{Error, Result};
use std::cell::RefCell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::rc::Rc;

/// Where the callbacks of one solver leave their error for whoever called the solver.
pub(super) type Failure = Rc<RefCell<Option<Error>>>;

/// A closure with what it needs to be called from C.
pub(super) struct Callback<F: ?Sized> {
    pub context: Rc<Context>,
    pub failure: Failure,
    pub run: Box<F>,
}

impl<F: ?Sized> Callback<F> {
    /// Boxed, since PETSc keeps its address.
    pub fn new(context: &Rc<Context>, failure: &Failure, run: Box<F>) -> Box<Self> {
        Box::new(Self { context: context.clone(), failure: failure.clone(), run })
    }
}

/// Runs a callback's body; its error or panic becomes a code for PETSc, and waits in `failure`.
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

/// The result of a solve: a callback's own error goes before what PETSc makes of it.
pub(super) fn settle(failure: &Failure, result: Result<()>) -> Result<()> {
    match failure.borrow_mut().take() {
        Some(error) => Err(error),
        None => result,
    }
}
