//! Saving and restoring modal coordinates, on any number of ranks.
//!
//! On another number of ranks the modes have other signs, and those of equal frequency mix. This
//! may also happen on the same number, since MUMPS rounds differently each time. Coordinates are
//! therefore saved with the displacement that they describe, and found from it where the modes have
//! changed.

use super::all_bounds::AllBounds;
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::kernels::lanes::norm;
use crate::linalg::vectors::subtract;
use crate::linalg::{Engine, MassModes};
use crate::scheme::System;
use std::cell::Cell;

/// Relative distance up to which modal coordinates are the same but for rounding.
const SAME: f64 = 1e-12;

/// Modal coordinates in an archive; see the [module page](self).
pub(crate) struct Coordinates<'a, E: Engine> {
    system: &'a System<E>,
    modes: &'a MassModes,
    global: &'a AllBounds,
    /// Whether all coordinates so far were saved with the same modes, but for rounding.
    pub are_same: Cell<bool>,
}

impl<'a, E: Engine> Coordinates<'a, E> {
    /// Creates the coordinates of some modes.
    pub fn new(system: &'a System<E>, modes: &'a MassModes, global: &'a AllBounds) -> Coordinates<'a, E> {
        Coordinates { system, modes, global, are_same: Cell::new(true) }
    }

    /// Saves or restores modal coordinates. Collective.
    pub fn archive(&self, values: &mut Vec<f64>, archive: &mut Archive) -> Result<()> {
        archive.value(values)?;
        if !self.global.is_partitioned() {
            return Ok(());
        }
        let System { engine, mass, .. } = self.system;
        let mut u = vec![0.0; engine.dofs()];
        if archive.saves() {
            self.modes.add_shapes(values, &mut u);
        }
        archive.vector(VectorKind::Dofs, &mut u)?;
        if !archive.saves() {
            let mut present = vec![0.0; self.modes.count()];
            engine.project(mass, &u, &mut present)?;
            subtract(values, &mut present);
            // NaN is another value.
            if norm(&present) <= SAME * norm(values) {
                return Ok(());
            }
            engine.project(mass, &u, values)?;
            self.are_same.set(false);
        }
        Ok(())
    }
}
