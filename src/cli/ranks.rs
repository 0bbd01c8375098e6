//! Starts and ends of the commands that run on several ranks.

use crate::communicator::Communicator;
use crate::distributed;
use crate::error::{Error, Result};
use crate::hash;
use crate::output::checkpoint::Identity;
use crate::petsc::Context;
use std::rc::Rc;
use std::time::Duration;

/// Time that a failed rank waits for the others to fail too, before it ends them.
pub(super) const PATIENCE: Duration = Duration::from_secs(5);

/// Starts MPI and PETSc with the options of a scene's command, on groups of `ranks` ranks or on one
/// of all, and refuses ranks that do not all begin with the same scene. Collective.
///
/// # Errors
/// Returns [`Error::Usage`] on all ranks where one has another input, and the errors of
/// [`Context::start_in_groups`].
pub(super) fn start(options: &[String], ranks: Option<usize>, scene: &Identity) -> Result<Rc<Context>> {
    let context = Context::start_in_groups(options, ranks)?;
    same_input(&context, Some(scene))?;
    Ok(context)
}

/// Prints a text once for all ranks, which ask for nothing but that. Returns whether this rank is
/// the one to print it. Collective.
///
/// # Errors
/// Returns the errors of [`start`].
pub fn print_once() -> Result<bool> {
    let context = Context::start(&[])?;
    same_input(&context, None)?;
    Ok(context.rank() == 0)
}

/// Refuses ranks that are given different words, scenes, meshes or options of the environment:
/// each would compute its part of another plate. Collective.
fn same_input(context: &Context, scene: Option<&Identity>) -> Result<()> {
    let words: Vec<_> = std::env::args_os().skip(1).collect();
    // A command line that names another file of a scene is told as another scene.
    let parts = [
        ("scene", format!("{:?}", scene.map(|identity| &identity.scene))),
        ("mesh file", format!("{:?}", scene.map(|identity| identity.mesh))),
        ("command line", format!("{words:?}")),
        ("PETSC_OPTIONS", format!("{:?}", std::env::var_os("PETSC_OPTIONS"))),
    ];
    let prints = parts.clone().map(|(_, text)| hash::fnv1a(text.into_bytes()));
    let prints = context.everyone.all_gather_one(prints);
    for (part, (name, _)) in parts.iter().enumerate() {
        if let Some(rank) = prints.iter().position(|prints_there| prints_there[part] != prints[0][part]) {
            return Err(Error::Usage(format!(
                "rank {rank} was given another {name} than rank 0; all ranks of a run need the same"
            )));
        }
    }
    Ok(())
}

/// Ends all ranks where any has an error, after the others with errors have written their output;
/// rank 0 prints the error.
pub(super) fn ended(context: &Context, ended: Result<()>) -> Result<()> {
    let ended = ended.map_err(|why| with_options(context, why));
    if context.size() > 1 { context.settle(ended, PATIENCE) } else { ended }
}

/// Names the user's options of the linear solver beside an error that these may have caused.
fn with_options(context: &Context, error: Error) -> Error {
    let options =
        ["", distributed::IN_PLANE].map(|prefix| context.solver_options(prefix).unwrap_or_default());
    let options = options.join(" ").trim().to_owned();
    match error {
        Error::Singular(words) if !options.is_empty() => Error::Singular(format!(
            "{words}; but first try without {options}, options of a linear solver that may be too inaccurate"
        )),
        other => other,
    }
}

/// Returns a number of ranks in words.
pub(super) fn in_words(count: usize) -> String {
    if count == 1 { "1 rank".into() } else { format!("{count} ranks") }
}
