//! Command `rebond sweep`.

use super::arguments::{SceneArgs, overrides, refuse_petsc_options, toml};
use super::command::{Execute, Program};
use super::printing::command_line;
#[cfg(feature = "petsc")]
use super::ranks;
use super::{launch, signal};
#[cfg(feature = "petsc")]
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::output::checkpoint::Identity;
use crate::output::claim::RunLock;
use crate::output::plot::{self, Figure};
use crate::output::progress::moving_line;
use crate::scene::{EngineName, Scene, SweepSpec};
#[cfg(not(feature = "petsc"))]
use crate::simulation::Model;
use crate::sweep::{self, Loader, Plan, SweepReport, SweepRow, SweepRows, SweepStatistics, SweepStore};
#[cfg(feature = "petsc")]
use crate::sweep::{RankedSweep, SweepPart};
use clap::Args;
use indicatif::ProgressBar;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "\
Examples:
  rebond sweep shaker.toml                                  # the scene's table [sweep]
  rebond sweep shaker.toml --over frequency=15..30:61 --period 1/frequency --up-and-down
  rebond sweep shaker.toml --over frequency=15..30:16 --over amplitude=1e-4,2e-4 --jobs 2
  rebond sweep shaker.toml --random 'amplitude=normal(1e-4,1e-5)' --criterion 'impacts > 0'
  rebond sweep shaker.toml --over a=-1e-3..1e-3:64 --over v=-0.1..0.1:64 --basins
  mpirun -n 2 rebond sweep shaker.toml --ranks-per-run 1    # on PETSc, two runs at a time

Ctrl-C stops it; the same command goes on with the runs that are missing.";

/// Make many runs over keys: response curves, bifurcation diagrams, maps; or with random values:
/// probabilities, distributions, sensitivities
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct SweepArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder of sweep.csv, sweep.json and plots; default: sweeps/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Replace what the folder holds of another sweep
    #[arg(long)]
    overwrite: bool,
    /// Number of simultaneous runs, or of simultaneous rows of runs that carry their state on
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: NonZeroUsize,
    /// Number of ranks of each run on PETSc; default: all that mpirun started
    #[arg(long, value_name = "N", conflicts_with = "jobs")]
    ranks_per_run: Option<NonZeroUsize>,
    /// Make one run alone, by its number from 0 on, and write no files
    #[arg(long, value_name = "N", conflicts_with_all = ["out", "overwrite", "jobs", "ranks_per_run"])]
    only: Option<usize>,
    #[command(flatten)]
    settings: Settings,
}

/// Keys of `[sweep]`.
#[derive(Debug, Args, Serialize)]
#[command(next_help_heading = "What to sweep, instead of the scene's [sweep]")]
struct Settings {
    /// Key or parameter with its values: load.pressure=90..250:161, or a=1,2,5; twice for a map, or
    /// oftener
    #[arg(long, value_name = "KEY=VALUES")]
    #[serde(skip)]
    over: Vec<String>,
    /// Key or parameter with random values: plate.thickness=normal(1e-3,1e-5); may be repeated
    #[arg(long, value_name = "KEY=DISTRIBUTION", conflicts_with = "over")]
    #[serde(skip)]
    random: Vec<String>,
    /// Correlation of two random keys: plate.thickness,plate.density=-0.3; may be repeated
    #[arg(long, value_name = "KEY,KEY=NUMBER")]
    #[serde(skip)]
    correlation: Vec<String>,
    /// Number of runs with random values
    #[arg(long, value_name = "N")]
    runs: Option<String>,
    /// Seed of the random values
    #[arg(long, value_name = "N")]
    seed: Option<String>,
    /// How random values are drawn: plain | latin | sobol | saltelli (sensitivity indices)
    #[arg(long, value_name = "POINTS", value_parser = toml::word)]
    points: Option<String>,
    /// Condition whose probability counts: 'peak_force > 100'; may be repeated
    #[arg(long, value_name = "CONDITION", allow_hyphen_values = true)]
    #[serde(skip)]
    criterion: Vec<String>,
    /// Start each run where that of the value before ended
    #[arg(long, conflicts_with_all = ["down", "up_and_down"])]
    #[serde(skip)]
    up: bool,
    /// Start each run where that of the value after ended
    #[arg(long, conflicts_with = "up_and_down")]
    #[serde(skip)]
    down: bool,
    /// All values up, then all values down
    #[arg(long)]
    #[serde(skip)]
    up_and_down: bool,
    /// Period of the drive in s: a number, or a formula of the parameters such as 1/frequency
    #[arg(long, value_name = "SECONDS")]
    period: Option<String>,
    /// Periods of each run
    #[arg(long, value_name = "N")]
    periods: Option<String>,
    /// Periods of each run before the measured ones
    #[arg(long, value_name = "N")]
    settle: Option<String>,
    /// Distance of equal points of a section, relative to the range of the motion
    #[arg(long, value_name = "NUMBER")]
    tolerance: Option<String>,
    /// Measure the largest Lyapunov exponent too, at twice the time
    #[arg(long)]
    lyapunov: bool,
    /// Tell the attractors that the runs settle on; with keys of the start, their basins
    #[arg(long)]
    basins: bool,
}

