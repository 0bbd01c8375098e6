//! Loading of PETSc, by the first call of one of its functions.
//!
//! The library brings a hundred others and the threads of BLAS, which cost more than all else in a
//! short run of the native engine.

#![allow(unsafe_code)]

use super::sys::{Functions, PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR};
use crate::error::{Error, Result};
use libloading::os::unix::{Library, RTLD_GLOBAL, RTLD_LAZY};
use std::ffi::{CStr, OsString, c_void};
use std::path::Path;
use std::sync::OnceLock;

/// Environment variable with the path of another build of PETSc, of the same release.
const VARIABLE: &str = "REBOND_PETSC_LIBRARY";

type Loaded = std::result::Result<Functions, String>;

/// Returns the functions of PETSc.
pub(super) fn functions() -> Result<&'static Functions> {
    static LOADED: OnceLock<Loaded> = OnceLock::new();
    let given = || std::env::var_os(VARIABLE).filter(|path| !path.is_empty());
    let loaded = LOADED.get_or_init(|| load(given().unwrap_or_else(|| env!("REBOND_PETSC_LIBRARY").into())));
    loaded.as_ref().map_err(|why| Error::Petsc(why.clone()))
}

/// Loads the library that a path or a name leads to.
fn load(path: OsString) -> Loaded {
    let absent = |why| {
        format!(
            "the library cannot be loaded: {why} (install the Debian package libpetsc-real{PETSC_VERSION_MAJOR}.{PETSC_VERSION_MINOR}, \
             or set LD_LIBRARY_PATH or {VARIABLE})"
        )
    };
    // Plugins of PETSc, and searches for functions of BLAS, find the names that all may see.
    // SAFETY: the libraries are made to be loaded at any time, and stay until the process ends.
    let library = unsafe { Library::open(Some(&path), RTLD_LAZY | RTLD_GLOBAL) }.map_err(absent)?;
    // SAFETY: in a library of the same release, functions have the declared signatures, and this
    // one has had it in every release.
    let functions = unsafe { Functions::from_library(library) }.map_err(absent)?;
    let ([mut major, mut minor], none) = ([0; 2], std::ptr::null_mut());
    // SAFETY: null stands for numbers that are not asked for.
    unsafe { functions.PetscGetVersionNumber(&mut major, &mut minor, none, none) };
    if [major, minor].map(i32::unsigned_abs) == [PETSC_VERSION_MAJOR, PETSC_VERSION_MINOR] {
        return Ok(functions);
    }
    let path = Path::new(&path).display();
    Err(format!(
        "{path} is of release {major}.{minor}; expected {PETSC_VERSION_MAJOR}.{PETSC_VERSION_MINOR}, for which this program was built"
    ))
}

/// Returns the address of a function or variable of the loaded libraries, if there is one.
pub(super) fn address(name: &CStr) -> Option<*mut c_void> {
    // SAFETY: the symbol is only located, as an address without a type.
    let symbol = unsafe { Library::this().get::<*mut c_void>(name.to_bytes_with_nul()) };
    symbol.ok().map(|symbol| *symbol)
}
