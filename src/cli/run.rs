//! Command `rebond run`.

use super::arguments::SceneArgs;
use super::help;
use super::job::Job;
use crate::error::{Error, Result};
use crate::output::checkpoint::Identity;
use crate::output::claim;
use crate::output::run_files::RecordedRun;
use clap::Args;
use std::path::PathBuf;

/// Simulate a scene.
#[derive(Debug, Args)]
#[command(after_help = help::RUN)]
pub struct Run {
    #[command(flatten)]
    scene: SceneArgs,
    /// Run folder; default: runs/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the run folder holds of an unfinished run, or of another scene
    #[arg(long)]
    overwrite: bool,
}

impl Run {
    pub(super) fn execute(&self) -> Result<()> {
        let scene = self.scene.load()?;
        let folder = self.scene.folder(self.out.as_deref(), "runs");
        let file = std::path::absolute(&self.scene.scene).map_err(Error::io(&self.scene.scene))?;
        let identity = Identity::of(&scene)?;
        let resolved = serde_json::to_value(&scene).unwrap_or_default();
        claim::refuse_results(&folder, &identity, &resolved, self.overwrite)?;
        let SceneArgs { cache, voice, .. } = self.scene;
        let petsc = self.scene.petsc.clone();
        let run = RecordedRun { scene, file, identity, folder, petsc };
        Job { run, cache, voice, from: None }.execute()
    }
}