impl Settings {
    fn overrides(&self) -> Vec<String> {
        let texts = |key: &str, texts: &[String]| {
            let texts: Vec<String> = texts.iter().map(|text| format!("{text:?}")).collect();
            (!texts.is_empty()).then(|| format!("sweep.{key}=[{}]", texts.join(", ")))
        };
        // Random values replace the swept ones of the scene.
        let over = match self.random.is_empty() {
            true => texts("over", &self.over),
            false => Some("sweep.over=[]".into()),
        };
        let random = [("random", &self.random), ("correlation", &self.correlation)];
        let lists = random.into_iter().chain([("criterion", &self.criterion)]);
        let lists = lists.filter_map(|(key, list)| texts(key, list));
        let direction = [(self.up, "up"), (self.down, "down"), (self.up_and_down, "up_and_down")];
        let direction = direction.iter().filter(|(is_on, _)| *is_on);
        let direction = direction.map(|(_, word)| format!("sweep.direction={word:?}"));
        over.into_iter().chain(lists).chain(direction).chain(overrides("sweep", self)).collect()
    }
}

impl Execute for SweepArgs {
    fn execute(&self, _: Program) -> Result<()> {
        let settings = self.settings.overrides();
        let load = |more: &[String]| self.scene.load_with(&[&settings, more]);
        let scene = load(&[])?;
        let Some(sweep) = &scene.sweep else {
            let wrong =
                "has no [sweep]; expected --over with --period, such as --over 'load.pressure=90..250:161'";
            return Err(Error::Usage(format!("{}: it {wrong}", self.scene.scene.display())));
        };
        // A key that does not exist ends the sweep before its first run.
        sweep::scene_at(sweep, &load, &Plan::new(sweep).typical_run().values)?;
        sweep::check_criteria(&scene)
            .map_err(|wrong| Error::Scene(format!("{}: {wrong}", self.scene.scene.display())))?;
        match scene.solver.engine {
            EngineName::Native => self.in_process(&scene, sweep, &load),
            #[cfg(feature = "petsc")]
            EngineName::Petsc => self.on_ranks(&scene, sweep, &load),
            #[cfg(not(feature = "petsc"))]
            EngineName::Petsc => Model::new(&scene).map(drop), // says that this build has no such engine
        }
    }
}

impl SweepArgs {
    /// Makes the runs on the native engine.
    fn in_process(&self, scene: &Scene, sweep: &SweepSpec, load: &Loader) -> Result<()> {
        launch::one_process("the native engine runs")?;
        refuse_petsc_options(&self.scene.petsc)?;
        if let Some(run) = self.only {
            return self.make_one(scene, sweep, load, run);
        }
        if self.ranks_per_run.is_some() {
            return Err(Error::Usage("--ranks-per-run: runs on ranks need --engine petsc".into()));
        }
        let folder = self.folder();
        let _lock = RunLock::new(&folder, &Identity::of(scene)?)?;
        let mut store = SweepStore::open(&folder, &scene.hash(), self.overwrite, sweep.shows_sections())?;
        signal::listen()?;
        let cache = self.scene.open_cache();
        let line =
            ProgressLine::new(Plan::new(sweep).count(), store.indices().len(), self.scene.voice.is_silent());
        let shown = line.clone();
        store.on_row(move |row| shown.tell(row));
        let ended = sweep::conduct(sweep, load, &mut store, self.jobs.get(), &|| signal::signal_received());
        line.0.finish_and_clear();
        drop(cache);
        self.finish(scene, &folder, store, ended)
    }

    /// Makes one run of the sweep, and tells how `rebond run` makes it.
    fn make_one(&self, scene: &Scene, sweep: &SweepSpec, load: &Loader, run: usize) -> Result<()> {
        signal::listen()?;
        let cache = self.scene.open_cache();
        let row = sweep::conduct_one(sweep, load, run, &|| signal::signal_received())?;
        drop(cache);
        let mut text = String::new();
        if let Ok((made, _)) = sweep::scene_at(sweep, load, &row.values) {
            let mut words = vec![format!("rebond run {}", self.scene.scene.display())];
            let keys = sweep.keys().zip(&row.values);
            words.extend(keys.map(|((_, key), value)| format!("--set {key}={}", sweep::spell(*value))));
            words.push(format!("--set time.step={:?} --set time.end={:?}", made.time.step, made.time.end));
            text += &format!("{}\n", words.join(" "));
        }
        let report = SweepReport::new(scene, command_line(), SweepRows::new([row.clone()])?);
        let mut lines = report.lines();
        let mut cells = || lines.next().into_iter().flatten().flatten();
        let cells: Vec<_> = cells().zip(cells()).collect();
        for (head, cell) in cells {
            if !cell.is_empty() && !head.ends_with("_section") {
                text += &format!("  {head}: {cell}\n");
            }
        }
        self.scene.voice.print(&text, &row)
    }

