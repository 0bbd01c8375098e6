//! Recorded runs, and the distance of one from another.

use super::norms::Norms;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::difference;
use crate::scene::{Horizon, Scene};
use crate::scheme::{Scheme, Solution};
use crate::simulation::{self, Model, Observer, Outcome, Row, SolverFactory};
use serde::{Deserialize, Serialize};

/// Record of a run at the instants of comparison.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Instants in s.
    pub times: Vec<f64>,
    /// Deflections at the probes in m, one row per instant.
    pub probes: Vec<Vec<f64>>,
    /// Displacements over the native engine's free dofs, one per instant; empty if they were not
    /// kept.
    pub fields: Vec<Vec<f64>>,
    /// Energies in J.
    pub energies: Vec<f64>,
    /// Kinetic energies in J.
    pub kinetic: Vec<f64>,
}

struct TrajectoryRecorder {
    trajectory: Trajectory,
    keep_fields: bool,
}

impl Observer for TrajectoryRecorder {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.trajectory.times.push(row.time);
        self.trajectory.probes.push(row.probes.to_vec());
        self.trajectory.energies.push(row.energy);
        self.trajectory.kinetic.push(row.kinetic);
        Ok(())
    }

    fn state(&mut self, scheme: &dyn Solution) -> Result<()> {
        if self.keep_fields {
            self.trajectory.fields.push(scheme.displacement().to_vec());
        }
        Ok(())
    }
}

impl Trajectory {
    /// Runs a model and records its rows.
    ///
    /// # Errors
    /// Returns the error that ends the run early.
    pub fn record<E: Engine>(
        scene: &Scene,
        model: &Model<E>,
        solver: &SolverFactory<E>,
        keep_fields: bool,
    ) -> Result<(Trajectory, Outcome)> {
        Self::recorded(scene, keep_fields, |recorder| simulation::run(scene, model, solver, recorder))
    }

    /// Follows a scheme from its start and records its rows.
    ///
    /// # Errors
    /// Returns the errors of [`Trajectory::record`].
    pub fn of<E: Engine>(
        scene: &Scene,
        model: &Model<E>,
        scheme: Box<dyn Scheme + '_>,
        keep_fields: bool,
    ) -> Result<(Trajectory, Outcome)> {
        Self::recorded(scene, keep_fields, |recorder| {
            simulation::run_scheme(scene, model, scheme, 0.0, recorder)
        })
    }

    /// Returns the record of a run without a last row that lies between two instants of comparison.
    ///
    /// Such a row is written where the run's end is no multiple of the interval.
    fn recorded(
        scene: &Scene,
        keep_fields: bool,
        run: impl FnOnce(&mut TrajectoryRecorder) -> Result<(Outcome, Result<()>)>,
    ) -> Result<(Trajectory, Outcome)> {
        let mut recorder = TrajectoryRecorder { trajectory: Trajectory::default(), keep_fields };
        let (outcome, ended) = run(&mut recorder)?;
        ended?;
        let mut trajectory = recorder.trajectory;
        if !scene.time.steps().is_multiple_of(scene.output.every) {
            trajectory.times.pop();
            trajectory.probes.pop();
            trajectory.energies.pop();
            trajectory.kinetic.pop();
            trajectory.fields.pop();
        }
        Ok((trajectory, outcome))
    }

    /// Returns the largest deflection at any probe, in m, which is the scale of relative errors.
    pub fn scale(&self) -> f64 {
        self.probes.iter().flatten().fold(0.0, |scale, w| w.abs().max(scale))
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
    /// Returns the deviation of some errors.
    fn of(errors: impl Iterator<Item = f64>) -> Deviation {
        let (mut sum, mut number, mut max) = (0.0, 0_usize, 0.0_f64);
        for error in errors {
            sum += error * error;
            number += 1;
            max = if error.is_nan() { f64::NAN } else { max.max(error.abs()) };
        }
        Deviation { rms: (sum / number.max(1) as f64).sqrt(), max }
    }

    /// Returns the deviation of the errors at the instants of an interval, one row per instant.
    pub(super) fn within(times: &[f64], errors: &[Vec<f64>], [from, to]: [f64; 2]) -> Deviation {
        let rows = times.iter().zip(errors).filter(|(time, _)| from <= **time && **time <= to);
        Deviation::of(rows.flat_map(|(_, row)| row.iter().copied()))
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

impl<T: Copy> Parts<T> {
    /// Computes one value per part, from the instants at which impacts of the reference begin.
    pub(super) fn new(impacts: &[f64], value: impl Fn(f64) -> T) -> Parts<T> {
        Parts {
            first_impact: impacts.first().map(|&end| value(end)),
            second_impact: impacts.get(1).map(|&end| value(end)),
            end: value(f64::INFINITY),
        }
    }

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

    /// Applies a function to each part.
    pub fn map<U>(&self, function: impl Fn(T) -> U) -> Parts<U> {
        Parts {
            first_impact: self.first_impact.map(&function),
            second_impact: self.second_impact.map(&function),
            end: function(self.end),
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
        let parts = |values: &[Vec<f64>]| {
            Parts::new(impacts, |end| Deviation::within(times, values, [f64::NEG_INFINITY, end]))
        };
        let probes = parts(&differences(&run.probes, &reference.probes));
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
