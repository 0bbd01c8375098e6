//! Meshes from Gmsh: MSH 2.0 to 2.2 and 4.1, in text or in binary of either byte order.
//!
//! Source: C. Geuzaine and J.-F. Remacle, *Gmsh reference manual*, "MSH file format" and "MSH file
//! format version 2 (Legacy)".

use std::collections::{HashMap, HashSet};

use super::contents::{Contents, Dialect, ELEMENTARY, Groups, Node, SOLID, Shape};
use super::cursor::{Cursor, Encoding};
use crate::error::Result;

/// Words of the format.
const DIALECT: Dialect = Dialect {
    groups: ["physical point", "physical curve", "physical surface"],
    no_cell: "mesh the surface, and where there are physical groups, put it into one or set Mesh.SaveAll = 1",
};

/// Reads the contents of a file.
pub fn read(cursor: Cursor) -> Result<Contents> {
    cursor.refuse_foreign()?;
    let mut sections = Sections { contents: Contents::new(cursor, &DIALECT), entities: HashMap::new() };
    sections.read()?;
    Ok(sections.contents)
}

/// Returns the shape of elements by their number in the format.
fn shape(kind: i64) -> std::result::Result<Shape, String> {
    const CURVED: &str = "cells have straight edges: set Mesh.ElementOrder = 1";
    let (name, advice) = match kind {
        15 => return Ok(Shape { dimension: 0, nodes: 1 }),
        1 => return Ok(Shape { dimension: 1, nodes: 2 }),
        2 => return Ok(Shape { dimension: 2, nodes: 3 }),
        3 => return Ok(Shape { dimension: 2, nodes: 4 }),
        4 => ("4-node tetrahedron", SOLID),
        5 => ("8-node hexahedron", SOLID),
        6 => ("6-node prism", SOLID),
        7 => ("5-node pyramid", SOLID),
        8 => ("3-node line", CURVED),
        9 => ("6-node triangle", CURVED),
        10 => ("9-node quadrangle", CURVED),
        16 => ("8-node quadrangle", CURVED),
        11 => ("10-node tetrahedron", SOLID),
        12 => ("27-node hexahedron", SOLID),
        17 => ("20-node hexahedron", SOLID),
        20 => ("9-node triangle", CURVED),
        21 => ("10-node triangle", CURVED),
        23 => ("15-node triangle", CURVED),
        26 => ("4-node line", CURVED),
        27 => ("5-node line", CURVED),
        36 => ("16-node quadrangle", CURVED),
        37 => ("25-node quadrangle", CURVED),
        _ => {
            return Err(format!(
                "expected a point (15), line (1), triangle (2) or quadrangle (3), found elements of type {kind}"
            ));
        }
    };
    Err(format!("found a {name} (type {kind}); {advice}"))
}

/// Contents of the sections.
struct Sections<'a> {
    contents: Contents<'a>,
    /// Groups of the entities, by dimension and number.
    entities: HashMap<(usize, i64), Groups>,
}

impl<'a> Sections<'a> {
    fn read(&mut self) -> Result<()> {
        let legacy = self.format()?;
        let mut seen = HashSet::new();
        while let Some((name, place)) = self.contents.cursor.section()? {
            let parse: fn(&mut Sections<'a>) -> Result<()> = match (name, legacy) {
                ("PhysicalNames", _) => Sections::physical_names,
                ("Nodes", true) => |sections| sections.legacy_nodes(false),
                ("ParametricNodes", true) => |sections| sections.legacy_nodes(true),
                ("Elements", true) => Sections::legacy_elements,
                ("Entities", false) => |sections| sections.entities(false),
                ("PartitionedEntities", false) => |sections| sections.entities(true),
                ("Nodes", false) => Sections::nodes,
                ("Elements", false) => Sections::elements,
                _ => {
                    self.contents.cursor.skip_section(name)?;
                    continue;
                }
            };
            if !seen.insert(name) {
                return Err(self
                    .contents
                    .cursor
                    .fault(place, format_args!("there is a ${name} above already")));
            }
            if self.contents.cursor.encoding != Encoding::Text {
                self.contents.cursor.end_line()?;
            }
            parse(self)?;
            self.contents.cursor.end_section(name)?;
        }
        Ok(())
    }

