//! Distributed meshes of triangles or quadrilaterals: PETSc's DMPlex.

use super::error::{c_string, call, int};
use super::handle::handle;
use super::vec::slice;
use super::{Comm, Context, Dofs, Index, IndexSet, Section, Vector, sys};
use crate::error::{Error, Result};
use std::ops::Range;
use std::rc::Rc;

handle! {
    /// A plane mesh over all ranks: cells, edges and vertices are its *points*, numbered on each rank from 0.
    ///
    /// Ranks share the vertices and edges between their cells; one of them owns each. Creating and dropping it is collective.
    Plex, DM, DMDestroy
}

impl Plex {
    /// A mesh from its cells, each rank with its own.
    ///
    /// `cells` holds `corners` (3 or 4) vertex numbers a cell, counterclockwise; vertices are numbered over all ranks, first those of rank 0.
    /// `vertices` are the positions of this rank's vertices: any share of them, not those of its cells. Collective.
    ///
    /// # Errors
    /// [`Error::Mesh`] where the lengths do not fit, [`Error::Petsc`] else.
    pub fn from_cells(
        context: &Rc<Context>,
        corners: usize,
        cells: &[Index],
        vertices: &[[f64; 2]],
    ) -> Result<Self> {
        let all = context.sum_count(vertices.len());
        let good = (3..=4).contains(&corners)
            && cells.len().is_multiple_of(corners)
            && cells.iter().all(|&v| v >= 0 && (v as usize) < all);
        if !context.all(good) {
            return Err(Error::Mesh(format!(
                "cells of {corners} corners that are no whole number of cells or name vertices out of 0..{all}"
            )));
        }
        let [count, own, corners] = [int(cells.len() / corners)?, int(vertices.len())?, int(corners)?];
        let (mut raw, null) = (std::ptr::null_mut(), std::ptr::null_mut());
        call!(DMPlexCreateFromCellListParallelPetsc(
            context.raw(Comm::World),
            2,
            count,
            own,
            int(all)?,
            corners,
            sys::truth(true),
            cells.as_ptr(),
            2,
            vertices.as_ptr().cast(),
            null,
            std::ptr::null_mut(),
            &mut raw
        ))?;
        Ok(Self::owning(raw, context))
    }

    /// A mesh whose cells are all on rank 0, triangles and quadrilaterals alike; [`Plex::distribute`] shares them out.
    ///
    /// `cells` are the vertex numbers of each, counterclockwise, all triangles first as PETSc's refinement asks, and
    /// `vertices` the positions; both empty on other ranks. Points keep this order: cell 0 is the first of [`Plex::cells`].
    /// Collective.
    ///
    /// # Errors
    /// [`Error::Mesh`] where the cells are not so, [`Error::Petsc`] else.
    pub fn from_first(context: &Rc<Context>, cells: &[&[usize]], vertices: &[[f64; 2]]) -> Result<Self> {
        let good = (context.rank() == 0 || cells.is_empty() && vertices.is_empty())
            && cells.iter().all(|c| (3..=4).contains(&c.len()) && c.iter().all(|&v| v < vertices.len()))
            && cells.is_sorted_by_key(|cell| cell.len());
        if !context.all(good) {
            return Err(Error::Mesh(
                "cells that are not triangles, then quadrilaterals, of the vertices given, all on rank 0"
                    .into(),
            ));
        }
        let points = cells.len() + vertices.len();
        context.together(int(points))?;
        let mut sizes: Vec<Index> = cells.iter().map(|cell| cell.len() as Index).collect();
        sizes.resize(points, 0);
        let cones: Vec<Index> = cells.concat().into_iter().map(|v| (cells.len() + v) as Index).collect();
        let orientations = vec![0; cones.len()];
        let strata = [vertices.len() as Index, cells.len() as Index];
        let mut raw = std::ptr::null_mut();
        call!(DMPlexCreate(context.raw(Comm::World), &mut raw))?;
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
        let mut raw = std::ptr::null_mut();
        call!(DMPlexInterpolate(bare.raw, &mut raw))?;
        Ok(Self::owning(raw, context))
    }

