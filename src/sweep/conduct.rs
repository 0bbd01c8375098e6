//! Execution of the runs of a sweep, on one or several threads, in lock step where they share their
//! matrices.

use super::one_run::run_together;
use super::plan::{PlannedRun, groups, typical_run};
use super::prepared_run::{CarriedState, Finished, Leader, PreparedRun};
use super::row::SweepRow;
use crate::error::{Error, Result};
use crate::kernels::Lanes;
use crate::scene::{Scene, SweepSpec};
use crate::simulation::{Model, condensed};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread;
use std::time::Instant;

/// Loader of the scene with further settings, each `key=value`.
pub type Loader<'l> = dyn Fn(&[String]) -> Result<Scene> + Sync + 'l;

/// Receiver of finished runs.
pub trait SweepRecord {
    /// Returns whether the row of a run is known from before.
    fn is_known(&self, index: usize) -> bool;

    /// Returns the state with which the last known run of a group ended, if it is known.
    fn state(&self, group: usize) -> Option<CarriedState>;

    /// Receives the row of a finished run, and the state that the next run of the group starts
    /// from.
    ///
    /// # Errors
    /// Returns any error that must stop the sweep.
    fn done(&mut self, group: usize, row: SweepRow, state: Option<&CarriedState>) -> Result<()>;
}

/// Finished run on its way to the record: its group, its row, and the state that the next run of
/// the group starts from.
type Noted = (usize, SweepRow, Option<CarriedState>);

/// Runs of a group that are still to be made, each from the end of the one before.
#[derive(Clone)]
struct Waiting {
    group: usize,
    runs: Vec<PlannedRun>,
    /// State that the first run starts from.
    state: Option<CarriedState>,
    is_carried: bool,
}

/// Part of a sweep that is the same for all its threads.
struct Conductor<'c> {
    sweep: &'c SweepSpec,
    load: &'c Loader<'c>,
    interrupts: &'c (dyn Fn() -> bool + Sync),
    /// Run that decides what goes in lock step; `None` where nothing can, as there is one group.
    leader: Option<PlannedRun>,
    waiting: Vec<Waiting>,
    /// Number of groups that a thread takes at once.
    lot: usize,
    next: AtomicUsize,
}

/// Makes the runs of a sweep that the record does not know, on a number of threads.
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
) -> Result<()> {
    let (mut made, mut total) = (0, 0);
    let mut waiting = Vec::new();
    let groups = groups(sweep);
    let leader = typical_run(sweep).filter(|_| groups.len() > 1);
    for (group, runs) in groups.into_iter().enumerate() {
        let recorded = runs.iter().take_while(|run| record.is_known(run.index)).count();
        let rest = runs[recorded..].to_vec();
        (made, total) = (made + recorded, total + runs.len());
        let state = if rest.is_empty() { None } else { record.state(group) };
        if !rest.is_empty() {
            waiting.push(Waiting { group, is_carried: runs.len() > 1, runs: rest, state });
        }
    }
    let lot = waiting.len().div_ceil(threads.max(1)).clamp(1, Lanes::COUNT);
    let conductor = Conductor { sweep, load, interrupts, leader, waiting, lot, next: AtomicUsize::new(0) };
    let (sender, receiver) = channel();
    thread::scope(|scope| {
        for _ in 0..threads.min(conductor.waiting.len().div_ceil(lot)) {
            let (conductor, sender) = (&conductor, sender.clone());
            scope.spawn(move || conductor.work(&sender));
        }
        drop(sender);
        // A failed record drops the receiver, at which the threads stop.
        for (group, row, state) in receiver {
            record.done(group, row, state.as_ref())?;
            made += 1;
        }
        Ok::<_, Error>(())
    })?;
    if made < total {
        let words = format!("interrupted: {made} of {total} runs are done; the same command goes on");
        return Err(Error::Stopped(words));
    }
    Ok(())
}

