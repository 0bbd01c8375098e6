//! Command `rebond run`.

use super::plot::obstacles;
use super::{OutputMode, SceneArgs, launch, print, refuse_petsc_options, signal};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::motion::{self, Motion};
use crate::output::checkpoint::{self, Checkpoint, Identity, Outputs};
use crate::output::claim::{self, RunLock};
use crate::output::contacts::{self, Contacts};
use crate::output::events::{self, Events};
use crate::output::history::{self, History};
use crate::output::plot;
use crate::output::progress::{Progress, SetUp, State};
use crate::output::text::{Report, significant};
use crate::output::vtu::{self, Series};
use crate::output::{remove, summary, sweep, write_atomic};
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use crate::scene::{EngineName, Scene};
use crate::scheme::RelaxationStatistics;
use crate::simulation::{
    self, Contact, Model, NodeEvent, Observer, Outcome, Row, RunState, Snapshot, SolverFactory,
};
use crate::study;
use clap::Args;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Simulate a scene.
#[derive(Debug, Args)]
pub struct Run {
    #[command(flatten)]
    scene: SceneArgs,
    /// Run folder; default: runs/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the run folder holds of an unfinished run, or of another scene
    #[arg(long)]
    overwrite: bool,
}

/// Run to make, from its start or from a checkpoint.
pub(super) struct Job {
    pub scene: Scene,
    pub file: PathBuf,
    pub identity: Identity,
    pub folder: PathBuf,
    pub voice: OutputMode,
    pub petsc: Vec<String>,
    pub from: Option<Checkpoint>,
}

/// Contents of `summary.json`.
#[derive(Debug, Serialize)]
struct Summary<'s> {
    program: &'static str,
    version: &'static str,
    /// Status of the run: "done", or the cause of its early end.
    status: String,
    scene_hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh_checksum: Option<u32>,
    effects: Vec<String>,
    warnings: &'s [String],
    /// Heights of the obstacles at each probe, in m.
    opposite: BTreeMap<String, Vec<f64>>,
    #[serde(flatten)]
    outcome: &'s Outcome,
    scene: &'s Scene,
}

/// Observer that writes a run's rows, contacts and checkpoints and reports progress to the
/// terminal. Of several ranks only one writes these; each writes its own fields.
struct Recorder<'r> {
    job: &'r Job,
    files: Option<Files>,
    fields: Series,
    /// Progress report of the set-up, until the first row.
    set_up: Option<SetUpTold>,
    /// Energies of the first and of the last row, in J.
    start: Option<f64>,
    energy: f64,
    check_options: &'r dyn Fn() -> Result<()>,
}

/// Progress report of a set-up, while it lasts.
pub(super) struct SetUpTold(Rc<SetUp>);

impl SetUpTold {
    /// Starts listening to the phases of the set-up.
    pub fn new(voice: OutputMode) -> SetUpTold {
        let set_up = Rc::new(SetUp::new(voice.is_silent()));
        let told = Rc::clone(&set_up);
        simulation::on_phase(Some(Box::new(move |part| told.part(part))));
        SetUpTold(set_up)
    }

    /// Reports a phase of the command itself.
    fn part(&self, part: &'static str) {
        self.0.part(part);
    }
}

impl Drop for SetUpTold {
    fn drop(&mut self) {
        simulation::on_phase(None);
    }
}

/// Files that only one rank writes.
struct Files {
    history: History,
    contacts: Option<Contacts>,
    /// Events file, for event-driven schemes.
    events: Option<Events>,
    progress: Progress,
}

impl Files {
    /// Creates the files of a new run, and removes those of an earlier one.
    fn create(Job { scene, folder, voice, .. }: &Job) -> Result<Files> {
        checkpoint::clear(folder)?;
        checkpoint::clear_state(folder)?;
        remove(&folder.join(summary::FILE))?;
        plot::clear(folder)?;
        let probes: Vec<String> = scene.output.probes.iter().map(|probe| probe.name.clone()).collect();
        let history = History::create(folder, &probes)?;
        vtu::clear(folder)?;
        contacts::clear(folder)?;
        let contacts = if !scene.has_contact() { None } else { Some(Contacts::create(folder)?) };
        events::clear(folder)?;
        let finds_events = scene.time.scheme.capabilities().is_event_driven;
        let events = if finds_events { Some(Events::create(folder)?) } else { None };
        let progress = Progress::new(0..scene.time.steps(), 0.0..scene.time.end, voice.is_silent());
        Ok(Files { history, contacts, events, progress })
    }

