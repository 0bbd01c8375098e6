//! Table `[solver]`: linear algebra, contact solver and tolerances.

use super::quantities::{ENERGY_GUARD, TOLERANCE};
use crate::error::Result;
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::{ContactSolver, EngineName, LinearSolver, Solver};

pub(super) static SOLVER: TableKeys = TableKeys::optional(&[&[
    key(
        "engine",
        ValueKind::Word(words::<EngineName>),
        "linear algebra; default: native on one process, petsc on several",
    ),
    key(
        "linear",
        ValueKind::Word(words::<LinearSolver>),
        "solver of the linear systems on PETSc; default auto: direct, or multigrid where factors would not fit",
    ),
    key("vi", ValueKind::Word(words::<ContactSolver>), "contact solver; default condensed"),
    key(
        "tolerance",
        ValueKind::Number(&TOLERANCE),
        "relative KKT residual that every step must meet; default 1e-10",
    ),
    key(
        "energy_guard",
        ValueKind::Number(&ENERGY_GUARD),
        "ratio to the initial energy at which a run is stopped; default 100",
    ),
]]);

/// Reads the table; `engine` is the default.
pub(super) fn read(doc: &Document, engine: EngineName) -> Result<Solver> {
    doc.allow("solver", &SOLVER)?;
    Ok(Solver {
        engine: doc.optional_choice("solver.engine")?.unwrap_or(engine),
        linear: doc.optional_choice("solver.linear")?.unwrap_or(LinearSolver::Auto),
        vi: doc.optional_choice("solver.vi")?.unwrap_or(ContactSolver::Condensed),
        tolerance: doc.optional_number("solver.tolerance", &TOLERANCE)?.unwrap_or(1e-10),
        energy_guard: doc.optional_number("solver.energy_guard", &ENERGY_GUARD)?.unwrap_or(100.0),
    })
}
