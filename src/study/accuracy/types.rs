//! Results of a study: limits, runs and failures.

use super::plan::{Absent, Case, mesh_name};
use super::trajectory::{Deviation, Distance, Parts, Samples};
use super::truth::Family;
use super::whole::{BestRun, Floor, ReferenceMotion, Whole};
use crate::scene::{Grid, Horizon, Mass, Scene, Study};
use serde::{Deserialize, Serialize};

/// Scales of relative errors: the largest magnitudes in the motion on the reference mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Scales {
    /// Deflection at the probes, in m.
    pub deflection: f64,
    /// L2 norm of the deflection, in m2; 0 without limits.
    pub l2: f64,
    /// Energy norm of the deflection, in J^(1/2); 0 without limits.
    pub energy: f64,
}

/// Motion to which runs converge as their step tends to zero.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the mesh.
    pub mesh: String,
    /// Mass matrix.
    pub mass: Mass,
    /// Family of methods with this limit: all of the singular mass, all of the modal mass with a
    /// number of modes, or one method of the consistent mass.
    pub family: String,
    /// Method by which the motion was computed.
    pub source: String,
    /// Methods that were tried before, and why they failed.
    pub refused: Vec<String>,
    /// Number of free dofs.
    pub dofs: usize,
    /// Side of a square with the mean area of a cell, two triangles counted as one cell, in m.
    pub size: f64,
    /// Starts of the impacts, in s.
    pub impacts: Vec<f64>,
    /// Time of the first contact, in s.
    pub first_impact: Option<f64>,
    /// Estimate of the limit's own error at the probes, relative.
    pub own_error: Parts<Deviation>,
    /// Error in space: the distance from the motion on the reference mesh.
    pub space: Distance,
}

/// Measurements of one run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the mesh.
    pub mesh: String,
    /// Mesh, method and step.
    #[serde(flatten)]
    pub case: Case,
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of steps.
    pub steps: u64,
    /// Number of steps in contact.
    pub contact_steps: u64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of numeric factorisations.
    pub factorisations: u64,
    /// Worst relative KKT residual.
    pub worst_kkt: f64,
    /// Time of mesh, matrices, modes, static start and first factorisation, in s.
    pub set_up_seconds: f64,
    /// Time of all steps, in s.
    pub stepping_seconds: f64,
    /// Distance from the limit on the same mesh; `None` in a study without limits.
    pub time: Option<Distance>,
    /// Error in time that ranks the run: root mean square at the probes up to the horizon,
    /// relative; `None` in a study without limits.
    pub time_error: Option<f64>,
    /// Error in space of the limit: root mean square at the probes up to the horizon, relative;
    /// `None` in a study without limits.
    pub space_error: Option<f64>,
    /// Distance from the motion on the reference mesh.
    pub whole: Whole,
    /// Whole error: root mean square of that distance at the probes up to the horizon, relative.
    pub whole_error: f64,
    /// Whether the error in time is too close to the limit's own error to be resolved.
    pub at_floor: bool,
    /// Time of the first contact minus that of the limit, in s.
    pub first_impact_error: Option<f64>,
    /// Relative change of the energy at the end, and the largest magnitude of that change during
    /// the run.
    pub energy_drift: Option<[f64; 2]>,
}

impl Run {
    /// Returns the time of the whole run, in s.
    pub fn seconds(&self) -> f64 {
        self.set_up_seconds + self.stepping_seconds
    }

    /// Returns a bound on the whole error, or in a study without limits that error, relative.
    pub fn error(&self) -> f64 {
        self.time_error.zip(self.space_error).map_or(self.whole_error, |(time, space)| time + space)
    }

    /// Returns the name of the larger error, in a study with limits.
    pub fn dominating(&self) -> Option<&'static str> {
        let larger = |(time, space)| if time > space { "time" } else { "space" };
        self.time_error.zip(self.space_error).map(larger)
    }
}

