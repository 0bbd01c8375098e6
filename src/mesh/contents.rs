//! Contents of a mesh file of any format, and the mesh that they make.

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::rc::Rc;

use super::cursor::Cursor;
use super::parts::Unions;
use super::plane::Plane;
use super::quality::NumbersOfFile;
use super::{Cell, Mesh, Point};
use crate::error::Result;
use crate::geometry;

/// Advice for volumes.
pub const SOLID: &str = "a plate is flat: mesh its surfaces only";

/// Conversion of a mesh as it is read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Import {
    /// Factor that converts coordinates to m.
    pub scale: f64,
    /// Distance up to which nodes are merged, in m; 0 merges none.
    pub merge: f64,
    /// Whether boundary edges may lie on each other, see [`Mesh::slits`].
    pub slits: bool,
}

impl Default for Import {
    fn default() -> Import {
        Import { scale: 1.0, merge: 0.0, slits: false }
    }
}

/// Bit in the number of a group that stands for a curve of the drawing, which is in no group.
pub const ELEMENTARY: u64 = 1 << 63;

/// Numbers of groups of one dimension.
pub type Groups = Rc<[u64]>;

/// Node as the file has it.
pub struct Node {
    pub number: u64,
    pub place: usize,
    pub position: [f64; 3],
}

/// Elements of one shape in the same groups.
struct Block {
    shape: Shape,
    groups: Groups,
    /// Numbers of the elements in the file.
    numbers: Vec<u64>,
    /// Indices of the nodes, element by element.
    nodes: Vec<usize>,
}

/// Shape of elements that a plate can use.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    pub dimension: usize,
    /// Number of nodes.
    pub nodes: usize,
}

/// Words of a format.
pub struct Dialect {
    /// Kinds of groups in messages, by dimension.
    pub groups: [&'static str; 3],
    /// Remedy where a file has no cell.
    pub no_cell: &'static str,
}

/// Contents of a mesh file.
pub struct Contents<'a> {
    pub cursor: Cursor<'a>,
    dialect: &'static Dialect,
    /// Names of groups, by dimension and number.
    pub names: BTreeMap<(usize, u64), String>,
    pub nodes: Vec<Node>,
    /// Indices of the nodes by their numbers in the file.
    pub indices: HashMap<u64, usize>,
    blocks: Vec<Block>,
    /// Plane of the nodes that cells use, once it is determined.
    plane: Plane,
    /// Named sets of nodes, as indices: edges where they consist of whole sides of the boundary.
    pub node_sets: BTreeMap<String, Vec<usize>>,
    /// Notes for the user, one sentence each.
    pub notes: Vec<String>,
}

