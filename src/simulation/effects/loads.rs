//! Integration of the loads of all effects, and their resultants.

use super::contributions::{Body, Load, LoadLaw, PointTerm};
use super::ground::BuildContext;
use crate::assembly::{self, Pressure};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::element::adaptive::{self, Integrand, Rules, Triangle};
use crate::error::Result;
use crate::field::{Enclosure, Field, Interval};
use crate::linalg::vectors::{self, axpy};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::FieldInput;
use crate::scheme::{LoadOfTime, LoadTerm};
use crate::simulation::phase;
use crate::simulation::refinement::accepted;
use serde::Serialize;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Sum of loads on this process's part of the mesh: on all deflections and slopes, three per node,
/// held or not, then on the gaps of bodies.
pub(super) struct Loads<P: Partition> {
    /// Constant part, in N.
    constant: Vec<f64>,
    /// Products of a factor g(t) and a load vector (N).
    terms: Vec<(FieldInput, Vec<f64>)>,
    waves: Vec<Rc<Wave<P>>>,
}

/// Sum of loads at some nodes.
pub(super) struct LoadsAtNodes<P: Partition> {
    nodes: Vec<usize>,
    at_nodes: Loads<P>,
}

/// Pressure that is no sum of products g(t) h(x, y), integrated at every instant.
struct Wave<P: Partition> {
    pressure: FieldInput,
    points: Pressure,
    pieces: Vec<Triangle>,
    space: DofMap,
    /// Number of deflections and slopes.
    dofs: usize,
    /// Time step, in s.
    step: f64,
    /// Index of the last time window tested and the result, by length of the window in steps.
    calm: RefCell<BTreeMap<u32, (u64, bool)>>,
    /// Loads at the last instants, by the bits of the instant (s).
    last_loads: RefCell<Vec<(u64, Rc<[f64]>)>>,
    partition: P,
}

/// Lengths, in steps, of the time windows in which a wave is tested for being smooth enough for the
/// usual quadrature rule. Windows start at multiples of their length, so that a resumed run makes
/// the same tests.
const WINDOWS: [u32; 2] = [256, 16];

/// Number of instants whose wave loads are kept, as many as a step of any scheme needs.
const KEPT_INSTANTS: usize = 4;

/// Wave at the start of a time window, with bounds over the whole window.
struct Window<'w> {
    pressure: &'w FieldInput,
    from: f64,
    to: f64,
}

impl Integrand for Window<'_> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        self.pressure.values(points, self.from, values)
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure<3> {
        self.pressure.enclose(low, high, Interval { low: self.from, high: self.to })
    }

    fn side(&self, point: Point) -> u64 {
        self.pressure.still(self.from).side(point)
    }
}

impl<P: Partition> Wave<P> {
    /// Prepares the integration of a pressure. Collective.
    fn new(ground: &BuildContext<P>, pressure: &FieldInput) -> Result<Wave<P>> {
        let BuildContext { scene, mesh, cells, space, .. } = ground;
        Ok(Wave {
            pressure: pressure.clone(),
            points: ground.comm().all_ok(Pressure::new(mesh, &assembly::unheld(mesh, cells)))?,
            pieces: ground.comm().all_ok(assembly::pieces(mesh))?,
            space: (*space).clone(),
            dofs: PER_NODE * mesh.nodes.len(),
            step: scene.time.step,
            calm: RefCell::default(),
            last_loads: RefCell::default(),
            partition: ground.partition.clone(),
        })
    }

    /// Returns whether the usual quadrature rule suffices in the window of `steps` steps around an
    /// instant (s). Collective.
    fn is_calm(&self, t: f64, steps: u32) -> Result<bool> {
        let length = f64::from(steps) * self.step;
        let number = (t / length).floor().max(0.0);
        let last = self.calm.borrow().get(&steps).copied();
        if let Some((_, calm)) = last.filter(|(last, _)| *last == number as u64) {
            return Ok(calm);
        }
        let window = Window { pressure: &self.pressure, from: number * length, to: (number + 1.0) * length };
        // A window that cannot be evaluated is not calm; its instants report the error.
        let comm = self.partition.comm();
        let calm = adaptive::is_calm(&self.pieces, &window, adaptive::EACH_TIME, comm);
        let calm = comm.all_reduce_all(matches!(calm, Ok(true)));
        self.calm.borrow_mut().insert(steps, (number as u64, calm));
        Ok(calm)
    }

