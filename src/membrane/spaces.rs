//! Spaces of the displacement in the plane.

use crate::communicator::Communicator;
use crate::dof_map::{NodeConstraint, Support};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use crate::partition::{NodalField, Partition};
use nalgebra::{DMatrix, Matrix3, RowVector3, Vector3};

/// Components of the displacement in the plane that a support along an edge holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InPlaneHold {
    /// Both components.
    Held,
    /// The component normal to the edge.
    Normal,
    /// None.
    Free,
}

/// Support along an edge, in the plane.
#[derive(Debug, Clone, PartialEq)]
pub struct InPlaneSupport {
    /// Key of its table in the scene, for messages.
    pub key: String,
    /// Sides of cells, each by its two nodes.
    pub sides: Vec<[usize; 2]>,
    /// Components that it holds.
    pub hold: InPlaneHold,
}

/// Relative size below which a rigid motion is none.
const NONE: f64 = 1e-9;

/// Spaces of the displacement in the plane.
pub struct Spaces {
    /// Components along x and y, without the rigid motions that no support holds.
    pub components: [NodalField; 2],
    /// Rigid motions that no support holds: translations along x and y and rotation about the
    /// centre, in parts of the size of the plate.
    pub free: Vec<Vector3<f64>>,
    /// First node in the order of x and y, about which the plate turns.
    pub centre: Point,
    /// Largest distance between a node and the centre, in m: the unit of length of rotations.
    pub size: f64,
}

impl Spaces {
    /// Returns the spaces of both components. Rigid motions that no support holds, and that no
    /// strain sees, are left out. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] where the component normal to an oblique side is to be held.
    pub fn new<P: Partition>(mesh: &Mesh, supports: &[InPlaneSupport], partition: &P) -> Result<Spaces> {
        let comm = partition.comm();
        let mut holds = comm.all_ok(holds(mesh, supports))?;
        for holds in &mut holds {
            NodeConstraint::add_up(holds, |nodal| partition.sum_at_nodes(nodal))?;
        }
        let (centre, is_centre) = first_node(mesh, partition)?;
        let size = mesh.nodes.iter().fold(f64::MIN_POSITIVE, |size, node| size.max((node - centre).norm()));
        let size = comm.all_reduce_max(size);
        let free = fix_rigid_motions(mesh, (centre, &is_centre, size), partition, &mut holds);
        Ok(Spaces { components: holds.map(NodalField::new::<P>), free, centre, size })
    }
}

/// Returns the constraints of both components at the nodes by the sides of this process.
fn holds(mesh: &Mesh, supports: &[InPlaneSupport]) -> Result<[Vec<NodeConstraint>; 2]> {
    let mut holds = [(); 2].map(|()| vec![NodeConstraint::default(); mesh.nodes.len()]);
    for InPlaneSupport { key, sides, hold } in supports {
        for &[a, b] in sides {
            let side = (mesh.nodes[b] - mesh.nodes[a]).normalize();
            let components = match hold {
                InPlaneHold::Held => [true, true],
                InPlaneHold::Free => [false, false],
                InPlaneHold::Normal if side.x.abs() <= NONE => [true, false],
                InPlaneHold::Normal if side.y.abs() <= NONE => [false, true],
                InPlaneHold::Normal => {
                    let Point { coords: place, .. } = mesh.nodes[a];
                    return Err(Error::Scene(format!(
                        "{key}.in_plane: \"normal\" at ({}, {}), where the edge is oblique; expected an edge along x or y, \
                         or \"held\"",
                        place.x, place.y
                    )));
                }
            };
            for (holds, _) in holds.iter_mut().zip(components).filter(|(_, is_held)| *is_held) {
                for node in [a, b] {
                    holds[node].add(Support::SimplySupported, Some([side.x, side.y]));
                }
            }
        }
    }
    Ok(holds)
}

/// Returns the place of the first node in the order of x and y, and whether each node of this
/// process is that one. Collective.
///
/// Every mesh of multigrid has this node, the coarsest one too.
fn first_node<P: Partition>(mesh: &Mesh, partition: &P) -> Result<(Point, Vec<bool>)> {
    let order = |a: &Point, b: &Point| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y));
    let nodes = (0..mesh.nodes.len()).filter(|&node| partition.owns_node(node));
    let here = nodes.min_by(|&a, &b| order(&mesh.nodes[a], &mesh.nodes[b]));
    let place = here.map_or([f64::INFINITY; 2], |node| mesh.nodes[node].into());
    let places = partition.comm().all_gather_one(place).into_iter().map(Point::from).enumerate();
    let first = places.min_by(|(_, a), (_, b)| order(a, b));
    let (rank, centre) = first.unwrap_or((0, Point::origin()));
    let mut flags = vec![0.0; mesh.nodes.len()];
    here.filter(|_| rank == partition.comm().rank()).into_iter().for_each(|node| flags[node] = 1.0);
    Ok((centre, partition.sum_at_nodes(&flags)?.into_iter().map(|flag| flag > 0.0).collect()))
}

/// Holds the rigid motions that are left at the centre, and returns them. Collective.
fn fix_rigid_motions<P: Partition>(
    mesh: &Mesh,
    (centre, is_centre, size): (Point, &[bool], f64),
    partition: &P,
    holds: &mut [Vec<NodeConstraint>; 2],
) -> Vec<Vector3<f64>> {
    // Displacement of a node under a motion (a, b, c): (a - c y, b + c x), in parts of the size.
    let row = |component: usize, place: Point| {
        let arm = (place - centre) / size;
        if component == 0 { RowVector3::new(1.0, 0.0, -arm.y) } else { RowVector3::new(0.0, 1.0, arm.x) }
    };
    let mut sum = Matrix3::zeros();
    for (component, holds) in holds.iter().enumerate() {
        let is_held = |&(node, hold): &(usize, &NodeConstraint)| hold.is_any() && partition.owns_node(node);
        for (node, _) in holds.iter().enumerate().filter(is_held) {
            let row = row(component, mesh.nodes[node]);
            sum += row.tr_mul(&row);
        }
    }
    let mut sum = Matrix3::from_column_slice(&partition.comm().all_reduce_sum_slice(sum.as_slice()));
    let eigen = sum.symmetric_eigen();
    let is_free = |value: f64| value <= NONE * sum.norm().max(1.0);
    let motions = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    let motions = motions.filter(|(value, _)| is_free(**value)).map(|(_, motion)| motion.into()).collect();
    let rank = |matrix: Matrix3<f64>| {
        DMatrix::from_column_slice(3, 3, matrix.as_slice()).rank(NONE * matrix.norm().max(1.0))
    };
    let turn = RowVector3::new(0.0, 0.0, 1.0);
    for (row, component, hold) in [
        (row(0, centre), 0, NodeConstraint { deflection: 1.0, slopes: [0.0; 3] }),
        (row(1, centre), 1, NodeConstraint { deflection: 1.0, slopes: [0.0; 3] }),
        (turn, 0, NodeConstraint { deflection: 0.0, slopes: [0.0, 0.0, 1.0] }),
    ] {
        let more = sum + row.tr_mul(&row);
        if rank(more) > rank(sum) {
            sum = more;
            for (held, _) in holds[component].iter_mut().zip(is_centre).filter(|(_, is_centre)| **is_centre) {
                let NodeConstraint { deflection, slopes } = held;
                *deflection += hold.deflection;
                slopes.iter_mut().zip(hold.slopes).for_each(|(sum, slope)| *sum += slope);
            }
        }
    }
    motions
}
