//! Meshes in input files of Abaqus and CalculiX: nodes, first-order shells or plane elements,
//! lines, and sets.
//!
//! Source: *Abaqus keywords reference guide*, `*NODE`, `*ELEMENT`, `*NSET`, `*ELSET`; G. Dhondt,
//! *CalculiX CrunchiX user's manual*.

use super::cards::{CURVED, Cards, ElementCard, Member};
use super::contents::{Contents, Dialect, Node, SOLID, Shape};
use super::cursor::Cursor;
use crate::error::{Error, Result};

/// Words of the format.
const DIALECT: Dialect = Dialect {
    groups: ["node set", "element set", "element set"],
    no_cell: "expected *ELEMENT cards of shells, such as TYPE=S3 or S4",
};

/// Families of flat elements; the digit that follows is the number of nodes.
const FLAT: [&str; 7] = ["STRI", "S", "CPS", "CPE", "CPEG", "DS", "M3D"];

/// Lines of two nodes, and of three.
const STRAIGHT: [&str; 6] = ["B21", "B23", "B31", "B33", "T2D2", "T3D2"];
const BENT: [&str; 4] = ["B22", "B32", "T2D3", "T3D3"];

/// Families of volumes.
const VOLUMES: [&str; 4] = ["C3D", "SC", "DC3D", "COH3D"];

/// Cards that change the nodes and elements of others, with the remedy.
const REFUSED: [(&str, &str); 8] = [
    ("INCLUDE", "reads another file: put its lines in place of the card"),
    ("NGEN", WRITTEN_OUT),
    ("NFILL", WRITTEN_OUT),
    ("NCOPY", WRITTEN_OUT),
    ("NMAP", WRITTEN_OUT),
    ("ELGEN", WRITTEN_OUT),
    ("ELCOPY", WRITTEN_OUT),
    ("SYSTEM", "turns the nodes that follow: expected coordinates without it"),
];
const WRITTEN_OUT: &str = "makes nodes or elements from others: expected all of them, one by one";

/// Cards that need no mention.
const SILENT: [&str; 6] = ["HEADING", "PREPRINT", "ASSEMBLY", "END ASSEMBLY", "END PART", "END INSTANCE"];

/// Reads the contents of a file.
pub fn read(cursor: Cursor) -> Result<Contents> {
    let lines = cursor.lines();
    let mut reader = Reader {
        cards: Cards::new(cursor, &DIALECT),
        task: Task::Strange,
        row: Vec::new(),
        parts: 0,
        instances: 0,
        is_inside: true,
    };
    let mut card: Option<(usize, String)> = None;
    for (place, line) in lines {
        let line = String::from_utf8_lossy(line);
        let line = line.trim();
        if line.is_empty() || line.starts_with("**") {
            continue;
        }
        // A card whose line ends in a comma goes on in the next one.
        let (start, text) = match card.take() {
            Some((start, text)) => (start, text + line),
            None if line.starts_with('*') => (place, line.to_owned()),
            None => {
                reader.data(place, line)?;
                continue;
            }
        };
        if text.ends_with(',') {
            card = Some((start, text));
        } else {
            reader.card(start, &text)?;
        }
    }
    if let Some((place, text)) = card {
        reader.card(place, &text)?;
    }
    reader.end_element()?;
    reader.cards.contents()
}

/// Meaning of the lines that follow a card.
enum Task {
    /// No card has come yet.
    Strange,
    Ignore,
    Nodes {
        set: Option<String>,
    },
    Elements {
        shape: Shape,
        set: Option<String>,
    },
    Set {
        members: Member,
        name: String,
        /// Whether each line is a range.
        is_range: bool,
    },
    Instance,
}

struct Reader<'a> {
    cards: Cards<'a>,
    task: Task,
    /// Numbers of an element whose line goes on, with their places.
    row: Vec<(usize, u64)>,
    parts: usize,
    instances: usize,
    /// Whether nodes and elements belong to the mesh; those of an assembly do not.
    is_inside: bool,
}

