//! Table `[in_plane]`: forces in the plane of the plate.

use super::document::Document;
use super::entry::{section, table, tables};
use super::given::FieldInput;
use super::kinds::{number, tag, truth};
use crate::error::Result;
use crate::field::Names;

table! {
    /// Forces in the plane of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct InPlane {
        /// Whether the mid-plane stretches as the plate bends (von Karman), where supports hold the
        /// plate in its plane; with `conserving`, or with `newmark` or `midpoint` and a mass that
        /// is not modal.
        stretching: bool = truth().says("the mid-plane stretches").or_silent(false);
        /// Temperature above the one at which the plate has no stress, the same through the
        /// thickness, a field of x, y; supports that hold the plate in its plane turn its expansion
        /// into forces. Needs `plate.expansion`.
        temperature: Option<FieldInput> = number("a temperature", "K").field(Names::XY).optional();
        /// Loads on edges in the plane.
        tractions: Vec<Traction> = tables("traction", "edge and force");
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
            .or(FieldInput::new("in_plane.tension.xx", 0.0));
        /// Force along y across lines along x, a field of x, y.
        yy: FieldInput = number("a membrane force", "N/m").field(Names::XY)
            .or(FieldInput::new("in_plane.tension.yy", 0.0));
        /// Shear force, a field of x, y.
        xy: FieldInput = number("a membrane force", "N/m").field(Names::XY)
            .or(FieldInput::new("in_plane.tension.xy", 0.0));
    }
}

table! {
    /// Load on an edge in the plane, which keeps its direction.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Traction {
        /// `left`, `right`, `bottom`, `top`, or a physical group of a mesh file.
        edge: String = tag("expected the name of an edge");
        /// Force per length along x and y.
        force: [f64; 2] = number("a force per length", "N/m").pair("expected [along x, along y] in N/m");
    }
}

impl Tension {
    /// Returns the components xx, yy and xy.
    pub fn components(&self) -> [&FieldInput; 3] {
        [&self.xx, &self.yy, &self.xy]
    }
}

impl InPlane {
    /// Returns whether there are forces in the plane that do not depend on the deflection.
    pub fn is_prestressed(&self) -> bool {
        self.is_solved() || self.tension.components().into_iter().any(|component| !component.is_zero())
    }

    /// Returns whether forces follow from the equilibrium in the plane.
    pub fn is_solved(&self) -> bool {
        self.temperature.as_ref().is_some_and(|given| !given.is_zero()) || !self.tractions.is_empty()
    }

    /// Returns whether supports in the plane count, be the temperature 0.
    pub fn has_equilibrium(&self) -> bool {
        self.stretching || self.temperature.is_some() || !self.tractions.is_empty()
    }

    /// Returns the key of the forces, for messages: of several the one that says most.
    pub fn key(&self) -> &'static str {
        match (&self.temperature, self.tractions.is_empty()) {
            (Some(_), _) => "in_plane.temperature",
            (None, false) => "in_plane.traction",
            (None, true) => "in_plane.tension",
        }
    }

    /// Refuses a table that says nothing.
    pub(super) fn check(&self, doc: &Document) -> Result<()> {
        let is_given = |name: &&str| doc.get(&format!("in_plane.tension.{name}")).is_some();
        if !self.has_equilibrium() && !["xx", "yy", "xy"].iter().any(is_given) {
            let wrong = "expected at least one of xx, yy and xy, in N/m";
            return Err(doc.missing("in_plane.tension", wrong));
        }
        Ok(())
    }
}
