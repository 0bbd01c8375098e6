//! Command line: translates arguments into calls.

mod animate;
mod arguments;
mod cache;
mod check;
mod command;
mod compare;
mod continuation;
mod figures;
mod hard_scenes;
pub mod launch;
mod execution;
mod job;
mod modes;
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
mod set_up;
mod shell;
mod signal;
mod sound;
mod stability;
mod study;
mod sweep;
mod terminal;

use crate::error::Result;
use crate::memory;
use clap::error::ErrorKind;
use command::{Entry, Execute};
use std::ffi::OsString;

/// Beginning of the work, and the exit codes.
const BEGINNING: &str = "\
Begin with:
  rebond new plate            # writes plate.toml, a commented scene
  rebond check plate.toml     # its size, natural frequencies, an advised step, cost, warnings
  rebond run plate.toml       # simulates, into runs/plate
  rebond plot runs/plate      # pictures
  rebond report runs/plate    # one page with the moving plate, for a browser

Exit codes: 0 done; 2 scene or command line; 3 a solver did not converge; 4 reading or writing;
5 the energy guard stopped the run; 130 interrupted, with a checkpoint written.";

/// Commands in the order of the help.
static COMMANDS: [Entry; 19] = [
    Entry::new::<run::Run>("run").on_ranks(),
    Entry::new::<resume::Resume>("resume").on_ranks(),
    Entry::new::<check::Check>("check"),
    Entry::new::<check::Inspect>("inspect"),
    Entry::new::<modes::ModesArgs>("modes"),
    Entry::new::<compare::Compare>("compare").on_ranks(),
    Entry::new::<study::Study>("study"),
    Entry::new::<sweep::SweepArgs>("sweep").on_ranks(),
    Entry::new::<continuation::ContinueArgs>("continue"),
    Entry::new::<stability::Stable>("stability"),
    Entry::new::<figures::Figures>("figures"),
    Entry::new::<plot::Plot>("plot"),
    Entry::new::<report_page::ReportPage>("report"),
    Entry::new::<animate::Animate>("animate"),
    Entry::new::<sound::SoundArgs>("sound"),
    Entry::new::<new_scene::NewScene>("new"),
    Entry::new::<shell::Schema>("schema"),
    Entry::new::<shell::Completions>("completions"),
    Entry::new::<shell::ManPages>("man"),
];

/// Returns the program with its commands.
fn program() -> clap::Command {
    let program = clap::Command::new(env!("CARGO_PKG_NAME"))
        .version(env!("CARGO_PKG_VERSION"))
        .about(env!("CARGO_PKG_DESCRIPTION"))
        .subcommand_required(true)
        .arg_required_else_help(true)
        .after_help(BEGINNING);
    program.subcommands(COMMANDS.iter().map(|entry| (entry.declare)(clap::Command::new(entry.name))))
}

/// Command line: a command with its options.
pub struct Cli {
    entry: &'static Entry,
    command: Box<dyn Execute>,
}

impl Cli {
    /// Reads the command line, the name of the program first.
    ///
    /// # Errors
    /// Returns clap's error, also for `--help` and `--version`, whose text it then is.
    pub fn read<W: Into<OsString> + Clone>(
        words: impl IntoIterator<Item = W>,
    ) -> std::result::Result<Cli, clap::Error> {
        let words: Vec<OsString> = words.into_iter().map(Into::into).collect();
        let matches = match program().try_get_matches_from(&words) {
            // Libraries that a command may do without are loaded to tell their versions.
            Err(why) if why.kind() == ErrorKind::DisplayVersion => {
                program().long_version(shell::version()).try_get_matches_from(words)
            }
            result => result.map_err(|why| in_one_line(why, &words)),
        }?;
        let (name, matches) = matches.subcommand().expect("a command is required");
        let entry = COMMANDS.iter().find(|entry| entry.name == name).expect("it is one of the registry");
        Ok(Cli { entry, command: (entry.parse)(matches)? })
    }
}

/// Returns an error of the command line in one line, which names the help of its command; help and
/// version as they are.
fn in_one_line(why: clap::Error, words: &[OsString]) -> clap::Error {
    use ErrorKind::{DisplayHelp, DisplayHelpOnMissingArgumentOrSubcommand, DisplayVersion};
    if matches!(why.kind(), DisplayHelp | DisplayHelpOnMissingArgumentOrSubcommand | DisplayVersion) {
        return why;
    }
    let text = why.to_string();
    let is_usage = |part: &&str| part.starts_with("Usage:") || part.starts_with("For more information");
    let parts = text.trim_start_matches("error: ").split("\n\n").take_while(|part| !is_usage(part));
    let parts = parts.map(|part| part.lines().map(str::trim).collect::<Vec<_>>().join(" "));
    let told = parts.collect::<Vec<_>>().join("; ");
    let told = told.replace("invalid digit found in string", "expected a whole number");
    let command = COMMANDS.iter().find(|entry| words.get(1).is_some_and(|word| word == entry.name));
    let command = command.map_or(String::new(), |entry| format!(" {}", entry.name));
    clap::Error::raw(why.kind(), format!("{told}; see rebond{command} --help\n"))
}

/// Executes the command.
///
/// # Errors
/// Returns the error of the command, whose [code](crate::Error::exit_code) is that of the program.
pub fn execute(Cli { entry, command }: &Cli) -> Result<()> {
    memory::require_some()?;
    signal::survive_full_files();
    if !entry.is_on_ranks {
        launch::one_process(&format!("{} runs", entry.name))?;
    }
    command.execute(program)
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
        let program = program();
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