    /// Returns special quadrature rules for cells that need them at an instant (s). Collective.
    fn rules(&self, t: f64) -> Result<Rules> {
        for steps in WINDOWS {
            if self.is_calm(t, steps)? {
                return Ok(Rules::new());
            }
        }
        let (still, comm) = (self.pressure.still(t), self.partition.comm());
        let refined = adaptive::refine(&self.pieces, &|_| Some(&still), adaptive::EACH_TIME, comm)?;
        accepted(&self.pressure.key, refined)
    }

    /// Adds the load at an instant (s) to `load`, in N, on the engine's dofs. Collective.
    fn add(&self, t: f64, load: &mut [f64]) -> Result<()> {
        vectors::add(&self.partition.add_up(&self.space.restrict(&self.load(t)?))?, load);
        Ok(())
    }

    /// Returns the load at an instant (s), in N, on all deflections and slopes. Collective.
    fn load(&self, t: f64) -> Result<Rc<[f64]>> {
        let mut loads = self.last_loads.borrow_mut();
        if let Some((_, load)) = loads.iter().find(|(instant, _)| *instant == t.to_bits()) {
            return Ok(load.clone());
        }
        let mut load = vec![0.0; self.dofs];
        let rules = self.rules(t);
        let pressure = |points: &[Point], values: &mut [f64]| self.pressure.values(points, t, values);
        let comm = self.partition.comm();
        comm.all_ok(rules.and_then(|rules| self.points.load(&rules, pressure, &mut load)))?;
        let load: Rc<[f64]> = load.into();
        loads.truncate(KEPT_INSTANTS - 1);
        loads.insert(0, (t.to_bits(), load.clone()));
        Ok(load)
    }
}

/// Resultant force and moments of a load.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Resultant {
    /// Force, in N, positive upwards.
    pub force: f64,
    /// Moments about the x and y axes through the origin of the coordinates, in N m.
    pub moments: [f64; 2],
}

impl Resultant {
    /// Returns the resultant of a load on the deflections and slopes of all nodes, three entries
    /// per node, on a plate that extends to an arm (m).
    fn of(nodes: &[Point], load: &[f64], arm: f64) -> Resultant {
        let mut sum = Resultant::default();
        for (node, load) in nodes.iter().zip(load.chunks_exact(PER_NODE)) {
            sum.force += load[0];
            sum.moments[0] += load[0] * node.y + load[2];
            sum.moments[1] -= load[0] * node.x + load[1];
        }
        // A pure moment has forces that cancel, or none but rounding.
        let parts = load.chunks_exact(PER_NODE).map(|load| load[0].abs() + load[1].hypot(load[2]) / arm);
        let parts: f64 = parts.sum();
        if sum.force.abs() < ROUNDING * parts {
            sum.force = 0.0;
        }
        sum
    }

    fn add(&mut self, factor: f64, other: Resultant) {
        self.force += factor * other.force;
        (0..2).for_each(|k| self.moments[k] += factor * other.moments[k]);
    }

    /// Returns force and moments, the force times an arm (m), in N m.
    fn parts(self, arm: f64) -> [f64; 3] {
        [self.force * arm, self.moments[0], self.moments[1]]
    }
}

/// Load that is a constant and a sum of products of a factor of time and a resultant.
struct TimedResultant {
    constant: Resultant,
    terms: Vec<(FieldInput, Resultant)>,
}

impl TimedResultant {
    fn value(&self, t: f64) -> Result<Resultant> {
        let mut sum = self.constant;
        for (time, resultant) in &self.terms {
            sum.add(time.at(Point::origin(), t)?, *resultant);
        }
        Ok(sum)
    }

    /// Returns a bound on the magnitudes of the [parts](Resultant::parts), added up, between two
    /// instants (s).
    fn bound(&self, from: f64, to: f64, arm: f64) -> f64 {
        let mut sums = self.constant.parts(arm).map(Interval::point);
        for (time, resultant) in &self.terms {
            let range = time.range(Point::origin(), from, to);
            for (sum, part) in sums.iter_mut().zip(resultant.parts(arm)) {
                *sum = sum.plus(range.times(Interval::point(part)));
            }
        }
        sums.iter().map(|sum| sum.magnitude()).sum()
    }
}

/// Resultants of a load over the run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoadTotal {
    /// Key of the load in the scene.
    pub key: String,
    /// Resultant at the start.
    pub start: Resultant,
    /// Instant (s) and resultant of the largest load during the run, for time-dependent loads;
    /// among a hundred instants for a pressure that is no sum of products of time and place.
    pub largest: Option<(f64, Resultant)>,
}

