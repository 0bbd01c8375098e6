//! Main loop of a run, from step to step.

use super::contacts::{ContactRecorder, ContactTotal};
use super::deflection::DeflectionWatch;
use super::extremes::{Extremes, StressWatch};
use super::forces::ForceRecorder;
use super::outcome::{add_contact, first_impact};
use super::readings::Accelerations;
use super::step_check::{GUARD_EVERY, check_residual};
use super::{
    BlockSeconds, Contact, DeflectionDof, Impact, Model, NodeEvent, Observer, Outcome, Row, RunState,
};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::energy::Guard;
use crate::error::{Error, Result};
use crate::hash::Extent;
use crate::linalg::Engine;
use crate::scene::Scene;
use crate::scheme::{Event, Scheme};
use std::time::Instant;

/// Step just made, and its time.
#[derive(Clone, Copy)]
struct StepTime {
    /// Index of the step.
    step: u64,
    /// Time, in s.
    time: f64,
    /// Whether the run ends with this step.
    is_last: bool,
}

/// Contact during the step just made.
struct StepContact {
    /// Contact of all nodes at the end of the step.
    total: ContactTotal,
    /// Events of this process's nodes.
    events: Vec<Event>,
    /// Whether none of this process's nodes touches.
    is_free: bool,
}

/// Main loop of a run: all objects that a step reads or changes.
pub(super) struct TimeLoop<'r, E: Engine> {
    pub scene: &'r Scene,
    pub model: &'r Model<E>,
    pub scheme: &'r mut dyn Scheme,
    pub outcome: &'r mut Outcome,
    pub monitor: &'r mut RunMonitor,
    pub observer: &'r mut dyn Observer,
    /// Quantities at the probes.
    pub probes: Vec<f64>,
    /// Result of this process's observer, for instance an error of a full disk; the process
    /// continues until all processes know of it.
    pub observed: Result<()>,
}

/// Steps the scheme from its present step to the end of the scene, and records each step.
/// Collective.
pub(super) fn time_loop<E: Engine>(mut run: TimeLoop<E>) -> Result<()> {
    run.observer.begin(run.outcome.energy.start);
    // A resumed run may start at a step that was recorded before the interruption.
    if run.monitor.is_recorded {
        run.advance()?;
    }
    loop {
        let now = run.step_time();
        run.keep_end(now)?;

        let contact = run.record_events()?;
        run.check_step(now)?;
        run.follow_contacts(&contact)?;
        run.monitor.clock.lap(|blocks| &mut blocks.contacts);
        run.follow_deflections(now)?;
        run.follow_accelerations()?;
        run.follow_stresses()?;
        run.row(now, &contact)?;
        run.fields(now)?;
        run.reactions(now)?;
        run.observer.step(now.step, contact.total.nodes);
        if now.is_last {
            run.envelope();
            return run.share_error();
        }

        let stops = run.is_asked_to_stop()?;
        run.checkpoint(now, stops)?;
        if stops {
            return run.interrupt(now);
        }

        run.advance()?;
    }
}