    /// The same mesh with its cells shared out evenly, so that ranks share few edges: PTScotch's partition unless
    /// `-petscpartitioner_type` says otherwise. Each cell is on one rank. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn distribute(self) -> Result<Self> {
        if self.context.size() == 1 {
            return Ok(self);
        }
        let mut partitioner = std::ptr::null_mut();
        call!(DMPlexGetPartitioner(self.raw, &mut partitioner))?;
        call!(PetscPartitionerSetType(partitioner, c"ptscotch".as_ptr()))?;
        call!(PetscPartitionerSetFromOptions(partitioner))?;
        let mut raw = std::ptr::null_mut();
        call!(DMPlexDistribute(self.raw, 0, std::ptr::null_mut(), &mut raw))?;
        Ok(if raw.is_null() { self } else { Self::owning(raw, &self.context) })
    }

    /// The mesh with every cell cut into four; labels go with it. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn refine(self) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(DMPlexSetRefinementUniform(self.raw, sys::truth(true)))?;
        call!(DMRefine(self.raw, self.context.raw(Comm::World), &mut raw))?;
        Ok(Self::owning(raw, &self.context))
    }

    /// All points of this rank.
    pub fn chart(&self) -> Range<Index> {
        let (mut start, mut end) = (0, 0);
        // It cannot fail: the mesh is complete.
        let _ = call!(DMPlexGetChart(self.raw, &mut start, &mut end));
        start..end
    }

    fn height(&self, height: Index) -> Range<Index> {
        let (mut start, mut end) = (0, 0);
        // It cannot fail: the mesh is complete. A rank without cells has no strata.
        let _ = call!(DMPlexGetHeightStratum(self.raw, height, &mut start, &mut end));
        start..end
    }

    /// This rank's cells.
    pub fn cells(&self) -> Range<Index> {
        self.height(0)
    }

    /// This rank's edges, shared ones among them.
    pub fn edges(&self) -> Range<Index> {
        self.height(1)
    }

    /// This rank's vertices, shared ones among them.
    pub fn vertices(&self) -> Range<Index> {
        self.height(2)
    }

    /// What bounds a point: the edges of a cell, the vertices of an edge.
    ///
    /// # Errors
    /// [`Error::Petsc`] where there is no such point.
    pub fn cone(&self, point: Index) -> Result<Vec<Index>> {
        let (mut length, mut array) = (0, std::ptr::null());
        call!(DMPlexGetConeSize(self.raw, point, &mut length))?;
        call!(DMPlexGetCone(self.raw, point, &mut array))?;
        // SAFETY: PETSc's array has this length.
        Ok(unsafe { slice(array, length as usize) }.to_vec())
    }

    /// What a point bounds on this rank: the edges of a vertex, the cells of an edge.
    ///
    /// # Errors
    /// [`Error::Petsc`] where there is no such point.
    pub fn support(&self, point: Index) -> Result<Vec<Index>> {
        let (mut length, mut array) = (0, std::ptr::null());
        call!(DMPlexGetSupportSize(self.raw, point, &mut length))?;
        call!(DMPlexGetSupport(self.raw, point, &mut array))?;
        // SAFETY: PETSc's array has this length.
        Ok(unsafe { slice(array, length as usize) }.to_vec())
    }

    /// The edge between two vertices of this rank.
    ///
    /// # Errors
    /// [`Error::Mesh`] where there is none, [`Error::Petsc`] else.
    pub fn edge(&self, [a, b]: [Index; 2]) -> Result<Index> {
        for edge in self.support(a)? {
            if self.cone(edge)?.contains(&b) {
                return Ok(edge);
            }
        }
        Err(Error::Mesh(format!("no edge joins the points {a} and {b} of the mesh")))
    }

    /// A point with all that bounds it, each with its orientation; a cell, its edges, its vertices in turn.
    ///
    /// # Errors
    /// [`Error::Petsc`] where there is no such point.
    pub fn closure(&self, point: Index) -> Result<Vec<[Index; 2]>> {
        let (mut count, mut array, cone) = (0, std::ptr::null_mut(), sys::truth(true));
        call!(DMPlexGetTransitiveClosure(self.raw, point, cone, &mut count, &mut array))?;
        // SAFETY: PETSc's array has two integers a point.
        let closure =
            unsafe { slice(array.cast_const(), 2 * count as usize) }.chunks_exact(2).map(|p| [p[0], p[1]]);
        let closure = closure.collect();
        call!(DMPlexRestoreTransitiveClosure(self.raw, point, cone, &mut count, &mut array))?;
        Ok(closure)
    }

    /// The vertices of a cell or an edge, in the cell's own order round it.
    ///
    /// # Errors
    /// [`Error::Petsc`] where there is no such point.
    pub fn corners(&self, point: Index) -> Result<Vec<Index>> {
        let vertices = self.vertices();
        Ok(self
            .closure(point)?
            .into_iter()
            .map(|[point, _]| point)
            .filter(|point| vertices.contains(point))
            .collect())
    }

    /// Positions of this rank's vertices, in their order.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn coordinates(&self) -> Result<Vec<[f64; 2]>> {
        let (mut vector, mut section) = (std::ptr::null_mut(), std::ptr::null_mut());
        call!(DMGetCoordinatesLocal(self.raw, &mut vector))?;
        call!(DMGetCoordinateSection(self.raw, &mut section))?;
        let vector = Vector::sharing(vector, &self.context)?;
        let section = Section::sharing(section, &self.context)?;
        let offsets = self.vertices().map(|vertex| section.offset(vertex)).collect::<Result<Vec<_>>>()?;
        vector.with_local(|values| {
            offsets.iter().map(|&at| [values[at as usize], values[at as usize + 1]]).collect()
        })
    }

    /// Whether this rank owns each point of its chart.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn owned(&self) -> Result<Vec<bool>> {
        let mut forest = std::ptr::null_mut();
        call!(DMGetPointSF(self.raw, &mut forest))?;
        let (mut roots, mut leaves, mut points, mut remote) = (0, 0, std::ptr::null(), std::ptr::null());
        call!(PetscSFGetGraph(forest, &mut roots, &mut leaves, &mut points, &mut remote))?;
        let mut owned = vec![true; self.chart().len()];
        if points.is_null() {
            // PETSc's shorthand for the first points.
            owned[..leaves.max(0) as usize].fill(false);
        } else {
            // SAFETY: PETSc's array has one point a leaf.
            for &point in unsafe { slice(points, leaves.max(0) as usize) } {
                owned[point as usize] = false;
            }
        }
        Ok(owned)
    }

    /// Edges of this rank with one cell over all ranks. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn boundary_edges(&self) -> Result<Vec<Index>> {
        let edges = self.edges();
        let counter =
            self.with_section(&Section::new(&self.context, Comm::World, self.chart(), |point| Dofs {
                count: edges.contains(&point).into(),
                held: Vec::new(),
            })?)?;
        let (mut all, mut mine) = (counter.global_vector()?, counter.local_vector()?);
        let counts =
            edges.clone().map(|edge| Ok(self.support(edge)?.len() as f64)).collect::<Result<Vec<_>>>()?;
        mine.set_local(&counts)?;
        counter.add_to_global(&mine, &mut all)?;
        counter.to_local(&all, &mut mine)?;
        let counts = mine.to_vec()?;
        Ok(edges.zip(counts).filter(|&(_, count)| count == 1.0).map(|(edge, _)| edge).collect())
    }

    /// Gives points of this rank a value under a name; refinement and distribution keep it. Every rank must name the label.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn label(&mut self, name: &str, value: Index, points: &[Index]) -> Result<()> {
        let name = c_string(name)?;
        call!(DMCreateLabel(self.raw, name.as_ptr()))?;
        for &point in points {
            call!(DMSetLabelValue(self.raw, name.as_ptr(), point, value))?;
        }
        Ok(())
    }

    /// This rank's points of a value under a name.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn labelled(&self, name: &str, value: Index) -> Result<Vec<Index>> {
        let (name, mut raw) = (c_string(name)?, std::ptr::null_mut());
        call!(DMGetStratumIS(self.raw, name.as_ptr(), value, &mut raw))?;
        if raw.is_null() {
            return Ok(Vec::new());
        }
        IndexSet::owning(raw, &self.context).to_vec()
    }

    /// The same mesh, whose vectors have the dofs of a section. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn with_section(&self, section: &Section) -> Result<Self> {
        let mut raw = std::ptr::null_mut();
        call!(DMClone(self.raw, &mut raw))?;
        let mesh = Self::owning(raw, &self.context);
        call!(DMSetLocalSection(raw, section.raw))?;
        Ok(mesh)
    }

    /// Where each point's dofs are in global vectors; see [`Section::offset`]. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn global_section(&self) -> Result<Section> {
        let mut raw = std::ptr::null_mut();
        call!(DMGetGlobalSection(self.raw, &mut raw))?;
        Section::sharing(raw, &self.context)
    }

    /// A vector of zeros with the free dofs of the points that each rank owns. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the mesh has no section.
    pub fn global_vector(&self) -> Result<Vector> {
        let mut raw = std::ptr::null_mut();
        call!(DMCreateGlobalVector(self.raw, &mut raw))?;
        let mut vector = Vector::owning(raw, &self.context);
        vector.fill(0.0)?;
        Ok(vector)
    }

    /// A vector of this rank alone: zeros for all dofs of all its points, held and shared ones among them.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the mesh has no section.
    pub fn local_vector(&self) -> Result<Vector> {
        let mut raw = std::ptr::null_mut();
        call!(DMCreateLocalVector(self.raw, &mut raw))?;
        let mut vector = Vector::owning(raw, &self.context);
        vector.fill(0.0)?;
        Ok(vector)
    }

    /// Copies a global vector to a local one; held dofs of the local one stay as they are. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn to_local(&self, global: &Vector, local: &mut Vector) -> Result<()> {
        call!(DMGlobalToLocal(self.raw, global.raw, sys::InsertMode::INSERT_VALUES, local.raw))
    }

    /// Adds a local vector to a global one, the shares of all ranks; held dofs go nowhere. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn add_to_global(&self, local: &Vector, global: &mut Vector) -> Result<()> {
        call!(DMLocalToGlobal(self.raw, local.raw, sys::InsertMode::ADD_VALUES, global.raw))
    }

    /// Position in global vectors of each dof of this rank's local vectors; negative for a held one. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`] where the mesh has no section.
    pub fn global_dofs(&self) -> Result<Vec<Index>> {
        let (mut map, mut length, mut array) = (std::ptr::null_mut(), 0, std::ptr::null());
        call!(DMGetLocalToGlobalMapping(self.raw, &mut map))?;
        call!(ISLocalToGlobalMappingGetSize(map, &mut length))?;
        call!(ISLocalToGlobalMappingGetIndices(map, &mut array))?;
        // SAFETY: PETSc's array has this length.
        let dofs = unsafe { slice(array, length as usize) }.to_vec();
        call!(ISLocalToGlobalMappingRestoreIndices(map, &mut array))?;
        Ok(dofs)
    }

    /// Prints the mesh. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`].
    pub fn view(&self) -> Result<()> {
        call!(DMView(self.raw, std::ptr::null_mut()))
    }
}
