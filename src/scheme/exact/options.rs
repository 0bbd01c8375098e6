//! Options of the event-driven scheme, and its memory.

use crate::error::{Error, Result};
use crate::linalg::{Engine, Form};
use crate::memory;
use crate::scheme::System;

/// Largest total size of the dense arrays, in bytes. Beyond it the first diagonalisation alone
/// takes minutes, and impacts need hundreds.
const MAX_DENSE_MEMORY: usize = 1 << 33;

/// Number of candidates expected with velocities of modes, in units of the number of bounded nodes
/// along the side of a square: edges are hit rather than faces.
const EXPECTED_LINES: usize = 4;

/// Number of modes from which on changes of one node take the place of eigenproblems. On the
/// paper's plate with 80x32 cells and 200 modes eigenproblems take 8 s to 0.2 s and change the
/// energy by 5e-13, changes 4 s and 2e-11; with 400 modes 94 s and 6e-12, or 27 s and 1e-11.
const CHANGES_FROM: usize = 256;

/// Returns the number of nodes that are expected in reach of their obstacles, among those bounded,
/// with velocities of modes.
pub fn expected_candidates(bounded: usize) -> usize {
    bounded.min(EXPECTED_LINES * (bounded as f64).sqrt().ceil() as usize)
}

/// Checks that the dense arrays fit into the memory.
///
/// # Errors
/// Returns [`Error::Usage`] and [`Error::Memory`] where they do not.
pub(super) fn require_memory<E: Engine>(system: &System<E>, candidates: usize) -> Result<()> {
    let System { engine, mass, .. } = system;
    let cells = engine.velocities(mass);
    let needed = estimated_memory(engine.dofs(), cells, candidates);
    let (size, advice) = match mass {
        Form::Modal { .. } => (
            format!("{cells} modes and {candidates} nodes in reach of an obstacle"),
            "reduce time.modes or set time.scheme = \"conserving\"",
        ),
        _ => (format!("{cells} cells"), "coarsen the mesh or set time.scheme = \"conserving\""),
    };
    if needed > MAX_DENSE_MEMORY {
        return Err(Error::Usage(format!(
            "time.scheme = \"exact\" would need {:.0} GB of dense matrices for {size}; {advice}",
            needed as f64 / 1e9
        )));
    }
    memory::require(needed as u64, &format!("time.scheme = \"exact\" with {size}"), |_| advice.into())
}

/// Returns the estimated peak memory of the dense arrays, in bytes.
pub fn estimated_memory(dofs: usize, cells: usize, bounded: usize) -> usize {
    // Number of arrays of these sizes held at once: in the solution for R, and in the
    // diagonalisation of a set.
    let (lifts, squares) = (7 * dofs * cells, 8 * cells * cells);
    let at_bounds = bounded * (2 * dofs + 4 * cells + 3 * bounded);
    // An impact visits about as many active sets as there are nodes that come into contact.
    let cached = bounded.max(1).saturating_mul(size_of::<f64>() * cells * (cells + bounded));
    size_of::<f64>() * (lifts + squares + at_bounds) + cached.min(ExactOptions::default().memory)
}

/// Options of the event detection. The motion depends on them only through rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExactOptions {
    /// Multiple of the rounding error of a gap or reaction within which it counts as zero.
    pub roundings: f64,
    /// First interval of the search, in units of 1/w of the fastest mode.
    pub stride: f64,
    /// Memory of the cache of modes, in bytes.
    pub memory: usize,
    /// Largest number of events per grid step.
    pub events_per_step: u64,
    /// Time before a possible contact from which on a node is watched, with velocities of modes, in
    /// periods of the fastest of them. A shorter one takes more checks, a longer one watches more
    /// nodes, and an infinite one all.
    pub horizon: f64,
    /// Number of modes from which on the eigenvectors of a set in contact follow from those of
    /// another set by changes of one node, with velocities of modes.
    pub changes_from: usize,
}

impl Default for ExactOptions {
    fn default() -> ExactOptions {
        ExactOptions {
            roundings: 64.0,
            stride: 4.0,
            memory: 1 << 29,
            events_per_step: 1_000_000,
            horizon: 0.1,
            changes_from: CHANGES_FROM,
        }
    }
}
