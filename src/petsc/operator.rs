//! Operators that a closure applies, in place of the entries of a matrix.

#![allow(unsafe_code)]

use super::callback::{Callback, CallbackSlot, Failure, guard};
use super::error::{call, get, int, raise};
use super::{Context, Matrix, Vector, sys};
use crate::error::Result;
use std::ffi::c_void;
use std::rc::Rc;

type Product = dyn FnMut(&Vector, &mut Vector) -> Result<()>;

/// Square operator y = A x that a closure applies; iterative solvers need nothing else of it.
///
/// An error or a panic of the closure ends the solve with that error. With several ranks, every
/// rank must return the error, and a panic ends the program. Creating and dropping the operator is
/// collective.
pub struct Operator {
    pub(super) matrix: Matrix,
    pub(super) failure: Failure,
    _product: CallbackSlot<Product>,
}

impl Operator {
    /// Creates the operator over vectors of which this rank owns `local` entries. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(
        context: &Rc<Context>,
        local: usize,
        product: impl FnMut(&Vector, &mut Vector) -> Result<()> + 'static,
    ) -> Result<Self> {
        let failure = Failure::default();
        let (comm, local, end) = (context.raw(), int(local)?, sys::PETSC_DETERMINE);
        let mut slot = CallbackSlot::<Product>::default();
        let raw = slot.set(context, &failure, Box::new(product), |state| {
            get!(MatCreateShell(comm, local, local, end, end, state))
        })?;
        let operator = Self { matrix: Matrix::owning(raw, context), failure, _product: slot };
        // SAFETY: PETSc calls the function of this operation with the arguments of `call_product`.
        let function = unsafe {
            std::mem::transmute::<
                unsafe extern "C" fn(sys::Mat, sys::Vec, sys::Vec) -> sys::PetscErrorCode,
                unsafe extern "C" fn(),
            >(call_product)
        };
        call!(MatShellSetOperation(raw, sys::MatOperation::MATOP_MULT, Some(function)))?;
        Ok(operator)
    }
}

impl std::fmt::Debug for Operator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Operator").finish_non_exhaustive()
    }
}

unsafe extern "C" fn call_product(matrix: sys::Mat, x: sys::Vec, y: sys::Vec) -> sys::PetscErrorCode {
    let mut state = std::ptr::null_mut::<c_void>();
    // PETSc writes the state that `Operator::new` registered.
    if let Err(error) = call!(MatShellGetContext(matrix, (&raw mut state).cast())) {
        return raise(&error.to_string());
    }
    // SAFETY: the callback lives as long as the operator, and the solvers that apply it keep the
    // operator. Only this function borrows it, never twice: a product cannot reach its own
    // operator.
    let callback = unsafe { &mut *state.cast::<Callback<Product>>() };
    let Callback { context, failure, run } = callback;
    guard(failure, || run(&Vector::sharing(x, context)?, &mut Vector::sharing(y, context)?))
}
