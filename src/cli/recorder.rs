//! Observer that writes the files of a run.

use super::job::Job;
use super::set_up::SetUpTold;
use super::signal;
use crate::error::Result;
use crate::motion::{self, Motion};
use crate::output::checkpoint::{self, Checkpoint, Outputs};
use crate::output::contacts::{self, Contacts};
use crate::output::events::{self, Events};
use crate::output::history::History;
use crate::output::progress::{Progress, State};
use crate::output::reactions::{self, Reactions};
use crate::output::vtu::{self, Contents, Series};
use crate::output::{extremes, plot, remove, report, summary, sweep, write_atomic};
use crate::simulation::{Contact, Envelope, NodeEvent, NodeReaction, Observer, Row, RunState, Snapshot};

/// Observer that writes a run's rows, contacts and checkpoints and reports progress to the
/// terminal. Of several ranks only one writes these; each writes its own fields.
pub(super) struct Recorder<'r> {
    job: &'r Job,
    pub files: Option<Files>,
    fields: Series,
    /// Progress report of the set-up, until the first row.
    set_up: Option<SetUpTold>,
    /// Energies of the first and of the last row, in J.
    start: Option<f64>,
    energy: f64,
    check_options: &'r dyn Fn() -> Result<()>,
}

/// Files that only one rank writes.
pub(super) struct Files {
    history: History,
    contacts: Option<Contacts>,
    /// Events file, for event-driven schemes.
    events: Option<Events>,
    /// Reactions file, for scenes with named supports.
    reactions: Option<Reactions>,
    progress: Progress,
}

impl Files {
    /// Creates the files of a new run, and removes those of an earlier one.
    fn create(Job { scene, folder, voice, .. }: &Job) -> Result<Files> {
        checkpoint::clear(folder)?;
        checkpoint::clear_state(folder)?;
        remove(&folder.join(summary::FILE))?;
        plot::clear(folder)?;
        remove(&folder.join(report::FILE))?;
        let probes: Vec<String> = scene.output.probes.iter().map(|probe| probe.name.clone()).collect();
        let history = History::create(folder, &probes, &scene.force_columns())?;
        vtu::clear(folder)?;
        contacts::clear(folder)?;
        let contacts = if !scene.has_contact() { None } else { Some(Contacts::create(folder)?) };
        events::clear(folder)?;
        let finds_events = scene.time.scheme.capabilities().is_event_driven;
        let events = if finds_events { Some(Events::create(folder)?) } else { None };
        reactions::clear(folder)?;
        let has_names = scene.supports.iter().any(|support| support.name.is_some());
        let reactions = if has_names { Some(Reactions::create(folder)?) } else { None };
        let progress = Progress::new(0..scene.time.steps(), 0.0..scene.time.end, voice.is_silent());
        Ok(Files { history, contacts, events, reactions, progress })
    }

    /// Truncates the files to their lengths at a checkpoint.
    fn resume(Job { scene, folder, voice, .. }: &Job, from: &Checkpoint) -> Result<Files> {
        let Outputs { history, contacts, events, reactions, .. } = from.outputs;
        let RunState { step, time, .. } = from.pause;
        let columns = [scene.output.probes.len(), scene.force_columns().len()];
        Ok(Files {
            history: History::resume(folder, columns, history)?,
            contacts: contacts.map(|length| Contacts::resume(folder, length)).transpose()?,
            events: events.map(|length| Events::resume(folder, length)).transpose()?,
            reactions: reactions.map(|length| Reactions::resume(folder, length)).transpose()?,
            progress: Progress::new(step..scene.time.steps(), time..scene.time.end, voice.is_silent()),
        })
    }

    /// Returns the lengths of the files on the disk.
    fn outputs(&mut self, fields: &Series) -> Result<Outputs> {
        Ok(Outputs {
            history: self.history.position()?,
            contacts: self.contacts.as_mut().map(Contacts::position).transpose()?,
            events: self.events.as_mut().map(Events::position).transpose()?,
            reactions: self.reactions.as_mut().map(Reactions::position).transpose()?,
            snapshots: fields.snapshots().to_vec(),
        })
    }

    /// Closes the files and returns an error if something could not be written, which a mere drop
    /// would hide.
    pub fn finish(self) -> Result<()> {
        self.progress.finish();
        self.history.finish()?;
        self.contacts.map_or(Ok(()), Contacts::finish)?;
        self.events.map_or(Ok(()), Events::finish)?;
        self.reactions.map_or(Ok(()), Reactions::finish)
    }
}

