//! Balls: bodies beside the plate, each on a gap that is a dof of its own.

use crate::error::Result;
use crate::partition::Partition;
use crate::scene::Compliance;
use crate::simulation::effects::contributions::{Body, Contributions, Link, PointEvaluation, PointTerm};
use crate::simulation::effects::ground::BuildContext;

/// Adds all balls. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    for (number, ball) in ground.scene.attachments.balls.iter().enumerate() {
        let term = ground.point_term(&format!("ball.{number}"), ball.at, ball.mass)?;
        let Some((PointTerm { amount, point, spot }, gap)) = term.zip(ground.gaps[number]) else { continue };
        let rides =
            PointEvaluation { free: spot.free.clone().with(gap, 1.0), of_shape: spot.of_shape.clone() };
        let tip = ground.ball_tip(number);
        if let Some((stop, tip)) = ball.compliance.zip(tip) {
            let obstacle = ground.scene.obstacles.len() + number;
            let Compliance { stiffness, damping, .. } = stop;
            sum.links.push(Link { body: gap, tip, obstacle, stiffness, damping });
        }
        sum.bodies.push(Body {
            number,
            spot,
            mass: PointTerm { amount, point, spot: rides },
            gap,
            tip,
            start: [ball.height, ball.velocity],
        });
    }
    Ok(())
}
