//! Tables `[[obstacle]]`: heights, and the regions that can touch them.

use super::column;
use super::quantities::{AREA_DAMPING, AREA_STOP, HEIGHT, LINE_DAMPING, LINE_STOP, POINT_DAMPING, SPRING};
use super::region::{self, AT, GROUP, LINE, POINT, WHERE};
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::typed::Quantity;
use crate::scene::{Compliance, Obstacle, Region, Side};

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
        key(
            "stiffness",
            ValueKind::Number(&AREA_STOP),
            "compliant stop: N/m at a point, N/m2 along a line, N/m3 otherwise; default rigid",
        ),
        key("damping", ValueKind::Number(&AREA_DAMPING), "compliant stop: N s/m, N s/m2, N s/m3; default 0"),
    ]],
    needed: &["side", "height"],
    one_of: &[],
};

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
            compliance: compliance(doc, &table, units(&region))?,
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

/// Returns the quantities of stiffness and damping of a stop opposite to a region.
fn units(region: &Region) -> [&'static Quantity; 2] {
    match region {
        Region::At(_) | Region::Point(_) => [&SPRING, &POINT_DAMPING],
        Region::Line(_) => [&LINE_STOP, &LINE_DAMPING],
        Region::All | Region::Where(_) | Region::Group(_) => [&AREA_STOP, &AREA_DAMPING],
    }
}

/// Reads stiffness and damping of a stop; `None` without stiffness, for a rigid one.
pub(in crate::scene) fn compliance(
    doc: &Document,
    table: &str,
    [of_stiffness, of_damping]: [&Quantity; 2],
) -> Result<Option<Compliance>> {
    let (stiffness, damping) = (format!("{table}.stiffness"), format!("{table}.damping"));
    let Some(value) = doc.optional_number(&stiffness, of_stiffness)? else {
        doc.forbid(&damping, format!("has no use without {stiffness}; expected a stiffness beside it"))?;
        return Ok(None);
    };
    let damping = doc.optional_number(&damping, of_damping)?.unwrap_or(0.0);
    Ok(Some(Compliance { stiffness: value, damping }))
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
