//! State at the instants of the grid of the output.

use super::state::State;
use crate::obstacle::Bounds;
use crate::vi::ComplianceSolver;
use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;

/// State at a grid instant. All but the limits is computed where it is asked for.
pub(super) struct Shown {
    /// State where the instant lies between two steps, and the solver of its reactions.
    pub between: OnceCell<(State, ComplianceSolver)>,
    /// Bounds of this rank at the instant.
    pub limits: Bounds,
    /// Displacement, in m, one entry per dof.
    pub shape: OnceCell<Vec<f64>>,
    /// Mode shapes at the dofs whose displacement was asked for, one entry per mode.
    pub dof_rows: RefCell<BTreeMap<usize, Rc<[f64]>>>,
}

impl Shown {
    /// Creates the state of the start, under given bounds.
    pub fn new(limits: Bounds) -> Shown {
        Shown { between: OnceCell::new(), limits, shape: OnceCell::new(), dof_rows: RefCell::default() }
    }

    /// Forgets the state of the last instant.
    pub fn forget(&mut self) {
        self.between.take();
        self.shape.take();
    }
}
