//! How many dofs each point of a mesh has, and which of them are held.

use super::error::{call, int};
use super::handle::handle;
use super::{Comm, Context, Index};
use crate::error::Result;
use std::ops::Range;
use std::rc::Rc;

/// The dofs of one point of a mesh.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Dofs {
    /// How many.
    pub count: usize,
    /// Which of them are held, ascending: they are in local vectors and not in global ones.
    pub held: Vec<Index>,
}

handle! {
    /// Numbers of dofs over the points of a mesh. Creating and dropping it is collective.
    Section, PetscSection, PetscSectionDestroy
}

impl Section {
    /// The section that gives each point of `chart` its dofs. Ranks that share a point must say the same of it. Collective.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`].
    pub fn new(
        context: &Rc<Context>,
        comm: Comm,
        chart: Range<Index>,
        mut dofs: impl FnMut(Index) -> Dofs,
    ) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(PetscSectionCreate(context.raw(comm), &mut raw))?;
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

    /// Points that the section speaks of.
    pub fn chart(&self) -> Range<Index> {
        let (mut start, mut end) = (0, 0);
        // It cannot fail: the section is set up.
        let _ = call!(PetscSectionGetChart(self.raw, &mut start, &mut end));
        start..end
    }

    /// Number of dofs of a point.
    ///
    /// # Errors
    /// [`crate::Error::Petsc`] where the point is not of the chart.
    pub fn dofs(&self, point: Index) -> Result<usize> {
        let mut count = 0;
        call!(PetscSectionGetDof(self.raw, point, &mut count))?;
        Ok(count.unsigned_abs() as usize)
    }

    /// Position of a point's first dof: in a local vector for a local section; in the whole global vector for a global one,
    /// where a point of another rank has -(position + 1).
    ///
    /// # Errors
    /// [`crate::Error::Petsc`] where the point is not of the chart.
    pub fn offset(&self, point: Index) -> Result<Index> {
        let mut offset = 0;
        call!(PetscSectionGetOffset(self.raw, point, &mut offset))?;
        Ok(offset)
    }

    /// Number of dofs of all points of this rank, held ones among them.
    pub fn size(&self) -> usize {
        let mut size = 0;
        // It cannot fail: the section is set up.
        let _ = call!(PetscSectionGetStorageSize(self.raw, &mut size));
        size as usize
    }
}