impl<E: Engine> TimeLoop<'_, E> {
    fn step_time(&self) -> StepTime {
        let step = self.scheme.step();
        StepTime { step, time: self.scheme.time(), is_last: step == self.scene.time.steps() }
    }

    /// Passes the state at the last step to an observer that keeps it.
    ///
    /// The state comes before all that marks the end, so that a run to a later end continues from
    /// it as if there had been no end.
    fn keep_end(&mut self, now: StepTime) -> Result<()> {
        self.monitor.is_recorded = false;
        if now.is_last && self.observer.keeps_end() {
            let state = self.state(now)?;
            let motion = self.model.places.motion(&self.model.system.engine, self.scene, self.scheme)?;
            if let Some((state, motion)) = state.zip(motion) {
                self.notify(|observer| observer.end(state, motion));
            }
            self.monitor.clock.lap(|blocks| &mut blocks.checkpoints);
        }
        self.monitor.is_recorded = true;
        Ok(())
    }

    /// Records the step and its events in the outcome.
    fn record_events(&mut self) -> Result<StepContact> {
        let TimeLoop { scene, model, scheme, outcome, monitor, observer, .. } = self;
        let events = scheme.take_events();
        for &event in &events {
            let Event { time, bound, closes, velocity, .. } = event;
            let DeflectionDof { node, at, .. } = model.sites[bound];
            if closes && outcome.first_impact.is_none() {
                outcome.first_impact = Some(Impact { time, node, at, velocity });
            }
            add_contact(&mut outcome.contacts, scene.time.step, time);
            observer.event(&NodeEvent { node, at, event })?;
        }
        let is_free = scheme.record().is_free(scheme.limits());
        let total = monitor.forces.contact(model, *scheme, is_free)?;
        self.record_contact(!events.is_empty(), &total)?;
        Ok(StepContact { total, events, is_free })
    }

    /// Records the step in the outcome, given whether it had events and its contact.
    fn record_contact(&mut self, has_events: bool, contact: &ContactTotal) -> Result<()> {
        let TimeLoop { scene, model, scheme, outcome, .. } = self;
        let verdict = scheme.step_report();
        outcome.steps = scheme.step();
        outcome.vi_iterations += u64::from(verdict.iterations);
        outcome.retries += u64::from(verdict.retries > 0);
        if verdict.kkt > outcome.worst_kkt || verdict.kkt.is_nan() {
            outcome.worst_kkt = verdict.kkt;
        }
        outcome.worst_penetration = outcome.worst_penetration.max(contact.penetration);
        outcome.contact_steps += u64::from(contact.nodes > 0 || has_events);
        if contact.nodes > 0 {
            outcome.most_contact_nodes = outcome.most_contact_nodes.max(contact.nodes);
            if outcome.first_impact.is_none() {
                outcome.first_impact = first_impact(model, *scheme, scene.time.step, &|_| true)?;
            }
            add_contact(&mut outcome.contacts, scene.time.step, scheme.time());
        }
        Ok(())
    }

    /// Checks the answer of the contact solver.
    fn check_step(&mut self, now: StepTime) -> Result<()> {
        let report = self.scheme.step_report();
        self.monitor.iterations += u64::from(report.iterations);
        self.monitor.kkt = self.monitor.kkt.max(report.kkt);
        check_residual(now.step, now.time, report.kkt, self.scene.solver.tolerance)
    }

    /// Extends, begins and ends the contacts of this process's nodes, and records the forces of
    /// obstacles and named supports.
    fn follow_contacts(&mut self, contact: &StepContact) -> Result<()> {
        let TimeLoop { scene, model, scheme, monitor, .. } = self;
        monitor.contacts.record(&model.sites, scene.time.step, *scheme, &contact.events, contact.is_free);
        monitor.forces.record(scene, model, *scheme, &contact.events)
    }

    /// Takes the deflections of this step.
    fn follow_deflections(&mut self, now: StepTime) -> Result<()> {
        let TimeLoop { model, scheme, monitor, .. } = self;
        monitor.deflection.note(&model.deflections, *scheme, now.is_last, model.system.engine.comm())
    }

    /// Takes the velocities of this step at the probes that record accelerations.
    fn follow_accelerations(&mut self) -> Result<()> {
        let Model { readings, system, .. } = self.model;
        self.monitor.accelerations.note(readings, system, self.scheme)
    }

    /// Takes the stresses of this step where the scene asks for their extremes.
    fn follow_stresses(&mut self) -> Result<()> {
        let Some(stresses) = &mut self.monitor.stresses else { return Ok(()) };
        stresses.note(&self.model.system.engine, self.scheme.displacement(), self.scheme.time())?;
        self.monitor.clock.lap(|blocks| &mut blocks.rows);
        Ok(())
    }

    /// Passes the envelope of the stresses to the observer at the end of the run.
    fn envelope(&mut self) {
        let TimeLoop { monitor, observer, observed, .. } = self;
        if let (Some(stresses), Ok(())) = (&monitor.stresses, &observed) {
            *observed = observer.envelope(&stresses.envelope());
        }
    }

    /// Checks the energy, and passes a row of the history to the observer where one is due.
    fn row(&mut self, now: StepTime, contact: &StepContact) -> Result<()> {
        let StepTime { step, time, is_last } = now;
        let is_due = step.is_multiple_of(self.scene.output.every) || is_last;
        if !is_due && !step.is_multiple_of(GUARD_EVERY) {
            return Ok(());
        }
        if let Some(following) = &self.model.system.drive.following {
            following.refuse_poles(time, self.scheme.displacement())?;
        }
        let energies = self.scheme.energies()?;
        let guarded = self.monitor.guard.check(step, time, energies);
        if !is_due || matches!(guarded, Err(Error::NotFinite { .. })) {
            return guarded;
        }
        self.outcome.energy.record(energies);
        let Model { readings, system, .. } = self.model;
        readings.read(system, &self.monitor.accelerations, self.scheme, &mut self.probes)?;
        let row = Row {
            step,
            time,
            energy: energies.total(),
            kinetic: energies.kinetic,
            elastic: energies.elastic,
            work: energies.work,
            contact_nodes: contact.total.nodes as u64,
            contact_force: contact.total.force,
            vi_iterations: self.monitor.iterations,
            kkt: self.monitor.kkt,
            probes: &self.probes,
            forces: &self.monitor.forces.take_columns(),
        };
        if self.observed.is_ok() {
            self.observed = self.observer.row(&row);
        }
        self.contacts(is_last)?;
        if self.observed.is_ok() {
            self.observed = self.observer.state(self.scheme);
        }
        (self.monitor.iterations, self.monitor.kkt) = (0, 0.0);
        self.monitor.clock.lap(|blocks| &mut blocks.rows);
        guarded
    }

    /// Passes the contacts that ended since the last row to the observer, at the last step also the
    /// open ones.
    fn contacts(&mut self, is_last: bool) -> Result<()> {
        if !self.scene.has_contact() {
            return Ok(());
        }
        let contacts = &mut self.monitor.contacts;
        if is_last {
            contacts.close(&self.model.sites, f64::INFINITY);
        }
        let ended = self.model.system.engine.comm().all_gather(&contacts.take());
        let ended: Vec<Contact> = ended.into_iter().map(Contact::from_numbers).collect();
        self.outcome.node_contacts += ended.len() as u64;
        self.notify(|observer| observer.contacts(&ended));
        Ok(())
    }

    /// Passes a snapshot to the observer where one is due; a process whose observer failed earlier
    /// only takes part in the sampling.
    fn fields(&mut self, now: StepTime) -> Result<()> {
        let Model { system, fields, .. } = self.model;
        let (Some(fields), Some(asked)) = (fields, self.scene.output.fields) else { return Ok(()) };
        if !now.step.is_multiple_of(asked.every) && !now.is_last {
            return Ok(());
        }
        let snapshot = fields.sample(system, self.scheme)?;
        self.notify(|observer| observer.fields(&snapshot));
        let comm = system.engine.comm();
        let Extent { length, checksum } = self.observer.piece();
        let pieces = comm.all_gather_one((length, checksum)).into_iter();
        let pieces: Vec<Extent> = pieces.map(|(length, checksum)| Extent { length, checksum }).collect();
        if comm.all_reduce_all(self.observed.is_ok()) {
            self.observed = self.observer.fields_complete(now.step, now.time, &pieces);
        }
        self.monitor.clock.lap(|blocks| &mut blocks.fields);
        Ok(())
    }

    /// Passes the reactions along named supports to the observer where they are due: with each
    /// snapshot, or at the start where there are none, and at the end.
    fn reactions(&mut self, StepTime { step, time, is_last }: StepTime) -> Result<()> {
        let is_due = self.scene.output.fields.map_or(step == 0, |asked| step.is_multiple_of(asked.every));
        if !is_due && !is_last {
            return Ok(());
        }
        if let Some(rows) = self.monitor.forces.at_nodes(self.model)? {
            self.notify(|observer| observer.reactions(step, time, &rows));
        }
        Ok(())
    }

    /// Returns whether an observer asks to stop; all processes stop after the same step.
    ///
    /// # Errors
    /// Returns the error of any observer, on all processes.
    fn is_asked_to_stop(&mut self) -> Result<bool> {
        let flags = (self.observed.is_err(), self.observed.is_ok() && self.observer.interrupts());
        let comm = self.model.system.engine.comm();
        let (failed, stops) = comm.all_reduce(flags, |a, b| (a.0 || b.0, a.1 || b.1));
        if failed {
            self.share_error()?;
        }
        Ok(stops)
    }

    /// Passes the state of the run to the observer where a checkpoint is due, or before a stop.
    fn checkpoint(&mut self, now: StepTime, stops: bool) -> Result<()> {
        let every = self.scene.output.checkpoint_every;
        if stops || now.step > 0 && every.is_some_and(|every| now.step.is_multiple_of(every)) {
            let state = self.state(now)?;
            self.observed = state.map_or(Ok(()), |state| self.observer.pause(state));
            self.monitor.clock.lap(|blocks| &mut blocks.checkpoints);
        }
        Ok(())
    }

    /// Ends the run before its last step, with the error of an observer or [`Error::Interrupted`].
    fn interrupt(&mut self, now: StepTime) -> Result<()> {
        self.share_error()?;
        Err(Error::Interrupted { step: now.step, time: now.time })
    }

    /// Makes the next step.
    fn advance(&mut self) -> Result<()> {
        let advanced = self.scheme.advance().map_err(|error| locate(error, self.model));
        self.monitor.clock.lap(|blocks| &mut blocks.advance);
        self.monitor.clock.shift_to_compliance(self.scheme.take_compliance_seconds());
        advanced
    }

    /// Collects the whole state of the run, on the first process only.
    fn state(&mut self, now: StepTime) -> Result<Option<RunState>> {
        let TimeLoop { model, scheme, outcome, monitor, .. } = self;
        RunState::take(model, now.step, now.time, |archive| monitor.archive(model, *scheme, outcome, archive))
    }

    /// Passes a result to the observer of this process, unless it failed earlier.
    fn notify(&mut self, pass: impl FnOnce(&mut dyn Observer) -> Result<()>) {
        if self.observed.is_ok() {
            self.observed = pass(self.observer);
        }
    }

    /// Turns the error of one observer into an error on all processes.
    fn share_error(&mut self) -> Result<()> {
        self.model.system.engine.comm().all_ok(std::mem::replace(&mut self.observed, Ok(())))
    }
}

