//! Spaces of the displacement in the plane.

use crate::dof_map::{DofMap, NodeConstraint, Support};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use nalgebra::{DMatrix, RowVector3};

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

/// Returns the spaces of the components along x and y. Rigid motions that no support holds, and
/// that no strain sees, are left out.
///
/// # Errors
/// Returns [`Error::Scene`] where the component normal to an oblique side is to be held.
pub fn spaces(mesh: &Mesh, supports: &[InPlaneSupport]) -> Result<[DofMap; 2]> {
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
    fix_rigid_motions(mesh, &mut holds);
    Ok(holds.each_ref().map(|holds| DofMap::of(holds)))
}

/// Holds the rigid motions that are left at the first free node.
fn fix_rigid_motions(mesh: &Mesh, holds: &mut [Vec<NodeConstraint>; 2]) {
    let centre = mesh.nodes[0];
    let size = mesh.nodes.iter().fold(f64::MIN_POSITIVE, |size, node| size.max((node - centre).norm()));
    // Displacement of a node under a motion (a, b, c): (a - c y, b + c x), in parts of the size.
    let row = |component: usize, node: usize| {
        let arm = (mesh.nodes[node] - centre) / size;
        if component == 0 { RowVector3::new(1.0, 0.0, -arm.y) } else { RowVector3::new(0.0, 1.0, arm.x) }
    };
    let mut sum = nalgebra::Matrix3::zeros();
    for (component, holds) in holds.iter().enumerate() {
        for (node, _) in holds.iter().enumerate().filter(|(_, hold)| hold.is_any()) {
            let row = row(component, node);
            sum += row.tr_mul(&row);
        }
    }
    let rank = |matrix: nalgebra::Matrix3<f64>| {
        DMatrix::from_column_slice(3, 3, matrix.as_slice()).rank(NONE * matrix.norm().max(1.0))
    };
    let free = |node: &usize| holds.iter().all(|holds| !holds[*node].is_any());
    let Some(node) = (0..mesh.nodes.len()).find(free) else { return };
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
}
