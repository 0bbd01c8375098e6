//! Files of a run, written as the run advances.

use super::checkpoint::{self, Checkpoint, Identity, Outputs};
use super::history::{self, History};
use super::resolved::{obstacles, quantity};
use super::vtu::{self, Series};
use super::{
    Lines, claim, contacts, events, extremes, plot, reactions, remove, report, summary, sweep, write_atomic,
};
use crate::error::{Error, Result};
use crate::hash::Extent;
use crate::motion::{self, Motion};
use crate::scene::Scene;
use crate::simulation::{
    self, Contact, Envelope, NodeEvent, NodeReaction, Observer, Outcome, Row, RunState, Snapshot,
};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Run that writes files: its scene, its folder, and what a resumed run needs to know.
#[derive(Debug, Clone)]
pub struct RecordedRun {
    /// Scene of the run.
    pub scene: Scene,
    /// File of the scene; other files that it names are relative to it.
    pub file: PathBuf,
    /// Identity of the scene.
    pub identity: Identity,
    /// Run folder.
    pub folder: PathBuf,
    /// Options for PETSc.
    pub petsc: Vec<String>,
}

/// Run to go on with.
#[derive(Debug)]
pub struct ResumedRun {
    /// Run, with its new end if there is one.
    pub run: RecordedRun,
    /// Checkpoint from which it goes on.
    pub from: Checkpoint,
    /// Damage of newer checkpoints, which are not used.
    pub damaged: Vec<Error>,
}

impl ResumedRun {
    /// Finds the newest checkpoint of a run folder, to go on to the end of its scene or, also where
    /// the run has finished, to a later one (s, a whole number of steps).
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where there is none, or a file that the scene names has
    /// changed, [`Error::Usage`] for an end that is no later one or while a process runs in the
    /// folder, and [`Error::Io`] where the folder cannot be read, or a file of
    /// results is not the one that the run wrote before the checkpoint.
    pub fn new(folder: PathBuf, until: Option<&str>) -> Result<ResumedRun> {
        claim::refuse_running(&folder)?;
        let (from, damaged) = Checkpoint::newest(&folder, until.is_some())?;
        let Checkpoint { scene: text, scene_file: file, identity, petsc, pause, outputs } = from.clone();
        let mut scene = from.read_scene(&folder)?;
        if let Some(until) = until {
            let end = format!("time.end={until}");
            let prefix = format!("--set {end}: time.end: ");
            scene = Scene::from_str(&text, &file.to_string_lossy(), &[end]).map_err(|why| {
                Error::Usage(format!("--until {until}: {}", why.to_string().replacen(&prefix, "", 1)))
            })?;
            if scene.time.steps() <= pause.step {
                let RunState { step, time, .. } = pause;
                let wrong = format!("the run has made {step} steps, to {time:.9} s");
                return Err(Error::Usage(format!("--until {until}: {wrong}; expected a later end")));
            }
        }
        outputs.require_same(&folder)?;
        let identity = if until.is_some() { Identity::of(&scene)? } else { identity };
        Ok(ResumedRun { run: RecordedRun { scene, file, identity, folder, petsc }, from, damaged })
    }
}

/// Contents of `summary.json`.
#[derive(Debug, Serialize)]
pub struct RunSummary<'s> {
    program: &'static str,
    version: &'static str,
    /// Status of the run: "done", or the cause of its early end.
    pub status: String,
    scene_hash: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh_checksum: Option<u32>,
    effects: Vec<String>,
    /// Whether nothing but the scheme may change the energy.
    conservative: bool,
    warnings: &'s [String],
    /// Heights of the obstacles at each probe, in m.
    opposite: BTreeMap<String, Vec<f64>>,
    #[serde(flatten)]
    outcome: &'s Outcome,
    scene: &'s Scene,
}

