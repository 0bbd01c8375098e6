//! Rows of a sweep, and the files `sweep.json` and `sweep.csv` that have them.

use super::measures::Measures;
use super::plan::{Direction, PlannedRun};
use crate::error::{Error, Result};
use crate::input;
use crate::output::summary::write_json;
use crate::output::write_atomic;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fmt::Write as _;
use std::io;
use std::path::Path;

/// Names of the files in the folder of a sweep.
pub const JSON: &str = "sweep.json";
/// Name of the table in the folder of a sweep.
pub const CSV: &str = "sweep.csv";

/// Run of a sweep: its values, and its measures or the reason why there are none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepRow {
    /// Index of the run in the plan.
    pub index: usize,
    /// Values of the swept keys.
    pub values: Vec<f64>,
    /// Sense in which the run continues another.
    pub direction: Direction,
    /// Measures; `None` where the run failed.
    pub measures: Option<Measures>,
    /// Reason of a failure.
    pub failure: Option<String>,
}

impl SweepRow {
    /// Creates the row of a run.
    pub(super) fn new(run: &PlannedRun, outcome: std::result::Result<Measures, String>) -> SweepRow {
        let PlannedRun { index, values, direction } = run.clone();
        let (measures, failure) = match outcome {
            Ok(measures) => (Some(measures), None),
            Err(why) => (None, Some(why)),
        };
        SweepRow { index, values, direction, measures, failure }
    }
}

/// Probe of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeHead {
    /// Name of the probe.
    pub name: String,
    /// Quantity and its unit.
    pub quantity: String,
    /// Unit of the quantity.
    pub unit: String,
}

/// Contents of `sweep.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepReport {
    /// Title of the scene.
    pub title: String,
    /// Version of the program.
    pub version: String,
    /// Command that made the sweep.
    #[serde(default)]
    pub command: String,
    /// Hash of the scene with its sweep.
    pub scene_hash: String,
    /// Names of the swept keys.
    pub keys: Vec<String>,
    /// Probes of the scene.
    pub probes: Vec<ProbeHead>,
    /// Whether anything can touch.
    pub has_contact: bool,
    /// Runs in the order of the plan.
    pub rows: Vec<SweepRow>,
    /// Resolved scene.
    pub scene: Value,
}

impl SweepReport {
    /// Creates the report of a scene's sweep that a command made.
    pub fn new(scene: &Scene, command: String, rows: Vec<SweepRow>) -> SweepReport {
        let probes = scene.output.probes.iter().map(|probe| {
            let (quantity, unit) = probe.quantity.axis();
            ProbeHead { name: probe.name.clone(), quantity: quantity.into(), unit: unit.into() }
        });
        SweepReport {
            title: scene.title.clone(),
            command,
            version: env!("CARGO_PKG_VERSION").into(),
            scene_hash: scene.hash(),
            keys: scene.sweep.iter().flat_map(|sweep| &sweep.over).map(|axis| axis.name.clone()).collect(),
            probes: probes.collect(),
            has_contact: scene.has_contact(),
            rows,
            scene: serde_json::to_value(scene).unwrap_or_default(),
        }
    }

    /// Reads `sweep.json` from a folder.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the file cannot be read or is none of a sweep.
    pub fn read(folder: &Path) -> Result<SweepReport> {
        let path = folder.join(JSON);
        let bytes = input::read_plain(&path).map_err(Error::io(&path))?;
        serde_json::from_slice(&bytes)
            .map_err(|why| Error::io(path)(io::Error::new(io::ErrorKind::InvalidData, why)))
    }

    /// Writes `sweep.csv` and `sweep.json`, each whole or not at all.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(JSON), self)?;
        write_atomic(&folder.join(CSV), self.csv().as_bytes())
    }

    /// Returns the number of runs that failed.
    pub fn failures(&self) -> usize {
        self.rows.iter().filter(|row| row.measures.is_none()).count()
    }

    /// Returns the table with one line per run, in which every number reads back as the same `f64`.
    pub fn csv(&self) -> String {
        let of_probe = ["section", "max", "min", "rms", "amplitude", "phase"];
        let mut heads: Vec<String> = self.keys.iter().map(|key| quoted(key)).collect();
        heads.push("direction".into());
        let names = |probe: &ProbeHead| of_probe.map(|measure| quoted(&format!("{}_{measure}", probe.name)));
        heads.extend(self.probes.iter().flat_map(names));
        let others = ["period", "lyapunov", "peak_force", "impulse", "impacts", "impact_velocity"];
        heads.extend(others.into_iter().chain(["work", "loss", "failure"]).map(str::to_owned));
        let mut text = heads.join(",") + "\n";
        for row in &self.rows {
            let mut cells: Vec<String> = row.values.iter().map(|value| format!("{value:?}")).collect();
            cells.push(row.direction.word().into());
            match &row.measures {
                Some(measures) => cells.extend(cells_of(measures)),
                None => cells.resize(heads.len() - 1, String::new()),
            }
            cells.push(row.failure.as_deref().map_or(String::new(), quoted));
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }
}

/// Returns the cells of a run's measures.
fn cells_of(measures: &Measures) -> Vec<String> {
    let number = |value: f64| format!("{value:?}");
    let mut cells = Vec::new();
    for probe in &measures.probes {
        let section: Vec<String> = probe.section.iter().copied().map(number).collect();
        cells.push(section.join(";"));
        cells.extend([probe.max, probe.min, probe.rms, probe.amplitude, probe.phase].map(number));
    }
    cells.push(measures.period.map_or(String::new(), |period| period.to_string()));
    cells.push(measures.lyapunov.map_or(String::new(), number));
    let Measures { peak_force, impulse, impacts, impact_velocity, work, loss, .. } = *measures;
    cells.extend([peak_force, impulse, impacts, impact_velocity, work, loss].map(number));
    cells
}

/// Quotes a cell of a table where it must be.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.into() }
}
