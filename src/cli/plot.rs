//! Command `rebond plot`.

use super::command::{Execute, Program};
use super::modes;
use super::printing::print;
use crate::continuation::{self, BranchReport};
use crate::error::Result;
use crate::output::plot::{self, Figure};
use crate::output::run_folder::RunFolder;
use crate::sweep::{self, SweepReport};
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond plot runs/plate
  rebond plot sweeps/shaker";

/// Draw a run folder: history, energies, contacts, phase portraits, spectra, snapshots; SVG and
/// PNG
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Plot {
    /// Folder of a run, of a sweep or of a continuation
    folder: PathBuf,
}

impl Execute for Plot {
    fn execute(&self, _: Program) -> Result<()> {
        let (figures, absent) = if self.folder.join(sweep::JSON).is_file() {
            (sweep::figures(&SweepReport::read(&self.folder)?), Vec::new())
        } else if self.folder.join(continuation::JSON).is_file() {
            (continuation::figures(&BranchReport::read(&self.folder)?, None), Vec::new())
        } else {
            let run = RunFolder::read(&self.folder)?;
            let modes = modes::of_run(&run);
            run.pictures(modes.as_ref().map_or(&[], |modes| modes.frequencies.as_slice()))?
        };
        let mut report = Figure::write_all(&self.folder.join(plot::FOLDER), &figures)?;
        report.extend(absent.iter().map(|what| format!("{what}\n")));
        print(&report)
    }
}
