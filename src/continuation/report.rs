//! Motions of a branch, and the files `branch.csv` and `branch.json` that have them.

use super::branch::PeriodicMotion;
use super::orbit::modulus;
use super::points::PointKind;
use crate::error::Result;
use crate::geometry::range;
use crate::output::summary::{read_json, write_json};
use crate::output::text::{TableColumns, engineering, significant_digits};
use crate::output::write_atomic;
use crate::scene::{Scene, unit};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fmt;
use std::path::Path;

/// Names of the files in the folder of a branch.
pub const JSON: &str = "branch.json";
/// Name of the table in the folder of a branch.
pub const CSV: &str = "branch.csv";

/// Motion of a branch as a row.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BranchRow {
    /// Value of the key, or the energy in J.
    pub parameter: f64,
    /// Period of the motion, in s.
    pub period: f64,
    /// Smallest and largest value of each probe, in m.
    pub probes: Vec<[f64; 2]>,
    /// Largest sum of the magnitudes of all reactions, in N.
    pub peak_force: f64,
    /// Contacts per period.
    pub contacts: usize,
    /// Smallest distance from an obstacle, negative where the plate touches, in m; `None` without
    /// obstacles.
    pub gap: Option<f64>,
    /// Whether small disturbances do not grow.
    pub stable: bool,
    /// Modulus of the largest multiplier.
    pub multiplier: f64,
    /// Argument of the largest multiplier, in rad.
    pub argument: f64,
    /// Kind of a special motion; `None` for others.
    pub point: Option<PointKind>,
}

impl BranchRow {
    /// Creates the row of a motion.
    pub fn new(motion: &PeriodicMotion) -> BranchRow {
        let orbit = &motion.orbit;
        let [re, im] = orbit.multipliers.first().copied().unwrap_or_default();
        BranchRow {
            parameter: motion.parameter,
            period: orbit.period,
            probes: orbit.probes.clone(),
            peak_force: orbit.peak_force,
            contacts: orbit.contacts,
            gap: Some(orbit.gap).filter(|gap| gap.is_finite()),
            stable: orbit.unstable == 0,
            multiplier: modulus([re, im]),
            argument: im.abs().atan2(re),
            point: motion.point,
        }
    }

    /// Returns half the range of a probe, in m.
    pub fn amplitude(&self, probe: usize) -> f64 {
        0.5 * (self.probes[probe][1] - self.probes[probe][0])
    }
}

/// Contents of `branch.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BranchReport {
    /// Title of the scene.
    pub title: String,
    /// Version of the program.
    pub version: String,
    /// Command that made the branch.
    pub command: String,
    /// Hash of the scene.
    pub scene_hash: String,
    /// Key over which the branch is told; `energy` for free vibrations.
    pub key: String,
    /// Probes of deflections.
    pub probes: Vec<String>,
    /// Why the branch ends.
    pub ending: String,
    /// Motions in their order along the branch.
    pub rows: Vec<BranchRow>,
    /// Resolved scene.
    pub scene: Value,
}

impl BranchReport {
    /// Creates the report of a scene's branch without motions so far.
    pub fn new(scene: &Scene, command: String, key: String, probes: Vec<String>) -> BranchReport {
        BranchReport {
            title: scene.title.clone(),
            version: env!("CARGO_PKG_VERSION").into(),
            command,
            scene_hash: scene.hash(),
            key,
            probes,
            ending: String::new(),
            rows: Vec::new(),
            scene: serde_json::to_value(scene).unwrap_or_default(),
        }
    }

    /// Reads `branch.json` from a folder.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where the file cannot be read or is none of a branch.
    pub fn read(folder: &Path) -> Result<BranchReport> {
        read_json(&folder.join(JSON))
    }

    /// Returns whether the branch is one of free vibrations.
    pub fn is_free(&self) -> bool {
        self.key == "energy"
    }

