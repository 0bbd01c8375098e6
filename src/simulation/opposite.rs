//! Heights of the obstacles at the probes, for plots.

use super::meshing;
use super::regions;
use crate::error::Result;
use crate::geometry::Segment;
use crate::mesh::{Mesh, Point};
use crate::scene::{Region, Scene};
use std::collections::BTreeMap;

/// Distance, relative to the coordinates, below which a probe lies at a point or on a line.
const NEAR: f64 = 1e-6;

/// Returns the heights of the fixed obstacles at each probe of the plate, by its name, in m.
///
/// # Errors
/// Returns the errors of reading the mesh and of evaluating formulas.
pub fn opposite(scene: &Scene) -> Result<BTreeMap<String, Vec<f64>>> {
    let is_named = |region: &Region| matches!(region, Region::Group(_) | Region::Point(_));
    let has_names = scene.obstacles.iter().any(|obstacle| is_named(&obstacle.region));
    let mesh = if has_names { Some(meshing::mesh(scene)?) } else { None };
    let mut opposite = BTreeMap::new();
    for probe in scene.output.probes.iter().filter(|probe| probe.ball.is_none()) {
        let point = Point::from(probe.at);
        let mut heights = Vec::new();
        for obstacle in scene.obstacles.iter().filter(|obstacle| !obstacle.height.changes()) {
            if is_in(&obstacle.region, point, mesh.as_ref())? {
                let height = obstacle.height.at(point, 0.0)?;
                if !heights.contains(&height) {
                    heights.push(height);
                }
            }
        }
        opposite.insert(probe.name.clone(), heights);
    }
    Ok(opposite)
}

/// Returns whether a point lies in a region of the plate.
fn is_in(region: &Region, point: Point, mesh: Option<&Mesh>) -> Result<bool> {
    Ok(match region {
        Region::All => true,
        Region::Where(condition) => regions::holds(condition, point, "obstacle")?,
        Region::Group(name) => mesh.is_some_and(|mesh| {
            let members = mesh.groups.get(name);
            members.is_some_and(|members| mesh.cells_at(point).any(|cell| members.contains(&cell)))
        }),
        Region::Point(name) => mesh.is_some_and(|mesh| {
            let nodes = mesh.points.get(name).into_iter().flatten();
            nodes.map(|&node| mesh.nodes[node].into()).any(|place| is_on([place, place], point))
        }),
        Region::At(place) => is_on([*place, *place], point),
        Region::Line(ends) => is_on(*ends, point),
    })
}

/// Returns whether a point lies on the straight line between two ends.
fn is_on(ends: [[f64; 2]; 2], point: Point) -> bool {
    let [from, to] = ends.map(Point::from);
    let scale = [from, to, point].iter().map(|point| point.coords.amax()).fold(0.0, f64::max);
    Segment::new([from, to]).distance(point) <= NEAR * scale
}
