//! Command line: translates arguments into calls.

mod check;
mod compare;
mod figures;
mod hard_scenes;
pub mod launch;
mod plot;
mod resume;
mod run;
mod signal;
mod stability;
mod study;

use crate::error::{Error, Result};
use crate::memory;
use crate::scene::{EngineName, Scene};
use clap::{Args, Parser, Subcommand};
use std::io::Write;
use std::path::PathBuf;

/// Time that a failed rank waits for the others to fail too, before it ends them.
#[cfg(feature = "petsc")]
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(5);

/// Thin elastic plates that vibrate and hit rigid obstacles.
#[derive(Debug, Parser)]
#[command(name = "rebond", version, about, arg_required_else_help = true)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulate a scene; writes history.csv, contacts.csv, summary.json, fields and a picture into
    /// the run folder
    Run(run::Run),
    /// Resume an interrupted run from its newest checkpoint, bitwise as if without interruption
    Resume(resume::Resume),
    /// Read and validate a scene: its defaults, size, frequencies, advised step and expected time
    Check(check::Check),
    /// Natural frequencies, masses, initial energy, static deflection and inf-sup constant of a
    /// scene
    Inspect(check::Inspect),
    /// Run a scene on several engines and contact solvers: how far they differ, what each costs
    Compare(compare::Compare),
    /// Measure what accuracy costs in time: errors against seconds for schemes, masses, steps and
    /// meshes
    Study(Box<study::Study>),
    /// Try every method on hard scenes, and judge its energy, residual and penetration
    Stability(stability::Stable),
    /// The six figures of CSMA 2013, and a verdict on each of the paper's claims
    Figures(figures::Figures),
    /// Draw a run folder: history, energies, contacts, phase portraits, spectra, snapshots; SVG and
    /// PNG
    Plot(plot::Plot),
}

/// Output mode of a command.
#[derive(Debug, Clone, Copy, Args)]
struct OutputMode {
    /// Print JSON on standard output
    #[arg(long)]
    json: bool,
    /// Print errors only
    #[arg(long, short)]
    quiet: bool,
}

impl OutputMode {
    /// Returns whether progress is hidden.
    fn is_silent(self) -> bool {
        self.json || self.quiet
    }

    /// Prints a report, or its value as JSON, unless in quiet mode.
    fn print(self, report: &impl std::fmt::Display, value: &impl serde::Serialize) -> Result<()> {
        match (self.json, self.quiet) {
            (true, _) => print(&json(value)?),
            (false, false) => print(&report.to_string()),
            (false, true) => Ok(()),
        }
    }
}

/// Scene file with overrides and solver settings.
#[derive(Debug, Args)]
struct SceneArgs {
    /// Scene file (TOML)
    scene: PathBuf,
    /// Change a key of the scene, such as time.step=1e-6; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    overrides: Vec<String>,
    /// Linear algebra: native | petsc
    #[arg(long, value_name = "ENGINE")]
    engine: Option<String>,
    /// Contact solver: condensed | snes | tao
    #[arg(long, value_name = "SOLVER")]
    vi: Option<String>,
    #[command(flatten)]
    voice: OutputMode,
    /// Options for PETSc, after --
    #[arg(last = true, value_name = "PETSC OPTIONS")]
    petsc: Vec<String>,
}

impl SceneArgs {
    /// Loads the scene.
    ///
    /// A scene that names no engine gets the one that works with the number of started processes.
    fn load(&self) -> Result<Scene> {
        self.load_with(&[])
    }

    /// Loads the scene with additional overrides.
    fn load_with(&self, more: &[String]) -> Result<Scene> {
        let named = [("solver.engine", &self.engine), ("solver.vi", &self.vi)];
        let named = named.into_iter().filter_map(|(key, name)| Some(format!("{key}={}", name.as_ref()?)));
        let overrides: Vec<String> =
            self.overrides.iter().cloned().chain(named).chain(more.iter().cloned()).collect();
        let parallel = cfg!(feature = "petsc") && launch::size() > 1;
        let engine = if parallel { EngineName::Petsc } else { EngineName::Native };
        Scene::load_for(&self.scene, &overrides, engine)
    }
}

/// Refuses PETSc options on a run that does not read them.
fn refuse_petsc_options(options: &[String]) -> Result<()> {
    options.first().map_or(Ok(()), |option| {
        Err(Error::Usage(format!("{option}: options after -- are for PETSc; choose it with --engine petsc")))
    })
}

/// Returns the command as typed, for the foot of a plot.
fn command_line() -> String {
    let mut words = std::env::args();
    let program = words.next().map(PathBuf::from);
    let program = program.as_ref().and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
    let quoted = words.map(|word| if word.contains([' ', '"', '[']) { format!("'{word}'") } else { word });
    std::iter::once(program.unwrap_or_default().into_owned()).chain(quoted).collect::<Vec<_>>().join(" ")
}

fn json(value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(value)
        .map(|text| text + "\n")
        .map_err(|why| Error::Io { path: "standard output".into(), source: why.into() })
}

/// Writes to standard output; a reader that closes the pipe early (`rebond check ... | head`) is no
/// error.
fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(why) if why.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Io { path: "standard output".into(), source: why })
        }
        _ => Ok(()),
    }
}

/// Executes the command.
///
/// # Errors
/// Returns the error of the command; [`Error::exit_code`] is its exit code.
pub fn execute(cli: &Cli) -> Result<()> {
    memory::require_some()?;
    match &cli.command {
        Command::Run(run) => run.execute(),
        Command::Resume(resume) => resume.execute(),
        Command::Check(check) => check.execute(),
        Command::Inspect(inspect) => inspect.execute(),
        Command::Compare(compare) => compare.execute(),
        Command::Study(study) => study.execute(),
        Command::Stability(stability) => stability.execute(),
        Command::Figures(figures) => figures.execute(),
        Command::Plot(plot) => plot.execute(),
    }
}
