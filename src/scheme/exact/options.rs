//! Options of the event-driven scheme, and its memory.

/// Largest total size of the dense arrays, in bytes. Beyond it the first diagonalisation alone
/// takes minutes, and impacts need hundreds.
pub(super) const MAX_DENSE_MEMORY: usize = 1 << 33;

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
}

impl Default for ExactOptions {
    fn default() -> ExactOptions {
        ExactOptions { roundings: 64.0, stride: 4.0, memory: 1 << 29, events_per_step: 1_000_000 }
    }
}
