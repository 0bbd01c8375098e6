//! A plate's mesh over all ranks: built, shared out and refined in parallel; no rank ever holds the whole.

use super::{Comm, Context, Dofs, Index, Plex, Section};
use crate::error::{Error, Result};
use crate::mesh::{Cell, Grid, Mesh, Point};
use crate::space::{PER_NODE, Space, Support};
use std::rc::Rc;

/// The label of the plate's edges, and their values from 1 on.
const LABEL: &str = "edge";
const EDGES: [&str; 4] = ["left", "right", "bottom", "top"];

/// This rank's part of a plate: its own cells, and the nodes of these, some shared with other ranks.
pub struct Part {
    /// The whole mesh; three dofs a vertex, those that supports hold left out of global vectors.
    pub plex: Rc<Plex>,
    /// This rank's cells and their nodes, as a mesh of its own.
    pub mesh: Mesh,
    /// All dofs of its nodes: dof k of node n is entry 3 n + k of local vectors. What supports hold is zero there.
    pub space: Space,
    /// Whether this rank owns each node.
    pub owns: Vec<bool>,
}

impl Part {
    /// A grid, shared out, refined and supported. Collective.
    ///
    /// # Errors
    /// [`Error::Petsc`], and as [`Space::held`].
    pub fn new(
        context: &Rc<Context>,
        grid: &Grid,
        refinements: u32,
        supports: &[(&str, Support)],
    ) -> Result<Part> {
        let mut plex = share(context, grid)?;
        let sides = sides(&plex, grid)?;
        for (value, points) in (1..).zip(&sides) {
            plex.label(LABEL, value, points)?;
        }
        plex = plex.distribute()?;
        for _ in 0..refinements {
            plex = plex.refine()?;
        }
        let mesh = own_mesh(&plex)?;
        let held = agree(&plex, Space::held(&mesh, supports.iter().copied())?)?;
        let space = Space::unsupported(&mesh);
        let vertices = plex.vertices();
        let section = Section::new(context, Comm::World, plex.chart(), |point| {
            if !vertices.contains(&point) {
                return Dofs::default();
            }
            let first = PER_NODE * (point - vertices.start) as usize;
            let held = (0..PER_NODE).filter(|k| held[first + k]).map(|k| k as Index).collect();
            Dofs { count: PER_NODE, held }
        })?;
        let owned = plex.owned()?;
        let owns = vertices.map(|vertex| owned[(vertex - plex.chart().start) as usize]).collect();
        Ok(Part { plex: Rc::new(plex.with_section(&section)?), mesh, space, owns })
    }
}

/// The grid's cells, each rank with as many.
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

/// This rank's edges on each side of the plate, in the order of [`EDGES`].
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

/// The cells of this rank as a mesh.
fn own_mesh(plex: &Plex) -> Result<Mesh> {
    let start = plex.vertices().start;
    let number = |vertex: Index| (vertex - start) as usize;
    let nodes = plex.coordinates()?.into_iter().map(Point::from).collect();
    let mut mesh = Mesh { nodes, ..Mesh::default() };
    for cell in plex.cells() {
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
    let edges = plex.edges();
    for (value, name) in (1..).zip(EDGES) {
        let on_side = plex.labelled(LABEL, value)?.into_iter().filter(|point| edges.contains(point));
        let ends = |edge: Index| -> Result<[usize; 2]> {
            let cone = plex.cone(edge)?;
            Ok([number(cone[0]), number(cone[1])])
        };
        mesh.edges.insert(name.into(), on_side.map(ends).collect::<Result<_>>()?);
    }
    Ok(mesh)
}

/// What any rank says is held is held: an edge's support reaches the ranks that have only its vertex.
fn agree(plex: &Plex, held: Vec<bool>) -> Result<Vec<bool>> {
    let vertices = plex.vertices();
    let all_free = Section::new(plex.context(), Comm::World, plex.chart(), |point| Dofs {
        count: if vertices.contains(&point) { PER_NODE } else { 0 },
        held: Vec::new(),
    })?;
    let plex = plex.with_section(&all_free)?;
    let (mut all, mut own) = (plex.global_vector()?, plex.local_vector()?);
    own.set_local(&held.into_iter().map(|held| f64::from(u8::from(held))).collect::<Vec<_>>())?;
    plex.add_to_global(&own, &mut all)?;
    plex.to_local(&all, &mut own)?;
    own.with_local(|counts| counts.iter().map(|&count| count > 0.0).collect())
}
