//! Life cycle of MPI and PETSc.

#![allow(unsafe_code)]

use super::error::{c_string, call, keep};
use super::{WorldComm, ending, library, sys, words};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use mpi::Threading;
use mpi::traits::AsRaw;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ffi::{CString, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Whether MPI was started in this process, which is possible only once.
static STARTED: AtomicBool = AtomicBool::new(false);

/// Running MPI and PETSc. PETSc stops when the last owner is dropped, and then MPI with the last
/// copy of its communicator.
///
/// Every handle owns a reference to its context, so that none outlives PETSc. Neither contexts nor
/// handles leave their thread.
pub struct Context {
    /// Communicator of the ranks that work together, dropped after PETSc has ended.
    comm: WorldComm,
    /// Communicator of all ranks, of which the own group may be a part.
    pub(crate) everyone: WorldComm,
    /// Names of the options that the program set as defaults, which may remain unused.
    pub(super) ours: RefCell<BTreeSet<String>>,
    /// Options prefixes of the solvers created so far.
    pub(super) prefixes: RefCell<BTreeSet<String>>,
    /// Command line of PETSc, which keeps pointers into it until it ends.
    _arguments: (Vec<CString>, Vec<*mut c_char>),
    _thread: PhantomData<*const ()>,
}

impl Context {
    /// Loads PETSc, starts MPI, then PETSc with its options.
    ///
    /// `arguments` are the words after `--` on the command line: `-name value` or `-name`. They
    /// override the environment variable `PETSC_OPTIONS`. PETSc ignores `.petscrc` files, so that a
    /// run does not depend on the folder it starts in; `-skip_petscrc 0` reads them again, and rank
    /// 0 prints a note where one is ignored. PETSc's signal handlers, which fill the screen, are
    /// off (`-no_signal_handler 0` turns them on), and so is its own report on unused options
    /// (`-options_left`). BLAS gets one thread per rank unless the environment sets
    /// `OPENBLAS_NUM_THREADS` or `OMP_NUM_THREADS`. With several ranks, a panic on one rank ends
    /// all of them. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where an argument is no option or the value of an option is NaN,
    /// whichever its source; [`Error::Petsc`] where MPI was started before (it starts once per
    /// process), or PETSc cannot be loaded or fails to start.
    pub fn start(arguments: &[String]) -> Result<Rc<Self>> {
        Context::start_in_groups(arguments, None)
    }

    /// Starts MPI and PETSc as [`Context::start`] does, on groups of `ranks` neighbours that work
    /// apart from each other, or on one group of all. The context and its objects are those of the
    /// own group. Collective over all ranks.
    ///
    /// # Errors
    /// Returns the errors of [`Context::start`], and [`Error::Usage`] where the ranks do not divide
    /// into such groups.
    pub fn start_in_groups(arguments: &[String], ranks: Option<usize>) -> Result<Rc<Self>> {
        words::validate(arguments)?;
        let variable = std::env::var(words::VARIABLE).unwrap_or_default();
        // Newer releases of PETSc also report our own unused defaults at the end;
        // `refuse_unused_options` reports only those of the user, and earlier.
        let ours = ["rebond", "-skip_petscrc", "-no_signal_handler", "-options_left", "no"];
        let mut owned = ours.into_iter().map(c_string).collect::<Result<Vec<_>>>()?;
        // PETSc looks this option up before it reads the environment variable.
        for argument in words::skip_petscrc(&variable).iter().chain(arguments) {
            owned.push(c_string(argument)?);
        }
        library::functions()?;
        if STARTED.swap(true, Ordering::SeqCst) {
            return Err(Error::Petsc(
                "MPI starts once in the life of a process, and it has been started".into(),
            ));
        }
        one_blas_thread();
        let (universe, _) = mpi::initialize_with_threading(Threading::Funneled)
            .ok_or_else(|| Error::Petsc("MPI was started by something else in this process".into()))?;
        return_freed_memory();
        let everyone = WorldComm::new(universe);
        if everyone.size() > 1 {
            ending::abort_on_panic();
        }
        let comm = ranks.map_or(Ok(everyone.clone()), |ranks| everyone.group(ranks))?;

        let mut pointers: Vec<*mut c_char> = owned.iter().map(|text| text.as_ptr().cast_mut()).collect();
        let mut count = pointers.len() as c_int;
        pointers.push(std::ptr::null_mut());
        let mut start = pointers.as_mut_ptr();
        // PETSc allows an error handler before its own start. This one is there to the end.
        call!(PetscPushErrorHandler(Some(keep), std::ptr::null_mut()))?;
        // MPI runs, and the strings and the array live in the context until PETSc has ended.
        call!(PetscInitialize(&mut count, &mut start, std::ptr::null(), std::ptr::null()))?;
        let context = Rc::new(Self {
            comm,
            everyone,
            ours: RefCell::default(),
            prefixes: RefCell::default(),
            _arguments: (owned, pointers),
            _thread: PhantomData,
        });
        context.comm.all_ok(context.check_database())?;
        context.tell_of_files_left_out();
        Ok(context)
    }

    /// Returns the number of this rank in its group, from 0.
    pub fn rank(&self) -> usize {
        self.comm.rank()
    }

    /// Returns the number of ranks that work together.
    pub fn size(&self) -> usize {
        self.comm.size()
    }

    /// Returns the communicator of the ranks that work together.
    pub fn comm(&self) -> &WorldComm {
        &self.comm
    }

    /// Returns the number of the own group of ranks, from 0, and the number of groups.
    pub fn group(&self) -> (usize, usize) {
        (self.everyone.rank() / self.size(), self.everyone.size() / self.size())
    }

    pub(super) fn raw(&self) -> sys::MPI_Comm {
        self.comm.world().as_raw()
    }

    /// Ends the common work of all ranks with one report of the first error. Collective.
    ///
    /// Where all ranks arrive and some have an error, rank 0 gets the error of the lowest of them
    /// and the others get `Ok`: rank 0 alone reports it, and the launcher passes on its message and
    /// exit code. A rank that has an error, and waits for the others longer than `patience`, ends
    /// all with [`Context::fail`].
    ///
    /// # Errors
    /// Returns the first error, on rank 0 only.
    pub fn settle(&self, ended: Result<()>, patience: Duration) -> Result<()> {
        match ended {
            Err(error) if !self.everyone.arrive(Some(patience)) => self.fail(&error),
            Ok(()) => self.everyone.arrive(None),
            _ => true,
        };
        let is_first = self.everyone.rank() == 0;
        self.everyone.all_ok(ended).or_else(|error| if is_first { Err(error) } else { Ok(()) })
    }

    /// Returns the outcome of the ranks that work together: the first error, if any has one.
    /// A rank that has an error, and waits for the others longer than `patience`, ends all with
    /// [`Context::fail`]. Collective.
    ///
    /// # Errors
    /// Returns the first error, on every rank.
    pub fn agree<T>(&self, result: Result<T>, patience: Duration) -> Result<T> {
        match &result {
            Err(error) if !self.comm.arrive(Some(patience)) => self.fail(error),
            Ok(_) => self.comm.arrive(None),
            Err(_) => true,
        };
        self.comm.all_ok(result)
    }

    /// Reports an error and ends the program on every rank, with the error's exit code.
    ///
    /// One rank suffices (not collective). If several ranks have the same error, the lowest one
    /// reports it.
    pub fn fail(&self, error: &Error) -> ! {
        ending::fail(self.everyone.world(), error)
    }

    /// Returns the number of OpenBLAS threads, or `None` if BLAS is another library.
    pub fn blas_threads(&self) -> Option<usize> {
        let address = library::address(c"openblas_get_num_threads")?;
        // SAFETY: the function has had this signature in every version.
        let threads = unsafe { std::mem::transmute::<*mut c_void, extern "C" fn() -> c_int>(address)() };
        Some(threads as usize)
    }

    /// Returns the version of the PETSc library, which need not run: major, minor, patch.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the library cannot be loaded.
    pub fn library_version() -> Result<[i32; 3]> {
        let mut version = [0; 3];
        let [major, minor, patch] = &mut version;
        call!(PetscGetVersionNumber(major, minor, patch, std::ptr::null_mut()))?;
        Ok(version)
    }
}

impl std::fmt::Debug for Context {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Context")
            .field("rank", &self.rank())
            .field("size", &self.size())
            .finish_non_exhaustive()
    }
}

