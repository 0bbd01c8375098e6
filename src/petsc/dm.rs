//! Distributed meshes of triangles or quadrilaterals: PETSc's DMPlex.

#![allow(unsafe_code)]

use super::error::{c_string, call, get, int};
use super::handle::handle;
use super::vec::slice;
use super::{Context, Dofs, Index, IndexSet, Section, Vector, sys};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use std::ops::Range;
use std::rc::Rc;

handle! {
    /// Distributed mesh of the plane, whose cells, edges and vertices are its *points*.
    ///
    /// Each rank numbers its points from 0. Ranks share the vertices and edges between their cells;
    /// one rank owns each of them. Creating and dropping a mesh is collective.
    Plex, DM, DMDestroy
}

impl Plex {
    /// Creates a mesh from the cells of each rank. Collective.
    ///
    /// `cells` holds `corners` (3 or 4) vertex numbers per cell, counterclockwise. Vertices are
    /// numbered over all ranks, beginning with those of rank 0. `vertices` are the positions that
    /// this rank contributes: any share of them, not necessarily those of its cells.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] where the lengths do not fit; [`Error::Petsc`] where PETSc reports
    /// an error.
    pub fn from_cells(
        context: &Rc<Context>,
        corners: usize,
        cells: &[Index],
        vertices: &[[f64; 2]],
    ) -> Result<Self> {
        let total = context.comm().all_reduce_sum(vertices.len());
        let good = (3..=4).contains(&corners)
            && cells.len().is_multiple_of(corners)
            && cells.iter().all(|&v| v >= 0 && (v as usize) < total);
        if !context.comm().all_reduce_all(good) {
            return Err(Error::Mesh(format!(
                "cells of {corners} corners that are no whole number of cells or name vertices out of 0..{total}"
            )));
        }
        let [count, nodes, corners] = [int(cells.len() / corners)?, int(vertices.len())?, int(corners)?];
        let raw = get!(DMPlexCreateFromCellListParallelPetsc(
            context.raw(),
            2,
            count,
            nodes,
            int(total)?,
            corners,
            sys::truth(true),
            cells.as_ptr(),
            2,
            vertices.as_ptr().cast(),
            std::ptr::null_mut(),
            std::ptr::null_mut()
        ))?;
        Ok(Self::owning(raw, context))
    }

    /// Creates a mesh of triangles and quadrilaterals that are all on rank 0. Collective.
    ///
    /// `cells` are the vertex numbers of each cell, counterclockwise, all triangles first because
    /// PETSc's refinement requires it; `vertices` are the positions. Both are empty on other ranks.
    /// The points keep this order: cell 0 is the first of [`Plex::cells`]. [`Plex::distribute`]
    /// partitions the mesh.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] where the cells violate these rules; [`Error::Petsc`] where PETSc
    /// reports an error.
    pub fn from_first(context: &Rc<Context>, cells: &[&[usize]], vertices: &[[f64; 2]]) -> Result<Self> {
        let good = (context.rank() == 0 || cells.is_empty() && vertices.is_empty())
            && cells.iter().all(|c| (3..=4).contains(&c.len()) && c.iter().all(|&v| v < vertices.len()))
            && cells.is_sorted_by_key(|cell| cell.len());
        if !context.comm().all_reduce_all(good) {
            return Err(Error::Mesh(
                "cells that are not triangles, then quadrilaterals, of the vertices given, all on rank 0"
                    .into(),
            ));
        }
        let points = cells.len() + vertices.len();
        context.comm().all_ok(int(points))?;
        let mut sizes: Vec<Index> = cells.iter().map(|cell| cell.len() as Index).collect();
        sizes.resize(points, 0);
        let cones: Vec<Index> = cells.concat().into_iter().map(|v| (cells.len() + v) as Index).collect();
        let orientations = vec![0; cones.len()];
        let strata = [vertices.len() as Index, cells.len() as Index];
        let raw = get!(DMPlexCreate(context.raw()))?;
        let bare = Self::owning(raw, context);
        call!(DMSetDimension(raw, 2))?;
        call!(DMPlexCreateFromDAG(
            raw,
            1,
            strata.as_ptr(),
            sizes.as_ptr(),
            cones.as_ptr(),
            orientations.as_ptr(),
            vertices.as_ptr().cast()
        ))?;
        Ok(Self::owning(get!(DMPlexInterpolate(bare.raw))?, context))
    }