/// Force, relative to the magnitudes of its parts, below which it is rounding.
const ROUNDING: f64 = 1e-12;

/// Number of instants at which time-dependent loads are evaluated for their resultants. Between two
/// of them the largest one is sought by halving where the bounds of the load exceed it.
const INSTANTS: u64 = 1000;
/// Excess of a bound over the largest load, relative to it, up to which there is no further search,
/// and the largest number of bounds.
const CLOSE: f64 = 1e-6;
const MOST_BOUNDS: u64 = 50_000;

/// Number of instants for loads that must be integrated at each.
const WAVE_INSTANTS: u64 = 100;

/// Returns the resultants of all loads, on a single process.
pub(in crate::simulation) fn totals<P: Partition>(ground: &BuildContext<P>) -> Result<Vec<LoadTotal>> {
    phase("loads");
    let BuildContext { scene, mesh, .. } = ground;
    let arm = mesh.nodes.iter().fold(0.0, |m: f64, p| m.max(p.coords.norm()));
    let resultant = |load: &[f64]| Resultant::of(&mesh.nodes, load, arm);
    let push = |total: Resultant| total.parts(arm).iter().map(|part| part.abs()).sum::<f64>();
    let end = scene.time.end;
    let among = |instants: u64, value: &dyn Fn(f64) -> Result<Resultant>| {
        let instants = instants.min(scene.time.steps());
        let times: Vec<f64> = (0..=instants).map(|k| end * k as f64 / instants as f64).collect();
        let mut largest = (0.0, value(0.0)?);
        for &t in &times {
            let total = value(t)?;
            if push(total) > push(largest.1) {
                largest = (t, total);
            }
        }
        Ok::<_, crate::Error>((times, largest))
    };
    let over_time = |load: &TimedResultant| {
        let (times, mut largest) = among(INSTANTS, &|t| load.value(t))?;
        let mut pending: Vec<[f64; 2]> = times.windows(2).map(|ends| [ends[0], ends[1]]).collect();
        for _ in 0..MOST_BOUNDS {
            let Some([from, to]) = pending.pop() else { break };
            let middle = 0.5 * (from + to);
            let is_short = to - from <= f64::EPSILON * end;
            if is_short || load.bound(from, to, arm) <= (1.0 + CLOSE) * push(largest.1) {
                continue;
            }
            // The run need not evaluate the load at this instant, where it may have no value.
            if let Some(total) = load.value(middle).ok().filter(|total| push(*total) > push(largest.1)) {
                largest = (middle, total);
            }
            pending.extend([[from, middle], [middle, to]]);
        }
        Ok::<_, crate::Error>(largest)
    };
    let mut totals = Vec::new();
    let initial = &scene.initial.static_pressure;
    if !initial.is_zero() {
        let start = resultant(&ground.pressed(initial)?);
        totals.push(LoadTotal { key: initial.key.clone(), start, largest: None });
    }
    for load in &ground.terms.loads {
        let Loads { constant, terms, waves } = Loads::new(ground, std::slice::from_ref(load))?;
        let terms: Vec<_> = terms.into_iter().map(|(time, load)| (time, resultant(&load))).collect();
        let timed = TimedResultant { constant: resultant(&constant), terms };
        let (start, largest) = match waves.first() {
            Some(wave) => {
                let value = |t: f64| Ok(resultant(&wave.load(t)?));
                (value(0.0)?, Some(among(WAVE_INSTANTS, &value)?.1))
            }
            None if timed.terms.is_empty() => (timed.constant, None),
            None => (timed.value(0.0)?, Some(over_time(&timed)?)),
        };
        totals.push(LoadTotal { key: load.key.clone(), start, largest });
    }
    Ok(totals)
}