impl<'s> RunSummary<'s> {
    /// Summarises a run of a scene with its outcome, the warnings of its scene, and its status.
    pub fn new(
        scene: &'s Scene,
        identity: &Identity,
        outcome: &'s Outcome,
        warnings: &'s [String],
        status: String,
    ) -> RunSummary<'s> {
        RunSummary {
            program: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            status,
            scene_hash: scene.hash(),
            mesh_checksum: identity.mesh,
            effects: scene.effects(),
            conservative: scene.changes().is_none() && !scene.dissipates(),
            warnings,
            opposite: simulation::opposite(scene).unwrap_or_default(),
            outcome,
            scene,
        }
    }

    /// Writes `summary.json`, and draws `plots/history.svg` from `history.csv`; `rebond plot` draws
    /// the other plots.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where a file cannot be read or written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        summary::write_json(&folder.join(summary::FILE), self)?;
        let resolved = serde_json::to_value(self.scene).unwrap_or_default();
        let obstacles = obstacles(&resolved, &self.opposite);
        let table = history::read(folder)?.with_quantities(|name| quantity(&resolved, name));
        plot::run::history(&table, &self.scene.title, &obstacles)
            .write_svg(&folder.join(plot::FOLDER).join("history.svg"))
    }
}

/// Observer that writes the rows, contacts, snapshots and checkpoints of a run. Of several ranks
/// only one writes tables and checkpoints; each writes its own snapshots.
pub struct RunFiles<'r> {
    run: &'r RecordedRun,
    tables: Option<Tables>,
    fields: Series,
}

/// Table that only some runs have: the name of its file, its header, and which runs have it.
type OptionalTable = (&'static str, &'static str, fn(&Scene) -> bool);

const OPTIONAL: [OptionalTable; 3] = [
    (contacts::FILE, contacts::HEADER, Scene::has_contact),
    (events::FILE, events::HEADER, |scene| scene.time.scheme.capabilities().is_event_driven),
    (reactions::FILE, reactions::HEADER, |scene| scene.supports.iter().any(|support| support.name.is_some())),
];

/// Tables of a run, which only one rank writes.
struct Tables {
    history: History,
    /// Further tables by the names of their files.
    others: BTreeMap<&'static str, Lines>,
}

impl Tables {
    /// Creates the files of a new run, and removes those of an earlier one.
    fn create(RecordedRun { scene, folder, .. }: &RecordedRun) -> Result<Tables> {
        checkpoint::clear(folder)?;
        for name in [motion::FILE, checkpoint::STATE, summary::FILE, report::FILE] {
            remove(&folder.join(name))?;
        }
        plot::clear(folder)?;
        let probes: Vec<String> = scene.output.probes.iter().map(|probe| probe.name.clone()).collect();
        let history = History::create(folder, &probes, &scene.force_columns())?;
        vtu::clear(folder)?;
        let mut others = BTreeMap::new();
        for (name, header, is_written) in OPTIONAL {
            remove(&folder.join(name))?;
            if is_written(scene) {
                others.insert(name, Lines::create(folder, name, header)?);
            }
        }
        Ok(Tables { history, others })
    }

    /// Truncates the files to their lengths at a checkpoint.
    fn resume(RecordedRun { scene, folder, .. }: &RecordedRun, from: &Checkpoint) -> Result<Tables> {
        let Outputs { history, tables, .. } = &from.outputs;
        let columns = [scene.output.probes.len(), scene.force_columns().len()];
        let written = OPTIONAL.iter().filter_map(|(name, ..)| Some((*name, *tables.get(*name)?)));
        let others = written.map(|(name, written)| Ok((name, Lines::resume(folder, name, written)?)));
        Ok(Tables {
            history: History::resume(folder, columns, *history)?,
            others: others.collect::<Result<_>>()?,
        })
    }

    /// Returns what the files have on the disk.
    fn outputs(&mut self, fields: &Series) -> Result<Outputs> {
        let tables = self.others.iter_mut().map(|(name, lines)| Ok(((*name).to_owned(), lines.position()?)));
        Ok(Outputs {
            history: self.history.position()?,
            tables: tables.collect::<Result<_>>()?,
            snapshots: fields.snapshots.clone(),
        })
    }

    fn finish(mut self) -> Result<()> {
        self.history.flush()?;
        self.others.values_mut().try_for_each(Lines::flush)
    }
}

