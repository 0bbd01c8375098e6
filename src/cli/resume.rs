//! `rebond resume`.

use super::run::Job;
use super::{Voice, launch};
use crate::error::{Error, Result};
use crate::output::checkpoint::{Checkpoint, Identity};
use crate::scene::Scene;
use clap::Args;
use std::path::PathBuf;

/// Go on with a run.
#[derive(Debug, Args)]
pub struct Resume {
    /// Run folder with checkpoint-*.bin
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    #[command(flatten)]
    voice: Voice,
}

impl Resume {
    pub(super) fn execute(&self) -> Result<()> {
        let (checkpoint, damaged) = Checkpoint::newest(&self.folder)?;
        if launch::rank() == 0 {
            for why in damaged {
                eprintln!("rebond: {why}; going on from the one before");
            }
        }
        let Checkpoint { scene, scene_file: file, identity, petsc, .. } = checkpoint.clone();
        let scene = Scene::from_str(&scene, &file.to_string_lossy(), &[])?;
        if Identity::of(&scene)? != identity {
            return Err(Error::Checkpoint(format!(
                "{}: a mesh or table that the scene names has changed since the run began",
                self.folder.display()
            )));
        }
        let (folder, voice, from) = (self.folder.clone(), self.voice, Some(checkpoint));
        Job { scene, file, identity, folder, voice, petsc, from }.execute()
    }
}
