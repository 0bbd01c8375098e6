//! Largest Lyapunov exponent, from two neighbouring motions (Benettin, Galgani, Giorgilli and
//! Strelcyn, Meccanica 15 (1980) 9-20).
//!
//! Two motions start a small distance d apart. After each period their distance is `$d_k$`, and the
//! second one is pulled back along the line between them to the distance d. The exponent is the
//! mean rate
//!
//! ```math
//! \lambda = \frac{1}{n T} \sum_{k=1}^{n} \ln \frac{d_k}{d} .
//! ```

use crate::archive::{Archive, Entry};
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::{Scheme, System};

/// Distance of the two motions, relative to the motion itself.
const APART: f64 = 1e-7;

/// Share of the periods in which the distance turns into its fastest direction, and which do not
/// count.
const TURNING: f64 = 0.1;

/// Two neighbouring motions.
pub trait Neighbours {
    /// Returns the distance between the motions.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    fn distance(&mut self) -> Result<f64>;

    /// Multiplies the difference of the motions by a ratio, by a move of the second one.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    fn rescale(&mut self, ratio: f64) -> Result<()>;
}

/// Mean rate at which two motions part, from period to period.
#[derive(Debug, Clone)]
pub struct Exponent {
    /// Distance to which the motions are pulled back.
    distance: f64,
    /// Periods that do not count, of all periods so far.
    turning: u64,
    periods: u64,
    sum: f64,
}

impl Exponent {
    /// Starts with two motions that are some distance apart, for a number of periods.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    pub fn new(motions: &mut impl Neighbours, periods: u64) -> Result<Exponent> {
        let turning = (TURNING * periods as f64) as u64;
        Ok(Exponent { distance: motions.distance()?, turning, periods: 0, sum: 0.0 })
    }

    /// Records the distance at the end of a period, and pulls the motions back together.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    pub fn note(&mut self, motions: &mut impl Neighbours) -> Result<()> {
        let growth = motions.distance()? / self.distance;
        self.periods += 1;
        if self.periods > self.turning {
            self.sum += growth.ln();
        }
        motions.rescale(1.0 / growth)
    }

    /// Returns the exponent per period; `None` where the motions met or were never apart.
    pub fn per_period(&self) -> Option<f64> {
        let counted = self.periods.saturating_sub(self.turning);
        Some(self.sum / counted as f64).filter(|exponent| exponent.is_finite())
    }
}

/// Two runs of a scheme, the second one beside the first.
pub(super) struct TwoRuns<'r, 's, E: Engine> {
    pub system: &'s System<E>,
    pub first: &'r mut dyn Scheme,
    pub second: &'r mut dyn Scheme,
}

impl<E: Engine> TwoRuns<'_, '_, E> {
    /// Puts the second run a small distance beside the first.
    pub fn part(&mut self) -> Result<()> {
        let first = entries(self.first)?;
        restore(self.second, &first, &first, 1.0 + APART)
    }
}

impl<E: Engine> Neighbours for TwoRuns<'_, '_, E> {
    /// Returns the root of the energy of the difference.
    fn distance(&mut self) -> Result<f64> {
        let less = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>();
        let u = less(self.second.displacement(), self.first.displacement());
        let rate = less(&self.second.velocity()?, &self.first.velocity()?);
        let [elastic, kinetic] = self.system.energies(&u, &rate)?;
        Ok((elastic + kinetic).max(0.0).sqrt())
    }

    fn rescale(&mut self, ratio: f64) -> Result<()> {
        let (first, second) = (entries(self.first)?, entries(self.second)?);
        restore(self.second, &first, &second, ratio)
    }
}

/// Returns the state of a scheme.
fn entries(scheme: &mut dyn Scheme) -> Result<Vec<Entry>> {
    let mut archive = Archive::Saves(Vec::new());
    scheme.archive(&mut archive)?;
    Ok(archive.into_entries())
}

/// Restores a scheme to the state `from + ratio (to - from)`, or to `ratio from` where both states
/// are the same. Only vectors are combined; all else is that of `from`.
fn restore(scheme: &mut dyn Scheme, from: &[Entry], to: &[Entry], ratio: f64) -> Result<()> {
    let is_scaled = std::ptr::eq(from, to);
    let one = |from: f64, to: f64| match (is_scaled, from == to) {
        (true, _) => ratio * from,
        // Absent obstacles have infinite bounds.
        (false, true) => from,
        (false, false) => from + ratio * (to - from),
    };
    let combine = |from: &[f64], to: &[f64]| from.iter().zip(to).map(|(a, b)| one(*a, *b)).collect();
    let entry = |(from, to): (&Entry, &Entry)| match (from, to) {
        (Entry::Vector(over, from), Entry::Vector(_, to)) if from.len() == to.len() => {
            Entry::Vector(*over, combine(from, to))
        }
        _ => from.clone(),
    };
    let entries: Vec<Entry> = from.iter().zip(to).map(entry).collect();
    let mut archive = Archive::Restores { entries: entries.into_iter(), same_processes: true };
    scheme.archive(&mut archive)
}
