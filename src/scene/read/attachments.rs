//! Tables `[[foundation]]`, `[[spring]]`, `[[mass]]` and `[[ball]]`: objects beside the plate that
//! bear, hold, load or hit it.

use super::quantities::{FOUNDATION, HEIGHT, MASS, SPRING, VELOCITY};
use super::region::{self, PlaceReader};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::{Ball, Foundation, PointMass, Side, Spring};

pub(super) fn read_foundations(doc: &Document) -> Result<Vec<Foundation>> {
    let foundation = |index: usize| {
        let table = format!("foundation.{index}");
        doc.allow(&table, &["stiffness", "where", "group"])?;
        Ok(Foundation {
            stiffness: doc.needed(&format!("{table}.stiffness"), &FOUNDATION, Names::XY)?,
            region: region::read(doc, &table, &["where", "group"])?,
        })
    };
    let count = doc.entries("foundation", "expected tables [[foundation]] with stiffness")?;
    (0..count).map(foundation).collect()
}

pub(super) fn read_springs(doc: &Document, places: &PlaceReader) -> Result<Vec<Spring>> {
    let spring = |index: usize| {
        let table = format!("spring.{index}");
        doc.allow(&table, &["at", "point", "stiffness"])?;
        let (at, point) = places.read(doc, &table)?;
        Ok(Spring { at, point, stiffness: doc.number(&format!("{table}.stiffness"), &SPRING)? })
    };
    (0..doc.entries("spring", "expected tables [[spring]] with at and stiffness")?).map(spring).collect()
}

pub(super) fn read_masses(doc: &Document, places: &PlaceReader) -> Result<Vec<PointMass>> {
    let mass = |index: usize| {
        let table = format!("mass.{index}");
        doc.allow(&table, &["at", "point", "mass"])?;
        let (at, point) = places.read(doc, &table)?;
        Ok(PointMass { at, point, mass: doc.number(&format!("{table}.mass"), &MASS)? })
    };
    (0..doc.entries("mass", "expected tables [[mass]] with at and mass")?).map(mass).collect()
}

pub(super) fn read_balls(doc: &Document, places: &PlaceReader) -> Result<Vec<Ball>> {
    let ball = |index: usize| {
        let table = format!("ball.{index}");
        doc.allow(&table, &["at", "point", "side", "mass", "height", "velocity"])?;
        let key = |name: &str| format!("{table}.{name}");
        let (at, point) = places.read(doc, &table)?;
        Ok(Ball {
            at,
            point,
            side: doc.optional_choice(&key("side"))?.unwrap_or(Side::Above),
            mass: doc.number(&key("mass"), &MASS)?,
            height: doc.number(&key("height"), &HEIGHT)?,
            velocity: doc.optional_number(&key("velocity"), &VELOCITY)?.unwrap_or(0.0),
        })
    };
    (0..doc.entries("ball", "expected tables [[ball]] with at, mass and height")?).map(ball).collect()
}
