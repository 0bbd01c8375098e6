//! Table `[output]`: rows, snapshots, checkpoints and probes.

use super::ProbeQuantity;
use super::attachments::Ball;
use super::column::column;
use super::document::{Document, Value, join, quote};
use super::entry::{self, Entry, Kind, SceneText, Table, flat, flat_if, object, table, tables, via};
use super::kinds::{count, truth, word};
use super::mesh;
use super::place::{PlaceKeys, located, place_keys};
use crate::error::Result;
use serde_json::json;

/// Limit on the parts into which snapshots divide an edge.
const MOST_PARTS: usize = 64;

table! {
    /// Output settings.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Output {
        /// Number of steps between rows of `history.csv`.
        every: u64 = count(STEPS, 1).says("steps between rows of history.csv").or(1);
        /// Snapshots of the plate; `None` costs nothing.
        fields: Option<Snapshots> = flat_if();
        /// The largest von Mises stress over *all* steps, with place and time, in `summary.json`,
        /// and at each node in `extremes.vtu`. A step then takes longer by the time of three to six
        /// products with the stiffness matrix; with `time.mass = "modal"`, whose steps are cheaper
        /// than that, this is much. On several ranks the cells' shares are added up besides.
        extremes: bool = truth().says("largest stress over all steps").or_silent(false);
        /// Number of steps between checkpoints, from which `rebond resume` continues; by default a
        /// checkpoint is written only where a run is interrupted.
        checkpoint_every: Option<u64> = count(STEPS, 1).says("steps between checkpoints").optional();
        /// `[{ name = "corner", at = [1.2, 0.0] }]`: columns of `history.csv` with the deflection
        /// at these points, in m. `point = "name"` in place of `at` means a physical point; `{ name
        /// = "ball", ball = 0 }` gives the height of a ball, by its number. `quantity = "..."`
        /// records something else than the deflection. Names hold no commas, quotes and control
        /// characters, and do not begin with =, +, - or @, which spreadsheets take for a formula.
        probes: Vec<Probe> = probes();
    }
}

/// Meaning of the keys of intervals, in words.
const STEPS: &str = "a number of steps";

table! {
    /// Frequency and resolution of the snapshots of the plate.
    #[derive(Debug, Clone, Copy, PartialEq)]
    pub struct Snapshots {
        /// Number of steps between snapshots.
        every as "fields_every": u64 = count(STEPS, 1).says("steps between snapshots");
        /// With `fields_every`: number of parts of each edge in snapshots, at most 64; by default
        /// 4, less on fine meshes.
        subdivide: usize = count("a number of parts of each edge", 1)
            .says("parts of each edge in snapshots").or_else(parts);
        /// With `fields_every`: snapshots also have moments and stresses, see
        /// [Moments and stresses](runs.md#moments-and-stresses).
        stresses: bool = truth().says("moments and stresses in snapshots").or_silent(false);
        /// With `fields_every`: bits of the numbers in snapshots, 32 (seven digits) or 64.
        precision: u32 = bits().says("bits of the numbers in snapshots").or_silent(32);
    } then of_moderate_size
}

/// Number of bits of a floating-point number.
fn bits() -> Kind<u32> {
    let expected = "expected 32 or 64";
    let read = move |doc: &Document, key: &str| match doc.value(key) {
        Some(Value::Integer(bits @ (32 | 64))) => Ok(bits.unsigned_abs() as u32),
        Some(Value::Integer(bits)) => {
            Err(doc.fault(key, format!("{bits} bits are none that VTK knows; {expected}")))
        }
        other => Err(doc.unfit(key, other, expected)),
    };
    Kind::new(expected, || object([("enum", json!([32, 64]))]), read, |bits, _| bits.to_string())
}

table! {
    /// Probe: a point where a quantity, such as the deflection, is recorded.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Probe {
        /// Name of the column.
        name: String = column();
        /// Coordinates x and y in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String>,
        /// Index of a ball whose height is recorded in place of the plate's.
        ball: Option<usize> = via(spot, spot_keys);
        /// Recorded quantity.
        quantity: ProbeQuantity = word().or_silent(ProbeQuantity::Deflection);
    }
}

