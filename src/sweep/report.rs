//! Rows of a sweep, and the files `sweep.json` and `sweep.csv` that have them.

use super::basins::Basins;
use super::quantities::{Quantity, of_plate, of_probe};
use super::row::{ProbeHead, SweepRow};
use super::rows::SweepRows;
use super::statistics::SweepStatistics;
use crate::error::Result;
use crate::input::write_whole;
use crate::output::summary::{read_json, write_json};
use crate::output::text::TableColumns;
use crate::scene::{Scene, SweepSpec};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::Path;

/// Names of the files in the folder of a sweep.
pub const JSON: &str = "sweep.json";
/// Name of the table in the folder of a sweep.
pub const CSV: &str = "sweep.csv";

/// Contents of `sweep.json`.
#[derive(Debug, Clone, Serialize, Deserialize)]
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
    /// Statistics of runs with random values.
    #[serde(flatten)]
    pub statistics: Option<SweepStatistics>,
    /// Attractors, if they are asked for.
    #[serde(default)]
    pub basins: Option<Basins>,
    /// Runs in the order of the plan.
    pub rows: SweepRows,
    /// Resolved scene.
    pub scene: Value,
}

impl SweepReport {
    /// Creates the report of a scene's sweep that a command made.
    pub fn new(scene: &Scene, command: String, rows: SweepRows) -> SweepReport {
        let probes = ProbeHead::of_scene(scene);
        let spec = scene.sweep.as_ref();
        let random = spec.and_then(|sweep| sweep.random.as_ref());
        let statistics = random.map(|random| SweepStatistics::new(random, &scene.parameters, &probes, &rows));
        SweepReport {
            title: scene.title.clone(),
            command,
            version: env!("CARGO_PKG_VERSION").into(),
            scene_hash: scene.hash(),
            keys: scene.sweep.iter().flat_map(SweepSpec::keys).map(|(name, _)| name.to_owned()).collect(),
            probes,
            has_contact: scene.has_contact(),
            statistics,
            basins: spec.filter(|spec| spec.basins).map(|spec| Basins::new(&rows, spec.tolerance)),
            rows,
            scene: serde_json::to_value(scene).unwrap_or_default(),
        }
    }

    /// Reads `sweep.json` from a folder.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where the file cannot be read or is none of a sweep.
    pub fn read(folder: &Path) -> Result<SweepReport> {
        read_json(&folder.join(JSON))
    }

    /// Writes `sweep.csv` and `sweep.json`, each whole or not at all.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(JSON), self)?;
        write_whole(&folder.join(CSV), &mut File::options(), |file| {
            self.lines().try_for_each(|cells| {
                let cells = cells?;
                let cells: Vec<String> = cells.iter().map(|cell| quoted(cell)).collect();
                writeln!(file, "{}", cells.join(","))
            })
        })
    }

    /// Returns the number of runs that failed.
    pub fn failures(&self) -> usize {
        self.rows.iter().filter(|row| row.measures.is_none()).count()
    }

    /// Returns the heads of the table and a line per run, in which every number reads back as the
    /// same `f64`.
    pub fn lines(&self) -> impl Iterator<Item = io::Result<Vec<String>>> {
        let mut columns = TableColumns::default();
        for (key, name) in self.keys.iter().enumerate() {
            columns.add(name, move |row: &SweepRow| format!("{:?}", row.values[key]));
        }
        columns.add("direction", |row| row.direction.word().into());
        for (index, probe) in self.probes.iter().enumerate() {
            columns.add(format!("{}_section", probe.name), move |row: &SweepRow| {
                let section = row.measures.iter().flat_map(|run| &run.probes[index].section);
                section.map(|value| format!("{value:?}")).collect::<Vec<_>>().join(";")
            });
            of_probe(index, probe).into_iter().for_each(|quantity| columns.measure(quantity));
        }
        of_plate().into_iter().for_each(|quantity| columns.measure(quantity));
        if let Some(basins) = &self.basins {
            columns.add("attractor", |row| {
                let label = basins.labels.get(&row.index);
                label.map_or(String::new(), |label| (label + 1).to_string())
            });
        }
        if self.statistics.is_some() {
            columns.add("run", |row| row.index.to_string());
        }
        columns.add("failure", |row| row.failure.clone().unwrap_or_default());
        let heads = columns.heads().into_iter().map(str::to_owned).collect();
        std::iter::once(Ok(heads)).chain(self.rows.whole().map(move |row| Ok(columns.row(&row?))))
    }
}

impl<'a> TableColumns<'a, SweepRow> {
    /// Adds a column of what was measured, empty where there is nothing.
    fn measure(&mut self, quantity: Quantity<'a>) {
        let Quantity { name, value, .. } = quantity;
        let is_count = name == "period";
        let cell = move |value: f64| if is_count { value.to_string() } else { format!("{value:?}") };
        self.add(name, move |row| row.measures.as_ref().and_then(&value).map_or(String::new(), cell));
    }
}

/// Quotes a cell of a table where it must be.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n']) { format!("\"{}\"", cell.replace('"', "\"\"")) } else { cell.into() }
}
