//! Nodes that obstacles with friction face, and the motion of these obstacles in their plane.

use super::ground::BuildContext;
use super::heights::opposites;
use super::motion::Lift;
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::element::quadrature::GAUSS_4;
use crate::error::{Error, Result};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::Sections;
use crate::scene::{FieldInput, Side};
use crate::scheme::{ContactFriction, FrictionalNode, FrictionalSide, PathOfObstacle};
use crate::simulation::DeflectionDof;
use crate::simulation::plate_assembly::PlateAssembly;
use std::collections::BTreeMap;

/// Returns the friction of the obstacles, given the dofs opposite to each and the motions of
/// supports; `None` where none has any. Collective.
///
/// # Errors
/// Returns [`Error::Scene`] where an obstacle with friction shares a side of a node with another
/// one, and the errors of the thickness.
pub(super) fn of_obstacles<P: Partition>(
    ground: &BuildContext<P>,
    opposite: &[Vec<usize>],
    bounded: &[DeflectionDof],
    lifts: &[Lift],
) -> Result<Option<(ContactFriction, Option<String>)>> {
    if ground.scene.frictional_obstacle().is_none() {
        return Ok(None);
    }
    let sections = PlateAssembly::new(ground.scene, ground.mesh, ground.comm())?;
    let arms = arms(ground, &sections)?;
    let facing = nodes(ground, &arms, opposite, bounded);
    let (nodes, points) = ground.comm().all_ok(facing)?;
    let obstacles = ground.scene.obstacles.len();
    let doubt = doubt(ground, &nodes, bounded);
    let of_obstacles = path_of_obstacles(ground, &nodes, points);
    let path = path_with_lifts(of_obstacles, lifts, &nodes, bounded);
    Ok(Some((ContactFriction { nodes, obstacles, path }, doubt)))
}

/// Largest arm of friction relative to the distance of neighbouring nodes at which moments and
/// reactions were found in every step that was tried; from 0.4 on they may have no solution.
const LONGEST_ARM: f64 = 0.25;

/// Returns a warning where moments of friction change the reactions at neighbouring nodes by about
/// as much as they depend on them. Collective.
fn doubt<P: Partition>(
    ground: &BuildContext<P>,
    nodes: &[FrictionalNode],
    bounded: &[DeflectionDof],
) -> Option<String> {
    let length = ground.mesh.shortest_sides();
    let share = |node: &FrictionalNode| {
        let arms = node.sides.iter().flatten().map(|side| side.coefficient * side.arm);
        arms.fold(0.0, f64::max) / length[bounded[node.bound].node]
    };
    let share = ground.comm().all_reduce_max(nodes.iter().map(share).fold(0.0, f64::max));
    (share > LONGEST_ARM).then(|| {
        format!(
            "obstacle.friction: friction times half the thickness is {share:.2} of the distance of two nodes; from about 0.4 \
             on, moments and reactions may have no common solution, and a step fails: take larger cells or a smaller coefficient"
        )
    })
}

/// Returns half the mean thickness of the cells around each node, in m. Collective.
fn arms<P: Partition>(ground: &BuildContext<P>, sections: &PlateAssembly) -> Result<Vec<f64>> {
    let mesh = ground.mesh;
    let sums = || {
        let (mut sums, mut counts) = (vec![0.0; mesh.nodes.len()], vec![0.0; mesh.nodes.len()]);
        for (cell, corners) in mesh.cells.iter().enumerate() {
            for &node in corners.nodes() {
                sums[node] += sections.section(cell, mesh.nodes[node])?.thickness;
                counts[node] += 1.0;
            }
        }
        Ok((sums, counts))
    };
    let (sums, counts) = ground.comm().all_ok(sums())?;
    let [sums, counts] = [ground.partition.sum_at_nodes(&sums)?, ground.partition.sum_at_nodes(&counts)?];
    Ok(sums.into_iter().zip(counts).map(|(sum, count)| 0.5 * sum / count).collect())
}

