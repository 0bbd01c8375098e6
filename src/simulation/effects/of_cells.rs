//! Engines that build their matrices from the cells of this process.

use crate::linalg::{Engine, Native};

/// Engine whose matrices the native engine builds over this process's cells.
pub(in crate::simulation) trait OfCells: Engine + 'static {
    /// Returns the native engine.
    fn native(&self) -> &Native;
}

impl OfCells for Native {
    fn native(&self) -> &Native {
        self
    }
}

#[cfg(feature = "petsc")]
impl OfCells for crate::distributed::Distributed {
    fn native(&self) -> &Native {
        self.cells()
    }
}