/// State of the main loop that persists between steps.
pub(super) struct RunMonitor {
    guard: Guard,
    /// Number of iterations since the last row.
    iterations: u64,
    kkt: f64,
    contacts: ContactRecorder,
    pub(super) deflection: DeflectionWatch,
    accelerations: Accelerations,
    /// Largest stresses so far, if the scene asks for them.
    stresses: Option<StressWatch>,
    pub(super) forces: ForceRecorder,
    /// Whether the present step has been recorded.
    is_recorded: bool,
    pub(super) clock: BlockClock,
}

/// Stopwatch that adds the time since its last reading to a block of the main loop.
///
/// The loop reads the stopwatch twice per step, and after rows, snapshots and checkpoints where
/// they are due. The time that other steps take to find out whether they are due counts with the
/// next block.
pub(super) struct BlockClock {
    read: Instant,
    pub seconds: BlockSeconds,
}

impl BlockClock {
    /// Starts the stopwatch, with the times of an interrupted run.
    fn start(seconds: BlockSeconds) -> BlockClock {
        BlockClock { read: Instant::now(), seconds }
    }

    /// Adds the time since the last reading to a block.
    fn lap(&mut self, block: impl FnOnce(&mut BlockSeconds) -> &mut f64) {
        let now = Instant::now();
        *block(&mut self.seconds) += (now - self.read).as_secs_f64();
        self.read = now;
    }

