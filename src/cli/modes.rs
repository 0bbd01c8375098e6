//! Command `rebond modes`.

use super::arguments::{SceneArgs, refuse_petsc_options};
use super::command::{Execute, Program};
use super::set_up::SetUpTold;
use crate::error::Result;
use crate::output::claim;
use crate::study::ModeShapes;
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond modes plate.toml
  rebond modes plate.toml --count 24 --set mesh.refine=1";

/// Natural frequencies and mode shapes of a scene, with the consistent mass: a table, a picture
/// with nodal lines, and files for ParaView
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ModesArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Number of modes
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u16).range(1..))]
    count: u16,
    /// Folder of the modes; default: modes/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

impl Execute for ModesArgs {
    fn execute(&self, _: Program) -> Result<()> {
        let scene = self.scene.load()?;
        refuse_petsc_options(&self.scene.petsc)?;
        let folder = self.scene.folder(self.out.as_deref(), "modes");
        claim::refuse_foreign(&folder, "modes", "--out", ModeShapes::is_file)?;
        let _cache = self.scene.open_cache();
        let set_up = SetUpTold::new(self.scene.voice);
        let modes = ModeShapes::new(&scene, self.count.into())?;
        drop(set_up);
        modes.write(&folder)?;
        self.scene.voice.print(&format!("{modes}written to {}\n", folder.display()), &modes)
    }
}
