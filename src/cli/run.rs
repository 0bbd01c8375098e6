//! Command `rebond run`.

use super::arguments::SceneArgs;
use super::command::{Execute, Program};
use super::job::Job;
use crate::error::{Error, Result};
use crate::output::checkpoint::Identity;
use crate::output::claim;
use crate::output::run_files::RecordedRun;
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond run plate.toml
  rebond run plate.toml --set time.step=1e-6 --set time.scheme=conserving --out runs/fine
  rebond run plate.toml --set 'load.pressure=100*sin(40*t)' --overwrite
  rebond run plate.toml --engine petsc --vi tao -- -tao_monitor
  mpirun -n 2 rebond run plate.toml

Ctrl-C writes a checkpoint; `rebond resume` goes on from it.";

/// Simulate a scene; writes history.csv, contacts.csv, summary.json, fields and a picture into
/// the run folder
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Run {
    #[command(flatten)]
    scene: SceneArgs,
    /// Run folder; default: runs/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the run folder holds of an unfinished run, or of another scene
    #[arg(long)]
    overwrite: bool,
    /// Also print how the answers were computed: steps, solves, residuals, times
    #[arg(long, short)]
    verbose: bool,
}

impl Execute for Run {
    fn execute(&self, _: Program) -> Result<()> {
        let scene = self.scene.load()?;
        let folder = self.scene.folder(self.out.as_deref(), "runs");
        let file = std::path::absolute(&self.scene.scene).map_err(Error::io(&self.scene.scene))?;
        let identity = Identity::of(&scene)?;
        let resolved = serde_json::to_value(&scene).unwrap_or_default();
        claim::refuse_results(&folder, &identity, &resolved, self.overwrite)?;
        let SceneArgs { cache, voice, .. } = self.scene;
        let petsc = self.scene.petsc.clone();
        let run = RecordedRun { scene, file, identity, folder, petsc };
        Job { run, cache, voice, from: None, verbose: self.verbose }.execute()
    }
}
