//! Commands `rebond check` and `rebond inspect`.

use super::arguments::{SceneArgs, refuse_petsc_options};
use super::command::{Execute, Program};
use super::set_up::SetUpTold;
use crate::error::{Error, Result};
use crate::output::claim;
use crate::scene::{EngineName, Scene};
use crate::study::{self, SweepCost};
use crate::sweep;
use clap::Args;
use std::path::{Path, PathBuf};

const CHECK: &str = "\
Examples:
  rebond check plate.toml
  rebond check plate.toml --scene
  rebond check plate.toml --set mesh.refine=2 --json";

/// Read and validate a scene: its size, loads, frequencies, advised step, cost and warnings
#[derive(Debug, Args)]
#[command(after_help = CHECK)]
pub(super) struct Check {
    #[command(flatten)]
    scene: SceneArgs,
    /// Print the scene as well, with every default filled in
    #[arg(long = "scene")]
    resolved: bool,
}

const INSPECT: &str = "\
Examples:
  rebond inspect plate.toml
  rebond inspect plate.toml --matrices matrices";

/// Natural frequencies, masses, initial energy, static deflection and inf-sup constant of a
/// scene
#[derive(Debug, Args)]
#[command(after_help = INSPECT)]
pub(super) struct Inspect {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder for the matrices K, M_r, M, B, C, G, F in Matrix Market form, all dofs before
    /// supports
    #[arg(long, value_name = "DIR")]
    matrices: Option<PathBuf>,
    /// Replace the matrices of another scene in that folder
    #[arg(long, requires = "matrices")]
    overwrite: bool,
}

impl Execute for Check {
    fn execute(&self, _: Program) -> Result<()> {
        let scene = self.scene.load()?;
        refuse_petsc_options(&self.scene.petsc)?;
        let _cache = self.scene.open_cache();
        let set_up = SetUpTold::new(self.scene.voice);
        let mut check = study::check(&scene)?;
        if let Some(sweep) = scene.sweep.as_ref().filter(|_| scene.solver.engine == EngineName::Native) {
            let (runs, expected_seconds) = sweep::expected_time(sweep, &|more| self.scene.load_with(&[more]));
            check.sweep = Some(SweepCost { runs, periods: sweep.periods, expected_seconds });
        }
        drop(set_up);
        let resolved = if self.resolved { format!("{}\n", check.scene) } else { String::new() };
        self.scene.voice.print(&format!("{resolved}{check}"), &check)
    }
}

impl Execute for Inspect {
    fn execute(&self, _: Program) -> Result<()> {
        let scene = self.scene.load()?;
        refuse_petsc_options(&self.scene.petsc)?;
        self.matrices.as_ref().map_or(Ok(()), |folder| self.refuse_matrices(folder, &scene))?;
        let _cache = self.scene.open_cache();
        let set_up = SetUpTold::new(self.scene.voice);
        let inspection = study::inspect(&scene)?;
        drop(set_up);
        if let Some(folder) = &self.matrices {
            study::write_matrices(&scene, folder)?;
        }
        self.scene.voice.print(&inspection, &inspection)
    }
}

impl Inspect {
    /// Refuses a folder with foreign files or, without `--overwrite`, matrices of another scene.
    fn refuse_matrices(&self, folder: &Path, scene: &Scene) -> Result<()> {
        claim::refuse_foreign(folder, "matrices", "--matrices", |name| study::MATRICES.contains(&name))?;
        let holds_some = study::MATRICES.iter().any(|name| folder.join(name).exists());
        let is_same = || study::matrices_are_of(scene, folder);
        if self.overwrite || !holds_some || is_same() {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "{} holds the matrices of another scene: --matrices DIR names another folder, --overwrite replaces them",
            folder.display()
        )))
    }
}
