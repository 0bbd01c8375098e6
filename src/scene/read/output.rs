//! Table `[output]`: rows, snapshots, checkpoints and probes.

use super::column;
use super::region::{AT, POINT, PlaceReader};
use crate::error::Result;
use crate::scene::document::{Document, quote};
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::{Ball, Grid, Output, Probe, ProbeQuantity, Snapshots};

/// Limit on the parts into which snapshots divide an edge.
const MOST_PARTS: u64 = 64;

pub(super) static OUTPUT: TableKeys = TableKeys::optional(&[&[
    key("every", ValueKind::Count(1), "steps between rows of history.csv; default 1"),
    key("fields_every", ValueKind::Count(1), "steps between snapshots; default: none"),
    key("subdivide", ValueKind::Count(1), "with fields_every: parts of each edge in snapshots, at most 64"),
    key("stresses", ValueKind::Truth, "with fields_every: snapshots have moments and stresses too"),
    key("extremes", ValueKind::Truth, "true: the largest von Mises stress of all steps"),
    key(
        "checkpoint_every",
        ValueKind::Count(1),
        "steps between checkpoints; default: only where a run is interrupted",
    ),
    key("probes", ValueKind::Array(&ValueKind::Table(&PROBE)), "points recorded in columns of history.csv"),
]]);

static PROBE: TableKeys = TableKeys {
    groups: &[&[
        key("name", ValueKind::Text, "name of the column"),
        AT,
        POINT,
        key("ball", ValueKind::Count(0), "number of a ball, from 0, in place of a point of the plate"),
        key("quantity", ValueKind::Word(words::<ProbeQuantity>), "default deflection"),
    ]],
    needed: &["name"],
    one_of: &[&["at"], &["point"], &["ball"]],
};

pub(super) fn read(doc: &Document, places: &PlaceReader, mesh: &Grid, balls: &[Ball]) -> Result<Output> {
    doc.allow("output", &OUTPUT)?;
    let every = doc.optional_count("output.every", "a number of steps", 1)?.unwrap_or(1);
    let mut probes: Vec<Probe> = Vec::new();
    for index in 0..doc.entries("output.probes", "expected an array of { name = \"...\", at = [x, y] }")? {
        let probe = probe(doc, &format!("output.probes.{index}"), places, balls)?;
        if let Some(first) = probes.iter().position(|earlier| earlier.name == probe.name) {
            let wrong =
                format!("{} is already output.probes.{first}; expected unique names", quote(&probe.name));
            return Err(doc.fault(&format!("output.probes.{index}.name"), wrong));
        }
        probes.push(probe);
    }
    let checkpoint_every = doc.optional_count("output.checkpoint_every", "a number of steps", 1)?;
    let extremes = doc.optional_truth("output.extremes")?.unwrap_or(false);
    Ok(Output { every, checkpoint_every, fields: snapshots(doc, mesh)?, extremes, probes })
}

/// Reads the settings of snapshots; by default finer meshes divide their cells less.
fn snapshots(doc: &Document, mesh: &Grid) -> Result<Option<Snapshots>> {
    let Some(every) = doc.optional_count("output.fields_every", "a number of steps", 1)? else {
        for key in ["output.subdivide", "output.stresses"] {
            doc.forbid(key, "has no use without output.fields_every")?;
        }
        return Ok(None);
    };
    let rectangles = (mesh.cells[0] * mesh.cells[1]) << (2 * mesh.refine);
    let parts = match rectangles {
        0..=2_000 => 4,
        2_001..=20_000 => 2,
        _ => 1,
    };
    let subdivide =
        doc.optional_count("output.subdivide", "a number of parts of each edge", 1)?.unwrap_or(parts);
    if subdivide > MOST_PARTS {
        let wrong = format!("{subdivide} parts are too many; expected at most {MOST_PARTS}");
        return Err(doc.fault("output.subdivide", wrong));
    }
    let stresses = doc.optional_truth("output.stresses")?.unwrap_or(false);
    Ok(Some(Snapshots { every, subdivide: subdivide as usize, stresses }))
}

fn probe(doc: &Document, table: &str, places: &PlaceReader, balls: &[Ball]) -> Result<Probe> {
    doc.allow(table, &PROBE)?;
    let name = column::needed(doc, &format!("{table}.name"))?;
    let key = format!("{table}.ball");
    let Some(number) = doc.optional_count(&key, "the number of a ball, from 0,", 0)? else {
        let (at, point) = places.read(doc, table)?;
        let quantity = doc.optional_choice(&format!("{table}.quantity"))?;
        return Ok(Probe { name, at, point, ball: None, quantity: quantity.unwrap_or_default() });
    };
    for place in ["at", "point"] {
        doc.forbid(
            &format!("{table}.{place}"),
            format!("contradicts {key}: a ball is where its own table says"),
        )?;
    }
    let number = usize::try_from(number).unwrap_or(usize::MAX);
    let ball = balls.get(number).ok_or_else(|| {
        doc.fault(&key, format!("{number} is no ball; the scene has {} of them, counted from 0", balls.len()))
    })?;
    let key = format!("{table}.quantity");
    let quantity = match doc.get(&key) {
        Some(_) => {
            doc.one_of(&key, &ProbeQuantity::OF_BALLS.map(ProbeQuantity::name)).map(ProbeQuantity::named)?
        }
        None => None,
    };
    let quantity = quantity.unwrap_or_default();
    Ok(Probe { name, at: ball.at, point: None, ball: Some(number), quantity })
}
