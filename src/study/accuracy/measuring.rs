//! Measurement of single runs: their times, and their distances from their limit.

use super::Runner;
use super::cpu::CpuClock;
use super::norms::{Jet, Metric, Norms, Points, Sampler};
use super::plan::{Case, mesh_and_space, mesh_name};
use super::run_native;
use super::trajectory::{Distance, Trajectory};
use super::truth::{ReferenceSolution, starts};
use super::types::{Accuracy, Limit, Run, Scales};
use crate::error::Result;
use crate::mesh::{Cell, Mesh};
use crate::scene::{EngineName, Scene, Study};
use crate::simulation::{self, Outcome};

/// Limit on the total time of the repetitions of a case, in s; a first run that takes longer is not
/// repeated.
pub(super) const PATIENCE: f64 = 10.0;

/// Total time, in s, up to which short cases are repeated, at most [`MOST_REPETITIONS`] times.
///
/// This keeps a momentary disturbance from affecting the ranks.
const ENOUGH: f64 = 0.2;
const MOST_REPETITIONS: u32 = 30;

/// Motion on the reference mesh, at its quadrature points if its displacements were kept.
pub(super) struct Reference {
    pub truth: ReferenceSolution,
    points: Points,
    jets: Vec<Vec<Jet>>,
}

impl Reference {
    /// Samples a motion at the quadrature points of its own mesh.
    pub fn new(base: &Scene, truth: ReferenceSolution) -> Result<Reference> {
        let (mesh, space) = mesh_and_space(base, truth.grid)?;
        let points = Points::new(&mesh, &simulation::sections(base, &mesh)?)?;
        let sampler = Sampler::new(&mesh, &space, &points.at)?;
        let jets = truth.trajectory.fields.iter().map(|u| sampler.jets(u)).collect();
        Ok(Reference { truth, points, jets })
    }

    /// Returns the scales of relative errors.
    pub fn scales(&self) -> Scales {
        let zeros = vec![[0.0; 4]; self.points.at.len()];
        let largest = self.jets.iter().fold(Norms::default(), |largest, jets| {
            let norms = self.points.distance(jets, &zeros);
            Norms { l2: largest.l2.max(norms.l2), energy: largest.energy.max(norms.energy) }
        });
        Scales { deflection: self.truth.trajectory.scale(), l2: largest.l2, energy: largest.energy }
    }

    /// Returns the record of a limit, the motion on another mesh, with its error in space.
    pub fn limit(
        &self,
        base: &Scene,
        truth: &ReferenceSolution,
        scales: Scales,
        instants: &[f64],
    ) -> Result<Limit> {
        let (mesh, space) = mesh_and_space(base, truth.grid)?;
        let sampler = Sampler::new(&mesh, &space, &self.points.at)?;
        let fields = truth.trajectory.fields.iter().zip(&self.jets);
        let norms: Vec<Norms> =
            fields.map(|(u, jets)| self.points.distance(&sampler.jets(u), jets)).collect();
        let (finest, impacts) = (&self.truth.trajectory, starts(&self.truth.impacts));
        Ok(Limit {
            mesh: mesh_name(&truth.grid),
            mass: truth.family.mass(),
            family: truth.family.to_string(),
            source: truth.source.clone(),
            refused: truth.refused.clone(),
            dofs: space.dofs(),
            size: size(&mesh),
            impacts: starts(&truth.impacts),
            first_impact: truth.first_impact,
            own_error: truth.error.probes.over(scales.deflection),
            space: Distance::new(&truth.trajectory, finest, &impacts, Some(&norms), instants),
        })
    }
}

/// Returns the side of a square with the mean area of a cell, in m; two triangles count as one
/// cell.
fn size(mesh: &Mesh) -> f64 {
    let area = |cell| mesh.area(cell);
    let parts = |cell: &Cell| if cell.nodes().len() == 3 { 0.5 } else { 1.0 };
    let rectangles: f64 = mesh.cells.iter().map(parts).sum();
    ((0..mesh.cells.len()).map(area).sum::<f64>() / rectangles).sqrt()
}

