//! Forces and impulses by named support and obstacle, at every step.

use super::effects::{Attribution, Wrench};
use super::outcome::first_impact;
use super::{
    DeflectionDof, HardestImpact, Impact, Model, NamedForce, NodeReaction, ObstacleForce, SupportForce,
};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scene::Scene;
use crate::scheme::{Event, Scheme, Solution};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::collections::BTreeMap;

/// Force and impulse of a named obstacle, step by step.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct ObstacleRecord {
    /// Force at the last step, in N.
    force: f64,
    /// Impulse since the last row, in N s.
    impulse: f64,
    /// Last instant of the contact that is open, in s, and its impact.
    last: Option<f64>,
    impact: Option<HardestImpact>,
    /// Number of touching nodes between events, and the time of the first touch, in s.
    touching: i64,
    since: f64,
    total: ObstacleForce,
}

impl ObstacleRecord {
    /// Adds force (N) and impulse (N s) of a step that ends at an instant (s).
    fn add(&mut self, force: f64, impulse: f64, time: f64) {
        self.force = force;
        self.impulse += impulse;
        self.total.impulse += impulse;
        if force.abs() > self.total.peak.abs() {
            (self.total.peak, self.total.time_of_peak) = (force, Some(time));
        }
    }

    /// Begins a contact with an impact.
    fn begin(&mut self, impact: Option<Impact>, scheme: &dyn Solution) -> Result<()> {
        self.total.impacts += 1;
        let Some(Impact { time, at, velocity: approach_velocity, .. }) = impact else { return Ok(()) };
        let kinetic_energy = scheme.energies()?.kinetic;
        self.impact = Some(HardestImpact { time, at, approach_velocity, kinetic_energy, impulse: 0.0 });
        Ok(())
    }

    /// Adds the impulse of a step (N s) to the contact that is open.
    fn follow(&mut self, impulse: f64) {
        let (Some(impact), hardest) = (&mut self.impact, &mut self.total.hardest) else { return };
        impact.impulse += impulse;
        let is_harder =
            |other: &HardestImpact| impact.time == other.time || impact.impulse.abs() > other.impulse.abs();
        if hardest.as_ref().is_none_or(is_harder) {
            *hardest = Some(*impact);
        }
    }

    /// Records the closing or opening of the gap at a node, for an event-driven scheme.
    fn event(&mut self, closes: bool, impact: Impact, scheme: &dyn Solution) -> Result<()> {
        if self.last.is_none() {
            self.begin(Some(impact), scheme)?;
        }
        self.last = Some(impact.time);
        if closes && self.touching == 0 {
            self.since = impact.time;
        }
        self.touching += if closes { 1 } else { -1 };
        if self.touching == 0 {
            self.total.time_in_contact += impact.time - self.since;
        }
        Ok(())
    }
}

/// Force and moments of a named support, step by step.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct SupportRecord {
    /// Force and moments at the last step.
    wrench: Wrench,
    /// Impulse since the last row, in N s.
    impulse: f64,
    total: SupportForce,
}

impl SupportRecord {
    /// Adds force and moments of a step at an instant (s), with the impulse of the step (N s).
    fn add(&mut self, wrench: Wrench, impulse: f64, time: f64) {
        let SupportRecord { total, .. } = self;
        let [force, x, y] = wrench;
        if force.abs() > total.peak.abs() {
            (total.peak, total.time_of_peak) = (force, time);
        }
        if x.hypot(y) > total.peak_moment[0].hypot(total.peak_moment[1]) {
            (total.peak_moment, total.time_of_peak_moment) = ([x, y], time);
        }
        total.impulse += impulse;
        self.impulse += impulse;
        self.wrench = wrench;
    }

    /// Returns the values of the columns of a row, and begins the impulse of the next row.
    fn take_columns(&mut self) -> [f64; 4] {
        let [force, x, y] = self.wrench;
        [force, std::mem::take(&mut self.impulse), x, y]
    }
}

