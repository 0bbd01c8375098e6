//! Regions and places that several tables name: conditions, groups, points and lines.

use std::cell::OnceCell;
use std::collections::BTreeMap;

use super::quantities::COORDINATE;
use crate::error::Result;
use crate::mesh::Point;
use crate::scene::document::{Document, quote};
use crate::scene::keys::{TableKey, ValueKind, key};
use crate::scene::{MeshFile, PlateSpec, Region};

const COORDINATES: ValueKind = ValueKind::Pair(&ValueKind::Number(&COORDINATE));

/// Key of a place by its coordinates.
pub(in crate::scene) const AT: TableKey = key("at", COORDINATES, "[x, y] in m");

/// Key of a place by its name.
pub(in crate::scene) const POINT: TableKey = key("point", ValueKind::Text, "physical point of mesh.file");

/// Key of a line segment.
pub(in crate::scene) const LINE: TableKey =
    key("line", ValueKind::Pair(&COORDINATES), "[[x, y], [x, y]] in m, a line segment");

/// Key of a part of the plate by a condition.
pub(in crate::scene) const WHERE: TableKey = key(
    "where",
    ValueKind::Condition,
    "condition on x, y, such as \"x > 0.5 and y < 0.2\"; default: all of it",
);

/// Key of a part of the plate by its name.
pub(in crate::scene) const GROUP: TableKey = key("group", ValueKind::Text, "physical surface of mesh.file");

/// Alternatives of a place.
pub(in crate::scene) const AT_OR_POINT: &[&[&str]] = &[&["at"], &["point"]];

/// Reads the region that one of `keys` names (`where`, `group`, `at`, `point`, `line`).
///
/// Without any of them, the region is the whole plate.
pub(in crate::scene) fn read(doc: &Document, table: &str, keys: &[&str]) -> Result<Region> {
    let mut named = keys.iter().filter(|key| doc.get(&format!("{table}.{key}")).is_some());
    let Some(first) = named.next() else { return Ok(Region::All) };
    let key = format!("{table}.{first}");
    if let Some(second) = named.next() {
        let wrong = format!("contradicts {table}.{second}; expected only one of {}", keys.join(", "));
        return Err(doc.fault(&key, wrong));
    }
    Ok(match *first {
        "where" => Region::Where(doc.condition(&key)?),
        "group" => Region::Group(name(doc, &key, "expected the name of a physical group")?),
        "at" => Region::At(point(doc, &key)?),
        "point" => Region::Point(name(doc, &key, "expected the name of a physical point")?),
        _ => {
            doc.pair(&key, "expected [[x, y], [x, y]] in m")?;
            Region::Line([point(doc, &format!("{key}.0"))?, point(doc, &format!("{key}.1"))?])
        }
    })
}

/// Reads a text that is not empty.
pub(in crate::scene) fn name(doc: &Document, key: &str, expected: &str) -> Result<String> {
    let text = doc.optional_text(key, expected)?.ok_or_else(|| doc.missing(key, expected))?;
    if text.trim().is_empty() {
        return Err(doc.fault(key, format!("{} names nothing; {expected}", quote(text))));
    }
    Ok(text.to_owned())
}

/// Reads a point, in m.
pub(in crate::scene) fn point(doc: &Document, key: &str) -> Result<[f64; 2]> {
    doc.pair(key, "expected [x, y] in m")?;
    Ok([doc.number(&format!("{key}.0"), &COORDINATE)?, doc.number(&format!("{key}.1"), &COORDINATE)?])
}

/// Reads a point and checks it against the rectangle, or not at all where a file gives the shape.
fn point_on(doc: &Document, key: &str, plate: &PlateSpec) -> Result<[f64; 2]> {
    let [x, y] = point(doc, key)?;
    let PlateSpec { length, width, .. } = *plate;
    let has_sides = length > 0.0;
    if has_sides && !((0.0..=length).contains(&x) && (0.0..=width).contains(&y)) {
        let wrong = format!(
            "[{x:?}, {y:?}] is off the plate; expected x from 0 to {length:?} m, y from 0 to {width:?} m"
        );
        return Err(doc.fault(key, wrong));
    }
    Ok([x, y])
}

/// Reader of places on the plate: coordinates, or named points of its mesh file.
pub(in crate::scene) struct PlaceReader<'p> {
    plate: &'p PlateSpec,
    file: Option<&'p MeshFile>,
    /// Points of the file, read at the first use.
    points: OnceCell<BTreeMap<String, Vec<Point>>>,
}

impl<'p> PlaceReader<'p> {
    /// Creates the reader of places on a plate, whose mesh `file` gives unless it is a rectangle.
    pub(in crate::scene) fn new(plate: &'p PlateSpec, file: Option<&'p MeshFile>) -> PlaceReader<'p> {
        PlaceReader { plate, file, points: OnceCell::new() }
    }

    /// Reads a point of the plate, in m.
    pub(in crate::scene) fn on_plate(&self, doc: &Document, key: &str) -> Result<[f64; 2]> {
        point_on(doc, key, self.plate)
    }

    /// Returns the coordinates of a table's `at`, or of the single node of its `point` with its
    /// name.
    pub(in crate::scene) fn read(&self, doc: &Document, table: &str) -> Result<([f64; 2], Option<String>)> {
        let (at, key) = (format!("{table}.at"), format!("{table}.point"));
        if doc.get(&key).is_none() {
            return Ok((point_on(doc, &at, self.plate)?, None));
        }
        doc.forbid(&at, format!("contradicts {key}; expected only one of at, point"))?;
        let name = name(doc, &key, "expected the name of a physical point")?;
        let Some(file) = self.file else {
            return Err(doc.fault(&key, "has no use without mesh.file; expected at = [x, y]"));
        };
        let points = match self.points.get() {
            Some(points) => points,
            None => {
                let mesh = file.load()?;
                let places = |nodes: &Vec<usize>| nodes.iter().map(|&node| mesh.nodes[node]).collect();
                let points = mesh.points.iter().map(|(name, nodes)| (name.clone(), places(nodes))).collect();
                self.points.get_or_init(|| points)
            }
        };
        match points.get(&name).map(Vec::as_slice) {
            Some(&[place]) => Ok((place.into(), Some(name))),
            Some(places) => {
                let wrong = format!("{} has {} nodes; expected a point with one", quote(&name), places.len());
                Err(doc.fault(&key, wrong))
            }
            None => {
                let known: Vec<&str> = points.keys().map(String::as_str).collect();
                let wrong =
                    format!("the mesh has no point named {}; it has: {}", quote(&name), known.join(", "));
                Err(doc.fault(&key, wrong))
            }
        }
    }
}
