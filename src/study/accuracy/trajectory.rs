//! Recorded runs, and the distance of one from another.

use super::norms::Norms;
use crate::error::Result;
use crate::linalg::vectors::difference;
use crate::scene::{Horizon, Scene};
use crate::scheme::Solution;
use crate::simulation::{Observer, Outcome, Row};
use serde::{Deserialize, Serialize};

/// Deflections and kinetic energies of a motion at the instants of comparison.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    /// Deflections at the probes in m, one row per instant.
    pub probes: Vec<Vec<f64>>,
    /// Kinetic energies in J.
    pub kinetic: Vec<f64>,
}

/// Record of a run at the instants of comparison.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Instants in s.
    pub times: Vec<f64>,
    /// Deflections and kinetic energies at these instants.
    pub samples: Samples,
    /// Displacements over the native engine's free dofs, one per instant; empty if they were not
    /// kept.
    pub fields: Vec<Vec<f64>>,
    /// Energies in J.
    pub energies: Vec<f64>,
    keep_fields: bool,
}

impl Observer for Trajectory {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.times.push(row.time);
        self.samples.probes.push(row.probes.to_vec());
        self.samples.kinetic.push(row.kinetic);
        self.energies.push(row.energy);
        Ok(())
    }

    fn state(&mut self, scheme: &dyn Solution) -> Result<()> {
        if self.keep_fields {
            self.fields.push(scheme.displacement().to_vec());
        }
        Ok(())
    }
}

impl Trajectory {
    /// Returns the record of a run of a scene, which `run` makes with an observer.
    ///
    /// A last row that lies between two instants of comparison is left out. Such a row is written
    /// where the run's end is no multiple of the interval.
    ///
    /// # Errors
    /// Returns the error that ends the run early.
    pub fn record(
        scene: &Scene,
        keep_fields: bool,
        run: impl FnOnce(&mut Trajectory) -> Result<(Outcome, Result<()>)>,
    ) -> Result<(Trajectory, Outcome)> {
        let mut trajectory = Trajectory { keep_fields, ..Trajectory::default() };
        let (outcome, ended) = run(&mut trajectory)?;
        ended?;
        if !scene.time.steps().is_multiple_of(scene.output.every) {
            trajectory.times.pop();
            trajectory.samples.probes.pop();
            trajectory.samples.kinetic.pop();
            trajectory.energies.pop();
            trajectory.fields.pop();
        }
        Ok((trajectory, outcome))
    }

    /// Returns the largest deflection at any probe, in m, which is the scale of relative errors.
    pub fn scale(&self) -> f64 {
        self.samples.probes.iter().flatten().fold(0.0, |scale, w| w.abs().max(scale))
    }

    /// Returns the relative change of the energy at the end, and its largest magnitude during the
    /// run.
    ///
    /// Without initial energy the result is `None`.
    pub fn energy_drift(&self) -> Option<[f64; 2]> {
        let start = *self.energies.first().filter(|energy| **energy != 0.0)?;
        let drift = |energy: &f64| energy / start - 1.0;
        let worst = self.energies.iter().map(drift).fold(0.0, |worst: f64, d| worst.max(d.abs()));
        Some([drift(self.energies.last()?), worst])
    }
}

/// Root mean square and maximum of an error.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviation {
    /// Root mean square over instants and probes.
    pub rms: f64,
    /// Largest magnitude.
    pub max: f64,
}

impl Deviation {
    /// Returns the deviation of the errors at the instants of an interval, one row per instant.
    pub(super) fn within(times: &[f64], errors: &[Vec<f64>], [from, to]: [f64; 2]) -> Deviation {
        let rows = times.iter().zip(errors).filter(|(time, _)| from <= **time && **time <= to);
        let (mut sum, mut number, mut max) = (0.0, 0_usize, 0.0_f64);
        for error in rows.flat_map(|(_, row)| row) {
            sum += error * error;
            number += 1;
            max = if error.is_nan() { f64::NAN } else { max.max(error.abs()) };
        }
        Deviation { rms: (sum / number.max(1) as f64).sqrt(), max }
    }
}