    /// Returns the unit of the key.
    pub fn unit(&self) -> String {
        if self.is_free() { "J".into() } else { unit(&self.key).unwrap_or_default() }
    }

    /// Writes `branch.csv` and `branch.json`, each whole or not at all.
    ///
    /// # Errors
    /// Returns [`crate::error::Error::Io`] where a file cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        write_json(&folder.join(JSON), self)?;
        let csv: String = self.lines().map(|cells| cells.join(",") + "\n").collect();
        write_atomic(&folder.join(CSV), csv.as_bytes())
    }

    /// Returns the heads of the table and a line per motion, in which every number reads back as
    /// the same `f64`; the last column is the kind of a special motion.
    pub fn lines(&self) -> impl Iterator<Item = Vec<String>> {
        let mut columns = TableColumns::default();
        columns.add(self.key.as_str(), |row: &BranchRow| format!("{:?}", row.parameter));
        columns.add("period", |row| format!("{:?}", row.period));
        for (index, probe) in self.probes.iter().enumerate() {
            columns.add(format!("{probe}_max"), move |row| format!("{:?}", row.probes[index][1]));
            columns.add(format!("{probe}_min"), move |row| format!("{:?}", row.probes[index][0]));
        }
        columns.add("peak_force", |row| format!("{:?}", row.peak_force));
        columns.add("contacts", |row| row.contacts.to_string());
        columns.add("gap", |row| row.gap.map_or(String::new(), |gap| format!("{gap:?}")));
        columns.add("stable", |row| u8::from(row.stable).to_string());
        columns.add("multiplier", |row| format!("{:?}", row.multiplier));
        columns.add("argument", |row| format!("{:?}", row.argument));
        columns.add("point", |row| row.point.map_or(String::new(), |point| point.to_string()));
        let heads = columns.heads().into_iter().map(str::to_owned).collect();
        std::iter::once(heads).chain(self.rows.iter().map(move |row| columns.row(row)))
    }

    /// Returns where motions are stable, in words.
    pub fn stability(&self) -> String {
        let value = |value: f64| significant_digits(value, 5);
        let stretches = self.rows.chunk_by(|a, b| a.stable == b.stable).filter(|rows| rows[0].stable);
        let spans = stretches.map(|rows| {
            let [low, high] = range(rows.iter().map(|row| row.parameter));
            format!("{} to {}", value(low), value(high))
        });
        let spans: Vec<String> = spans.collect();
        match spans.is_empty() {
            true => "no stable motion".into(),
            false => {
                format!("stable for {} = {} {}", self.key, spans.join(", "), self.unit()).trim_end().into()
            }
        }
    }
}

impl fmt::Display for BranchReport {
    /// Formats what was found: where the branch is stable, and its special motions.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let unit = self.unit();
        let value = |value: f64| significant_digits(value, 5);
        writeln!(f, "{}", self.title)?;
        writeln!(f, "  {}", self.stability())?;
        let points: Vec<&BranchRow> = self.rows.iter().filter(|row| row.point.is_some()).collect();
        if !points.is_empty() {
            let mut columns = TableColumns::default();
            columns
                .add("point", |row: &BranchRow| row.point.map_or(String::new(), |point| point.to_string()));
            let head = if unit.is_empty() { self.key.clone() } else { format!("{}, {unit}", self.key) };
            columns.add(head, move |row| value(row.parameter));
            columns.add("period", |row| engineering(row.period, "s"));
            for (index, probe) in self.probes.iter().enumerate() {
                columns.add(format!("{probe}, half\nthe range"), move |row| {
                    engineering(row.amplitude(index), "m")
                });
            }
            columns.add("peak force", |row| engineering(row.peak_force, "N"));
            columns.add("contacts", |row| row.contacts.to_string());
            write!(f, "{}", columns.table(points))?;
        }
        writeln!(f, "{} motions; {}", self.rows.len(), self.ending)
    }
}
