//! `rebond run`.

use super::plot::obstacles;
use super::{SceneArgs, launch, print};
use crate::error::Result;
use crate::linalg::Engine;
use crate::output::contacts::{self, Contacts};
use crate::output::events::{self, Events};
use crate::output::history::{self, History};
use crate::output::plot;
use crate::output::progress::{Progress, State};
use crate::output::summary;
use crate::output::text::{Report, significant};
use crate::output::vtu::{self, Series};
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use crate::scene::{EngineName, Scene, Scheme};
use crate::scheme::Relaxation;
use crate::simulation::{self, Contact, Model, NodeEvent, Observer, Outcome, Row, Snapshot, SolverFactory};
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Simulate a scene.
#[derive(Debug, Args)]
pub struct Run {
    #[command(flatten)]
    scene: SceneArgs,
    /// Run folder; default: runs/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// `summary.json`.
#[derive(Debug, Serialize)]
struct Summary<'s> {
    program: &'static str,
    version: &'static str,
    /// "done", or what ended the run early.
    status: String,
    scene_hash: String,
    effects: Vec<String>,
    #[serde(flatten)]
    outcome: &'s Outcome,
    scene: &'s Scene,
}

/// What records a run: rows to the history, contacts, and now and then a look for the terminal. Of several ranks, one
/// records; but each writes its own fields.
struct Recorder<'r> {
    files: Option<Files>,
    fields: Series,
    has_obstacles: bool,
    step: f64,
    start: Option<f64>,
    energy_ratio: f64,
    check_options: &'r dyn Fn() -> Result<()>,
}

/// What one rank alone writes.
struct Files {
    history: History,
    contacts: Option<Contacts>,
    /// Where the scheme follows events.
    events: Option<Events>,
    progress: Progress,
}

impl Files {
    /// Starts the files of a run afresh; those of an earlier one go.
    fn create(folder: &Path, scene: &Scene, quiet: bool) -> Result<Files> {
        let probes: Vec<String> = scene.output.probes.iter().map(|probe| probe.name.clone()).collect();
        let history = History::create(folder, &probes)?;
        vtu::clear(folder)?;
        contacts::clear(folder)?;
        let contacts = if !scene.has_contact() { None } else { Some(Contacts::create(folder)?) };
        events::clear(folder)?;
        let events = if scene.time.scheme == Scheme::Exact { Some(Events::create(folder)?) } else { None };
        Ok(Files { history, contacts, events, progress: Progress::new(0, 0.0..scene.time.end, quiet) })
    }
}

impl Observer for Recorder<'_> {
    fn row(&mut self, row: &Row) -> Result<()> {
        if row.step > 0 {
            // By now every solver has looked up its options.
            (self.check_options)()?;
        }
        let start = *self.start.get_or_insert(row.energy);
        self.energy_ratio = row.energy / start;
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
        if self.files.is_some() { self.fields.index(step, time, self.has_obstacles) } else { Ok(()) }
    }

    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        let events = self.files.as_mut().and_then(|files| files.events.as_mut());
        events.map_or(Ok(()), |events| events.push(event))
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        let (time, energy_ratio) = (step as f64 * self.step, self.energy_ratio);
        if let Some(Files { progress, .. }) = &mut self.files {
            progress.tick(step, || State { time, contact_nodes, energy_ratio });
        }
    }
}

impl Run {
    pub(super) fn execute(&self) -> Result<()> {
        let scene = self.scene.load()?;
        match scene.solver.engine {
            #[cfg(feature = "petsc")]
            EngineName::Petsc => self.on_petsc(&scene),
            #[cfg(not(feature = "petsc"))]
            EngineName::Petsc => Model::new(&scene).map(drop), // says that this build has no such engine
            EngineName::Native => {
                launch::one_process("the native engine runs")?;
                self.scene.refuse_petsc_options()?;
                self.announce(&scene, "")?;
                let model = Model::new(&scene)?;
                self.simulate(&scene, &model, &simulation::condensed, [0, 1], &|| Ok(()))
            }
        }
    }

    /// Runs on all ranks; an error on any of them ends all.
    #[cfg(feature = "petsc")]
    fn on_petsc(&self, scene: &Scene) -> Result<()> {
        let context = Context::start(&self.scene.petsc)?;
        let speaks = context.rank() == 0;
        let run = || {
            if speaks {
                self.announce(scene, &format!("engine: petsc, {}\n", ranks(context.size())))?;
            }
            let model = Model::distributed(scene, &context)?;
            let solver = model.solver(scene);
            let process = [context.rank(), context.size()];
            self.simulate(scene, &model, &solver, process, &|| context.refuse_unused_options())
        };
        ended(&context, run())
    }

    /// Says what will be simulated.
    fn announce(&self, scene: &Scene, engine: &str) -> Result<()> {
        if self.scene.json || self.scene.quiet {
            return Ok(());
        }
        print(&format!("{}\n{engine}effects: {}\n", scene.title, effects(scene)))
    }

