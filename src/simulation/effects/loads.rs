//! Loads of the plate: pressure, point forces, gravity.

use super::attached::Attached;
use super::ground::BuildContext;
use crate::assembly::{self, Pressure};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::element::adaptive::{self, Integrand, Rules, Triangle};
use crate::error::Result;
use crate::field::{Enclosure, Field, Interval};
use crate::linalg::vectors::{self, axpy};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::FieldInput;
use crate::scheme::{LoadOfTime, LoadTerm};
use crate::simulation::refinement::seen;
use serde::Serialize;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Loads on the dofs of this process's part of the mesh.
pub(super) struct LocalLoads<P: Partition> {
    /// Constant part of the load, in N.
    pub constant: Vec<f64>,
    /// Products of a factor g(t) and a load vector (N).
    pub terms: Vec<(FieldInput, Vec<f64>)>,
    wave: Option<Wave<P>>,
}

/// Loads on the engine's dofs.
pub(super) struct Loads<P: Partition> {
    /// Constant part of the load, in N; `None` where it is zero.
    pub constant: Option<Vec<f64>>,
    /// Products of a factor g(t) and a load vector (N).
    terms: Vec<(FieldInput, Vec<f64>)>,
    wave: Option<Wave<P>>,
}

/// Pressure that is no sum of products g(t) h(x, y), integrated at every instant.
struct Wave<P: Partition> {
    pressure: FieldInput,
    points: Pressure,
    pieces: Vec<Triangle>,
    /// Number of local dofs.
    dofs: usize,
    /// Time step, in s.
    step: f64,
    /// Index of the last time window tested and the result, by length of the window in steps.
    calm: RefCell<BTreeMap<u32, (u64, bool)>>,
    partition: P,
}

/// Lengths, in steps, of the time windows in which a wave is tested for being smooth enough for the
/// usual quadrature rule. Windows start at multiples of their length, so that a resumed run makes
/// the same tests.
const WINDOWS: [u32; 2] = [256, 16];

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

    fn side(&self, at: Point) -> u64 {
        self.pressure.still(self.from).side(at)
    }
}

impl<P: Partition> Wave<P> {
    /// Prepares the integration of a pressure. Collective.
    fn new(ground: &BuildContext<P>, pressure: &FieldInput) -> Result<Wave<P>> {
        let BuildContext { scene, mesh, cells, space, .. } = ground;
        Ok(Wave {
            pressure: pressure.clone(),
            points: ground.comm().all_ok(Pressure::new(mesh, cells))?,
            pieces: ground.comm().all_ok(assembly::pieces(mesh))?,
            dofs: space.dofs(),
            step: scene.time.step,
            calm: RefCell::default(),
            partition: ground.partition.clone(),
        })
    }

