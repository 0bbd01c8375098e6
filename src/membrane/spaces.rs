//! Spaces of the displacement in the plane.

use crate::dof_map::{DofMap, NodeConstraint, Support};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
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
    /// Spaces of the components along x and y, without the rigid motions that no support holds.
    pub maps: [DofMap; 2],
    /// Rigid motions that no support holds: translations along x and y and rotation about the
    /// first node, in parts of the size of the plate.
    pub free: Vec<Vector3<f64>>,
    /// Largest distance between a node and the first node, in m: the unit of length of rotations.
    pub size: f64,
}

/// Returns the spaces of both components. Rigid motions that no support holds, and that no strain
/// sees, are left out.
///
/// # Errors
/// Returns [`Error::Scene`] where the component normal to an oblique side is to be held.
pub fn spaces(mesh: &Mesh, supports: &[InPlaneSupport]) -> Result<Spaces> {
    let nothing = || vec![NodeConstraint::default(); mesh.nodes.len()];
    let mut holds = [nothing(), nothing()];
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
    let centre = mesh.nodes[0];
    let size = mesh.nodes.iter().fold(f64::MIN_POSITIVE, |size, node| size.max((node - centre).norm()));
    let free = fix_rigid_motions(mesh, size, &mut holds);
    Ok(Spaces { maps: holds.each_ref().map(|holds| DofMap::of(holds)), free, size })
}

/// Holds the rigid motions that are left at the first free node, and returns them.
fn fix_rigid_motions(mesh: &Mesh, size: f64, holds: &mut [Vec<NodeConstraint>; 2]) -> Vec<Vector3<f64>> {
    let centre = mesh.nodes[0];
    // Displacement of a node under a motion (a, b, c): (a - c y, b + c x), in parts of the size.
    let row = |component: usize, node: usize| {
        let arm = (mesh.nodes[node] - centre) / size;
        if component == 0 { RowVector3::new(1.0, 0.0, -arm.y) } else { RowVector3::new(0.0, 1.0, arm.x) }
    };
    let mut sum = Matrix3::zeros();
    for (component, holds) in holds.iter().enumerate() {
        for (node, _) in holds.iter().enumerate().filter(|(_, hold)| hold.is_any()) {
            let row = row(component, node);
            sum += row.tr_mul(&row);
        }
    }
    let eigen = sum.symmetric_eigen();
    let is_free = |value: f64| value <= NONE * sum.norm().max(1.0);
    let motions = eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter());
    let motions = motions.filter(|(value, _)| is_free(**value)).map(|(_, motion)| motion.into()).collect();
    let rank = |matrix: Matrix3<f64>| {
        DMatrix::from_column_slice(3, 3, matrix.as_slice()).rank(NONE * matrix.norm().max(1.0))
    };
    let free = |node: &usize| holds.iter().all(|holds| !holds[*node].is_any());
    let Some(node) = (0..mesh.nodes.len()).find(free) else { return motions };
    let turn = RowVector3::new(0.0, 0.0, 1.0);
    for (row, component, hold) in [
        (row(0, node), 0, NodeConstraint { deflection: 1.0, slopes: [0.0; 3] }),
        (row(1, node), 1, NodeConstraint { deflection: 1.0, slopes: [0.0; 3] }),
        (turn, 0, NodeConstraint { deflection: 0.0, slopes: [0.0, 0.0, 1.0] }),
    ] {
        let more = sum + row.tr_mul(&row);
        if rank(more) > rank(sum) {
            sum = more;
            let NodeConstraint { deflection, slopes } = &mut holds[component][node];
            *deflection += hold.deflection;
            slopes.iter_mut().zip(hold.slopes).for_each(|(sum, slope)| *sum += slope);
        }
    }
    motions
}
