//! What a cell and a mesh must be for the elements to exist and to fit together.

use std::collections::HashMap;
use std::fmt::Display;

use nalgebra::Vector2;

use super::{Cell, Mesh, Point};
use crate::error::{Error, Result};

/// A corner whose two sides span less than this times the square of the longest side is flat.
///
/// At that flatness the second derivatives of the element, differences of order flatness squared, are all rounding.
const FLAT: f64 = 1e-8;

/// A node this near to an edge, relative to the edge's length, lies on it; less than what [`FLAT`] keeps a cell's own apart.
const JOINT: f64 = 1e-9;

impl Mesh {
    /// Checks that the mesh can carry the elements.
    ///
    /// # Errors
    /// [`Error::Mesh`] names the first flaw, with the numbers (from 0) and coordinates of what is at fault: no cell; a
    /// node whose coordinates are not finite, or that no cell uses; a cell with a node that does not exist or appears
    /// twice, or that is flat, clockwise or not strictly convex; cells that overlap along an edge (as they must when
    /// more than two share it), or that touch along one without sharing its nodes: two nodes at one place (a slit of no
    /// width is none), a node inside the edge of another cell; a named edge that is not an edge of a cell; a named cell
    /// or node that does not exist.
    pub fn check(&self) -> Result<()> {
        if self.cells.is_empty() {
            return Err(Error::Mesh("the mesh has no cell".into()));
        }
        let mut used = vec![false; self.nodes.len()];
        let mut owners: HashMap<[usize; 2], usize> = HashMap::with_capacity(4 * self.cells.len());
        for (number, cell) in self.cells.iter().enumerate() {
            self.check_cell(number)?;
            cell.nodes().iter().for_each(|&node| used[node] = true);
            for [a, b] in cell.edges() {
                if let Some(other) = owners.insert([a, b], number) {
                    let at = list(&[self.nodes[a], self.nodes[b]]);
                    return Err(Error::Mesh(format!(
                        "cells {other} and {number} overlap: both lie on the same side of their common edge, nodes {a} \
                         and {b} at {at}"
                    )));
                }
            }
        }
        if let Some(node) = used.iter().position(|used| !used) {
            let at = list(&[self.nodes[node]]);
            return Err(Error::Mesh(format!("no cell uses node {node} at {at}")));
        }
        self.check_joints(&owners)?;
        for (name, edges) in &self.edges {
            let stray =
                |&&[a, b]: &&[usize; 2]| !owners.contains_key(&[a, b]) && !owners.contains_key(&[b, a]);
            if let Some([a, b]) = edges.iter().find(stray) {
                let text = format!("nodes {a} and {b} of edge \"{name}\" are not an edge of a cell");
                return Err(Error::Mesh(text));
            }
        }
        for (what, names, count) in
            [("cell", &self.groups, self.cells.len()), ("node", &self.points, self.nodes.len())]
        {
            for (name, numbers) in names {
                if let Some(number) = numbers.iter().find(|&&number| number >= count) {
                    let text = format!("\"{name}\" names {what} {number}, but the mesh has {count} {what}s");
                    return Err(Error::Mesh(text));
                }
            }
        }
        Ok(())
    }

