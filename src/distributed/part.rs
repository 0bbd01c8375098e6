//! Mesh of a plate over all ranks: partitioned, then refined in parallel.

use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE, Place, Support};
use crate::element::ElementByShape;
use crate::error::{Error, Result};
use crate::mesh::{Cell, Grid, Mesh, Point};
use crate::petsc::{Comm, Context, Dofs, Index, Plex, Section, WorldComm};
use std::ops::Range;
use std::rc::Rc;

/// Labels of named edges, groups and points; the value is the number of the name, from 1.
const EDGE: &str = "edge";
const GROUP: &str = "group";
const POINT: &str = "point";

/// Names of the sides of a grid.
const SIDES: [&str; 4] = ["left", "right", "bottom", "top"];

/// Names of a mesh, in the order of their label values, and the elements of its cells.
#[derive(Default, serde::Serialize, serde::Deserialize)]
struct Names {
    edges: Vec<String>,
    groups: Vec<String>,
    points: Vec<String>,
    elements: ElementByShape,
}

impl Names {
    fn of(mesh: &Mesh) -> Names {
        Names {
            edges: mesh.edges.keys().cloned().collect(),
            groups: mesh.groups.keys().cloned().collect(),
            points: mesh.points.keys().cloned().collect(),
            elements: mesh.elements,
        }
    }
}

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
    /// Local dofs: after the extra dofs those of the nodes, each with its tips of compliant stops.
    ///
    /// Constrained dofs are zero.
    pub space: DofMap,
    /// Constraints of this rank's nodes.
    pub holds: Vec<NodeConstraint>,
    /// Whether this rank owns each node.
    pub owns: Vec<bool>,
    /// Local index of each extra dof, on the one rank that has it.
    pub extra: Vec<Option<usize>>,
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
        refinements: u32,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        let mut plex = share(context, grid)?;
        for (value, points) in (1..).zip(&sides(&plex, grid)?) {
            plex.label(EDGE, value, points)?;
        }
        let edges = SIDES.map(String::from).to_vec();
        let names = Names { edges, elements: grid.element().into(), ..Names::default() };
        Part::build(plex, &names, refinements, supports, extra, tips)
    }

    /// Works as [`Part::new`] for a valid mesh that only rank 0 reads. Collective.
    ///
    /// # Errors
    /// Returns the error of `read`, or those of [`Part::new`]; all ranks get the same.
    pub fn of_mesh(
        context: &Rc<Context>,
        read: impl FnOnce() -> Result<Mesh>,
        refinements: u32,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        let whole = context.comm().all_ok(if context.rank() == 0 { read() } else { Ok(Mesh::default()) })?;
        let names = context.comm().broadcast_value(&Names::of(&whole))?;
        let plex = named(context, &whole, &names)?;
        drop(whole);
        Part::build(plex, &names, refinements, supports, extra, tips)
    }

    /// Partitions, refines and supports a mesh.
    fn build(
        mut plex: Plex,
        names: &Names,
        refinements: u32,
        supports: &Supports,
        extra: &[(String, Point)],
        tips: Option<&Tips>,
    ) -> Result<Part> {
        plex = plex.distribute()?;
        for _ in 0..refinements {
            plex = plex.refine()?;
        }
        let context = plex.context().clone();
        let start = plex.chart().start;
        let owned = plex.owned()?;
        let owns = |point: Index| owned[(point - start) as usize];
        let mesh = own_mesh(&plex, names, owns)?;
        let places = context.comm().all_ok(supports(&mesh))?;
        let holds = spread_holds(&plex, &DofMap::holds(&mesh, &places))?;
        let sums = |of_nodes: &[f64]| sum_at_nodes(&plex, of_nodes);
        let tips = tips.map_or(Ok(Vec::new()), |tips| tips(&mesh, &holds, &sums));
        let tips = context.comm().all_ok(tips)?;
        let mut tips_at = vec![0; holds.len()];
        tips.iter().for_each(|&node| tips_at[node] += 1);
        let (cells, vertices) = (plex.cells(), plex.vertices());
        let mine = extra_cells(context.comm(), &mesh, extra)?;
        let mut extra = vec![None; extra.len()];
        mine.iter().enumerate().for_each(|(at, (_, number))| extra[*number] = Some(at));
        // Cells come before vertices, and so do their dofs.
        let section = Section::new(&context, Comm::World, plex.chart(), |point| {
            if cells.contains(&point) {
                let cell = (point - cells.start) as usize;
                return Dofs { count: mine.iter().filter(|(of, _)| *of == cell).count(), held: Vec::new() };
            }
            if !vertices.contains(&point) {
                return Dofs::default();
            }
            let node = (point - vertices.start) as usize;
            let held = DofMap::held(&holds[node]);
            Dofs {
                count: PER_NODE + tips_at[node],
                held: (0..PER_NODE).filter(|k| held[*k]).map(|k| k as Index).collect(),
            }
        })?;
        let space = DofMap::of_all(&holds, mine.len(), &tips);
        let owns = vertices.map(owns).collect();
        Ok(Part { plex: Rc::new(plex.with_section(&section)?), mesh, space, holds, owns, extra })
    }
}

/// Returns the cells of this rank with an extra dof, ascending, and the number of its point.
/// Collective.
fn extra_cells(comm: &WorldComm, mesh: &Mesh, points: &[(String, Point)]) -> Result<Vec<(usize, usize)>> {
    let mut mine = Vec::new();
    for (number, (name, point)) in points.iter().enumerate() {
        let cell = mesh.locate(*point);
        match comm.all_gather_one(cell.is_some()).iter().position(|&here| here) {
            Some(first) => mine.extend(cell.filter(|_| first == comm.rank()).map(|cell| (cell, number))),
            None => {
                let Point { coords } = point;
                return Err(Error::Mesh(format!(
                    "{name}: the point ({}, {}) lies outside the plate",
                    coords.x, coords.y
                )));
            }
        }
    }
    mine.sort_unstable();
    Ok(mine)
}