impl Drop for Context {
    fn drop(&mut self) {
        // No handle is left, since each owns a reference to the context. MPI still runs, for the
        // communicator is dropped after this. An error has nowhere to go.
        let _ = call!(PetscFinalize());
    }
}

/// Gives BLAS and OpenMP one thread, unless the environment sets their number.
///
/// The libraries read their environment when they are loaded, so that only a call to them has an
/// effect here.
fn one_blas_thread() {
    let free = |names: &[&str]| names.iter().all(|name| std::env::var_os(name).is_none());
    let mut setters = Vec::new();
    if free(&["OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS"]) {
        setters.push(c"openblas_set_num_threads");
    }
    if free(&["OMP_NUM_THREADS"]) {
        setters.push(c"omp_set_num_threads");
    }
    for name in setters {
        if let Some(address) = library::address(name) {
            // SAFETY: both functions have had this signature in every version.
            unsafe { std::mem::transmute::<*mut c_void, extern "C" fn(c_int)>(address)(1) };
        }
    }
}

/// Smallest allocation that is given back to the system when it is freed, in bytes.
const RETURNED: c_int = 1 << 20;

/// Has large arrays given back when they are freed. Open MPI keeps them for later messages, and a
/// run that replaces its factor would hold both.
fn return_freed_memory() {
    /// Parameter of `mallopt` for this size.
    const M_MMAP_THRESHOLD: c_int = -3;
    if let Some(address) = library::address(c"mallopt") {
        // SAFETY: where the C library has this function, it has this signature.
        unsafe {
            std::mem::transmute::<*mut c_void, extern "C" fn(c_int, c_int) -> c_int>(address)(
                M_MMAP_THRESHOLD,
                RETURNED,
            )
        };
    }
}
