//! Table `[load]`: pressure, gravity and point forces.

use super::quantities::{FORCE, GRAVITY, PRESSURE};
use super::region::PlaceReader;
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::{FieldInput, Force, Load};

pub(super) fn read(doc: &Document, places: &PlaceReader) -> Result<Option<Load>> {
    doc.allow("load", &["pressure", "gravity", "force"])?;
    if doc.get("load").is_none() {
        return Ok(None);
    }
    let gravity = doc.optional_number("load.gravity", &GRAVITY)?;
    let force = |index: usize| {
        let table = format!("load.force.{index}");
        doc.allow(&table, &["at", "point", "value"])?;
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