/// Recorder of the forces of named supports and obstacles, the same on all processes.
pub(super) struct ForceRecorder {
    /// Name of each named support.
    supports: Vec<String>,
    reactions: Vec<SupportRecord>,
    /// This process's part of the reactions at the held nodes, at the last step.
    at_nodes: Vec<f64>,
    attribution: Option<Attribution>,
    /// Name and index of each named obstacle.
    obstacles: Vec<(String, usize)>,
    records: Vec<ObstacleRecord>,
    /// Forces of all sliders at the last step, in N, and whether each has a name.
    sliders: Vec<(f64, bool)>,
}

impl ForceRecorder {
    /// Prepares the records of the named supports and obstacles of a scene.
    pub fn new<E: Engine>(scene: &Scene, model: &Model<E>) -> ForceRecorder {
        let names = scene.obstacles.iter().map(|obstacle| obstacle.name.clone()).enumerate();
        let obstacles: Vec<_> = names.filter_map(|(k, name)| Some((name?, k))).collect();
        let supports: Vec<_> = scene.supports.iter().filter_map(|support| support.name.clone()).collect();
        ForceRecorder {
            reactions: vec![SupportRecord::default(); supports.len()],
            supports,
            at_nodes: Vec::new(),
            attribution: model.attribution.clone(),
            records: vec![ObstacleRecord::default(); obstacles.len()],
            obstacles,
            sliders: scene.sliders.iter().map(|slider| (0.0, slider.name.is_some())).collect(),
        }
    }

