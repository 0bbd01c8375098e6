//! Tables `[[foundation]]`, `[[spring]]`, `[[mass]]` and `[[ball]]`: objects beside the plate that
//! bear, hold, load or hit it.

use super::quantities::{FOUNDATION, HEIGHT, MASS, SPRING, VELOCITY};
use super::region::{self, PlaceReader};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::{Ball, Foundation, PointMass, Side, Spring};

/// Reads the tables `[[name]]`, which take these keys and need those in `needs`; `read` gets the
/// path of one table.
fn read_tables<T>(
    doc: &Document,
    name: &str,
    needs: &str,
    keys: &[&str],
    read: impl Fn(&str) -> Result<T>,
) -> Result<Vec<T>> {
    let table = |index: usize| {
        let table = format!("{name}.{index}");
        doc.allow(&table, keys)?;
        read(&table)
    };
    let count = doc.entries(name, &format!("expected tables [[{name}]] with {needs}"))?;
    (0..count).map(table).collect()
}

pub(super) fn read_foundations(doc: &Document) -> Result<Vec<Foundation>> {
    read_tables(doc, "foundation", "stiffness", &["stiffness", "where", "group"], |table| {
        Ok(Foundation {
            stiffness: doc.needed(&format!("{table}.stiffness"), &FOUNDATION, Names::XY)?,
            region: region::read(doc, table, &["where", "group"])?,
        })
    })
}

pub(super) fn read_springs(doc: &Document, places: &PlaceReader) -> Result<Vec<Spring>> {
    read_tables(doc, "spring", "at and stiffness", &["at", "point", "stiffness"], |table| {
        let (at, point) = places.read(doc, table)?;
        Ok(Spring { at, point, stiffness: doc.number(&format!("{table}.stiffness"), &SPRING)? })
    })
}

pub(super) fn read_masses(doc: &Document, places: &PlaceReader) -> Result<Vec<PointMass>> {
    read_tables(doc, "mass", "at and mass", &["at", "point", "mass"], |table| {
        let (at, point) = places.read(doc, table)?;
        Ok(PointMass { at, point, mass: doc.number(&format!("{table}.mass"), &MASS)? })
    })
}

pub(super) fn read_balls(doc: &Document, places: &PlaceReader) -> Result<Vec<Ball>> {
    let keys = ["at", "point", "side", "mass", "height", "velocity"];
    read_tables(doc, "ball", "at, mass and height", &keys, |table| {
        let key = |name: &str| format!("{table}.{name}");
        let (at, point) = places.read(doc, table)?;
        Ok(Ball {
            at,
            point,
            side: doc.optional_choice(&key("side"))?.unwrap_or(Side::Above),
            mass: doc.number(&key("mass"), &MASS)?,
            height: doc.number(&key("height"), &HEIGHT)?,
            velocity: doc.optional_number(&key("velocity"), &VELOCITY)?.unwrap_or(0.0),
        })
    })
}
