//! Meshes from Gmsh: MSH 2.2 and 4.1, in text or in binary of either byte order.
//!
//! Source: C. Geuzaine and J.-F. Remacle, *Gmsh reference manual*, "MSH file format" and "MSH file
//! format version 2 (Legacy)".

mod cursor;
mod sections;

use std::collections::{HashMap, HashSet};
use std::path::Path;

use super::{Cell, Mesh, Point};
use crate::error::Result;
use crate::geometry;
use crate::input;
use cursor::Cursor;
use sections::{Block, Node, Sections, physical};

/// Largest distance of a node from the plane of the others, relative to the size of the plate.
const FLAT: f64 = 1e-9;

/// Conversion of a mesh as it is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Import {
    /// Factor that converts coordinates to m.
    pub scale: f64,
    /// Distance up to which nodes are merged, in m; 0 merges none.
    pub merge: f64,
}

impl Default for Import {
    fn default() -> Import {
        Import { scale: 1.0, merge: 0.0 }
    }
}

impl Mesh {
    /// Reads a mesh saved by Gmsh: MSH 2.2 or 4.1, text or binary.
    ///
    /// - Triangles and quadrangles become cells, in the order of the file; clockwise ones are
    ///   reversed. Nodes keep their order; those that no cell uses are dropped. A repeated cell, as
    ///   2.2 writes it for each of its groups, counts once.
    /// - Physical curves become named [`edges`](Mesh::edges), physical surfaces
    ///   [`groups`](Mesh::groups) of cells, and physical points named [`points`](Mesh::points). One
    ///   without a name is called by its number (`"7"`); those of one name and kind are united. A
    ///   boundary edge has its cell on the left.
    /// - Curved boundaries become the straight edges between their nodes. Lengths are in m.
    /// - Whole and partitioned files give the same mesh. Parametric coordinates, periodicity,
    ///   post-processing data and sections of other programs are ignored.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] for a file that cannot be read. Returns [`crate::Error::Mesh`],
    /// with the line or the offset where there is one, for
    ///
    /// - a file that does not follow the format, or another version of it;
    /// - elements of higher order or volumes, or no cell at all;
    /// - nodes that do not lie in one plane of constant z;
    /// - a physical group that contains nothing, or no edge or node of a cell;
    /// - a mesh that [`Mesh::check`] refuses.
    pub fn load_gmsh(path: impl AsRef<Path>) -> Result<Mesh> {
        Mesh::load_gmsh_as(path, Import::default())
    }

    /// Reads a mesh like [`Mesh::load_gmsh`], with coordinates in another unit or nodes to be
    /// merged.
    ///
    /// # Errors
    /// Returns the errors of [`Mesh::load_gmsh`], and [`crate::Error::Mesh`] where nodes of one
    /// cell would be merged.
    pub fn load_gmsh_as(path: impl AsRef<Path>, import: Import) -> Result<Mesh> {
        let path = path.as_ref();
        // Only the available memory limits the size of the file.
        let bytes = input::read(path, u64::MAX)?;
        Mesh::from_gmsh_as(&bytes, &path.display().to_string(), import)
    }

    /// Reads a mesh like [`Mesh::load_gmsh`], from the bytes of a file. Any bytes give either a
    /// valid mesh or [`crate::Error::Mesh`].
    pub fn from_gmsh(bytes: &[u8], file_name: &str) -> Result<Mesh> {
        Mesh::from_gmsh_as(bytes, file_name, Import::default())
    }

    /// Reads a mesh like [`Mesh::load_gmsh_as`], from the bytes of a file.
    pub fn from_gmsh_as(bytes: &[u8], file_name: &str, import: Import) -> Result<Mesh> {
        Sections::read(Cursor::new(file_name, bytes))?.mesh(import)
    }
}

