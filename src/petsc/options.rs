//! PETSc's options database, with a check for options that nothing used.

#![allow(unsafe_code)]

use super::error::{c_string, call, check, get, text};
use super::words::{is_name, refuse_nan};
use super::{Context, library, sys};
use crate::error::{Error, Result};
use std::ffi::{CString, c_char, c_int, c_void};

pub use super::words::validate;

/// Options that PETSc looks up only at its end, or not at all in some builds; they may stay unused.
const LATE: &str = include_str!("late_options.txt");

/// Options that PETSc's solvers look up, without prefixes, one name per line.
///
/// The nearest of these names is suggested for an unused option.
const KNOWN: &str = include_str!("known_options.txt");

/// Option files that PETSc looks for in the working folder; the home folder has `.petscrc` only.
const FILES: [&str; 2] = [".petscrc", "petscrc"];

/// Options prefix of a solver, null where it is empty.
///
/// With an empty string instead, PETSc's monitors would print an empty solver name.
pub(super) struct Prefix(Option<CString>);

impl Prefix {
    pub(super) fn new(prefix: &str) -> Result<Prefix> {
        Ok(Prefix(if prefix.is_empty() { None } else { Some(c_string(prefix)?) }))
    }

    /// Returns the string or null, valid while `self` lives; PETSc copies it.
    pub(super) fn pointer(&self) -> *const c_char {
        self.0.as_ref().map_or(std::ptr::null(), |prefix| prefix.as_ptr())
    }
}

