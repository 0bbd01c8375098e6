//! Summary of a run: its impacts, contacts and energies.

use super::{DeflectionDof, Extremes, LargestDeflection, Model, NamedForce};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::{Engine, LinearMethod, LinearSolves};
use crate::obstacle::Bounds;
use crate::scheme::{EventStatistics, RelaxationStatistics, Solution, System};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// First impact on an obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Impact {
    /// Time, in s: where the extrapolated free motion meets the obstacle, or the time of the event
    /// for an event-driven scheme.
    pub time: f64,
    /// Index of the first node in contact.
    pub node: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Velocity relative to the obstacle before impact, in m/s, positive upwards: negative where
    /// the gap closes from above the obstacle, whichever of the two moves, in any frame. For a ball
    /// it is the velocity of its gap, relative to the plate.
    pub velocity: f64,
}

/// Energy at the start and end, its extremes over the rows, and its balance, in J.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct EnergySpan {
    /// Energy at the start, in J.
    pub start: f64,
    /// Energy at the last row, in J.
    pub end: f64,
    /// Least energy, in J.
    pub min: f64,
    /// Largest energy, in J.
    pub max: f64,
    /// Kinetic and elastic energy at the start and at the last row, in J.
    pub stored: [f64; 2],
    /// Work of loads, moving obstacles and moving supports from the start to the last row, in J.
    pub put_in: f64,
    /// Energy lost up to the last row, in J: `put_in` and `stored` at the start less that at the
    /// last row. Damping, stops and friction take it, and in contact dissipative schemes.
    pub lost: f64,
}

impl EnergySpan {
    /// Starts with the energies of the initial state.
    fn new(start: Energies) -> EnergySpan {
        let [total, stored] = [start.total(), start.kinetic + start.elastic];
        EnergySpan {
            start: total,
            end: total,
            min: total,
            max: total,
            stored: [stored; 2],
            ..EnergySpan::default()
        }
    }

    /// Records the energies of a row.
    pub(super) fn record(&mut self, now: Energies) {
        let energy = now.total();
        self.end = energy;
        self.min = self.min.min(energy);
        self.max = self.max.max(energy);
        self.stored[1] = now.kinetic + now.elastic;
        self.lost = self.start - energy;
        self.put_in = self.stored[1] - self.stored[0] + self.lost;
    }
}

/// Wall time by phase, in s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Time for mesh and matrices, in s.
    pub assembly: f64,
    /// Time for the static start, in s.
    pub equilibrium: f64,
    /// Time for the first factorisation, in s.
    pub factor: f64,
    /// Time for all steps and their observers, in s; the sum of the blocks.
    pub stepping: f64,
    /// Time for the blocks of the main loop, in s.
    pub blocks: BlockSeconds,
}

/// Wall time by block of the main loop, in s.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct BlockSeconds {
    /// Time for the steps of the scheme, in s.
    pub advance: f64,
    /// Time for the compliance of nodes that come near their obstacles, for the modal mass, in s:
    /// once per run and node, and no part of the steps.
    pub compliance: f64,
    /// Time for events, the check of each step and the contacts of nodes, in s.
    pub contacts: f64,
    /// Time for energies, probes, the rows of the history and extremes of the stress, in s.
    pub rows: f64,
    /// Time for snapshots, in s.
    pub fields: f64,
    /// Time for checkpoints, the last state and the question whether to stop, in s.
    pub checkpoints: f64,
}

impl BlockSeconds {
    /// Returns the time for all blocks, in s.
    pub fn total(self) -> f64 {
        self.advance + self.compliance + self.contacts + self.rows + self.fields + self.checkpoints
    }
}

/// Solver of the linear systems, and its iterations since the program began or resumed the run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct LinearIterations {
    /// Method of the last matrix.
    pub method: LinearMethod,
    /// Mean number of iterations per system; `None` where factors solve them.
    pub iterations_mean: Option<f64>,
    /// Largest number of iterations of a system; `None` where factors solve them.
    pub iterations_max: Option<u64>,
}

impl From<LinearSolves> for LinearIterations {
    fn from(solves: LinearSolves) -> LinearIterations {
        let LinearSolves { method, count, iterations, most } = solves;
        LinearIterations {
            method,
            iterations_mean: (count > 0).then(|| iterations as f64 / count as f64),
            iterations_max: (count > 0).then_some(most),
        }
    }
}

/// Summary of a finished run.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Number of free dofs.
    pub dofs: usize,
    /// Number of dofs bounded by an obstacle.
    pub bounded_dofs: usize,
    /// Number of ranks.
    pub ranks: usize,
    /// Largest number of dofs that a rank owns, over the mean of all ranks.
    pub imbalance: f64,
    /// Number of steps.
    pub steps: u64,
    /// Number of steps with contact.
    pub contact_steps: u64,
    /// Number of iterations of the contact solver.
    pub vi_iterations: u64,
    /// Number of numeric factorisations of the step matrix.
    pub factorisations: u64,
    /// Solver of the linear systems, and its iterations.
    pub linear: LinearIterations,
    /// Number of steps solved again by a more robust method, because the first solution did not
    /// meet the tolerance.
    pub retries: u64,
    /// Largest number of nodes in contact at once.
    pub most_contact_nodes: usize,
    /// Work counters of an event-driven scheme.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub tally: Option<EventStatistics>,
    /// Largest deflection of all nodes over all steps; with the modal mass at 100 instants per
    /// period of the lowest mode.
    pub largest_deflection: Option<LargestDeflection>,
    /// Energy at the start and end, its extremes and its balance.
    pub energy: EnergySpan,
    /// First impact; `None` if there was no contact.
    pub first_impact: Option<Impact>,
    /// Contacts of the plate: intervals in which any node touches anything, in s. A plate that is
    /// released for a single step stays in contact.
    pub contacts: Vec<[f64; 2]>,
    /// Number of contacts of single nodes, i.e. of rows of contacts.csv.
    pub node_contacts: u64,
    /// Forces by obstacle and named support.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub forces: BTreeMap<String, NamedForce>,
    /// Energy that each slider, and the friction and dashpots of each obstacle, have dissipated, in
    /// J, by its name or key.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub dissipated: BTreeMap<String, f64>,
    /// Largest relative KKT residual of all steps.
    pub worst_kkt: f64,
    /// Largest violation of a bound in all steps, in m; during the run, of this process's bounds.
    pub worst_penetration: f64,
    /// Relaxation statistics of a conserving scheme.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub relaxation: Option<RelaxationStatistics>,
    /// Largest distance of the variable of stretching from the root of its energy, relative to the
    /// largest root, with `newmark` and `midpoint`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stretching_gap: Option<f64>,
    /// Extremes of the stress; `None` unless the scene asks for them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub extremes: Option<Extremes>,
    /// Wall time by phase, in s.
    pub seconds: Seconds,
}

