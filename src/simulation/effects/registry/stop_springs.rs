//! Springs and dashpots between nodes of the plate and the massless tips of compliant stops.

use crate::error::Result;
use crate::partition::Partition;
use crate::simulation::effects::contributions::{Contributions, Link};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::stops::Stop;

/// Adds the stops at the nodes that this process owns.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let tips = ground.tips().filter(|(stop, _)| ground.partition.owns_node(stop.node));
    sum.links.extend(tips.filter_map(|(&Stop { obstacle, node, stiffness, damping }, tip)| {
        Some(Link { body: ground.space.deflection(node)?, tip, obstacle, stiffness, damping })
    }));
    Ok(())
}
