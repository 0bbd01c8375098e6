//! `events.csv`: every touch and leave of a node, from a scheme that follows them.

use super::{Lines, remove};
use crate::error::Result;
use crate::scheme::Event;
use crate::simulation::NodeEvent;
use std::fmt::Write as _;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "events.csv";

/// Writes `events.csv`: time (s, 17 digits), node, x, y (m), kind (`closes` or `opens`), velocity (m/s, before it closes or after it
/// opens) and reaction (N, of all nodes together; that of the node itself is 0, for reactions are continuous).
#[derive(Debug)]
pub struct Events {
    lines: Lines,
}

impl Events {
    /// Starts `events.csv` afresh in `folder`, which is created if need be.
    ///
    /// # Errors
    /// [`crate::Error::Io`], as all below.
    pub fn create(folder: &Path) -> Result<Events> {
        Ok(Events { lines: Lines::create(folder, FILE, "time,node,x,y,kind,velocity,reaction")? })
    }

    /// Goes on with the first `length` bytes of what is there.
    pub fn resume(folder: &Path, length: u64) -> Result<Events> {
        Ok(Events { lines: Lines::resume(folder, FILE, length)? })
    }

    /// How many bytes have reached the disk: all.
    pub fn position(&mut self) -> Result<u64> {
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

    /// Ends the file; unlike a mere drop, says when the last events could not be written.
    pub fn finish(mut self) -> Result<()> {
        self.lines.flush()
    }
}

/// Removes the file of an earlier run.
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))
}