impl Outcome {
    /// Creates the outcome of a run at its start; `factor` is the time of the factorisation, in s.
    pub(super) fn new<E: Engine>(model: &Model<E>, scheme: &dyn Solution, factor: f64) -> Result<Outcome> {
        let [assembly, equilibrium] = model.seconds;
        let System { engine, bounds, .. } = &model.system;
        let [dofs, bounded_dofs] = engine.comm().all_reduce_sum([engine.dofs(), bounds.len()]);
        Ok(Outcome {
            dofs,
            bounded_dofs,
            ranks: engine.comm().size(),
            imbalance: engine.comm().all_reduce_max(engine.dofs() as f64) * engine.comm().size() as f64
                / dofs.max(1) as f64,
            energy: EnergySpan::new(scheme.energies()?),
            seconds: Seconds { assembly, equilibrium, factor, ..Seconds::default() },
            ..Outcome::default()
        })
    }

    /// Saves or restores the numbers that steps change; the schemes have the others.
    pub(super) fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        for count in [&mut self.steps, &mut self.contact_steps, &mut self.vi_iterations, &mut self.retries] {
            archive.value(count)?;
        }
        archive.value(&mut self.most_contact_nodes)?;
        archive.value(&mut self.energy)?;
        archive.value(&mut self.first_impact)?;
        archive.value(&mut self.contacts)?;
        archive.value(&mut self.node_contacts)?;
        archive.value(&mut self.worst_kkt)?;
        archive.value(&mut self.worst_penetration)?;
        archive.value(&mut self.seconds.blocks)
    }
}

/// Number of steps between contacts that are one: a release for a single step ends none.
pub(crate) const JOINED: f64 = 2.5;

/// Adds an instant of contact (s) to the intervals of a run with steps of a length (s), see
/// [`Outcome::contacts`].
pub(crate) fn add_contact(contacts: &mut Vec<[f64; 2]>, step: f64, time: f64) {
    match contacts.last_mut() {
        Some([_, last]) if time - *last <= JOINED * step => *last = time,
        _ => contacts.push([time, time]),
    }
}

/// Returns the earliest impact of this step among the bounds that are `chosen`, if node and
/// obstacle move uniformly. Collective.
pub(super) fn first_impact<E: Engine>(
    model: &Model<E>,
    scheme: &dyn Solution,
    step: f64,
    chosen: &dyn Fn(usize) -> bool,
) -> Result<Option<Impact>> {
    let System { engine, drive, .. } = &model.system;
    let touched = || {
        let reactions = scheme.reaction().iter().enumerate();
        reactions.filter(|(bound, r)| **r != 0.0 && chosen(*bound))
    };
    // Bounds at the earliest instant before contact of any of these nodes, and one step later.
    let times = touched().map(|(bound, _)| scheme.approach(bound).time);
    let before =
        -engine.comm().all_reduce_max(times.fold(f64::NEG_INFINITY, |latest, time| latest.max(-time)));
    let before = if before.is_finite() { before.max(0.0) } else { 0.0 };
    let [from, to] = [model.system.bounds_at(before)?, model.system.bounds_at(before + step)?];
    let met = |(bound, &r): (usize, &f64)| {
        let approach = scheme.approach(bound);
        let height = |bounds: &Bounds| if r > 0.0 { bounds.lower[bound] } else { bounds.upper[bound] };
        let rate = (height(&to) - height(&from)) / step;
        // An absent obstacle has infinite height and gets the rate zero.
        let rate = if rate.is_finite() { rate } else { 0.0 };
        let target = if drive.bounds.is_some() && height(&from).is_finite() {
            height(&from) + rate * (approach.time - before)
        } else {
            height(scheme.limits())
        };
        let (gap, velocity) = (target - approach.deflection, approach.velocity - rate);
        let mut delay = if gap == 0.0 { 0.0 } else { gap / velocity };
        if drive.bounds.is_some() {
            delay = delay.min(scheme.time() + step - approach.time).max(0.0);
        }
        let DeflectionDof { node, at: place, .. } = model.sites[bound];
        ((approach.time + delay).max(0.0), velocity, node, place)
    };
    let touched = touched();
    let first = touched.map(met).min_by(|a, b| a.0.total_cmp(&b.0));
    let impacts = engine.comm().all_gather(first.as_slice());
    let first = impacts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(first.map(|(time, velocity, node, place)| Impact { time, node, at: place, velocity }))
}
