//! Places and regions that several tables name: points, lines, conditions and groups.

use super::document::{Document, join, quote};
use super::entry::{self, Entry, Kind, Table, flat, table, via};
use super::given::Region;
use super::kinds::{condition, number, tag};
use super::mesh::MeshTable;
use crate::error::Result;
use crate::field::Condition;
use crate::mesh::Point;
use std::collections::BTreeMap;

/// Point of the plane.
pub(super) fn coordinates() -> Kind<[f64; 2]> {
    number("a coordinate", "m").pair("expected [x, y] in m")
}

/// Physical point of the mesh file.
pub(super) fn point_name() -> Kind<String> {
    tag("expected the name of a physical point")
}

/// Physical surface of the mesh file.
pub(super) fn group() -> Kind<String> {
    tag("expected the name of a physical group")
}

table! {
    /// Keys of a place.
    #[derive(Clone)]
    pub(super) struct PlaceKeys {
        /// `[x, y]` of a point of the plate.
        at: Option<[f64; 2]> = coordinates().optional();
        /// Physical point of `mesh.file` with one node, in place of `at`.
        point: Option<String> = point_name().optional();
    } one_of {at} {point}
}

/// Place on the plate: coordinates, or a named point of its mesh file.
pub(super) fn place() -> Entry<([f64; 2], Option<String>)> {
    via(located, |(place, point)| place_keys(*place, point))
}

pub(super) fn place_keys(place: [f64; 2], point: &Option<String>) -> PlaceKeys {
    PlaceKeys { at: point.is_none().then_some(place), point: point.clone() }
}

/// Returns the coordinates of a place, with the name of its physical point if it has one.
pub(super) fn located(keys: PlaceKeys, doc: &Document, table: &str) -> Result<([f64; 2], Option<String>)> {
    let (at_key, key) = (join(table, "at"), join(table, "point"));
    let Some(name) = keys.point else {
        let point = doc.required(&at_key, &coordinates())?;
        return on_plate(doc, &at_key, point).map(|()| (point, None));
    };
    doc.only_one(table, &["at", "point"])?;
    let points = match doc.points.get() {
        Some(points) => points,
        None => {
            let Some(file) = entry::read::<MeshTable>(doc, "mesh")?.file else {
                return Err(doc.fault(&key, "has no use without mesh.file; expected at = [x, y]"));
            };
            let mesh = file.load()?;
            let places = |nodes: &Vec<usize>| nodes.iter().map(|&node| mesh.nodes[node]).collect();
            let points = mesh.points.iter().map(|(name, nodes)| (name.clone(), places(nodes)));
            let points: BTreeMap<String, Vec<Point>> = points.collect();
            doc.points.get_or_init(|| points)
        }
    };
    match points.get(&name).map(Vec::as_slice) {
        Some(&[place]) => Ok((place.into(), Some(name))),
        Some(places) => {
            let wrong = format!("{} has {} nodes; expected a point with one", quote(&name), places.len());
            Err(doc.fault(&key, wrong))
        }
        None => {
            let others = points.keys().map(String::as_str).collect::<Vec<_>>().join(", ");
            let wrong = format!("the mesh has no point named {}; it has: {others}", quote(&name));
            Err(doc.fault(&key, wrong))
        }
    }
}

/// Refuses a point off the rectangle; where a file gives the shape, any point passes.
pub(super) fn on_plate(doc: &Document, key: &str, [x, y]: [f64; 2]) -> Result<()> {
    if let (None, Some(length), Some(width)) =
        (doc.get("mesh.file"), doc.figure("plate.length"), doc.figure("plate.width"))
        && !((0.0..=length).contains(&x) && (0.0..=width).contains(&y))
    {
        let wrong = format!(
            "[{x:?}, {y:?}] is off the plate; expected x from 0 to {length:?} m, y from 0 to {width:?} m"
        );
        return Err(doc.fault(key, wrong));
    }
    Ok(())
}

table! {
    /// Keys of a part of the plate.
    #[derive(Clone, Default)]
    pub(super) struct CellKeys {
        /// Condition on x, y; by default all of the plate.
        part as "where": Option<Condition> = condition().optional();
        /// Physical surface of `mesh.file`.
        group: Option<String> = group().optional();
    }
}

table! {
    /// Keys of what an obstacle faces.
    #[derive(Clone, Default)]
    pub(super) struct SiteKeys {
        /// Part of the plate.
        cells: CellKeys = flat();
        /// `[x, y]`, a point of the plate, which becomes a node.
        at: Option<[f64; 2]> = coordinates().optional();
        /// Physical point of `mesh.file`.
        point: Option<String> = point_name().optional();
        /// `[[x, y], [x, y]]`, a line segment; nodes are made where it crosses the sides of cells,
        /// and at its ends that lie in the plate.
        line: Option<[[f64; 2]; 2]> = coordinates().pair("expected [[x, y], [x, y]] in m").optional();
    }
}

/// Part of the plate by a condition or a name.
pub(super) fn cells() -> Entry<Region> {
    via(
        |cells: CellKeys, doc, table| {
            region(SiteKeys { cells, ..SiteKeys::default() }, doc, table, CellKeys::keys().names())
        },
        |region| site_keys(region).cells,
    )
}

/// Returns the region that one of the keys `names` gives, or the whole plate without any.
pub(super) fn region(keys: SiteKeys, doc: &Document, table: &str, names: Vec<&str>) -> Result<Region> {
    doc.only_one(table, &names)?;
    let SiteKeys { cells: CellKeys { part, group }, at: node, point, line } = keys;
    let named = part.map(Region::Where).or(group.map(Region::Group)).or(node.map(Region::At));
    Ok(named.or(point.map(Region::Point)).or(line.map(Region::Line)).unwrap_or(Region::All))
}

/// Returns the keys of a region.
pub(super) fn site_keys(region: &Region) -> SiteKeys {
    let mut keys = SiteKeys::default();
    match region.clone() {
        Region::All => {}
        Region::Where(condition) => keys.cells.part = Some(condition),
        Region::Group(name) => keys.cells.group = Some(name),
        Region::At(node) => keys.at = Some(node),
        Region::Point(name) => keys.point = Some(name),
        Region::Line(line) => keys.line = Some(line),
    }
    keys
}