/// Makes one run of a sweep without others, by its index in the plan. Its row is the one of the
/// whole sweep, to the bit.
///
/// # Errors
/// Returns [`Error::Usage`] where the sweep has no such run, or where the run continues another,
/// and [`Error::Stopped`] once `interrupts` says so. The failure of the run is a row, and no error.
pub fn conduct_one(
    sweep: &SweepSpec,
    load: &Loader,
    index: usize,
    interrupts: &(dyn Fn() -> bool + Sync),
) -> Result<SweepRow> {
    let groups = groups(sweep);
    let Some(runs) = groups.iter().find(|runs| runs.iter().any(|run| run.index == index)) else {
        let count = groups.iter().map(Vec::len).sum::<usize>();
        return Err(Error::Usage(format!("run {index}: the sweep has the runs 0 to {}", count - 1)));
    };
    if runs.len() > 1 {
        return Err(Error::Usage(format!("run {index} continues others; expected runs that start apart")));
    }
    let leader = typical_run(sweep).filter(|_| groups.len() > 1);
    let waiting = vec![Waiting { group: 0, runs: runs.clone(), state: None, is_carried: false }];
    let next = AtomicUsize::new(0);
    let conductor = Conductor { sweep, load, interrupts, leader, waiting, lot: 1, next };
    let (sender, receiver) = channel();
    conductor.work(&sender);
    let made = receiver.try_recv().map(|(_, row, _)| row);
    made.map_err(|_| Error::Stopped(format!("interrupted: run {index} is not done")))
}

/// Time for which some runs are watched, in s.
const WATCH: f64 = 0.2;

/// Returns the number of runs of a sweep, and the time (s) that one thread takes for all: expected
/// from some periods of some of the runs.
pub fn expected_time(sweep: &SweepSpec, load: &Loader) -> (usize, f64) {
    let groups = groups(sweep);
    let leader = typical_run(sweep).filter(|_| groups.len() > 1);
    let first = |runs: &Vec<PlannedRun>| {
        let runs = runs.first().cloned().into_iter().collect();
        Waiting { group: 0, runs, state: None, is_carried: false }
    };
    let stride = groups.len().div_ceil(Lanes::COUNT).max(1);
    let waiting: Vec<Waiting> = groups.iter().step_by(stride).map(first).collect();
    let time = |periods: u64| {
        let settings = [format!("sweep.periods={periods}"), "sweep.settle=0".into()];
        let short = |more: &[String]| load(&[more, &settings].concat());
        let (lot, next) = (waiting.len(), AtomicUsize::new(0));
        let (leader, waiting) = (leader.clone(), waiting.clone());
        let conductor = Conductor { sweep, load: &short, interrupts: &|| false, leader, waiting, lot, next };
        let clock = Instant::now();
        let (sender, _receiver) = channel();
        conductor.work(&sender);
        clock.elapsed().as_secs_f64()
    };
    let one = time(1);
    let periods = ((WATCH / one) as u64).clamp(1, sweep.periods) + 1;
    let period = ((time(periods) - one) / (periods - 1) as f64).max(0.0);
    let runs = groups.iter().map(Vec::len).sum::<usize>();
    let share = runs as f64 / waiting.len().max(1) as f64;
    (runs, share * (one + period * (sweep.periods - 1) as f64))
}

impl Conductor<'_> {
    /// Makes lots of groups one after the other, until none is left or the sweep stops.
    fn work(&self, finished: &Sender<Noted>) {
        // A run that fails here fails again where it is due, and says why.
        let run = self.leader.as_ref().and_then(|planned| self.prepare(planned, None).ok());
        let leader = run.as_ref().map(Leader::new);
        loop {
            let first = self.next.fetch_add(self.lot, Ordering::Relaxed);
            let last = self.waiting.len().min(first + self.lot);
            let Some(lot) = self.waiting.get(first..last).filter(|lot| !lot.is_empty()) else { return };
            if self.make_lot(lot.to_vec(), leader.as_ref(), finished).is_none() {
                return;
            }
        }
    }

    /// Makes the runs of some groups, those of the same place in their groups together. Returns
    /// `None` where the sweep stops.
    fn make_lot(
        &self,
        mut lot: Vec<Waiting>,
        leader: Option<&Leader>,
        finished: &Sender<Noted>,
    ) -> Option<()> {
        let most = lot.iter().map(|group| group.runs.len()).max().unwrap_or(0);
        for place in 0..most {
            let mut due: Vec<&mut Waiting> =
                lot.iter_mut().filter(|group| place < group.runs.len()).collect();
            let prepared: Vec<Result<PreparedRun>> =
                due.iter().map(|group| self.prepare(&group.runs[place], group.state.as_ref())).collect();
            let made = make_all(prepared, leader, self.interrupts)?;
            for (group, made) in due.iter_mut().zip(made) {
                let outcome = made.map(|(measures, last)| {
                    group.state = group.is_carried.then_some(last);
                    measures
                });
                let row = SweepRow::new(&group.runs[place], outcome.map_err(|why| why.to_string()));
                finished.send((group.group, row, group.state.clone())).ok()?;
            }
        }
        Some(())
    }

    /// Prepares one run.
    fn prepare(&self, planned: &PlannedRun, state: Option<&CarriedState>) -> Result<PreparedRun> {
        let (scene, sweep) = scene_at(self.sweep, self.load, &planned.values)?;
        PreparedRun::new(scene, sweep, state, Model::new)
    }
}

