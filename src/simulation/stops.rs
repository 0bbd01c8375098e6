//! Linear compliant stops: their springs and dashpots, node by node.
//!
//! A linear compliant obstacle touches the plate through a massless tip at each node opposite to
//! it. The tip is one more dof y, joined to the deflection w of the node by a spring and a dashpot,
//! and bounded by the obstacle in place of w:
//!
//! ```math
//! \tfrac12 k\,(w - y)^2, \qquad c\,(\dot w - \dot y), \qquad y \ge h .
//! ```
//!
//! While the tip is off the obstacle, it follows the node without force. The reaction of the
//! obstacle on the tip is the force of the stop, and h - w, if positive, is the depth to which the
//! stop yields.
//!
//! # Stiffness per node
//!
//! - At points, each node has the k and c of the scene.
//! - Along a line, a node has half the distance to each of its neighbours on the line: all nodes
//!   together have the length from the first node to the last.
//! - Over an area, a node has a share of each cell around it that belongs to the region, i.e. whose
//!   centre satisfies its condition. The share of a triangle is a third; the share of a
//!   quadrilateral is the mean over its two cuts into triangles. All nodes together have the area
//!   of the region's cells.

use super::regions::{NodeSums, cells_in, nodes_of, require};
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::scene::{Compliance, Obstacle, Region, Scene};

/// Tip of a compliant obstacle at a node of this process.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stop {
    /// Index of the obstacle in the scene.
    pub obstacle: usize,
    pub node: usize,
    /// Stiffness between tip and node, in N/m.
    pub stiffness: f64,
    /// Damping between tip and node, in N s/m.
    pub damping: f64,
}

/// Distance of two nodes on a line, relative to its length, below which they are one.
const SAME: f64 = 1e-9;

/// Returns the tips of all linear compliant obstacles at the nodes of this process, owned or not;
/// none where a support holds the deflection. Collective.
pub(super) fn find(
    scene: &Scene,
    mesh: &Mesh,
    holds: &[NodeConstraint],
    comm: &impl Communicator,
    sums: &NodeSums,
) -> Result<Vec<Stop>> {
    let mut stops = Vec::new();
    for (number, obstacle) in scene.obstacles.iter().enumerate() {
        let Some(compliance) = obstacle.compliance.filter(Compliance::has_tip) else { continue };
        let measures = measures(obstacle, mesh, comm, sums, &format!("obstacle.{number}"))?;
        let free = measures.into_iter().filter(|(node, _)| holds[*node].deflection == 0.0);
        stops.extend(free.map(|(node, measure)| Stop {
            obstacle: number,
            node,
            stiffness: compliance.stiffness * measure,
            damping: compliance.damping * measure,
        }));
    }
    Ok(stops)
}

/// Returns the nodes opposite to an obstacle with the length (m) or area (m2) of each, or 1 at
/// points. Collective.
fn measures(
    obstacle: &Obstacle,
    mesh: &Mesh,
    comm: &impl Communicator,
    sums: &NodeSums,
    key: &str,
) -> Result<Vec<(usize, f64)>> {
    let region = &obstacle.region;
    match region {
        Region::At(_) | Region::Point(_) => {
            Ok(nodes_of(region, mesh, comm, sums, key)?.into_iter().map(|node| (node, 1.0)).collect())
        }
        Region::Line(ends) => {
            let nodes = nodes_of(region, mesh, comm, sums, key)?;
            let [from, to] = ends.map(Point::from);
            let along = (to - from).normalize();
            let places: Vec<f64> = nodes.iter().map(|&node| (mesh.nodes[node] - from).dot(&along)).collect();
            let same = SAME * (to - from).norm();
            let mut line = comm.all_gather(&places);
            line.sort_by(f64::total_cmp);
            line.dedup_by(|next, last| *next - *last <= same);
            require(comm, line.len() > 1, || {
                format!("{key}.line: only one node lies on it; expected at for a stop at a point")
            })?;
            let length = |place: f64| {
                let k = line.partition_point(|other| *other < place - same).min(line.len() - 1);
                0.5 * (line[(k + 1).min(line.len() - 1)] - line[k.saturating_sub(1)])
            };
            Ok(nodes.into_iter().zip(places).map(|(node, place)| (node, length(place))).collect())
        }
        Region::All | Region::Where(_) | Region::Group(_) => {
            let mut areas = vec![0.0; mesh.nodes.len()];
            let inside = cells_in(region, mesh, comm, key)?;
            for cell in (0..mesh.cells.len()).filter(|&cell| inside[cell]) {
                let nodes = mesh.cells[cell].nodes();
                nodes.iter().zip(shares(&mesh.vertices(cell))).for_each(|(&node, area)| areas[node] += area);
            }
            let areas = sums(&areas)?.into_iter().enumerate();
            Ok(areas.filter(|(_, area)| *area > 0.0).collect())
        }
    }
}

/// Returns the share of each vertex in the area of a triangle or a convex quadrilateral, in m2.
fn shares(vertices: &[Point]) -> Vec<f64> {
    let third = |a: usize, b: usize, c: usize| {
        let [b, c] = [b, c].map(|k| vertices[k] - vertices[a]);
        (b.x * c.y - b.y * c.x).abs() / 6.0
    };
    match vertices.len() {
        3 => vec![third(0, 1, 2); 3],
        _ => {
            let halves = [third(0, 1, 2), third(0, 2, 3), third(1, 2, 3), third(1, 3, 0)];
            let share = |vertex: usize| {
                let cuts = [[0, 1, 2], [0, 2, 3], [1, 2, 3], [1, 3, 0]].into_iter().zip(halves);
                0.5 * cuts.filter(|(corners, _)| corners.contains(&vertex)).map(|(_, area)| area).sum::<f64>()
            };
            (0..4).map(share).collect()
        }
    }
}
