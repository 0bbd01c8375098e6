//! Forces of obstacles and named supports, as a run reports them.

use serde::{Deserialize, Serialize};

/// Contact with the largest impulse.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HardestImpact {
    /// Time, in s, determined as in [`Impact`](super::Impact).
    pub time: f64,
    /// Position of the node that touches first, in m.
    pub at: [f64; 2],
    /// Velocity of the node relative to the obstacle, in m/s, positive upwards.
    pub approach_velocity: f64,
    /// Kinetic energy at the first instant of the contact, in J.
    pub kinetic_energy: f64,
    /// Impulse of the contact, in N s.
    pub impulse: f64,
}

/// Forces of an obstacle over a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ObstacleForce {
    /// Force of largest magnitude over all steps, in N, positive upwards.
    pub peak: f64,
    /// Time of the peak, in s; `None` without contact.
    pub time_of_peak: Option<f64>,
    /// Impulse over the run, in N s.
    pub impulse: f64,
    /// Number of contacts; the obstacle stays in contact while any node touches it, and if it is
    /// released for a single step.
    pub impacts: u64,
    /// Time in contact, in s.
    pub time_in_contact: f64,
    /// Hardest contact; `None` without contact.
    pub hardest: Option<HardestImpact>,
}

/// Reactions of a named support over a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SupportForce {
    /// Force of largest magnitude over all steps, in N, positive upwards.
    pub peak: f64,
    /// Time of the peak, in s.
    pub time_of_peak: f64,
    /// Impulse over the run, in N s.
    pub impulse: f64,
    /// Moment about the centroid of the support that is largest over all steps, about the axes x
    /// and y, in N m.
    pub peak_moment: [f64; 2],
    /// Time of the largest moment, in s.
    pub time_of_peak_moment: f64,
}

/// Reaction of a named support at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeReaction {
    /// Index of the support among the named ones.
    pub support: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Force of the support on the plate, in N, positive upwards.
    pub force: f64,
    /// Moments of the support on the plate about the axes x and y through the node, in N m.
    pub moments: [f64; 2],
}

/// Forces of an obstacle or a named support over a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum NamedForce {
    /// Reactions of a support.
    Support(SupportForce),
    /// Forces of an obstacle.
    Obstacle(ObstacleForce),
}