impl<'r> Recorder<'r> {
    /// Creates a recorder that has no files yet; `check_options` looks for PETSc options that
    /// nothing used.
    pub fn new(
        job: &'r Job,
        fields: Series,
        set_up: Option<SetUpTold>,
        check_options: &'r dyn Fn() -> Result<()>,
    ) -> Recorder<'r> {
        Recorder { job, files: None, fields, set_up, start: None, energy: 0.0, check_options }
    }

    /// Returns a checkpoint of a state with the lengths of the files; `None` on a process that
    /// writes no files.
    fn checkpoint(&mut self, pause: RunState) -> Result<Option<Checkpoint>> {
        let Job { scene, file, identity, petsc, .. } = self.job;
        let Some(files) = &mut self.files else { return Ok(None) };
        let outputs = files.outputs(&self.fields)?;
        let (scene_file, identity, petsc) = (file.clone(), identity.clone(), petsc.clone());
        Ok(Some(Checkpoint { scene: scene.written(), scene_file, identity, petsc, pause, outputs }))
    }

    /// Opens the files of a new or resumed run.
    pub fn prepare(&mut self, from: Option<&Checkpoint>) -> Result<()> {
        let Job { scene, folder, .. } = self.job;
        sweep(folder)?;
        // The envelope of a former end is not that of the new one.
        extremes::clear(folder)?;
        self.files = Some(match from {
            None => Files::create(self.job)?,
            Some(from) => Files::resume(self.job, from)?,
        });
        if let Some(Checkpoint { outputs, pause, .. }) = from {
            // The snapshot of a former end is removed unless one is due at that step.
            let is_due = |every: u64| pause.step.is_multiple_of(every);
            let is_kept = scene.output.fields.is_some_and(|fields| is_due(fields.every));
            let last = if is_kept { pause.step } else { pause.step.saturating_sub(1) };
            self.fields.resume(outputs.snapshots.clone(), last)?;
        }
        Ok(())
    }
}

impl Observer for Recorder<'_> {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.set_up = None;
        if row.step > 0 {
            // By now every solver has looked up its options.
            (self.check_options)()?;
        }
        self.start.get_or_insert(row.energy);
        self.energy = row.energy;
        self.files.as_mut().map_or(Ok(()), |files| files.history.push(row))
    }

    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        let file = self.files.as_mut().and_then(|files| files.contacts.as_mut());
        file.map_or(Ok(()), |file| file.push(ended))
    }

    fn reactions(&mut self, step: u64, time: f64, rows: &[NodeReaction]) -> Result<()> {
        let file = self.files.as_mut().and_then(|files| files.reactions.as_mut());
        let Some(file) = file else { return Ok(()) };
        let names: Vec<String> =
            self.job.scene.supports.iter().filter_map(|support| support.name.clone()).collect();
        file.push(step, time, &names, rows)
    }

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.fields.write(snapshot)
    }

    fn fields_complete(&mut self, step: u64, time: f64) -> Result<()> {
        let scene = &self.job.scene;
        let stresses = scene.output.fields.is_some_and(|fields| fields.stresses);
        let contents = Contents { obstacles: scene.has_contact(), stresses };
        if self.files.is_some() { self.fields.index(step, time, contents) } else { Ok(()) }
    }

    fn envelope(&mut self, envelope: &Envelope) -> Result<()> {
        let Job { scene, folder, .. } = self.job;
        extremes::write(folder, envelope, scene.time.end, self.fields.place())
    }

    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        let events = self.files.as_mut().and_then(|files| files.events.as_mut());
        events.map_or(Ok(()), |events| events.push(event))
    }

    fn pause(&mut self, pause: RunState) -> Result<()> {
        let checkpoint = self.checkpoint(pause)?;
        checkpoint.map_or(Ok(()), |checkpoint| checkpoint.write(&self.job.folder))
    }

    fn keeps_end(&self) -> bool {
        true
    }

    fn end(&mut self, pause: RunState, motion: Motion) -> Result<()> {
        let Some(checkpoint) = self.checkpoint(pause)? else { return Ok(()) };
        let folder = &self.job.folder;
        checkpoint.write_state(folder)?;
        write_atomic(&folder.join(motion::FILE), &motion.to_bytes()?)
    }

    fn interrupts(&self) -> bool {
        signal::signal_received()
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        let (time, energy) = (step as f64 * self.job.scene.time.step, self.energy);
        let start = self.start.unwrap_or(energy);
        if let Some(Files { progress, .. }) = &mut self.files {
            progress.tick(step, || State { time, contact_nodes, energy, start });
        }
    }
}
