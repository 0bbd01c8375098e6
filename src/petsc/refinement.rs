//! Uniform refinement of a mesh, which knows the vertices that each point becomes.

#![allow(unsafe_code)]

use super::error::{call, get};
use super::handle::handle;
use super::{Index, Plex, sys};
use crate::error::Result;

handle! {
    /// Refinement of a mesh that cuts every cell into four. Creating and dropping it is collective.
    ///
    /// Vertices stay, each edge gets a vertex at its midpoint and each quadrilateral one at the
    /// mean of its corners. All of them are on the ranks of the points that they come from.
    Refinement, DMPlexTransform, DMPlexTransformDestroy
}

impl Refinement {
    /// Creates the refinement of a mesh. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(mesh: &Plex) -> Result<Self> {
        let raw = get!(DMPlexTransformCreate(mesh.context.raw()))?;
        let refinement = Self::owning(raw, &mesh.context);
        call!(DMPlexTransformSetType(raw, c"refine_regular".as_ptr()))?;
        call!(DMPlexTransformSetDM(raw, mesh.raw))?;
        call!(DMPlexTransformSetUp(raw))?;
        Ok(refinement)
    }

    /// Returns the mesh that is refined.
    fn coarse(&self) -> Result<Plex> {
        Plex::sharing(get!(DMPlexTransformGetDM(self.raw))?, &self.context)
    }

    /// Creates the refined mesh; labels are kept. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn fine(&self) -> Result<Plex> {
        let coarse = self.coarse()?;
        Ok(Plex::owning(get!(DMPlexTransformApply(self.raw, coarse.raw))?, &self.context))
    }

    /// Returns the vertex of the refined mesh that a vertex, an edge or a quadrilateral of this
    /// rank becomes; `None` for a triangle.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where there is no such point.
    pub fn vertex(&self, point: Index) -> Result<Option<Index>> {
        let coarse = self.coarse()?;
        let kind = get!(DMPlexGetCellType(coarse.raw, point))?;
        if kind == sys::DMPolytopeType::DM_POLYTOPE_TRIANGLE {
            return Ok(None);
        }
        let to = sys::DMPolytopeType::DM_POLYTOPE_POINT;
        get!(DMPlexTransformGetTargetPoint(self.raw, kind, to, point, 0)).map(Some)
    }
}
