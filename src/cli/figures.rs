//! Command `rebond figures`.

use super::command::{Execute, Program};
use super::printing::{OutputMode, command_line};
use crate::error::Result;
use crate::output::claim;
use crate::output::progress::moving_line;
use crate::study::figures;
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond figures
  rebond figures --smallest-step 1e-5    # in less time";

/// The six figures of CSMA 2013, and a verdict on each of the paper's claims
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Figures {
    /// Folder of the figures
    #[arg(long, value_name = "DIR", default_value = "figures")]
    out: PathBuf,
    /// Smallest time step, in s; a larger one saves time
    #[arg(long, value_name = "STEP", default_value_t = 0.0)]
    smallest_step: f64,
    #[command(flatten)]
    voice: OutputMode,
}

impl Execute for Figures {
    fn execute(&self, _: Program) -> Result<()> {
        claim::refuse_foreign(&self.out, "figure", "--out", figures::is_one)?;
        let line = moving_line("{elapsed}  {wide_msg}", None, self.voice.is_silent());
        let mut starts = |what: &str| line.set_message(what.to_owned());
        let claims = figures::figures(&self.out, self.smallest_step, &command_line(), &mut starts)?;
        line.finish_and_clear();
        self.voice.print(&format!("{claims}\nwritten to {}\n", self.out.display()), &claims)
    }
}
