//! File `reactions.csv`: forces and moments along named supports, one row per node and instant.

use super::Lines;
use super::history::numbers;
use crate::error::Result;
pub use crate::simulation::NodeReaction;
use std::fmt::Write as _;

/// Name of the file in the run folder.
pub const FILE: &str = "reactions.csv";
/// Columns: index of the step; time, s; name of the support; position of the node, m; force of the
/// support on it, N, positive upwards; moments about the axes x and y through it, N m.
pub(super) const HEADER: &str = "step,time,support,x,y,force,moment_x,moment_y";

/// Appends the rows of an instant (s), with the names of the supports.
pub(super) fn push(
    file: &mut Lines,
    step: u64,
    time: f64,
    names: &[&str],
    rows: &[NodeReaction],
) -> Result<()> {
    rows.iter().try_for_each(|&NodeReaction { support, at: [x, y], force, moments }| {
        file.push(|line| {
            write!(line, "{step}").expect("a string takes everything");
            numbers(line, [time]);
            write!(line, ",{}", names[support]).expect("a string takes everything");
            numbers(line, [x, y, force, moments[0], moments[1]]);
        })
    })
}
