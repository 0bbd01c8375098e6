//! Meshes: nodes, cells, and the names of their parts.
//!
//! A mesh is plain data. [`Mesh::rectangle`] and [`Mesh::load`] return valid meshes; a mesh
//! from elsewhere is valid once [`Mesh::check`] accepts it. The other methods rely on this and
//! panic on an index that is out of range.

mod abaqus;
mod bisection;
mod cards;
mod contents;
mod cursor;
mod file;
mod gmsh;
mod insert;
mod nastran;
mod parts;
mod plane;
mod quality;
mod rectangle;
mod refine;
mod rims;

use std::collections::{BTreeMap, HashSet};

pub use contents::Import;
pub use insert::{Made, Mark};
pub(crate) use insert::{NEAR, nearness};
pub use parts::Part;
pub(crate) use parts::Unions;
pub use rectangle::{Diagonal, Grid};

pub use crate::element::ElementKind;
pub use crate::geometry::Point;

use crate::communicator::Communicator;
use crate::element::{AnyElement, CellShape, ElementByShape};
use crate::error::{Error, Result};
use crate::geometry;

/// Cell, given by the numbers of its nodes, counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cell {
    /// Triangle.
    Triangle([usize; 3]),
    /// Strictly convex quadrilateral.
    Quadrilateral([usize; 4]),
}

impl Cell {
    /// Returns the cell's nodes, counter-clockwise.
    pub fn nodes(&self) -> &[usize] {
        match self {
            Cell::Triangle(nodes) => nodes,
            Cell::Quadrilateral(nodes) => nodes,
        }
    }

    /// Returns the cell's shape.
    pub fn shape(&self) -> CellShape {
        match self {
            Cell::Triangle(_) => CellShape::Triangle,
            Cell::Quadrilateral(_) => CellShape::Quadrilateral,
        }
    }

    /// Returns the cell's edges, counter-clockwise, from the first node on; the cell lies to the
    /// left of each.
    pub fn edges(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let nodes = self.nodes();
        (0..nodes.len()).map(|i| [nodes[i], nodes[(i + 1) % nodes.len()]])
    }
}

/// Conforming mesh of triangles, quadrilaterals or both; all elements fit together along an edge.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Coordinates of the nodes, in m.
    pub nodes: Vec<Point>,
    /// Cells of the mesh.
    pub cells: Vec<Cell>,
    /// Elements that the cells carry.
    pub elements: ElementByShape,
    /// Named edges, which supports can hold. Each is a list of node pairs that are edges of cells.
    pub edges: BTreeMap<String, Vec<[usize; 2]>>,
    /// Named groups of cells, as cell numbers: parts of the plate.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// Named nodes, as node numbers.
    pub points: BTreeMap<String, Vec<usize>>,
    /// Whether boundary edges may lie on each other without a common node: slits of no width.
    pub slits: bool,
    /// Notes of the reader of its file, one sentence each.
    pub notes: Vec<String>,
}

/// Distance from a cell up to which a point counts as inside, relative to the cell's longest edge.
const LOCATE: f64 = 1e-10;

impl Mesh {
    /// Returns the vertices of a cell, counter-clockwise.
    pub fn vertices(&self, cell: usize) -> Vec<Point> {
        self.cells[cell].nodes().iter().map(|&node| self.nodes[node]).collect()
    }

    /// Returns a length up to which distances count as equal, in m: a few roundings of the largest
    /// coordinate.
    pub fn grain(&self) -> f64 {
        16.0 * f64::EPSILON * self.nodes.iter().fold(0.0, |m: f64, p| m.max(p.x.abs()).max(p.y.abs()))
    }

    /// Returns the shape of a cell in multiples of the [grain](Self::grain), which congruent cells
    /// (translates of one another) share.
    pub fn shape(&self, cell: usize, grain: f64) -> Vec<i64> {
        let vertices = self.vertices(cell);
        let arms = vertices[1..].iter().map(|vertex| vertex - vertices[0]);
        arms.flat_map(|arm| [arm.x, arm.y].map(|a| (a / grain).round() as i64)).collect()
    }