/// Results of a study: the cost and the errors of each run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// Title of the scene.
    pub title: String,
    /// Whether all runs are included.
    pub complete: bool,
    /// Horizon that ranks the runs; the whole run if the scene's horizon needs an impact that is
    /// missing.
    pub until: Horizon,
    /// Time between instants of comparison, in s.
    pub interval: f64,
    /// Names of the probes.
    pub probes: Vec<String>,
    /// Scales of relative errors.
    pub scales: Scales,
    /// Mesh on which the error in space is measured, and the method that computed its motion.
    pub reference: String,
    /// Motion on that mesh.
    pub motion: ReferenceMotion,
    /// Best runs of the masses on the finest mesh, in a study of the floor.
    pub best: Vec<BestRun>,
    /// Limits of the runs.
    pub limits: Vec<Limit>,
    /// Completed runs.
    pub runs: Vec<Run>,
    /// Failed runs.
    pub failures: Vec<Absent>,
    /// Combinations left out.
    pub dropped: Vec<Absent>,
    /// Largest number of simultaneous runs; times are unreliable if it exceeds 1.
    pub at_once: usize,
}

impl Accuracy {
    /// Creates a study without results.
    pub(super) fn unknown(base: &Scene, study: &Study, interval: f64) -> Accuracy {
        Accuracy {
            title: base.title.clone(),
            until: study.until,
            interval,
            probes: base.output.probes.iter().map(|probe| probe.name.clone()).collect(),
            at_once: 1,
            ..Accuracy::default()
        }
    }

    /// Returns the largest distance between the best runs of the masses on the finest mesh and the
    /// motion on the reference mesh; `None` for fewer than two masses.
    pub fn floor(&self) -> Option<Floor> {
        let Accuracy { motion, best, until, scales, .. } = self;
        let runs = best.iter().map(|run| run.name.clone()).collect();
        let mut floor = Floor { deflection: 0.0, after_impact: None, kinetic: None, runs };
        let motions: Vec<&Samples> =
            std::iter::once(&motion.samples).chain(best.iter().map(|run| &run.samples)).collect();
        let larger = |a: Option<f64>, b: Option<Deviation>, scale: f64| {
            b.map_or(a, |b| Some(a.unwrap_or(0.0).max(b.rms / scale)))
        };
        for (number, a) in motions.iter().enumerate() {
            for b in &motions[number + 1..] {
                let distance = motion.between(a, b);
                let deflection = distance.probes.at(*until).rms / scales.deflection;
                floor.deflection = floor.deflection.max(deflection);
                floor.after_impact = larger(floor.after_impact, distance.after_impact, scales.deflection);
                floor.kinetic = larger(floor.kinetic, distance.kinetic, 1.0);
            }
        }
        (best.len() > 1).then_some(floor)
    }

    /// Returns the limit of a family on a mesh.
    pub(super) fn limit(&self, grid: &Grid, family: Family) -> Option<&Limit> {
        let (mesh, family) = (mesh_name(grid), family.to_string());
        self.limits.iter().find(|limit| limit.mesh == mesh && limit.family == family)
    }
}

#[cfg(test)]
mod tests {
    use super::{Accuracy, BestRun, ReferenceMotion, Samples, Scales};
    use crate::scene::{Horizon, Mass};
    use crate::study::accuracy::whole::keep_best;

    /// Motion with one probe at rest, and with a constant kinetic energy.
    fn still(w: f64) -> Samples {
        Samples { probes: vec![vec![w]; 6], kinetic: vec![w; 6] }
    }

    #[test]
    fn the_floor_is_the_largest_distance_of_the_best_runs() {
        // The only impact lasts from 1 s to 2 s; the next starts at 4 s.
        let (times, impacts) = ((0..6).map(f64::from).collect(), vec![[1.0, 2.0], [4.0, 4.5]]);
        let motion = ReferenceMotion { times, samples: still(0.0), impacts, energy: 10.0 };
        let scales = Scales { deflection: 2.0, ..Scales::default() };
        let mut study = Accuracy { motion, until: Horizon::End, scales, ..Accuracy::default() };
        let run = |mass, error, w: f64| BestRun { name: format!("{w}"), mass, error, samples: still(w) };
        keep_best(&mut study.best, run(Mass::Singular, 0.3, 3.0));
        assert!(study.floor().is_none());
        keep_best(&mut study.best, run(Mass::Singular, 0.2, 2.0));
        keep_best(&mut study.best, run(Mass::Singular, 0.9, 9.0));
        keep_best(&mut study.best, run(Mass::Modal, 0.1, -1.0));
        let floor = study.floor().unwrap();
        assert_eq!(floor.runs, ["2", "-1"]);
        assert_eq!((floor.deflection, floor.after_impact), (1.5, Some(1.5)));
        assert!((floor.kinetic.unwrap() - 0.3).abs() < 1e-15);
    }
}