    /// Makes the runs on PETSc, on groups of ranks. Collective.
    #[cfg(feature = "petsc")]
    fn on_ranks(&self, scene: &Scene, spec: &SweepSpec, load: &Loader) -> Result<()> {
        if self.only.is_some() {
            return Err(Error::Usage("--only: one run needs --engine native".into()));
        }
        if self.jobs.get() > 1 {
            return Err(Error::Usage("--jobs: on PETSc expected --ranks-per-run, and mpirun -n".into()));
        }
        let (size, ranks) = (launch::size(), self.ranks_per_run.map(NonZeroUsize::get));
        let identity = Identity::of(scene)?;
        if let Some(ranks) = ranks.filter(|ranks| !size.is_multiple_of(*ranks)) {
            let wrong = format!("--ranks-per-run {ranks} does not divide the number of ranks, {size}");
            return Err(Error::Usage(wrong));
        }
        let context = ranks::start(&self.scene.petsc, ranks, &identity)?;
        let everyone = &context.everyone;
        let speaks = everyone.rank() == 0;
        let sweep = || {
            let (folder, hash) = (self.folder(), scene.hash());
            let lock = speaks.then(|| RunLock::new(&folder, &identity)).transpose();
            let _lock = everyone.all_ok(lock)?;
            let store =
                speaks.then(|| SweepStore::open(&folder, &hash, self.overwrite, spec.shows_sections()));
            let store = store.transpose();
            let store = everyone.all_ok(store)?;
            let made = store.map_or_else(Vec::new, |store| store.indices());
            let made = everyone.broadcast_value(&made)?;
            let (group, _) = context.group();
            let is_first = context.rank() == 0;
            let part = is_first.then(|| SweepPart::start(&folder, &hash, group)).transpose();
            let part = everyone.all_ok(part)?;
            signal::listen()?;
            let ranked =
                RankedSweep { sweep: spec, load, context: &context, known: &made, patience: ranks::PATIENCE };
            // The first group tells how far it is, and each tells of its own failures.
            let line = ProgressLine::new(ranked.count(), 0, !speaks || self.scene.voice.is_silent());
            let mut told = |row: &SweepRow| {
                if is_first {
                    line.tell(row);
                }
            };
            let ended = ranked.conduct(part, &mut told, &|| signal::signal_received());
            line.0.finish_and_clear();
            let ended = everyone.all_ok(ended);
            let is_stopped = |error: &Error| error.exit_code() == Error::Stopped(String::new()).exit_code();
            if ended.as_ref().is_err_and(|error| !is_stopped(error)) {
                return ended;
            }
            // All rows are written; rank 0 joins them.
            let joined = speaks.then(|| {
                let store = SweepStore::open(&folder, &hash, false, spec.shows_sections())?;
                self.finish(scene, &folder, store, ended)
            });
            everyone.all_ok(joined.unwrap_or(Ok(())))
        };
        ranks::ended(&context, sweep())
    }

    /// Writes table, report and pictures of all runs, or the table of those that are done.
    fn finish(&self, scene: &Scene, folder: &Path, mut store: SweepStore, ended: Result<()>) -> Result<()> {
        let is_complete = ended.is_ok();
        let report = SweepReport::new(scene, command_line(), store.take_rows()?);
        report.write(folder)?;
        ended?;
        let pictures = Figure::write_all(&folder.join(plot::FOLDER), &sweep::figures(&report))?;
        if is_complete {
            store.clear_states()?;
        }
        let shown = folder.display();
        let mut text = report.statistics.as_ref().map_or(String::new(), SweepStatistics::text);
        text += &report.basins.as_ref().map_or(String::new(), ToString::to_string);
        text += &format!("{}\n{} runs, {} failed\n", report.title, report.rows.count(), report.failures());
        text += &format!("{shown}/{}, {}\n", sweep::CSV, sweep::JSON);
        text += &pictures;
        self.scene.voice.print(&text, &report)
    }

    fn folder(&self) -> PathBuf {
        self.scene.folder(self.out.as_deref(), "sweeps")
    }
}

/// Progress of a sweep on the terminal.
#[derive(Clone)]
struct ProgressLine(ProgressBar);

impl ProgressLine {
    fn new(runs: usize, made: usize, quiet: bool) -> ProgressLine {
        let template = "{pos}/{len} runs  {elapsed}, {eta} left  {wide_msg}";
        let line = moving_line(template, Some(runs as u64), quiet);
        if made > 0 && !quiet {
            eprintln!("going on: {made} of {runs} runs are known");
        }
        line.set_position(made as u64);
        line.reset_eta();
        ProgressLine(line)
    }

    fn tell(&self, row: &SweepRow) {
        let values: Vec<String> = row.values.iter().map(|value| format!("{value}")).collect();
        if let Some(why) = &row.failure {
            self.0.suspend(|| eprintln!("failed at {}: {why}", values.join(", ")));
        }
        self.0.set_message(values.join(", "));
        self.0.inc(1);
    }
}
