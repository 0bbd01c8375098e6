//! Execution of the runs of a sweep, on one or several threads.

use super::one_run::{CarriedState, run};
use super::plan::{PlannedRun, groups};
use super::report::SweepRow;
use crate::error::{Error, Result};
use crate::scene::{Scene, SweepSpec};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread;

/// Loader of the scene with further settings, each `key=value`.
pub type Loader<'l> = dyn Fn(&[String]) -> Result<Scene> + Sync + 'l;

/// Receiver of finished runs.
pub trait SweepRecord {
    /// Returns the row of a run that is known from before, if it is.
    fn known(&self, index: usize) -> Option<SweepRow>;

    /// Returns the state with which the last known run of a group ended, if it is known.
    fn state(&self, group: usize) -> Option<CarriedState>;

    /// Receives the row of a finished run, and the state that the next run of the group starts
    /// from.
    ///
    /// # Errors
    /// Returns any error that must stop the sweep.
    fn done(&mut self, group: usize, row: &SweepRow, state: Option<&CarriedState>) -> Result<()>;
}

/// Finished run on its way to the record.
struct Finished {
    group: usize,
    row: SweepRow,
    state: Option<CarriedState>,
}

/// Part of a sweep that is the same for all its threads.
struct Conductor<'c> {
    sweep: &'c SweepSpec,
    load: &'c Loader<'c>,
    interrupts: &'c (dyn Fn() -> bool + Sync),
    /// Runs still to make, by group, each with the state that its first run starts from.
    waiting: Vec<(usize, Vec<PlannedRun>, Option<CarriedState>)>,
    next: AtomicUsize,
}

/// Makes the runs of a sweep that the record does not know, on a number of threads. Returns all
/// rows in the order of the plan.
///
/// # Errors
/// Returns the errors of the record, and [`Error::Stopped`] once `interrupts` says so. The failure
/// of a run is a row, and no error.
pub fn conduct(
    sweep: &SweepSpec,
    load: &Loader,
    record: &mut dyn SweepRecord,
    threads: usize,
    interrupts: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<SweepRow>> {
    let mut rows = Vec::new();
    let mut waiting = Vec::new();
    for (group, runs) in groups(sweep).into_iter().enumerate() {
        let known: Vec<SweepRow> = runs.iter().map_while(|run| record.known(run.index)).collect();
        let rest = runs[known.len()..].to_vec();
        let state = if rest.is_empty() { None } else { record.state(group) };
        rows.extend(known);
        if !rest.is_empty() {
            waiting.push((group, rest, state));
        }
    }
    let total = rows.len() + waiting.iter().map(|(_, runs, _)| runs.len()).sum::<usize>();
    let conductor = Conductor { sweep, load, interrupts, waiting, next: AtomicUsize::new(0) };
    let (sender, receiver) = channel();
    thread::scope(|scope| {
        for _ in 0..threads.min(conductor.waiting.len()) {
            let (conductor, sender) = (&conductor, sender.clone());
            scope.spawn(move || conductor.work(&sender));
        }
        drop(sender);
        // A failed record drops the receiver, at which the threads stop.
        for Finished { group, row, state } in receiver {
            record.done(group, &row, state.as_ref())?;
            rows.push(row);
        }
        Ok::<_, Error>(())
    })?;
    if rows.len() < total {
        let words = format!("interrupted: {} of {total} runs are done; the same command goes on", rows.len());
        return Err(Error::Stopped(words));
    }
    rows.sort_by_key(|row| row.index);
    Ok(rows)
}

impl Conductor<'_> {
    /// Makes the runs of one group after the other, until none is left or the sweep stops.
    fn work(&self, finished: &Sender<Finished>) {
        while let Some((group, runs, state)) = self.waiting.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            let mut state = state.clone();
            for planned in runs {
                let made = self.make(planned, state.as_ref());
                let is_carried = runs.len() > 1 || state.is_some();
                let outcome = match made {
                    Err(Error::Interrupted { .. }) => return,
                    Err(why) => Err(why.to_string()),
                    Ok((measures, last)) => {
                        state = is_carried.then_some(last);
                        Ok(measures)
                    }
                };
                let row = SweepRow::new(planned, outcome);
                if finished.send(Finished { group: *group, row, state: state.clone() }).is_err() {
                    return;
                }
            }
        }
    }

    /// Makes one run.
    fn make(
        &self,
        planned: &PlannedRun,
        state: Option<&CarriedState>,
    ) -> Result<(super::Measures, CarriedState)> {
        if (self.interrupts)() {
            return Err(Error::Interrupted { step: 0, time: 0.0 });
        }
        let (scene, sweep) = scene_at(self.sweep, self.load, &planned.values)?;
        run(&scene, &sweep, state, self.interrupts)
    }
}

/// Returns the scene of a run, with a step that divides the period and the end of the run, and its
/// own sweep, whose period may depend on the values.
///
/// # Errors
/// Returns the errors of the scene.
pub fn scene_at(sweep: &SweepSpec, load: &Loader, values: &[f64]) -> Result<(Scene, SweepSpec)> {
    let mut settings: Vec<String> =
        sweep.over.iter().zip(values).map(|(of, value)| format!("{}={}", of.key, spell(*value))).collect();
    let scene = load(&settings)?;
    let own = scene.sweep.unwrap_or_else(|| sweep.clone());
    let period = own.period();
    // Rounding must not add a step.
    let per_period = (period / scene.time.step * (1.0 - 1e-9)).ceil().max(1.0);
    settings.push(format!("time.step={:?}", period / per_period));
    settings.push(format!("time.end={:?}", own.periods as f64 * period));
    let mut scene = load(&settings)?;
    // Nothing of these is measured.
    (scene.output.fields, scene.output.extremes) = (None, false);
    Ok((scene, own))
}

/// Formats a value for a setting; whole numbers without a point, which counts need.
fn spell(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 { format!("{value:.0}") } else { format!("{value:?}") }
}
