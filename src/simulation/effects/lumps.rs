//! Springs, masses and balls, each at a point of the plate.

use super::ground::PointEvaluation;
use crate::mesh::Point;
use crate::scene;

/// Spring (N/m) or mass (kg) at a point.
pub(super) struct LumpedMass {
    pub amount: f64,
    pub at: Point,
    pub spot: PointEvaluation,
}

/// Ball, with its dofs.
pub(super) struct AttachedBall<'s> {
    /// Index of the ball in the scene.
    pub number: usize,
    pub ball: &'s scene::Ball,
    /// Point of the plate under the ball.
    pub spot: PointEvaluation,
    /// Dof of the gap, i.e. of the height of the ball over the plate.
    pub gap: usize,
    /// Dof of the tip that touches the plate, for a ball on a spring.
    pub tip: Option<usize>,
}
