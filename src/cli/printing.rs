//! Standard output of the commands: reports for readers, or JSON.

use super::launch;
use crate::error::{Error, Result};
use crate::output::text::quoted;
use clap::Args;
use std::io::{IsTerminal, Write};
use std::path::PathBuf;

/// Output mode of a command.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct OutputMode {
    /// Print JSON on standard output
    #[arg(long)]
    pub json: bool,
    /// Print errors only
    #[arg(long, short)]
    pub quiet: bool,
}

impl OutputMode {
    /// Returns whether progress is hidden.
    pub fn is_silent(self) -> bool {
        self.json || self.quiet
    }

    /// Prints a report, or its value as JSON, unless in quiet mode.
    pub fn print(self, report: &impl std::fmt::Display, value: &impl serde::Serialize) -> Result<()> {
        match (self.json, self.quiet) {
            (true, _) => print(&json(value)?),
            (false, false) => {
                let [on, off] = colour(&std::io::stdout());
                print(&report.to_string().replace("\n  warning ", &format!("\n  {on}warning{off} ")))
            }
            (false, true) => Ok(()),
        }
    }
}

/// Returns a value as JSON text of several lines.
pub(super) fn json(value: &impl serde::Serialize) -> Result<String> {
    serde_json::to_string_pretty(value)
        .map(|text| text + "\n")
        .map_err(|why| Error::Io { path: "standard output".into(), source: why.into() })
}

/// Writes to standard output; a reader that closes the pipe early (`rebond check ... | head`) is no
/// error.
pub(super) fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(why) if why.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Error::Io { path: "standard output".into(), source: why })
        }
        _ => Ok(()),
    }
}

/// Returns a warning for standard error, with colour on a terminal.
pub(super) fn warning(text: &str) -> String {
    let [on, off] = colour(&std::io::stderr());
    format!("{on}warning:{off} {text}")
}

/// Returns what switches the colour of warnings on and off on a terminal; nothing on others.
fn colour(stream: &impl IsTerminal) -> [&'static str; 2] {
    let is_plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    if stream.is_terminal() && !is_plain { ["\x1b[33m", "\x1b[0m"] } else { [""; 2] }
}

/// Returns the command as a shell would take it again, for the foot of a plot.
pub(super) fn command_line() -> String {
    let mut words = std::env::args();
    let program = words.next().map(PathBuf::from);
    let program = program.as_ref().and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
    let launcher = match launch::size() {
        1 => String::new(),
        ranks => format!("mpirun -n {ranks} "),
    };
    let words = words.map(|word| quoted(&word)).collect::<Vec<_>>().join(" ");
    format!("{launcher}{} {words}", program.unwrap_or_default())
}
