//! Command `rebond report`.

use super::command::{Execute, Program};
use super::printing::print;
use super::report_many;
use crate::error::Result;
use crate::output::report::{self, Frames};
use crate::output::run_folder::RunFolder;
use crate::output::text::grouped;
use crate::output::write_atomic;
use crate::sweep;
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond report runs/plate
  rebond report sweeps/shaker";

/// Write report.html into the folder of a run, a sweep or a study: one page with the moving
/// plate, charts, pictures and tables, which needs no network
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ReportPage {
    /// Folder of a run, a sweep or a study
    folder: PathBuf,
}

impl Execute for ReportPage {
    fn execute(&self, _: Program) -> Result<()> {
        if self.folder.join(sweep::JSON).is_file() {
            return report_many::of_sweep(&self.folder);
        }
        if self.folder.join(report_many::STUDY).is_file() {
            return report_many::of_study(&self.folder);
        }
        let run = RunFolder::read(&self.folder)?;
        let frames = Frames::read(&run.snapshots)?;
        let page = report::page(&run, frames.as_ref())?;
        let path = run.folder.join(report::FILE);
        write_atomic(&path, page.as_bytes())?;
        let frames = match &frames {
            Some(frames) if frames.times.len() < frames.snapshots => {
                format!("{} of {} snapshots, ", frames.times.len(), frames.snapshots)
            }
            Some(frames) => format!("{} snapshots, ", frames.snapshots),
            None => "no snapshots (output.fields_every), ".to_owned(),
        };
        print(&format!("{} ({frames}{} kB)\n", path.display(), grouped(page.len() as u64 / 1000)))
    }
}
