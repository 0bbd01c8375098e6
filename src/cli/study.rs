//! Command `rebond study`.

use super::arguments::{SceneArgs, overrides, refuse_petsc_options, toml};
use super::command::{Execute, Program};
use super::printing::{command_line, print};
use crate::error::{Error, Result};
use crate::input;
use crate::output::plot::{self, Figure};
use crate::output::progress::moving_line;
use crate::output::summary::write_json;
use crate::output::write_atomic;
use crate::output::{claim, remove, report};
#[cfg(feature = "petsc")]
use crate::petsc::Context;
#[cfg(feature = "petsc")]
use crate::scene::EngineName;
use crate::scene::{ElementKind, Scene};
#[cfg(feature = "petsc")]
use crate::simulation::{self, Model};
#[cfg(feature = "petsc")]
use crate::study::accuracy::trajectory::Trajectory;
use crate::study::accuracy::{self, Accuracy, Runner, Watch, pictures};
use clap::Args;
use indicatif::{HumanDuration, ProgressBar};
use serde::Serialize;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

const EXAMPLES: &str = "\
Examples:
  rebond study plate.toml
  rebond study plate.toml --set 'study.schemes=[\"newmark\", \"conserving\"]' --jobs 2

The table [study] of the scene says what is compared; without it a usual choice is.";

/// Measure what accuracy costs in time: errors against seconds for schemes, masses, steps and
/// meshes
// Studies open no cache of modes: the measured set-up of each run computes its own.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Study {
    #[command(flatten)]
    scene: SceneArgs,
    /// Folder of study.csv, study.json and plots; default: studies/ and the scene file's name
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Start anew, even if the folder holds an unfinished or another study
    #[arg(long)]
    fresh: bool,
    /// Number of simultaneous runs on the native engine; their times are then marked as unreliable
    #[arg(long, value_name = "N", default_value = "1")]
    jobs: std::num::NonZeroUsize,
    #[command(flatten)]
    lists: Lists,
}

/// Lists of `[study]`, each separated by commas.
#[derive(Debug, Args, Serialize)]
#[command(next_help_heading = "What to compare, instead of the scene's [study]")]
struct Lists {
    /// Time schemes
    #[arg(long, value_parser = toml::words, value_name = "NAMES")]
    schemes: Option<String>,
    /// Masses: singular, consistent, modal
    #[arg(long, value_parser = toml::words, value_name = "NAMES")]
    masses: Option<String>,
    /// Numbers of modes of the modal mass
    #[arg(long, value_parser = toml::numbers, value_name = "NUMBERS")]
    modes: Option<String>,
    /// Restitution coefficients of newmark
    #[arg(long, value_parser = toml::numbers, value_name = "NUMBERS")]
    restitutions: Option<String>,
    /// Time steps in s
    #[arg(long, value_parser = toml::numbers, value_name = "NUMBERS")]
    steps: Option<String>,
    // Elements: their list is the registry's.
    #[arg(long, value_parser = toml::words, value_name = "NAMES", help = format!("Elements: {}", ElementKind::ALL.map(ElementKind::name).join(", ")))]
    elements: Option<String>,
    /// Meshes, such as 10x4,20x8
    #[arg(long, value_parser = toml::pairs, value_name = "NXxNY")]
    cells: Option<String>,
    /// Uniform refinements
    #[arg(long, value_parser = toml::numbers, value_name = "NUMBERS")]
    refinements: Option<String>,
    /// Engines: native, petsc
    #[arg(long, value_parser = toml::words, value_name = "NAMES")]
    engines: Option<String>,
    /// Contact solvers: condensed, snes, tao
    #[arg(long, value_parser = toml::words, value_name = "NAMES")]
    #[serde(rename = "vi")]
    solvers: Option<String>,
    /// Mesh that measures the error in space, such as 40x16
    #[arg(long, value_parser = toml::pair, value_name = "NXxNY")]
    #[serde(rename = "reference_cells")]
    reference: Option<String>,
    /// Mass of the motion on that mesh: singular, modal
    #[arg(long, value_parser = toml::word, value_name = "NAME")]
    reference_mass: Option<String>,
    /// Number of modes of that motion
    #[arg(long, value_name = "N")]
    reference_modes: Option<String>,
    /// Runs to leave out, by words of their names such as "80x32 newmark 2e-6"
    #[arg(long, value_parser = toml::words, value_name = "WORDS")]
    skip: Option<String>,
    /// Instants in s at which errors of the whole deflection are reported
    #[arg(long, value_parser = toml::numbers, value_name = "NUMBERS")]
    at: Option<String>,
    /// Horizon that ranks the runs: first_impact, second_impact, end
    #[arg(long, value_parser = toml::word, value_name = "PART")]
    until: Option<String>,
    /// Timed repetitions of each run
    #[arg(long, value_name = "N")]
    repeat: Option<String>,
}

