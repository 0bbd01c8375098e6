//! Command `rebond figures`.

use super::help;
use super::printing::{command_line, json, print};
use crate::error::Result;
use crate::output::claim;
use crate::study::figures;
use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::path::PathBuf;

/// Draw the paper's figures and judge its claims.
#[derive(Debug, Args)]
#[command(after_help = help::FIGURES)]
pub struct Figures {
    /// Folder of the figures
    #[arg(long, value_name = "DIR", default_value = "figures")]
    out: PathBuf,
    /// Smallest time step, in s; a larger one saves time
    #[arg(long, value_name = "STEP", default_value_t = 0.0)]
    smallest_step: f64,
    /// Print JSON on standard output
    #[arg(long)]
    json: bool,
    /// Print errors only
    #[arg(long, short)]
    quiet: bool,
}

impl Figures {
    pub(super) fn execute(&self) -> Result<()> {
        claim::refuse_foreign(&self.out, "figure", "--out", figures::is_one)?;
        let hidden = self.json || self.quiet;
        let target = if hidden { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style =
            ProgressStyle::with_template("{elapsed}  {wide_msg}").expect("the template is well-formed");
        let line = ProgressBar::with_draw_target(None, target).with_style(style);
        let mut starts = |what: &str| line.set_message(what.to_owned());
        let claims = figures::figures(&self.out, self.smallest_step, &command_line(), &mut starts)?;
        line.finish_and_clear();
        match (self.json, self.quiet) {
            (true, _) => print(&json(&claims)?),
            (false, false) => print(&format!("{claims}\nwritten to {}\n", self.out.display())),
            (false, true) => Ok(()),
        }
    }
}
