//! Run to make: its description before it begins, and its summary, plot and report at the end.

use super::cache::CacheArgs;
use super::printing::{self, OutputMode, print};
use super::report::report;
use crate::error::Result;
use crate::output::answers::answers;
use crate::output::checkpoint::Checkpoint;
use crate::output::run_files::{RecordedRun, RunSummary};
use crate::scene::Scene;
use crate::simulation::Outcome;
use crate::study;

/// Run to make, from its start or from a checkpoint.
pub(super) struct Job {
    pub run: RecordedRun,
    pub cache: CacheArgs,
    pub voice: OutputMode,
    pub from: Option<Checkpoint>,
    /// Whether the report at the end tells how the answers were computed.
    pub verbose: bool,
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
        let scene = &self.run.scene;
        print(&format!("{}\n{engine}effects: {}\n{from}", scene.title, effects(scene)))
    }

    /// Writes the summary of a run, and prints its report and what its outcome warns of.
    pub fn tell(&self, outcome: &Outcome, warnings: &[String], status: String) -> Result<()> {
        let RecordedRun { scene, folder, identity, .. } = &self.run;
        let late = study::warning_of_run(scene, outcome, warnings);
        if let Some(warning) = late.as_ref().filter(|_| !self.voice.is_silent()) {
            eprintln!("{}", printing::warning(warning));
        }
        let warnings: Vec<String> = warnings.iter().cloned().chain(late).collect();
        let summary = RunSummary::new(scene, identity, outcome, &warnings, status);
        summary.write(folder)?;
        let answers = answers(&serde_json::to_value(&summary).unwrap_or_default());
        let report = report(scene, outcome, answers, warnings.len(), folder, self.verbose);
        self.voice.print(&report, &summary)
    }
}

fn effects(scene: &Scene) -> String {
    let effects = scene.effects();
    if effects.is_empty() { "none".into() } else { effects.join(", ") }
}
