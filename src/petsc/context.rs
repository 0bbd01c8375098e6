//! MPI and PETSc from start to finish.

use super::error::{c_string, call, check, keep};
use super::{options, sys};
use crate::error::{Error, Result};
use mpi::Threading;
use mpi::collective::SystemOperation;
use mpi::datatype::{Equivalence, PartitionMut};
use mpi::environment::Universe;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{AsRaw, Communicator, CommunicatorCollectives, Root};
use serde::{Serialize, de::DeserializeOwned};
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::ffi::{CString, c_char, c_int, c_ulong, c_void};
use std::io::Write;
use std::marker::PhantomData;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// MPI can be started once in the life of a process.
static STARTED: AtomicBool = AtomicBool::new(false);

/// Which ranks own an object together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comm {
    /// All of them: its calls are collective.
    World,
    /// This one alone.
    Own,
}

/// Running MPI and PETSc; stops both when the last owner drops it.
///
/// Every handle owns a share, so none outlives PETSc; none leaves its thread.
pub struct Context {
    /// `None` only while it drops: MPI ends after PETSc.
    universe: Option<Universe>,
    world: SimpleCommunicator,
    /// Names of the options that the program set: the user need not use them.
    pub(super) ours: RefCell<BTreeSet<String>>,
    /// Prefixes of the options of the solvers created so far.
    pub(super) prefixes: RefCell<BTreeSet<String>>,
    /// PETSc keeps pointers into these until it ends.
    _arguments: (Vec<CString>, Vec<*mut c_char>),
    _thread: PhantomData<*const ()>,
}

impl Context {
    /// Starts MPI, then PETSc with its options.
    ///
    /// `arguments` are what followed `--` on the command line: `-name value` or `-name`. The environment's
    /// `PETSC_OPTIONS` is read too and yields to them; `.petscrc` files are not, so that a run does not depend on the folder it
    /// starts in (`-skip_petscrc 0` brings them back), and rank 0 says so where there is one. PETSc's signal handlers, which fill the screen, stay off
    /// (`-no_signal_handler 0`), and so do its own words on options left over (`-options_left`). Unless the environment sets `OPENBLAS_NUM_THREADS` or `OMP_NUM_THREADS`,
    /// BLAS gets one thread a rank. With several ranks a panic of one ends all.
    ///
    /// Collective.
    ///
    /// # Errors
    /// [`Error::Usage`] where an argument is no option or an option's value not a number, wherever it comes from, [`Error::Petsc`] where MPI was started before (it starts once in a
    /// process) or PETSc refuses.
    pub fn start(arguments: &[String]) -> Result<Rc<Self>> {
        options::validate(arguments)?;
        let variable = std::env::var(options::VARIABLE).unwrap_or_default();
        // Newer releases tell of options left over as they end, of our defaults too; `refuse_unused_options` does better.
        let ours = ["rebond", "-skip_petscrc", "-no_signal_handler", "-options_left", "no"];
        let mut owned = ours.into_iter().map(c_string).collect::<Result<Vec<_>>>()?;
        // PETSc asks for this one before it reads the variable.
        for argument in options::skip_petscrc(&variable).iter().chain(arguments) {
            owned.push(c_string(argument)?);
        }
        if STARTED.swap(true, Ordering::SeqCst) {
            return Err(Error::Petsc(
                "MPI starts once in the life of a process, and it has been started".into(),
            ));
        }
        one_blas_thread();
        let (universe, _) = mpi::initialize_with_threading(Threading::Funneled)
            .ok_or_else(|| Error::Petsc("MPI was started by something else in this process".into()))?;
        let world = universe.world();
        if world.size() > 1 {
            abort_on_panic();
        }

        let mut pointers: Vec<*mut c_char> = owned.iter().map(|text| text.as_ptr().cast_mut()).collect();
        let mut count = pointers.len() as c_int;
        pointers.push(std::ptr::null_mut());
        let mut start = pointers.as_mut_ptr();
        // The handler may be set before PETSc starts.
        // SAFETY: `keep` lives as long as the program and takes no context.
        check(
            unsafe { sys::PetscPushErrorHandler(Some(keep), std::ptr::null_mut()) },
            "PetscPushErrorHandler",
        )?;
        // SAFETY: MPI runs; the strings and the array live in the context until PETSc has ended.
        let code =
            unsafe { sys::PetscInitialize(&mut count, &mut start, std::ptr::null(), std::ptr::null()) };
        check(code, "PetscInitialize")?;
        let context = Rc::new(Self {
            universe: Some(universe),
            world,
            ours: RefCell::default(),
            prefixes: RefCell::default(),
            _arguments: (owned, pointers),
            _thread: PhantomData,
        });
        context.together(context.check_database())?;
        context.tell_of_files_left_out();
        Ok(context)
    }

