//! Checks that cells can carry the elements and that a mesh is conforming.

use std::collections::{HashMap, HashSet};

use super::{Cell, Mesh};
use crate::error::{Error, Result};
use crate::geometry::{self, Point, require_convex, sides};

/// Distance, relative to an edge's length, up to which a node lies on the edge. It is smaller than
/// the distance that [`require_convex`] keeps between a cell's own nodes and edges.
const JOINT: f64 = 1e-9;

/// Width of a gap between cells, relative to their sides, below which it counts as unintended.
const GAP: f64 = 1e-4;

/// Way in which a node touches an edge that is not its own, with the distance in m.
enum Touch {
    /// At a node of the edge.
    Node(usize, f64),
    /// Between the nodes of the edge.
    Side(f64),
}

/// Lists points with six digits of their coordinates.
fn list(points: &[Point]) -> String {
    let rounded = |x: f64| format!("{x:.5e}").parse().unwrap_or(x);
    geometry::list(&points.iter().map(|point| point.map(rounded)).collect::<Vec<_>>())
}

/// Returns a merging distance for nodes at a distance: ten times more, with one digit.
fn merge(distance: f64) -> String {
    if distance > 0.0 { format!("{:.0e}", 10.0 * distance) } else { "1e-9".into() }
}

/// Numbers by which messages call nodes and cells: as a file has them, or from 0 where the lists
/// are empty.
#[derive(Default)]
pub struct NumbersOfFile {
    pub nodes: Vec<u64>,
    pub cells: Vec<u64>,
}

impl NumbersOfFile {
    fn node(&self, node: usize) -> u64 {
        self.nodes.get(node).copied().unwrap_or(node as u64)
    }

    fn cell(&self, cell: usize) -> u64 {
        self.cells.get(cell).copied().unwrap_or(cell as u64)
    }
}

impl Mesh {
    /// Checks that the mesh can carry the elements.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for the first flaw, with the numbers (from 0) and coordinates of the
    /// culprits:
    ///
    /// - no cell;
    /// - a node with coordinates that are not finite, or one that no cell uses;
    /// - a cell with a node that does not exist or appears twice;
    /// - a cell that is flat, clockwise or not strictly convex;
    /// - cells that overlap along an edge, as they must when more than two share it;
    /// - cells that touch along an edge without sharing its nodes, unless the mesh has
    ///   [`slits`](Mesh::slits): two nodes at one place, or a node inside the edge of another cell;
    /// - a named edge that is not an edge of a cell, or a named cell or node that does not exist.
    pub fn check(&self) -> Result<()> {
        self.check_as(&NumbersOfFile::default())
    }

    /// Checks the mesh like [`Mesh::check`], with numbers for messages.
    pub(super) fn check_as(&self, numbers: &NumbersOfFile) -> Result<()> {
        if self.cells.is_empty() {
            return Err(Error::Mesh("the mesh has no cell".into()));
        }
        let mut used = vec![false; self.nodes.len()];
        let mut owners: HashMap<[usize; 2], usize> = HashMap::with_capacity(4 * self.cells.len());
        for (number, cell) in self.cells.iter().enumerate() {
            self.check_cell(number, numbers)?;
            cell.nodes().iter().for_each(|&node| used[node] = true);
            for [a, b] in cell.edges() {
                if let Some(other) = owners.insert([a, b], number) {
                    let places = list(&[self.nodes[a], self.nodes[b]]);
                    let [other, number] = [other, number].map(|cell| numbers.cell(cell));
                    let [a, b] = [a, b].map(|node| numbers.node(node));
                    return Err(Error::Mesh(format!(
                        "cells {other} and {number} overlap: both lie on the same side of their common edge, nodes {a} \
                         and {b} at {places}"
                    )));
                }
            }
        }
        if let Some(node) = used.iter().position(|used| !used) {
            let place = list(&[self.nodes[node]]);
            return Err(Error::Mesh(format!("no cell uses node {} at {place}", numbers.node(node))));
        }
        self.check_joints(&owners, numbers)?;
        for (name, edges) in &self.edges {
            let stray =
                |&&[a, b]: &&[usize; 2]| !owners.contains_key(&[a, b]) && !owners.contains_key(&[b, a]);
            if let Some([a, b]) = edges.iter().find(stray) {
                let [a, b] = [a, b].map(|&node| numbers.node(node));
                let text = format!("nodes {a} and {b} of edge \"{name}\" are not an edge of a cell");
                return Err(Error::Mesh(text));
            }
        }
        for (what, names, count) in
            [("cell", &self.groups, self.cells.len()), ("node", &self.points, self.nodes.len())]
        {
            for (name, members) in names {
                if let Some(number) = members.iter().find(|&&number| number >= count) {
                    let text = format!("\"{name}\" names {what} {number}, but the mesh has {count} {what}s");
                    return Err(Error::Mesh(text));
                }
            }
        }
        Ok(())
    }

