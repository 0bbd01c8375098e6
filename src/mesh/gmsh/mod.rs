//! Meshes from Gmsh: MSH 2.2 and 4.1, text and binary of either byte order.
//!
//! Source: C. Geuzaine and J.-F. Remacle, *Gmsh reference manual*, "MSH file format" and "MSH file format version 2
//! (Legacy)".

mod cursor;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;
use std::rc::Rc;

use super::{Cell, Mesh, Point, quality};
use crate::error::{Error, Result};
use cursor::{Cursor, Encoding};

/// How far from the plane of the others a node may lie, relative to the plate's size.
const FLAT: f64 = 1e-9;

impl Mesh {
    /// Reads a mesh that Gmsh saved: MSH 2.2 or 4.1, text or binary.
    ///
    /// - Triangles and quadrangles become cells, in the order of the file; those that run clockwise are turned over.
    ///   Nodes keep their order; those that no cell uses are dropped. A cell that is repeated, as 2.2 does for each
    ///   of its groups, is one.
    /// - Physical curves become named [`edges`](Mesh::edges), physical surfaces [`groups`](Mesh::groups) of cells,
    ///   physical points named [`points`](Mesh::points). One without a name goes by its number (`"7"`); those of one
    ///   name and kind are one. An edge of the boundary has its cell on the left.
    /// - Curved boundaries are the straight edges between their nodes. Lengths are metres.
    /// - Whole and partitioned files are the same. Parametric coordinates, periodicity, post-processing data and sections
    ///   of other programs are passed over.
    ///
    /// # Errors
    /// [`Error::Io`] for a file that cannot be read. [`Error::Mesh`], with the line or the offset where there is one,
    /// for a file that is not as the format asks; another version; elements of higher order or of volumes; no cell at all;
    /// nodes that are not in one plane of constant z; a physical group that names nothing, or no edge or node of a cell;
    /// what [`Mesh::check`] refuses.
    pub fn load_gmsh(path: impl AsRef<Path>) -> Result<Mesh> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        Mesh::from_gmsh(&bytes, &path.display().to_string())
    }

    /// As [`Mesh::load_gmsh`], from a file's bytes. Whatever they are, the answer is a sound mesh or [`Error::Mesh`].
    pub fn from_gmsh(bytes: &[u8], file_name: &str) -> Result<Mesh> {
        Reader::read(Cursor::new(file_name, bytes))?.mesh()
    }
}

/// Numbers of physical groups of one dimension.
type Groups = Rc<[u64]>;

struct Node {
    number: u64,
    place: usize,
    position: [f64; 3],
}

/// Elements of one shape in the same groups.
struct Block {
    shape: Shape,
    groups: Groups,
    /// Indices of the nodes, element by element.
    nodes: Vec<usize>,
}

/// The elements that a plate has a use for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Shape {
    Point,
    Line,
    Triangle,
    Quadrangle,
}

impl Shape {
    fn new(kind: i64) -> std::result::Result<Shape, String> {
        const SOLID: &str = "a plate is flat: mesh its surfaces only";
        const CURVED: &str = "cells have straight edges: set Mesh.ElementOrder = 1";
        let (name, advice) = match kind {
            15 => return Ok(Shape::Point),
            1 => return Ok(Shape::Line),
            2 => return Ok(Shape::Triangle),
            3 => return Ok(Shape::Quadrangle),
            4 => ("4-node tetrahedron", SOLID),
            5 => ("8-node hexahedron", SOLID),
            6 => ("6-node prism", SOLID),
            7 => ("5-node pyramid", SOLID),
            8 => ("3-node line", CURVED),
            9 => ("6-node triangle", CURVED),
            10 => ("9-node quadrangle", CURVED),
            16 => ("8-node quadrangle", CURVED),
            _ => {
                return Err(format!(
                    "expected a point (15), line (1), triangle (2) or quadrangle (3), found elements of type {kind}"
                ));
            }
        };
        Err(format!("found a {name} (type {kind}); {advice}"))
    }

    fn nodes(self) -> usize {
        match self {
            Shape::Point => 1,
            Shape::Line => 2,
            Shape::Triangle => 3,
            Shape::Quadrangle => 4,
        }
    }

    fn dimension(self) -> usize {
        match self {
            Shape::Point => 0,
            Shape::Line => 1,
            Shape::Triangle | Shape::Quadrangle => 2,
        }
    }
}