    /// Number of this rank, from 0.
    pub fn rank(&self) -> usize {
        self.world.rank() as usize
    }

    /// Number of ranks.
    pub fn size(&self) -> usize {
        self.world.size() as usize
    }

    /// The communicator of all ranks, for `mpi`'s own verbs.
    pub fn world(&self) -> &SimpleCommunicator {
        &self.world
    }

    /// Number of ranks that own an object of this communicator together.
    pub fn ranks(&self, comm: Comm) -> usize {
        match comm {
            Comm::World => self.size(),
            Comm::Own => 1,
        }
    }

    pub(super) fn raw(&self, comm: Comm) -> sys::MPI_Comm {
        match comm {
            Comm::World => self.world.as_raw(),
            // SAFETY: a constant of the MPI library.
            Comm::Own => unsafe { mpi::ffi::RSMPI_COMM_SELF },
        }
    }

    /// Sum over all ranks. Collective.
    pub fn sum(&self, value: f64) -> f64 {
        let mut sum = 0.0;
        self.world.all_reduce_into(&value, &mut sum, SystemOperation::sum());
        sum
    }

    /// Largest value of all ranks. Collective.
    pub fn maximum(&self, value: f64) -> f64 {
        let mut largest = value;
        self.world.all_reduce_into(&value, &mut largest, SystemOperation::max());
        largest
    }

    /// Sums of counts over all ranks. Collective.
    pub fn sum_count(&self, value: usize) -> usize {
        let mut sum = 0u64;
        self.world.all_reduce_into(&(value as u64), &mut sum, SystemOperation::sum());
        sum as usize
    }

    /// Entrywise sum over all ranks of arrays of the same length, in place. Collective.
    pub fn sum_all(&self, values: &mut [f64]) {
        let mine = values.to_vec();
        self.world.all_reduce_into(&mine[..], values, SystemOperation::sum());
    }

    /// Gives all ranks the numbers of rank 0, in arrays of the same length. Collective.
    pub fn broadcast(&self, values: &mut [f64]) {
        self.world.process_at_rank(0).broadcast_into(values);
    }

    /// The arrays of all ranks one after the other, on every rank; their lengths may differ. Collective.
    pub fn gather<T: Equivalence + Default + Clone>(&self, mine: &[T]) -> Vec<T> {
        let mut counts = vec![0 as c_int; self.size()];
        self.world.all_gather_into(&(mine.len() as c_int), &mut counts[..]);
        let starts = starts(&counts);
        let mut all = vec![T::default(); counts.iter().sum::<c_int>() as usize];
        self.world.all_gather_varcount_into(mine, &mut PartitionMut::new(&mut all[..], counts, starts));
        all
    }

    /// The arrays of all ranks, in their order, on rank 0; nothing on the others. Collective.
    pub fn gather_to_first<T: Equivalence + Default + Clone>(&self, mine: &[T]) -> Vec<Vec<T>> {
        let mut counts = vec![0 as c_int; self.size()];
        self.world.all_gather_into(&(mine.len() as c_int), &mut counts[..]);
        let first = self.world.process_at_rank(0);
        if self.rank() > 0 {
            first.gather_varcount_into(mine);
            return Vec::new();
        }
        let starts = starts(&counts);
        let mut all = vec![T::default(); counts.iter().sum::<c_int>() as usize];
        first.gather_varcount_into_root(mine, &mut PartitionMut::new(&mut all[..], &counts[..], &starts[..]));
        counts
            .iter()
            .zip(starts)
            .map(|(&count, start)| all[start as usize..][..count as usize].to_vec())
            .collect()
    }

