//! `rebond check` and `rebond inspect`.

use super::run::SetUpTold;
use super::{SceneArgs, launch, refuse_petsc_options};
use crate::error::Result;
use crate::study;
use clap::Args;
use std::path::PathBuf;

/// Validate a scene.
#[derive(Debug, Args)]
pub struct Check {
    #[command(flatten)]
    scene: SceneArgs,
}

/// Look into a scene's matrices.
#[derive(Debug, Args)]
pub struct Inspect {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder for the matrices K, M_r, M, B, C, G, F in Matrix Market form, all dofs before supports
    #[arg(long, value_name = "DIR")]
    matrices: Option<PathBuf>,
}

impl Check {
    pub(super) fn execute(&self) -> Result<()> {
        launch::one_process("check runs")?;
        let scene = self.scene.load()?;
        refuse_petsc_options(&self.scene.petsc)?;
        let set_up = SetUpTold::new(self.scene.voice);
        let check = study::check(&scene)?;
        drop(set_up);
        self.scene.voice.print(&check, &check)
    }
}

impl Inspect {
    pub(super) fn execute(&self) -> Result<()> {
        launch::one_process("inspect runs")?;
        let scene = self.scene.load()?;
        refuse_petsc_options(&self.scene.petsc)?;
        let set_up = SetUpTold::new(self.scene.voice);
        let inspection = study::inspect(&scene)?;
        drop(set_up);
        if let Some(folder) = &self.matrices {
            study::write_matrices(&scene, folder)?;
        }
        self.scene.voice.print(&inspection, &inspection)
    }
}