/// What the sections say.
struct Reader<'a> {
    cursor: Cursor<'a>,
    /// Names, with their places, by dimension and number.
    names: BTreeMap<(usize, u64), (&'a str, usize)>,
    /// Groups of the entities, by dimension and number.
    entities: HashMap<(usize, i64), Groups>,
    nodes: Vec<Node>,
    /// Indices of the nodes by their numbers.
    indices: HashMap<u64, usize>,
    blocks: Vec<Block>,
}

impl<'a> Reader<'a> {
    fn read(cursor: Cursor<'a>) -> Result<Reader<'a>> {
        let mut reader = Reader {
            cursor,
            names: BTreeMap::new(),
            entities: HashMap::new(),
            nodes: Vec::new(),
            indices: HashMap::new(),
            blocks: Vec::new(),
        };
        let legacy = reader.format()?;
        let mut seen = HashSet::new();
        while let Some((name, place)) = reader.cursor.section()? {
            let parsed = match (name, legacy) {
                ("PhysicalNames", _) => Reader::physical_names,
                ("Nodes", true) => Reader::legacy_nodes,
                ("ParametricNodes", true) => Reader::legacy_parametric_nodes,
                ("Elements", true) => Reader::legacy_elements,
                ("Entities", false) => Reader::entities,
                ("PartitionedEntities", false) => Reader::partitioned_entities,
                ("Nodes", false) => Reader::nodes,
                ("Elements", false) => Reader::elements,
                _ => {
                    reader.cursor.skip_section(name)?;
                    continue;
                }
            };
            if !seen.insert(name) {
                return Err(reader.cursor.fault(place, format_args!("there is a ${name} above already")));
            }
            if reader.cursor.encoding != Encoding::Text {
                reader.cursor.end_line()?;
            }
            parsed(&mut reader)?;
            reader.cursor.end_section(name)?;
        }
        Ok(reader)
    }

    /// Reads `$MeshFormat`, comments before it passed over; whether the version is 2.2.
    fn format(&mut self) -> Result<bool> {
        let cursor = &mut self.cursor;
        loop {
            match cursor.section()? {
                Some(("MeshFormat", _)) => break,
                Some(("Comments", _)) => cursor.skip_section("Comments")?,
                Some((name, place)) => {
                    let text = format!("expected $MeshFormat, as Gmsh's files start, found ${name}");
                    return Err(cursor.fault(place, text));
                }
                None => return Err(cursor.fault_of_file("the file is empty")),
            }
        }
        let place = cursor.place();
        let version: f64 = cursor.word("the version of the format")?;
        let legacy = version == 2.2;
        if !legacy && version != 4.1 {
            let text = format!(
                "version {version} of the format is not supported: save with Mesh.MshFileVersion = 4.1, or 2.2"
            );
            return Err(cursor.fault(place, text));
        }
        let place = cursor.place();
        let binary = match cursor.word("0 for a text file or 1 for a binary one")? {
            0 => false,
            1 => true,
            other => {
                let text = format!("expected 0 for a text file or 1 for a binary one, found {other}");
                return Err(cursor.fault(place, text));
            }
        };
        let place = cursor.place();
        let size: u64 = cursor.word("the size of a number in bytes")?;
        if binary {
            if size != 8 {
                return Err(
                    cursor.fault(place, format_args!("expected numbers of 8 bytes, found {size} bytes"))
                );
            }
            cursor.end_line()?;
            cursor.encoding = Encoding::LittleEndian;
            let place = cursor.place();
            let one = cursor.int("a 1 that tells the order of bytes")?;
            if one == i64::from(1_i32.swap_bytes()) {
                cursor.encoding = Encoding::BigEndian;
            } else if one != 1 {
                let text = format!("expected a 1 that tells the order of bytes, found {one}");
                return Err(cursor.fault(place, text));
            }
        }
        cursor.end_section("MeshFormat")?;
        Ok(legacy)
    }

    /// `$PhysicalNames`: text in every file.
    fn physical_names(&mut self) -> Result<()> {
        for _ in 0..self.cursor.word("the number of physical names")? {
            let dimension: usize = self.cursor.word("the dimension of a physical group")?;
            let number: i64 = self.cursor.word("the number of a physical group")?;
            let place = self.cursor.place();
            let name = self.cursor.quoted("the name of a physical group in double quotes")?;
            if self.names.insert((dimension, number.unsigned_abs()), (name, place)).is_some() {
                let text = format!("{} {number} has a name above already", physical(dimension));
                return Err(self.cursor.fault(place, text));
            }
        }
        Ok(())
    }

    /// `$Entities`: what lies on a curve belongs to the groups of the curve.
    fn entities(&mut self) -> Result<()> {
        self.entities_of(false)
    }

    /// `$PartitionedEntities`: the pieces of the entities, each with the groups of the whole.
    fn partitioned_entities(&mut self) -> Result<()> {
        self.cursor.size("the number of partitions")?;
        let ghosts = self.cursor.size("the number of ghost entities")?;
        for _ in 0..2 * self.cursor.claim(ghosts, "ghost entities", 2)? {
            self.cursor.int("a ghost entity")?;
        }
        self.entities_of(true)
    }

    fn entities_of(&mut self, partitioned: bool) -> Result<()> {
        let mut counts = [0; 4];
        for count in &mut counts {
            *count = self.cursor.size("the number of entities of a dimension")?;
        }
        for (dimension, count) in counts.into_iter().enumerate() {
            for _ in 0..self.cursor.claim(count, "entities", 5)? {
                let number = self.cursor.int("the number of an entity")?;
                if partitioned {
                    self.cursor.int("the dimension of the parent of an entity")?;
                    self.cursor.int("the number of the parent of an entity")?;
                    self.ints("partitions")?;
                }
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    self.cursor.real("the place of an entity")?;
                }
                let mut groups: Vec<_> =
                    self.ints("physical groups")?.into_iter().map(i64::unsigned_abs).collect();
                groups.sort_unstable();
                groups.dedup();
                if dimension > 0 {
                    self.ints("entities of the boundary")?;
                }
                self.entities.insert((dimension, number), groups.into());
            }
        }
        Ok(())
    }