/// Completed run of a case.
pub(super) struct Measurement {
    pub trajectory: Trajectory,
    pub outcome: Outcome,
    keep_fields: bool,
    /// Least times of set-up and of stepping, in s.
    seconds: [f64; 2],
}

/// Runs a case once for its motion, then repeatedly for its time.
pub(super) fn take(
    base: &Scene,
    study: &Study,
    case: &Case,
    interval: f64,
    run: &Runner,
) -> Result<Measurement> {
    let mut scene = case.scene(base, interval);
    let keep_fields = study.limits && scene.solver.engine == EngineName::Native;
    let ((trajectory, outcome), first) = timed(&scene, keep_fields, run)?;
    scene.output.every = u64::MAX;
    let (mut least, mut spent) = ([f64::INFINITY; 2], 0.0);
    if first.iter().sum::<f64>() > PATIENCE {
        (least, spent) = (first, f64::INFINITY);
    }
    for round in 0.. {
        let settled = study.repeat == 1 || spent > ENOUGH || round >= MOST_REPETITIONS;
        if round >= study.repeat && settled || spent > PATIENCE {
            break;
        }
        let (_, seconds) = timed(&scene, false, run)?;
        least = [0, 1].map(|part| seconds[part].min(least[part]));
        spent += seconds.iter().sum::<f64>();
    }
    Ok(Measurement { trajectory, outcome, keep_fields, seconds: least })
}

/// Runs a scene, and returns with its results the seconds of its set-up and of its steps without
/// their rows.
fn timed(scene: &Scene, keep_fields: bool, run: &Runner) -> Result<((Trajectory, Outcome), [f64; 2])> {
    let clock = CpuClock::start();
    let (trajectory, outcome) = run(scene, keep_fields)?;
    let share = clock.share();
    let time = outcome.seconds;
    let seconds = [time.assembly + time.equilibrium + time.factor, time.stepping - time.blocks.rows];
    Ok(((trajectory, outcome), seconds.map(|seconds| share * seconds)))
}

/// Works as [`take`] for several cases at the same time, on the native engine.
pub(super) fn take_at_once(
    base: &Scene,
    study: &Study,
    cases: &[&Case],
    interval: f64,
) -> Vec<Result<Measurement>> {
    std::thread::scope(|scope| {
        let start = |case| scope.spawn(move || take(base, study, case, interval, &run_native));
        let running: Vec<_> = cases.iter().copied().map(start).collect();
        running
            .into_iter()
            .map(|run| run.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    })
}

impl Measurement {
    /// Returns the distance of the run from its limit.
    pub fn error_in_time(
        &self,
        study: &Study,
        truth: &ReferenceSolution,
        metric: &Metric,
    ) -> Result<Distance> {
        let (trajectory, reference) = (&self.trajectory, &truth.trajectory);
        let norms: Option<Vec<Norms>> = self
            .keep_fields
            .then(|| {
                let pairs = trajectory.fields.iter().zip(&reference.fields);
                pairs.map(|(a, b)| metric.distance(a, b)).collect::<Result<_>>()
            })
            .transpose()?;
        Ok(Distance::new(trajectory, reference, &starts(&truth.impacts), norms.as_deref(), &study.at))
    }
}

/// Returns the record of a run without its error in time.
pub(super) fn record(case: &Case, taken: &Measurement, accuracy: &Accuracy) -> Run {
    let Measurement { trajectory, outcome, seconds: [set_up_seconds, stepping_seconds], .. } = taken;
    let whole = accuracy.motion.distance(&trajectory.samples);
    Run {
        mesh: mesh_name(&case.grid),
        case: *case,
        dofs: outcome.dofs,
        steps: outcome.steps,
        contact_steps: outcome.contact_steps,
        vi_iterations: outcome.vi_iterations,
        factorisations: outcome.factorisations,
        worst_kkt: outcome.worst_kkt,
        set_up_seconds: *set_up_seconds,
        stepping_seconds: *stepping_seconds,
        time: None,
        time_error: None,
        space_error: None,
        whole_error: whole.probes.at(accuracy.until).rms / accuracy.scales.deflection,
        whole,
        at_floor: false,
        first_impact_error: None,
        energy_drift: trajectory.energy_drift(),
    }
}
