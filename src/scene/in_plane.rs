//! Table `[in_plane]`: forces in the plane of the plate.

use super::document::Document;
use super::entry::{section, table};
use super::given::FieldInput;
use super::kinds::number;
use crate::error::Result;
use crate::field::Names;

table! {
    /// Forces in the plane of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct InPlane {
        /// Membrane force that a stretched frame or edge loads keep up: `xx`, `yy`, `xy`.
        tension: Tension = section();
    }
}

table! {
    /// Membrane force per length, in N/m; positive in tension.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Tension {
        /// Force along x across lines along y, a field of x, y.
        xx: FieldInput = number("a membrane force", "N/m").field(Names::XY)
            .or_silent(FieldInput::new("in_plane.tension.xx", 0.0));
        /// Force along y across lines along x, a field of x, y.
        yy: FieldInput = number("a membrane force", "N/m").field(Names::XY)
            .or_silent(FieldInput::new("in_plane.tension.yy", 0.0));
        /// Shear force, a field of x, y.
        xy: FieldInput = number("a membrane force", "N/m").field(Names::XY)
            .or_silent(FieldInput::new("in_plane.tension.xy", 0.0));
    }
}

impl Tension {
    /// Returns the components xx, yy and xy.
    pub fn components(&self) -> [&FieldInput; 3] {
        [&self.xx, &self.yy, &self.xy]
    }
}

impl InPlane {
    /// Refuses a table without any force.
    pub(super) fn check(&self, doc: &Document) -> Result<()> {
        if self.tension.components().into_iter().all(FieldInput::is_zero) {
            let wrong = "expected at least one of xx, yy and xy, in N/m";
            return Err(doc.missing("in_plane.tension", wrong));
        }
        Ok(())
    }
}
