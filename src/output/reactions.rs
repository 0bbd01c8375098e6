//! File `reactions.csv`: forces and moments along named supports, one row per node and instant.

use super::history::number;
use super::{Lines, remove};
use crate::error::Result;
use crate::hash::Extent;
pub use crate::simulation::NodeReaction;
use std::fmt::Write as _;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "reactions.csv";
/// Columns: index of the step; time, s; name of the support; position of the node, m; force of the
/// support on it, N, positive upwards; moments about the axes x and y through it, N m.
const HEADER: &str = "step,time,support,x,y,force,moment_x,moment_y";

/// Writer of `reactions.csv`.
#[derive(Debug)]
pub struct Reactions {
    lines: Lines,
}

impl Reactions {
    /// Creates an empty `reactions.csv` in `folder`, and the folder if necessary.
    ///
    /// # Errors
    /// Returns [`Error::Io`](crate::Error::Io) on a failure to write; so do the functions below.
    pub fn create(folder: &Path) -> Result<Reactions> {
        Ok(Reactions { lines: Lines::create(folder, FILE, HEADER)? })
    }

    /// Continues the file after what it had at a checkpoint.
    pub fn resume(folder: &Path, written: Extent) -> Result<Reactions> {
        Ok(Reactions { lines: Lines::resume(folder, FILE, written)? })
    }

    /// Writes all rows to the disk and returns what the file has.
    pub fn position(&mut self) -> Result<Extent> {
        self.lines.position()
    }

    /// Appends the rows of an instant (s), with the names of the supports.
    pub fn push(&mut self, step: u64, time: f64, names: &[String], rows: &[NodeReaction]) -> Result<()> {
        rows.iter().try_for_each(|&NodeReaction { support, at: [x, y], force, moments }| {
            self.lines.push(|line| {
                write!(line, "{step},").expect("a string takes everything");
                number(line, time);
                write!(line, ",{}", names[support]).expect("a string takes everything");
                for value in [x, y, force, moments[0], moments[1]] {
                    line.push(',');
                    number(line, value);
                }
            })
        })
    }

    /// Closes the file and returns an error if the last rows could not be written, which a mere
    /// drop would hide.
    pub fn finish(mut self) -> Result<()> {
        self.lines.flush()
    }
}

/// Removes the file of an earlier run.
///
/// # Errors
/// Returns [`Error::Io`](crate::Error::Io) where the file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))
}
