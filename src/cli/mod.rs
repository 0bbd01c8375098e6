//! Command line: translates arguments into calls.

mod animate;
mod arguments;
mod cache;
mod check;
mod compare;
mod figures;
mod hard_scenes;
mod help;
pub mod launch;
mod execution;
mod job;
mod new_scene;
mod plot;
mod printing;
#[cfg(feature = "petsc")]
mod ranks;
mod report;
mod report_many;
mod report_page;
mod resume;
mod run;
mod run_folder;
mod set_up;
mod shell;
mod signal;
mod stability;
mod study;
mod sweep;
mod terminal;

use crate::error::Result;
use crate::memory;
use clap::error::ErrorKind;
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;

/// Thin elastic plates that vibrate and hit rigid obstacles.
#[derive(Debug, Parser)]
#[command(name = "rebond", version, about, arg_required_else_help = true, after_help = help::PROGRAM)]
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
    /// Make many runs over one or two keys: response curves, bifurcation diagrams, maps
    Sweep(Box<sweep::SweepArgs>),
    /// Try every method on hard scenes, and judge its energy, residual and penetration
    Stability(stability::Stable),
    /// The six figures of CSMA 2013, and a verdict on each of the paper's claims
    Figures(figures::Figures),
    /// Draw a run folder: history, energies, contacts, phase portraits, spectra, snapshots; SVG and
    /// PNG
    Plot(plot::Plot),
    /// Write report.html into the folder of a run, a sweep or a study: one page with the moving
    /// plate, charts, pictures and tables, which needs no network
    Report(report_page::ReportPage),
    /// Draw a run's snapshots as an animated picture (APNG), which browsers and slides show
    Animate(animate::Animate),
    /// Write a commented scene to begin with: a falling plate, a Gmsh mesh, a shaker, ...
    New(new_scene::NewScene),
    /// Print the JSON schema of scenes, by which editors complete and check them
    Schema(shell::Schema),
    /// Print completions for a shell
    Completions(shell::Completions),
    /// Print a manual page, or write all of them
    Man(shell::ManPages),
}

impl Command {
    /// Returns the name of a command that several processes would only repeat.
    fn of_one_process(&self) -> Option<&'static str> {
        match self {
            Self::Run(_) | Self::Resume(_) | Self::Compare(_) | Self::Sweep(_) => None,
            Self::Check(_) => Some("check"),
            Self::Inspect(_) => Some("inspect"),
            Self::Study(_) => Some("study"),
            Self::Stability(_) => Some("stability"),
            Self::Figures(_) => Some("figures"),
            Self::Plot(_) => Some("plot"),
            Self::Report(_) => Some("report"),
            Self::Animate(_) => Some("animate"),
            Self::New(_) => Some("new"),
            Self::Schema(_) => Some("schema"),
            Self::Completions(_) => Some("completions"),
            Self::Man(_) => Some("man"),
        }
    }
}

impl Cli {
    /// Reads the command line, the name of the program first.
    ///
    /// # Errors
    /// Returns clap's error, also for `--help` and `--version`, whose text it then is.
    pub fn read<W: Into<OsString> + Clone>(
        words: impl IntoIterator<Item = W>,
    ) -> std::result::Result<Cli, clap::Error> {
        let words: Vec<W> = words.into_iter().collect();
        let read =
            |command: clap::Command| Cli::from_arg_matches(&command.try_get_matches_from(words.clone())?);
        match read(Cli::command()) {
            // Libraries that a command may do without are loaded to tell their versions.
            Err(why) if why.kind() == ErrorKind::DisplayVersion => {
                read(Cli::command().long_version(shell::version()))
            }
            result => result,
        }
    }
}

/// Executes the command.
///
/// # Errors
/// Returns the error of the command, whose [code](crate::Error::exit_code) is that of the program.
pub fn execute(cli: &Cli) -> Result<()> {
    memory::require_some()?;
    signal::survive_full_files();
    if let Some(name) = cli.command.of_one_process() {
        launch::one_process(&format!("{name} runs"))?;
    }
    match &cli.command {
        Command::Run(run) => run.execute(),
        Command::Resume(resume) => resume.execute(),
        Command::Check(check) => check.execute(),
        Command::Inspect(inspect) => inspect.execute(),
        Command::Compare(compare) => compare.execute(),
        Command::Study(study) => study.execute(),
        Command::Sweep(sweep) => sweep.execute(),
        Command::Stability(stability) => stability.execute(),
        Command::Figures(figures) => figures.execute(),
        Command::Plot(plot) => plot.execute(),
        Command::Report(report) => report.execute(),
        Command::Animate(animate) => animate.execute(),
        Command::New(new) => new.execute(),
        Command::Schema(schema) => schema.execute(),
        Command::Completions(completions) => completions.execute(Cli::command()),
        Command::Man(man) => man.execute(Cli::command()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Splits a line of a shell into words, without its comment.
    fn words(line: &str) -> Vec<String> {
        let (mut words, mut quote, mut is_open) = (Vec::new(), None, false);
        for c in line.chars() {
            match (quote, c) {
                (Some(open), c) if c == open => quote = None,
                (None, '\'' | '"') => quote = Some(c),
                (None, '#') if !is_open => break,
                (None, '|' | '>') => break,
                (None, ' ') => is_open = false,
                _ => {
                    if !is_open {
                        words.push(String::new());
                        is_open = true;
                    }
                    words.last_mut().expect("one was added").push(c);
                }
            }
        }
        words
    }

    #[test]
    fn the_parser_takes_every_example_of_the_help() {
        let program = Cli::command();
        for command in std::iter::once(&program).chain(program.get_subcommands()) {
            let help =
                command.get_after_help().unwrap_or_else(|| panic!("{}", command.get_name())).to_string();
            let lines: Vec<&str> = help.lines().filter(|line| line.starts_with("  ")).collect();
            assert!(!lines.is_empty(), "{help}");
            for line in lines {
                let words = words(line.trim().trim_start_matches("mpirun -n 2 "));
                assert_eq!(words[0], "rebond", "{line}");
                assert!(words[1] == command.get_name() || command.get_name() == "rebond", "{line}");
                Cli::read(&words).unwrap_or_else(|why| panic!("{line}\n{why}"));
            }
        }
    }
}