impl Probe {
    /// Returns the probe of a ball's height, given the ball's index.
    pub fn of_ball(number: usize, ball: &Ball) -> Probe {
        let (name, quantity) = (format!("ball {number}"), ProbeQuantity::Deflection);
        Probe { name, at: ball.at, point: ball.point.clone(), ball: Some(number), quantity }
    }
}

/// Returns the usual parts of an edge: finer meshes divide their cells less.
fn parts(doc: &Document) -> Result<usize> {
    let mesh = mesh::grid(doc)?;
    Ok(match (mesh.cells[0] * mesh.cells[1]) << (2 * mesh.refine) {
        0..=2_000 => 4,
        2_001..=20_000 => 2,
        _ => 1,
    })
}

fn of_moderate_size(snapshots: Snapshots, doc: &Document, table: &str) -> Result<Snapshots> {
    let parts = snapshots.subdivide;
    if parts > MOST_PARTS {
        let wrong = format!("{parts} parts are too many; expected at most {MOST_PARTS}");
        return Err(doc.fault(&join(table, "subdivide"), wrong));
    }
    Ok(snapshots)
}

/// Inline tables of the probes.
fn probes() -> Entry<Vec<Probe>> {
    let read = |doc: &Document, table: &str, name: &str| {
        let array = join(table, name);
        let mut probes: Vec<Probe> = Vec::new();
        for index in 0..doc.entries(&array, "expected an array of { name = \"...\", at = [x, y] }")? {
            let probe: Probe = entry::read(doc, &format!("{array}.{index}"))?;
            if let Some(first) = probes.iter().position(|earlier| earlier.name == probe.name) {
                let wrong =
                    format!("{} is already {array}.{first}; expected unique names", quote(&probe.name));
                return Err(doc.fault(&format!("{array}.{index}.name"), wrong));
            }
            probes.push(probe);
        }
        Ok(probes)
    };
    let write = |name: &str, probes: &Vec<Probe>, lines: &mut SceneText| {
        let row = |probe: &Probe| {
            let mut row = SceneText::new(lines.by_path);
            probe.write(&mut row);
            format!("  {},\n", row.inline())
        };
        let rows: String = probes.iter().map(row).collect();
        let are_deflections = probes.iter().all(|probe| probe.quantity == ProbeQuantity::Deflection);
        lines.behind(&match (probes.is_empty(), are_deflections) {
            (true, _) => format!("{name} = []\n"),
            (_, true) => format!("{name} = [ # m\n{rows}]\n"),
            _ => format!("{name} = [\n{rows}]\n"),
        });
    };
    Entry { read: Box::new(read), write: Box::new(write), ..tables("probes", "") }
}

table! {
    /// Keys of the place of a probe: a point of the plate, or a ball.
    struct SpotKeys {
        /// Point of the plate.
        place: PlaceKeys = flat();
        /// Number of a ball, from 0, in place of a point of the plate.
        ball: Option<usize> = count("the number of a ball, from 0,", 0).optional();
    } one_of {at} {point} {ball}
}

/// Place of a probe, its physical point, and its ball.
type Spot = ([f64; 2], Option<String>, Option<usize>);

fn spot(keys: SpotKeys, doc: &Document, table: &str) -> Result<Spot> {
    let Some(number) = keys.ball else {
        return located(keys.place, doc, table).map(|(place, point)| (place, point, None));
    };
    let [key, quantity] = ["ball", "quantity"].map(|name| join(table, name));
    for place in ["at", "point"] {
        let wrong = format!("contradicts {key}: a ball is where its own table says");
        doc.forbid(&join(table, place), wrong)?;
    }
    let balls = doc.entries("ball", "")?;
    if number >= balls {
        let wrong = format!("{number} is no ball; the scene has {balls} of them, counted from 0");
        return Err(doc.fault(&key, wrong));
    }
    if doc.get(&quantity).is_some() {
        doc.one_of(&quantity, &ProbeQuantity::OF_BALLS.map(ProbeQuantity::name))?;
    }
    Ok((Ball::read(doc, &format!("ball.{number}"))?.at, None, Some(number)))
}

fn spot_keys((place, point, ball): &Spot) -> SpotKeys {
    let mut place = place_keys(*place, point);
    place.at.take_if(|_| ball.is_some());
    SpotKeys { place, ball: *ball }
}