impl<'a> Contents<'a> {
    pub fn new(cursor: Cursor<'a>, dialect: &'static Dialect) -> Contents<'a> {
        Contents {
            cursor,
            dialect,
            names: BTreeMap::new(),
            nodes: Vec::new(),
            indices: HashMap::new(),
            blocks: Vec::new(),
            plane: Plane::default(),
            node_sets: BTreeMap::new(),
            notes: Vec::new(),
        }
    }

    pub fn add_node(&mut self, node: Node) -> Result<()> {
        if self.indices.insert(node.number, self.nodes.len()).is_some() {
            let text = format!("there is a node {} above already", node.number);
            return Err(self.cursor.fault(node.place, text));
        }
        self.nodes.push(node);
        Ok(())
    }

    /// Begins an element, whose nodes follow by [`Contents::add_corner`].
    pub fn begin_element(&mut self, shape: Shape, groups: &[u64], number: u64) {
        match self.blocks.last_mut().filter(|last| last.shape == shape && *last.groups == *groups) {
            Some(last) => last.numbers.push(number),
            None => self.blocks.push(Block {
                shape,
                groups: groups.into(),
                numbers: vec![number],
                nodes: Vec::new(),
            }),
        }
    }

    /// Adds a node, by its number, to the last element.
    pub fn add_corner(&mut self, place: usize, number: u64) -> Result<()> {
        let Some(index) = self.index(number) else {
            let wrong = format!("node {number} of this element is not among the nodes above");
            return Err(self.cursor.fault(place, wrong));
        };
        self.blocks.iter_mut().last().into_iter().for_each(|block| block.nodes.push(index));
        Ok(())
    }

    /// Returns the index of a node by its number.
    pub fn index(&self, number: u64) -> Option<usize> {
        self.indices.get(&number).copied()
    }

    /// Returns the mesh of all elements, checked.
    pub fn mesh(mut self, import: Import) -> Result<Mesh> {
        let (mut mesh, numbers) = self.flat_nodes(import)?;
        let names = NumbersOfFile {
            nodes: self.node_numbers(&numbers, mesh.nodes.len()),
            cells: self.add_cells(&mut mesh, &numbers),
        };
        mesh.slits = import.slits;
        self.require_apart(&mesh, import)?;
        self.add_edges(&mut mesh, &numbers)?;
        self.add_points(&mut mesh, &numbers)?;
        self.add_node_sets(&mut mesh, &numbers);
        mesh.notes.extend(self.plane.note.iter().chain(&self.notes).cloned());
        mesh.check_as(&names).map_err(|error| self.cursor.fault_of_file(error))?;
        Ok(mesh)
    }

    /// Returns the number in the file of each node of the mesh.
    fn node_numbers(&self, numbers: &[Option<usize>], count: usize) -> Vec<u64> {
        let mut names = vec![0; count];
        for (node, number) in self.nodes.iter().zip(numbers).rev() {
            number.iter().for_each(|&number| names[number] = node.number);
        }
        names
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
    fn flat_nodes(&mut self, import: Import) -> Result<(Mesh, Vec<Option<usize>>)> {
        let mut used = vec![false; self.nodes.len()];
        self.blocks_of(2).flat_map(|block| &block.nodes).for_each(|&index| used[index] = true);
        let nodes = || self.nodes.iter().zip(&used).filter(|(_, used)| **used).map(|(node, _)| node);
        let positions: Vec<[f64; 3]> = nodes().map(|node| node.position).collect();
        if positions.is_empty() {
            let wrong = format!("there is no triangle and no quadrangle: {}", self.dialect.no_cell);
            return Err(self.cursor.fault_of_file(wrong));
        }
        let plane = Plane::of(&positions).map_err(|off| match nodes().nth(off.index) {
            Some(node) => self.cursor.fault(node.place, format_args!("node {} {}", node.number, off.wrong)),
            None => self.cursor.fault_of_file(off.wrong),
        })?;
        self.plane = plane;
        let place = |node: &Node| self.plane.point(node.position) * import.scale;
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
        let joined = positions.len() - mesh.nodes.len();
        if import.slits && joined > 0 {
            self.notes.push(format!("mesh.merge joined {joined} nodes to others, also across slits"));
        }
        Ok((mesh, numbers))
    }

    /// Adds the cells and their groups, and a note where cells stand twice in the same groups,
    /// maybe in place of others. Returns the number in the file of each cell.
    fn add_cells(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) -> Vec<u64> {
        let mut cell_numbers: HashMap<Cell, usize> = HashMap::new();
        let (mut names, mut repeated) = (Vec::new(), 0);
        for block in self.blocks_of(2) {
            let mut members = Vec::new();
            for (nodes, &name) in block.nodes.chunks_exact(block.shape.nodes).zip(&block.numbers) {
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
                    names.push(name);
                    mesh.cells.len() - 1
                }));
            }
            let listed = members.len();
            sort(&mut members);
            repeated += listed - members.len();
            for &group in block.groups.iter() {
                mesh.groups.entry(self.name(2, group)).or_default().extend(&members);
            }
        }
        mesh.groups.values_mut().for_each(sort);
        if repeated > 0 {
            mesh.notes.push(format!("the mesh file has {repeated} of its cells twice; each counts once"));
        }
        names
    }

    fn add_edges(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) -> Result<()> {
        let sides: HashSet<[usize; 2]> = mesh.cells.iter().flat_map(Cell::edges).collect();
        let mut curves: BTreeMap<String, Vec<[usize; 2]>> = BTreeMap::new();
        for block in self.blocks_of(1) {
            for &group in block.groups.iter() {
                let name = self.name(1, group);
                let is_elementary = group >= ELEMENTARY;
                let lists = if is_elementary { &mut curves } else { &mut mesh.edges };
                let edges = lists.entry(name.clone()).or_default();
                for nodes in block.nodes.chunks_exact(2) {
                    let side = |(a, b)| [[a, b], [b, a]].into_iter().find(|side| sides.contains(side));
                    let edge = numbers[nodes[0]].zip(numbers[nodes[1]]).and_then(side);
                    if is_elementary && edge.is_none() {
                        continue;
                    }
                    edges.push(edge.ok_or_else(|| {
                        let [from, to] = [nodes[0], nodes[1]].map(|index| self.spot(index));
                        self.cursor.fault_of_file(format_args!(
                            "the line from {from} to {to}, of {} {name:?}, is not an edge of a cell",
                            self.dialect.groups[1]
                        ))
                    })?);
                }
            }
        }
        for (name, edges) in curves.into_iter().filter(|(_, edges)| !edges.is_empty()) {
            mesh.edges.entry(name).or_insert(edges);
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
                        let (spot, kind) = (self.spot(index), self.dialect.groups[0]);
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

    /// Adds the sets of nodes: as edges where they consist of whole sides of the boundary, else as
    /// points. Nodes that no cell uses are left out.
    fn add_node_sets(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) {
        if self.node_sets.is_empty() {
            return;
        }
        let border = mesh.border();
        for (name, nodes) in &self.node_sets {
            let members: BTreeSet<usize> = nodes.iter().filter_map(|&index| numbers[index]).collect();
            let is_within = |side: &&[usize; 2]| side.iter().all(|node| members.contains(node));
            let edges: Vec<[usize; 2]> = border.iter().filter(is_within).copied().collect();
            let is_named = mesh.edges.contains_key(name) || mesh.groups.contains_key(name);
            if is_named || members.is_empty() {
                continue;
            }
            if edges.concat().into_iter().collect::<BTreeSet<_>>() == members {
                mesh.edges.insert(name.clone(), edges);
            } else {
                mesh.points.insert(name.clone(), members.into_iter().collect());
            }
        }
    }

    fn name(&self, dimension: usize, group: u64) -> String {
        match self.names.get(&(dimension, group)) {
            Some(name) => name.clone(),
            None => (group & !ELEMENTARY).to_string(),
        }
    }

    /// Describes a node in words.
    fn spot(&self, index: usize) -> String {
        let Node { number, position, .. } = self.nodes[index];
        format!("node {number} at {}", geometry::place(self.plane.point(position)))
    }
}

/// Returns for each place the first place with which it is merged: places within a distance are,
/// and so are chains of them.
fn merged(places: &[Option<Point>], distance: f64) -> Vec<usize> {
    if distance <= 0.0 {
        return (0..places.len()).collect();
    }
    let mut unions = Unions::new(places.len());
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
                    unions.unite(other, index);
                }
            }
        }
        squares.entry([i, j]).or_default().push(index);
    }
    (0..places.len()).map(|index| unions.first(index)).collect()
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
