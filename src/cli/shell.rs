//! Commands `rebond completions`, `rebond man` and `rebond schema`, and the text of `--version`.

use super::command::{Execute, Program};
use super::printing::{json, print};
use crate::error::{Error, Result, suggestion};
use crate::output::write_atomic;
#[cfg(feature = "petsc")]
use crate::petsc::Context;
use crate::scene;
use clap::Args;
use clap_complete::Shell;
use std::path::PathBuf;

const COMPLETIONS: &str = "\
Examples:
  rebond completions bash > ~/.local/share/bash-completion/completions/rebond
  rebond completions zsh > ~/.zfunc/_rebond
  rebond completions fish > ~/.config/fish/completions/rebond.fish";

/// Print completions for a shell
#[derive(Debug, Args)]
#[command(after_help = COMPLETIONS)]
pub(super) struct Completions {
    /// Shell
    #[arg(value_enum)]
    shell: Shell,
}

const MAN: &str = "\
Examples:
  rebond man | man -l -
  rebond man sweep | man -l -
  rebond man --out ~/.local/share/man/man1    # all pages";

/// Print a manual page, or write all of them
#[derive(Debug, Args)]
#[command(after_help = MAN)]
pub(super) struct ManPages {
    /// Command whose page is printed; default: that of the program
    command: Option<String>,
    /// Folder into which all pages are written instead
    #[arg(long, value_name = "DIR", conflicts_with = "command")]
    out: Option<PathBuf>,
}

const SCHEMA: &str = "\
Example:
  rebond schema > scene.schema.json

Editors with a TOML language server complete and check a scene whose first line is
#:schema ./scene.schema.json";

/// Print the JSON schema of scenes, by which editors complete and check them
#[derive(Debug, Args)]
#[command(after_help = SCHEMA)]
pub(super) struct Schema {}

impl Execute for Completions {
    fn execute(&self, program: Program) -> Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut program(), env!("CARGO_PKG_NAME"), &mut script);
        print(&String::from_utf8_lossy(&script))
    }
}

impl Execute for ManPages {
    fn execute(&self, program: Program) -> Result<()> {
        let mut program = program();
        // Each subcommand gets its whole name, such as `rebond run`.
        program.build();
        let commands = || program.get_subcommands().filter(|command| command.get_name() != "help");
        if let Some(folder) = &self.out {
            std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
            let mut written = String::new();
            for command in std::iter::once(&program).chain(commands()) {
                let name = command.get_display_name().unwrap_or(command.get_name());
                let path = folder.join(format!("{name}.1"));
                write_atomic(&path, page(command)?.as_bytes())?;
                written += &format!("{}\n", path.display());
            }
            return print(&written);
        }
        let Some(name) = &self.command else { return print(&page(&program)?) };
        match commands().find(|command| command.get_name() == name) {
            Some(command) => print(&page(command)?),
            None => {
                let names: Vec<&str> = commands().map(clap::Command::get_name).collect();
                let expected = format!("expected one of {}{}", names.join(", "), suggestion(name, &names));
                Err(Error::Usage(format!("{name:?} is no command; {expected}")))
            }
        }
    }
}

/// Returns the manual page of a command.
fn page(command: &clap::Command) -> Result<String> {
    let mut page = Vec::new();
    let name = command.get_display_name().unwrap_or(command.get_name()).to_owned();
    let command = command.clone().name(name);
    clap_mangen::Man::new(command).render(&mut page).map_err(Error::io("manual page"))?;
    Ok(String::from_utf8_lossy(&page).into_owned())
}

impl Execute for Schema {
    fn execute(&self, _: Program) -> Result<()> {
        print(&json(&scene::schema())?)
    }
}

/// Returns the version of the program, and those of the libraries that it finds.
pub(super) fn version() -> String {
    let version = env!("CARGO_PKG_VERSION");
    #[cfg(feature = "petsc")]
    {
        let petsc = match Context::library_version() {
            Ok([major, minor, patch]) => format!("PETSc {major}.{minor}.{patch}"),
            Err(absent) => absent.to_string(),
        };
        // MPI answers before it is started. Its answer has one line, or several.
        let mpi = mpi::environment::library_version().unwrap_or_default();
        let mpi = mpi.lines().next().unwrap_or_default();
        let mpi = mpi.split(", package").next().unwrap_or(mpi).trim_matches(['\0', ' ']).to_owned();
        format!("{version}\nfeatures: petsc\nengines: native, petsc\n{petsc}\n{mpi}")
    }
    #[cfg(not(feature = "petsc"))]
    format!("{version}\nfeatures: none (built without petsc)\nengines: native")
}
