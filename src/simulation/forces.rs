//! Forces and impulses by obstacle, ball and named support, at every step.

use super::contacts::ContactTotal;
use super::effects::{Attribution, Wrench};
use super::outcome::{JOINED, first_impact};
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
use std::collections::BTreeMap;

/// Force and impulse of an obstacle, step by step.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
struct ObstacleRecord {
    /// Force at the last step, in N.
    force: f64,
    /// Impulse since the last row, in N s.
    impulse: f64,
    /// Last instant of contact, in s, and the impact of that contact.
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

    /// Returns whether contact at an instant (s) begins another one, with steps of a length (s).
    fn is_apart(&self, time: f64, step: f64) -> bool {
        self.last.is_none_or(|last| time - last > JOINED * step)
    }

    /// Begins a contact with an impact.
    fn begin(&mut self, impact: Option<Impact>, scheme: &dyn Solution) -> Result<()> {
        self.total.impacts += 1;
        self.impact = None;
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
    fn event(&mut self, closes: bool, impact: Impact, step: f64, scheme: &dyn Solution) -> Result<()> {
        if self.is_apart(impact.time, step) {
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

/// Recorder of the forces of named supports, all obstacles and balls, the same on all processes.
pub(super) struct ForceRecorder {
    /// Name of each named support.
    supports: Vec<String>,
    reactions: Vec<SupportRecord>,
    /// This process's part of the reactions at the held nodes, at the last step.
    at_nodes: Vec<f64>,
    /// Obstacles behind the bounds; `None` where nothing can touch.
    attribution: Option<Attribution>,
    /// Name of each obstacle, then of each ball, and whether the scene gives it.
    obstacles: Vec<(String, bool)>,
    records: Vec<ObstacleRecord>,
    /// Sums over the nodes of all ranks, [`SUMS`] per obstacle, at the last step.
    sums: Vec<f64>,
    /// Forces of all sliders at the last step, in N, and whether each has a name.
    sliders: Vec<(f64, bool)>,
}

impl ForceRecorder {
    /// Prepares the records of the named supports and all obstacles of a scene.
    pub fn new<E: Engine>(scene: &Scene, model: &Model<E>) -> ForceRecorder {
        let named = |kind: &'static str| {
            move |(name, number): (&Option<String>, usize)| match name {
                Some(name) => (name.clone(), true),
                None => (format!("{kind}_{number}"), false),
            }
        };
        let obstacles = scene.obstacles.iter().map(|obstacle| &obstacle.name).zip(1..);
        let balls = scene.attachments.balls.iter().map(|ball| &ball.name).zip(1..);
        let obstacles: Vec<_> = obstacles.map(named("obstacle")).chain(balls.map(named("ball"))).collect();
        let supports: Vec<_> = scene.supports.iter().filter_map(|support| support.name.clone()).collect();
        ForceRecorder {
            reactions: vec![SupportRecord::default(); supports.len()],
            supports,
            at_nodes: Vec::new(),
            attribution: model.attribution.clone(),
            records: vec![ObstacleRecord::default(); obstacles.len()],
            obstacles,
            sums: Vec::new(),
            sliders: scene.sliders.iter().map(|slider| (0.0, slider.name.is_some())).collect(),
        }
    }

    /// Returns the names of all obstacles, given or not, in their order.
    pub fn obstacles(&self) -> impl Iterator<Item = &str> {
        self.obstacles.iter().map(|(name, _)| name.as_str())
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

    /// Returns the contact of a step, given whether nothing touches on this rank, and keeps its
    /// sums by obstacle. Collective.
    ///
    /// # Errors
    /// Returns the errors of the obstacles' heights.
    pub fn contact<E: Engine>(
        &mut self,
        model: &Model<E>,
        scheme: &dyn Solution,
        is_free: bool,
    ) -> Result<ContactTotal> {
        let ForceRecorder { attribution: Some(attribution), obstacles, sums, .. } = self else {
            return Ok(ContactTotal::default());
        };
        let comm = model.system.engine.comm();
        attribution.set(scheme.time(), comm)?;
        sums.clear();
        sums.resize(TOTALS + SUMS * obstacles.len(), 0.0);
        let penetration = if is_free { 0.0 } else { add_contact_of_nodes(scheme, attribution, sums) };
        if comm.size() > 1 {
            *sums = comm.all_reduce_sum_slice(sums);
        }
        Ok(ContactTotal { nodes: sums[0] as usize, force: sums[1], penetration })
    }

    /// Records the forces of the obstacles at a step and its events, after
    /// [`ForceRecorder::contact`]. Collective.
    fn record_obstacles<E: Engine>(
        &mut self,
        scene: &Scene,
        model: &Model<E>,
        scheme: &dyn Solution,
        events: &[Event],
    ) -> Result<()> {
        let ForceRecorder { attribution: Some(attribution), records, sums, .. } = self else {
            return Ok(());
        };
        let (time, step) = (scheme.time(), scene.time.step);
        let is_event_driven = scene.time.scheme.capabilities().is_event_driven;
        let sums = sums[TOTALS..].as_chunks::<SUMS>().0;
        for (obstacle, (&[force, impulse, nodes], record)) in sums.iter().zip(records).enumerate() {
            // The reaction at a gap acts on the ball.
            let sign = if obstacle < scene.obstacles.len() { 1.0 } else { -1.0 };
            let (force, impulse) = (sign * force, sign * impulse);
            record.add(force, impulse, time);
            for event in events {
                if attribution.obstacle(event.bound, towards(event)) == Some(obstacle) {
                    let DeflectionDof { node, at, .. } = model.sites[event.bound];
                    let impact = Impact { time: event.time, node, at, velocity: event.velocity };
                    record.event(event.closes, impact, step, scheme)?;
                }
            }
            if nodes > 0.0 {
                if record.is_apart(time, step) {
                    let is_chosen = |bound: usize| {
                        attribution.obstacle(bound, scheme.reaction()[bound]) == Some(obstacle)
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
        let mut rows = model.system.engine.comm().all_gather(&part);
        rows.sort_by(|(a, p, _), (b, q, _)| a.cmp(b).then(p[0].total_cmp(&q[0])).then(p[1].total_cmp(&q[1])));
        let row = |(support, place, [force, x, y]): (usize, [f64; 2], Wrench)| NodeReaction {
            support,
            at: place,
            force,
            moments: [x, y],
        };
        Ok(Some(rows.into_iter().map(row).collect()))
    }

    /// Returns the values of the force columns of a row, and begins the impulses of the next row.
    pub fn take_columns(&mut self) -> Vec<f64> {
        let take = |record: &mut ObstacleRecord| [record.force, std::mem::take(&mut record.impulse)];
        let obstacles = self.records.iter_mut().zip(&self.obstacles);
        let obstacles = obstacles.filter(|(_, (_, is_named))| *is_named).flat_map(|(record, _)| take(record));
        let supports = self.reactions.iter_mut().flat_map(SupportRecord::take_columns);
        let sliders = self.sliders.iter().filter(|(_, is_named)| *is_named).map(|(force, _)| *force);
        supports.chain(obstacles).chain(sliders).collect()
    }

    /// Returns the forces by name up to an instant (s).
    pub fn summary(&self, time: f64) -> BTreeMap<String, NamedForce> {
        let total = |((name, _), record): (&(String, bool), &ObstacleRecord)| {
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

/// Number of sums over all bounds: nodes in contact, force (N).
const TOTALS: usize = 2;

/// Number of sums per obstacle: force (N), impulse (N s), nodes in contact.
const SUMS: usize = 3;

/// Adds this process's nodes to the sums of a step. Returns the largest violation of a bound, in m.
fn add_contact_of_nodes(scheme: &dyn Solution, attribution: &Attribution, sums: &mut [f64]) -> f64 {
    let (record, bounds) = (scheme.record(), scheme.limits());
    let (totals, by_obstacle) = sums.split_at_mut(TOTALS);
    let mut add = |bound: usize, push: f64, values: [f64; SUMS]| {
        if let Some(obstacle) = attribution.obstacle(bound, push) {
            by_obstacle[SUMS * obstacle..].iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
        }
    };
    let mut penetration = 0.0_f64;
    for bound in record.candidates() {
        let (r, impulse, z) = (record.reaction[bound], record.impulses[bound], record.admissible[bound]);
        totals[0] += f64::from(r != 0.0);
        totals[1] += r;
        if r != 0.0 {
            add(bound, r, [r, 0.0, 1.0]);
        }
        if impulse != 0.0 {
            add(bound, impulse, [0.0, impulse, 0.0]);
        }
        let [lower, upper] = bounds.rigid(bound);
        penetration = penetration.max(lower - z).max(z - upper);
    }
    penetration
}
