//! Springs between points of the plate and the ground.

use crate::dof_map::{NodeConstraint, PER_NODE};
use crate::error::Result;
use crate::partition::Partition;
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;

/// Adds all springs. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    for (number, spring) in ground.scene.attachments.springs.iter().enumerate() {
        let Some(term) = ground.point_term(&format!("spring.{number}"), spring.at, spring.stiffness)? else {
            continue;
        };
        let dof = term.spot.of_shape.weights().first().map_or(0, |(dof, _)| *dof);
        let hold = NodeConstraint { deflection: 1.0, ..NodeConstraint::default() };
        sum.restraints.push(Restraint { node: dof / PER_NODE, point: term.point, hold });
        sum.springs.push(term);
    }
    Ok(())
}
