//! Table `[solver]`: linear algebra, contact solver and tolerances.

use super::quantities::{ENERGY_GUARD, TOLERANCE};
use crate::error::Result;
use crate::scene::document::Document;
use crate::scene::{ContactSolver, EngineName, Solver};

/// Reads the table; `engine` is the default.
pub(super) fn read(doc: &Document, engine: EngineName) -> Result<Solver> {
    doc.allow("solver", &["engine", "vi", "tolerance", "energy_guard"])?;
    Ok(Solver {
        engine: doc.optional_choice("solver.engine")?.unwrap_or(engine),
        vi: doc.optional_choice("solver.vi")?.unwrap_or(ContactSolver::Condensed),
        tolerance: doc.optional_number("solver.tolerance", &TOLERANCE)?.unwrap_or(1e-10),
        energy_guard: doc.optional_number("solver.energy_guard", &ENERGY_GUARD)?.unwrap_or(100.0),
    })
}
