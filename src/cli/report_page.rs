//! Command `rebond report`.

use super::help;
use super::printing::print;
use super::report_many;
use super::run_folder::RunFolder;
use crate::error::{Error, Result};
use crate::output::plot::Obstacle;
use crate::output::report::{self, Frames, InlinePicture, ReportContents};
use crate::output::text::grouped;
use crate::output::write_atomic;
use crate::sweep;
use clap::Args;
use std::path::PathBuf;

/// Write report.html: one page that a browser opens without a network.
///
/// The page of a run tells the scene and its key numbers, shows the plate in motion beside its time
/// series, and lists the contacts. The view needs snapshots: set output.fields_every for the run.
/// That of a sweep or a study has their pictures and a table of their runs.
#[derive(Debug, Args)]
#[command(after_help = help::REPORT)]
pub struct ReportPage {
    /// Folder of a run, a sweep or a study
    folder: PathBuf,
}

impl ReportPage {
    pub(super) fn execute(&self) -> Result<()> {
        if self.folder.join(sweep::JSON).is_file() {
            return report_many::of_sweep(&self.folder);
        }
        if self.folder.join(report_many::STUDY).is_file() {
            return report_many::of_study(&self.folder);
        }
        let run = RunFolder::read(&self.folder)?;
        let frames = Frames::read(&run.snapshots)?;
        let figures = run.pictures()?.figures;
        let pictures: Vec<InlinePicture> =
            figures.into_iter().map(|(name, figure)| InlinePicture { name, svg: figure.svg() }).collect();
        let height = |obstacle: &Obstacle| match *obstacle {
            Obstacle::Below(height) | Obstacle::Above(height) | Obstacle::Part(height) => height,
        };
        let heights: Vec<f64> = run.obstacles().iter().map(height).collect();
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
