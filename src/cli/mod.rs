//! Command line: translates arguments into calls.

mod arguments;
mod cache;
mod check;
mod compare;
mod figures;
mod hard_scenes;
pub mod launch;
mod execution;
mod job;
mod plot;
mod printing;
#[cfg(feature = "petsc")]
mod ranks;
mod recorder;
mod report;
mod report_page;
mod resume;
mod run;
mod run_folder;
mod set_up;
mod signal;
mod stability;
mod study;
mod sweep;

use crate::error::Result;
use crate::memory;
use clap::{Parser, Subcommand};

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
    /// Make many runs over one or two keys: response curves, bifurcation diagrams, maps
    Sweep(Box<sweep::SweepArgs>),
    /// Try every method on hard scenes, and judge its energy, residual and penetration
    Stability(stability::Stable),
    /// The six figures of CSMA 2013, and a verdict on each of the paper's claims
    Figures(figures::Figures),
    /// Draw a run folder: history, energies, contacts, phase portraits, spectra, snapshots; SVG and
    /// PNG
    Plot(plot::Plot),
    /// Write a run folder's report.html: one page with the moving plate, charts and contacts, which
    /// needs no network
    Report(report_page::ReportPage),
}

/// Executes the command.
///
/// # Errors
/// Returns the error of the command, whose [code](crate::Error::exit_code) is that of the program.
pub fn execute(cli: &Cli) -> Result<()> {
    memory::require_some()?;
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
    }
}