    /// A count and as many ints.
    fn ints(&mut self, things: &str) -> Result<Vec<i64>> {
        let count = self.cursor.size(&format!("the number of {things}"))?;
        let count = self.cursor.claim(count, things, 1)?;
        (0..count).map(|_| self.cursor.int(things)).collect()
    }

    /// `$Nodes` of 4.1: blocks of numbers, then of positions.
    fn nodes(&mut self) -> Result<()> {
        let [blocks, total] = self.block_counts("nodes", 4)?;
        for _ in 0..blocks {
            let dimension = self.cursor.int("the dimension of an entity")?;
            self.cursor.int("the number of an entity")?;
            let parameters =
                if self.cursor.int("0, or 1 for parametric nodes")? == 0 { 0 } else { dimension.clamp(0, 3) };
            let count = self.cursor.size("the number of nodes")?;
            let count = self.cursor.claim(count, "nodes", 4)?;
            let mut numbers = Vec::with_capacity(count);
            for _ in 0..count {
                numbers.push((self.cursor.place(), self.cursor.size("the number of a node")?));
            }
            for (place, number) in numbers {
                let position = self.position()?;
                for _ in 0..parameters {
                    self.cursor.real("a parameter of a node")?;
                }
                self.add_node(Node { number, place, position })?;
            }
        }
        self.require_total("nodes", total, self.nodes.len())
    }

    /// `$Nodes` of 2.2.
    fn legacy_nodes(&mut self) -> Result<()> {
        for _ in 0..self.legacy_count("nodes", 4)? {
            let (place, number) = (self.cursor.place(), self.legacy_number()?);
            let position = self.position()?;
            self.add_node(Node { number, place, position })?;
        }
        Ok(())
    }

    /// `$ParametricNodes` of 2.2: each node with the entity it lies on and its parameters there.
    fn legacy_parametric_nodes(&mut self) -> Result<()> {
        for _ in 0..self.legacy_count("nodes", 6)? {
            let (place, number) = (self.cursor.place(), self.legacy_number()?);
            let position = self.position()?;
            let dimension = self.cursor.int("the dimension of an entity")?;
            self.cursor.int("the number of an entity")?;
            // None for volumes.
            for _ in 0..if (1..=2).contains(&dimension) { dimension } else { 0 } {
                self.cursor.real("a parameter of a node")?;
            }
            self.add_node(Node { number, place, position })?;
        }
        Ok(())
    }

