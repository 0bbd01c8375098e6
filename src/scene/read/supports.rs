//! Tables `[[support]]`: edges and points that are held, at rest or in motion.

use super::column;
use super::quantities::{DEFLECTION, EDGE_ROTATION, EDGE_SPRING};
use super::region::{AT, POINT, WHERE, name, point};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::typed::Choice;
use crate::scene::{ElasticEdge, FieldInput, Support, SupportKind, SupportLocation};

/// Names of the edges of a rectangle.
const EDGES: [&str; 4] = ["left", "right", "bottom", "top"];

pub(super) static SUPPORT: TableKeys = TableKeys {
    groups: &[&[
        key("name", ValueKind::Text, "name under which its reactions are reported"),
        key("edge", ValueKind::Text, "left, right, bottom, top, or a physical curve of mesh.file"),
        WHERE,
        AT,
        POINT,
        key(
            "kind",
            ValueKind::Word(words::<SupportKind>),
            "what is held: deflection and slope, deflection, slope, or springs",
        ),
        key("stiffness", ValueKind::Number(&EDGE_SPRING), "elastic: N/m2; default: the edge cannot deflect"),
        key("rotation", ValueKind::Number(&EDGE_ROTATION), "elastic: N m/rad per metre; default 0"),
        key(
            "motion",
            ValueKind::Field(&DEFLECTION, Names::T),
            "m, upward: a formula of t without jumps, or a table; default 0",
        ),
    ]],
    needed: &["kind"],
    one_of: &[&["edge"], &["at"], &["point"]],
};

pub(super) fn read(doc: &Document, has_file: bool) -> Result<Vec<Support>> {
    let mut supports: Vec<Support> = Vec::new();
    for index in 0..doc.entries("support", "expected tables [[support]] with edge and kind")? {
        let table = format!("support.{index}");
        doc.allow(&table, &SUPPORT)?;
        let (kind, elastic) = hold(doc, &table)?;
        let key = format!("{table}.motion");
        if !kind.holds_deflection() {
            let kind = kind.word();
            doc.forbid(&key, format!("contradicts kind = \"{kind}\", which leaves the plate free to move"))?;
        }
        let stand = location(doc, &table, has_file)?;
        let support = Support {
            name: column::optional(doc, &format!("{table}.name"))?,
            stand,
            kind,
            elastic,
            motion: motion(doc, &key)?,
        };
        let whole = |support: &Support| matches!(support.stand, SupportLocation::Edge { part: None, .. });
        if let Some(first) =
            supports.iter().position(|earlier| earlier.stand == support.stand && whole(&support))
        {
            let wrong = format!("support.{first} already holds this edge; expected each edge once");
            return Err(doc.fault(&format!("{table}.edge"), wrong));
        }
        supports.push(support);
    }
    Ok(supports)
}

/// Reads what a support holds, and its springs. An elastic edge that cannot deflect holds what a
/// simply supported one holds.
fn hold(doc: &Document, table: &str) -> Result<(SupportKind, Option<ElasticEdge>)> {
    let key = |name: &str| format!("{table}.{name}");
    let kind: SupportKind = doc.choice(&key("kind"))?;
    if kind != SupportKind::Elastic {
        for name in ["stiffness", "rotation"] {
            doc.forbid(&key(name), format!("contradicts kind = \"{}\"; expected \"elastic\"", kind.word()))?;
        }
        return Ok((kind, None));
    }
    for name in ["at", "point"] {
        doc.forbid(
            &key(name),
            "contradicts kind = \"elastic\"; expected edge, or a [[spring]] at the point",
        )?;
    }
    let stiffness = doc.optional_number(&key("stiffness"), &EDGE_SPRING)?;
    let rotation = doc.optional_number(&key("rotation"), &EDGE_ROTATION)?;
    if stiffness.unwrap_or(0.0) == 0.0 && rotation.unwrap_or(0.0) == 0.0 {
        let wrong = "\"elastic\" needs springs; expected stiffness or rotation greater than 0";
        return Err(doc.fault(&key("kind"), wrong));
    }
    let held = stiffness.map_or(SupportKind::SimplySupported, |_| SupportKind::Elastic);
    Ok((held, Some(ElasticEdge { stiffness, rotation: rotation.unwrap_or(0.0) })))
}

fn location(doc: &Document, table: &str, has_file: bool) -> Result<SupportLocation> {
    let key = |name: &str| format!("{table}.{name}");
    let named: Vec<&str> =
        ["edge", "at", "point"].into_iter().filter(|name| doc.get(&key(name)).is_some()).collect();
    if let [first, second, ..] = named[..] {
        let wrong = format!("contradicts {table}.{second}; expected only one of edge, at, point");
        return Err(doc.fault(&key(first), wrong));
    }
    let part = match doc.get(&key("where")) {
        Some(_) if named.first() != Some(&"edge") => {
            return Err(doc.fault(&key("where"), "has no use without edge, of which it takes a part"));
        }
        Some(_) => Some(doc.condition(&key("where"))?),
        None => None,
    };
    match named.first() {
        Some(&"at") => Ok(SupportLocation::At(point(doc, &key("at"))?)),
        Some(&"point") => {
            Ok(SupportLocation::Point(name(doc, &key("point"), "expected the name of a physical point")?))
        }
        _ if has_file => {
            let edge = name(doc, &key("edge"), "expected the name of a physical curve")?;
            Ok(SupportLocation::Edge { edge, part })
        }
        _ => Ok(SupportLocation::Edge { edge: doc.one_of(&key("edge"), &EDGES)?.to_owned(), part }),
    }
}

/// Reads the motion of a support; the cross-checks refuse jumps.
fn motion(doc: &Document, key: &str) -> Result<Option<FieldInput>> {
    Ok(doc.given(key, &DEFLECTION, Names::T)?.filter(|motion| !motion.is_zero()))
}