impl<P: Partition> Loads<P> {
    /// Integrates the parts of some loads that can be integrated in advance. Collective.
    pub fn new(ground: &BuildContext<P>, loads: &[Load]) -> Result<Loads<P>> {
        let BuildContext { mesh, cells, gaps, .. } = ground;
        let of_nodes = PER_NODE * mesh.nodes.len();
        let zeros = vec![0.0; of_nodes + gaps.len()];
        let mut sum = Loads { constant: zeros.clone(), terms: Vec::new(), waves: Vec::new() };
        for load in loads {
            match &load.law {
                LoadLaw::Weight(gravity) => {
                    let (law, amplitude) = gravity.law();
                    let mut weight = assembly::weight(&assembly::unheld(mesh, cells), zeros.len(), amplitude);
                    for PointTerm { amount, spot, .. } in ground.terms.masses() {
                        spot.of_shape.push(-amount * amplitude, &mut weight);
                    }
                    for Body { number, mass, .. } in &ground.terms.bodies {
                        weight[of_nodes + number] -= mass.amount * amplitude;
                    }
                    match law.number() {
                        Some(factor) => axpy(factor, &weight, &mut sum.constant),
                        None => sum.terms.push((law, weight)),
                    }
                }
                LoadLaw::Pressure(pressure) => {
                    let pressed = |place: &FieldInput| {
                        let mut load = ground.pressed(place)?;
                        load.resize(zeros.len(), 0.0);
                        Ok::<_, crate::Error>(load)
                    };
                    if !pressure.changes() {
                        vectors::add(&pressed(pressure)?, &mut sum.constant);
                    } else if let Some(terms) = pressure.terms() {
                        for [time, place] in terms {
                            match time.number() {
                                Some(factor) => axpy(factor, &pressed(&place)?, &mut sum.constant),
                                None => sum.terms.push((time, pressed(&place)?)),
                            }
                        }
                    } else {
                        sum.waves.push(Rc::new(Wave::new(ground, pressure)?));
                    }
                }
                LoadLaw::Force(value, spot) => match value.number() {
                    Some(force) => spot.iter().for_each(|spot| spot.push(force, &mut sum.constant)),
                    None => {
                        let ((law, amplitude), mut load) = (value.law(), zeros.clone());
                        spot.iter().for_each(|spot| spot.push(amplitude, &mut load));
                        sum.terms.push((law, load));
                    }
                },
            }
        }
        Ok(sum)
    }

    /// Returns the loads at some nodes.
    pub fn at_nodes(&self, nodes: Vec<usize>) -> LoadsAtNodes<P> {
        let terms = self.terms.iter().map(|(time, load)| (time.clone(), at_nodes(&nodes, load)));
        let (constant, waves) = (at_nodes(&nodes, &self.constant), self.waves.clone());
        LoadsAtNodes { at_nodes: Loads { constant, terms: terms.collect(), waves }, nodes }
    }

    /// Returns the constant load on the engine's dofs, in N; `None` where it is zero. Collective.
    pub fn constant(&self, ground: &BuildContext<P>) -> Result<Option<Vec<f64>>> {
        if ground.terms.loads.is_empty() {
            return Ok(None);
        }
        let constant = ground.partition.add_up(&ground.local_load(&self.constant))?;
        let loaded = ground.comm().all_reduce_any(constant.iter().any(|f| f.abs() > 0.0));
        Ok(loaded.then_some(constant))
    }

    /// Returns the time-dependent loads on the engine's dofs: products of time and place, and
    /// waves. Collective.
    pub fn in_time(&self, ground: &BuildContext<P>) -> Result<(Vec<LoadTerm>, Option<Box<LoadOfTime>>)> {
        let term = |(factor, load): &(FieldInput, Vec<f64>)| {
            let (factor, load) = (factor.clone(), ground.partition.add_up(&ground.local_load(load))?);
            let law = factor.lone_formula().map(Field::canonical);
            Ok(LoadTerm { law, factor: Box::new(move |t| factor.at(Point::origin(), t)), load })
        };
        let terms = self.terms.iter().map(term).collect::<Result<_>>()?;
        let waves = self.waves.clone();
        let add = move |t, load: &mut [f64]| waves.iter().try_for_each(|wave| wave.add(t, load));
        let waves = (!self.waves.is_empty()).then(|| -> Box<LoadOfTime> { Box::new(add) });
        Ok((terms, waves))
    }
}

impl<P: Partition> LoadsAtNodes<P> {
    /// Subtracts the constant load, and the loads in time at instants (s) times their weights.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the loads' formulas.
    pub fn subtract(&self, instants: &[(f64, f64)], force: &mut [f64]) -> Result<()> {
        let Loads { constant, terms, waves } = &self.at_nodes;
        axpy(-1.0, constant, force);
        for (time, weight) in instants {
            for (factor, load) in terms {
                axpy(-weight * factor.at(Point::origin(), *time)?, load, force);
            }
            for wave in waves {
                axpy(-weight, &at_nodes(&self.nodes, &wave.load(*time)?), force);
            }
        }
        Ok(())
    }
}

/// Returns the entries at some nodes of a vector over all deflections and slopes.
fn at_nodes(nodes: &[usize], of_mesh: &[f64]) -> Vec<f64> {
    nodes.iter().flat_map(|&node| &of_mesh[PER_NODE * node..][..PER_NODE]).copied().collect()
}
