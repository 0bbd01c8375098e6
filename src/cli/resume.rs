//! Command `rebond resume`.

use super::cache::CacheArgs;
use super::command::{Execute, Program};
use super::job::Job;
use super::launch;
use super::printing::OutputMode;
use crate::error::Result;
use crate::output::run_files::ResumedRun;
use clap::Args;
use std::path::PathBuf;

const EXAMPLES: &str = "\
Examples:
  rebond resume runs/plate
  rebond resume runs/plate --until 0.5    # beyond the end of the scene";

/// Resume an interrupted run from its newest checkpoint, bitwise as if without interruption
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Resume {
    /// Run folder with checkpoint-*.bin; with --until also with end.state
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// New end in s, a whole number of steps; also for a finished run
    #[arg(long, value_name = "T")]
    until: Option<String>,
    /// Also print how the answers were computed: steps, solves, residuals, times
    #[arg(long, short)]
    verbose: bool,
    #[command(flatten)]
    cache: CacheArgs,
    #[command(flatten)]
    voice: OutputMode,
}

impl Execute for Resume {
    fn execute(&self, _: Program) -> Result<()> {
        let ResumedRun { run, from, damaged } = ResumedRun::new(self.folder.clone(), self.until.as_deref())?;
        if launch::rank() == 0 {
            for why in damaged {
                eprintln!("rebond: {why}; going on from the one before");
            }
        }
        let Resume { cache, voice, verbose, .. } = *self;
        Job { run, cache, voice, from: Some(from), verbose }.execute()
    }
}
