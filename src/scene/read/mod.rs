//! Translation of a document into a scene: one file per table, its keys in the order of the
//! file.

pub(super) mod column;
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
use super::keys::{TableKeys, ValueKind, key};
use super::typed::PARAMETER;
use super::{EngineName, Scene, attachments, cross_checks, slider};
use crate::error::Result;
use region::PlaceReader;

/// Tables of a scene.
pub(super) static SCENE: TableKeys = TableKeys {
    groups: &[
        &[
            key("title", ValueKind::Text, "one line of text; default: the name of the file"),
            key(
                "parameters",
                ValueKind::Names(&PARAMETER),
                "numbers with names, for all formulas of the scene",
            ),
            key("plate", ValueKind::Table(&plate::PLATE), "sides, thickness and material"),
            key(
                "part",
                ValueKind::Tables(&plate::PART),
                "parts of the plate with another thickness or material",
            ),
            key("mesh", ValueKind::Table(&mesh::MESH), "rectangles, or a Gmsh file"),
            key(
                "support",
                ValueKind::Tables(&supports::SUPPORT),
                "edges and points that are held; all others are free",
            ),
            key("obstacle", ValueKind::Tables(&obstacles::OBSTACLE), "rigid obstacles and compliant stops"),
            key("load", ValueKind::Table(&loads::LOAD), "pressure, gravity and point forces"),
        ],
        attachments::TABLES,
        &[key("slider", ValueKind::Tables(&slider::SLIDER), "dry friction at nodes")],
        &[
            key(
                "damping",
                ValueKind::Table(&plate::DAMPING),
                "Rayleigh's coefficients, and damping of single modes",
            ),
            key(
                "initial",
                ValueKind::Table(&initial::INITIAL),
                "deflection and velocity at the start; default: at rest and flat",
            ),
            key("time", ValueKind::Table(&time::TIME), "scheme, mass, step and end"),
            key("solver", ValueKind::Table(&solver::SOLVER), "linear algebra, contact solver, tolerances"),
            key("output", ValueKind::Table(&output::OUTPUT), "what a run writes"),
            key("study", ValueKind::Table(&study::STUDY), "runs of rebond study"),
            key("sweep", ValueKind::Table(&sweep::SWEEP), "runs of rebond sweep"),
        ],
    ],
    needed: &["plate", "mesh", "time"],
    one_of: &[],
};

/// Reads the whole scene; `engine` is the default.
pub(super) fn scene(doc: &Document, file_name: &str, engine: EngineName) -> Result<Scene> {
    doc.allow("", &SCENE)?;
    let title = title(doc, file_name)?;
    let parameters = doc.parameters()?.clone();
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
        sliders: slider::read(doc, &places)?,
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