/// Makes some runs: those that go with the leader in lock step, the others one by one. Returns
/// `None` once `interrupts` says so.
///
/// Runs in lock step end together at an error of any. Each is then made in lanes of its own, which
/// gives the same numbers to the bit, and one that fails there by itself.
fn make_all(
    prepared: Vec<Result<PreparedRun>>,
    leader: Option<&Leader>,
    interrupts: &dyn Fn() -> bool,
) -> Option<Vec<Result<Finished>>> {
    if interrupts() {
        return None;
    }
    let goes = |run: &&PreparedRun| leader.is_some_and(|leader| leader.takes(run));
    let in_lanes = |runs: &[&PreparedRun]| match leader {
        Some(leader) if !runs.is_empty() => run_together(runs, leader, interrupts),
        _ => Ok(Vec::new()),
    };
    let together: Vec<&PreparedRun> =
        prepared.iter().filter_map(|run| run.as_ref().ok()).filter(goes).collect();
    let (mut made, mut is_whole) = (Vec::new().into_iter(), false);
    match in_lanes(&together) {
        Err(Error::Interrupted { .. }) => return None,
        Err(_) => {}
        Ok(several) => (made, is_whole) = (several.into_iter(), true),
    }
    let mut one = |run: PreparedRun| {
        if goes(&&run) {
            let outcome = match is_whole {
                true => made.next(),
                false => in_lanes(&[&run]).ok().and_then(|runs| runs.into_iter().next()),
            };
            if let Some(finished) = outcome {
                return Ok(finished);
            }
        }
        run.run_alone(&condensed, interrupts)
    };
    let outcomes: Vec<Result<Finished>> = prepared.into_iter().map(|run| run.and_then(&mut one)).collect();
    let is_interrupted = outcomes.iter().any(|made| matches!(made, Err(Error::Interrupted { .. })));
    (!is_interrupted).then_some(outcomes)
}

/// Returns the scene of a run, with a step that divides the period and the end of the run, and its
/// own sweep, whose period may depend on the values.
///
/// # Errors
/// Returns the errors of the scene.
pub fn scene_at(sweep: &SweepSpec, load: &Loader, values: &[f64]) -> Result<(Scene, SweepSpec)> {
    let mut settings: Vec<String> =
        sweep.keys().zip(values).map(|((_, key), value)| format!("{key}={}", spell(*value))).collect();
    let scene = load(&settings)?;
    let spec = scene.sweep.unwrap_or_else(|| sweep.clone());
    let period = spec.period();
    // Rounding must not add a step.
    let per_period = (period / scene.time.step * (1.0 - 1e-9)).ceil().max(1.0);
    settings.push(format!("time.step={:?}", period / per_period));
    settings.push(format!("time.end={:?}", spec.periods as f64 * period));
    let mut scene = load(&settings)?;
    // Nothing of these is measured.
    (scene.output.fields, scene.output.extremes) = (None, false);
    Ok((scene, spec))
}

/// Formats a value for a setting; whole numbers without a point, which counts need.
pub fn spell(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 { format!("{value:.0}") } else { format!("{value:?}") }
}