    /// Counts a part of the steps (s) as work on the compliance.
    fn shift_to_compliance(&mut self, part: f64) {
        self.seconds.advance -= part;
        self.seconds.compliance += part;
    }
}

impl RunMonitor {
    /// Starts to monitor a scheme of a model.
    pub(super) fn new<E: Engine>(scene: &Scene, model: &Model<E>, scheme: &dyn Scheme) -> Result<RunMonitor> {
        Ok(RunMonitor {
            guard: model.guard(scene, scheme)?,
            iterations: 0,
            kkt: 0.0,
            contacts: ContactRecorder::default(),
            deflection: DeflectionWatch::new(&model.system, scene.time.step),
            accelerations: Accelerations::new(scene),
            stresses: model.stress_watch(),
            forces: ForceRecorder::new(scene, model),
            is_recorded: false,
            clock: BlockClock::start(BlockSeconds::default()),
        })
    }

    /// Returns the extremes of the run so far, if the scene asks for them. Collective.
    pub(super) fn extremes<E: Engine>(&self, model: &Model<E>) -> Option<Extremes> {
        let von_mises = self.stresses.as_ref()?.largest(model.system.engine.comm())?;
        Some(Extremes { von_mises })
    }

    /// Saves or restores the whole run between two steps.
    pub(super) fn archive<E: Engine>(
        &mut self,
        model: &Model<E>,
        scheme: &mut dyn Scheme,
        outcome: &mut Outcome,
        archive: &mut Archive,
    ) -> Result<()> {
        scheme.archive(archive)?;
        self.guard.archive(archive)?;
        archive.value(&mut self.iterations)?;
        archive.value(&mut self.kkt)?;
        archive.value(&mut self.is_recorded)?;
        self.contacts.archive(model.system.bounds.len(), archive)?;
        self.deflection.archive(model.system.engine.comm(), archive)?;
        self.accelerations.archive(archive)?;
        if let Some(stresses) = &mut self.stresses {
            stresses.archive(model.system.engine.comm(), archive)?;
        }
        self.forces.archive(archive)?;
        // A last state has no times, so that equal runs leave equal bytes.
        outcome.seconds.blocks = if self.is_recorded { self.clock.seconds } else { BlockSeconds::default() };
        outcome.worst_penetration = model.system.engine.comm().all_reduce_max(outcome.worst_penetration);
        outcome.archive(archive)?;
        if !archive.saves() {
            self.clock = BlockClock::start(outcome.seconds.blocks);
        }
        Ok(())
    }
}

/// Adds node and position to the error of a scheme, which has no mesh and only the index of the
/// bound.
fn locate<E: Engine>(error: Error, model: &Model<E>) -> Error {
    match error {
        Error::Events { step, time, count, bound, .. } => {
            let DeflectionDof { node, at: [x, y], .. } = model.sites[bound];
            Error::Events { step, time, count, bound, place: format!("node {node} at ({x}, {y})") }
        }
        error => error,
    }
}
