//! Increments over a step.

use super::limits::Limits;

/// Increments over a step; work space.
#[derive(Default)]
pub(super) struct Increments {
    /// Increments of the modal coordinates and their rates.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    /// Increments of the deflections of the candidates without reactions, in m.
    pub y: Vec<f64>,
    /// Increments of the bounds; used only where they change in time.
    pub limits: Limits,
}

impl Increments {
    /// Creates the increments of a number of modes.
    pub fn new(modes: usize) -> Increments {
        Increments { q: vec![0.0; modes], v: vec![0.0; modes], ..Increments::default() }
    }
}
