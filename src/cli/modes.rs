//! Command `rebond modes`.

use super::arguments::{SceneArgs, refuse_petsc_options};
use super::command::{Execute, Program};
use super::set_up::SetUpTold;
use crate::error::Result;
use crate::output::claim;
use crate::output::run_folder::RunFolder;
use crate::scene::Snapshots;
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

/// Number of modes of a report.
const REPORTED: usize = 6;

/// Largest number of dofs of a plate whose modes are computed for a report.
const MOST_DOFS: f64 = 5_000.0;

/// Approximate number of faces of a shape in a report, which keeps its page small.
const FACES: f64 = 500.0;

/// Computes the lowest modes of the plate of a run; `None` where it is large, or where files that
/// its scene names are not as they were.
pub(super) fn of_run(run: &RunFolder) -> Option<ModeShapes> {
    let dofs = run.summary["dofs"].as_f64().filter(|dofs| *dofs <= MOST_DOFS)?;
    let mut scene = run.scene()?;
    // A node has three dofs, and there are about as many cells as nodes.
    let subdivide = (3.0 * FACES / dofs.max(1.0)).sqrt().clamp(1.0, 4.0) as usize;
    scene.output.fields = Some(Snapshots { every: 1, subdivide, stresses: false, precision: 64 });
    ModeShapes::new(&scene, REPORTED).ok()
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