    /// `$Elements` of 4.1: blocks of one shape on one entity.
    fn elements(&mut self) -> Result<()> {
        let [blocks, total] = self.block_counts("elements", 2)?;
        let mut read = 0;
        for _ in 0..blocks {
            let place = self.cursor.place();
            let dimension = self.cursor.int("the dimension of an entity")?;
            let entity = self.cursor.int("the number of an entity")?;
            let shape = self.shape()?;
            if usize::try_from(dimension) != Ok(shape.dimension()) {
                let text = format!("elements of dimension {} on an entity of {dimension}", shape.dimension());
                return Err(self.cursor.fault(place, text));
            }
            let count = self.cursor.size("the number of elements")?;
            let count = self.cursor.claim(count, "elements", 1 + shape.nodes())?;
            let groups = self.entities.get(&(shape.dimension(), entity)).cloned().unwrap_or_default();
            let mut nodes = Vec::with_capacity(count * shape.nodes());
            for _ in 0..count {
                self.cursor.size("the number of an element")?;
                for _ in 0..shape.nodes() {
                    let place = self.cursor.place();
                    let number = self.cursor.size("the number of a node")?;
                    nodes.push(self.index(place, number)?);
                }
            }
            self.blocks.push(Block { shape, groups, nodes });
            read += count;
        }
        self.require_total("elements", total, read)
    }

    /// `$Elements` of 2.2: one by one in text, in runs of one shape in binary.
    fn legacy_elements(&mut self) -> Result<()> {
        let text = self.cursor.encoding == Encoding::Text;
        let mut left = self.legacy_count("elements", 3)?;
        while left > 0 {
            if text {
                self.cursor.int("the number of an element")?;
            }
            let shape = self.shape()?;
            let place = self.cursor.place();
            let run = if text { 1 } else { self.cursor.int("the number of elements that follow")? };
            let run = usize::try_from(run).ok().filter(|run| (1..=left).contains(run));
            let run = run.ok_or_else(|| {
                self.cursor.fault(place, format_args!("expected a run of 1 to {left} elements"))
            })?;
            let tags = self.cursor.int("the number of tags")?;
            for _ in 0..run {
                if !text {
                    self.cursor.int("the number of an element")?;
                }
                // The first tag is the physical group, 0 for none.
                let mut group = 0;
                for tag in 0..tags {
                    let value = self.cursor.int("a tag of an element")?;
                    if tag == 0 {
                        group = value.unsigned_abs();
                    }
                }
                let groups: &[u64] = if group == 0 { &[] } else { &[group] };
                if self.blocks.last().is_none_or(|last| last.shape != shape || *last.groups != *groups) {
                    self.blocks.push(Block { shape, groups: groups.into(), nodes: Vec::new() });
                }
                for _ in 0..shape.nodes() {
                    let place = self.cursor.place();
                    let number = self.legacy_number()?;
                    let index = self.index(place, number)?;
                    self.blocks.last_mut().expect("just pushed").nodes.push(index);
                }
            }
            left -= run;
        }
        Ok(())
    }

    /// The head of `$Nodes` and `$Elements` of 4.1: the numbers of blocks and, over all of them, of things.
    fn block_counts(&mut self, things: &str, numbers: usize) -> Result<[usize; 2]> {
        let blocks = self.cursor.size("the number of blocks")?;
        let blocks = self.cursor.claim(blocks, "blocks", 4)?;
        let total = self.cursor.size(&format!("the number of {things}"))?;
        let total = self.cursor.claim(total, things, numbers)?;
        self.cursor.size("the smallest number")?;
        self.cursor.size("the largest number")?;
        Ok([blocks, total])
    }

    fn require_total(&mut self, things: &str, announced: usize, found: usize) -> Result<()> {
        if announced == found {
            return Ok(());
        }
        let place = self.cursor.place();
        let text = format!("{announced} {things} are announced, but the blocks have {found}");
        Err(self.cursor.fault(place, text))
    }

    /// The head of `$Nodes` and `$Elements` of 2.2: text in every file.
    fn legacy_count(&mut self, things: &str, numbers: usize) -> Result<usize> {
        let count = self.cursor.word(&format!("the number of {things}"))?;
        if self.cursor.encoding != Encoding::Text {
            self.cursor.end_line()?;
        }
        self.cursor.claim(count, things, numbers)
    }

    /// The number of a node in 2.2.
    fn legacy_number(&mut self) -> Result<u64> {
        let place = self.cursor.place();
        let number = self.cursor.int("the number of a node")?;
        u64::try_from(number).map_err(|_| {
            self.cursor.fault(place, format_args!("expected the number of a node, found {number}"))
        })
    }

