//! Sums of the contributions of all ranks at shared dofs.

use crate::error::Result;
use crate::petsc::{Plex, Vector};
use std::cell::RefCell;
use std::rc::Rc;

/// Adder of the contributions of all ranks over their local dofs; see
/// [`Distributed::adder`](super::Distributed::adder).
pub struct Adder {
    plex: Rc<Plex>,
    /// Number of dofs that this rank owns.
    own: usize,
    /// Global and local vector.
    vectors: RefCell<(Vector, Vector)>,
}

impl Adder {
    /// Creates the adder for a rank that owns `own` dofs. Collective.
    pub(super) fn new(plex: &Rc<Plex>, own: usize) -> Result<Adder> {
        let vectors = RefCell::new((plex.global_vector()?, plex.local_vector()?));
        Ok(Adder { plex: plex.clone(), own, vectors })
    }

    /// Returns the sums at the dofs that this rank owns, as
    /// [`Distributed::add_up`](super::Distributed::add_up) does.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn add_up(&self, values: &[f64]) -> Result<Vec<f64>> {
        let (all, local) = &mut *self.vectors.borrow_mut();
        let mut sums = vec![0.0; self.own];
        local.set_local(values)?;
        all.fill(0.0)?;
        self.plex.add_to_global(local, all)?;
        all.copy_to(&mut sums)?;
        Ok(sums)
    }
}
