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
/// the time step. Runs that are made one after the other have most of them in common.
#[derive(Default)]
pub(super) struct KnownFactors {
    of_laws: RefCell<HashMap<(String, u64), KeptFactors>>,
}

/// Factors of one law, one per instant from the start on.
type KeptFactors = Rc<RefCell<Vec<f64>>>;

impl KnownFactors {
    fn of(&self, law: &str, dt: f64) -> KeptFactors {
        self.of_laws.borrow_mut().entry((law.to_owned(), dt.to_bits())).or_default().clone()
    }
}

/// Laws in time of the loads of all lanes. Laws that lanes have in common are evaluated once.
pub(super) struct LoadLaws<'s> {
    /// Time step, in s.
    dt: f64,
    /// Terms of the load of each system.
    of_lanes: Vec<Vec<LaneLaw<'s>>>,
    /// Whether all systems have the laws of the first one.
    are_alike: bool,
}

/// Law of a term of the load of one lane.
struct LaneLaw<'s> {
    term: &'s LoadTerm,
    /// First lane with the same law, where it is not this one.
    first: Option<usize>,
    kept: Option<KeptFactors>,
}

impl LaneLaw<'_> {
    /// Returns the factor after a number of steps of `dt` seconds.
    fn factor(&self, step: usize, dt: f64) -> Result<f64> {
        let evaluated = || (self.term.factor)(step as f64 * dt);
        let Some(kept) = &self.kept else { return evaluated() };
        let mut kept = kept.borrow_mut();
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

impl<'s> LoadLaws<'s> {
    /// Finds the laws that lanes have in common with each other, and with runs before. All runs
    /// have steps of `dt` seconds.
    pub fn new(systems: &[&'s System<Native>], dt: f64, known: &KnownFactors) -> LoadLaws<'s> {
        let law = |lane: usize, term: usize| systems[lane].drive.terms.get(term)?.law.as_ref();
        let of_term = |lane: usize, (number, term): (usize, &'s LoadTerm)| {
            let own = law(lane, number);
            LaneLaw {
                term,
                first: (0..lane).find(|&other| own.is_some() && law(other, number) == own),
                kept: own.map(|law| known.of(law, dt)),
            }
        };
        let of_lane = |(lane, system): (usize, &&'s System<Native>)| {
            system.drive.terms.iter().enumerate().map(|of| of_term(lane, of)).collect()
        };
        let of_lanes: Vec<Vec<LaneLaw>> = systems.iter().enumerate().map(of_lane).collect();
        let is_like_first = |laws: &Vec<LaneLaw>| {
            laws.len() == of_lanes[0].len() && laws.iter().all(|law| law.first == Some(0))
        };
        LoadLaws { dt, are_alike: of_lanes.iter().skip(1).all(is_like_first), of_lanes }
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
        if self.are_alike {
            let laws = self.of_lanes.first().into_iter().flatten();
            for (factors, law) in factors[1..].iter_mut().zip(laws) {
                let factor = law.factor(step as usize, self.dt)?;
                *factors = each(|_| factor);
            }
            return Ok(());
        }
        for (lane, laws) in self.of_lanes.iter().enumerate() {
            for (factors, law) in factors[1..].iter_mut().zip(laws) {
                factors.0[lane] = match law.first {
                    Some(first) => factors.0[first],
                    None => law.factor(step as usize, self.dt)?,
                };
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