    /// Whether it holds on every rank: how ranks agree to go on or give up together. Collective.
    pub fn all(&self, holds: bool) -> bool {
        self.maximum(if holds { 0.0 } else { 1.0 }) == 0.0
    }

    /// What each rank found, or the error of the first rank that has one, on every rank: so that none goes on alone.
    /// Collective.
    ///
    /// # Errors
    /// This rank's own, or [`Error::Elsewhere`].
    pub fn together<T>(&self, mine: Result<T>) -> Result<T> {
        if self.all(mine.is_ok()) {
            return mine;
        }
        let codes = self.gather(&[mine.as_ref().err().map_or(0, Error::exit_code)]);
        let first = codes.iter().position(|&code| code != 0).unwrap_or(0);
        let own = mine.err().filter(|_| self.rank() == first);
        let words = self.gather(own.as_ref().map(Error::to_string).unwrap_or_default().as_bytes());
        let words = String::from_utf8_lossy(&words).into_owned();
        Err(own.unwrap_or(Error::Elsewhere { words, code: codes[first] }))
    }

    /// What rank 0 has, on every rank. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] for what JSON cannot express.
    pub fn share<T: Serialize + DeserializeOwned>(&self, value: &T) -> Result<T> {
        let unfit = |error| Error::Petsc(format!("ranks cannot tell each other: {error}"));
        let mine = if self.rank() == 0 { serde_json::to_vec(value).map_err(unfit) } else { Ok(Vec::new()) };
        serde_json::from_slice(&self.gather(&self.together(mine)?)).map_err(unfit)
    }

    /// Waits for all ranks. Collective.
    pub fn barrier(&self) {
        self.world.barrier();
    }

    /// Whether all ranks come here within some time. Where one does not, it waits inside a call that the others have left:
    /// nothing but [`Context::fail`] can follow. Collective.
    pub fn all_arrive(&self, within: Duration) -> bool {
        self.arrive(Some(within))
    }

    /// The end of what each rank was to do. Where all come here and some have an error, rank 0 gets the error of the first of
    /// them and the others end in peace: rank 0 speaks, and the launcher passes on what it says and its exit code. A rank with an
    /// error that waits in vain for the others ends all with [`Context::fail`]. Collective.
    ///
    /// # Errors
    /// The first error, on rank 0.
    pub fn settle(&self, ended: Result<()>, patience: Duration) -> Result<()> {
        match ended {
            Err(error) if !self.arrive(Some(patience)) => self.fail(&error),
            Ok(()) => self.arrive(None),
            _ => true,
        };
        self.together(ended).or_else(|error| if self.rank() == 0 { Err(error) } else { Ok(()) })
    }