    /// Checks that no boundary node lies on a boundary edge other than its own, or across a gap
    /// that is narrow relative to the cells there.
    ///
    /// For each edge, only the nodes within its extent along x or y, the longer of the two, are
    /// tested.
    fn check_joints(&self, owners: &HashMap<[usize; 2], usize>, numbers: &NumbersOfFile) -> Result<()> {
        let boundary: Vec<[usize; 2]> = (self.cells.iter().flat_map(Cell::edges))
            .filter(|&[a, b]| !owners.contains_key(&[b, a]))
            .collect();
        let sorted = [0, 1].map(|axis| {
            let mut nodes: Vec<usize> = boundary.iter().map(|[node, _]| *node).collect();
            nodes.sort_by(|&a, &b| self.nodes[a][axis].total_cmp(&self.nodes[b][axis]).then(a.cmp(&b)));
            nodes.dedup();
            nodes
        });
        let shortest = self.shortest_sides();
        let mut first = None;
        let (mut twins, mut farthest) = (HashSet::new(), 0.0_f64);
        for [a, b] in boundary {
            let [start, end] = [a, b].map(|node| self.nodes[node]);
            let side = end - start;
            let slack = GAP * side.norm();
            let axis = usize::from(side.y.abs() > side.x.abs());
            let nodes = &sorted[axis];
            let low = nodes.partition_point(|&n| self.nodes[n][axis] < start[axis].min(end[axis]) - slack);
            let high = start[axis].max(end[axis]) + slack;
            let near = nodes[low..].iter().copied().take_while(|&node| self.nodes[node][axis] <= high);
            let owner = owners[&[a, b]];
            let is_own = |node: &usize| self.cells[owner].nodes().contains(node);
            for node in near.filter(|node| !is_own(node)) {
                let gap = slack.min(GAP * shortest[node]);
                let Some(touch) = self.touch(owner, [a, b], node, gap) else { continue };
                if let Touch::Node(twin, distance) = touch {
                    twins.insert([node.min(twin), node.max(twin)]);
                    farthest = farthest.max(distance);
                }
                first.get_or_insert((node, [a, b], owner, touch));
            }
        }
        first.map_or(Ok(()), |(node, [a, b], owner, touch)| {
            let (place, ends) = (list(&[self.nodes[node]]), list(&[self.nodes[a], self.nodes[b]]));
            Err(Error::Mesh(match touch {
                Touch::Node(twin, distance) => {
                    let [first, second] = [node.min(twin), node.max(twin)].map(|node| numbers.node(node));
                    let more = match twins.len() {
                        0 | 1 => String::new(),
                        count if farthest == 0.0 => format!(", and {} more pairs are at the same place", count - 1),
                        count => format!(", and so are {} more pairs, up to {farthest:.1e} m apart", count - 1),
                    };
                    if distance <= JOINT * shortest[node] {
                        format!(
                            "nodes {first} and {second} are both at {place}{more}: merge them, for example with mesh.merge = {}, or \
                             set mesh.slits = true if the plate is slit there",
                            merge(farthest)
                        )
                    } else {
                        format!(
                            "nodes {first} and {second} at {place} are {distance:.1e} m apart, too near for a gap{more}: merge \
                             them, for example with mesh.merge = {}, or set mesh.slits = true if the plate is slit there",
                            merge(farthest)
                        )
                    }
                }
                Touch::Side(distance) => format!(
                    "node {} at {place} hangs: it lies {distance:.1e} m from the edge {ends} of cell {} but is not one of its nodes; mesh.slits = true allows this where the plate is slit",
                    numbers.node(node),
                    numbers.cell(owner)
                ),
            }))
        })
    }

    /// Returns how a node outside the owner of an edge touches that edge, if it does. In a mesh
    /// with slits only a node inside the owner does.
    fn touch(&self, owner: usize, [a, b]: [usize; 2], node: usize, gap: f64) -> Option<Touch> {
        let [start, end, point] = [a, b, node].map(|node| self.nodes[node]);
        let side = end - start;
        let length = side.norm();
        let beyond = -side.perp(&(point - start)) / length;
        let slack = JOINT * length;
        // The plate lies on the cell's own side of the edge, unless cells overlap.
        let vertices = self.vertices(owner);
        let is_inside = |by: f64| {
            sides(&vertices).all(|(start, side)| side.perp(&(point - start)) >= by * side.norm_squared())
        };
        let nearest = [a, b].into_iter().map(|n| ((self.nodes[n] - point).norm(), n));
        let (distance, twin) = nearest.min_by(|x, y| x.0.total_cmp(&y.0))?;
        let is_in_gap = beyond >= -slack;
        if self.slits && is_in_gap {
            return None;
        }
        if distance <= slack || distance <= gap && (is_in_gap || is_inside(-JOINT)) {
            let share = |cell: &Cell| cell.nodes().contains(&node) && cell.nodes().contains(&twin);
            return (!self.cells.iter().any(share)).then_some(Touch::Node(twin, distance));
        }
        let along = side.dot(&(point - start)) / length;
        let reaches = (0.0..=length).contains(&along);
        let is_near = beyond.abs() <= slack || is_in_gap && beyond <= gap;
        let touches = reaches && (is_near || is_inside(JOINT));
        touches.then_some(Touch::Side(beyond.abs()))
    }

    /// Checks that the nodes of a cell exist and differ, and that its shape can carry an element.
    fn check_cell(&self, cell: usize, numbers: &NumbersOfFile) -> Result<()> {
        let (nodes, number) = (self.cells[cell].nodes(), numbers.cell(cell));
        if let Some(node) = nodes.iter().find(|&&node| node >= self.nodes.len()) {
            let count = self.nodes.len();
            let text =
                format!("cell {number}, of nodes {nodes:?}, has node {node}: the mesh has {count} nodes");
            return Err(Error::Mesh(text));
        }
        let vertices = self.vertices(cell);
        if let Some(i) = (1..nodes.len()).find(|&i| nodes[..i].contains(&nodes[i])) {
            let text = format!(
                "cell {number} has node {} twice; its vertices are {}",
                numbers.node(nodes[i]),
                list(&vertices)
            );
            return Err(Error::Mesh(text));
        }
        require_convex(format_args!("cell {number}"), &vertices)
    }
}
