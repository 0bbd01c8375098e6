//! What is kept of a run, and how far one is from another.

use super::norms::Norms;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scene::{Horizon, Scene};
use crate::scheme::Scheme;
use crate::simulation::{self, Model, Observer, Outcome, Row, SolverFactory};
use serde::{Deserialize, Serialize};

/// A run at the instants of comparison.
#[derive(Debug, Clone, Default)]
pub struct Trajectory {
    /// Instants, in s.
    pub times: Vec<f64>,
    /// Deflections at the probes, in m, instant by instant.
    pub probes: Vec<Vec<f64>>,
    /// Displacements over the free dofs of the native engine, instant by instant; empty where they were not kept.
    pub fields: Vec<Vec<f64>>,
    /// Energies, in J.
    pub energies: Vec<f64>,
}

struct Recorder {
    trajectory: Trajectory,
    keep_fields: bool,
}

impl Observer for Recorder {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.trajectory.times.push(row.time);
        self.trajectory.probes.push(row.probes.to_vec());
        self.trajectory.energies.push(row.energy);
        Ok(())
    }

    fn state(&mut self, scheme: &dyn Scheme) -> Result<()> {
        if self.keep_fields {
            self.trajectory.fields.push(scheme.displacement().to_vec());
        }
        Ok(())
    }
}

impl Recorder {
    /// What was kept. Steps that fit the interval but not the end leave a last row of their own, which goes.
    fn finish(self, scene: &Scene) -> Trajectory {
        let mut trajectory = self.trajectory;
        if !scene.time.steps().is_multiple_of(scene.output.every) {
            trajectory.times.pop();
            trajectory.probes.pop();
            trajectory.energies.pop();
            trajectory.fields.pop();
        }
        trajectory
    }
}

impl Trajectory {
    /// Runs a model and keeps its rows.
    ///
    /// # Errors
    /// What ends the run early.
    pub fn record<E: Engine>(
        scene: &Scene,
        model: &Model<E>,
        solver: &SolverFactory<E>,
        keep_fields: bool,
    ) -> Result<(Trajectory, Outcome)> {
        let mut recorder = Recorder { trajectory: Trajectory::default(), keep_fields };
        let (outcome, ended) = simulation::run(scene, model, solver, &mut recorder)?;
        ended?;
        Ok((recorder.finish(scene), outcome))
    }

    /// Follows a scheme from its start and keeps its rows.
    ///
    /// # Errors
    /// As [`Trajectory::record`].
    pub fn of<E: Engine>(
        scene: &Scene,
        model: &Model<E>,
        scheme: Box<dyn Scheme + '_>,
        keep_fields: bool,
    ) -> Result<(Trajectory, Outcome)> {
        let mut recorder = Recorder { trajectory: Trajectory::default(), keep_fields };
        let (outcome, ended) = simulation::follow(scene, model, scheme, 0.0, &mut recorder)?;
        ended?;
        Ok((recorder.finish(scene), outcome))
    }

    /// Largest deflection at any probe, in m: what errors are relative to.
    pub fn scale(&self) -> f64 {
        self.probes.iter().flatten().fold(0.0, |scale, w| w.abs().max(scale))
    }

    /// Energy at the end over that of the start less one, and the largest such departure on the way; `None` without energy.
    pub fn energy_drift(&self) -> Option<[f64; 2]> {
        let start = *self.energies.first().filter(|energy| **energy != 0.0)?;
        let drift = |energy: &f64| energy / start - 1.0;
        let worst = self.energies.iter().map(drift).fold(0.0, |worst: f64, d| worst.max(d.abs()));
        Some([drift(self.energies.last()?), worst])
    }
}

/// Root mean square and largest magnitude of an error.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviation {
    /// Root mean square over instants (and probes).
    pub rms: f64,
    /// Largest.
    pub max: f64,
}

/// How far a run is from another, over three parts of it; `None` where the reference has no such impact.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Parts<T> {
    /// Up to the first impact.
    pub first_impact: Option<T>,
    /// Up to the second.
    pub second_impact: Option<T>,
    /// The whole run.
    pub end: T,
}

impl<T: Copy> Parts<T> {
    /// One value a part, given the instants at which the reference's contacts begin.
    fn new(impacts: &[f64], of: impl Fn(f64) -> T) -> Parts<T> {
        Parts {
            first_impact: impacts.first().map(|&end| of(end)),
            second_impact: impacts.get(1).map(|&end| of(end)),
            end: of(f64::INFINITY),
        }
    }

    /// The part that ranks runs: the longest up to the horizon that the reference has.
    pub fn at(&self, horizon: Horizon) -> T {
        let second = self.second_impact.unwrap_or(self.end);
        match horizon {
            Horizon::FirstImpact => self.first_impact.unwrap_or(second),
            Horizon::SecondImpact => second,
            Horizon::End => self.end,
        }
    }

    /// Each part's value turned into another.
    pub fn map<U>(&self, of: impl Fn(T) -> U) -> Parts<U> {
        Parts {
            first_impact: self.first_impact.map(&of),
            second_impact: self.second_impact.map(&of),
            end: of(self.end),
        }
    }
}

/// How far a run is from a reference.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// Deflections at the probes, in m.
    pub probes: Parts<Deviation>,
    /// L2 norm of the deflection's difference, in m2; `None` without fields.
    pub l2: Option<Parts<Deviation>>,
    /// Its energy norm, the root of a(w, w), in J^(1/2).
    pub energy: Option<Parts<Deviation>>,
    /// Instant, L2 and energy norm at the instants asked for.
    pub at: Vec<[f64; 3]>,
}

impl Distance {
    /// Measures instant by instant; both runs have the same instants. `impacts` are the reference's.
    ///
    /// `norms` holds the norms of the fields' difference at each instant, if they are wanted, and `instants` those to tell.
    pub fn new(
        run: &Trajectory,
        reference: &Trajectory,
        impacts: &[f64],
        norms: Option<&[Norms]>,
        instants: &[f64],
    ) -> Distance {
        let count = run.times.len().min(reference.times.len());
        let times = &reference.times[..count];
        let part = |values: &[Vec<f64>], end: f64| {
            let within = times.iter().zip(values).filter(|(time, _)| **time <= end);
            let (mut sum, mut number, mut max) = (0.0, 0_usize, 0.0_f64);
            for error in within.flat_map(|(_, errors)| errors) {
                sum += error * error;
                number += 1;
                max = if error.is_nan() { f64::NAN } else { max.max(error.abs()) };
            }
            Deviation { rms: (sum / number.max(1) as f64).sqrt(), max }
        };
        let parts = |values: &[Vec<f64>]| Parts::new(impacts, |end| part(values, end));
        let difference = |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| a - b).collect();
        let probes: Vec<Vec<f64>> = run.probes.iter().zip(&reference.probes).map(difference).collect();
        let mut distance = Distance { probes: parts(&probes), ..Distance::default() };
        let Some(norms) = norms else { return distance };
        let column = |of: fn(&Norms) -> f64| norms.iter().map(|norms| vec![of(norms)]).collect::<Vec<_>>();
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
