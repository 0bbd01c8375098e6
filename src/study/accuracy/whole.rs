//! Distance of runs from the motion on the reference mesh, and the floor of these distances.
//!
//! Deflections are compared at the probes. The energy that an impact leaves in vibration shows in
//! the kinetic energy between the end of the first impact and the start of the second, when every
//! run moves freely: the *energy split* is the root mean square of its difference there, relative
//! to the energy at the start.

use super::trajectory::{Deviation, Parts, Samples, Trajectory, differences};
use crate::scene::Mass;
use serde::{Deserialize, Serialize};

/// Motion on the reference mesh.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceMotion {
    /// Instants in s.
    pub times: Vec<f64>,
    /// Deflections and kinetic energies.
    pub samples: Samples,
    /// Starts and ends of the impacts, in s.
    pub impacts: Vec<[f64; 2]>,
    /// Energy at the start in J, the scale of the energy split.
    pub energy: f64,
}

/// Distance between two motions, of which one is usually that on the reference mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Whole {
    /// Deviation of the deflections at the probes, in m.
    pub probes: Parts<Deviation>,
    /// Deviation of the deflections at the probes between the end of the first impact and the start
    /// of the second, in m; `None` without an impact.
    pub after_impact: Option<Deviation>,
    /// Energy split: deviation of the kinetic energy in the same interval, relative to the energy
    /// at the start; `None` without an impact or without such energy.
    pub kinetic: Option<Deviation>,
}

impl ReferenceMotion {
    /// Creates the motion of a trajectory with its impacts.
    pub fn new(trajectory: &Trajectory, impacts: &[[f64; 2]]) -> ReferenceMotion {
        ReferenceMotion {
            times: trajectory.times.clone(),
            samples: trajectory.samples.clone(),
            impacts: impacts.to_vec(),
            energy: trajectory.energies.first().map_or(0.0, |energy| energy.abs()),
        }
    }

    /// Returns the interval between the end of the first impact and the start of the second, or the
    /// end of the run, in s; `None` without an impact.
    pub fn flight(&self) -> Option<[f64; 2]> {
        let [_, end] = *self.impacts.first()?;
        Some([end, self.impacts.get(1).map_or(f64::INFINITY, |[start, _]| *start)])
    }

    /// Returns the distance of a run from this motion.
    pub fn distance(&self, run: &Samples) -> Whole {
        self.between(run, &self.samples)
    }

    /// Returns the distance between two runs, in the intervals of this motion.
    pub(super) fn between(&self, a: &Samples, b: &Samples) -> Whole {
        let probes = differences(&a.probes, &b.probes);
        let within = |values: &[Vec<f64>], interval| Deviation::within(&self.times, values, interval);
        let starts: Vec<f64> = self.impacts.iter().map(|[start, _]| *start).collect();
        let flight = self.flight();
        let kinetic = flight.filter(|_| self.energy > 0.0).map(|flight| {
            let pairs = a.kinetic.iter().zip(&b.kinetic);
            within(&pairs.map(|(a, b)| vec![(a - b) / self.energy]).collect::<Vec<_>>(), flight)
        });
        Whole {
            probes: Parts::new(&self.times, &probes, &starts),
            after_impact: flight.map(|flight| within(&probes, flight)),
            kinetic,
        }
    }
}

/// Best run with one mass on the finest mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BestRun {
    /// Name of the run.
    pub name: String,
    /// Mass matrix.
    pub mass: Mass,
    /// Whole error by which it is the best, relative.
    pub error: f64,
    /// Deflections and kinetic energies.
    pub samples: Samples,
}

/// Keeps a run if it is the best one of its mass.
pub(super) fn keep_best(best: &mut Vec<BestRun>, run: BestRun) {
    match best.iter_mut().find(|other| other.mass == run.mass) {
        Some(other) if run.error < other.error => *other = run,
        Some(_) => {}
        None => best.push(run),
    }
}

/// Floor of a study: the largest distance between any two of the reference and the best runs of the
/// masses on the finest mesh.
///
/// These are different methods with the same limit. Smaller differences between runs say nothing
/// about their errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Floor {
    /// Root mean square at the probes up to the horizon, relative.
    pub deflection: f64,
    /// Root mean square at the probes after the first impact, relative.
    pub after_impact: Option<f64>,
    /// Energy split.
    pub kinetic: Option<f64>,
    /// Names of the runs.
    pub runs: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::{ReferenceMotion, Samples};

    /// Motion with one probe, whose only impact lasts from 1 s to 2 s; the next starts at 4 s.
    fn motion() -> ReferenceMotion {
        let times: Vec<f64> = (0..6).map(f64::from).collect();
        let samples = Samples { probes: vec![vec![0.0]; 6], kinetic: vec![0.0; 6] };
        ReferenceMotion { times, samples, impacts: vec![[1.0, 2.0], [4.0, 4.5]], energy: 10.0 }
    }

    fn samples(probe: [f64; 6], kinetic: [f64; 6]) -> Samples {
        Samples { probes: probe.map(|w| vec![w]).to_vec(), kinetic: kinetic.to_vec() }
    }

    #[test]
    fn the_energy_split_counts_between_the_impacts() {
        let run = samples([9.0, 3.0, 1.0, -1.0, 1.0, 50.0], [7.0, 7.0, 3.0, 4.0, 5.0, 70.0]);
        let whole = motion().distance(&run);
        assert_eq!(motion().flight(), Some([2.0, 4.0]));
        let after = whole.after_impact.unwrap();
        assert_eq!((after.rms, after.max), (1.0, 1.0));
        let kinetic = whole.kinetic.unwrap();
        assert!((kinetic.rms - (50.0_f64 / 3.0).sqrt() / 10.0).abs() < 1e-15 && kinetic.max == 0.5);
        assert_eq!(whole.probes.first_impact.unwrap().max, 9.0);
        assert_eq!(whole.probes.end.max, 50.0);
    }

    #[test]
    fn without_impact_there_is_no_energy_split() {
        let of_flight = ReferenceMotion { impacts: vec![], ..motion() };
        let whole = of_flight.distance(&of_flight.samples);
        assert!(whole.after_impact.is_none() && whole.kinetic.is_none());
        // At rest without energy nothing scales the kinetic energy.
        let at_rest = ReferenceMotion { energy: 0.0, ..motion() };
        assert!(at_rest.distance(&at_rest.samples).kinetic.is_none());
    }
}
