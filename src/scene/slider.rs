//! Tables `[[slider]]`: dry friction against the deflection of a node.

use super::column::column;
use super::entry::table;
use super::kinds::positive;
use super::place::place;
use crate::contact_law::DryFriction;

table! {
    /// Dry friction of a given normal force at a node, behind a spring or directly.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Slider {
        /// Name under which its force is reported: a column of `history.csv`.
        name: Option<String> = column().optional();
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Force F at which it slips; greater than 0.
        force: f64 = positive("a force", "N").says("N, at which it slips");
        /// Stiffness of a spring between slider and plate; greater than 0. Without this key the
        /// slider sits on the plate itself.
        stiffness: Option<f64> = positive("a stiffness", "N/m").optional();
    }
}

impl Slider {
    /// Returns the law of its force.
    pub fn law(&self) -> DryFriction {
        DryFriction { force: self.force, stiffness: self.stiffness.unwrap_or(f64::INFINITY) }
    }
}
