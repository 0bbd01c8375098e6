//! Mesh of a plate over all ranks: partitioned, then refined in parallel.

use super::hierarchy::{Hierarchy, Level};
use super::own_mesh::{EDGE, GROUP, Names, POINT, own_mesh, section, sum_at_nodes};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, Place, Support};
use crate::error::{Error, Result};
use crate::mesh::{Cell, Grid, Mesh, Point};
use crate::petsc::{Context, Index, Plex, Refinement, WorldComm};
use std::rc::Rc;

/// Option of PETSc that names a partitioner in place of our own bisection.
const PARTITIONER: &str = "petscpartitioner_type";

/// Names of the sides of a grid.
const SIDES: [&str; 4] = ["left", "right", "bottom", "top"];

/// Part of a plate on this rank: its cells and their nodes, some of them shared with other ranks.
pub struct Part {
    /// Distributed mesh with three dofs per vertex and one per tip of a stop there; constrained
    /// dofs are not in global vectors.
    pub plex: Rc<Plex>,
    /// Mesh of this rank's cells and their nodes, with all names of the whole mesh.
    ///
    /// A named edge or node is only on the rank that owns it, so that sums over all ranks count it
    /// once.
    pub mesh: Mesh,
    /// Local dofs: the extra ones, then the nodes' dofs, each with its tips of compliant stops.
    ///
    /// Constrained dofs are zero.
    pub space: DofMap,
    /// Constraints of this rank's nodes.
    pub holds: Vec<NodeConstraint>,
    /// Whether this rank owns each node.
    pub owns: Vec<bool>,
    /// Local index of each extra dof, on the one rank that has it.
    pub extra: Vec<Option<usize>>,
    /// Meshes that the refinement has passed, coarsest first, where they are kept.
    pub(super) passed: Rc<Vec<(Plex, Refinement)>>,
    /// Interpolation from these meshes, where they are kept.
    pub hierarchy: Option<Rc<Hierarchy>>,
}

/// Uniform refinements of a mesh after it is partitioned.
#[derive(Debug, Clone, Copy)]
pub struct Refinements {
    /// Number of refinements, each of which cuts every cell into four.
    pub count: u32,
    /// Whether the meshes before them are kept as the coarse levels of multigrid.
    pub keep: bool,
}

impl From<u32> for Refinements {
    /// Refines a number of times, without keeping the meshes in between.
    fn from(count: u32) -> Refinements {
        Refinements { count, keep: false }
    }
}

/// Function that returns the nodes of this rank that have a tip of a compliant stop, once per tip,
/// given the constraints of the nodes and the sum of all ranks at each node. Collective.
pub type Tips<'s> =
    dyn Fn(&Mesh, &[NodeConstraint], &dyn Fn(&[f64]) -> Result<Vec<f64>>) -> Result<Vec<usize>> + 's;

/// Function that locates the supports on this rank's part of a mesh. Collective.
pub type Supports<'s> = dyn Fn(&Mesh) -> Result<Vec<(Place, Support)>> + 's;

impl Part {
    /// Creates a grid, partitioned, refined and supported; no rank ever holds all of it.
    /// Collective.
    ///
    /// Each point of `extra`, named for messages, gets an extra dof in its cell, and each node that
    /// `tips` returns one more dof.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error, the error of `supports`, and
    /// [`Error::Mesh`] for a point outside the plate.
    pub fn new(
        context: &Rc<Context>,
        grid: &Grid,
        refinements: impl Into<Refinements>,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        let mut plex = share(context, grid)?;
        if context.has_option(PARTITIONER)? {
            let here = vec![context.rank(); plex.cells().len()];
            plex = plex.distribute(&here)?;
        }
        for (value, points) in (1..).zip(&sides(&plex, grid)?) {
            plex.label(EDGE, value, points)?;
        }
        let edges = SIDES.map(String::from).to_vec();
        let names = Names { edges, elements: grid.kind.into(), ..Names::default() };
        Part::build(plex, &names, refinements.into(), supports, extra, tips)
    }

