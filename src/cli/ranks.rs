//! Ends of the commands that run on several ranks.

use crate::error::Result;
use crate::petsc::Context;
use std::time::Duration;

/// Time that a failed rank waits for the others to fail too, before it ends them.
pub(super) const PATIENCE: Duration = Duration::from_secs(5);

/// Ends all ranks where any has an error, after the others with errors have written their output;
/// rank 0 prints the error.
pub(super) fn ended(context: &Context, ended: Result<()>) -> Result<()> {
    if context.size() > 1 { context.settle(ended, PATIENCE) } else { ended }
}

/// Returns a number of ranks in words.
pub(super) fn in_words(count: usize) -> String {
    if count == 1 { "1 rank".into() } else { format!("{count} ranks") }
}
