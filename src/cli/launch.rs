//! Number of processes and rank, read from the launcher's environment before MPI starts.

use crate::error::{Error, Result};
use std::time::Duration;

/// Reads a number that Open MPI or MPICH (and its derivatives) pass to a process.
fn number(names: [&str; 2]) -> Option<usize> {
    names.iter().find_map(|name| std::env::var(name).ok()?.parse().ok())
}

/// Returns the number of processes that were started together.
pub fn size() -> usize {
    number(["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"]).unwrap_or(1)
}

/// Returns the number of this process among them, from 0.
pub fn rank() -> usize {
    number(["OMPI_COMM_WORLD_RANK", "PMI_RANK"]).unwrap_or(0)
}

/// Refuses to repeat the same work in several processes.
///
/// # Errors
/// Returns [`Error::Usage`] where there are several.
pub(super) fn one_process(what: &str) -> Result<()> {
    match size() {
        1 => Ok(()),
        ranks => Err(Error::Usage(format!(
            "{what} in one process, and mpirun started {ranks}; `rebond run --engine petsc` takes several"
        ))),
    }
}

/// Returns whether this process is the one that prints a text for all, which each of them was asked
/// for alone.
///
/// # Errors
/// Returns [`Error::Usage`] where some process was asked for something else, and would wait for
/// this one without end.
pub fn prints() -> Result<bool> {
    #[cfg(feature = "petsc")]
    if size() > 1 {
        return super::ranks::print_once();
    }
    Ok(rank() == 0)
}

/// Waits for the first process to report an error that all have, and to end the others.
pub fn wait_turn() {
    let rank = rank() as u64;
    if rank > 0 {
        std::thread::sleep(Duration::from_millis(30_000 + 20 * rank.min(100)));
    }
}