    /// Works as [`Part::new`] for a valid mesh that only rank 0 reads. Collective.
    ///
    /// # Errors
    /// Returns the error of `read` or an error of [`Part::new`]; all ranks get the same.
    pub fn of_mesh(
        context: &Rc<Context>,
        read: impl FnOnce() -> Result<Mesh>,
        refinements: impl Into<Refinements>,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        let whole = context.comm().all_ok(if context.rank() == 0 { read() } else { Ok(Mesh::default()) })?;
        let names = context.comm().broadcast_value(&Names::of(&whole))?;
        let plex = named(context, &whole, &names)?.distribute(&ranks(&whole, context.size()))?;
        drop(whole);
        Part::build(plex, &names, refinements.into(), supports, extra, tips)
    }

    /// Partitions, refines and supports a mesh.
    fn build(
        mut plex: Plex,
        names: &Names,
        refinements: Refinements,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        let mut passed = Vec::new();
        for _ in 0..refinements.count {
            let refinement = Refinement::new(&plex)?;
            let coarse = std::mem::replace(&mut plex, refinement.fine()?);
            if refinements.keep {
                passed.push((coarse, refinement));
            }
        }
        let context = plex.context().clone();
        let start = plex.chart().start;
        let owned = plex.owned()?;
        let owns = |point: Index| owned[(point - start) as usize];
        let mesh = own_mesh(&plex, names, owns)?;
        let places = context.comm().all_ok(supports(&mesh))?;
        let mut holds = DofMap::holds(&mesh, &places);
        let sums = |nodal: &[f64]| sum_at_nodes(&plex, nodal);
        NodeConstraint::add_up(&mut holds, sums)?;
        let tips = tips.map_or(Ok(Vec::new()), |tips| tips(&mesh, &holds, &sums));
        let tips = context.comm().all_ok(tips)?;
        let mut tips_at = vec![0; holds.len()];
        tips.iter().for_each(|&node| tips_at[node] += 1);
        let mine = extra_cells(context.comm(), &mesh, extra)?;
        let mut extra = vec![None; extra.len()];
        mine.iter().enumerate().for_each(|(dof, (_, number))| extra[*number] = Some(dof));
        let extra_cells: Vec<usize> = mine.iter().map(|(cell, _)| *cell).collect();
        let section = section(&plex, &holds, &extra_cells, &tips_at)?;
        let space = DofMap::of_all(&holds, mine.len(), &tips);
        let owns: Vec<bool> = plex.vertices().map(owns).collect();
        let plex = Rc::new(plex.with_section(&section)?);
        let hierarchy = if refinements.keep {
            let finest = Level {
                plex: plex.clone(),
                mesh: &mesh,
                space: &space,
                holds: &holds,
                owns: &owns,
                extra_cells: &extra_cells,
            };
            Some(Rc::new(Hierarchy::new(context.comm(), &passed, &finest)?))
        } else {
            None
        };
        Ok(Part { plex, mesh, space, holds, owns, extra, passed: passed.into(), hierarchy })
    }
}

/// Returns the cells of this rank with an extra dof, ascending, and the number of its point.
/// Collective.
fn extra_cells(comm: &WorldComm, mesh: &Mesh, points: &[(String, Point)]) -> Result<Vec<(usize, usize)>> {
    let mut mine = Vec::new();
    for (number, (name, point)) in points.iter().enumerate() {
        mine.extend(mesh.locate_once(comm, name, *point)?.map(|cell| (cell, number)));
    }
    mine.sort_unstable();
    Ok(mine)
}

