//! Saves and restores the state of a run between two steps, on any number of processes.

use super::Model;
use crate::archive::{self, Archive, Entry};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::System;
use serde::{Deserialize, Serialize};

/// Whole state of a run between two steps: the scheme and the main loop.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunState {
    /// Index of the last step made.
    pub step: u64,
    /// Time of that step, in s.
    pub time: f64,
    /// Number of processes. A resumed run with the same number is bitwise identical to an
    /// uninterrupted one.
    pub processes: usize,
    entries: Vec<Entry>,
}

impl RunState {
    /// Collects what `state` archives after a step, on the first process only. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub(super) fn take<E: Engine>(
        model: &Model<E>,
        step: u64,
        time: f64,
        state: impl FnOnce(&mut Archive) -> Result<()>,
    ) -> Result<Option<RunState>> {
        let System { engine, bounds, .. } = &model.system;
        let mut archive = Archive::Saves(Vec::new());
        state(&mut archive)?;
        let share = (archive.into_entries(), model.places.numbering(engine, &bounds.dofs));
        let parts: Vec<_> = engine
            .comm()
            .gather(&archive::to_bytes(&share)?)
            .iter()
            .map(|part| archive::from_bytes(part))
            .collect::<Result<_>>()?;
        let processes = parts.len();
        let first = processes > 0;
        first.then(|| Ok(RunState { step, time, processes, entries: archive::join(parts)? })).transpose()
    }

    /// Returns the archive that restores this process's part of the state. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] for the state of another model.
    pub(super) fn part<E: Engine>(self, model: &Model<E>) -> Result<Archive> {
        let System { engine, bounds, .. } = &model.system;
        let numbering = model.places.numbering(engine, &bounds.dofs);
        archive::part(self.entries, &numbering, engine.comm().rank(), self.processes == engine.comm().size())
    }
}
