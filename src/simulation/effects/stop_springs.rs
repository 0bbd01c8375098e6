//! Springs and dashpots between the massless tips of compliant stops and what they touch: a node of
//! the plate, or a ball.

use super::ground::BuildContext;
use super::lumps::AttachedBall;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::linalg::ElementMatrix;
use crate::partition::Partition;
use crate::scene::Compliance;
use crate::simulation::stops::Stop;
use std::collections::HashMap;

/// Springs and dashpots of the compliant stops that this process owns.
pub(super) struct StopSprings {
    springs: Vec<StopSpring>,
    /// First class number for their forms.
    first_class: usize,
}

/// Spring and dashpot between two dofs.
struct StopSpring {
    /// Dof of the node's deflection, or of the gap of a ball.
    body: usize,
    tip: usize,
    /// Stiffness in N/m.
    stiffness: f64,
    /// Damping in N s/m.
    damping: f64,
}

impl StopSprings {
    /// Collects the stops of obstacles and of balls.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        balls: &[AttachedBall],
        first_class: usize,
    ) -> StopSprings {
        let own = ground.tips().filter(|(stop, _)| ground.partition.owns_node(stop.node));
        let at_node = |(&Stop { node, stiffness, damping, .. }, tip): (&Stop, usize)| {
            Some(StopSpring { body: ground.space.deflection(node)?, tip, stiffness, damping })
        };
        let at_ball = |ball: &AttachedBall| {
            let (Compliance { stiffness, damping, .. }, tip) = ball.ball.compliance.zip(ball.tip)?;
            Some(StopSpring { body: ball.gap, tip, stiffness, damping })
        };
        let springs = own.filter_map(at_node).chain(balls.iter().filter_map(at_ball)).collect();
        StopSprings { springs, first_class }
    }

    /// Returns the contributions of the springs to K.
    pub fn stiffness(&self) -> impl Iterator<Item = ElementMatrix> {
        self.forms(|spring| spring.stiffness)
    }

    /// Returns the damping of the stops less what Rayleigh damping by the stiffness, with this
    /// coefficient in s, gives their springs; `None` where both are zero. Collective.
    pub fn dashpots(&self, beta: f64, comm: &impl Communicator) -> Option<Vec<ElementMatrix>> {
        let is_damped = |spring: &StopSpring| spring.damping > 0.0 || beta > 0.0;
        comm.all_reduce_any(self.springs.iter().any(is_damped))
            .then(|| self.forms(|spring| spring.damping - beta * spring.stiffness).collect())
    }

    /// Returns one form per stop. Stops with equal springs and dashpots share a class.
    fn forms(&self, amount: impl Fn(&StopSpring) -> f64) -> impl Iterator<Item = ElementMatrix> {
        let mut classes = HashMap::new();
        self.springs.iter().map(move |spring| {
            let next = self.first_class + classes.len();
            let class = *classes.entry([spring.stiffness, spring.damping].map(f64::to_bits)).or_insert(next);
            Probe::default().with(spring.body, 1.0).with(spring.tip, -1.0).spring(amount(spring), class)
        })
    }
}