    /// Checks that no node of the boundary lies on an edge of the boundary other than its own.
    ///
    /// Of an edge, only the nodes in its extent along x or y, the longer of the two, are looked at.
    fn check_joints(&self, owners: &HashMap<[usize; 2], usize>) -> Result<()> {
        let boundary: Vec<[usize; 2]> = (self.cells.iter().flat_map(Cell::edges))
            .filter(|&[a, b]| !owners.contains_key(&[b, a]))
            .collect();
        let sorted = [0, 1].map(|axis| {
            let mut nodes: Vec<usize> = boundary.iter().map(|[node, _]| *node).collect();
            nodes.sort_by(|&a, &b| self.nodes[a][axis].total_cmp(&self.nodes[b][axis]).then(a.cmp(&b)));
            nodes.dedup();
            nodes
        });
        for [a, b] in boundary {
            let [start, end] = [a, b].map(|node| self.nodes[node]);
            let side = end - start;
            let slack = JOINT * side.norm();
            let axis = usize::from(side.y.abs() > side.x.abs());
            let nodes = &sorted[axis];
            let low = nodes.partition_point(|&n| self.nodes[n][axis] < start[axis].min(end[axis]) - slack);
            let high = start[axis].max(end[axis]) + slack;
            let near = nodes[low..].iter().copied().take_while(|&node| self.nodes[node][axis] <= high);
            for node in near.filter(|&node| node != a && node != b) {
                let point = self.nodes[node];
                let at = list(&[point]);
                if let Some(twin) = [a, b].into_iter().find(|&n| (self.nodes[n] - point).norm() <= slack) {
                    let [first, second] = [node.min(twin), node.max(twin)];
                    return Err(Error::Mesh(format!(
                        "nodes {first} and {second} are both at {at}: merge them"
                    )));
                }
                if side.perp(&(point - start)).abs() <= slack * side.norm() {
                    let (cell, ends) = (owners[&[a, b]], list(&[start, end]));
                    return Err(Error::Mesh(format!(
                        "node {node} at {at} hangs: it lies inside the edge {ends} of cell {cell}, of which it is no node"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Checks that the nodes of a cell exist and differ, and that its shape can carry an element.
    fn check_cell(&self, number: usize) -> Result<()> {
        let nodes = self.cells[number].nodes();
        if let Some(node) = nodes.iter().find(|&&node| node >= self.nodes.len()) {
            let count = self.nodes.len();
            let text =
                format!("cell {number}, of nodes {nodes:?}, has node {node}: the mesh has {count} nodes");
            return Err(Error::Mesh(text));
        }
        let vertices = self.vertices(number);
        if let Some(i) = (1..nodes.len()).find(|&i| nodes[..i].contains(&nodes[i])) {
            let text =
                format!("cell {number} has node {} twice; its vertices are {}", nodes[i], list(&vertices));
            return Err(Error::Mesh(text));
        }
        require_convex(format_args!("cell {number}"), &vertices)
    }
}

/// Checks that a polygon is finite, counter-clockwise and strictly convex; `name` is what the message calls it.
pub(crate) fn require_convex(name: impl Display, vertices: &[Point]) -> Result<()> {
    let flat = FLAT * longest_edge(vertices).powi(2);
    let area = area(vertices);
    let count = vertices.len();
    let mut spans = (0..count).map(|i| {
        let corner = vertices[i];
        (vertices[(i + 1) % count] - corner).perp(&(vertices[(i + count - 1) % count] - corner))
    });
    let flaw = if vertices.iter().any(|v| !(v.x.is_finite() && v.y.is_finite())) {
        "has a coordinate that is not a finite number"
    } else if area.abs() <= flat || area.is_nan() {
        "is degenerate: it has no area to speak of"
    } else if area < 0.0 {
        "is inverted: its nodes run clockwise"
    } else if !spans.all(|span| span > flat) {
        "is not strictly convex"
    } else {
        return Ok(());
    };
    Err(Error::Mesh(format!("{name} {flaw}; its vertices are {}", list(vertices))))
}

/// The start of each side of a polygon, and the side as a vector.
pub(super) fn sides(vertices: &[Point]) -> impl Iterator<Item = (Point, Vector2<f64>)> + '_ {
    vertices.iter().zip(vertices.iter().cycle().skip(1)).map(|(a, b)| (*a, b - a))
}

/// The length of the longest side of a polygon, in metres.
pub(super) fn longest_edge(vertices: &[Point]) -> f64 {
    sides(vertices).map(|(_, side)| side.norm()).fold(0.0, f64::max)
}

/// The signed area of a polygon, in square metres, from differences of coordinates.
pub(super) fn area(vertices: &[Point]) -> f64 {
    vertices.windows(2).skip(1).map(|v| (v[0] - vertices[0]).perp(&(v[1] - vertices[0]))).sum::<f64>() / 2.0
}

/// The points as text: `(0, 0), (1, 0), (0, 1)`.
fn list(points: &[Point]) -> String {
    points.iter().map(|p| format!("({}, {})", p.x, p.y)).collect::<Vec<_>>().join(", ")
}
