//! Translation of PETSc's error codes and messages into the crate's errors.

#![allow(unsafe_code)]

use super::{Index, sys};
use crate::error::{Error, Result};
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char, c_int, c_void};

thread_local! {
    /// Record of the function that failed first; PETSc's unwinding calls the handler many times.
    static RECORD: RefCell<Option<Record>> = const { RefCell::new(None) };
}

/// Origin of an error.
struct Record {
    function: String,
    place: String,
    message: String,
}

/// Turns the code of a call into a result.
///
/// `call` names the function for codes about which PETSc's handler has no record.
pub(super) fn check(code: sys::PetscErrorCode, call: &str) -> Result<()> {
    if code == 0 {
        return Ok(());
    }
    let text = match RECORD.take() {
        Some(Record { function, place, message }) => {
            format!("{function}(): {message} (code {code}, {place})")
        }
        None => format!("{call}(): failed (code {code})"),
    };
    Err(Error::Petsc(text))
}

/// Calls a PETSc function and turns its code into a result that names it.
macro_rules! call {
    ($function:ident($($argument:expr),* $(,)?)) => {
        match $crate::petsc::library::functions() {
            // SAFETY: the handles passed are alive, since each owns its object and the context;
            // slices carry their lengths.
            Ok(petsc) => $crate::petsc::error::check(unsafe { petsc.$function($($argument),*) }, stringify!($function)),
            Err(absent) => Err(absent),
        }
    };
}
pub(super) use call;

/// Calls a PETSc function that writes its results behind its last arguments, and returns them: one
/// value, or a tuple of as many as there are names behind the semicolon.
macro_rules! get {
    ($function:ident($($argument:expr),* $(,)?)) => {
        $crate::petsc::error::get!($function($($argument),*; value))
    };
    ($function:ident($($argument:expr),*; $($result:ident),*)) => {{
        // SAFETY: the results are numbers, enumerations and pointers of C, for which 0 is a value.
        $(let mut $result = unsafe { std::mem::MaybeUninit::zeroed().assume_init() };)*
        $crate::petsc::error::call!($function($($argument,)* $(&mut $result),*)).map(|()| ($($result),*))
    }};
}
pub(super) use get;

/// PETSc's error handler from [`super::Context::start`] on: keeps the first record, prints nothing.
pub(super) unsafe extern "C" fn keep(
    _: sys::MPI_Comm,
    line: c_int,
    function: *const c_char,
    file: *const c_char,
    code: sys::PetscErrorCode,
    kind: sys::PetscErrorType,
    message: *const c_char,
    _: *mut c_void,
) -> sys::PetscErrorCode {
    if kind == sys::PetscErrorType::PETSC_ERROR_INITIAL {
        // SAFETY: PETSc passes null or strings that end in zero.
        let (function, file, message) = unsafe { (text(function), text(file), text(message)) };
        let file = file.rsplit('/').next().unwrap_or_default();
        // PETSc breaks its messages into lines.
        let message = message.split_whitespace().collect::<Vec<_>>().join(" ");
        let record = Record { function, place: format!("{file}:{line}"), message };
        RECORD.with(|slot| {
            if let Ok(mut slot) = slot.try_borrow_mut() {
                *slot = Some(record);
            }
        });
    }
    code
}

/// Raises one of our errors inside PETSc and returns the code that the callback must return.
pub(super) fn raise(message: &str) -> sys::PetscErrorCode {
    RECORD.set(Some(Record { function: "callback".into(), place: "rebond".into(), message: message.into() }));
    sys::PETSC_ERR_USER as sys::PetscErrorCode
}

/// Copies the text of a C string; a null pointer gives an empty text.
///
/// # Safety
/// The pointer is null or points to bytes that end in zero.
pub(super) unsafe fn text(pointer: *const c_char) -> String {
    if pointer.is_null() {
        return String::new();
    }
    // SAFETY: guaranteed by the caller.
    unsafe { CStr::from_ptr(pointer) }.to_string_lossy().into_owned()
}

/// Converts a text without zero bytes into a C string.
pub(super) fn c_string(text: &str) -> Result<CString> {
    CString::new(text).map_err(|_| Error::Usage(format!("{text:?} holds a zero byte")))
}

/// Converts a length into PETSc's integer.
pub(super) fn int(length: usize) -> Result<Index> {
    Index::try_from(length).map_err(|_| {
        Error::Petsc(format!("a length of {length} is more than this PETSc's 32-bit integers hold"))
    })
}
