//! Table `[load]`: pressure, gravity and point forces.

use super::quantities::{FORCE, GRAVITY, PRESSURE};
use super::region::{AT, AT_OR_POINT, POINT, PlaceReader};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key};
use crate::scene::{FieldInput, Force, Load};

pub(super) static LOAD: TableKeys = TableKeys::optional(&[&[
    key(
        "pressure",
        ValueKind::Field(&PRESSURE, Names::XYT),
        "Pa, upward: a number, a formula of x, y, t, or a table",
    ),
    key("gravity", ValueKind::Number(&GRAVITY), "m/s2, downward; default 0"),
    key("force", ValueKind::Tables(&POINT_FORCE), "point forces"),
]]);

static POINT_FORCE: TableKeys = TableKeys {
    groups: &[&[
        AT,
        POINT,
        key("value", ValueKind::Field(&FORCE, Names::T), "N, upward: a number, a formula of t, or a table"),
    ]],
    needed: &["value"],
    one_of: AT_OR_POINT,
};

pub(super) fn read(doc: &Document, places: &PlaceReader) -> Result<Option<Load>> {
    doc.allow("load", &LOAD)?;
    if doc.get("load").is_none() {
        return Ok(None);
    }
    let gravity = doc.optional_number("load.gravity", &GRAVITY)?;
    let force = |index: usize| {
        let table = format!("load.force.{index}");
        doc.allow(&table, &POINT_FORCE)?;
        let (at, point) = places.read(doc, &table)?;
        Ok(Force { at, point, value: doc.needed(&format!("{table}.value"), &FORCE, Names::T)? })
    };
    let count = doc.entries("load.force", "expected tables [[load.force]] with at and value")?;
    let forces: Vec<Force> = (0..count).map(force).collect::<Result<_>>()?;
    let pressure = if gravity.is_some() || !forces.is_empty() {
        doc.given("load.pressure", &PRESSURE, Names::XYT)?
            .unwrap_or(FieldInput::constant("load.pressure", 0.0))
    } else {
        doc.needed("load.pressure", &PRESSURE, Names::XYT)?
    };
    Ok(Some(Load { pressure, gravity: gravity.unwrap_or(0.0), forces }))
}
