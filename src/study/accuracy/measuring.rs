//! Measurement of single runs: their times, and their distances from their limit.

use super::Runner;
use super::norms::{Jet, Metric, Norms, Points, Sampler};
use super::plan::{Case, mesh_name};
use super::run_native;
use super::trajectory::{Deviation, Distance, Trajectory};
use super::truth::{Family, ReferenceSolution};
use super::types::{Limit, Run, Scales};
use crate::dof_map::DofMap;
use crate::error::Result;
use crate::mesh::{Cell, Mesh};
use crate::scene::{EngineName, Grid, Mass, Scene, Study};
use crate::simulation::{self, Outcome};

/// Limit on the total time of a case's repetitions, in s.
pub(super) const PATIENCE: f64 = 10.0;

/// Total time, in s, up to which short cases are repeated, at most [`MOST_REPETITIONS`] times.
///
/// This keeps a momentary disturbance from affecting the ranks.
const ENOUGH: f64 = 0.2;
const MOST_REPETITIONS: u32 = 30;

/// Motion on the reference mesh, at its quadrature points.
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
        let sampler = Sampler::new(&mesh, &space, points.at())?;
        let jets = truth.trajectory.fields.iter().map(|u| sampler.jets(u)).collect();
        Ok(Reference { truth, points, jets })
    }

    /// Returns the scales of relative errors.
    pub fn scales(&self) -> Scales {
        let zeros = vec![[0.0; 4]; self.points.at().len()];
        let largest = self.jets.iter().fold(Norms::default(), |largest, jets| {
            let norms = self.points.distance(jets, &zeros);
            Norms { l2: largest.l2.max(norms.l2), energy: largest.energy.max(norms.energy) }
        });
        Scales { deflection: self.truth.trajectory.scale(), l2: largest.l2, energy: largest.energy }
    }

    /// Returns the error in space of a motion on another mesh.
    pub fn distance(&self, base: &Scene, truth: &ReferenceSolution, instants: &[f64]) -> Result<Distance> {
        let (mesh, space) = mesh_and_space(base, truth.grid)?;
        let sampler = Sampler::new(&mesh, &space, self.points.at())?;
        let norms: Vec<Norms> = truth
            .trajectory
            .fields
            .iter()
            .zip(&self.jets)
            .map(|(u, reference)| self.points.distance(&sampler.jets(u), reference))
            .collect();
        let finest = &self.truth;
        Ok(Distance::new(&truth.trajectory, &finest.trajectory, &finest.impacts, Some(&norms), instants))
    }
}

/// Builds the mesh of a grid and its free dofs.
pub(super) fn mesh_and_space(base: &Scene, grid: Grid) -> Result<(Mesh, DofMap)> {
    let mut scene = base.clone();
    scene.mesh = grid;
    let mesh = simulation::mesh(&scene)?;
    let space = simulation::space(&scene, &mesh)?;
    Ok((mesh, space))
}

/// Returns the record of a limit, with its error in space.
pub(super) fn limit(
    mesh: &Mesh,
    truth: &ReferenceSolution,
    dofs: usize,
    scales: Scales,
    space: Distance,
) -> Limit {
    let relative =
        |d: Deviation| Deviation { rms: d.rms / scales.deflection, max: d.max / scales.deflection };
    Limit {
        mesh: mesh_name(&truth.grid),
        mass: match truth.family {
            Family::Singular => Mass::Singular,
            Family::Consistent(_) => Mass::Consistent,
        },
        family: truth.family.to_string(),
        source: truth.source.clone(),
        refused: truth.refused.clone(),
        dofs,
        size: size(mesh),
        impacts: truth.impacts.clone(),
        first_impact: truth.first_impact,
        own_error: truth.error.probes.map(relative),
        space,
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
    trajectory: Trajectory,
    outcome: Outcome,
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
    let keep_fields = scene.solver.engine == EngineName::Native;
    let (trajectory, outcome) = run(&scene, keep_fields)?;
    scene.output.every = u64::MAX;
    let (mut set_up_seconds, mut stepping_seconds, mut spent) = (f64::INFINITY, f64::INFINITY, 0.0);
    for round in 0.. {
        let settled = study.repeat == 1 || spent > ENOUGH || round >= MOST_REPETITIONS;
        if round >= study.repeat && settled || spent > PATIENCE {
            break;
        }
        let (_, outcome) = run(&scene, false)?;
        let seconds = outcome.seconds;
        let set_up = seconds.assembly + seconds.equilibrium + seconds.factor;
        set_up_seconds = set_up.min(set_up_seconds);
        stepping_seconds = seconds.stepping.min(stepping_seconds);
        spent += set_up + seconds.stepping;
    }
    Ok(Measurement { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] })
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

/// Measures the distance of a case from its limit.
pub(super) fn measure(
    study: &Study,
    case: &Case,
    taken: Measurement,
    truth: &ReferenceSolution,
    metric: &Metric,
) -> Result<Run> {
    let Measurement { trajectory, outcome, keep_fields, seconds: [set_up_seconds, stepping_seconds] } = taken;
    let reference = &truth.trajectory;
    let norms: Option<Vec<Norms>> = keep_fields
        .then(|| {
            let pairs = trajectory.fields.iter().zip(&reference.fields);
            pairs.map(|(a, b)| metric.distance(a, b)).collect::<Result<_>>()
        })
        .transpose()?;
    let time = Distance::new(&trajectory, reference, &truth.impacts, norms.as_deref(), &study.at);
    let touch = outcome.first_impact.map(|impact| impact.time);
    Ok(Run {
        case: *case,
        dofs: outcome.dofs,
        steps: outcome.steps,
        contact_steps: outcome.contact_steps,
        vi_iterations: outcome.vi_iterations,
        factorisations: outcome.factorisations,
        worst_kkt: outcome.worst_kkt,
        set_up_seconds,
        stepping_seconds,
        time,
        time_error: f64::NAN,
        space_error: f64::NAN,
        at_floor: false,
        first_impact_error: touch.zip(truth.first_impact).map(|(own, exact)| own - exact),
        energy_drift: trajectory.energy_drift(),
    })
}
