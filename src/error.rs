//! Error type of the crate, the exit code of each case, and name suggestions for messages.

use crate::quantity::{engineering, place, significant_digits};
use std::path::PathBuf;

/// Everything that can go wrong, with messages for the user.
///
/// [`Error::exit_code`] returns the exit code of the command.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Scene that cannot be read or is invalid. The message is complete: file, line, key, and what
    /// was expected.
    #[error("{0}")]
    Scene(String),
    /// Invalid command line.
    #[error("{0}")]
    Usage(String),
    /// Mesh that cannot carry the elements. The message names the cell, node or edge.
    #[error("{0}")]
    Mesh(String),
    /// Structure or discretisation without a unique answer (a mechanism, a singular matrix).
    #[error("{0}")]
    Singular(String),
    /// Work that needs more memory than the machine and its limits leave. The message gives both
    /// figures and what would fit.
    #[error("{0}")]
    Memory(String),
    /// Step whose solution does not meet the tolerance.
    #[error(
        "step {step}, t = {time:.9} s: the contact solver reached a relative KKT residual of {residual:.1e}, asked for {tolerance:.1e}"
    )]
    NotConverged {
        /// Number of the step.
        step: u64,
        /// Time of the step, in s.
        time: f64,
        /// Relative KKT residual reached, dimensionless.
        residual: f64,
        /// Relative KKT residual required, dimensionless.
        tolerance: f64,
    },
    /// NaN or infinity, reported at the step where it appears.
    #[error("step {step}, t = {}: {what} is not a finite number", engineering(*time, "s"))]
    NotFinite {
        /// Number of the step.
        step: u64,
        /// Time of the step, in s.
        time: f64,
        /// Name of the quantity that is not finite.
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
        /// Number of the step.
        step: u64,
        /// Time of the last event, in s.
        time: f64,
        /// Number of events in the step.
        count: u64,
        /// Bound of the last event (an index into the bounds).
        bound: usize,
        /// Position of the last event, in words.
        place: String,
    },
    /// Call that PETSc or MPI refused: the function, its message and its code.
    #[error("PETSc: {0}")]
    Petsc(String),
    /// Error of another rank, with its message and exit code.
    #[error("{words}")]
    Elsewhere {
        /// Message of the error.
        words: String,
        /// Exit code of the error.
        code: u8,
    },
    /// Energy above the limit of the guard.
    #[error(
        "step {step}, t = {}: the energy is {} times {of}, past the guard of {limit}; {advice}",
        engineering(*time, "s"), significant_digits(*ratio, 4)
    )]
    EnergyGuard {
        /// Number of the step.
        step: u64,
        /// Time of the step, in s.
        time: f64,
        /// Ratio of the energy to its reference, dimensionless.
        ratio: f64,
        /// Name of the reference.
        of: &'static str,
        /// Limit of the ratio, dimensionless.
        limit: f64,
        /// Advice to the user.
        advice: &'static str,
    },
    /// Load with a pole that the plate has passed.
    #[error(
        "t = {}: {key}: the plate was pulled in: at {} it has passed w = {}, where the formula has a pole; put an \
         obstacle before it, or lower the load",
        engineering(*time, "s"), place(*point), engineering(*w, "m")
    )]
    PulledIn {
        /// Key of the load.
        key: String,
        /// Time of the step, in s.
        time: f64,
        /// Place of the point, in m.
        point: [f64; 2],
        /// Deflection at the pole, in m.
        w: f64,
    },
    /// Checkpoint from which a run cannot be resumed.
    #[error("{0}")]
    Checkpoint(String),
    /// Run that was interrupted and has written a checkpoint.
    #[error(
        "interrupted at step {step}, t = {time:.9} s; `rebond resume` with the run folder goes on from there"
    )]
    Interrupted {
        /// Number of the last step.
        step: u64,
        /// Time of the last step, in s.
        time: f64,
    },
    /// Command of many runs that was interrupted between them. The message tells how to go on.
    #[error("{0}")]
    Stopped(String),
    /// File or folder that cannot be read or written.
    #[error("{}: {}", path.display(), words(source))]
    Io {
        /// Path of the file or folder.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

impl Error {
    /// Returns the exit code of the command.
    ///
    /// The codes are 2 for an invalid scene, mesh or command line, a singular problem or lack of
    /// memory; 3 for a step or a comparison that fails, or a PETSc error; 4 for input, output and
    /// checkpoints; 5 for the energy guard; 130 for an interruption. An error of another rank has
    /// the code that it has there.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Scene(_) | Error::Usage(_) | Error::Mesh(_) | Error::Singular(_) | Error::Memory(_) => 2,
            Error::NotConverged { .. }
            | Error::NotFinite { .. }
            | Error::Events { .. }
            | Error::PulledIn { .. }
            | Error::Unfinished(_)
            | Error::Petsc(_) => 3,
            Error::Io { .. } | Error::Checkpoint(_) => 4,
            Error::EnergyGuard { .. } => 5,
            Error::Interrupted { .. } | Error::Stopped(_) => 130,
            Error::Elsewhere { code, .. } => *code,
        }
    }

    /// Adds warnings, which may tell the reason, to the words of a singular problem.
    pub(crate) fn beside(self, warnings: &[String]) -> Error {
        match self {
            Error::Singular(words) => Error::Singular([&[words], warnings].concat().join("; ")),
            other => other,
        }
    }

    /// Returns the error of a file whose contents are wrong.
    pub fn invalid(path: impl Into<PathBuf>, what: impl Into<String>) -> Error {
        Error::io(path)(std::io::Error::new(std::io::ErrorKind::InvalidData, what.into()))
    }

    /// Returns a function that attaches a path to an input or output error.
    pub fn io(path: impl Into<PathBuf>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.into();
        move |source| Error::Io { path, source }
    }
}

/// Returns the words of an error of the operating system, without its number.
fn words(source: &std::io::Error) -> String {
    match source.kind() {
        std::io::ErrorKind::NotADirectory => "a file stands where a folder is expected".to_owned(),
        _ => source.to_string().split(" (os error").next().unwrap_or_default().to_owned(),
    }
}

/// Result with the crate's error type.
pub type Result<T> = std::result::Result<T, Error>;

/// Limit on the characters of a user's string that a message repeats.
const LONGEST_QUOTE: usize = 60;

/// Shortens a long string of the input for a message.
pub(crate) fn cut(text: &str) -> String {
    match text.char_indices().nth(LONGEST_QUOTE) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// Creates the error at a place of the input, with control characters escaped so that it stays on
/// one line.
pub(crate) fn error_at(place: &str, wrong: &str) -> Error {
    let escape = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    Error::Scene(format!("{place}: {wrong}").chars().map(escape).collect())
}

/// Returns a hint with the valid name that was probably meant, or an empty string.
pub(crate) fn suggestion(wrong: &str, valid: &[&str]) -> String {
    let alike = |name: &&&str| strsim::jaro_winkler(wrong, name);
    // Names of files are not alike by their ending alone.
    let stem = |name: &str| name.rsplit_once('.').map_or(name, |(stem, _)| stem).to_owned();
    let is_near = |name: &&&str| strsim::jaro_winkler(&stem(wrong), &stem(name)) > 0.75;
    let nearest = valid.iter().filter(is_near).max_by(|a, b| alike(a).total_cmp(&alike(b)));
    nearest.map_or(String::new(), |name| format!(" (did you mean {name}?)"))
}
