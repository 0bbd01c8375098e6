//! Rows of a sweep, and the files `sweep.json` and `sweep.csv` that have them.

use super::measures::{Measures, ProbeMeasures};
use super::plan::{Direction, PlannedRun};
use crate::error::{Error, Result};
use crate::input;
use crate::output::summary::write_json;
use crate::output::text::TableColumns;
use crate::output::write_atomic;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::Value;
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
        let failure = outcome.as_ref().err().cloned();
        SweepRow { index, values, direction, measures: outcome.ok(), failure }
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
        serde_json::from_slice(&bytes).map_err(|why| Error::invalid(path, why.to_string()))
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

    /// Returns the table as CSV.
    fn csv(&self) -> String {
        let line = |cells: &Vec<String>| cells.iter().map(|cell| quoted(cell)).collect::<Vec<_>>().join(",");
        self.lines().iter().map(|cells| line(cells) + "\n").collect()
    }

    /// Returns the heads of the table and a line per run, in which every number reads back as the
    /// same `f64`.
    pub fn lines(&self) -> Vec<Vec<String>> {
        let mut columns = TableColumns::default();
        for (key, name) in self.keys.iter().enumerate() {
            columns.add(name, move |row: &SweepRow| format!("{:?}", row.values[key]));
        }
        columns.add("direction", |row| row.direction.word().into());
        for (index, ProbeHead { name, .. }) in self.probes.iter().enumerate() {
            let mut add = |measure: &str, cell: fn(&ProbeMeasures) -> String| {
                columns.measure(format!("{name}_{measure}"), move |run| Some(cell(&run.probes[index])));
            };
            add("section", |probe| probe.section.iter().map(number).collect::<Vec<_>>().join(";"));
            add("max", |probe| number(&probe.max));
            add("min", |probe| number(&probe.min));
            add("rms", |probe| number(&probe.rms));
            add("amplitude", |probe| number(&probe.amplitude));
            add("phase", |probe| number(&probe.phase));
        }
        columns.measure("period", |run| run.period.map(|period| period.to_string()));
        columns.measure("lyapunov", |run| run.lyapunov.as_ref().map(number));
        columns.measure("peak_force", |run| Some(number(&run.peak_force)));
        columns.measure("impulse", |run| Some(number(&run.impulse)));
        columns.measure("impacts", |run| Some(number(&run.impacts)));
        columns.measure("impact_velocity", |run| Some(number(&run.impact_velocity)));
        columns.measure("work", |run| Some(number(&run.work)));
        columns.measure("loss", |run| Some(number(&run.loss)));
        columns.add("failure", |row| row.failure.clone().unwrap_or_default());
        let heads = columns.heads().into_iter().map(str::to_owned).collect();
        std::iter::once(heads).chain(self.rows.iter().map(|row| columns.row(row))).collect()
    }
}

impl<'a> TableColumns<'a, SweepRow> {
    /// Adds a column of what was measured, empty where there is nothing.
    fn measure(&mut self, head: impl Into<String>, cell: impl Fn(&Measures) -> Option<String> + 'a) {
        self.add(head, move |row| row.measures.as_ref().and_then(&cell).unwrap_or_default());
    }
}

fn number(value: &f64) -> String {
    format!("{value:?}")
}

/// Quotes a cell of a table where it must be.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.into() }
}
