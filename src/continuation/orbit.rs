//! Periodic motion and what is measured of it.

use crate::assembly::Probe;
use crate::error::{Error, Result};
use crate::scheme::{Passage, Passing, ReturnMap};
use faer::Mat;

/// Modulus of a multiplier up to which a driven motion counts as stable. The multipliers have the
/// rounding errors of a product over the steps of a period.
const STABLE: f64 = 1.0 + 1e-7;

/// The same for free vibrations, whose multipliers lie on the circle in pairs: a pair has the root
/// of the error.
const STABLE_FREE: f64 = 1.0 + 1e-4;

/// Multiplier of Floquet: its real and its imaginary part.
pub type Multiplier = [f64; 2];

/// Periodic motion, with the measures of one period.
#[derive(Debug, Clone)]
pub struct Orbit {
    /// Period of the motion, in s.
    pub period: f64,
    /// Energy at the start, in J.
    pub energy: f64,
    /// Smallest and largest value of each probe, in m.
    pub probes: Vec<[f64; 2]>,
    /// Largest sum of the magnitudes of all reactions, in N.
    pub peak_force: f64,
    /// Number of contacts of the plate with anything.
    pub contacts: usize,
    /// Smallest distance from an obstacle that the nodes would have without reactions, in m;
    /// negative where they touch, infinite without obstacles.
    pub gap: f64,
    /// Multipliers, the largest first; a free motion has two more, at 1, for shifts in time and in
    /// energy.
    pub multipliers: Vec<Multiplier>,
    /// Number of multipliers outside the unit circle, by which small disturbances grow.
    pub unstable: usize,
}

/// Returns the modulus of a multiplier.
pub fn modulus([re, im]: Multiplier) -> f64 {
    re.hypot(im)
}

impl Orbit {
    /// Returns the product of some function over the real multipliers, which changes its sign where
    /// one of them passes a zero of the function.
    pub fn product(&self, value: impl Fn(f64) -> f64) -> f64 {
        let real = self.multipliers.iter().filter(|multiplier| multiplier[1] == 0.0);
        real.map(|multiplier| value(multiplier[0])).product()
    }

    /// Sets the multipliers to the eigenvalues of a derivative. Those of a free motion include two
    /// of a shift in time and in energy, the nearest to 1, which are left out.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where they cannot be found.
    pub fn set_multipliers(&mut self, derivative: &Mat<f64>, is_free: bool) -> Result<()> {
        let values = derivative.eigenvalues();
        let values = values.map_err(|_| Error::Singular("no multipliers of a periodic motion".into()))?;
        self.multipliers = values.iter().map(|value| [value.re, value.im]).collect();
        if is_free {
            let distance = |multiplier: &Multiplier| modulus([multiplier[0] - 1.0, multiplier[1]]);
            self.multipliers.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
            self.multipliers.drain(..self.multipliers.len().min(2));
        }
        self.multipliers.sort_by(|a, b| modulus(*b).total_cmp(&modulus(*a)));
        let limit = if is_free { STABLE_FREE } else { STABLE };
        self.unstable = self.multipliers.iter().filter(|multiplier| modulus(**multiplier) > limit).count();
        Ok(())
    }
}

/// Measures of a passage through the return map on its way.
pub struct Recorder<'p> {
    probes: &'p [(Probe, Vec<f64>)],
    energy: f64,
    ranges: Vec<[f64; 2]>,
    forces: Vec<f64>,
    gaps: Vec<f64>,
}

impl<'p> Recorder<'p> {
    /// Creates a recorder of some probes.
    pub fn new(probes: &'p [(Probe, Vec<f64>)]) -> Recorder<'p> {
        Recorder { probes, energy: 0.0, ranges: Vec::new(), forces: Vec::new(), gaps: Vec::new() }
    }

    /// Goes through the return map, with its derivative, and measures the period (s).
    ///
    /// # Errors
    /// Returns the errors of the map.
    pub fn pass(mut self, map: &mut ReturnMap, start: &[f64], period: f64) -> Result<(Passage, Orbit)> {
        let passage = map.pass(start, true, &mut |passing| self.note(passing))?;
        // The end of the period is its start.
        let steps = self.forces.len() - 1;
        self.forces[0] = self.forces[0].max(self.forces[steps]);
        let [forces, gaps] = [&self.forces[..steps], &self.gaps[..steps]];
        let begins = |step: usize| forces[step] > 0.0 && forces[(step + steps - 1) % steps] == 0.0;
        let begun = (0..steps).filter(|step| begins(*step)).count();
        let peak_force = forces.iter().copied().fold(0.0, f64::max);
        let orbit = Orbit {
            period,
            energy: self.energy,
            peak_force,
            contacts: if begun == 0 && peak_force > 0.0 { 1 } else { begun },
            gap: least(gaps),
            probes: self.ranges,
            multipliers: Vec::new(),
            unstable: 0,
        };
        Ok((passage, orbit))
    }

    fn note(&mut self, passing: &Passing) {
        if passing.step == 0 {
            self.energy = passing.energy();
            self.ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; self.probes.len()];
            (self.forces, self.gaps) = (Vec::new(), Vec::new());
        }
        for (probe, ends) in self.probes.iter().zip(&mut self.ranges) {
            let value = passing.deflection(probe);
            *ends = [ends[0].min(value), ends[1].max(value)];
        }
        self.forces.push(passing.force);
        self.gaps.push(passing.gap);
    }
}

/// Returns the smallest of values that repeat, by the parabola through the least of them and its
/// neighbours.
fn least(values: &[f64]) -> f64 {
    let Some(place) = (0..values.len()).min_by(|a, b| values[*a].total_cmp(&values[*b])) else {
        return f64::INFINITY;
    };
    let beside = |shift: usize| values[(place + values.len() + shift - 1) % values.len()];
    let [before, least, after] = [beside(0), beside(1), beside(2)];
    let (slope, bend) = (0.5 * (after - before), before - 2.0 * least + after);
    if bend > 0.0 && bend.is_finite() { least - 0.5 * slope * slope / bend } else { least }
}