    /// Returns the mesh distributed without overlap: `ranks` has the rank of each cell, unless
    /// `-petscpartitioner_type` names a partitioner. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn distribute(self, ranks: &[usize]) -> Result<Self> {
        if self.context.size() == 1 {
            return Ok(self);
        }
        let partitioner = get!(DMPlexGetPartitioner(self.raw))?;
        call!(PetscPartitionerSetType(partitioner, c"shell".as_ptr()))?;
        let size = self.context.size();
        let sizes: Vec<Index> =
            (0..size).map(|rank| ranks.iter().filter(|of_cell| **of_cell == rank).count() as Index).collect();
        let mut cells: Vec<Index> = (0..ranks.len() as Index).collect();
        cells.sort_by_key(|&cell| ranks[cell as usize]);
        // PETSc copies both arrays.
        call!(PetscPartitionerShellSetPartition(partitioner, int(size)?, sizes.as_ptr(), cells.as_ptr()))?;
        call!(PetscPartitionerSetFromOptions(partitioner))?;
        let raw = get!(DMPlexDistribute(self.raw, 0, std::ptr::null_mut()))?;
        Ok(if raw.is_null() { self } else { Self::owning(raw, &self.context) })
    }

    /// Returns the range of all points of this rank.
    pub fn chart(&self) -> Range<Index> {
        // This call cannot fail: the mesh is complete.
        get!(DMPlexGetChart(self.raw; start, end)).map_or(0..0, |(start, end)| start..end)
    }

    fn height(&self, height: Index) -> Range<Index> {
        // This call cannot fail: the mesh is complete. A rank without cells has empty strata.
        get!(DMPlexGetHeightStratum(self.raw, height; start, end)).map_or(0..0, |(start, end)| start..end)
    }

    /// Returns the range of this rank's cells.
    pub fn cells(&self) -> Range<Index> {
        self.height(0)
    }

    /// Returns the range of this rank's edges, including shared ones.
    pub fn edges(&self) -> Range<Index> {
        self.height(1)
    }

    /// Returns the range of this rank's vertices, including shared ones.
    pub fn vertices(&self) -> Range<Index> {
        self.height(2)
    }

    /// Returns the boundary of a point: the edges of a cell, or the vertices of an edge.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where there is no such point.
    pub fn cone(&self, point: Index) -> Result<Vec<Index>> {
        let (length, array) =
            (get!(DMPlexGetConeSize(self.raw, point))?, get!(DMPlexGetCone(self.raw, point))?);
        // SAFETY: PETSc's array has this length.
        Ok(unsafe { slice(array, length as usize) }.to_vec())
    }

    /// Returns the points of this rank that a point bounds: the edges of a vertex, or the cells of
    /// an edge.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where there is no such point.
    pub fn support(&self, point: Index) -> Result<Vec<Index>> {
        let (length, array) =
            (get!(DMPlexGetSupportSize(self.raw, point))?, get!(DMPlexGetSupport(self.raw, point))?);
        // SAFETY: PETSc's array has this length.
        Ok(unsafe { slice(array, length as usize) }.to_vec())
    }

    /// Returns the edge between two vertices of this rank.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] where no edge joins them; [`Error::Petsc`] where PETSc reports an
    /// error.
    pub fn edge(&self, [a, b]: [Index; 2]) -> Result<Index> {
        for edge in self.support(a)? {
            if self.cone(edge)?.contains(&b) {
                return Ok(edge);
            }
        }
        Err(Error::Mesh(format!("no edge joins the points {a} and {b} of the mesh")))
    }

    /// Returns the transitive closure of a point, each entry with its orientation.
    ///
    /// For a cell these are the cell, its edges and its vertices, in this order.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where there is no such point.
    pub fn closure(&self, point: Index) -> Result<Vec<[Index; 2]>> {
        let (mut count, mut array, cone) = (0, std::ptr::null_mut(), sys::truth(true));
        call!(DMPlexGetTransitiveClosure(self.raw, point, cone, &mut count, &mut array))?;
        // SAFETY: PETSc's array has two integers per point.
        let closure =
            unsafe { slice(array.cast_const(), 2 * count as usize) }.chunks_exact(2).map(|p| [p[0], p[1]]);
        let closure = closure.collect();
        call!(DMPlexRestoreTransitiveClosure(self.raw, point, cone, &mut count, &mut array))?;
        Ok(closure)
    }

    /// Returns the vertices of a cell or an edge, in the cell's own cyclic order.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where there is no such point.
    pub fn corners(&self, point: Index) -> Result<Vec<Index>> {
        let vertices = self.vertices();
        Ok(self
            .closure(point)?
            .into_iter()
            .map(|[point, _]| point)
            .filter(|point| vertices.contains(point))
            .collect())
    }

    /// Returns the positions of this rank's vertices, in their order.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn coordinates(&self) -> Result<Vec<[f64; 2]>> {
        let vector = Vector::sharing(get!(DMGetCoordinatesLocal(self.raw))?, &self.context)?;
        let section = Section::sharing(get!(DMGetCoordinateSection(self.raw))?, &self.context)?;
        let offsets = self.vertices().map(|vertex| section.offset(vertex)).collect::<Result<Vec<_>>>()?;
        vector.with_local(|values| {
            offsets.iter().map(|&offset| [values[offset as usize], values[offset as usize + 1]]).collect()
        })
    }

    /// Returns whether this rank owns each point of its chart.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn owned(&self) -> Result<Vec<bool>> {
        let forest = get!(DMGetPointSF(self.raw))?;
        let (_, leaves, points, _) = get!(PetscSFGetGraph(forest; roots, leaves, points, remote))?;
        let mut owned = vec![true; self.chart().len()];
        if points.is_null() {
            // PETSc's null stands for the first `leaves` points.
            owned[..leaves.max(0) as usize].fill(false);
        } else {
            // SAFETY: PETSc's array has one point per leaf.
            for &point in unsafe { slice(points, leaves.max(0) as usize) } {
                owned[point as usize] = false;
            }
        }
        Ok(owned)
    }

    /// Returns the edges of this rank that bound one cell only, counted over all ranks. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn boundary_edges(&self) -> Result<Vec<Index>> {
        let edges = self.edges();
        let counter = self.with_section(&Section::new(&self.context, self.chart(), |point| Dofs {
            count: edges.contains(&point).into(),
            held: Vec::new(),
        })?)?;
        let (mut sums, mut mine) = (counter.global_vector()?, counter.local_vector()?);
        let counts =
            edges.clone().map(|edge| Ok(self.support(edge)?.len() as f64)).collect::<Result<Vec<_>>>()?;
        mine.set_local(&counts)?;
        counter.add_to_global(&mine, &mut sums)?;
        counter.to_local(&sums, &mut mine)?;
        let counts = mine.to_vec()?;
        Ok(edges.zip(counts).filter(|&(_, count)| count == 1.0).map(|(edge, _)| edge).collect())
    }

    /// Labels points of this rank with a name and a value, which refinement and distribution keep.
    ///
    /// Every rank must name the label, even without points.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn label(&mut self, name: &str, value: Index, points: &[Index]) -> Result<()> {
        let name = c_string(name)?;
        call!(DMCreateLabel(self.raw, name.as_ptr()))?;
        for &point in points {
            call!(DMSetLabelValue(self.raw, name.as_ptr(), point, value))?;
        }
        Ok(())
    }

    /// Returns the points of this rank with a given label and value.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn labelled(&self, name: &str, value: Index) -> Result<Vec<Index>> {
        let raw = get!(DMGetStratumIS(self.raw, c_string(name)?.as_ptr(), value))?;
        if raw.is_null() {
            return Ok(Vec::new());
        }
        IndexSet::owning(raw, &self.context).to_vec()
    }

    /// Returns a clone of the mesh with the dof layout of a section. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn with_section(&self, section: &Section) -> Result<Self> {
        let raw = get!(DMClone(self.raw))?;
        let mesh = Self::owning(raw, &self.context);
        call!(DMSetLocalSection(raw, section.raw))?;
        Ok(mesh)
    }

    /// Creates a global vector of zeros: the free dofs of the points that each rank owns.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the mesh has no section.
    pub fn global_vector(&self) -> Result<Vector> {
        Vector::owning(get!(DMCreateGlobalVector(self.raw))?, &self.context).zeroed()
    }

    /// Creates a local vector of zeros: all dofs of this rank's points.
    ///
    /// Constrained and shared dofs are included.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the mesh has no section.
    pub fn local_vector(&self) -> Result<Vector> {
        Vector::owning(get!(DMCreateLocalVector(self.raw))?, &self.context).zeroed()
    }

    /// Copies a global vector into a local one, whose constrained dofs keep their values.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn to_local(&self, global: &Vector, local: &mut Vector) -> Result<()> {
        call!(DMGlobalToLocal(self.raw, global.raw, sys::InsertMode::INSERT_VALUES, local.raw))
    }

    /// Adds the local vectors of all ranks into a global one, without constrained dofs. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn add_to_global(&self, local: &Vector, global: &mut Vector) -> Result<()> {
        call!(DMLocalToGlobal(self.raw, local.raw, sys::InsertMode::ADD_VALUES, global.raw))
    }

    /// Returns the global position of each local dof; negative for a constrained dof. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the mesh has no section.
    pub fn global_dofs(&self) -> Result<Vec<Index>> {
        let map = get!(DMGetLocalToGlobalMapping(self.raw))?;
        let length = get!(ISLocalToGlobalMappingGetSize(map))?;
        let mut array = get!(ISLocalToGlobalMappingGetIndices(map))?;
        // SAFETY: PETSc's array has this length.
        let dofs = unsafe { slice(array, length as usize) }.to_vec();
        call!(ISLocalToGlobalMappingRestoreIndices(map, &mut array))?;
        Ok(dofs)
    }
}