impl<'r> RunFiles<'r> {
    /// Creates the files of one of several ranks, which has no tables yet.
    pub fn new(run: &'r RecordedRun, rank: usize, ranks: usize) -> RunFiles<'r> {
        let bits = run.scene.output.fields.map_or(64, |fields| fields.precision);
        RunFiles { run, tables: None, fields: Series::new(&run.folder, rank, ranks, bits) }
    }

    /// Opens the tables of a new or resumed run.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where a file cannot be opened, and [`crate::Error::Scene`] for
    /// a name that cannot head a column.
    pub fn prepare(&mut self, from: Option<&Checkpoint>) -> Result<()> {
        let RecordedRun { scene, folder, .. } = self.run;
        sweep(folder)?;
        // The envelope of a former end is not that of the new one.
        extremes::clear(folder)?;
        self.tables = Some(match from {
            None => Tables::create(self.run)?,
            Some(from) => Tables::resume(self.run, from)?,
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

    /// Returns a checkpoint of a state with what the files have; `None` on a process that
    /// writes no tables.
    fn checkpoint(&mut self, pause: RunState) -> Result<Option<Checkpoint>> {
        let RecordedRun { scene, file, identity, petsc, .. } = self.run;
        let Some(tables) = &mut self.tables else { return Ok(None) };
        let outputs = tables.outputs(&self.fields)?;
        let (scene_file, identity, petsc) = (file.clone(), identity.clone(), petsc.clone());
        Ok(Some(Checkpoint { scene: scene.written(), scene_file, identity, petsc, pause, outputs }))
    }

    /// Returns a table by the name of its file, where this rank writes it.
    fn table(&mut self, name: &str) -> Option<&mut Lines> {
        self.tables.as_mut()?.others.get_mut(name)
    }

    /// Returns whether this rank writes the tables.
    pub fn has_tables(&self) -> bool {
        self.tables.is_some()
    }

    /// Closes the files and returns an error if something could not be written, which a mere drop
    /// would hide.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] for the file.
    pub fn finish(self) -> Result<()> {
        self.tables.map_or(Ok(()), Tables::finish)
    }
}

impl Observer for RunFiles<'_> {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.tables.as_mut().map_or(Ok(()), |tables| tables.history.push(row))
    }

    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        self.table(contacts::FILE).map_or(Ok(()), |file| contacts::push(file, ended))
    }

    fn reactions(&mut self, step: u64, time: f64, rows: &[NodeReaction]) -> Result<()> {
        let run = self.run;
        let Some(file) = self.table(reactions::FILE) else { return Ok(()) };
        let names: Vec<&str> =
            run.scene.supports.iter().filter_map(|support| support.name.as_deref()).collect();
        reactions::push(file, step, time, &names, rows)
    }

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.fields.write(snapshot)
    }

    fn piece(&self) -> Extent {
        self.fields.last
    }

    fn fields_complete(&mut self, step: u64, time: f64, pieces: &[Extent]) -> Result<()> {
        if self.tables.is_some() { self.fields.index(step, time, pieces) } else { Ok(()) }
    }

    fn envelope(&mut self, envelope: &Envelope) -> Result<()> {
        let RecordedRun { scene, folder, .. } = self.run;
        extremes::write(folder, envelope, scene.time.end, self.fields.place())
    }

    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        self.table(events::FILE).map_or(Ok(()), |file| events::push(file, event))
    }

    fn pause(&mut self, pause: RunState) -> Result<()> {
        let checkpoint = self.checkpoint(pause)?;
        checkpoint.map_or(Ok(()), |checkpoint| checkpoint.write(&self.run.folder))
    }

    fn keeps_end(&self) -> bool {
        true
    }

    fn end(&mut self, pause: RunState, motion: Motion) -> Result<()> {
        let Some(checkpoint) = self.checkpoint(pause)? else { return Ok(()) };
        let folder = &self.run.folder;
        write_atomic(&folder.join(checkpoint::STATE), &checkpoint.to_bytes()?)?;
        write_atomic(&folder.join(motion::FILE), &motion.to_bytes()?)
    }
}
