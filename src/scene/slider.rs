//! Tables `[[slider]]`: dry friction against the deflection of a node.

use super::attachments::read_tables;
use super::document::Document;
use super::keys::{TableKeys, ValueKind, key};
use super::read::column;
use super::read::quantities::{FRICTION, SPRING};
use super::read::region::{AT, AT_OR_POINT, POINT, PlaceReader};
use super::toml_text::{Row, name, number, place};
use crate::contact_law;
use crate::error::Result;

/// Dry friction of a given normal force at a node, behind a spring or directly.
#[derive(Debug, Clone, PartialEq)]
pub struct Slider {
    /// Name, under which its force is reported.
    pub name: Option<String>,
    /// Coordinates in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Force at which it slips, in N.
    pub force: f64,
    /// Stiffness of its spring, in N/m; `None` where it sits on the plate itself.
    pub stiffness: Option<f64>,
}

pub(super) static SLIDER: TableKeys = TableKeys {
    groups: &[&[
        key("name", ValueKind::Text, "name under which its force is reported"),
        AT,
        POINT,
        key("force", ValueKind::Number(&FRICTION), "N, at which it slips"),
        key(
            "stiffness",
            ValueKind::Number(&SPRING),
            "N/m, of a spring between slider and plate; default none",
        ),
    ]],
    needed: &["force"],
    one_of: AT_OR_POINT,
};

impl Slider {
    /// Returns its law.
    pub fn law(&self) -> contact_law::Slider {
        contact_law::Slider { force: self.force, stiffness: self.stiffness.unwrap_or(f64::INFINITY) }
    }

    /// Returns its table in a resolved scene.
    pub(super) fn rows(&self) -> Vec<Row> {
        let mut rows = name(self.name.as_ref());
        rows.push(place(&self.at, self.point.as_deref()));
        rows.push(("force", number(self.force), "N, at which it slips"));
        rows.extend(self.stiffness.map(|stiffness| ("stiffness", number(stiffness), "N/m")));
        rows
    }
}

pub(super) fn read(doc: &Document, places: &PlaceReader) -> Result<Vec<Slider>> {
    read_tables(doc, "slider", "at and force", &SLIDER, |table| {
        let (at, point) = places.read(doc, table)?;
        Ok(Slider {
            name: column::optional(doc, &format!("{table}.name"))?,
            at,
            point,
            force: doc.number(&format!("{table}.force"), &FRICTION)?,
            stiffness: doc.optional_number(&format!("{table}.stiffness"), &SPRING)?,
        })
    })
}
