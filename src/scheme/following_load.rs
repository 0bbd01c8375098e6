//! Loads that depend on the deflection, in time.
//!
//! A scheme takes such a load F(t, U) at a known displacement: its step matrix stays the same. Its
//! work enters the balance of energy like the one of a load in time. What the load stores is no
//! part of the elastic energy, and the promise of a scheme about the energy holds beside this work.
//! The conserving scheme counts the work by the potential of the load.

use super::System;
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::add;

/// Load that depends on the deflection.
pub trait FollowingLoad {
    /// Sets `force` to the load at an instant (s) and a displacement (m), in N, both with one entry
    /// per dof. Collective.
    ///
    /// # Errors
    /// Returns the errors of its formula.
    fn force(&self, t: f64, u: &[f64], force: &mut [f64]) -> Result<()>;

    /// Returns the work that the load does at an instant (s) from the flat plate to a displacement
    /// (m), in J. Collective.
    ///
    /// # Errors
    /// Returns the errors of its formula.
    fn work(&self, t: f64, u: &[f64]) -> Result<f64>;

    /// Returns an error where a pole of the load, such as an electrode, lies between the flat plate
    /// and a displacement (m) at an instant (s): no motion leads past it. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::PulledIn`].
    fn refuse_poles(&self, t: f64, u: &[f64]) -> Result<()>;

    /// Returns whether the load at a displacement changes in time.
    fn changes(&self) -> bool;

    /// Returns the multiple of a change x of the displacement (m) over which the stiffness of the
    /// load keeps its size where it pulls the plate on: a pole, such as an electrode, lies
    /// farther away. Collective.
    ///
    /// # Errors
    /// Returns the errors of its formula.
    fn reach(&self, t: f64, u: &[f64], x: &[f64]) -> Result<f64>;
}

/// Load that depends on the deflection, as a scheme takes it, with the work done.
pub(super) struct FollowedLoad<'s, E: Engine> {
    engine: &'s E,
    load: &'s dyn FollowingLoad,
    /// Load of the step, in N, one entry per dof.
    force: Vec<f64>,
    /// Work done, in J.
    pub work: f64,
    /// Work of the last step, in J.
    pub increment: f64,
}

impl<'s, E: Engine> FollowedLoad<'s, E> {
    /// Takes the load at the start and a displacement (m, one entry per dof); `None` where no load
    /// depends on the deflection. Collective.
    ///
    /// # Errors
    /// Returns the errors of the load.
    pub fn new(system: &'s System<E>, u: &[f64]) -> Result<Option<FollowedLoad<'s, E>>> {
        let Some(load) = &system.drive.following else { return Ok(None) };
        let (engine, load) = (&system.engine, load.as_ref());
        let mut followed =
            FollowedLoad { engine, load, force: vec![0.0; u.len()], work: 0.0, increment: 0.0 };
        followed.take(0.0, u)?;
        Ok(Some(followed))
    }

    /// Takes the load at an instant (s) and a displacement (m). Collective.
    ///
    /// # Errors
    /// Returns the errors of the load.
    pub fn take(&mut self, t: f64, u: &[f64]) -> Result<()> {
        self.load.force(t, u, &mut self.force)
    }

    /// Adds the load to b, in N.
    pub fn add_force(&self, b: &mut [f64]) {
        add(&self.force, b);
    }

    /// Returns the work of the load over a displacement (m), in J. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn along(&self, displacement: &[f64]) -> Result<f64> {
        self.engine.dot(&self.force, displacement)
    }

    /// Saves or restores the state.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.vector(VectorKind::Dofs, &mut self.force)?;
        archive.value(&mut self.work)?;
        archive.value(&mut self.increment)
    }
}
