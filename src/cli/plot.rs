//! Command `rebond plot`.

use super::help;
use super::printing::print;
use super::run_folder::{RunFolder, RunPictures};
use crate::error::Result;
use crate::sweep::{self, SweepReport};
use clap::Args;
use std::path::{Path, PathBuf};

/// Draw a run: history, energies, contacts, phase portraits, spectra and snapshots, as SVG and PNG.
#[derive(Debug, Args)]
#[command(after_help = help::PLOT)]
pub struct Plot {
    /// Folder of a run or of a sweep
    folder: PathBuf,
}

impl Plot {
    pub(super) fn execute(&self) -> Result<()> {
        if self.folder.join(sweep::JSON).is_file() {
            return draw_sweep(&self.folder);
        }
        let run = RunFolder::read(&self.folder)?;
        let RunPictures { figures, absent } = run.pictures()?;
        let mut report = String::new();
        for (name, figure) in figures {
            let path = run.folder.join("plots").join(name);
            figure.write(&path)?;
            report += &format!("{}.svg, .png\n", path.display());
        }
        for what in absent {
            report += &format!("{what}\n");
        }
        print(&report)
    }
}

/// Draws the pictures of a sweep.
fn draw_sweep(folder: &Path) -> Result<()> {
    let names = sweep::draw(&SweepReport::read(folder)?, folder)?;
    let line = |name: &str| format!("{}.svg, .png\n", folder.join("plots").join(name).display());
    print(&names.into_iter().map(line).collect::<String>())
}