impl Sections<'_> {
    /// Returns the mesh of all elements, checked.
    fn mesh(&self, import: Import) -> Result<Mesh> {
        let (mut mesh, numbers) = self.flat_nodes(import)?;
        self.add_cells(&mut mesh, &numbers);
        self.require_apart(&mesh, import)?;
        self.add_edges(&mut mesh, &numbers)?;
        self.add_points(&mut mesh, &numbers)?;
        mesh.check().map_err(|error| self.cursor.fault_of_file(error))?;
        Ok(mesh)
    }

    fn blocks_of(&self, dimension: usize) -> impl Iterator<Item = &Block> + Clone {
        let some = move |block: &&Block| block.shape.dimension == dimension && !block.nodes.is_empty();
        self.blocks.iter().filter(some)
    }

    /// Checks that no cell has lost a node by merging.
    fn require_apart(&self, mesh: &Mesh, import: Import) -> Result<()> {
        let shrunk = |cell: &Cell| cell.edges().find(|[a, b]| a == b);
        let pair = if import.merge > 0.0 { mesh.cells.iter().find_map(shrunk) } else { None };
        pair.map_or(Ok(()), |[node, _]| {
            let Point { coords: point } = mesh.nodes[node];
            Err(self.cursor.fault_of_file(format_args!(
                "mesh.merge = {:?} m merges two nodes of one cell at {}; expected less than the shortest side of \
                 a cell",
                import.merge,
                geometry::place([point.x, point.y])
            )))
        })
    }

    /// Returns a mesh of the nodes that cells use, and for each node of the file its number there.
    fn flat_nodes(&self, import: Import) -> Result<(Mesh, Vec<Option<usize>>)> {
        let mut used = vec![false; self.nodes.len()];
        self.blocks_of(2).flat_map(|block| &block.nodes).for_each(|&index| used[index] = true);
        let mut nodes = self.nodes.iter().zip(&used).filter(|(_, used)| **used).map(|(node, _)| node);
        let Some(first) = nodes.next() else {
            return Err(self.cursor.fault_of_file(
                "there is no triangle and no quadrangle: mesh the surface, and where there are physical groups, put it \
                 into one or set Mesh.SaveAll = 1",
            ));
        };
        let size = nodes.clone().fold(0.0, |size: f64, node| {
            (0..2).fold(size, |size, i| size.max((node.position[i] - first.position[i]).abs()))
        });
        if let Some(node) = nodes.find(|node| (node.position[2] - first.position[2]).abs() > FLAT * size) {
            let text = format!(
                "node {} lies at z = {}, but node {} at z = {}: a plate is flat, its z constant",
                node.number, node.position[2], first.number, first.position[2]
            );
            return Err(self.cursor.fault(node.place, text));
        }
        let place = |node: &Node| Point::new(node.position[0], node.position[1]) * import.scale;
        let places: Vec<Option<Point>> =
            self.nodes.iter().zip(used).map(|(node, used)| used.then(|| place(node))).collect();
        let first_of = merged(&places, import.merge);
        let mut mesh = Mesh::default();
        let mut numbers: Vec<Option<usize>> = Vec::with_capacity(places.len());
        for (index, place) in places.iter().enumerate() {
            let number = place.map(|place| {
                // The first of several merged nodes stands for all of them.
                numbers.get(first_of[index]).copied().flatten().unwrap_or_else(|| {
                    mesh.nodes.push(place);
                    mesh.nodes.len() - 1
                })
            });
            numbers.push(number);
        }
        Ok((mesh, numbers))
    }

    fn add_cells(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) {
        let mut cell_numbers: HashMap<Cell, usize> = HashMap::new();
        for block in self.blocks_of(2) {
            let mut members = Vec::new();
            for nodes in block.nodes.chunks_exact(block.shape.nodes) {
                let mut nodes: Vec<usize> = nodes.iter().filter_map(|&index| numbers[index]).collect();
                let vertices: Vec<Point> = nodes.iter().map(|&node| mesh.nodes[node]).collect();
                if geometry::area(&vertices) < 0.0 {
                    nodes[1..].reverse();
                }
                let cell = cell(&nodes);
                // The same cell may start at another node.
                let first = (0..nodes.len()).min_by_key(|&i| nodes[i]).unwrap_or(0);
                nodes.rotate_left(first);
                members.push(*cell_numbers.entry(self::cell(&nodes)).or_insert_with(|| {
                    mesh.cells.push(cell);
                    mesh.cells.len() - 1
                }));
            }
            for &group in block.groups.iter() {
                mesh.groups.entry(self.name(2, group)).or_default().extend(&members);
            }
        }
        mesh.groups.values_mut().for_each(sort);
    }

    fn add_edges(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) -> Result<()> {
        let sides: HashSet<[usize; 2]> = mesh.cells.iter().flat_map(Cell::edges).collect();
        for block in self.blocks_of(1) {
            for &group in block.groups.iter() {
                let name = self.name(1, group);
                let edges = mesh.edges.entry(name.clone()).or_default();
                for nodes in block.nodes.chunks_exact(2) {
                    let side = |(a, b)| [[a, b], [b, a]].into_iter().find(|side| sides.contains(side));
                    let edge = numbers[nodes[0]].zip(numbers[nodes[1]]).and_then(side);
                    edges.push(edge.ok_or_else(|| {
                        let [from, to] = [nodes[0], nodes[1]].map(|index| self.spot(index));
                        self.cursor.fault_of_file(format_args!(
                            "the line from {from} to {to}, of {} {name:?}, is not an edge of a cell",
                            physical(1)
                        ))
                    })?);
                }
            }
        }
        for edges in mesh.edges.values_mut() {
            let mut seen = HashSet::new();
            edges.retain(|&[a, b]| seen.insert([a.min(b), a.max(b)]));
        }
        Ok(())
    }

    fn add_points(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) -> Result<()> {
        for block in self.blocks_of(0) {
            for &group in block.groups.iter() {
                let name = self.name(0, group);
                for &index in &block.nodes {
                    let node = numbers[index].ok_or_else(|| {
                        let (spot, kind) = (self.spot(index), physical(0));
                        self.cursor.fault_of_file(format_args!(
                            "{spot}, of {kind} {name:?}, is not a node of a cell"
                        ))
                    })?;
                    mesh.points.entry(name.clone()).or_default().push(node);
                }
            }
        }
        mesh.points.values_mut().for_each(sort);
        Ok(())
    }

    fn name(&self, dimension: usize, group: u64) -> String {
        match self.names.get(&(dimension, group)) {
            Some((name, _)) => name.to_string(),
            None => group.to_string(),
        }
    }

    /// Describes a node in words.
    fn spot(&self, index: usize) -> String {
        let Node { number, position: [x, y, _], .. } = self.nodes[index];
        format!("node {number} at {}", geometry::place([x, y]))
    }
}