/// Creates the grid's cells, a block of them on each rank.
fn share(context: &Rc<Context>, grid: &Grid) -> Result<Plex> {
    let (rank, size) = (context.rank(), context.size());
    let mine = |count: usize| count * rank / size..count * (rank + 1) / size;
    let [columns, rows] = grid.blocks(size).swap_remove(rank);
    let rectangles = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
    let [length, _] = grid.cells;
    let cells: Vec<Cell> = rectangles.flat_map(|(column, row)| grid.cells(row * length + column)).collect();
    let corners = grid.cells(0).next().map_or(0, |cell| cell.nodes().len());
    let nodes: Vec<Index> = cells.iter().flat_map(|cell| cell.nodes().to_vec()).map(|n| n as Index).collect();
    let vertices: Vec<[f64; 2]> = mine(grid.nodes()).map(|number| grid.node(number).into()).collect();
    Plex::from_cells(context, corners, &nodes, &vertices)
}

/// Returns this rank's edges on each side of the plate, in the order of [`SIDES`].
fn sides(plex: &Plex, grid: &Grid) -> Result<[Vec<Index>; 4]> {
    let positions = plex.coordinates()?;
    let start = plex.vertices().start;
    let end = grid.node(grid.nodes() - 1);
    let mut sides: [Vec<Index>; 4] = Default::default();
    for edge in plex.boundary_edges()? {
        let ends: Vec<[f64; 2]> =
            plex.cone(edge)?.into_iter().map(|vertex| positions[(vertex - start) as usize]).collect();
        let on = |axis: usize, value: f64| ends.iter().all(|position| position[axis] == value);
        let side = [on(0, 0.0), on(0, end.x), on(1, 0.0), on(1, end.y)].into_iter().position(|on| on);
        let side =
            side.ok_or_else(|| Error::Mesh(format!("an edge at {ends:?} bounds no side of the plate")))?;
        sides[side].push(edge);
    }
    Ok(sides)
}

/// Returns the cells of a mesh in the order that PETSc requires, triangles first.
fn triangles_first(mesh: &Mesh) -> Vec<usize> {
    let mut order: Vec<usize> = (0..mesh.cells.len()).collect();
    order.sort_by_key(|&cell| mesh.cells[cell].nodes().len());
    order
}

/// Returns the rank of each cell of a mesh, triangles first.
fn ranks(mesh: &Mesh, size: usize) -> Vec<usize> {
    let part_of = mesh.bisect(size);
    triangles_first(mesh).into_iter().map(|cell| part_of[cell]).collect()
}

/// Creates a labelled mesh that is complete on rank 0 and empty elsewhere.
fn named(context: &Rc<Context>, whole: &Mesh, names: &Names) -> Result<Plex> {
    let order = triangles_first(whole);
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(number, &cell)| place[cell] = number as Index);
    let cells: Vec<&[usize]> = order.iter().map(|&cell| whole.cells[cell].nodes()).collect();
    let positions: Vec<[f64; 2]> = whole.nodes.iter().map(|&node| node.into()).collect();
    let mut plex = Plex::from_first(context, &cells, &positions)?;
    let (first_cell, first_vertex) = (plex.cells().start, plex.vertices().start);
    let cell = |number: &usize| first_cell + place[*number];
    let vertex = |node: &usize| first_vertex + *node as Index;
    for (value, name) in (1..).zip(&names.edges) {
        let edges = whole.edges.get(name).into_iter().flatten();
        let points = edges.map(|[a, b]| plex.edge([vertex(a), vertex(b)])).collect::<Result<Vec<_>>>();
        plex.label(EDGE, value, &context.comm().all_ok(points)?)?;
    }
    for (value, name) in (1..).zip(&names.groups) {
        let points: Vec<Index> = whole.groups.get(name).into_iter().flatten().map(cell).collect();
        plex.label(GROUP, value, &points)?;
    }
    for (value, name) in (1..).zip(&names.points) {
        let points: Vec<Index> = whole.points.get(name).into_iter().flatten().map(vertex).collect();
        plex.label(POINT, value, &points)?;
    }
    Ok(plex)
}
