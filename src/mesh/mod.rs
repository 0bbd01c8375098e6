//! Nodes, cells and the names of their parts: what the elements stand on.
//!
//! A mesh is plain data. [`Mesh::rectangle`] and [`Mesh::load_gmsh`] give sound ones; a mesh from elsewhere is sound once [`Mesh::check`]
//! says so, and the other methods rely on it: they panic on an index that is out of range.

mod gmsh;
mod insert;
mod parts;
mod quality;
mod rectangle;
mod refine;

use std::collections::BTreeMap;

pub use gmsh::Import;
pub use insert::{Made, Mark};
pub(crate) use insert::{NEAR, nearness};
pub use parts::Part;
pub(crate) use parts::Unions;
pub(crate) use quality::require_convex;
pub use rectangle::{Diagonal, ElementKind, Grid};

use crate::error::{Error, Result};

/// A point of the plate's mid-plane, in metres.
pub type Point = nalgebra::Point2<f64>;

/// A cell: the numbers of its nodes, counter-clockwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Cell {
    /// Carries the reduced Hsieh-Clough-Tocher element.
    Triangle([usize; 3]),
    /// Strictly convex; carries the reduced Fraeijs de Veubeke-Sander element.
    Quadrilateral([usize; 4]),
}

impl Cell {
    /// The cell's nodes, counter-clockwise.
    pub fn nodes(&self) -> &[usize] {
        match self {
            Cell::Triangle(nodes) => nodes,
            Cell::Quadrilateral(nodes) => nodes,
        }
    }

    /// The cell's edges, counter-clockwise: the cell lies to the left of each. The first starts at the first node.
    pub fn edges(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let nodes = self.nodes();
        (0..nodes.len()).map(|i| [nodes[i], nodes[(i + 1) % nodes.len()]])
    }
}

/// A conforming mesh of triangles, quadrilaterals or both: the two elements fit together along an edge.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Coordinates of the nodes, in metres.
    pub nodes: Vec<Point>,
    /// The cells.
    pub cells: Vec<Cell>,
    /// Edges by name: what a support can hold. Each is a pair of nodes and an edge of a cell.
    pub edges: BTreeMap<String, Vec<[usize; 2]>>,
    /// Cells by name, their numbers: a part of the plate.
    pub groups: BTreeMap<String, Vec<usize>>,
    /// Nodes by name, their numbers.
    pub points: BTreeMap<String, Vec<usize>>,
}

/// How far outside a cell a point may lie and still count as inside, relative to the cell's longest edge.
const LOCATE: f64 = 1e-10;

impl Mesh {
    /// The vertices of a cell, counter-clockwise.
    pub fn vertices(&self, cell: usize) -> Vec<Point> {
        self.cells[cell].nodes().iter().map(|&node| self.nodes[node]).collect()
    }

    /// The area of a cell, in square metres; negative if its nodes run clockwise.
    pub fn area(&self, cell: usize) -> f64 {
        quality::area(&self.vertices(cell))
    }

    /// The centre of gravity of a cell.
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

    /// The first cell that contains a point, its boundary included, or `None` outside the mesh.
    ///
    /// A point within 1e-10 of the cell's longest edge from the cell counts as inside.
    pub fn locate(&self, point: Point) -> Option<usize> {
        (0..self.cells.len()).find(|&cell| {
            let vertices = self.vertices(cell);
            let slack = LOCATE * quality::longest_edge(&vertices);
            quality::sides(&vertices).all(|(start, side)| side.perp(&(point - start)) >= -slack * side.norm())
        })
    }

    /// The nodes of the edges of that name, in increasing order, each once.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the mesh has no such edge; the message lists those it has.
    pub fn edge_nodes(&self, name: &str) -> Result<Vec<usize>> {
        let edges = self.edges.get(name).ok_or_else(|| {
            let known: Vec<&str> = self.edges.keys().map(String::as_str).collect();
            Error::Mesh(format!("the mesh has no edge named \"{name}\"; it has: {}", known.join(", ")))
        })?;
        let mut nodes = edges.concat();
        nodes.sort_unstable();
        nodes.dedup();
        Ok(nodes)
    }
}
