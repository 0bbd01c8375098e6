//! Cache of the modes of active sets, with the least recently used ones evicted first.

use super::modes::Modes;
use super::reduction::ReducedModel;
use super::spectrum::{Contacts, Held, Lineage, Spectrum, contacts};
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::System;
use crate::vi::BoundStatus;
use std::collections::HashMap;
use std::rc::Rc;

/// Cache of modes.
#[derive(Debug)]
pub(super) struct Cache {
    sets: HashMap<Contacts, Known>,
    /// Largest memory, in bytes.
    limit: usize,
    /// Whether the modes of one set may follow from those of another.
    takes_changes: bool,
    clock: u64,
    /// Number of sets whose modes were computed so far.
    pub computed: u64,
    /// Peak memory, in bytes.
    pub peak: usize,
}

/// Modes of one set.
#[derive(Debug)]
struct Known {
    lineage: Lineage,
    /// Modes, computed again on demand after they were restored from an archive. They may lack
    /// candidates that came into reach since.
    modes: Option<Rc<Modes>>,
    /// Time of the last use.
    used: u64,
}

impl Cache {
    /// Builds an empty cache of at most `limit` bytes (and at least one set).
    pub fn new(limit: usize, takes_changes: bool) -> Cache {
        Cache { sets: HashMap::new(), limit, takes_changes, clock: 0, computed: 0, peak: 0 }
    }

    /// Returns the modes of a set, from the cache or computed. Those of the set before are `from`.
    ///
    /// # Errors
    /// Returns the errors of [`Held::new`] and [`Spectrum::near`].
    pub fn get<E: Engine>(
        &mut self,
        system: &System<E>,
        reduction: &ReducedModel,
        sides: &[BoundStatus],
        from: Option<&Modes>,
    ) -> Result<Rc<Modes>> {
        self.clock += 1;
        let key = contacts(reduction, sides);
        if let Some(set) = self.sets.get_mut(&key) {
            set.used = self.clock;
            return set.get(system, reduction, sides);
        }
        let held = Held::new(reduction, sides)?;
        let spectrum = match self.takes_changes {
            true => Spectrum::near(system, reduction, &held, from.map(|from| &*from.spectrum))?,
            false => Spectrum::new(system, reduction, &held)?,
        };
        let lineage = spectrum.lineage.clone();
        let modes = Rc::new(Modes::new(system, reduction, held, spectrum.into(), None)?);
        self.computed += 1;
        let bytes = modes.bytes();
        while !self.sets.is_empty() && (self.sets.len() + 1) * bytes > self.limit {
            let oldest = self.sets.iter().min_by_key(|(_, set)| set.used).map(|(key, _)| key.clone());
            oldest.and_then(|key| self.sets.remove(&key));
        }
        self.sets.insert(key, Known { lineage, modes: Some(modes.clone()), used: self.clock });
        self.peak = self.peak.max(self.sets.len() * bytes);
        Ok(modes)
    }

    /// Returns the modes of a set that an archive tells, and keeps them.
    ///
    /// # Errors
    /// Returns the errors of [`Held::new`] and [`Spectrum::restored`].
    pub fn restore<E: Engine>(
        &mut self,
        system: &System<E>,
        reduction: &ReducedModel,
        sides: &[BoundStatus],
        lineage: Lineage,
    ) -> Result<Rc<Modes>> {
        let mut set = Known { lineage, modes: None, used: self.clock };
        let modes = set.get(system, reduction, sides)?;
        self.sets.insert(contacts(reduction, sides), set);
        Ok(modes)
    }

    /// Saves or restores the list of known sets, from which their modes follow.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        let entry = |(key, set): (&Contacts, &Known)| (set.used, key.clone(), set.lineage.clone());
        let mut sets: Vec<(u64, Contacts, Lineage)> = self.sets.iter().map(entry).collect();
        sets.sort_unstable_by_key(|(used, ..)| *used);
        archive.value(&mut sets)?;
        archive.value(&mut self.clock)?;
        archive.value(&mut self.computed)?;
        archive.value(&mut self.peak)?;
        if !archive.saves() {
            let mut before = std::mem::take(&mut self.sets);
            let set = |(used, key, lineage)| {
                let set = before.remove(&key).filter(|set: &Known| set.lineage == lineage);
                (key, Known { lineage, modes: set.and_then(|set| set.modes), used })
            };
            self.sets = sets.into_iter().map(set).collect();
        }
        Ok(())
    }
}

impl Known {
    /// Returns the modes with all present candidates.
    fn get<E: Engine>(
        &mut self,
        system: &System<E>,
        reduction: &ReducedModel,
        sides: &[BoundStatus],
    ) -> Result<Rc<Modes>> {
        let modes = match &self.modes {
            Some(modes) if modes.sides.len() == sides.len() => modes.clone(),
            before => {
                let spectrum = match before {
                    Some(modes) => modes.spectrum.clone(),
                    None => Rc::new(Spectrum::restored(system, reduction, &self.lineage)?),
                };
                let coupling = before.as_ref().and_then(|modes| modes.coupling.as_ref());
                let decoupling = coupling.map(|coupling| coupling.decoupling.clone());
                Rc::new(Modes::new(system, reduction, Held::new(reduction, sides)?, spectrum, decoupling)?)
            }
        };
        Ok(self.modes.insert(modes).clone())
    }
}
