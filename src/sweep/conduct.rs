//! Execution of the runs of a sweep, on one or several threads, in lock step where they share their
//! matrices.

use super::one_run::run_together;
use super::plan::{Plan, PlannedRun};
use super::prepared_run::{CarriedState, Finished, Leader, PreparedRun};
use super::row::SweepRow;
use crate::error::{Error, Result};
use crate::kernels::Lanes;
use crate::scene::{Scene, SweepSpec};
use crate::simulation::{Model, condensed};
use std::collections::BTreeMap;
use std::ops::Range;
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

/// Part of a sweep that is the same for all its threads.
struct Conductor<'c> {
    sweep: &'c SweepSpec,
    plan: &'c Plan<'c>,
    load: &'c Loader<'c>,
    interrupts: &'c (dyn Fn() -> bool + Sync),
    /// Runs of each group that are still to be made, each from the end of the one before.
    waiting: Vec<Range<usize>>,
    /// States that the first of these runs start from, by their indices.
    states: BTreeMap<usize, CarriedState>,
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
    let plan = Plan::new(sweep);
    let (mut waiting, mut states) = (Vec::new(), BTreeMap::new());
    for (group, mut runs) in plan.groups().enumerate() {
        while !runs.is_empty() && record.is_known(runs.start) {
            runs.start += 1;
        }
        if !runs.is_empty() {
            states.extend(record.state(group).map(|state| (runs.start, state)));
            waiting.push(runs);
        }
    }
    let total = plan.count();
    let mut made = total - waiting.iter().map(Range::len).sum::<usize>();
    let lot = waiting.len().div_ceil(threads.max(1)).clamp(1, Lanes::COUNT);
    let next = AtomicUsize::new(0);
    let conductor = Conductor { sweep, plan: &plan, load, interrupts, waiting, states, lot, next };
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
    let plan = Plan::new(sweep);
    if index >= plan.count() {
        return Err(Error::Usage(format!("run {index}: the sweep has the runs 0 to {}", plan.count() - 1)));
    }
    if plan.group_size() > 1 {
        return Err(Error::Usage(format!("run {index} continues others; expected runs that start apart")));
    }
    let waiting = plan.groups().skip(index).take(1).collect();
    let (states, next) = (BTreeMap::new(), AtomicUsize::new(0));
    let conductor = Conductor { sweep, plan: &plan, load, interrupts, waiting, states, lot: 1, next };
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
    let plan = Plan::new(sweep);
    let stride = plan.groups().count().div_ceil(Lanes::COUNT).max(1);
    let first = |runs: Range<usize>| runs.start..runs.start + 1;
    let waiting: Vec<Range<usize>> = plan.groups().step_by(stride).map(first).collect();
    let time = |periods: u64| {
        let settings = [format!("sweep.periods={periods}"), "sweep.settle=0".into()];
        let short = |more: &[String]| load(&[more, &settings].concat());
        let (lot, next) = (waiting.len(), AtomicUsize::new(0));
        let (waiting, states) = (waiting.clone(), BTreeMap::new());
        let (plan, load, interrupts) = (&plan, &short, &|| false);
        let conductor = Conductor { sweep, plan, load, interrupts, waiting, states, lot, next };
        let clock = Instant::now();
        let (sender, _receiver) = channel();
        conductor.work(&sender);
        clock.elapsed().as_secs_f64()
    };
    let one = time(1);
    let periods = ((WATCH / one) as u64).clamp(1, sweep.periods) + 1;
    let period = ((time(periods) - one) / (periods - 1) as f64).max(0.0);
    let runs = plan.count();
    let share = runs as f64 / waiting.len().max(1) as f64;
    (runs, share * (one + period * (sweep.periods - 1) as f64))
}

impl Conductor<'_> {
    /// Makes lots of groups one after the other, until none is left or the sweep stops.
    fn work(&self, finished: &Sender<Noted>) {
        // A run that fails here fails again where it is due, and says why. One group needs none.
        let leads = self.plan.count() > self.plan.group_size();
        let run = leads.then(|| self.prepare(&self.plan.typical_run(), None).ok()).flatten();
        let leader = run.as_ref().map(Leader::new);
        loop {
            let first = self.next.fetch_add(self.lot, Ordering::Relaxed);
            let last = self.waiting.len().min(first + self.lot);
            let Some(lot) = self.waiting.get(first..last).filter(|lot| !lot.is_empty()) else { return };
            if self.make_lot(lot, leader.as_ref(), finished).is_none() {
                return;
            }
        }
    }

    /// Makes the runs of some groups, those of the same place in their groups together. Returns
    /// `None` where the sweep stops.
    fn make_lot(
        &self,
        lot: &[Range<usize>],
        leader: Option<&Leader>,
        finished: &Sender<Noted>,
    ) -> Option<()> {
        let size = self.plan.group_size();
        let mut rest: Vec<_> =
            lot.iter().map(|runs| (runs.clone(), self.states.get(&runs.start).cloned())).collect();
        while !rest.is_empty() {
            let due: Vec<PlannedRun> = rest.iter().map(|(runs, _)| self.plan.run(runs.start)).collect();
            let prepared = due.iter().zip(&rest).map(|(run, (_, state))| self.prepare(run, state.as_ref()));
            let made = make_all(prepared.collect(), leader, self.interrupts)?;
            for (((runs, state), planned), made) in rest.iter_mut().zip(&due).zip(made) {
                let outcome = made.map(|(measures, last)| {
                    *state = (size > 1).then_some(last);
                    measures
                });
                let row = SweepRow::new(planned, outcome.map_err(|why| why.to_string()));
                finished.send((runs.start / size, row, state.clone())).ok()?;
                runs.start += 1;
            }
            rest.retain(|(runs, _)| !runs.is_empty());
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
