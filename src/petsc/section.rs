//! Numbers of dofs and constrained dofs of each mesh point.

#![allow(unsafe_code)]

use super::error::{call, get, int};
use super::handle::handle;
use super::{Context, Index};
use crate::error::Result;
use std::ops::Range;
use std::rc::Rc;

/// Dofs of one mesh point.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Dofs {
    /// Number of dofs.
    pub count: usize,
    /// Constrained dofs, ascending: they are in local vectors and not in global ones.
    pub held: Vec<Index>,
}

handle! {
    /// Layout of dofs over the points of a mesh. Creating and dropping it is collective.
    Section, PetscSection, PetscSectionDestroy
}

impl Section {
    /// Creates the section that gives each point of `chart` its dofs. Collective.
    ///
    /// Ranks that share a point must give it the same dofs.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(
        context: &Rc<Context>,
        chart: Range<Index>,
        mut dofs: impl FnMut(Index) -> Dofs,
    ) -> Result<Self> {
        let raw = get!(PetscSectionCreate(context.raw()))?;
        let section = Self::owning(raw, context);
        call!(PetscSectionSetChart(raw, chart.start, chart.end))?;
        let mut held = Vec::new();
        for point in chart {
            let dofs = dofs(point);
            call!(PetscSectionSetDof(raw, point, int(dofs.count)?))?;
            if !dofs.held.is_empty() {
                call!(PetscSectionSetConstraintDof(raw, point, int(dofs.held.len())?))?;
                held.push((point, dofs.held));
            }
        }
        call!(PetscSectionSetUp(raw))?;
        for (point, held) in held {
            // PETSc copies the indices.
            call!(PetscSectionSetConstraintIndices(raw, point, held.as_ptr()))?;
        }
        Ok(section)
    }

    /// Returns the position of a point's first dof in a local or global vector.
    ///
    /// In a global section, a point of another rank has -(position + 1).
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where the point is outside the chart.
    pub fn offset(&self, point: Index) -> Result<Index> {
        get!(PetscSectionGetOffset(self.raw, point))
    }
}
