//! The one error type, the exit code of each case, and the hint of a message.

use std::path::PathBuf;

/// Everything that can go wrong, in the user's words.
///
/// [`Error::exit_code`] gives the code with which the command ends.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A scene that cannot be read or makes no sense. The message is complete: file, line, key, what was expected.
    #[error("{0}")]
    Scene(String),
    /// A command line that makes no sense.
    #[error("{0}")]
    Usage(String),
    /// A mesh that cannot carry the elements: the message names the cell, node or edge.
    #[error("{0}")]
    Mesh(String),
    /// The structure or its discretisation has no unique answer (a mechanism, a singular matrix).
    #[error("{0}")]
    Singular(String),
    /// Work that takes more memory than the machine and its limits leave. The message has both figures and what would fit.
    #[error("{0}")]
    Memory(String),
    /// A step whose solution does not meet the tolerance.
    #[error(
        "step {step}, t = {time:.9} s: the contact solver reached a relative KKT residual of {residual:.1e}, asked for {tolerance:.1e}"
    )]
    NotConverged {
        /// Step at which it happened.
        step: u64,
        /// Its time, in seconds.
        time: f64,
        /// Relative KKT residual reached, dimensionless.
        residual: f64,
        /// Relative KKT residual asked for, dimensionless.
        tolerance: f64,
    },
    /// A NaN or an infinity, caught at the step where it appears.
    #[error("step {step}, t = {time:.9} s: {what} is not a finite number")]
    NotFinite {
        /// Step at which it appeared.
        step: u64,
        /// Its time, in seconds.
        time: f64,
        /// What is not finite.
        what: &'static str,
    },
    /// Solvers under comparison that did not reach the end, each with its reason.
    #[error("{0}")]
    Unfinished(String),
    /// More events in a step than a scheme follows.
    #[error(
        "step {step}, t = {time:.12} s: {count} events since the step began, the last at {place}; set a smaller time.step"
    )]
    Events {
        /// Step at which it happened.
        step: u64,
        /// Time of the last event, in seconds.
        time: f64,
        /// How many there were.
        count: u64,
        /// The bound of the last one (an index into the bounds).
        bound: usize,
        /// Where that is.
        place: String,
    },
    /// PETSc or MPI refused a call: the function, what it said, its code.
    #[error("PETSc: {0}")]
    Petsc(String),
    /// What another process found: its words and its exit code.
    #[error("{words}")]
    Elsewhere {
        /// What it says.
        words: String,
        /// With what it ends the command.
        code: u8,
    },
    /// The energy grew past the guard.
    #[error(
        "step {step}, t = {time:.9} s: the energy is {ratio:.4} times {of}, past the guard of {limit}; {advice}"
    )]
    EnergyGuard {
        /// Step at which it happened.
        step: u64,
        /// Its time, in seconds.
        time: f64,
        /// Energy over what it is measured against, dimensionless.
        ratio: f64,
        /// What that is.
        of: &'static str,
        /// The guard, dimensionless.
        limit: f64,
        /// What the user can do.
        advice: &'static str,
    },
    /// A checkpoint that cannot be gone on from.
    #[error("{0}")]
    Checkpoint(String),
    /// A run that was asked to stop, and has written a checkpoint.
    #[error(
        "interrupted at step {step}, t = {time:.9} s; `rebond resume` with the run folder goes on from there"
    )]
    Interrupted {
        /// Step at which it stopped.
        step: u64,
        /// Its time, in seconds.
        time: f64,
    },
    /// A file or folder that cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Error {
    /// Exit code of the command: 2 scene or usage, 3 no convergence or a refusal of PETSc, 4 reading or writing, 5 energy guard,
    /// 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Scene(_) | Error::Usage(_) | Error::Mesh(_) | Error::Singular(_) | Error::Memory(_) => 2,
            Error::NotConverged { .. }
            | Error::NotFinite { .. }
            | Error::Events { .. }
            | Error::Unfinished(_)
            | Error::Petsc(_) => 3,
            Error::Io { .. } | Error::Checkpoint(_) => 4,
            Error::EnergyGuard { .. } => 5,
            Error::Interrupted { .. } => 130,
            Error::Elsewhere { code, .. } => *code,
        }
    }

    /// Attaches a path to an input or output error.
    pub fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.into();
        move |source| Error::Io { path, source }
    }
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;

/// The valid name that a wrong one was probably meant to be.
pub(crate) fn suggestion(wrong: &str, valid: &[&str]) -> String {
    let alike = |name: &&&str| strsim::jaro_winkler(wrong, name);
    let nearest = valid.iter().max_by(|a, b| alike(a).total_cmp(&alike(b))).filter(|name| alike(name) > 0.75);
    nearest.map_or(String::new(), |name| format!(" (did you mean {name}?)"))
}
