//! Command `rebond report`.

use super::command::{Execute, Program};
use super::printing::print;
use super::report_many;
use super::run_folder::RunFolder;
use crate::error::{Error, Result};
use crate::output::plot::Obstacle;
use crate::output::report::{self, Frames, ReportContents};
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
        let figures = run.pictures()?.figures;
        let pictures: Vec<(String, String)> =
            figures.into_iter().map(|(name, figure)| (name.to_owned(), figure.svg())).collect();
        let heights: Vec<f64> = run.obstacles().into_iter().map(Obstacle::height).collect();
        let contents = ReportContents {
            summary: &run.summary,
            table: &run.table,
            contacts: run.contacts.as_deref(),
            frames: frames.as_ref(),
            pictures: &pictures,
            heights: &heights,
        };
        let path = run.folder.join(report::FILE);
        let page = report::page(&contents).map_err(Error::io(&path))?;
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