/// Creates the grid's cells, equally many per rank.
fn share(context: &Rc<Context>, grid: &Grid) -> Result<Plex> {
    let mine = |count: usize| {
        let (rank, size) = (context.rank(), context.size());
        count * rank / size..count * (rank + 1) / size
    };
    let cells: Vec<Cell> = mine(grid.rectangles()).flat_map(|rectangle| grid.cells(rectangle)).collect();
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

/// Creates a labelled mesh that is complete on rank 0 and empty elsewhere.
fn named(context: &Rc<Context>, whole: &Mesh, names: &Names) -> Result<Plex> {
    let mut order: Vec<usize> = (0..whole.cells.len()).collect();
    order.sort_by_key(|&cell| whole.cells[cell].nodes().len());
    let mut place = vec![0; order.len()];
    order.iter().enumerate().for_each(|(at, &cell)| place[cell] = at as Index);
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

/// Returns the cells of this rank as a mesh.
///
/// A named edge, cell or node is only on the rank that owns it, so that sums over all ranks count
/// it once.
fn own_mesh(plex: &Plex, names: &Names, owns: impl Fn(Index) -> bool) -> Result<Mesh> {
    let (cells, edges, vertices) = (plex.cells(), plex.edges(), plex.vertices());
    let number = |vertex: Index| (vertex - vertices.start) as usize;
    let nodes = plex.coordinates()?.into_iter().map(Point::from).collect();
    let mut mesh = Mesh { nodes, elements: names.elements, ..Mesh::default() };
    for cell in cells.clone() {
        let corners: Vec<usize> = plex.corners(cell)?.into_iter().map(number).collect();
        mesh.cells.push(match corners[..] {
            [a, b, c] => Cell::Triangle([a, b, c]),
            [a, b, c, d] => Cell::Quadrilateral([a, b, c, d]),
            _ => return Err(Error::Mesh(format!("a cell of {} corners", corners.len()))),
        });
        let last = mesh.cells.len() - 1;
        if mesh.area(last) < 0.0 {
            mesh.cells[last] = match mesh.cells[last] {
                Cell::Triangle([a, b, c]) => Cell::Triangle([a, c, b]),
                Cell::Quadrilateral([a, b, c, d]) => Cell::Quadrilateral([a, d, c, b]),
            };
        }
    }
    let labelled = |label: &str, value: Index, kind: &Range<Index>| -> Result<Vec<Index>> {
        let points = plex.labelled(label, value)?.into_iter();
        Ok(points.filter(|&point| kind.contains(&point) && owns(point)).collect())
    };
    for (value, name) in (1..).zip(&names.edges) {
        let sides = labelled(EDGE, value, &edges)?.into_iter().map(|edge| {
            let ends = plex.cone(edge)?;
            let [a, b] = [number(ends[0]), number(ends[1])];
            // The cell lies on the left, as along the boundary of the whole mesh.
            let left = &mesh.cells[(plex.support(edge)?[0] - cells.start) as usize];
            Ok(if left.edges().any(|side| side == [a, b]) { [a, b] } else { [b, a] })
        });
        let sides = sides.collect::<Result<_>>()?;
        mesh.edges.insert(name.clone(), sides);
    }
    for (value, name) in (1..).zip(&names.groups) {
        let members = labelled(GROUP, value, &cells)?;
        mesh.groups.insert(name.clone(), members.iter().map(|cell| (cell - cells.start) as usize).collect());
    }
    for (value, name) in (1..).zip(&names.points) {
        let members = labelled(POINT, value, &vertices)?;
        mesh.points.insert(name.clone(), members.into_iter().map(number).collect());
    }
    Ok(mesh)
}

/// Sums the constraints of all ranks at each node.
///
/// An edge's support must also reach ranks that have only a vertex of that edge.
fn spread_holds(plex: &Plex, own: &[NodeConstraint]) -> Result<Vec<NodeConstraint>> {
    let part =
        |of: &dyn Fn(&NodeConstraint) -> f64| sum_at_nodes(plex, &own.iter().map(of).collect::<Vec<_>>());
    let [deflection, xx, xy, yy] = [
        part(&|hold| hold.deflection)?,
        part(&|hold| hold.slopes[0])?,
        part(&|hold| hold.slopes[1])?,
        part(&|hold| hold.slopes[2])?,
    ];
    let hold =
        |node: usize| NodeConstraint { deflection: deflection[node], slopes: [xx[node], xy[node], yy[node]] };
    Ok((0..own.len()).map(hold).collect())
}

/// Sums the contributions of all ranks at each node. Collective.
///
/// # Errors
/// Returns [`Error::Petsc`] where PETSc reports an error.
pub fn sum_at_nodes(plex: &Plex, of_nodes: &[f64]) -> Result<Vec<f64>> {
    let vertices = plex.vertices();
    let one_each = Section::new(plex.context(), Comm::World, plex.chart(), |point| Dofs {
        count: usize::from(vertices.contains(&point)),
        held: Vec::new(),
    })?;
    let plex = plex.with_section(&one_each)?;
    let (mut all, mut own) = (plex.global_vector()?, plex.local_vector()?);
    own.set_local(of_nodes)?;
    plex.add_to_global(&own, &mut all)?;
    plex.to_local(&all, &mut own)?;
    own.with_local(|sums| sums.to_vec())
}
