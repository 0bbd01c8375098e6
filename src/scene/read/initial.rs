//! Table `[initial]`: deflection and velocity at the start.

use std::path::Path;
use std::sync::Arc;

use super::quantities::{DEFLECTION, PRESSURE, VELOCITY};
use super::region::name;
use crate::error::{Error, Result};
use crate::field::Names;
use crate::motion::{self, Motion};
use crate::scene::document::{Document, quote};
use crate::scene::keys::{TableKeys, ValueKind, key};
use crate::scene::{FieldInput, Initial, StartFrom};

pub(super) static INITIAL: TableKeys = TableKeys::optional(&[&[
    key(
        "static_pressure",
        ValueKind::Field(&PRESSURE, Names::XY),
        "Pa: start at rest from the equilibrium under this pressure; default 0",
    ),
    key("equilibrium", ValueKind::Truth, "true: start from the equilibrium under [load] at t = 0"),
    key("deflection", ValueKind::Field(&DEFLECTION, Names::XY), "m: start from this deflection instead"),
    key("velocity", ValueKind::Field(&VELOCITY, Names::XY), "m/s, upward; default 0"),
    key("from", ValueKind::Text, "folder of a finished run, whose last state is the start"),
]]);

pub(super) fn read(doc: &Document) -> Result<Initial> {
    let others = ["static_pressure", "equilibrium", "deflection", "velocity"];
    doc.allow("initial", &INITIAL)?;
    let from = from_run(doc)?;
    if from.is_some() {
        for name in others {
            let wrong = "contradicts initial.from: the other run gives deflection and velocity";
            doc.forbid_with("initial.from", &format!("initial.{name}"), wrong)?;
        }
    }
    let given = |name: &str, quantity| {
        let key = format!("initial.{name}");
        if from.is_some() {
            return Ok(FieldInput::constant(&key, 0.0));
        }
        Ok::<_, Error>(doc.given(&key, quantity, Names::XY)?.unwrap_or(FieldInput::constant(&key, 0.0)))
    };
    let initial = Initial {
        static_pressure: given("static_pressure", &PRESSURE)?,
        equilibrium: from.is_none() && doc.optional_truth("initial.equilibrium")?.unwrap_or(false),
        deflection: given("deflection", &DEFLECTION)?,
        velocity: given("velocity", &VELOCITY)?,
        from,
    };
    if !initial.deflection.is_zero() && (initial.equilibrium || !initial.static_pressure.is_zero()) {
        let wrong = "contradicts a static start; expected either initial.deflection";
        return Err(doc.fault(
            "initial.deflection",
            format!("{wrong}, or initial.static_pressure and initial.equilibrium"),
        ));
    }
    Ok(initial)
}

/// Reads the run whose last state is the start.
///
/// The folder of that run is relative to the scene's file or, if it is not there, to the working
/// folder.
fn from_run(doc: &Document) -> Result<Option<StartFrom>> {
    let key = "initial.from";
    if doc.get(key).is_none() {
        return Ok(None);
    }
    let folder = name(doc, key, "expected the folder of a run that is done")?;
    let beside = doc.beside(&folder);
    let path = if Path::new(&beside).is_dir() { beside } else { folder.clone() };
    if !Path::new(&path).join(motion::FILE).is_file() {
        let wrong =
            format!("{} has no {}; expected the folder of a run that is done", quote(&path), motion::FILE);
        return Err(doc.fault(key, wrong));
    }
    let motion = Motion::read(Path::new(&path)).map_err(|why| match why {
        Error::Scene(why) => doc.fault(key, why),
        other => other,
    })?;
    Ok(Some(StartFrom { folder, path, motion: Arc::new(motion) }))
}
