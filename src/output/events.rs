//! `events.csv`: closing and opening of contacts, from a scheme that locates them.

use super::Lines;
use crate::error::Result;
use crate::scheme::Event;
use crate::simulation::NodeEvent;
use std::fmt::Write as _;

/// Name of the file in the run folder.
pub const FILE: &str = "events.csv";

/// Columns: time, s, with 17 digits; index of the node; its position, m; `closes` or `opens`;
/// velocity before a contact closes or after it opens, m/s; sum of the reactions over all nodes, N
/// (the reaction of the node itself is 0, because reactions are continuous).
pub(super) const HEADER: &str = "time,node,x,y,kind,velocity,reaction";

/// Appends the row of an event.
pub(super) fn push(file: &mut Lines, event: &NodeEvent) -> Result<()> {
    let NodeEvent { node, at: [x, y], event } = event;
    let Event { time, closes, velocity, force, .. } = event;
    let kind = if *closes { "closes" } else { "opens" };
    file.push(|line| {
        write!(line, "{time:.16e},{node},{x},{y},{kind},{velocity:e},{force:e}")
            .expect("a string takes everything");
    })
}
