//! Laws in time of the loads of systems in lock step.

use super::lane_levels::each;
use crate::error::Result;
use crate::kernels::Lanes;
use crate::linalg::Native;
use crate::scheme::{LoadTerm, System};
use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

/// Largest number of instants at which the factors of a law are kept.
const MOST_KEPT: usize = 1 << 20;

/// Factors of laws at the instants of the steps so far, by the texts of the laws and the bits of
/// the time step. Lanes, and runs that are made one after the other, have most of them in common.
#[derive(Default)]
pub(super) struct KnownFactors {
    of_laws: RefCell<HashMap<(String, u64), KeptFactors>>,
}

/// Factors of one law, one per instant from the start on.
type KeptFactors = Rc<RefCell<Vec<f64>>>;

/// Laws in time of the loads of all lanes.
pub(super) struct LoadLaws<'s> {
    /// Time step, in s.
    dt: f64,
    /// Terms of the load of each system, with the factors of laws that have a text.
    of_lanes: Vec<Vec<(&'s LoadTerm, Option<KeptFactors>)>>,
}

impl<'s> LoadLaws<'s> {
    /// Finds the laws that lanes have in common with each other, and with runs before. All runs
    /// have steps of `dt` seconds.
    pub fn new(systems: &[&'s System<Native>], dt: f64, factors: &KnownFactors) -> LoadLaws<'s> {
        let mut of_laws = factors.of_laws.borrow_mut();
        let mut kept = |law: &String| of_laws.entry((law.clone(), dt.to_bits())).or_default().clone();
        let mut law = |term: &'s LoadTerm| (term, term.law.as_ref().map(&mut kept));
        let of_lanes = systems.iter().map(|system| system.drive.terms.iter().map(&mut law).collect());
        LoadLaws { dt, of_lanes: of_lanes.collect() }
    }

    /// Returns the number of loads, with a constant one.
    pub fn count(&self) -> usize {
        1 + self.of_lanes.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Sets the factors of the loads after a number of steps: 1 for the constant one, which is the
    /// first.
    ///
    /// # Errors
    /// Returns the errors of the laws.
    pub fn set(&self, step: u64, factors: &mut [Lanes]) -> Result<()> {
        factors[0] = each(|_| 1.0);
        for (lane, laws) in self.of_lanes.iter().enumerate() {
            for (factors, law) in factors[1..].iter_mut().zip(laws) {
                factors.0[lane] = self.factor(law, step as usize)?;
            }
        }
        Ok(())
    }

    /// Returns the factor of a law after a number of steps.
    fn factor(&self, (term, kept): &(&LoadTerm, Option<KeptFactors>), step: usize) -> Result<f64> {
        let evaluated = || (term.factor)(step as f64 * self.dt);
        let Some(mut kept) = kept.as_ref().map(|kept| kept.borrow_mut()) else { return evaluated() };
        if let Some(factor) = kept.get(step) {
            return Ok(*factor);
        }
        let factor = evaluated()?;
        if kept.len() == step && step < MOST_KEPT {
            kept.push(factor);
        }
        Ok(factor)
    }
}

/// Returns a load of a system, the constant one first; `None` where it has none of this number.
pub(super) fn load_of(system: &System<Native>, load: usize) -> Option<&[f64]> {
    match load.checked_sub(1) {
        None => system.load.as_deref(),
        Some(term) => system.drive.terms.get(term).map(|term| &*term.load),
    }
}