    /// Truncates the files to their lengths at a checkpoint.
    fn resume(Job { scene, folder, voice, .. }: &Job, from: &Checkpoint) -> Result<Files> {
        let Outputs { history, contacts, events, .. } = from.outputs;
        let RunState { step, time, .. } = from.pause;
        Ok(Files {
            history: History::resume(folder, scene.output.probes.len(), history)?,
            contacts: contacts.map(|length| Contacts::resume(folder, length)).transpose()?,
            events: events.map(|length| Events::resume(folder, length)).transpose()?,
            progress: Progress::new(step..scene.time.steps(), time..scene.time.end, voice.is_silent()),
        })
    }

    /// Returns the lengths of the files on the disk.
    fn outputs(&mut self, fields: &Series) -> Result<Outputs> {
        Ok(Outputs {
            history: self.history.position()?,
            contacts: self.contacts.as_mut().map(Contacts::position).transpose()?,
            events: self.events.as_mut().map(Events::position).transpose()?,
            snapshots: fields.snapshots().to_vec(),
        })
    }

    /// Closes the files and returns an error if something could not be written, which a mere drop
    /// would hide.
    fn finish(self) -> Result<()> {
        self.progress.finish();
        self.history.finish()?;
        self.contacts.map_or(Ok(()), Contacts::finish)?;
        self.events.map_or(Ok(()), Events::finish)
    }
}

impl Recorder<'_> {
    /// Returns a checkpoint of a state with the lengths of the files; `None` on a process that
    /// writes no files.
    fn checkpoint(&mut self, pause: RunState) -> Result<Option<Checkpoint>> {
        let Job { scene, file, identity, petsc, .. } = self.job;
        let Some(files) = &mut self.files else { return Ok(None) };
        let outputs = files.outputs(&self.fields)?;
        let (scene_file, identity, petsc) = (file.clone(), identity.clone(), petsc.clone());
        Ok(Some(Checkpoint { scene: scene.written(), scene_file, identity, petsc, pause, outputs }))
    }
}

