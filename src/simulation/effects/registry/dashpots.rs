//! Dashpots between points of the plate and the ground.

use crate::error::Result;
use crate::partition::Partition;
use crate::simulation::effects::contributions::Contributions;
use crate::simulation::effects::ground::BuildContext;

/// Adds all dashpots. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    for (number, dashpot) in ground.scene.attachments.dashpots.iter().enumerate() {
        sum.dashpots.extend(ground.point_term(&format!("dashpot.{number}"), dashpot.at, dashpot.damping)?);
    }
    Ok(())
}
