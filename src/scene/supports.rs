//! Tables `[[support]]`: edges and points that are held, at rest or in motion.

use super::column::column;
use super::document::{Document, join};
use super::entry::{Kind, table, via};
use super::given::FieldInput;
use super::kinds::{condition, name, not_negative, number, positive, tag, word};
use super::place::{coordinates, point_name};
use super::words::Choice;
use super::{InPlaneHold, SupportKind};
use crate::error::Result;
use crate::field::{Condition, Names};
use std::fmt;

table! {
    /// Support of the plate.
    #[derive(Clone, PartialEq)]
    pub struct Support {
        /// Name under which the reactions of this support are reported: columns of `history.csv`,
        /// `forces` in `summary.json`, rows of `reactions.csv`.
        name: Option<String> = column().optional();
        /// Location.
        stand: SupportLocation = via(location, location_keys);
        /// Constrained dofs; springs are constrained only where they do not yield.
        kind: SupportKind,
        /// Springs of an elastic edge.
        elastic: Option<ElasticEdge> = via(held, hold);
        /// Displacement of the support along z, a field of t without jumps, by default 0; not for
        /// `"guided"` supports, nor where the edge has a `stiffness`.
        motion: Option<FieldInput> = number("a deflection", "m").field(Names::T).optional();
        /// Along an edge of a plate with [stretching, a temperature or traction](#in_plane):
        /// `"held"`, `"normal"` to an edge along x or y, or `"free"` in the plane; by default held
        /// where the edge is clamped or simply supported. Points hold nothing in the plane.
        in_plane: Option<InPlaneHold> = word().optional();
    } then moved
}

/// Springs of a support along an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticEdge {
    /// Stiffness against deflection, in N/m2; `None` where the edge cannot deflect.
    pub stiffness: Option<f64>,
    /// Stiffness against rotation about the edge, in N m/rad per metre; 0 where it is free.
    pub rotation: f64,
}

impl fmt::Debug for Support {
    /// Formats all fields but the name, which does not change the motion.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Support { name: _, stand, kind, elastic, motion, in_plane } = self;
        let mut fields = f.debug_struct("Support");
        fields.field("stand", stand).field("kind", kind).field("elastic", elastic);
        fields.field("motion", motion);
        in_plane.iter().for_each(|hold| {
            fields.field("in_plane", hold);
        });
        fields.finish()
    }
}

/// Location of a support.
#[derive(Debug, Clone, PartialEq)]
pub enum SupportLocation {
    /// Edge, or the cell sides on it whose two ends satisfy a condition.
    Edge {
        /// Name of the edge: `left`, `right`, `bottom`, `top`, or a physical group.
        edge: String,
        /// Condition that selects a part of the edge.
        part: Option<Condition>,
    },
    /// Node at these coordinates, in m, and all nodes up to a radius (m) around it.
    At([f64; 2], Option<f64>),
    /// Nodes of a physical group, and all nodes up to a radius (m) around them.
    Point(String, Option<f64>),
}

/// Refuses the motion of a support that leaves the plate free; a motion of 0 is none.
fn moved(mut support: Support, doc: &Document, table: &str) -> Result<Support> {
    if !support.kind.holds_deflection() {
        let wrong = "which leaves the plate free to move";
        doc.forbid(
            &join(table, "motion"),
            format!("contradicts kind = \"{}\", {wrong}", support.kind.word()),
        )?;
    }
    support.motion.take_if(|motion| motion.is_zero());
    Ok(support)
}

table! {
    /// Keys of the location of a support.
    struct LocationKeys {
        /// `"left"`, `"right"`, `"bottom"`, `"top"`, or a physical curve of `mesh.file`.
        edge: Option<String> = edge().optional();
        /// With `edge`: condition on x, y, by default all of it; the support holds the cell sides
        /// at both of whose ends it is true.
        part as "where": Option<Condition> = condition().optional();
        /// `[x, y]`, a point of the plate, which becomes a node.
        at: Option<[f64; 2]> = coordinates().optional();
        /// Physical point of `mesh.file`.
        point: Option<String> = point_name().optional();
        /// With `at` or `point`: radius of a washer, within which all nodes are held; by default
        /// the point alone.
        radius: Option<f64> = positive("a radius", "m").says("m, of a washer").optional();
    } one_of {edge} {at} {point}
}