    /// Creates the element of a cell.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a cell that cannot carry its element.
    pub fn element(&self, cell: usize) -> Result<AnyElement> {
        self.elements.of(self.cells[cell].shape()).on(&self.vertices(cell))
    }

    /// Returns the area of a cell, in m^2; it is negative if the nodes run clockwise.
    pub fn area(&self, cell: usize) -> f64 {
        geometry::area(&self.vertices(cell))
    }

    /// Returns the centroid of a cell, in m.
    pub fn centroid(&self, cell: usize) -> Point {
        let vertices = self.vertices(cell);
        let (mut area, mut moment) = (0.0, nalgebra::Vector2::zeros());
        for pair in vertices.windows(2).skip(1) {
            let (a, b) = (pair[0] - vertices[0], pair[1] - vertices[0]);
            area += a.perp(&b);
            moment += (a + b) * (a.perp(&b) / 3.0);
        }
        vertices[0] + moment / area
    }

    /// Returns the mean of the corners of a cell, in m.
    pub fn middle(&self, cell: usize) -> Point {
        let vertices = self.vertices(cell);
        vertices.iter().fold(Point::origin(), |sum, p| sum + p.coords) / vertices.len() as f64
    }

    /// Returns the length of the shortest side at each node, in m.
    pub fn shortest_sides(&self) -> Vec<f64> {
        let mut shortest = vec![f64::INFINITY; self.nodes.len()];
        for [a, b] in self.cells.iter().flat_map(Cell::edges) {
            let side = (self.nodes[b] - self.nodes[a]).norm();
            [a, b].into_iter().for_each(|node| shortest[node] = shortest[node].min(side));
        }
        shortest
    }

    /// Returns the sides beyond which there is no cell, in the order of the cells.
    pub fn border(&self) -> Vec<[usize; 2]> {
        let sides: HashSet<[usize; 2]> = self.cells.iter().flat_map(Cell::edges).collect();
        self.cells.iter().flat_map(Cell::edges).filter(|&[a, b]| !sides.contains(&[b, a])).collect()
    }

    /// Returns the first cell that contains a point, or `None` outside the mesh.
    pub fn locate(&self, point: Point) -> Option<usize> {
        self.cells_at(point).next()
    }

    /// Returns the cell of a point on the first process whose mesh contains it; `None` on the
    /// others. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`], with the key of the point, where no mesh contains it.
    pub fn locate_once(&self, comm: &impl Communicator, key: &str, point: Point) -> Result<Option<usize>> {
        let cell = self.locate(point);
        let Some(first) = comm.all_gather_one(cell.is_some()).iter().position(|&here| here) else {
            let place = geometry::place(point);
            return Err(Error::Mesh(format!("{key}: the point {place} lies outside the plate")));
        };
        Ok(cell.filter(|_| first == comm.rank()))
    }

    /// Returns the cells that contain a point, their boundaries included.
    ///
    /// A point within 1e-10 of a cell's longest edge from the cell counts as inside.
    pub fn cells_at(&self, point: Point) -> impl Iterator<Item = usize> {
        (0..self.cells.len()).filter(move |&cell| {
            let vertices = self.vertices(cell);
            let slack = LOCATE * geometry::longest_edge(&vertices);
            geometry::sides(&vertices)
                .all(|(start, side)| side.perp(&(point - start)) >= -slack * side.norm())
        })
    }

    /// Returns the nodes of the edges with a name, in increasing order, each once.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] if the mesh has no such edge; the message lists the names that it
    /// has.
    pub fn edge_nodes(&self, name: &str) -> Result<Vec<usize>> {
        let edges = self.edges.get(name).ok_or_else(|| {
            let names: Vec<&str> = self.edges.keys().map(String::as_str).collect();
            Error::Mesh(format!("the mesh has no edge named \"{name}\"; it has: {}", names.join(", ")))
        })?;
        let mut nodes = edges.concat();
        nodes.sort_unstable();
        nodes.dedup();
        Ok(nodes)
    }
}