    /// Reads `$MeshFormat`, ignoring comments before it. Returns whether the version is 2.2, or one
    /// before it from 2.0 on, whose sections are the same.
    fn format(&mut self) -> Result<bool> {
        let cursor = &mut self.contents.cursor;
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
        let legacy = (2.0..=2.2).contains(&version);
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

    /// Reads `$PhysicalNames`, which is text in every file. A group without elements may have a
    /// name. Before 2.1 a name may come without a dimension, for all groups of its number.
    fn physical_names(&mut self) -> Result<()> {
        for _ in 0..self.contents.cursor.word("the number of physical names")? {
            let first: i64 = self.contents.cursor.word("the dimension of a physical group")?;
            let (dimensions, number) = if self.contents.cursor.is_before_quote() {
                (0..=2, first)
            } else {
                let number = self.contents.cursor.word("the number of a physical group")?;
                let dimension = usize::try_from(first).unwrap_or(usize::MAX);
                (dimension..=dimension, number)
            };
            let place = self.contents.cursor.place();
            let name = self.contents.cursor.quoted("the name of a physical group in double quotes")?;
            for dimension in dimensions {
                let key = (dimension, number.unsigned_abs());
                if self.contents.names.insert(key, name.to_owned()).is_some() {
                    let kind = DIALECT.groups.get(dimension).unwrap_or(&"physical volume");
                    let text = format!("{kind} {number} has a name above already");
                    return Err(self.contents.cursor.fault(place, text));
                }
            }
        }
        Ok(())
    }

    /// Reads `$Entities`, or `$PartitionedEntities`, the pieces of the entities, each with the
    /// groups of the whole: elements on a curve belong to the groups of the curve, or else to the
    /// curve alone.
    fn entities(&mut self, partitioned: bool) -> Result<()> {
        if partitioned {
            self.contents.cursor.size("the number of partitions")?;
            let ghosts = self.contents.cursor.size("the number of ghost entities")?;
            for _ in 0..2 * self.contents.cursor.claim(ghosts, "ghost entities", 2)? {
                self.contents.cursor.int("a ghost entity")?;
            }
        }
        let counts = (0..4).map(|_| self.contents.cursor.size("the number of entities of a dimension"));
        for (dimension, count) in counts.collect::<Result<Vec<_>>>()?.into_iter().enumerate() {
            for _ in 0..self.contents.cursor.claim(count, "entities", 5)? {
                let number = self.contents.cursor.int("the number of an entity")?;
                let mut whole = (dimension as i64, number);
                if partitioned {
                    whole.0 = self.contents.cursor.int("the dimension of the parent of an entity")?;
                    whole.1 = self.contents.cursor.int("the number of the parent of an entity")?;
                    self.ints("partitions")?;
                }
                for _ in 0..if dimension == 0 { 3 } else { 6 } {
                    self.contents.cursor.real("the place of an entity")?;
                }
                let mut groups: Vec<_> =
                    self.ints("physical groups")?.into_iter().map(i64::unsigned_abs).collect();
                groups.sort_unstable();
                groups.dedup();
                if groups.is_empty() && dimension == 1 && whole.0 == 1 {
                    groups.push(ELEMENTARY | whole.1.unsigned_abs());
                }
                if dimension > 0 {
                    self.ints("entities of the boundary")?;
                }
                self.entities.insert((dimension, number), groups.into());
            }
        }
        Ok(())
    }

    /// Reads a count and as many ints.
    fn ints(&mut self, things: &str) -> Result<Vec<i64>> {
        let count = self.contents.cursor.size(&format!("the number of {things}"))?;
        let count = self.contents.cursor.claim(count, things, 1)?;
        (0..count).map(|_| self.contents.cursor.int(things)).collect()
    }

    /// Reads `$Nodes` of 4.1: blocks of numbers, then of positions.
    fn nodes(&mut self) -> Result<()> {
        let [blocks, total] = self.block_counts("nodes", 4)?;
        for _ in 0..blocks {
            let dimension = self.contents.cursor.int("the dimension of an entity")?;
            self.contents.cursor.int("the number of an entity")?;
            let parameters =
                if self.contents.cursor.int("0, or 1 for parametric nodes")? == 0 { 0 } else { dimension };
            let count = self.contents.cursor.size("the number of nodes")?;
            let count = self.contents.cursor.claim(count, "nodes", 4)?;
            let mut numbers = Vec::with_capacity(count);
            for _ in 0..count {
                numbers
                    .push((self.contents.cursor.place(), self.contents.cursor.size("the number of a node")?));
            }
            for (place, number) in numbers {
                let position = self.position()?;
                self.parameters(parameters)?;
                self.contents.add_node(Node { number, place, position })?;
            }
        }
        self.require_total("nodes", total, self.contents.nodes.len())
    }

    /// Reads `$Nodes` of 2.2, or `$ParametricNodes`: each node with its entity and its parameters
    /// there.
    fn legacy_nodes(&mut self, parametric: bool) -> Result<()> {
        for _ in 0..self.legacy_count("nodes", if parametric { 6 } else { 4 })? {
            let (place, number) = (self.contents.cursor.place(), self.legacy_number()?);
            let position = self.position()?;
            if parametric {
                let dimension = self.contents.cursor.int("the dimension of an entity")?;
                self.contents.cursor.int("the number of an entity")?;
                // A volume has no parameters.
                self.parameters(if dimension > 2 { 0 } else { dimension })?;
            }
            self.contents.add_node(Node { number, place, position })?;
        }
        Ok(())
    }

    /// Reads the parameters of a node on an entity of some dimension.
    fn parameters(&mut self, dimension: i64) -> Result<()> {
        (0..dimension.clamp(0, 3))
            .try_for_each(|_| self.contents.cursor.real("a parameter of a node").map(drop))
    }

    /// Reads `$Elements` of 4.1: blocks of one shape on one entity.
    fn elements(&mut self) -> Result<()> {
        let [blocks, total] = self.block_counts("elements", 2)?;
        let mut read = 0;
        for _ in 0..blocks {
            let place = self.contents.cursor.place();
            let dimension = self.contents.cursor.int("the dimension of an entity")?;
            let entity = self.contents.cursor.int("the number of an entity")?;
            let shape = self.shape()?;
            if usize::try_from(dimension) != Ok(shape.dimension) {
                let text = format!("elements of dimension {} on an entity of {dimension}", shape.dimension);
                return Err(self.contents.cursor.fault(place, text));
            }
            let count = self.contents.cursor.size("the number of elements")?;
            let count = self.contents.cursor.claim(count, "elements", 1 + shape.nodes)?;
            let groups = self.entities.get(&(shape.dimension, entity)).cloned().unwrap_or_default();
            for _ in 0..count {
                let number = self.contents.cursor.size("the number of an element")?;
                self.contents.begin_element(shape, &groups, number);
                for _ in 0..shape.nodes {
                    let place = self.contents.cursor.place();
                    let node = self.contents.cursor.size("the number of a node")?;
                    self.contents.add_corner(place, node)?;
                }
            }
            read += count;
        }
        self.require_total("elements", total, read)
    }

    /// Reads `$Elements` of 2.2: one by one in text, in runs of one shape in binary.
    fn legacy_elements(&mut self) -> Result<()> {
        let text = self.contents.cursor.encoding == Encoding::Text;
        let mut rest = self.legacy_count("elements", 3)?;
        while rest > 0 {
            let mut number = if text { self.contents.cursor.int("the number of an element")? } else { 0 };
            let shape = self.shape()?;
            let place = self.contents.cursor.place();
            let run =
                if text { 1 } else { self.contents.cursor.int("the number of elements that follow")? };
            let run = usize::try_from(run).ok().filter(|run| (1..=rest).contains(run));
            let run = run.ok_or_else(|| {
                self.contents.cursor.fault(place, format_args!("expected a run of 1 to {rest} elements"))
            })?;
            let tags = self.contents.cursor.int("the number of tags")?;
            for _ in 0..run {
                if !text {
                    number = self.contents.cursor.int("the number of an element")?;
                }
                // The first tag is the physical group, 0 for none; the second is the entity.
                let mut group = 0;
                for tag in 0..tags {
                    let value = self.contents.cursor.int("a tag of an element")?.unsigned_abs();
                    if tag == 0 {
                        group = value;
                    } else if tag == 1 && group == 0 && shape.dimension == 1 {
                        group = ELEMENTARY | value;
                    }
                }
                let groups: &[u64] = if group == 0 { &[] } else { &[group] };
                self.contents.begin_element(shape, groups, number.unsigned_abs());
                for _ in 0..shape.nodes {
                    let place = self.contents.cursor.place();
                    let node = self.legacy_number()?;
                    self.contents.add_corner(place, node)?;
                }
            }
            rest -= run;
        }
        Ok(())
    }

    /// Reads the head of `$Nodes` and `$Elements` of 4.1: the number of blocks, and the number of
    /// things in all of them.
    fn block_counts(&mut self, things: &str, numbers: usize) -> Result<[usize; 2]> {
        let blocks = self.contents.cursor.size("the number of blocks")?;
        let blocks = self.contents.cursor.claim(blocks, "blocks", 4)?;
        let total = self.contents.cursor.size(&format!("the number of {things}"))?;
        let total = self.contents.cursor.claim(total, things, numbers)?;
        self.contents.cursor.size("the smallest number")?;
        self.contents.cursor.size("the largest number")?;
        Ok([blocks, total])
    }

    fn require_total(&mut self, things: &str, announced: usize, read: usize) -> Result<()> {
        if announced == read {
            return Ok(());
        }
        let place = self.contents.cursor.place();
        let text = format!("{announced} {things} are announced, but the blocks have {read}");
        Err(self.contents.cursor.fault(place, text))
    }

    /// Reads the head of `$Nodes` and `$Elements` of 2.2, which is text in every file.
    fn legacy_count(&mut self, things: &str, numbers: usize) -> Result<usize> {
        let count = self.contents.cursor.word(&format!("the number of {things}"))?;
        if self.contents.cursor.encoding != Encoding::Text {
            self.contents.cursor.end_line()?;
        }
        self.contents.cursor.claim(count, things, numbers)
    }

    /// Reads the number of a node in 2.2.
    fn legacy_number(&mut self) -> Result<u64> {
        let place = self.contents.cursor.place();
        let number = self.contents.cursor.int("the number of a node")?;
        u64::try_from(number).map_err(|_| {
            self.contents.cursor.fault(place, format_args!("expected the number of a node, found {number}"))
        })
    }

    fn position(&mut self) -> Result<[f64; 3]> {
        let mut position = [0.0; 3];
        for coordinate in &mut position {
            *coordinate = self.contents.cursor.real("a coordinate of a node")?;
        }
        Ok(position)
    }

    fn shape(&mut self) -> Result<Shape> {
        let place = self.contents.cursor.place();
        let kind = self.contents.cursor.int("the type of an element")?;
        shape(kind).map_err(|wrong| self.contents.cursor.fault(place, wrong))
    }
}
