//! Uniform refinement of a mesh, which knows the vertices that each point becomes.

#![allow(unsafe_code)]

use super::error::call;
use super::handle::handle;
use super::{Comm, Index, Plex, sys};
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
        let mut raw = std::ptr::null_mut();
        call!(DMPlexTransformCreate(mesh.context.raw(Comm::World), &mut raw))?;
        let refinement = Self::owning(raw, &mesh.context);
        call!(DMPlexTransformSetType(raw, c"refine_regular".as_ptr()))?;
        call!(DMPlexTransformSetDM(raw, mesh.raw))?;
        call!(DMPlexTransformSetUp(raw))?;
        Ok(refinement)
    }

    /// Returns the mesh that is refined.
    fn coarse(&self) -> Result<Plex> {
        let mut raw = std::ptr::null_mut();
        call!(DMPlexTransformGetDM(self.raw, &mut raw))?;
        Plex::sharing(raw, &self.context)
    }

    /// Creates the refined mesh; labels are kept. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn fine(&self) -> Result<Plex> {
        let coarse = self.coarse()?;
        let mut raw = std::ptr::null_mut();
        call!(DMPlexTransformApply(self.raw, coarse.raw, &mut raw))?;
        Ok(Plex::owning(raw, &self.context))
    }

    /// Returns the vertex of the refined mesh that a vertex, an edge or a quadrilateral of this
    /// rank becomes; `None` for a triangle.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where there is no such point.
    pub fn vertex(&self, point: Index) -> Result<Option<Index>> {
        let coarse = self.coarse()?;
        let mut kind = sys::DMPolytopeType::DM_POLYTOPE_UNKNOWN;
        call!(DMPlexGetCellType(coarse.raw, point, &mut kind))?;
        if kind == sys::DMPolytopeType::DM_POLYTOPE_TRIANGLE {
            return Ok(None);
        }
        let (to, mut vertex) = (sys::DMPolytopeType::DM_POLYTOPE_POINT, 0);
        call!(DMPlexTransformGetTargetPoint(self.raw, kind, to, point, 0, &mut vertex))?;
        Ok(Some(vertex))
    }
}
