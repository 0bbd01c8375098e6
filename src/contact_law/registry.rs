//! Registry of the laws of compliant stops: what scenes call each, and what it is.
//!
//! A new law is a file of its own, which implements [`ContactLaw`], and a variant of [`StopLaw`]
//! with its row here.

use super::{ContactLaw, Hertz};
use std::sync::Arc;

/// Law by which the force of a compliant stop depends on its depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopLaw {
    /// Spring and dashpot, `$k d + c \dot d$`, which join a massless tip to the plate.
    Linear,
    /// Contact of two elastic bodies with curved surfaces, `$k d^{3/2}$` (Hertz 1881).
    Hertz,
}

/// Row of a law of stops.
pub struct StopLawSpec {
    /// Name in a scene.
    pub name: &'static str,
    /// Name of the effect of stops with this law.
    pub effect: &'static str,
    /// Unit of the stiffness at a point.
    pub unit: &'static str,
    /// Law of the node's own bound, given the stiffness: the stop then touches at one point and has
    /// no damping. `None` where a rigid bound holds a massless tip in place of the node.
    pub law: Option<fn(f64) -> Arc<dyn ContactLaw>>,
}

impl StopLaw {
    /// All laws of stops.
    pub const ALL: [StopLaw; 2] = [StopLaw::Linear, StopLaw::Hertz];

    /// Returns the row of the law.
    pub const fn spec(self) -> StopLawSpec {
        match self {
            StopLaw::Linear => {
                StopLawSpec { name: "linear", effect: "compliant stops", unit: "N/m", law: None }
            }
            StopLaw::Hertz => StopLawSpec {
                name: "hertz",
                effect: "stops by the law of Hertz",
                unit: "N/m^1.5",
                law: Some(|stiffness| Arc::new(Hertz(stiffness))),
            },
        }
    }
}
