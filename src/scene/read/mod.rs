//! Translation of a document into a scene: one file per table, its keys in the order of the
//! file.

mod column;
mod initial;
mod loads;
mod mesh;
pub(super) mod obstacles;
mod output;
mod plate;
pub(super) mod quantities;
pub(super) mod region;
mod solver;
mod study;
mod supports;
mod sweep;
mod time;

use std::path::Path;

use super::document::{Document, quote};
use super::{EngineName, Scene, attachments, cross_checks};
use crate::error::Result;
use region::PlaceReader;

/// Names of a scene's tables before and after those of attachments.
const TABLES: [&[&str]; 2] = [
    &["title", "parameters", "plate", "part", "mesh", "support", "obstacle", "load"],
    &["damping", "initial", "time", "solver", "output", "study", "sweep"],
];

/// Reads the whole scene; `engine` is the default.
pub(super) fn scene(doc: &Document, file_name: &str, engine: EngineName) -> Result<Scene> {
    doc.allow("", &[TABLES[0], &attachments::TABLES, TABLES[1]].concat())?;
    let title = title(doc, file_name)?;
    let parameters = doc.parameters()?;
    let file = mesh::read_file(doc)?;
    let plate = plate::read(doc, file.is_some())?;
    let (mesh, time, solver) =
        (mesh::read(doc, file.is_some())?, time::read(doc)?, solver::read(doc, engine)?);
    let places = PlaceReader::new(&plate, file.as_ref());
    let attachments = attachments::read(doc, &places)?;
    let scene = Scene {
        title,
        parameters,
        parts: plate::read_parts(doc, &plate)?,
        supports: supports::read(doc, file.is_some())?,
        obstacles: obstacles::read(doc)?,
        load: loads::read(doc, &places)?,
        damping: plate::read_damping(doc)?,
        initial: initial::read(doc)?,
        output: output::read(doc, &places, &mesh, &attachments.balls)?,
        attachments,
        study: study::read(doc, &mesh, &time, &solver)?,
        sweep: sweep::read(doc)?,
        plate,
        mesh,
        file,
        time,
        solver,
    };
    cross_checks::check(doc, &scene)?;
    Ok(scene)
}

fn title(doc: &Document, file_name: &str) -> Result<String> {
    let expected = "expected one line of text";
    let Some(title) = doc.optional_text("title", expected)? else {
        let stem = Path::new(file_name).file_stem().unwrap_or_default().to_string_lossy();
        return Ok(stem.replace(char::is_control, " "));
    };
    if title.contains(char::is_control) {
        return Err(doc.fault("title", format!("{} has a control character; {expected}", quote(title))));
    }
    Ok(title.to_owned())
}