    /// Returns whether the usual quadrature rule suffices in the window of `steps` steps around an
    /// instant (s). Collective.
    fn is_calm(&self, t: f64, steps: u32) -> Result<bool> {
        let length = f64::from(steps) * self.step;
        let number = (t / length).floor().max(0.0);
        let known = self.calm.borrow().get(&steps).copied();
        if let Some((_, calm)) = known.filter(|(known, _)| *known == number as u64) {
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
        seen(&self.pressure.key, refined)
    }

    /// Adds the load at an instant (s) to `load`, in N. Collective.
    fn add(&self, t: f64, load: &mut [f64]) -> Result<()> {
        vectors::add(&self.partition.add_up(&self.load(t)?)?, load);
        Ok(())
    }

    /// Returns the load at an instant (s), in N, on the local dofs. Collective.
    fn load(&self, t: f64) -> Result<Vec<f64>> {
        let mut local = vec![0.0; self.dofs];
        let rules = self.rules(t);
        let pressure = |points: &[Point], values: &mut [f64]| self.pressure.values(points, t, values);
        self.partition
            .comm()
            .all_ok(rules.and_then(|rules| self.points.load_by(&rules, pressure, &mut local)))?;
        Ok(local)
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
    /// per node.
    fn of(nodes: &[Point], load: &[f64]) -> Resultant {
        let mut sum = Resultant::default();
        for (node, of) in nodes.iter().zip(load.chunks_exact(PER_NODE)) {
            sum.force += of[0];
            sum.moments[0] += of[0] * node.y + of[2];
            sum.moments[1] -= of[0] * node.x + of[1];
        }
        sum
    }

    fn add(&mut self, factor: f64, of: Resultant) {
        self.force += factor * of.force;
        (0..2).for_each(|k| self.moments[k] += factor * of.moments[k]);
    }

    /// Returns force and moments, the force times an arm (m), in N m.
    fn parts(self, arm: f64) -> [f64; 3] {
        [self.force * arm, self.moments[0], self.moments[1]]
    }
}

/// Load that is a sum of products of a factor of time and a resultant.
struct TimedResultant(Vec<(FieldInput, Resultant)>);

impl TimedResultant {
    fn value(&self, t: f64) -> Result<Resultant> {
        let mut sum = Resultant::default();
        for (time, of) in &self.0 {
            sum.add(time.at(Point::origin(), t)?, *of);
        }
        Ok(sum)
    }

    /// Returns a bound on the magnitudes of the [parts](Resultant::parts), added up, between two
    /// instants (s).
    fn bound(&self, from: f64, to: f64, arm: f64) -> f64 {
        let mut sums = [Interval::point(0.0); 3];
        for (time, of) in &self.0 {
            let range = time.range(Point::origin(), from, to);
            for (sum, part) in sums.iter_mut().zip(of.parts(arm)) {
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

/// Number of instants at which time-dependent loads are evaluated for their resultants. Between two
/// of them the largest one is sought by halving where the bounds of the load exceed it.
const INSTANTS: u64 = 1000;
/// Excess of a bound over the largest load, relative to it, up to which there is no further search,
/// and the largest number of bounds.
const CLOSE: f64 = 1e-6;
const MOST_BOUNDS: u64 = 50_000;

/// Number of instants for loads that must be integrated at each.
const WAVE_INSTANTS: u64 = 100;

/// Returns the resultants of all loads. The build context must have all dofs free and a single
/// process.
pub(super) fn totals<P: Partition>(ground: &BuildContext<P>, attached: &Attached) -> Result<Vec<LoadTotal>> {
    let BuildContext { scene, mesh, cells, space, .. } = ground;
    let of = |load: &[f64]| Resultant::of(&mesh.nodes, load);
    let still = |key: &str, load: &[f64]| LoadTotal { key: key.into(), start: of(load), largest: None };
    let mut totals = Vec::new();
    let initial = &scene.initial.static_pressure;
    if !initial.is_zero() {
        totals.push(still(&initial.key, &ground.pressed(initial)?));
    }
    let Some(load) = &scene.load else { return Ok(totals) };
    if load.gravity != 0.0 {
        let mut weight = assembly::weight(cells, space.dofs(), load.gravity);
        attached.add_weight(load.gravity, &mut weight);
        totals.push(still("load.gravity", &weight));
    }
    let arm = mesh.nodes.iter().fold(0.0, |m: f64, p| m.max(p.coords.norm()));
    let push = |of: Resultant| of.parts(arm).iter().map(|part| part.abs()).sum::<f64>();
    let end = scene.time.end;
    let among = |instants: u64, at: &dyn Fn(f64) -> Result<Resultant>| {
        let instants = instants.min(scene.time.steps());
        let times: Vec<f64> = (0..=instants).map(|k| end * k as f64 / instants as f64).collect();
        let mut largest = (0.0, at(0.0)?);
        for &t in &times {
            let of = at(t)?;
            if push(of) > push(largest.1) {
                largest = (t, of);
            }
        }
        Ok::<_, crate::Error>((times, largest))
    };
    let over_time = |key: &str, load: &TimedResultant| {
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
            if let Some(of) = load.value(middle).ok().filter(|of| push(*of) > push(largest.1)) {
                largest = (middle, of);
            }
            pending.extend([[from, middle], [middle, to]]);
        }
        let start = load.value(0.0)?;
        Ok::<_, crate::Error>(LoadTotal { key: key.into(), start, largest: Some(largest) })
    };
    let pressure = &load.pressure;
    if !pressure.changes() {
        if !pressure.is_zero() {
            totals.push(still(&pressure.key, &ground.pressed(pressure)?));
        }
    } else if let Some(terms) = pressure.terms() {
        let term =
            |[time, place]: [FieldInput; 2]| Ok::<_, crate::Error>((time, of(&ground.pressed(&place)?)));
        let terms = terms.into_iter().map(term).collect::<Result<_>>()?;
        totals.push(over_time(&pressure.key, &TimedResultant(terms))?);
    } else {
        let wave = Wave::new(ground, pressure)?;
        let value = |t: f64| Ok(of(&wave.load(t)?));
        let (_, largest) = among(WAVE_INSTANTS, &value)?;
        totals.push(LoadTotal { key: pressure.key.clone(), start: value(0.0)?, largest: Some(largest) });
    }
    for (number, force) in load.forces.iter().enumerate() {
        let mut unit = vec![0.0; space.dofs()];
        if let Some(spot) = ground.spot(&format!("load.force.{number}.at"), force.at)? {
            spot.free.push(1.0, &mut unit);
        }
        let key = format!("load.force.{number}");
        let load = TimedResultant(vec![(force.value.clone(), of(&unit))]);
        totals.push(match force.value.changes() {
            true => over_time(&key, &load)?,
            false => LoadTotal { key, start: load.value(0.0)?, largest: None },
        });
    }
    Ok(totals)
}

impl<P: Partition> LocalLoads<P> {
    /// Integrates the loads that can be integrated in advance. Collective.
    pub fn new(ground: &BuildContext<P>, attached: &Attached) -> Result<LocalLoads<P>> {
        let BuildContext { scene, cells, space, .. } = ground;
        let dofs = space.dofs();
        let mut loads = LocalLoads { constant: vec![0.0; dofs], terms: Vec::new(), wave: None };
        let Some(load) = &scene.load else { return Ok(loads) };
        let constant = &mut loads.constant;
        if load.gravity != 0.0 {
            vectors::add(&assembly::weight(cells, dofs, load.gravity), constant);
            attached.add_weight(load.gravity, constant);
        }
        if !load.pressure.changes() {
            vectors::add(&ground.pressed(&load.pressure)?, constant);
        } else if let Some(terms) = load.pressure.terms() {
            for [time, place] in terms {
                let load = ground.pressed(&place)?;
                match time.number() {
                    Some(factor) => axpy(factor, &load, constant),
                    None => loads.terms.push((time, load)),
                }
            }
        } else {
            loads.wave = Some(Wave::new(ground, &load.pressure)?);
        }
        for (number, force) in load.forces.iter().enumerate() {
            let mut unit = vec![0.0; dofs];
            if let Some(spot) = ground.spot(&format!("load.force.{number}.at"), force.at)? {
                spot.free.push(1.0, &mut unit);
            }
            if let Some(value) = force.value.number() {
                axpy(value, &unit, constant);
                continue;
            }
            let (law, amplitude) = force.value.law();
            vectors::scale(amplitude, &mut unit);
            loads.terms.push((law, unit));
        }
        Ok(loads)
    }

    /// Returns the load of changing distribution at an instant (s), in N; `None` if there is none.
    /// Collective.
    pub fn wave(&self, t: f64) -> Result<Option<Vec<f64>>> {
        self.wave.as_ref().map(|wave| wave.load(t)).transpose()
    }
}

impl<P: Partition> Loads<P> {
    /// Integrates the loads that can be integrated in advance. Collective.
    pub fn new(ground: &BuildContext<P>, attached: &Attached) -> Result<Loads<P>> {
        let LocalLoads { constant, terms, wave } = LocalLoads::new(ground, attached)?;
        if ground.scene.load.is_none() {
            return Ok(Loads { constant: None, terms: Vec::new(), wave });
        }
        let partition = ground.partition;
        let add_up = |(factor, load): (FieldInput, Vec<f64>)| Ok((factor, partition.add_up(&load)?));
        let terms = terms.into_iter().map(add_up).collect::<Result<_>>()?;
        let constant = partition.add_up(&constant)?;
        let loaded = ground.comm().all_reduce_any(constant.iter().any(|f| f.abs() > 0.0));
        Ok(Loads { constant: loaded.then_some(constant), terms, wave })
    }

    /// Adds the time-dependent loads at an instant (s) to `load`, in N. Collective.
    pub fn add(&self, t: f64, load: &mut [f64]) -> Result<()> {
        for (factor, of) in &self.terms {
            axpy(factor.at(Point::origin(), t)?, of, load);
        }
        if let Some(wave) = &self.wave {
            wave.add(t, load)?;
        }
        Ok(())
    }

    /// Returns the time-dependent loads: those of fixed distribution, and the wave.
    pub fn in_time(self) -> (Vec<LoadTerm>, Option<Box<LoadOfTime>>)
    where
        P: 'static,
    {
        let term = |(factor, load): (FieldInput, Vec<f64>)| LoadTerm {
            law: factor.formula().map(Field::canonical),
            factor: Box::new(move |t| factor.at(Point::origin(), t)),
            load,
        };
        let wave = self.wave.map(|wave| -> Box<LoadOfTime> { Box::new(move |t, load| wave.add(t, load)) });
        (self.terms.into_iter().map(term).collect(), wave)
    }
}