    /// Records a step of a scheme and its events. Collective.
    ///
    /// # Errors
    /// Returns the errors of the obstacles' heights and of the scheme.
    pub fn record<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &mut dyn Scheme,
        events: &[Event],
    ) -> Result<()> {
        self.record_supports(scene, model, scheme)?;
        if !self.sliders.is_empty() {
            let friction = model.friction(scene, scheme).into_iter();
            self.sliders.iter_mut().zip(friction).for_each(|(slider, [force, _])| slider.0 = force);
        }
        self.record_obstacles(scene, model, scheme, events)
    }

    /// Records the reactions of the supports at a step. Collective.
    fn record_supports<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &mut dyn Scheme,
    ) -> Result<()> {
        let Some(reactions) = &model.reactions else { return Ok(()) };
        let balance = scheme.balance()?;
        self.at_nodes = reactions.at_nodes(&model.system, &balance)?;
        let sums = model.sum_reactions(reactions, &self.at_nodes);
        for (record, wrench) in self.reactions.iter_mut().zip(sums) {
            let mean = match scheme.has_mean_reactions() {
                true => wrench[0],
                false => 0.5 * (record.wrench[0] + wrench[0]),
            };
            let seconds = if scheme.step() > 0 { scene.time.step } else { 0.0 };
            record.add(wrench, seconds * mean, scheme.time());
        }
        Ok(())
    }

    /// Records the forces of the obstacles at a step and its events. Collective.
    fn record_obstacles<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &dyn Solution,
        events: &[Event],
    ) -> Result<()> {
        let ForceRecorder { attribution: Some(attribution), obstacles, records, .. } = self else {
            return Ok(());
        };
        let (comm, time, step) = (model.system.engine.comm(), scheme.time(), scene.time.step);
        attribution.set(time, comm)?;
        let sums = comm.all_reduce_sum_slice(&own_sums(scheme, attribution, obstacles));
        let is_event_driven = scene.time.scheme.capabilities().is_event_driven;
        for ((sums, record), (_, obstacle)) in sums.chunks_exact(SUMS).zip(records).zip(obstacles) {
            let (force, impulse, nodes) = (sums[0], sums[1], sums[2]);
            record.add(force, impulse, time);
            for event in events {
                if attribution.obstacle(event.bound, towards(event)) == Some(*obstacle) {
                    let DeflectionDof { node, at, .. } = model.sites[event.bound];
                    let impact = Impact { time: event.time, node, at, velocity: event.velocity };
                    record.event(event.closes, impact, scheme)?;
                }
            }
            if nodes > 0.0 {
                if record.last.is_none() {
                    let is_chosen = |bound: usize| {
                        attribution.obstacle(bound, scheme.reaction()[bound]) == Some(*obstacle)
                    };
                    record.begin(first_impact(model, scheme, step, &is_chosen)?, scheme)?;
                }
                record.last = Some(time);
                match (is_event_driven, scheme.step()) {
                    (true, 0) => record.touching = nodes as i64,
                    (false, 1..) => record.total.time_in_contact += step,
                    _ => {}
                }
            }
            record.follow(impulse);
            if record.last.is_some_and(|last| last < time - 1.5 * step) {
                (record.last, record.impact) = (None, None);
            }
        }
        Ok(())
    }

    /// Returns the reactions at all nodes of the named supports at the last step, in the order of
    /// supports and positions; `None` where no support has a name. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn at_nodes<E: Engine>(&self, model: &Model<E>) -> Result<Option<Vec<NodeReaction>>> {
        let Some(reactions) = &model.reactions else { return Ok(None) };
        let part = reactions.distribution(&self.at_nodes)?;
        let numbers = |(support, [x, y], [force, mx, my]): (usize, [f64; 2], Wrench)| {
            [support as f64, x, y, force, mx, my]
        };
        let part: Vec<[f64; 6]> = part.into_iter().map(numbers).collect();
        let mut rows = model.system.engine.comm().all_gather(&part);
        rows.sort_by(|a, b| {
            a[..3].iter().zip(&b[..3]).fold(Ordering::Equal, |so_far, (a, b)| so_far.then(a.total_cmp(b)))
        });
        let row = |[support, x, y, force, mx, my]: [f64; 6]| NodeReaction {
            support: support as usize,
            at: [x, y],
            force,
            moments: [mx, my],
        };
        Ok(Some(rows.into_iter().map(row).collect()))
    }

    /// Returns the values of the force columns of a row, and begins the impulses of the next row.
    pub fn take_columns(&mut self) -> Vec<f64> {
        let columns = |record: &mut ObstacleRecord| [record.force, std::mem::take(&mut record.impulse)];
        let supports = self.reactions.iter_mut().flat_map(SupportRecord::take_columns);
        let sliders = self.sliders.iter().filter(|(_, is_named)| *is_named).map(|(force, _)| *force);
        supports.chain(self.records.iter_mut().flat_map(columns)).chain(sliders).collect()
    }

    /// Returns the forces by name up to an instant (s).
    pub fn summary(&self, time: f64) -> BTreeMap<String, NamedForce> {
        let total = |((name, _), record): (&(String, usize), &ObstacleRecord)| {
            let mut total = record.total.clone();
            if record.touching > 0 {
                total.time_in_contact += time - record.since;
            }
            (name.clone(), NamedForce::Obstacle(total))
        };
        let support = |(name, record): (&String, &SupportRecord)| {
            (name.clone(), NamedForce::Support(record.total.clone()))
        };
        let supports = self.supports.iter().zip(&self.reactions).map(support);
        supports.chain(self.obstacles.iter().zip(&self.records).map(total)).collect()
    }

    /// Saves or restores the records.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        if !self.reactions.is_empty() {
            archive.value(&mut self.reactions)?;
        }
        if self.records.is_empty() { Ok(()) } else { archive.value(&mut self.records) }
    }
}

/// Returns the sign of the force that the obstacle of an event exerts.
fn towards(event: &Event) -> f64 {
    if event.closes { -event.velocity } else { event.velocity }
}

/// Number of sums per named obstacle: force (N), impulse (N s), nodes in contact.
const SUMS: usize = 3;

/// Returns this process's part of the sums of a step, for each named obstacle.
fn own_sums(scheme: &dyn Solution, attribution: &Attribution, obstacles: &[(String, usize)]) -> Vec<f64> {
    let mut sums = vec![0.0; SUMS * obstacles.len()];
    let mut add = |bound: usize, push: f64, values: [f64; SUMS]| {
        let obstacle = attribution.obstacle(bound, push);
        if let Some(k) = obstacles.iter().position(|(_, number)| Some(*number) == obstacle) {
            sums[SUMS * k..].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    };
    let (reaction, impulses) = (scheme.reaction(), scheme.impulses());
    for bound in scheme.record().candidates() {
        let (r, impulse) = (reaction[bound], impulses[bound]);
        if r != 0.0 {
            add(bound, r, [r, 0.0, 1.0]);
        }
        if impulse != 0.0 {
            add(bound, impulse, [0.0, impulse, 0.0]);
        }
    }
    sums
}
