//! Tables `[[obstacle]]`: heights, and the regions that can touch them.

use super::column;
use super::quantities::{
    AREA_DAMPING, AREA_STOP, HEIGHT, HERTZ, LINE_DAMPING, LINE_STOP, POINT_DAMPING, SPRING,
};
use super::region::{self, AT, GROUP, LINE, POINT, WHERE};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::keys::{TableKey, TableKeys, ValueKind, key, words};
use crate::scene::typed::Quantity;
use crate::scene::{Compliance, Obstacle, Region, Side, SourcePosition, StopLaw};

pub(super) static OBSTACLE: TableKeys = TableKeys {
    groups: &[&[
        key("name", ValueKind::Text, "name under which its forces are reported"),
        key("side", ValueKind::Word(words::<Side>), "side of the plate on which the obstacle lies"),
        key("height", ValueKind::Field(&HEIGHT, Names::XYT), "m: a number, a formula of x, y, t, or a table"),
        WHERE,
        GROUP,
        AT,
        POINT,
        LINE,
        LAW,
        key(
            "stiffness",
            ValueKind::Number(&AREA_STOP),
            "compliant stop: N/m at a point (N/m^1.5 by Hertz), N/m2 along a line, N/m3 otherwise; default rigid",
        ),
        key("damping", ValueKind::Number(&AREA_DAMPING), "compliant stop: N s/m, N s/m2, N s/m3; default 0"),
    ]],
    needed: &["side", "height"],
    one_of: &[],
};

/// Key of the law of a compliant stop.
pub(in crate::scene) const LAW: TableKey = key(
    "law",
    ValueKind::Word(words::<StopLaw>),
    "law of a compliant stop, that of Hertz at a point only; default linear",
);

/// Keys of the part of the plate that an obstacle faces.
const FACED: [&str; 5] = [WHERE.name, GROUP.name, AT.name, POINT.name, LINE.name];

pub(super) fn read(doc: &Document) -> Result<Vec<Obstacle>> {
    let mut obstacles: Vec<Obstacle> = Vec::new();
    for index in 0..doc.entries("obstacle", "expected tables [[obstacle]] with side and height")? {
        let table = format!("obstacle.{index}");
        doc.allow(&table, &OBSTACLE)?;
        let (side, height) = (format!("{table}.side"), format!("{table}.height"));
        let region = region::read(doc, &table, &FACED)?;
        let obstacle = Obstacle {
            name: column::optional(doc, &format!("{table}.name"))?,
            side: doc.choice(&side)?,
            height: doc.needed(&height, &HEIGHT, Names::XYT)?,
            compliance: compliance(doc, &table, &region)?,
            position: SourcePosition(doc.position(&format!("{table}.law"))),
            region,
        };
        let is_rigid = |of: &Obstacle| of.region == Region::All && of.compliance.is_none();
        let same = |other: &&Obstacle| other.side == obstacle.side && is_rigid(other);
        if is_rigid(&obstacle)
            && let Some(first) = obstacles.iter().position(|other| same(&other))
        {
            let wrong = format!("obstacle.{first} already lies on this side of the whole plate");
            let expected =
                "expected where, group, at, point or line, for an obstacle opposite to a part of it";
            return Err(doc.fault(&side, format!("{wrong}; {expected}")));
        }
        if let Some([own, other]) = obstacles.iter().find_map(|other| no_room(&obstacle, other)) {
            let wrong = format!("{own:?} leaves no room beside the obstacle at {other:?} m");
            return Err(
                doc.fault(&height, format!("{wrong}; expected the one below lower than the one above"))
            );
        }
        obstacles.push(obstacle);
    }
    Ok(obstacles)
}

/// Reads the compliance of a stop opposite to a region; `None` for a rigid one.
fn compliance(doc: &Document, table: &str, region: &Region) -> Result<Option<Compliance>> {
    let units = match region {
        Region::At(_) | Region::Point(_) => return point_compliance(doc, table),
        Region::Line(_) => [&LINE_STOP, &LINE_DAMPING],
        Region::All | Region::Where(_) | Region::Group(_) => [&AREA_STOP, &AREA_DAMPING],
    };
    let law = format!("{table}.law");
    if doc.optional_choice(&law)? == Some(StopLaw::Hertz) {
        let wrong =
            "\"hertz\" is the law of a contact at a point; expected at or point beside it, or \"linear\"";
        return Err(doc.fault(&law, wrong));
    }
    linear(doc, table, units)
}

/// Reads the compliance of an obstacle at a point, or of a ball. A rigid contact has none.
pub(in crate::scene) fn point_compliance(doc: &Document, table: &str) -> Result<Option<Compliance>> {
    if doc.optional_choice(&format!("{table}.law"))? != Some(StopLaw::Hertz) {
        return linear(doc, table, [&SPRING, &POINT_DAMPING]);
    }
    let stiffness = doc.number(&format!("{table}.stiffness"), &HERTZ)?;
    let wrong =
        "has no meaning beside law = \"hertz\", an elastic contact; expected it with law = \"linear\" only";
    doc.forbid(&format!("{table}.damping"), wrong)?;
    Ok(Some(Compliance { law: StopLaw::Hertz, stiffness, damping: 0.0 }))
}

/// Reads stiffness and damping of a linear stop; `None` without stiffness, for a rigid one.
fn linear(
    doc: &Document,
    table: &str,
    [of_stiffness, of_damping]: [&Quantity; 2],
) -> Result<Option<Compliance>> {
    let [law, stiffness, damping] = ["law", "stiffness", "damping"].map(|key| format!("{table}.{key}"));
    let Some(value) = doc.optional_number(&stiffness, of_stiffness)? else {
        for key in [&law, &damping] {
            doc.forbid(key, format!("has no use without {stiffness}; expected a stiffness beside it"))?;
        }
        return Ok(None);
    };
    let damping = doc.optional_number(&damping, of_damping)?.unwrap_or(0.0);
    Ok(Some(Compliance { law: StopLaw::Linear, stiffness: value, damping }))
}

/// Returns the heights of two planes on opposite sides that leave no room for the plate.
fn no_room(one: &Obstacle, other: &Obstacle) -> Option<[f64; 2]> {
    let is_plane = |of: &Obstacle| of.region == Region::All && of.compliance.is_none();
    let all = is_plane(one) && is_plane(other);
    let heights = [one.height.number()?, other.height.number()?];
    let crossed = match one.side {
        Side::Below => heights[0] > heights[1],
        Side::Above => heights[0] < heights[1],
    };
    (all && one.side != other.side && crossed).then_some(heights)
}