    /// Simulates a model on one of several processes; the first writes and reports.
    fn simulate<E: Engine>(
        &self,
        scene: &Scene,
        model: &Model<E>,
        solver: &SolverFactory<E>,
        [rank, ranks]: [usize; 2],
        check_options: &dyn Fn() -> Result<()>,
    ) -> Result<()> {
        let folder = self.folder();
        let quiet = self.scene.json || self.scene.quiet;
        let mut recorder = Recorder {
            files: if rank == 0 { Some(Files::create(&folder, scene, quiet)?) } else { None },
            fields: Series::new(&folder, rank, ranks),
            has_obstacles: !scene.obstacles.is_empty(),
            step: scene.time.step,
            start: None,
            energy_ratio: 1.0,
            check_options,
        };
        let (outcome, ended) = simulation::run(scene, model, solver, &mut recorder)?;
        let Some(Files { history, events, progress, .. }) = recorder.files else { return ended };
        progress.finish();
        history.finish()?;
        events.map_or(Ok(()), Events::finish)?;
        let summary = Summary {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status: ended.as_ref().err().map_or("done".into(), ToString::to_string),
            scene_hash: scene.hash(),
            effects: scene.effects(),
            outcome: &outcome,
            scene,
        };
        summary::write_json(&folder.join("summary.json"), &summary)?;
        draw(&folder, scene)?;
        self.scene.print(&report(scene, &outcome, &folder), &summary)?;
        ended
    }

    fn folder(&self) -> PathBuf {
        let stem = || self.scene.scene.file_stem().unwrap_or(self.scene.scene.as_os_str()).to_owned();
        self.out.clone().unwrap_or_else(|| Path::new("runs").join(stem()))
    }
}

/// Ends all ranks on an error of any, once those that have it too have written what they have.
#[cfg(feature = "petsc")]
pub(super) fn ended(context: &Context, ended: Result<()>) -> Result<()> {
    match ended {
        Err(error) if context.size() > 1 => {
            context.all_arrive(super::PATIENCE);
            context.fail(&error)
        }
        ended => ended,
    }
}

#[cfg(feature = "petsc")]
fn ranks(count: usize) -> String {
    if count == 1 { "1 rank".into() } else { format!("{count} ranks") }
}

fn effects(scene: &Scene) -> String {
    let effects = scene.effects();
    if effects.is_empty() { "none".into() } else { effects.join(", ") }
}

/// Draws `plots/history.svg` from `history.csv`; `rebond plot` draws the rest.
fn draw(folder: &Path, scene: &Scene) -> Result<()> {
    let obstacles = serde_json::to_value(scene).map(|scene| obstacles(&scene)).unwrap_or_default();
    let table = history::read(folder)?;
    plot::run::history(&table, &scene.title, &obstacles).write_svg(&folder.join("plots/history.svg"))
}

/// What a run prints when it ends.
fn report(scene: &Scene, outcome: &Outcome, folder: &Path) -> Report {
    let Outcome { energy, seconds, .. } = outcome;
    let mut report = Report::new("");
    report.count("dofs", outcome.dofs as u64, "").count("steps", outcome.steps, "").count(
        "  in contact",
        outcome.contact_steps,
        "",
    );
    if outcome.steps > 0 {
        report.number("time a step", 1e6 * seconds.stepping / outcome.steps as f64, "us");
    }
    if let Some(tally) = outcome.tally {
        report.count("events", tally.events, "").count("active sets", tally.active_sets, "");
    }
    if let Some(impact) = outcome.first_impact {
        report
            .number("first impact", impact.time, "s")
            .text("  at", format!("({}, {}) m", significant(impact.at[0]), significant(impact.at[1])))
            .number("  velocity", impact.velocity, "m/s")
            .count("most nodes in contact", outcome.most_contact_nodes as u64, "");
        for (number, [begin, end]) in outcome.contacts.iter().enumerate().take(MOST_CONTACTS) {
            report.text(format!("contact {}", number + 1), format!("{begin:.6} s to {end:.6} s"));
        }
        if outcome.contacts.len() > MOST_CONTACTS {
            report.text("...", format!("{} contacts in all", outcome.contacts.len()));
        }
    } else if scene.has_contact() {
        report.text("first impact", "none");
    }
    report.number("energy at start", energy.start, "J").number("energy at end", energy.end, "J");
    // What changes with time gives and takes energy; next to what comes and goes, a start at rest is rounding.
    let is_measure = energy.start.abs() > 1e-6 * energy.min.abs().max(energy.max.abs());
    if is_measure && scene.changes().is_none() {
        let most = (energy.max - energy.start).max(energy.start - energy.min) / energy.start.abs();
        report
            .number("  over start", energy.end / energy.start, "")
            .text("  largest change", format!("{most:.1e}"));
    }
    if let Some(Relaxation { relaxed_steps, halved_steps, least_gamma, largest_gamma, .. }) =
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

/// Contacts that a report lists.
const MOST_CONTACTS: usize = 6;