    /// Whether all ranks come here, within some time if one is given.
    fn arrive(&self, within: Option<Duration>) -> bool {
        let start = Instant::now();
        let mut request = self.world.immediate_barrier();
        loop {
            match request.test() {
                Ok(_) => return true,
                Err(waiting) if within.is_none_or(|within| start.elapsed() < within) => request = waiting,
                Err(waiting) => {
                    std::mem::forget(waiting);
                    return false;
                }
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Reports an error and ends the program on every rank, with the error's exit code. Not collective: one rank suffices.
    ///
    /// Of several ranks with the same error, the lowest speaks.
    pub fn fail(&self, error: &Error) -> ! {
        // Rank 0 speaks at once and ends the others while they wait their turn.
        std::thread::sleep(Duration::from_millis(if self.rank() == 0 {
            0
        } else {
            5000 + 20 * self.rank().min(100) as u64
        }));
        let place = if self.size() > 1 {
            format!(" (rank {} of {})", self.rank(), self.size())
        } else {
            String::new()
        };
        let _ = writeln!(std::io::stderr(), "rebond: {error}{place}");
        wait_until_read();
        self.abort(error.exit_code())
    }

    /// Ends the program on every rank, now. Not collective.
    pub fn abort(&self, code: u8) -> ! {
        let _ = std::io::stdout().flush();
        if self.size() == 1 {
            std::process::exit(code.into());
        }
        self.world.abort(code.into())
    }

    /// Number of threads of OpenBLAS; none where BLAS is another library.
    pub fn blas_threads(&self) -> Option<usize> {
        let address = loaded_function(c"openblas_get_num_threads")?;
        // SAFETY: the function has had this signature in every version.
        let threads = unsafe { std::mem::transmute::<*mut c_void, extern "C" fn() -> c_int>(address)() };
        Some(threads as usize)
    }

    /// Version of the PETSc library: major, minor, patch.
    pub fn version(&self) -> [i32; 3] {
        let mut version = [0; 3];
        let [major, minor, patch] = &mut version;
        // It cannot fail: it copies three constants.
        let _ = call!(PetscGetVersionNumber(major, minor, patch, std::ptr::null_mut()));
        version
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
        // SAFETY: no handle is left, since each owns a share of the context; MPI still runs.
        unsafe { sys::PetscFinalize() };
        drop(self.universe.take());
    }
}

/// Where parts of these lengths begin, one after the other.
fn starts(counts: &[c_int]) -> Vec<c_int> {
    counts
        .iter()
        .scan(0, |sum, &count| {
            let start = *sum;
            *sum += count;
            Some(start)
        })
        .collect()
}

/// Ends all ranks when one panics, even inside a callback: the others would wait for it for ever.
fn abort_on_panic() {
    let before = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        before(panic);
        wait_until_read();
        // SAFETY: MPI is thread-safe enough to be aborted from anywhere.
        unsafe { mpi::ffi::MPI_Abort(mpi::ffi::RSMPI_COMM_WORLD, 101) };
    }));
}

/// Waits until the launcher has read what was written to standard error: as it ends all ranks, what is still in the pipe may be
/// lost. Known for Linux only.
fn wait_until_read() {
    const FIONREAD: c_ulong = 0x541B;
    const PAUSE: Duration = Duration::from_millis(10);
    unsafe extern "C" {
        fn ioctl(file: c_int, request: c_ulong, ...) -> c_int;
    }
    let _ = std::io::stderr().flush();
    if cfg!(not(target_os = "linux")) {
        return;
    }
    for _ in 0..500 {
        let mut waiting: c_int = 0;
        // SAFETY: the request writes one integer; a file that is no pipe refuses.
        let code = unsafe { ioctl(2, FIONREAD, &mut waiting as *mut c_int) };
        if code != 0 || waiting == 0 {
            break;
        }
        std::thread::sleep(PAUSE);
    }
    // The launcher passes it on.
    std::thread::sleep(10 * PAUSE);
}

/// Gives BLAS and OpenMP one thread, unless the environment says how many.
///
/// The libraries read their environment as they are loaded, before `main`, so that it must be said to them by call.
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
        if let Some(address) = loaded_function(name) {
            // SAFETY: both functions have had this signature in every version.
            unsafe { std::mem::transmute::<*mut c_void, extern "C" fn(c_int)>(address)(1) };
        }
    }
}

/// Address of a function in the libraries that are loaded, if it is there. Known for Linux only.
fn loaded_function(name: &std::ffi::CStr) -> Option<*mut c_void> {
    unsafe extern "C" {
        fn dlsym(library: *mut c_void, name: *const c_char) -> *mut c_void;
    }
    if cfg!(not(target_os = "linux")) {
        return None;
    }
    // SAFETY: null is RTLD_DEFAULT on Linux.
    let address = unsafe { dlsym(std::ptr::null_mut(), name.as_ptr()) };
    (!address.is_null()).then_some(address)
}