/// Returns for each place the first place with which it is merged: places within a distance are,
/// and so are chains of them.
fn merged(places: &[Option<Point>], distance: f64) -> Vec<usize> {
    let mut first_of: Vec<usize> = (0..places.len()).collect();
    if distance <= 0.0 {
        return first_of;
    }
    fn root(first_of: &mut [usize], mut index: usize) -> usize {
        while first_of[index] != index {
            first_of[index] = first_of[first_of[index]];
            index = first_of[index];
        }
        index
    }
    // In squares of this side, only places in neighbouring squares can be near.
    let square = |place: Point| [place.x, place.y].map(|x| (x / distance).floor() as i64);
    let mut squares: HashMap<[i64; 2], Vec<usize>> = HashMap::new();
    for (index, place) in places.iter().enumerate() {
        let Some(place) = *place else { continue };
        let [i, j] = square(place);
        for (k, l) in (-1..=1).flat_map(|k| (-1..=1).map(move |l| (k, l))) {
            let near = [i.saturating_add(k), j.saturating_add(l)];
            for &other in squares.get(&near).into_iter().flatten() {
                if places[other].is_some_and(|other| (other - place).norm() <= distance) {
                    let (a, b) = (root(&mut first_of, other), root(&mut first_of, index));
                    first_of[a.max(b)] = a.min(b);
                }
            }
        }
        squares.entry([i, j]).or_default().push(index);
    }
    (0..places.len()).map(|index| root(&mut first_of, index)).collect()
}

fn cell(nodes: &[usize]) -> Cell {
    match *nodes {
        [a, b, c] => Cell::Triangle([a, b, c]),
        [a, b, c, d] => Cell::Quadrilateral([a, b, c, d]),
        _ => unreachable!("a triangle or a quadrangle, all of whose nodes are numbered"),
    }
}

fn sort(numbers: &mut Vec<usize>) {
    numbers.sort_unstable();
    numbers.dedup();
}
