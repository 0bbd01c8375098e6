//! Table `[initial]`: deflection and velocity at the start.

use super::document::{Document, join, quote};
use super::entry::{Kind, table};
use super::given::FieldInput;
use super::kinds::{name, number, of_text, string, truth};
use crate::error::{Error, Result};
use crate::field::Names;
use crate::motion::{self, Motion};
use std::path::Path;
use std::sync::Arc;

table! {
    /// Initial state of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Initial {
        /// Upward pressure, a field of x, y: the run starts from the equilibrium under this
        /// pressure, within the obstacles.
        static_pressure: FieldInput =
            number("a pressure", "Pa").field(Names::XY).says("Pa, upward").or(zero("static_pressure"));
        /// With `true` the run starts from the equilibrium under `[load]` at t = 0 (and
        /// `static_pressure`).
        equilibrium: bool = truth().says("at rest under the loads of the first instant").or_silent(false);
        /// Smooth field of x, y: the run starts from this deflection instead, which is 0 where
        /// supports hold the plate. It is relative to the supports where these move. With an
        /// equilibrium of a plate that [stretches](#in_plane) it is where the search begins, such
        /// as on one side of a buckled plate.
        deflection: FieldInput = number("a deflection", "m").field(Names::XY).or_silent(zero("deflection"));
        /// Initial velocity, upward: a smooth field of x, y.
        velocity: FieldInput =
            number("a velocity", "m/s").field(Names::XY).says("m/s, upward").or(zero("velocity"));
        /// Folder of a finished run, relative to the folder of the scene file or of the command:
        /// the run starts at t = 0 from its last deflection and velocity, instead of all these.
        from: Option<StartFrom> = run_folder().optional();
    } then alone omit gone
}

impl Initial {
    /// Returns the start of a flat plate at rest.
    pub fn flat() -> Initial {
        Initial {
            static_pressure: zero("static_pressure"),
            equilibrium: false,
            deflection: zero("deflection"),
            velocity: zero("velocity"),
            from: None,
        }
    }

    /// Returns whether the start is an equilibrium.
    pub fn is_static(&self) -> bool {
        self.equilibrium || !self.static_pressure.is_zero()
    }

    /// Returns the key that gives the initial deflection.
    pub fn key(&self) -> &str {
        match self {
            Initial { from: Some(_), .. } => "initial.from",
            Initial { equilibrium: true, .. } => "initial.equilibrium",
            Initial { static_pressure, .. } if !static_pressure.is_zero() => &static_pressure.key,
            Initial { deflection, .. } => &deflection.key,
        }
    }
}

/// Last state of another run.
#[derive(Debug, Clone, PartialEq)]
pub struct StartFrom {
    /// Run folder as the scene writes it.
    pub folder: String,
    /// Path where the folder was found.
    pub path: String,
    /// Deflection and velocity.
    pub motion: Arc<Motion>,
}

/// Keys that a start from another run replaces.
const REPLACED: [&str; 4] = ["static_pressure", "equilibrium", "deflection", "velocity"];

fn zero(name: &str) -> FieldInput {
    FieldInput::new(&join("initial", name), 0.0)
}

/// Refuses starts that contradict each other.
fn alone(initial: Initial, doc: &Document, table: &str) -> Result<Initial> {
    if initial.from.is_some() {
        for name in REPLACED {
            let wrong = "contradicts initial.from: the other run gives deflection and velocity";
            doc.forbid_with("initial.from", &join(table, name), wrong)?;
        }
        return Ok(Initial { from: initial.from, ..Initial::flat() });
    }
    Ok(initial)
}

/// Returns the keys that a resolved scene omits.
fn gone(initial: &Initial) -> Vec<&'static str> {
    if initial.from.is_some() { REPLACED.to_vec() } else { Vec::new() }
}

/// Run whose last state is the start.
///
/// Its folder is relative to the scene's file or, if it is not there, to the working folder.
fn run_folder() -> Kind<StartFrom> {
    let folder = name("expected the folder of a run that is done");
    let expected = folder.expected.clone();
    let read = move |doc: &Document, key: &str| {
        let folder = doc.required(key, &folder)?;
        let beside = doc.beside(&folder);
        let path = if Path::new(&beside).is_dir() { beside } else { folder.clone() };
        if !Path::new(&path).join(motion::FILE).is_file() {
            let wrong = format!("{} has no {}; {expected}", quote(&path), motion::FILE);
            return Err(doc.fault(key, wrong));
        }
        let motion = Motion::read(Path::new(&path)).map_err(|why| match why {
            Error::Scene(why) => doc.fault(key, why),
            other => other,
        })?;
        Ok(StartFrom { folder, path, motion: Arc::new(motion) })
    };
    let write = |from: &StartFrom, by_path| string(if by_path { &from.path } else { &from.folder });
    Kind::new("", of_text, read, write).says("run folder")
}
