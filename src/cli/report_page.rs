//! Command `rebond report`.

use super::command::{Execute, Program};
use super::modes;
use super::printing::print;
use super::report_many;
use crate::continuation;
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
  rebond report runs/soft runs/stiff
  rebond report sweeps/shaker
  rebond report continuations/shaker";

/// Write report.html into the folder of a run, a sweep, a study or a branch: one page with the
/// moving plate, charts, pictures and tables, which needs no network; for two runs, their answers
/// and curves side by side
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct ReportPage {
    /// Folder of a run, a sweep, a study or a branch, or folders of two runs
    #[arg(required = true, num_args = 1..=2, value_name = "DIR")]
    folders: Vec<PathBuf>,
    /// Page; default: report.html in the folder, and A-B.html beside the first of two folders A
    /// and B
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Execute for ReportPage {
    fn execute(&self, _: Program) -> Result<()> {
        let folder = match self.folders.as_slice() {
            [a, b] => return self.side_by_side([a, b]),
            [folder, ..] => folder,
            [] => return Ok(()), // clap asks for a folder
        };
        let path = self.out.clone().unwrap_or_else(|| folder.join(report::FILE));
        if folder.join(sweep::JSON).is_file() {
            return report_many::of_sweep(folder, &path);
        }
        if folder.join(report_many::STUDY).is_file() {
            return report_many::of_study(folder, &path);
        }
        if folder.join(continuation::JSON).is_file() {
            return report_many::of_branch(folder, &path);
        }
        let run = RunFolder::read(folder)?;
        let frames = Frames::read(&run.snapshots)?;
        let modes = modes::of_run(&run).map(|modes| (modes.figure(), modes.frequencies));
        let page = report::page(&run, frames.as_ref(), modes.as_ref())?;
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

impl ReportPage {
    /// Writes the page of two runs.
    fn side_by_side(&self, folders: [&PathBuf; 2]) -> Result<()> {
        let [a, b] = folders.map(|folder| RunFolder::read(folder));
        let runs = [a?, b?];
        let path = self.out.clone().unwrap_or_else(|| {
            let names = folders.map(|folder| {
                let whole = folder.canonicalize().unwrap_or_else(|_| folder.clone());
                whole.file_name().unwrap_or_default().to_string_lossy().into_owned()
            });
            folders[0].with_file_name(format!("{}.html", names.join("-")))
        });
        let page = report::page_of_two(&runs, &path)?;
        write_atomic(&path, page.as_bytes())?;
        print(&format!("{} ({} kB)\n", path.display(), grouped(page.len() as u64 / 1000)))
    }
}
