//! Native part of the Python package `rebond`.
//!
//! The package's Python files define everything that users see; this library gives them scenes,
//! runs, models and simulations as plain numbers. All native work happens in threads of its own,
//! which hold models and schemes from their creation to their end: Python's lock is free
//! meanwhile, signals are looked at ten times per second, and a panic ends its thread and reaches
//! Python as an exception.

mod errors;
mod host;
mod line;
mod matrices;
mod model;
mod run;
mod run_data;
mod scene;
mod simulation;

use pyo3::prelude::*;

/// Native part of the package.
#[pymodule]
mod _core {
    #[pymodule_export]
    use crate::model::{Model, keep_modes};
    #[pymodule_export]
    use crate::run::{resume, run};
    #[pymodule_export]
    use crate::scene::Scene;
    #[pymodule_export]
    use crate::simulation::Simulation;

    use pyo3::prelude::*;

    /// Version of the program.
    #[pymodule_export]
    const VERSION: &str = env!("CARGO_PKG_VERSION");

    /// Number with its unit and the prefix of it, as the command writes both.
    #[pyfunction]
    fn engineering(value: f64, unit: &str) -> String {
        rebond::quantity::engineering(value, unit)
    }

    /// Panics in native code, by which a test proves that no panic crosses into Python.
    #[pyfunction]
    fn panic(py: Python<'_>, message: String) -> PyResult<()> {
        crate::errors::guarded(py, move || -> rebond::Result<()> { panic!("{message}") })
    }
}