impl Context {
    /// Returns whether the option `name` (without its dash) is set, by the user or by a default of
    /// ours.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn has_option(&self, name: &str) -> Result<bool> {
        // A query through PETSc would mark the option as used.
        Ok(self
            .database()?
            .split_whitespace()
            .any(|word| word.strip_prefix('-').is_some_and(|word| word.eq_ignore_ascii_case(name))))
    }

    /// Returns all options as text: names, each with a dash, and values.
    fn database(&self) -> Result<String> {
        let list = get!(PetscOptionsGetAll(std::ptr::null_mut()))?;
        // SAFETY: PETSc allocated the string.
        let words = unsafe { text(list) };
        free(list)?;
        Ok(words)
    }

    /// Returns the user's options of linear solvers, preconditioners and matrices with a prefix, as
    /// on a command line; an empty text where there are none.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn solver_options(&self, prefix: &str) -> Result<String> {
        let (database, ours) = (self.database()?, self.ours.borrow());
        let mut is_kept = false;
        let keeps = |word: &&str| {
            if let Some(name) = word.strip_prefix('-').filter(|name| name.starts_with(char::is_alphabetic)) {
                let rest = name.strip_prefix(prefix).unwrap_or_default();
                let is_of_solver = ["ksp_", "pc_", "mat_"].iter().any(|kind| rest.starts_with(kind));
                is_kept = is_of_solver && !ours.iter().any(|our| our.eq_ignore_ascii_case(name));
            }
            is_kept
        };
        Ok(database.split_whitespace().filter(keeps).collect::<Vec<_>>().join(" "))
    }

    /// Checks options from `PETSC_OPTIONS` and files, as [`validate`] checks arguments.
    pub(super) fn check_database(&self) -> Result<()> {
        let database = self.database()?;
        let words: Vec<&str> = database.split_whitespace().collect();
        words.windows(2).filter(|pair| is_name(pair[0])).try_for_each(|pair| refuse_nan(pair[0], pair[1]))
    }

    /// Prints on rank 0 which option file PETSc would have read without `-skip_petscrc`.
    pub(super) fn tell_of_files_left_out(&self) {
        let skips = self.option("skip_petscrc").ok().flatten();
        let reads =
            skips.is_some_and(|value| ["0", "false", "no", "off"].contains(&value.to_lowercase().as_str()));
        if reads || self.rank() > 0 {
            return;
        }
        let home = std::env::home_dir().map(|home| home.join(FILES[0]));
        let here = FILES.map(std::path::PathBuf::from);
        if let Some(file) = home.into_iter().chain(here).find(|file| file.is_file()) {
            eprintln!("rebond: note: {} is not read; `-- -skip_petscrc 0` has PETSc read it", file.display());
        }
    }

    /// Returns the value of the option `name` (without its dash), and marks it as used.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn option(&self, name: &str) -> Result<Option<String>> {
        let name = c_string(&format!("-{name}"))?;
        let (database, prefix, mut value) = (std::ptr::null_mut(), std::ptr::null(), [0; 256]);
        let is_set = get!(PetscOptionsGetString(database, prefix, name.as_ptr(), value.as_mut_ptr(), 256))?;
        // SAFETY: PETSc ends the string with a zero within the array.
        Ok((is_set == sys::truth(true)).then(|| unsafe { text(value.as_ptr()) }))
    }

    /// Returns the number that the option `name` (without its dash) gives, and marks it as used.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for what is no number, and [`Error::Petsc`].
    pub fn count(&self, name: &str) -> Result<Option<usize>> {
        let wrong = |value: &str| Error::Usage(format!("-{name} {value}: expected a whole number"));
        let number = |value: String| value.parse().map_err(|_| wrong(&value));
        self.option(name)?.map(number).transpose()
    }

    /// Sets a default for an option (name without dash) that the user did not set.
    ///
    /// Defaults may stay unused.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn default_option(&self, name: &str, value: &str) -> Result<()> {
        if self.has_option(name)? {
            return Ok(());
        }
        self.ours.borrow_mut().insert(name.to_string());
        self.set_option(name, value)
    }

    /// Runs `body` with an option (name and value) that overrides the user's.
    ///
    /// Afterwards the user's options are as they were, and defaults set by `body` are gone.
    ///
    /// # Errors
    /// Returns the error of `body`, or [`Error::Petsc`] where PETSc reports an error.
    pub fn with_option<T>(
        &self,
        option: Option<(&str, &str)>,
        body: impl FnOnce() -> Result<T>,
    ) -> Result<T> {
        let before = self.ours.borrow().clone();
        let mut aside = None;
        if let Some((name, value)) = option {
            if self.has_option(name)? {
                let unused = self.unused_options()?.iter().any(|unused| unused.eq_ignore_ascii_case(name));
                aside = Some((name, self.option(name)?.unwrap_or_default(), unused));
                self.clear_option(name)?;
            }
            self.default_option(name, value)?;
        }
        let result = body();
        let meanwhile: Vec<String> = self.ours.borrow().difference(&before).cloned().collect();
        for name in meanwhile {
            self.clear_option(&name)?;
            self.ours.borrow_mut().remove(&name);
        }
        if let Some((name, value, unused)) = aside {
            self.set_option(name, &value)?;
            if !unused {
                self.option(name)?;
            }
        }
        result
    }

    fn set_option(&self, name: &str, value: &str) -> Result<()> {
        let (name, value) = (c_string(&format!("-{name}"))?, c_string(value)?);
        call!(PetscOptionsSetValue(std::ptr::null_mut(), name.as_ptr(), value.as_ptr()))
    }

    fn clear_option(&self, name: &str) -> Result<()> {
        let name = c_string(&format!("-{name}"))?;
        call!(PetscOptionsClearValue(std::ptr::null_mut(), name.as_ptr()))
    }

    /// Returns the user's options that nothing has looked up yet, without dashes.
    ///
    /// Options that PETSc needs only at its end are left out.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn unused_options(&self) -> Result<Vec<String>> {
        let (mut count, mut names, mut values) =
            get!(PetscOptionsLeftGet(std::ptr::null_mut(); count, names, values))?;
        // SAFETY: PETSc allocated `count` names.
        let unused: Vec<_> = (0..count as usize).map(|i| unsafe { text(*names.add(i)) }).collect();
        call!(PetscOptionsLeftRestore(std::ptr::null_mut(), &mut count, &mut names, &mut values))?;
        let ours = self.ours.borrow();
        let is = |list: &str, name: &str| list.eq_ignore_ascii_case(name);
        Ok(unused
            .into_iter()
            .filter(|name| !LATE.lines().any(|late| is(late, name)) && !ours.iter().any(|our| is(our, name)))
            .collect())
    }

    /// Marks known options that begin with this prefix as used.
    ///
    /// Solvers look some options up only during a solve, which may never happen.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn accept_options(&self, beginning: &str) -> Result<()> {
        let names = self.known_options();
        for name in self.unused_options()?.iter().filter(|name| name.starts_with(beginning)) {
            if names.iter().any(|other| other.eq_ignore_ascii_case(name)) {
                self.option(name)?;
            }
        }
        Ok(())
    }

    /// Refuses options that nothing has looked up; call it once every solver is set up.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] naming the option and the nearest one that PETSc knows.
    pub fn refuse_unused_options(&self) -> Result<()> {
        let unused = self.unused_options()?;
        let Some(name) = unused.first() else { return Ok(()) };
        let names = self.known_options();
        let hint = match nearest(name, &names) {
            Some(near) if near == name => "; it is for a solver that was not chosen".into(),
            Some(near) => format!("; did you mean `-{near}`?"),
            None => String::new(),
        };
        let others = match unused.len() {
            1 => String::new(),
            n => format!(" (and {} more)", n - 1),
        };
        Err(Error::Usage(format!("nothing used the PETSc option `-{name}`{others}{hint}")))
    }

    /// Records the options prefix of a solver.
    pub(super) fn note_prefix(&self, prefix: &str) {
        self.prefixes.borrow_mut().insert(prefix.into());
    }

    /// Returns all names for suggestions: PETSc's, with the prefixes of the solvers created so far.
    pub fn known_options(&self) -> Vec<String> {
        let mut names: Vec<_> = KNOWN.lines().chain(LATE.lines()).map(String::from).collect();
        for prefix in self.prefixes.borrow().iter() {
            names.extend(KNOWN.lines().map(|name| format!("{prefix}{name}")));
        }
        names
    }
}

/// Frees memory that PETSc allocated for its caller.
fn free(pointer: *mut c_char) -> Result<()> {
    type Free = unsafe extern "C" fn(*mut c_void, c_int, *const c_char, *const c_char) -> sys::PetscErrorCode;
    let Some(variable) = library::address(c"PetscTrFree") else { return Ok(()) };
    // SAFETY: PetscFree is a macro on this variable of this type, which PetscInitialize sets.
    let Some(free) = (unsafe { *variable.cast::<Option<Free>>() }) else { return Ok(()) };
    // SAFETY: the pointer came from PetscMalloc and is not used again.
    check(unsafe { free(pointer.cast(), 0, c"free".as_ptr(), c"options.rs".as_ptr()) }, "PetscFree")
}

/// Returns the known name at the smallest edit distance, if that is small enough for a typo.
pub fn nearest<'a>(name: &str, names: &'a [String]) -> Option<&'a str> {
    let (distance, near) = names.iter().map(|near| (strsim::damerau_levenshtein(name, near), near)).min()?;
    (distance <= 1 + name.len() / 4).then_some(near.as_str())
}
