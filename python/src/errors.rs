//! Errors and panics of native code as Python exceptions.

use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Reason for which native code has no result.
pub enum Failure {
    /// Error of the library.
    Error(rebond::Error),
    /// Message of a panic, which is a defect of the library.
    Panic(String),
}

impl From<rebond::Error> for Failure {
    fn from(error: rebond::Error) -> Failure {
        Failure::Error(error)
    }
}

impl From<Box<dyn Any + Send>> for Failure {
    fn from(payload: Box<dyn Any + Send>) -> Failure {
        let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| payload.downcast_ref::<String>().cloned());
        Failure::Panic(text.unwrap_or_else(|| "no message".into()))
    }
}

impl Failure {
    /// Returns the exception of the package for the failure, with its message on one line.
    pub fn exception(&self, py: Python<'_>) -> PyErr {
        let (class, message) = match self {
            Failure::Error(error) => (class_of(error), in_python(&error.to_string())),
            Failure::Panic(text) => ("InternalError", format!("internal error, please report it: {text}")),
        };
        exception(py, class, &message.replace('\n', " "))
    }
}

/// Options of the command in messages, and Python's words for them.
const ARGUMENTS: [(&str, &str); 4] =
    [("--set ", ""), ("--out DIR", "out="), ("--overwrite", "overwrite=True"), ("--until ", "until=")];

/// Returns a message with the arguments of functions in place of the command's options.
fn in_python(message: &str) -> String {
    let mut message = match message.strip_prefix("--set ") {
        Some(change) => format!("set: {change}"),
        None => message.to_owned(),
    };
    if let Some((before, rest)) = message.split_once("`rebond resume ")
        && let Some((call, after)) = rest.split_once('`')
    {
        let (folder, until) = call.split_once(" --until ").unwrap_or((call, ""));
        let until = if until.is_empty() { String::new() } else { format!(", until={until}") };
        message = format!("{before}rebond.resume({folder:?}{until}){after}");
    }
    ARGUMENTS.iter().fold(message, |text, (option, argument)| text.replace(option, argument))
}

/// Returns the name of the exception class for an error; see `rebond/errors.py`.
fn class_of(error: &rebond::Error) -> &'static str {
    match error {
        rebond::Error::Scene(_) | rebond::Error::Mesh(_) | rebond::Error::Singular(_) => "SceneError",
        rebond::Error::Usage(_) => "UsageError",
        rebond::Error::Memory(_) => "MemoryLimitError",
        rebond::Error::Io { .. } | rebond::Error::Checkpoint(_) => "FileError",
        rebond::Error::EnergyGuard { .. } => "EnergyError",
        rebond::Error::Interrupted { .. } | rebond::Error::Stopped(_) => "Error",
        _ => "SolverError",
    }
}

/// Creates an exception of the package, by the name of its class.
pub fn exception(py: Python<'_>, class: &str, message: &str) -> PyErr {
    let made = py.import("rebond.errors").and_then(|errors| errors.getattr(class)?.call1((message,)));
    match made {
        Ok(exception) => PyErr::from_value(exception),
        Err(_) => PyRuntimeError::new_err(message.to_owned()),
    }
}

/// Creates the exception for a wrong use of the package.
pub fn usage(py: Python<'_>, message: &str) -> PyErr {
    exception(py, "UsageError", message)
}

/// Does short native work without Python's lock, and turns its error or panic into an exception.
pub fn guarded<T: Send>(py: Python<'_>, work: impl FnOnce() -> rebond::Result<T> + Send) -> PyResult<T> {
    let done = py.detach(|| catch_unwind(AssertUnwindSafe(work)));
    let done = done.map_err(Failure::from).and_then(|result| result.map_err(Failure::from));
    done.map_err(|failure| failure.exception(py))
}
