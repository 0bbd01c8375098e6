//! `events.csv`: closing and opening of contacts, from a scheme that locates them.

use super::{Lines, remove};
use crate::error::Result;
use crate::hash::Extent;
use crate::scheme::Event;
use crate::simulation::NodeEvent;
use std::fmt::Write as _;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "events.csv";

/// Writer of `events.csv`.
///
/// The columns are time (s, 17 digits), node, x, y (m), kind (`closes` or `opens`), velocity (m/s,
/// before a contact closes or after it opens) and reaction (N, the sum over all nodes; that of the
/// node itself is 0 because reactions are continuous).
#[derive(Debug)]
pub struct Events {
    lines: Lines,
}

impl Events {
    /// Creates `events.csv` in `folder`, which is created if necessary.
    ///
    /// # Errors
    /// Returns [`crate::Error::Io`] where the file cannot be written, as do all methods.
    pub fn create(folder: &Path) -> Result<Events> {
        Ok(Events { lines: Lines::create(folder, FILE, "time,node,x,y,kind,velocity,reaction")? })
    }

    /// Continues after what the file had at a checkpoint.
    pub fn resume(folder: &Path, written: Extent) -> Result<Events> {
        Ok(Events { lines: Lines::resume(folder, FILE, written)? })
    }

    /// Writes everything to the disk and returns what the file has.
    pub fn position(&mut self) -> Result<Extent> {
        self.lines.position()
    }

    /// Adds an event.
    pub fn push(&mut self, event: &NodeEvent) -> Result<()> {
        let NodeEvent { node, at: [x, y], event } = event;
        let Event { time, closes, velocity, force, .. } = event;
        let kind = if *closes { "closes" } else { "opens" };
        self.lines.push(|line| {
            write!(line, "{time:.16e},{node},{x},{y},{kind},{velocity:e},{force:e}")
                .expect("a string takes everything");
        })
    }

    /// Finishes the file, and reports errors of the last write, which a drop ignores.
    pub fn finish(mut self) -> Result<()> {
        self.lines.flush()
    }
}

/// Removes the file of an earlier run.
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))
}
