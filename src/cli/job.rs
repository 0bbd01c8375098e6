//! Run to make: its description before it begins, and its summary, plot and report at the end.

use super::cache::CacheArgs;
use super::printing::{OutputMode, print};
use super::report::report;
use super::run_folder::{obstacles, quantity};
use crate::error::Result;
use crate::output::checkpoint::{Checkpoint, Identity};
use crate::output::{history, plot, summary};
use crate::scene::Scene;
use crate::simulation::{self, Outcome};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Run to make, from its start or from a checkpoint.
pub(super) struct Job {
    pub scene: Scene,
    pub file: PathBuf,
    pub identity: Identity,
    pub folder: PathBuf,
    pub cache: CacheArgs,
    pub voice: OutputMode,
    pub petsc: Vec<String>,
    pub from: Option<Checkpoint>,
}

/// Contents of `summary.json`.
#[derive(Debug, Serialize)]
struct Summary<'s> {
    program: &'static str,
    version: &'static str,
    /// Status of the run: "done", or the cause of its early end.
    status: String,
    scene_hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh_checksum: Option<u32>,
    effects: Vec<String>,
    warnings: &'s [String],
    /// Heights of the obstacles at each probe, in m.
    opposite: BTreeMap<String, Vec<f64>>,
    #[serde(flatten)]
    outcome: &'s Outcome,
    scene: &'s Scene,
}

impl Job {
    /// Prints a description of the run.
    pub fn announce(&self, engine: &str) -> Result<()> {
        if self.voice.is_silent() {
            return Ok(());
        }
        let from = self.from.as_ref().map_or(String::new(), |Checkpoint { pause, .. }| {
            format!("resumed after step {}, t = {:.9} s\n", pause.step, pause.time)
        });
        print(&format!("{}\n{engine}effects: {}\n{from}", self.scene.title, effects(&self.scene)))
    }

    /// Writes the summary and the plot of a run, and prints its report.
    pub fn tell(&self, outcome: &Outcome, warnings: &[String], status: String) -> Result<()> {
        let Job { scene, folder, voice, .. } = self;
        let summary = Summary {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status,
            scene_hash: scene.hash(),
            mesh_checksum: self.identity.mesh_checksum(),
            effects: scene.effects(),
            warnings,
            opposite: simulation::opposite(scene).unwrap_or_default(),
            outcome,
            scene,
        };
        summary::write_json(&folder.join(summary::FILE), &summary)?;
        draw(folder, scene, &summary.opposite)?;
        voice.print(&report(scene, outcome, folder), &summary)
    }
}

fn effects(scene: &Scene) -> String {
    let effects = scene.effects();
    if effects.is_empty() { "none".into() } else { effects.join(", ") }
}

/// Draws `plots/history.svg` from `history.csv`; `rebond plot` draws the other plots.
fn draw(folder: &Path, scene: &Scene, opposite: &BTreeMap<String, Vec<f64>>) -> Result<()> {
    let resolved = serde_json::to_value(scene).unwrap_or_default();
    let obstacles = obstacles(&resolved, opposite);
    let table = history::read(folder)?.with_quantities(|name| quantity(&resolved, name));
    plot::run::history(&table, &scene.title, &obstacles)
        .write_svg(&folder.join(plot::FOLDER).join("history.svg"))
}