/// Name of an edge.
fn edge() -> Kind<String> {
    let curve = tag("expected the name of a physical curve");
    let sides = ["left", "right", "bottom", "top"];
    let read = move |doc: &Document, key: &str| match doc.get("mesh.file") {
        Some(_) => (curve.read)(doc, key),
        None => doc.one_of(key, &sides).map(str::to_owned),
    };
    let kind = name("").says("left | right | bottom | top | a physical curve");
    Kind { read: Box::new(read), ..kind }
}

fn location(keys: LocationKeys, doc: &Document, table: &str) -> Result<SupportLocation> {
    let key = |name: &str| join(table, name);
    doc.only_one(table, &["edge", "at", "point"])?;
    let LocationKeys { edge, part, at: node, point, radius } = keys;
    if edge.is_none() {
        doc.forbid(&key("where"), "has no use without edge, of which it takes a part")?;
    }
    match (node, point) {
        (Some(node), _) => Ok(SupportLocation::At(node, radius)),
        (_, Some(point)) => Ok(SupportLocation::Point(point, radius)),
        (None, None) => {
            doc.forbid(&key("radius"), "has no use without at or point, around which it holds the plate")?;
            let edge = edge.map_or_else(|| (self::edge().read)(doc, &key("edge")), Ok)?;
            Ok(SupportLocation::Edge { edge, part })
        }
    }
}

fn location_keys(stand: &SupportLocation) -> LocationKeys {
    let mut keys = LocationKeys { edge: None, part: None, at: None, point: None, radius: None };
    match stand.clone() {
        SupportLocation::Edge { edge, part } => (keys.edge, keys.part) = (Some(edge), part),
        SupportLocation::At(node, radius) => (keys.at, keys.radius) = (Some(node), radius),
        SupportLocation::Point(name, radius) => (keys.point, keys.radius) = (Some(name), radius),
    }
    keys
}

table! {
    /// Constraint of a support, as a scene gives it.
    struct Hold {
        /// `"clamped"`: neither deflection nor slope; `"simply_supported"`: no deflection, free to
        /// rotate; `"guided"`: no slope across the edge (no slope at all at a point), free to
        /// deflect; `"elastic"`: springs along an edge.
        kind: SupportKind = word();
        /// `"elastic"`: force per length and deflection; at least 0. Without this key the edge
        /// cannot deflect.
        stiffness: Option<f64> = not_negative("a stiffness", "N/m2")
            .says("N/m2, against deflection").optional();
        /// `"elastic"`: moment per length and angle of rotation about the edge; at least 0, by
        /// default 0.
        rotation: Option<f64> = not_negative("a stiffness against rotation", "N m/rad/m")
            .says("N m/rad/m, against rotation about the edge").optional();
    }
}

/// Returns the kind of a support, and its springs. An elastic edge that cannot deflect has the
/// constraints of a simply supported edge.
fn held(hold: Hold, doc: &Document, table: &str) -> Result<(SupportKind, Option<ElasticEdge>)> {
    let Hold { kind, stiffness, rotation } = hold;
    let forbid = |names: [&str; 2], wrong: String| {
        names.iter().try_for_each(|name| doc.forbid(&join(table, name), &wrong))
    };
    let wrong = format!("contradicts kind = \"{}\"; expected", kind.word());
    if kind != SupportKind::Elastic {
        forbid(["stiffness", "rotation"], format!("{wrong} \"elastic\""))?;
        return Ok((kind, None));
    }
    forbid(["at", "point"], format!("{wrong} edge, or a [[spring]] at the point"))?;
    let rotation = rotation.unwrap_or(0.0);
    if stiffness.unwrap_or(0.0) == 0.0 && rotation == 0.0 {
        let wrong = "\"elastic\" needs springs; expected stiffness or rotation greater than 0";
        return Err(doc.fault(&join(table, "kind"), wrong));
    }
    let held = stiffness.map_or(SupportKind::SimplySupported, |_| SupportKind::Elastic);
    Ok((held, Some(ElasticEdge { stiffness, rotation })))
}

fn hold((kind, elastic): &(SupportKind, Option<ElasticEdge>)) -> Hold {
    Hold {
        kind: elastic.map_or(*kind, |_| SupportKind::Elastic),
        stiffness: elastic.and_then(|edge| edge.stiffness),
        rotation: elastic.map(|edge| edge.rotation),
    }
}
