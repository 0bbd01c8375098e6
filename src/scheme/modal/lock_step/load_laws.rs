//! Laws in time of the loads of systems in lock step.

use super::lane_levels::each;
use crate::error::Result;
use crate::linalg::{Lanes, Native};
use crate::scheme::System;

/// Laws in time of the loads of all lanes. Laws that lanes have in common are evaluated once.
pub(super) struct LoadLaws<'s> {
    pub systems: Vec<&'s System<Native>>,
    /// First lane with the same law as a lane, one entry per term of each system.
    first: Vec<Vec<usize>>,
}

impl<'s> LoadLaws<'s> {
    /// Finds the laws that lanes have in common.
    pub fn new(systems: &[&'s System<Native>]) -> LoadLaws<'s> {
        let law = |lane: usize, term: usize| systems[lane].drive.terms.get(term)?.law.as_ref();
        let first = |lane: usize, term: usize| {
            let own = law(lane, term);
            (0..lane).find(|&other| own.is_some() && law(other, term) == own).unwrap_or(lane)
        };
        let of_lane =
            |lane: usize| (0..systems[lane].drive.terms.len()).map(|term| first(lane, term)).collect();
        LoadLaws { systems: systems.to_vec(), first: (0..systems.len()).map(of_lane).collect() }
    }

    /// Returns the number of loads, with a constant one.
    pub fn count(&self) -> usize {
        1 + self.first.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Sets the factors of the loads at an instant (s): 1 for the constant one, which is the first.
    ///
    /// # Errors
    /// Returns the errors of the laws.
    pub fn set(&self, time: f64, factors: &mut [Lanes]) -> Result<()> {
        factors[0] = each(|_| 1.0);
        for (lane, (system, first)) in self.systems.iter().zip(&self.first).enumerate() {
            for ((factors, term), &first) in factors[1..].iter_mut().zip(&system.drive.terms).zip(first) {
                factors.0[lane] = if first < lane { factors.0[first] } else { (term.factor)(time)? };
            }
        }
        Ok(())
    }
}

/// Returns a load of a system, the constant one first; `None` where it has none of this number.
pub(super) fn load_of(system: &System<Native>, load: usize) -> Option<&[f64]> {
    match load.checked_sub(1) {
        None => system.load.as_deref(),
        Some(term) => system.drive.terms.get(term).map(|term| &*term.load),
    }
}