impl Recorder<'_> {
    /// Opens the files of a new or resumed run.
    fn prepare(&mut self, from: Option<&Checkpoint>) -> Result<()> {
        let Job { scene, folder, .. } = self.job;
        sweep(folder)?;
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

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.fields.write(snapshot)
    }

    fn fields_complete(&mut self, step: u64, time: f64) -> Result<()> {
        let has_obstacles = self.job.scene.has_contact();
        if self.files.is_some() { self.fields.index(step, time, has_obstacles) } else { Ok(()) }
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

impl Run {
    pub(super) fn execute(&self) -> Result<()> {
        let scene = self.scene.load()?;
        let folder = self.folder();
        let file = std::path::absolute(&self.scene.scene).map_err(Error::io(&self.scene.scene))?;
        let identity = Identity::of(&scene)?;
        let resolved = serde_json::to_value(&scene).unwrap_or_default();
        claim::refuse_results(&folder, &identity, &resolved, self.overwrite)?;
        let (voice, petsc) = (self.scene.voice, self.scene.petsc.clone());
        Job { scene, file, identity, folder, voice, petsc, from: None }.execute()
    }

    fn folder(&self) -> PathBuf {
        let stem = || self.scene.scene.file_stem().unwrap_or(self.scene.scene.as_os_str()).to_owned();
        self.out.clone().unwrap_or_else(|| Path::new("runs").join(stem()))
    }
}

impl Job {
    pub(super) fn execute(self) -> Result<()> {
        match self.scene.solver.engine {
            #[cfg(feature = "petsc")]
            EngineName::Petsc => self.on_petsc(),
            #[cfg(not(feature = "petsc"))]
            EngineName::Petsc => Model::new(&self.scene).map(drop), // says that this build has no such engine
            EngineName::Native => {
                launch::one_process("the native engine runs")?;
                refuse_petsc_options(&self.petsc)?;
                let _claim = RunLock::new(&self.folder, &self.identity)?;
                self.announce("")?;
                let set_up = SetUpTold::new(self.voice);
                let model = Model::new(&self.scene)?;
                set_up.part("frequencies");
                let warnings = study::warnings(&self.scene, &model);
                self.simulate(Some(set_up), &model, &simulation::condensed, &warnings, &|| Ok(()))
            }
        }
    }

    /// Runs on all ranks; an error on any of them ends the run on all.
    #[cfg(feature = "petsc")]
    fn on_petsc(self) -> Result<()> {
        let context = Context::start(&self.petsc)?;
        let speaks = context.rank() == 0;
        let run = || {
            let claim = speaks.then(|| RunLock::new(&self.folder, &self.identity)).transpose();
            let _claim = context.comm().all_ok(claim)?;
            if speaks {
                self.announce(&format!("engine: petsc, {}\n", ranks(context.size())))?;
            }
            let set_up = speaks.then(|| SetUpTold::new(self.voice));
            let model = Model::distributed(&self.scene, &context)?;
            let solver = model.solver(&self.scene);
            let dofs = context.comm().all_reduce_sum(model.system.engine.dofs());
            set_up.iter().for_each(|set_up| set_up.part("frequencies"));
            let warnings =
                if speaks { study::warnings_apart(&self.scene, &model.warnings, dofs) } else { Vec::new() };
            self.simulate(set_up, &model, &solver, &warnings, &|| context.refuse_unused_options())
        };
        ended(&context, run())
    }

    /// Prints a description of the run.
    fn announce(&self, engine: &str) -> Result<()> {
        if self.voice.is_silent() {
            return Ok(());
        }
        let from = self.from.as_ref().map_or(String::new(), |Checkpoint { pause, .. }| {
            format!("resumed after step {}, t = {:.9} s\n", pause.step, pause.time)
        });
        print(&format!("{}\n{engine}effects: {}\n{from}", self.scene.title, effects(&self.scene)))
    }

    /// Runs a model as one of several processes; the first writes files and reports.
    fn simulate<E: Engine>(
        mut self,
        set_up: Option<SetUpTold>,
        model: &Model<E>,
        solver: &SolverFactory<E>,
        warnings: &[String],
        check_options: &dyn Fn() -> Result<()>,
    ) -> Result<()> {
        signal::listen()?;
        if let Some(SetUpTold(set_up)) = set_up.as_ref().filter(|_| !self.voice.is_silent()) {
            warnings.iter().for_each(|warning| set_up.say(&format!("warning: {warning}")));
        }
        let from = self.from.take();
        let comm = model.system.engine.comm();
        let job = &self;
        let Job { scene, folder, .. } = job;
        let mut recorder = Recorder {
            job,
            files: None,
            fields: Series::new(folder, comm.rank(), comm.size()),
            set_up,
            start: None,
            energy: 0.0,
            check_options,
        };
        let prepared = if comm.rank() == 0 { recorder.prepare(from.as_ref()) } else { Ok(()) };
        comm.all_ok(prepared)?;
        let (outcome, ended) = match from {
            None => simulation::run(scene, model, solver, &mut recorder)?,
            Some(from) => simulation::resume(scene, model, solver, from.pause, &mut recorder)?,
        };
        let Some(files) = recorder.files else { return ended };
        let status = ended.as_ref().err().map_or("done".into(), ToString::to_string);
        // The cause of the run's end takes precedence over errors of the report.
        let told = files.finish().and_then(|()| job.tell(&outcome, warnings, status));
        ended.and(told)?;
        // A finished run needs no checkpoints.
        checkpoint::clear(folder)
    }

    /// Writes the summary and the plot of a run, and prints its report.
    fn tell(&self, outcome: &Outcome, warnings: &[String], status: String) -> Result<()> {
        let Job { scene, folder, voice, .. } = self;
        let summary = Summary {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status,
            scene_hash: scene.hash(),
            mesh_checksum: self.identity.mesh_checksum(),
            effects: scene.effects(),
            warnings,
            opposite: simulation::opposite(scene).unwrap_or_default(),
            outcome,
            scene,
        };
        summary::write_json(&folder.join(summary::FILE), &summary)?;
        draw(folder, scene, &summary.opposite)?;
        voice.print(&report(scene, outcome, folder), &summary)
    }
}

/// Ends all ranks where any has an error, after the others with errors have written their output;
/// rank 0 prints the error.
#[cfg(feature = "petsc")]
pub(super) fn ended(context: &Context, ended: Result<()>) -> Result<()> {
    if context.size() > 1 { context.settle(ended, super::PATIENCE) } else { ended }
}

#[cfg(feature = "petsc")]
fn ranks(count: usize) -> String {
    if count == 1 { "1 rank".into() } else { format!("{count} ranks") }
}

fn effects(scene: &Scene) -> String {
    let effects = scene.effects();
    if effects.is_empty() { "none".into() } else { effects.join(", ") }
}

/// Draws `plots/history.svg` from `history.csv`; `rebond plot` draws the other plots.
fn draw(folder: &Path, scene: &Scene, opposite: &BTreeMap<String, Vec<f64>>) -> Result<()> {
    let obstacles = serde_json::to_value(scene).map(|scene| obstacles(&scene, opposite)).unwrap_or_default();
    let table = history::read(folder)?;
    plot::run::history(&table, &scene.title, &obstacles)
        .write_svg(&folder.join(plot::FOLDER).join("history.svg"))
}

/// Returns the report printed at the end of a run.
fn report(scene: &Scene, outcome: &Outcome, folder: &Path) -> Report {
    let Outcome { energy, seconds, .. } = outcome;
    let mut report = Report::new("");
    report.count("dofs", outcome.dofs as u64, "").count("steps", outcome.steps, "").count(
        "  in contact",
        outcome.contact_steps,
        "",
    );
    if outcome.steps > 0 {
        report.number("time per step", 1e6 * seconds.stepping / outcome.steps as f64, "us");
    }
    if let Some(tally) = outcome.tally {
        report.count("events", tally.events, "").count("active sets", tally.active_sets, "");
    }
    if let Some(impact) = outcome.first_impact {
        report
            .number("first impact", impact.time, "s")
            .text("  at", format!("({}, {}) m", significant(impact.at[0]), significant(impact.at[1])))
            .number("  relative velocity", impact.velocity, "m/s")
            .count("most nodes in contact", outcome.most_contact_nodes as u64, "")
            .count("contacts of nodes", outcome.node_contacts, "")
            .count("contacts of the plate", outcome.contacts.len() as u64, "");
        for (number, [begin, end]) in outcome.contacts.iter().enumerate().take(MOST_CONTACTS) {
            report.text(format!("  {}", number + 1), format!("{begin:.6} s to {end:.6} s"));
        }
        if outcome.contacts.len() > MOST_CONTACTS {
            report.text("  ...", "");
        }
    } else if scene.has_contact() {
        report.text("first impact", "none");
    }
    report.number("energy at start", energy.start, "J").number("energy at end", energy.end, "J");
    // Time-dependent data add and remove energy; compared with that, the energy of a start at rest
    // is rounding.
    let is_measure = energy.start.abs() > 1e-6 * energy.min.abs().max(energy.max.abs());
    if is_measure && scene.changes().is_none() {
        let most = (energy.max - energy.start).max(energy.start - energy.min) / energy.start.abs();
        report
            .number("  over start", energy.end / energy.start, "")
            .text("  largest change", format!("{most:.1e}"));
    }
    if let Some(RelaxationStatistics { relaxed_steps, halved_steps, least_gamma, largest_gamma, .. }) =
        outcome.relaxation
    {
        report.count("steps relaxed", relaxed_steps, "");
        report.text("  gamma", format!("{least_gamma:.3} to {largest_gamma:.3}"));
        if halved_steps > 0 {
            report.count("steps halved", halved_steps, "");
        }
    }
    if outcome.retries > 0 {
        report.count("steps solved again", outcome.retries, "");
    }
    report.text("worst KKT residual", format!("{:.1e}", outcome.worst_kkt));
    if scene.has_contact() {
        report.text("worst penetration", format!("{:.1e} m", outcome.worst_penetration));
    }
    report.text("written to", format!("{}", folder.display()));
    report
}

/// Number of contacts listed in a report.
const MOST_CONTACTS: usize = 6;
