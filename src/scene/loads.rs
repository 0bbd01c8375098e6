//! Table `[load]`: pressure, gravity, acceleration of the base, forces and moments at points.

use super::document::Document;
use super::entry::{table, tables};
use super::given::FieldInput;
use super::kinds::{number, word};
use super::place::place;
use super::words::RotationAxis;
use crate::error::Result;
use crate::field::Names;

table! {
    /// Loads on the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Load {
        /// Upward pressure, a field of x, y, t and of the deflection w there (m); by default 0, but
        /// needed if no other key is given.
        pressure: FieldInput =
            number("a pressure", "Pa").field(Names::XYTW).says("Pa, upward").or_else(no_pressure);
        /// Gravitational acceleration; it acts downwards on the plate, on the masses on it, and on
        /// balls.
        gravity: f64 = number("an acceleration", "m/s2, downward").or(0.0);
        /// Acceleration of the frame that carries supports and obstacles, a field of t; everything
        /// that has mass feels its inertia, and all results are relative to the frame.
        base_acceleration: FieldInput = number("an acceleration", "m/s2").field(Names::T)
            .says("m/s2, upward, of the frame of supports and obstacles").or_silent(FieldInput::new(BASE, 0.0));
        /// Point forces.
        forces: Vec<Force> = tables("force", "at and value");
        /// Moments at points.
        moments: Vec<Moment> = tables("moment", "at, about and value");
    }
}

table! {
    /// Point force.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Force {
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Upward force, a field of t.
        value: FieldInput = number("a force", "N").field(Names::T).says("N, upward");
    }
}

table! {
    /// Moment at a point.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Moment {
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Axis of the moment, which is right-handed about it.
        about: RotationAxis = word().says("x | y, right-handed");
        /// Moment, a field of t.
        value: FieldInput = number("a moment", "N m").field(Names::T);
    }
}

/// Key of the acceleration of the base.
const BASE: &str = "load.base_acceleration";

/// Returns a pressure of 0, beside another load.
fn no_pressure(doc: &Document) -> Result<FieldInput> {
    let key = "load.pressure";
    let mut lists = 0;
    for table in ["load.force", "load.moment"] {
        lists += doc.entries(table, "")?;
    }
    if doc.get("load.gravity").is_none() && doc.get(BASE).is_none() && lists == 0 {
        return Err(doc.missing(key, "expected a pressure in Pa"));
    }
    Ok(FieldInput::new(key, 0.0))
}

impl Load {
    /// Creates a load of pressure alone.
    pub fn of_pressure(pressure: FieldInput) -> Load {
        let base_acceleration = FieldInput::new(BASE, 0.0);
        Load { pressure, gravity: 0.0, base_acceleration, forces: Vec::new(), moments: Vec::new() }
    }

    /// Returns all fields of the load.
    pub fn fields(&self) -> impl Iterator<Item = &FieldInput> {
        [&self.pressure, &self.base_acceleration]
            .into_iter()
            .chain(self.forces.iter().map(|force| &force.value))
            .chain(self.moments.iter().map(|moment| &moment.value))
    }

    /// Returns all fields of the load, to be changed.
    pub(super) fn fields_mut(&mut self) -> impl Iterator<Item = &mut FieldInput> {
        let forces = self.forces.iter_mut().map(|force| &mut force.value);
        let moments = self.moments.iter_mut().map(|moment| &mut moment.value);
        [&mut self.pressure, &mut self.base_acceleration].into_iter().chain(forces).chain(moments)
    }
}
