//! Masses at points of the plate.

use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::error::Result;
use crate::partition::Partition;
use crate::simulation::effects::contributions::Contributions;
use crate::simulation::effects::ground::BuildContext;

/// Adds all masses. Collective.
///
/// All cells that contain the point share its mass equally. A mass at a held point does not move;
/// it would only slow the mean motion of the cells, and remains apart.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let comm = ground.comm();
    for (number, mass) in ground.scene.attachments.masses.iter().enumerate() {
        let term = ground.point_term(&format!("mass.{number}"), mass.at, mass.mass)?;
        let is_held = term.as_ref().is_some_and(|term| is_held(&term.spot.of_shape, ground.holds));
        // The one process that evaluates the point decides for all.
        if comm.all_reduce_any(is_held) {
            sum.masses.extend(term);
            continue;
        }
        let point = mass.at.into();
        let around: Vec<usize> = ground.mesh.cells_at(point).collect();
        let share = mass.mass / comm.all_reduce_sum(around.len()) as f64;
        sum.carried.extend(around.into_iter().map(|cell| (cell, point, share)));
    }
    Ok(())
}

/// Returns whether supports hold all dofs of a deflection, given over the dofs of all nodes.
fn is_held(of_shape: &Probe, holds: &[NodeConstraint]) -> bool {
    of_shape.weights().iter().all(|(dof, _)| DofMap::held(&holds[dof / PER_NODE])[dof % PER_NODE])
}
