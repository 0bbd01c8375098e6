//! Tables `[[obstacle]]`: heights, and the regions that can touch them.

use super::quantities::HEIGHT;
use super::region;
use crate::error::Result;
use crate::field::Names;
use crate::scene::document::Document;
use crate::scene::{Obstacle, Region, Side};

pub(super) fn read(doc: &Document) -> Result<Vec<Obstacle>> {
    let mut obstacles: Vec<Obstacle> = Vec::new();
    for index in 0..doc.entries("obstacle", "expected tables [[obstacle]] with side and height")? {
        let table = format!("obstacle.{index}");
        doc.allow(&table, &["side", "height", "where", "group", "at", "point", "line"])?;
        let (side, height) = (format!("{table}.side"), format!("{table}.height"));
        let obstacle = Obstacle {
            side: doc.choice(&side)?,
            height: doc.needed(&height, &HEIGHT, Names::XYT)?,
            region: region::read(doc, &table, &["where", "group", "at", "point", "line"])?,
        };
        let same = |other: &&Obstacle| other.side == obstacle.side && other.region == Region::All;
        if obstacle.region == Region::All
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

/// Returns the heights of two planes on opposite sides that leave no room for the plate.
fn no_room(one: &Obstacle, other: &Obstacle) -> Option<[f64; 2]> {
    let all = one.region == Region::All && other.region == Region::All;
    let heights = [one.height.number()?, other.height.number()?];
    let crossed = match one.side {
        Side::Below => heights[0] > heights[1],
        Side::Above => heights[0] < heights[1],
    };
    (all && one.side != other.side && crossed).then_some(heights)
}