impl Execute for Study {
    fn execute(&self, _: Program) -> Result<()> {
        let scene = self.scene.load_with(&[&overrides("study", &self.lists)])?;
        let study = scene.study();
        #[cfg(feature = "petsc")]
        if study.engines.contains(&EngineName::Petsc) {
            let context = Context::start(&self.scene.petsc)?;
            let on_both = |scene: &Scene, keep_fields: bool| match scene.solver.engine {
                EngineName::Native => accuracy::run_native(scene, keep_fields),
                EngineName::Petsc => {
                    let model = Model::distributed(scene, &context)?;
                    let solver = model.solver(scene);
                    let run =
                        |trajectory: &mut Trajectory| simulation::run(scene, &model, &*solver, trajectory);
                    Trajectory::record(scene, keep_fields, run)
                }
            };
            self.make(&scene, &study, &on_both)?;
            return context.refuse_unused_options();
        }
        refuse_petsc_options(&self.scene.petsc)?;
        self.make(&scene, &study, &accuracy::run_native)
    }
}

impl Study {
    fn make(&self, scene: &Scene, study: &crate::scene::Study, run: &Runner) -> Result<()> {
        let folder = self.scene.folder(self.out.as_deref(), "studies");
        let quiet = self.scene.voice.is_silent();
        let (command, hash) = (command_line(), scene.hash());
        self.refuse_results(&folder, &hash)?;
        fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
        remove(&folder.join(report::FILE))?;
        let json = input::read_plain(&folder.join(FILES[0])).ok().filter(|_| !self.fresh);
        let stopped = json.and_then(|json| Accuracy::stopped(&json, &hash));
        if let (Some(stopped), false) = (&stopped, quiet) {
            let (runs, failures) = (stopped.runs.len(), stopped.failures.len());
            eprintln!("going on in {}: {runs} runs and {failures} failures are known", folder.display());
        }
        let line = moving_line("{pos}/{len}  {elapsed}  {wide_msg}", Some(0), quiet);
        let mut watch = Files { folder: &folder, command: &command, scene, hash: &hash, line, quiet };
        let accuracy = accuracy::study(scene, study, stopped, run, self.jobs.get(), &mut watch)?;
        watch.line.finish_and_clear();
        Figure::write_all(&folder.join(plot::FOLDER), &pictures::figures(&accuracy, &command))?;
        self.scene.voice.print(&accuracy, &accuracy.summary(&command, scene, &hash))?;
        if !quiet {
            print(&format!("\nwritten to {}\n", folder.display()))?;
        }
        Ok(())
    }

    /// Refuses a folder with foreign files or, without `--fresh`, the study of another scene.
    fn refuse_results(&self, folder: &Path, hash: &str) -> Result<()> {
        claim::refuse_foreign(folder, "study", "--out", |name| FILES.contains(&name))?;
        let Ok(bytes) = input::read_plain(&folder.join(FILES[0])) else { return Ok(()) };
        let study: serde_json::Value = serde_json::from_slice(&bytes).unwrap_or_default();
        if self.fresh || study["scene"] == hash {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "{} holds the study of another scene, or with other lists: --out DIR names another folder, \
             --fresh replaces it",
            folder.display()
        )))
    }
}

/// Names of the files that a study writes into its folder.
const FILES: [&str; 4] = ["study.json", "study.csv", plot::FOLDER, report::FILE];

/// Writer that keeps the files up to date, so that an interrupted study keeps its results.
struct Files<'f> {
    folder: &'f Path,
    command: &'f str,
    scene: &'f Scene,
    hash: &'f str,
    line: ProgressBar,
    quiet: bool,
}

impl Watch for Files<'_> {
    fn begins(&mut self, parts: usize, seconds: f64) {
        self.line.set_length(parts as u64);
        if !self.quiet {
            let time = Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX);
            // The report alone goes to standard output.
            eprintln!("{parts} parts, about {}", HumanDuration(time));
        }
    }

    fn starts(&mut self, what: &str) {
        self.line.set_message(what.to_owned());
    }

    fn done(&mut self, so_far: &Accuracy) -> Result<()> {
        self.line.inc(1);
        write_json(&self.folder.join("study.json"), &so_far.summary(self.command, self.scene, self.hash))?;
        write_atomic(&self.folder.join("study.csv"), so_far.csv().as_bytes())
    }
}
