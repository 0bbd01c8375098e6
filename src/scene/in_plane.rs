//! Table `[in_plane]`: forces in the plane of the plate.

use super::document::Document;
use super::entry::{section, table};
use super::given::FieldInput;
use super::kinds::{number, truth};
use crate::error::Result;
use crate::field::Names;

table! {
    /// Forces in the plane of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct InPlane {
        /// Whether the mid-plane stretches as the plate bends (von Karman), where supports hold the
        /// plate in its plane; with `conserving` and the modal mass.
        stretching: bool = truth().says("the mid-plane stretches").or_silent(false);
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
    /// Returns the membrane force, if there is any.
    pub fn prestress(&self) -> Option<&Tension> {
        let components = self.tension.components();
        components.into_iter().any(|component| !component.is_zero()).then_some(&self.tension)
    }

    /// Refuses a table that changes nothing.
    pub(super) fn check(&self, doc: &Document) -> Result<()> {
        if !self.stretching && self.prestress().is_none() {
            let wrong = "expected at least one of xx, yy and xy, in N/m";
            return Err(doc.missing("in_plane.tension", wrong));
        }
        Ok(())
    }
}
