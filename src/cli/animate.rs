//! Command `rebond animate`.

use super::command::{Execute, Program};
use super::printing::print;
use crate::error::{Error, Result};
use crate::input::create_parent;
use crate::output::plot::animation::{self, Format};
use crate::output::plot::{self, perspective};
use crate::output::run_folder::RunFolder;
use crate::output::text::grouped;
use clap::Args;
use std::path::PathBuf;
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  rebond animate runs/plate
  rebond animate runs/plate --duration 10 --width 1280 --out slides/plate.png
  rebond animate runs/plate --format gif";

/// Draw a run's snapshots as an animated picture (APNG or GIF), which browsers and slides show
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Animate {
    /// Run folder, with snapshots (output.fields_every)
    folder: PathBuf,
    /// Picture (.png, .apng or .gif); default: plots/animation.png (or .gif) in the run folder
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Format; default: gif where FILE ends with .gif, else png
    #[arg(long)]
    format: Option<Format>,
    /// Time that the picture takes, in s
    #[arg(long, value_name = "SECONDS", default_value_t = 6.0)]
    duration: f64,
    /// Largest number of frames; more snapshots are left out evenly
    #[arg(long, value_name = "N", default_value_t = 150, value_parser = clap::value_parser!(u32).range(2..=2000))]
    frames: u32,
    /// Width in pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 720, value_parser = clap::value_parser!(u32).range(64..=4096))]
    width: u32,
}

impl Execute for Animate {
    fn execute(&self, _: Program) -> Result<()> {
        if !(self.duration > 0.0 && self.duration <= 3600.0) {
            let wrong =
                format!("--duration {}: expected a time in s greater than 0, up to 3600", self.duration);
            return Err(Error::Usage(wrong));
        }
        let named = match &self.out {
            None => Format::Png,
            Some(path) => Format::of(path).ok_or_else(|| {
                let shown = path.display();
                Error::Usage(format!("--out {shown}: expected a name that ends in .png, .apng or .gif"))
            })?,
        };
        let format = self.format.unwrap_or(named);
        let run = RunFolder::read(&self.folder)?;
        if run.snapshots.len() < 2 {
            let (shown, count) = (self.folder.display(), run.snapshots.len());
            let wrong = format!("{shown} has {count} snapshots; expected a run with output.fields_every");
            return Err(Error::Usage(wrong));
        }
        let title = run.summary["scene"]["title"].as_str().unwrap_or_default();
        let figures = perspective::frames(run.surfaces(self.frames as usize)?, title, &run.bolts());
        let name = || self.folder.join(plot::FOLDER).join(animation::NAME).with_extension(format.extension());
        let path = self.out.clone().unwrap_or_else(name);
        create_parent(&path)?;
        let delay = Duration::from_secs_f64(self.duration / figures.len() as f64);
        animation::write(&path, format, &figures, self.width, delay)?;
        let size = std::fs::metadata(&path).map_err(Error::io(&path))?.len();
        let (frames, count) = (figures.len(), run.snapshots.len());
        let share = if frames < count { format!(" of {count} snapshots") } else { String::new() };
        print(&format!("{} ({frames} frames{share}, {} kB)\n", path.display(), grouped(size / 1000)))
    }
}