/// Values over three parts of a run; `None` where the reference has no such impact.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Parts<T> {
    /// Up to the first impact.
    pub first_impact: Option<T>,
    /// Up to the second impact.
    pub second_impact: Option<T>,
    /// Over the whole run.
    pub end: T,
}

impl Parts<Deviation> {
    /// Returns the deviations of errors, one row per instant, up to the instants at which impacts
    /// of the reference begin.
    pub(super) fn new(times: &[f64], errors: &[Vec<f64>], impacts: &[f64]) -> Parts<Deviation> {
        let up_to = |end: f64| Deviation::within(times, errors, [f64::NEG_INFINITY, end]);
        Parts {
            first_impact: impacts.first().map(|&end| up_to(end)),
            second_impact: impacts.get(1).map(|&end| up_to(end)),
            end: up_to(f64::INFINITY),
        }
    }

    /// Returns the deviations relative to a scale.
    pub(super) fn over(&self, scale: f64) -> Parts<Deviation> {
        let relative = |d: Deviation| Deviation { rms: d.rms / scale, max: d.max / scale };
        Parts {
            first_impact: self.first_impact.map(relative),
            second_impact: self.second_impact.map(relative),
            end: relative(self.end),
        }
    }
}

impl<T: Copy> Parts<T> {
    /// Returns the value that ranks runs: at the horizon, or later if the reference lacks its
    /// impact.
    pub fn at(&self, horizon: Horizon) -> T {
        let second = self.second_impact.unwrap_or(self.end);
        match horizon {
            Horizon::FirstImpact => self.first_impact.unwrap_or(second),
            Horizon::SecondImpact => second,
            Horizon::End => self.end,
        }
    }
}

/// Distance of a run from a reference.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// Deviation of the deflections at the probes, in m.
    pub probes: Parts<Deviation>,
    /// L2 norm of the difference of the deflections, in m2; `None` without fields.
    pub l2: Option<Parts<Deviation>>,
    /// Energy norm of the difference, the root of a(w, w), in J^(1/2); `None` without fields.
    pub energy: Option<Parts<Deviation>>,
    /// Instant (s), L2 and energy norm at the requested instants.
    pub at: Vec<[f64; 3]>,
}

impl Distance {
    /// Measures the distance of two runs with the same instants.
    ///
    /// `impacts` are the starts of the reference's impacts. `norms` are the norms of the difference
    /// of the fields, one per instant, if they are wanted. `instants` are those for
    /// [`Distance::at`].
    pub fn new(
        run: &Trajectory,
        reference: &Trajectory,
        impacts: &[f64],
        norms: Option<&[Norms]>,
        instants: &[f64],
    ) -> Distance {
        let count = run.times.len().min(reference.times.len());
        let times = &reference.times[..count];
        let parts = |values: &[Vec<f64>]| Parts::new(times, values, impacts);
        let probes = parts(&differences(&run.samples.probes, &reference.samples.probes));
        let mut distance = Distance { probes, ..Distance::default() };
        let Some(norms) = norms else { return distance };
        let column =
            |norm: fn(&Norms) -> f64| norms.iter().map(|norms| vec![norm(norms)]).collect::<Vec<_>>();
        distance.l2 = Some(parts(&column(|norms| norms.l2)));
        distance.energy = Some(parts(&column(|norms| norms.energy)));
        for &instant in instants {
            let nearest = (0..count.min(norms.len()))
                .min_by(|&a, &b| (times[a] - instant).abs().total_cmp(&(times[b] - instant).abs()));
            distance.at.extend(nearest.map(|k| [times[k], norms[k].l2, norms[k].energy]));
        }
        distance
    }
}

/// Returns the differences of values, one row per instant that both motions have.
pub(super) fn differences(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    a.iter().zip(b).map(|(a, b)| difference(a, b)).collect()
}