    fn position(&mut self) -> Result<[f64; 3]> {
        let mut position = [0.0; 3];
        for coordinate in &mut position {
            *coordinate = self.cursor.real("a coordinate of a node")?;
        }
        Ok(position)
    }

    fn add_node(&mut self, node: Node) -> Result<()> {
        if self.indices.insert(node.number, self.nodes.len()).is_some() {
            let text = format!("there is a node {} above already", node.number);
            return Err(self.cursor.fault(node.place, text));
        }
        self.nodes.push(node);
        Ok(())
    }

    fn shape(&mut self) -> Result<Shape> {
        let place = self.cursor.place();
        let kind = self.cursor.int("the type of an element")?;
        Shape::new(kind).map_err(|wrong| self.cursor.fault(place, wrong))
    }

    fn index(&self, place: usize, number: u64) -> Result<usize> {
        let index = self.indices.get(&number).copied();
        index.ok_or_else(|| {
            self.cursor
                .fault(place, format_args!("node {number} of this element is not among the nodes above"))
        })
    }

    /// The mesh of all elements, checked.
    fn mesh(&self) -> Result<Mesh> {
        let (mut mesh, numbers) = self.flat_nodes()?;
        self.add_cells(&mut mesh, &numbers);
        self.add_edges(&mut mesh, &numbers)?;
        self.add_points(&mut mesh, &numbers)?;
        self.require_members()?;
        mesh.check().map_err(|error| self.cursor.fault_of_file(error))?;
        Ok(mesh)
    }

    fn blocks_of(&self, dimension: usize) -> impl Iterator<Item = &Block> + Clone {
        let some = move |block: &&Block| block.shape.dimension() == dimension && !block.nodes.is_empty();
        self.blocks.iter().filter(some)
    }

    /// Checks that each named group has an element. Volumes may lack theirs.
    fn require_members(&self) -> Result<()> {
        let groups = |dimension| {
            self.blocks_of(dimension)
                .flat_map(move |block| block.groups.iter().map(move |&group| (dimension, group)))
        };
        let inhabited: HashSet<(usize, u64)> = (0..=2).flat_map(groups).collect();
        let empty = self
            .names
            .iter()
            .find(|((dimension, group), _)| *dimension <= 2 && !inhabited.contains(&(*dimension, *group)));
        match empty {
            None => Ok(()),
            Some((&(dimension, _), &(name, place))) => {
                let text =
                    format!("{} {name:?} names nothing: no element belongs to it", physical(dimension));
                Err(self.cursor.fault(place, text))
            }
        }
    }

    /// A mesh of the nodes that cells use, and the numbers of all nodes there.
    fn flat_nodes(&self) -> Result<(Mesh, Vec<Option<usize>>)> {
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
        let mut mesh = Mesh::default();
        let number = |(node, used): (&Node, bool)| {
            used.then(|| {
                mesh.nodes.push(Point::new(node.position[0], node.position[1]));
                mesh.nodes.len() - 1
            })
        };
        let numbers = self.nodes.iter().zip(used).map(number).collect();
        Ok((mesh, numbers))
    }

    fn add_cells(&self, mesh: &mut Mesh, numbers: &[Option<usize>]) {
        let mut known: HashMap<Cell, usize> = HashMap::new();
        for block in self.blocks_of(2) {
            let mut members = Vec::new();
            for nodes in block.nodes.chunks_exact(block.shape.nodes()) {
                let mut nodes: Vec<usize> = nodes.iter().filter_map(|&index| numbers[index]).collect();
                let vertices: Vec<Point> = nodes.iter().map(|&node| mesh.nodes[node]).collect();
                if quality::area(&vertices) < 0.0 {
                    nodes[1..].reverse();
                }
                let cell = cell(&nodes);
                // The same cell may start at another node.
                let first = (0..nodes.len()).min_by_key(|&i| nodes[i]).unwrap_or(0);
                nodes.rotate_left(first);
                members.push(*known.entry(self::cell(&nodes)).or_insert_with(|| {
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

    /// A node in words.
    fn spot(&self, index: usize) -> String {
        let Node { number, position: [x, y, _], .. } = self.nodes[index];
        format!("node {number} at ({x}, {y})")
    }
}

/// A physical group's kind in words.
fn physical(dimension: usize) -> &'static str {
    ["physical point", "physical curve", "physical surface"].get(dimension).unwrap_or(&"physical volume")
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
