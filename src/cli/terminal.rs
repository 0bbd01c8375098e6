//! Observer that reports the progress of a run to the terminal, and stops it at a signal.

use super::job::Job;
use super::set_up::SetUpTold;
use super::signal;
use crate::error::Result;
use crate::output::checkpoint::Checkpoint;
use crate::output::progress::{Progress, State};
use crate::simulation::{Observer, Row, RunState};

/// Energy at the start, relative to what the plate has, up to which it is no measure.
const LEAST_START: f64 = 0.1;

/// Progress of a run, shown by the process that writes its tables.
pub(super) struct Terminal<'r> {
    job: &'r Job,
    progress: Option<Progress>,
    /// Progress report of the set-up, until the first row.
    set_up: Option<SetUpTold>,
    /// Energies at the start of the run and of the last row, in J. The start is NaN where it is no
    /// measure; the other one is then what the plate has, without the work of loads.
    start: f64,
    energy: f64,
}

impl<'r> Terminal<'r> {
    /// Creates the report of a run.
    pub fn new(job: &'r Job, set_up: Option<SetUpTold>) -> Terminal<'r> {
        Terminal { job, progress: None, set_up, start: 0.0, energy: 0.0 }
    }

    /// Begins to show the progress of a new or resumed run.
    pub fn begin(&mut self, from: Option<&Checkpoint>) {
        let Job { run, voice, .. } = self.job;
        let time = &run.scene.time;
        let (step, begin) =
            from.map_or((0, 0.0), |Checkpoint { pause: RunState { step, time, .. }, .. }| (*step, *time));
        self.progress = Some(Progress::new(step..time.steps(), begin..time.end, voice.is_silent()));
    }

    /// Returns whether something puts energy in, so that what the plate has is no part of a start.
    fn is_driven(&self) -> bool {
        let scene = &self.job.run.scene;
        scene.changes().is_some() || scene.obstacles.iter().any(|obstacle| obstacle.velocity.is_some())
    }

    /// Clears the line of the progress.
    pub fn finish(self) {
        self.progress.into_iter().for_each(Progress::finish);
    }
}

impl Observer for Terminal<'_> {
    fn begin(&mut self, energy: f64) {
        self.start = if self.is_driven() { f64::NAN } else { energy };
    }

    fn row(&mut self, row: &Row) -> Result<()> {
        self.set_up = None;
        let stored = row.kinetic + row.elastic;
        // Where a load has done most of the work, the energy at the start is no measure.
        if self.start.abs() <= LEAST_START * stored {
            self.start = f64::NAN;
        }
        self.energy = if self.start.is_nan() { stored } else { row.energy };
        Ok(())
    }

    fn interrupts(&self) -> bool {
        signal::signal_received()
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        let (time, energy, start) = (step as f64 * self.job.run.scene.time.step, self.energy, self.start);
        if let Some(progress) = &mut self.progress {
            progress.tick(step, || State { time, contact_nodes, energy, start });
        }
    }
}
