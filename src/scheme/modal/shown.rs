//! State at the instants of the grid of the output.

use super::state::State;
use crate::obstacle::Bounds;
use crate::vi::ComplianceSolver;
use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;

/// State at a grid instant.
pub(super) struct Shown {
    /// State between two steps, used where the instant is not that of a step, and the solver for
    /// its reactions.
    pub state: State,
    pub contact: ComplianceSolver,
    /// Bounds of this rank at the instant.
    pub limits: Bounds,
    /// Displacement, in m, one entry per dof; computed where it is asked for.
    pub shape: OnceCell<Vec<f64>>,
    /// Mode shapes at the dofs whose displacement was asked for, one entry per mode.
    pub dof_rows: RefCell<BTreeMap<usize, Vec<f64>>>,
}

impl Shown {
    /// Creates a state under given bounds, without candidates.
    pub fn new(state: State, limits: Bounds) -> Shown {
        let contact = ComplianceSolver::new(0);
        Shown { state, contact, limits, shape: OnceCell::new(), dof_rows: RefCell::default() }
    }
}