impl Reader<'_> {
    fn fault(&self, place: usize, wrong: impl std::fmt::Display) -> Error {
        self.cards.contents.cursor.fault(place, wrong)
    }

    /// Reads the line of a card.
    fn card(&mut self, place: usize, text: &str) -> Result<()> {
        self.end_element()?;
        let mut fields = text.trim_start_matches('*').split(',').map(str::trim);
        let name = fields.next().unwrap_or_default().to_uppercase();
        let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
        let is_plain = |c: char| c.is_ascii_alphanumeric() || " -_".contains(c);
        if name.is_empty() || !name.chars().all(is_plain) {
            let expected = "a card such as *NODE or *ELEMENT";
            return Err(self.cards.contents.cursor.unexpected(place, expected, text.as_bytes()));
        }
        let options = fields.map(|field| {
            let (key, value) = field.split_once('=').unwrap_or((field, ""));
            (key.trim().to_uppercase(), value.trim().trim_matches('"').to_owned())
        });
        let options: Vec<(String, String)> = options.collect();
        let option = |name: &str| options.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone());
        let required = |key: &str| {
            let value = option(key).filter(|value| !value.is_empty());
            value.ok_or_else(|| self.fault(place, format_args!("*{name} has no {key}=; expected its value")))
        };
        if let Some((_, remedy)) = REFUSED.iter().find(|(refused, _)| *refused == name) {
            return Err(self.fault(place, format_args!("*{name} {remedy}")));
        }
        let concerns_mesh = matches!(&*name, "NODE" | "ELEMENT" | "NSET" | "ELSET");
        if concerns_mesh && option("INPUT").is_some() {
            return Err(
                self.fault(place, format_args!("*{name} reads another file: put its lines below the card"))
            );
        }
        let is_of_mesh = self.is_inside || option("INSTANCE").is_some();
        let mut ignored = None;
        self.task = match &*name {
            "NODE" if self.is_inside => {
                if option("SYSTEM").is_some_and(|system| !system.eq_ignore_ascii_case("R")) {
                    return Err(self.fault(place, "*NODE with SYSTEM=: expected Cartesian coordinates"));
                }
                Task::Nodes { set: option("NSET") }
            }
            "ELEMENT" if self.is_inside => {
                let kind = required("TYPE")?.to_uppercase();
                match shape(&kind).map_err(|wrong| self.fault(place, wrong))? {
                    Some(shape) => Task::Elements { shape, set: option("ELSET") },
                    None => {
                        ignored = Some(format!("*ELEMENT of type {kind}"));
                        Task::Ignore
                    }
                }
            }
            "NSET" | "ELSET" if is_of_mesh && option("INTERNAL").is_some() => Task::Ignore,
            "NSET" if is_of_mesh && option("ELSET").is_some() => {
                let wrong = "*NSET with ELSET=: expected the numbers of the nodes";
                return Err(self.fault(place, wrong));
            }
            "NSET" | "ELSET" if is_of_mesh => Task::Set {
                members: if name == "NSET" { Member::Node } else { Member::Element },
                name: required(&name)?,
                is_range: option("GENERATE").is_some(),
            },
            "PART" | "INSTANCE" => {
                let count = if name == "PART" { &mut self.parts } else { &mut self.instances };
                *count += 1;
                if *count > 1 {
                    let wrong = format!("a second *{name}: expected a file of one plate alone");
                    return Err(self.fault(place, wrong));
                }
                self.is_inside = true;
                if name == "PART" { Task::Ignore } else { Task::Instance }
            }
            _ => {
                self.is_inside &= !matches!(&*name, "END PART" | "END INSTANCE");
                ignored = (!SILENT.contains(&&*name)).then(|| format!("*{name}"));
                Task::Ignore
            }
        };
        ignored.iter().for_each(|name| self.cards.ignore(name));
        Ok(())
    }

    /// Reads a line below a card.
    fn data(&mut self, place: usize, line: &str) -> Result<()> {
        let fields: Vec<&str> = line.split(',').map(str::trim).collect();
        match &self.task {
            Task::Ignore => {}
            Task::Strange => {
                let expected = "a card such as *NODE or *ELEMENT";
                return Err(self.cards.contents.cursor.unexpected(place, expected, line.as_bytes()));
            }
            Task::Nodes { set } => {
                let number = self.cards.number(place, fields[0], "the number of a node")?;
                if fields[1..].iter().all(|field| field.is_empty()) {
                    return Err(self.fault(place, format_args!("node {number} has no coordinates")));
                }
                let mut position = [0.0; 3];
                for (x, field) in position.iter_mut().zip(&fields[1..]) {
                    *x = self.cards.coordinate(place, field)?;
                }
                if let Some(set) = set {
                    self.cards.extend_set(Member::Node, set, [number, number, 1], place);
                }
                self.cards.contents.add_node(Node { number, place, position })?;
            }
            Task::Elements { shape, .. } => {
                let count = shape.nodes;
                for field in fields.iter().filter(|field| !field.is_empty()) {
                    let number = self.cards.number(place, field, "the number of an element or a node")?;
                    self.row.push((place, number));
                }
                if self.row.len() > count || !line.ends_with(',') {
                    self.end_element()?;
                }
            }
            Task::Set { members, name, is_range: false } => {
                let (members, name) = (*members, name.clone());
                for field in fields.into_iter().filter(|field| !field.is_empty()) {
                    if let Ok(number) = field.parse() {
                        self.cards.extend_set(members, &name, [number, number, 1], place);
                    } else if !self.cards.join_sets(members, &name, field) {
                        let expected = "a number or the name of a set above";
                        return Err(self.cards.contents.cursor.unexpected(place, expected, field.as_bytes()));
                    }
                }
            }
            Task::Set { members, name, .. } => {
                let numbers = fields.iter().filter(|field| !field.is_empty());
                let numbers = numbers.map(|field| self.cards.number(place, field, "first, last, step"));
                let range = match numbers.collect::<Result<Vec<u64>>>()?[..] {
                    [first, last] if first <= last => [first, last, 1],
                    [first, last, step] if first <= last && step > 0 => [first, last, step],
                    _ => {
                        let expected = "first, last, step of a range that rises";
                        return Err(self.cards.contents.cursor.unexpected(place, expected, line.as_bytes()));
                    }
                };
                self.cards.extend_set(*members, &name.clone(), range, place);
            }
            Task::Instance => {
                for field in &fields {
                    if self.cards.coordinate(place, field)? != 0.0 {
                        return Err(
                            self.fault(place, "*INSTANCE moves its part: expected it where the part is")
                        );
                    }
                }
            }
        }
        Ok(())
    }

    /// Adds the element whose numbers have been read.
    fn end_element(&mut self) -> Result<()> {
        let (Task::Elements { shape, set }, [(place, number), nodes @ ..]) = (&self.task, &self.row[..])
        else {
            return Ok(());
        };
        let (shape, place, number) = (*shape, *place, *number);
        if nodes.len() != shape.nodes {
            let wrong = format!("element {number} has {} nodes; expected {}", nodes.len(), shape.nodes);
            return Err(self.fault(place, wrong));
        }
        let mut corners = [0; 4];
        corners.iter_mut().zip(nodes).for_each(|(corner, (_, node))| *corner = *node);
        self.row.clear();
        if let Some(set) = set {
            self.cards.extend_set(Member::Element, set, [number, number, 1], place);
        }
        self.cards.add_element(ElementCard { number, place, shape, nodes: corners });
        Ok(())
    }
}

/// Returns the shape of elements of a type, `None` for elements that are no part of a mesh.
fn shape(kind: &str) -> std::result::Result<Option<Shape>, String> {
    let is_of = |names: &[&str]| names.iter().any(|name| kind.starts_with(name));
    let nodes = FLAT.iter().find_map(|family| kind.strip_prefix(family)?.chars().next()?.to_digit(10));
    match nodes {
        Some(nodes @ (3 | 4)) => Ok(Some(Shape { dimension: 2, nodes: nodes as usize })),
        Some(_) => Err(format!("found elements of type {kind}; {CURVED} (S3, S4)")),
        None if is_of(&STRAIGHT) => Ok(Some(Shape { dimension: 1, nodes: 2 })),
        None if is_of(&BENT) => Err(format!("found elements of type {kind}; {CURVED} (B31)")),
        None if is_of(&VOLUMES) => Err(format!("found elements of type {kind}; {SOLID}")),
        None => Ok(None),
    }
}
