//! Command `rebond plot`.

use super::command::{Execute, Program};
use super::printing::print;
use super::run_folder::{RunFolder, RunPictures};
use crate::error::Result;
use crate::output::plot::{self, Figure};
use crate::sweep::{self, SweepReport};
use clap::Args;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  rebond plot runs/plate
  rebond plot sweeps/shaker";

/// Draw a run folder: history, energies, contacts, phase portraits, spectra, snapshots; SVG and
/// PNG
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Plot {
    /// Folder of a run or of a sweep
    folder: PathBuf,
}

impl Execute for Plot {
    fn execute(&self, _: Program) -> Result<()> {
        if self.folder.join(sweep::JSON).is_file() {
            return draw_sweep(&self.folder);
        }
        let run = RunFolder::read(&self.folder)?;
        let RunPictures { figures, absent } = run.pictures()?;
        let placed = |(name, figure)| (run.folder.join(plot::FOLDER).join(name), figure);
        let figures: Vec<(PathBuf, Figure)> = figures.into_iter().map(placed).collect();
        Figure::write_all(&figures)?;
        let line = |(path, _): &(PathBuf, Figure)| format!("{}.svg, .png\n", path.display());
        let mut report: String = figures.iter().map(line).collect();
        for what in absent {
            report += &format!("{what}\n");
        }
        print(&report)
    }
}

/// Draws the pictures of a sweep.
fn draw_sweep(folder: &Path) -> Result<()> {
    let names = sweep::draw(&SweepReport::read(folder)?, folder)?;
    let line = |name: &str| format!("{}.svg, .png\n", folder.join(plot::FOLDER).join(name).display());
    print(&names.into_iter().map(line).collect::<String>())
}
