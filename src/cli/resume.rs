//! Command `rebond resume`.

use super::cache::CacheArgs;
use super::help;
use super::job::Job;
use super::launch;
use super::printing::OutputMode;
use crate::error::{Error, Result};
use crate::output::checkpoint::{Checkpoint, Identity};
use crate::output::claim;
use crate::output::run_files::RecordedRun;
use crate::scene::Scene;
use crate::simulation::RunState;
use clap::Args;
use std::path::PathBuf;

/// Resume a run.
#[derive(Debug, Args)]
#[command(after_help = help::RESUME)]
pub struct Resume {
    /// Run folder with checkpoint-*.bin; with --until also with end.state
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// New end in s, a whole number of steps; also for a finished run
    #[arg(long, value_name = "T")]
    until: Option<String>,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    voice: OutputMode,
}

impl Resume {
    pub(super) fn execute(&self) -> Result<()> {
        claim::refuse_running(&self.folder)?;
        let (checkpoint, damaged) = match self.until {
            None => Checkpoint::newest(&self.folder)?,
            Some(_) => Checkpoint::newest_or_last(&self.folder)?,
        };
        if launch::rank() == 0 {
            for why in damaged {
                eprintln!("rebond: {why}; going on from the one before");
            }
        }
        let Checkpoint { scene: text, scene_file: file, identity, petsc, pause, .. } = checkpoint.clone();
        let read = |overrides: &[String]| Scene::from_str(&text, &file.to_string_lossy(), overrides);
        let scene = read(&[])?;
        if Identity::of(&scene)? != identity {
            return Err(Error::Checkpoint(format!(
                "{}: a mesh, table or start that the scene names has changed since the run began",
                self.folder.display()
            )));
        }
        let (scene, identity) = match &self.until {
            None => (scene, identity),
            Some(until) => {
                let later = read(&[format!("time.end={until}")])
                    .map_err(|why| Error::Usage(format!("--until {until}: {why}")))?;
                if later.time.steps() <= pause.step {
                    let RunState { step, time, .. } = pause;
                    let wrong = format!("the run has made {step} steps, to {time:.9} s");
                    return Err(Error::Usage(format!("--until {until}: {wrong}; expected a later end")));
                }
                let identity = Identity::of(&later)?;
                (later, identity)
            }
        };
        let (folder, cache, voice) = (self.folder.clone(), self.cache, self.voice);
        let from = Some(checkpoint);
        let run = RecordedRun { scene, file, identity, folder, petsc };
        Job { run, cache, voice, from }.execute()
    }
}