/// Returns the nodes of this process that obstacles with friction face, and their places.
fn nodes<P: Partition>(
    ground: &BuildContext<P>,
    arms: &[f64],
    opposite: &[Vec<usize>],
    bounded: &[DeflectionDof],
) -> Result<(Vec<FrictionalNode>, Vec<Point>)> {
    let BuildContext { scene, space, partition, .. } = ground;
    let mut facing: BTreeMap<usize, [Vec<usize>; 2]> = BTreeMap::new();
    for (number, faced) in opposites(scene, opposite, bounded).enumerate() {
        for bound in faced.bounds {
            facing.entry(bound).or_default()[usize::from(faced.side == Side::Above)].push(number);
        }
    }
    let coefficient = |obstacle: usize| scene.obstacles[obstacle].positive_friction();
    let (mut nodes, mut points) = (Vec::new(), Vec::new());
    for (bound, sides) in facing {
        if !sides.iter().flatten().any(|obstacle| coefficient(*obstacle).is_some()) {
            continue;
        }
        let DeflectionDof { node, at: [x, y], .. } = bounded[bound];
        let point = Point::new(x, y);
        let arm = arms[node];
        let side = |obstacles: &[usize]| {
            let Some(&obstacle) = obstacles.iter().find(|obstacle| coefficient(**obstacle).is_some()) else {
                return Ok(None);
            };
            if let Some(other) = obstacles.iter().find(|other| **other != obstacle) {
                return Err(Error::Scene(format!(
                    "obstacle.{obstacle}.friction: needs a side of its nodes for itself, and obstacle.{other} is at \
                     ({x}, {y}) too; expected regions that do not overlap (`where`, `group`)"
                )));
            }
            Ok(coefficient(obstacle).map(|coefficient| FrictionalSide { obstacle, coefficient, arm }))
        };
        let slope = |axis: usize| {
            let (dof, factor) = space.dof(PER_NODE * node + axis)?;
            Some((partition.own_dof(dof)?, factor))
        };
        let sides = [side(&sides[0])?, side(&sides[1])?];
        nodes.push(FrictionalNode { bound, slopes: [slope(1), slope(2)], sides });
        points.push(point);
    }
    Ok((nodes, points))
}

/// Returns the paths of the obstacles at some nodes; `None` where all stand still.
fn path_of_obstacles<P: Partition>(
    ground: &BuildContext<P>,
    nodes: &[FrictionalNode],
    points: Vec<Point>,
) -> Option<Box<PathOfObstacle>> {
    let velocities: Vec<Option<[FieldInput; 2]>> =
        ground.scene.obstacles.iter().map(|obstacle| obstacle.velocity.clone()).collect();
    velocities.iter().flatten().flatten().find(|component| !component.is_zero())?;
    let obstacles: Vec<[Option<usize>; 2]> =
        nodes.iter().map(|node| node.sides.map(|side| side.map(|side| side.obstacle))).collect();
    Some(Box::new(move |node: usize, side: usize, [from, to]: [f64; 2]| {
        let velocity = obstacles[node][side].and_then(|obstacle| velocities[obstacle].as_ref());
        let Some(velocity) = velocity else { return Ok([0.0; 2]) };
        let mut path = [0.0; 2];
        for (path, component) in path.iter_mut().zip(velocity) {
            *path = match component.number() {
                Some(constant) => (to - from) * constant,
                None => {
                    let mut sum = 0.0;
                    for (place, weight) in GAUSS_4 {
                        let t = 0.5 * ((from + to) + place * (to - from));
                        sum += weight * component.at(points[node], t)?;
                    }
                    0.5 * (to - from) * sum
                }
            };
        }
        Ok(path)
    }))
}

/// Returns the paths of the obstacles as the plate sees them in the frame of moving supports, whose
/// shape turns its faces; the paths themselves where the plate only moves rigidly.
fn path_with_lifts(
    of_obstacles: Option<Box<PathOfObstacle>>,
    lifts: &[Lift],
    nodes: &[FrictionalNode],
    bounded: &[DeflectionDof],
) -> Option<Box<PathOfObstacle>> {
    // Displacement of the lower and the upper face at a node by a motion of 1 m, dimensionless.
    let of_faces = |lift: &Lift, node: &FrictionalNode| {
        let slopes = [1, 2].map(|component| lift.shape[PER_NODE * bounded[node.bound].node + component]);
        let [below, above] = node.sides.map(|side| side.map_or(0.0, |side| side.arm));
        [below, -above].map(|arm| slopes.map(|slope| arm * slope))
    };
    let faces = |lift: &Lift| nodes.iter().map(|node| of_faces(lift, node)).collect::<Vec<_>>();
    let bent = lifts.iter().filter(|lift| !lift.is_rigid);
    let lifts: Vec<_> = bent.map(|lift| (lift.motion.clone(), faces(lift))).collect();
    if lifts.is_empty() {
        return of_obstacles;
    }
    Some(Box::new(move |node, side, times| {
        let mut path = of_obstacles.as_ref().map_or(Ok([0.0; 2]), |path| path(node, side, times))?;
        for (motion, faces) in &lifts {
            let [from, to] = times.map(|time| motion.at(Point::origin(), time));
            let way = to? - from?;
            path.iter_mut().zip(faces[node][side]).for_each(|(path, face)| *path -= way * face);
        }
        Ok(path)
    }))
}
