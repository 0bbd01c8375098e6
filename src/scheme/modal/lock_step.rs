//! Newmark runs of equal systems in lock step, in the modes that carry inertia.
//!
//! A displacement is the sum of the modes and of a massless part, which reactions r, loads of fixed
//! distribution and the start move along few directions:
//!
//! ```math
//! U = \Phi q + H s + W p + e\, c .
//! ```
//!
//! H is the response of the massless part to unit reactions, W that to the loads, and e the
//! massless part of the start. No two of these coordinates are coupled, so that a step of the
//! scheme is a division for each, and a contact problem [in compliance form](crate::vi::compliance)
//! for each system that touches:
//!
//! ```math
//! \Bigl( \frac{\mu}{\Delta t^2} + \beta k + \frac{d}{2 \Delta t} \Bigr) x
//!    = g - k z^n - d\, \frac{z^n - z^{n-1}}{\Delta t} ,
//! ```
//!
//! with `$\mu = 1$`, `$k = \omega^2$` and `$g = \Phi^T (F + G^T r)$` for a mode, and `$\mu = 0$`,
//! `$k = 1$` and g = r, the factor of the load, or 0 for the others. The modes are those of the
//! modal mass, or with a mass of cells all modes with inertia, of which the paper's singular mass
//! has no more than cells. Lanes lane of the registers of the processor computes for one system.
//!
//! The modal mass and a mass of cells differ in their massless part. That of the modal mass follows
//! the loads at once, has no damping and starts in equilibrium (see [`super::newmark`]). With a
//! mass of cells it obeys the scheme like all else, and Rayleigh damping acts on it.

mod lane_levels;

use super::all_bounds::AllBounds;
use super::contact_model::{BoundRows, ContactModel};
use super::data::{ModalData, ModalLoads};
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, Form, Lanes, MassModes, Native};
use crate::modes::modes_with_mass;
use crate::obstacle::Bounds;
use crate::scheme::exact::modal_saddle_point::ModalSaddlePoint;
use crate::scheme::{
    Approach, NewmarkParameters, Scheme, SideBySide, Start, StepBalance, StepRecord, System,
};
use crate::vi::ComplianceSolver;
use faer::Mat;
use lane_levels::{Data, Equations, LaneLevels, Launch, MasslessPart, ZERO, along, each};
use std::cell::{OnceCell, RefCell};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Largest numbers of dofs and of bounds for which all modes with inertia pay.
const MOST_DOFS: usize = 600;
const MOST_BOUNDS: usize = 24;
/// Largest number of mode shapes at bounds for which steps in lock step, which evaluate all of
/// them, cost less than those of [`ModalScheme`](super::ModalScheme), which seldom do.
const MOST_SHAPES: usize = 2000;

/// Modes and compliance of equal systems whose runs go in lock step.
pub struct SharedModes<'s> {
    system: &'s System<Native>,
    modes: Rc<MassModes>,
    massless: MasslessPart,
    saddle: ModalSaddlePoint<'s, Native>,
    all: Rc<AllBounds>,
    /// Massless responses at all bounds; without candidates where there are none.
    model: ContactModel,
    /// Mode shapes at the bounds, one column each.
    rows: Mat<f64>,
}

impl<'s> SharedModes<'s> {
    /// Returns the modes in which a system goes in lock step with others; `None` where it does not,
    /// since there are too many of them, or rounding spoils them.
    ///
    /// # Errors
    /// Returns the errors of the dense eigenvalues.
    pub fn modes(system: &System<Native>) -> Result<Option<Rc<MassModes>>> {
        let System { engine, stiffness, mass, bounds, drive, .. } = system;
        if !SideBySide::takes(system) || drive.load.is_some() {
            return Ok(None);
        }
        if let Form::Modal { modes, .. } = mass {
            return Ok((modes.count() * bounds.len() <= MOST_SHAPES).then(|| modes.clone()));
        }
        if engine.dofs() > MOST_DOFS || bounds.len() > MOST_BOUNDS {
            return Ok(None);
        }
        Ok(modes_with_mass(engine, stiffness, mass)?.map(Rc::new))
    }

    /// Computes the massless responses of a system with given modes, at all bounds.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the modes leave the bounded dofs no compliance of their own,
    /// and the errors of the engine.
    pub fn new(system: &'s System<Native>, modes: &Rc<MassModes>) -> Result<SharedModes<'s>> {
        let System { engine, mass, bounds, .. } = system;
        let (massless, inertia) = match mass {
            Form::Modal { consistent, .. } => (MasslessPart::Follows, Form::Cells(consistent.clone())),
            _ if modes.count() == engine.dofs() => (MasslessPart::None, mass.clone()),
            _ => (MasslessPart::Swings, mass.clone()),
        };
        let saddle = ModalSaddlePoint::new(system, &inertia, modes)?;
        let all = Rc::new(AllBounds::new(system));
        let comm = engine.comm();
        let rows = all.shapes(comm, modes)?;
        let mut model = ContactModel::new(bounds.size);
        let numbers: Vec<usize> = (0..bounds.len()).collect();
        if massless != MasslessPart::None && !numbers.is_empty() {
            let at = BoundRows { shapes: &rows, places: &numbers, lanes: numbers.len() };
            model.extend(&saddle, &all, &all.limits(comm, bounds), at, &numbers)?;
        }
        Ok(SharedModes { system, modes: modes.clone(), massless, saddle, all, model, rows })
    }

    /// Starts one Newmark run per system, up to as many as a register has lanes, with the same
    /// parameters. The runs advance in turn, each by one step.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the loads.
    pub fn start(
        &'s self,
        systems: &[&'s System<Native>],
        parameters: NewmarkParameters,
        starts: &[Start],
    ) -> Result<Vec<ModeLane<'s>>> {
        let loads =
            systems.iter().map(|system| ModalLoads::new(system, &self.modes, &self.saddle, &self.all));
        let loads: Vec<ModalLoads> = loads.collect::<Result<_>>()?;
        let laws = LoadLaws::new(systems);
        let terms = laws.count();
        let [mut now, mut next] = [0.0, parameters.step].map(|_| vec![ZERO; terms]);
        laws.set(0.0, &mut now)?;
        laws.set(parameters.step, &mut next)?;
        let lanes = systems.iter().zip(starts).zip(&loads).enumerate();
        let lanes = lanes.map(|(lane, ((_, start), loads))| self.lane_start(lane, start, loads, &now));
        let lanes: Vec<LaneStart> = lanes.collect::<Result<_>>()?;
        let (z, launch) = self.gather_starts(terms, &now, &lanes);
        let data = self.data(systems, terms, &loads, &lanes);
        let equations = self.equations(parameters, z.len());
        let levels = LaneLevels::new(equations, data, systems.len(), z, [now, next], &launch);
        let runs = LaneRuns {
            shared: self,
            laws,
            levels,
            loads,
            starts: lanes,
            step: 0,
            dt: parameters.step,
            at_dofs: RefCell::default(),
        };
        let runs = Rc::new(RefCell::new(runs));
        let lane = |(lane, &system): (usize, &&'s System<Native>)| {
            let record = StepRecord {
                candidates: Some(Vec::new()),
                ..StepRecord::new(parameters.step, system.bounds.len())
            };
            let mut run = ModeLane { runs: runs.clone(), lane, system, record, shown: OnceCell::new() };
            run.refresh(&runs.borrow());
            run
        };
        Ok(systems.iter().enumerate().map(lane).collect())
    }

    /// Returns the equations of a number of coordinates.
    fn equations(&self, parameters: NewmarkParameters, size: usize) -> Equations {
        let NewmarkParameters { beta, step: dt, .. } = parameters;
        let (modes, squares) = (self.modes.count(), &self.modes.squares);
        let massless = size - modes;
        let slow = if self.massless == MasslessPart::Swings { self.system.damping.stiffness } else { 0.0 };
        let mut decay = self.system.decay_rates(&self.modes);
        decay.extend(vec![slow; massless]);
        let mut stiffness = squares.clone();
        stiffness.extend(vec![1.0; massless]);
        let inverse = |j: usize| {
            let inertia = if j < modes { 1.0 / (dt * dt) } else { 0.0 };
            1.0 / (inertia + beta * stiffness[j] + 0.5 * decay[j] / dt)
        };
        let inverse: Vec<f64> = (0..size).map(inverse).collect();
        let compliance = &self.model.compliance;
        let row = |i: usize| {
            let mut row = self.rows.col_as_slice(i).to_vec();
            row.extend((0..compliance.ncols()).map(|j| compliance[(i, j)]));
            row
        };
        let rows: Vec<Vec<f64>> = (0..self.rows.ncols()).map(row).collect();
        let entry = |i: usize, j: usize| {
            let inertial: f64 = (0..modes).map(|k| inverse[k] * rows[i][k] * rows[j][k]).sum();
            inertial + rows[i].get(modes + j).map_or(0.0, |of| of * inverse[modes + j])
        };
        Equations {
            compliance: Mat::from_fn(rows.len(), rows.len(), |i, j| 0.5 * (entry(i, j) + entry(j, i))),
            parameters,
            massless: self.massless,
            modes,
            stiffness,
            decay: decay.iter().map(|decay| decay / dt).collect(),
            inverse,
            rows,
        }
    }

    /// Returns the start of one lane, given the factors of the loads there.
    fn lane_start(
        &self,
        lane: usize,
        start: &Start,
        loads: &ModalLoads,
        factors: &[Lanes],
    ) -> Result<LaneStart> {
        let SharedModes { system, modes, massless, model, rows, .. } = self;
        let Start { displacement, velocity } = start;
        let (mut q, mut v) = (vec![0.0; modes.count()], vec![0.0; modes.count()]);
        modes.project(displacement, &mut q);
        modes.project(velocity, &mut v);
        let bounds = &system.bounds;
        let of_modes = |of: &[f64]| (0..rows.ncols()).map(|i| dot(rows.col_as_slice(i), of)).collect();
        let mut own = LaneStart {
            bounded_velocity: match massless {
                MasslessPart::Swings => bounds.dofs.iter().map(|&dof| velocity[dof]).collect(),
                _ => of_modes(&v),
            },
            reaction: vec![0.0; model.candidates.len()],
            massless: Vec::new(),
            velocity: velocity.clone(),
            work: 0.0,
            q,
            v,
        };
        let data = ModalData { factors: own_factors(loads, factors, lane), ..ModalData::default() };
        match massless {
            MasslessPart::None => {}
            MasslessPart::Follows => {
                let limits = &loads.limits;
                let shift = loads.shift(&data);
                let free: Vec<f64> = of_modes(&own.q);
                let free: Vec<f64> = free.iter().zip(&shift).map(|(q, shift)| q + shift).collect();
                let mut x = free.clone();
                let problem = model.problem(&free, &limits.lower, &limits.upper);
                ComplianceSolver::new(free.len()).solve(problem, &mut x, &mut own.reaction);
                let every: Vec<usize> = (0..free.len()).collect();
                own.work = loads.work(&data, &own.q, &every, &own.reaction)
                    - loads.elastic(&data)
                    - dot(&own.reaction, &shift)
                    - dot(loads.constant_force(), &own.q);
            }
            MasslessPart::Swings => {
                own.massless = displacement.clone();
                for (k, q) in own.q.iter().enumerate() {
                    axpy(-q, modes.shapes.col_as_slice(k), &mut own.massless);
                }
                let mut response = vec![0.0; displacement.len()];
                loads.add_response(&data, &mut response);
                axpy(-1.0, &response, &mut own.massless);
            }
        }
        Ok(own)
    }

    /// Returns the coordinates at the start, and the initial velocities.
    fn gather_starts(&self, terms: usize, factors: &[Lanes], lanes: &[LaneStart]) -> (Vec<Lanes>, Launch) {
        let gathered = |of: &dyn Fn(&LaneStart) -> &[f64], count: usize| -> Vec<Lanes> {
            (0..count).map(|j| each(|k| lanes.get(k).map_or(0.0, |lane| of(lane)[j]))).collect()
        };
        let modes = self.modes.count();
        let mut z = gathered(&|lane| &lane.q, modes);
        let launch = Launch {
            modes: gathered(&|lane| &lane.v, modes),
            bounded: gathered(&|lane| &lane.bounded_velocity, self.rows.ncols()),
        };
        if self.massless != MasslessPart::None {
            z.extend(gathered(&|lane| &lane.reaction, self.model.candidates.len()));
            z.extend(&factors[..terms]);
        }
        if self.massless == MasslessPart::Swings {
            z.push(each(|_| 1.0));
        }
        (z, launch)
    }

    /// Returns loads, bounds and starts of all lanes.
    fn data(
        &self,
        systems: &[&System<Native>],
        terms: usize,
        loads: &[ModalLoads],
        lanes: &[LaneStart],
    ) -> Data {
        let bounded = &self.system.bounds.dofs;
        let (has_massless, swings) =
            (self.massless != MasslessPart::None, self.massless == MasslessPart::Swings);
        let of_load = |of: &dyn Fn(&ModalLoads) -> &Mat<f64>, row: usize, load: usize| {
            each(|k| loads.get(k).map_or(0.0, |loads| entry(of(loads), row, load)))
        };
        let start_at = |dof: usize| each(|k| lanes.get(k).map_or(0.0, |lane| lane.massless[dof]));
        let row = |i: usize| {
            let mut row: Vec<Lanes> = Vec::new();
            if has_massless {
                row.extend((0..terms).map(|load| of_load(&|loads| &loads.shifts, i, load)));
            }
            if swings {
                row.push(start_at(bounded[i]));
            }
            row
        };
        let force = |load: usize| {
            let modes = 0..self.modes.count();
            let mut forces: Vec<Lanes> =
                modes.map(|mode| of_load(&|loads| &loads.forces, mode, load)).collect();
            if swings {
                let shifts = 0..bounded.len();
                forces.extend(shifts.map(|i| of_load(&|loads| &loads.shifts, i, load)));
                forces.extend((0..terms).map(|other| of_load(&|loads| &loads.energies, other, load)));
                let own = |k: usize, lane: &LaneStart| {
                    load_of(systems[k], load).map_or(0.0, |force| dot(force, &lane.massless))
                };
                forces.push(each(|k| lanes.get(k).map_or(0.0, |lane| own(k, lane))));
            }
            forces
        };
        let bound = |of: fn(&Bounds) -> &[f64], absent: f64| -> Vec<Lanes> {
            let at = |i: usize| each(|k| systems.get(k).map_or(absent, |system| of(&system.bounds)[i]));
            (0..bounded.len()).map(at).collect()
        };
        Data {
            rows: (0..bounded.len()).map(row).collect(),
            forces: (0..terms).map(force).collect(),
            lower: bound(|bounds| &bounds.lower, f64::NEG_INFINITY),
            upper: bound(|bounds| &bounds.upper, f64::INFINITY),
            magnitude: each(|k| systems.get(k).map_or(0.0, |system| system.bounds.magnitude())),
        }
    }
}

/// Returns an entry of a matrix, 0 beyond its columns.
fn entry(matrix: &Mat<f64>, row: usize, column: usize) -> f64 {
    if row < matrix.nrows() && column < matrix.ncols() { matrix[(row, column)] } else { 0.0 }
}

/// Returns a load of a system, the constant one first; `None` where it has none of this number.
fn load_of(system: &System<Native>, load: usize) -> Option<&[f64]> {
    match load.checked_sub(1) {
        None => system.load.as_deref(),
        Some(term) => system.drive.terms.get(term).map(|term| &*term.load),
    }
}

/// Returns the factors of the loads of one lane.
fn own_factors(loads: &ModalLoads, factors: &[Lanes], lane: usize) -> Vec<f64> {
    factors[..loads.count()].iter().map(|factors| factors.0[lane]).collect()
}

/// Laws in time of the loads of all lanes.
struct LoadLaws<'s> {
    systems: Vec<&'s System<Native>>,
    /// First lane with the same law as a lane, one entry per term of each system.
    first: Vec<Vec<usize>>,
}

impl<'s> LoadLaws<'s> {
    fn new(systems: &[&'s System<Native>]) -> LoadLaws<'s> {
        let law = |lane: usize, term: usize| systems[lane].drive.terms.get(term)?.law.as_ref();
        let first = |lane: usize, term: usize| {
            let own = law(lane, term);
            (0..lane).find(|&other| own.is_some() && law(other, term) == own).unwrap_or(lane)
        };
        let of_lane =
            |lane: usize| (0..systems[lane].drive.terms.len()).map(|term| first(lane, term)).collect();
        LoadLaws { systems: systems.to_vec(), first: (0..systems.len()).map(of_lane).collect() }
    }

    /// Returns the number of loads, with a constant one.
    fn count(&self) -> usize {
        1 + self.first.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Sets the factors of the loads at an instant (s): 1 for the constant one, which is the first.
    fn set(&self, time: f64, factors: &mut [Lanes]) -> Result<()> {
        factors[0] = each(|_| 1.0);
        for (lane, (system, first)) in self.systems.iter().zip(&self.first).enumerate() {
            for ((factors, term), &first) in factors[1..].iter_mut().zip(&system.drive.terms).zip(first) {
                factors.0[lane] = if first < lane { factors.0[first] } else { (term.factor)(time)? };
            }
        }
        Ok(())
    }
}

/// Start of one lane.
struct LaneStart {
    /// Modal coordinates and velocities.
    q: Vec<f64>,
    v: Vec<f64>,
    /// Initial velocities of the bounded dofs, in m/s.
    bounded_velocity: Vec<f64>,
    /// Reactions in which a massless part that follows the loads starts, in N.
    reaction: Vec<f64>,
    /// Massless part e of the start, in m, one entry per dof; empty unless it swings.
    massless: Vec<f64>,
    /// Initial velocity, in m/s, one entry per dof.
    velocity: Vec<f64>,
    /// Work of the constant load up to the start, less the energies there that count as work.
    work: f64,
}

/// Runs of all lanes.
struct LaneRuns<'s> {
    shared: &'s SharedModes<'s>,
    laws: LoadLaws<'s>,
    levels: LaneLevels,
    loads: Vec<ModalLoads>,
    starts: Vec<LaneStart>,
    step: u64,
    dt: f64,
    at_dofs: RefCell<BTreeMap<usize, DofRow>>,
}

/// Deflections of a dof per unit of the coordinates, and the present ones.
struct DofRow {
    shared: Vec<f64>,
    own: Vec<Lanes>,
    deflections: Lanes,
    step: u64,
}

impl LaneRuns<'_> {
    fn advance(&mut self) -> Result<()> {
        self.step += 1;
        let LaneRuns { laws, levels, step, dt, .. } = self;
        let ahead = (*step + 1) as f64 * *dt;
        let mut outcome = Ok(());
        levels.advance(|factors| outcome = laws.set(ahead, factors));
        outcome
    }

    /// Returns the vector over the dofs of one lane with given coordinates.
    fn vector(&self, lane: usize, coordinate: impl Fn(usize) -> f64) -> Vec<f64> {
        let SharedModes { system, modes, massless, model, .. } = self.shared;
        let mut u = vec![0.0; system.engine.dofs()];
        let mut at = modes.count();
        (0..at).for_each(|k| axpy(coordinate(k), modes.shapes.col_as_slice(k), &mut u));
        if *massless == MasslessPart::None {
            return u;
        }
        for column in &model.flexibility {
            axpy(coordinate(at), column, &mut u);
            at += 1;
        }
        let terms = self.levels.factors[1].len();
        let factors = (at..at + self.loads[lane].count()).map(&coordinate).collect();
        self.loads[lane].add_response(&ModalData { factors, ..ModalData::default() }, &mut u);
        if *massless == MasslessPart::Swings {
            axpy(coordinate(at + terms), &self.starts[lane].massless, &mut u);
        }
        u
    }

    /// Returns the deflections of a dof in all lanes, in m.
    fn deflections(&self, dof: usize) -> Lanes {
        if let Ok(bound) = self.shared.system.bounds.dofs.binary_search(&dof) {
            return self.levels.u[bound];
        }
        let mut rows = self.at_dofs.borrow_mut();
        let row = rows.entry(dof).or_insert_with(|| self.dof_row(dof));
        if row.step != self.step {
            row.step = self.step;
            row.deflections = along(&row.shared, &row.own, &self.levels.z);
        }
        row.deflections
    }

    fn dof_row(&self, dof: usize) -> DofRow {
        let SharedModes { modes, massless, model, .. } = self.shared;
        let mut shared: Vec<f64> = (0..modes.count()).map(|k| modes.shapes[(dof, k)]).collect();
        let mut own: Vec<Lanes> = Vec::new();
        if *massless != MasslessPart::None {
            shared.extend(model.flexibility.iter().map(|column| column[dof]));
            let terms = self.levels.factors[1].len();
            let response = |load: usize| {
                each(|k| self.loads.get(k).map_or(0.0, |loads| entry(&loads.responses, dof, load)))
            };
            own.extend((0..terms).map(response));
        }
        if *massless == MasslessPart::Swings {
            own.push(each(|k| self.starts.get(k).map_or(0.0, |start| start.massless[dof])));
        }
        let deflections = along(&shared, &own, &self.levels.z);
        DofRow { shared, own, deflections, step: self.step }
    }

    /// Returns the work of all loads on one lane up to the present instant, in J, given its
    /// displacement.
    fn work(&self, lane: usize, u: &[f64]) -> Result<f64> {
        let SharedModes { massless, model, .. } = self.shared;
        let by_time = self.levels.work.0[lane];
        if *massless != MasslessPart::Follows {
            return Ok(self.laws.systems[lane].work(u)? + by_time);
        }
        // The work that reactions and loads do on the massless part is stored there.
        let (levels, loads, modes) = (&self.levels, &self.loads[lane], self.levels.modes());
        let data =
            ModalData { factors: own_factors(loads, &levels.factors[1], lane), ..ModalData::default() };
        let shift = loads.shift(&data);
        let reactions = (0..model.candidates.len()).map(|i| levels.z[modes + i].0[lane] * shift[i]);
        let constant = loads.constant_force().iter().zip(&levels.z).map(|(force, q)| force * q.0[lane]);
        let stored = loads.elastic(&data) + reactions.sum::<f64>();
        Ok(self.starts[lane].work + constant.sum::<f64>() + stored + by_time)
    }
}

/// Newmark run of one of several equal systems in lock step. The first of the runs that advances
/// solves the step for all. None may be two steps ahead of another.
pub struct ModeLane<'s> {
    runs: Rc<RefCell<LaneRuns<'s>>>,
    lane: usize,
    system: &'s System<Native>,
    record: StepRecord,
    /// Displacement, in m, one entry per dof, where it was asked for.
    shown: OnceCell<Vec<f64>>,
}

impl ModeLane<'_> {
    /// Copies the own part of the record of all runs.
    fn refresh(&mut self, runs: &LaneRuns) {
        let (lane, levels) = (self.lane, &runs.levels);
        let StepRecord { dt, step, admissible, reaction, impulses, candidates, report } = &mut self.record;
        (*step, *report) = (runs.step, levels.reports[lane]);
        let listed = candidates.get_or_insert_default();
        for i in listed.drain(..) {
            (reaction[i], impulses[i]) = (0.0, 0.0);
        }
        let presses = levels.presses.iter().any(|of| of[lane]);
        for i in 0..if presses { reaction.len() } else { 0 } {
            let [before, now] = [levels.reaction_before[i].0[lane], levels.reaction[i].0[lane]];
            if before != 0.0 || now != 0.0 {
                listed.push(i);
                admissible[i] = levels.admissible[i].0[lane];
                reaction[i] = now;
                impulses[i] = 0.5 * *dt * (before + now);
            }
        }
        self.shown.take();
    }

    /// Returns the central velocity, in m/s, one entry per dof.
    fn central_velocity(&self) -> Vec<f64> {
        let runs = self.runs.borrow();
        if runs.step == 0 && runs.shared.massless == MasslessPart::Swings {
            return runs.starts[self.lane].velocity.clone();
        }
        let LaneLevels { d, d_next, .. } = &runs.levels;
        let twice = 2.0 * self.record.dt;
        runs.vector(self.lane, |j| (d[j].0[self.lane] + d_next[j].0[self.lane]) / twice)
    }
}

impl Scheme for ModeLane<'_> {
    fn advance(&mut self) -> Result<()> {
        let runs = self.runs.clone();
        let mut all = runs.borrow_mut();
        match all.step.checked_sub(self.record.step) {
            Some(0) => all.advance()?,
            Some(1) => {}
            _ => return Err(Error::Usage("runs in lock step advance in turn".into())),
        }
        self.refresh(&all);
        Ok(())
    }

    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        self.shown.get_or_init(|| {
            let runs = self.runs.borrow();
            let mut u = runs.vector(self.lane, |j| runs.levels.z[j].0[self.lane]);
            let bounds = self.system.bounds.dofs.iter().zip(&runs.levels.u);
            bounds.for_each(|(&dof, deflection)| u[dof] = deflection.0[self.lane]);
            u
        })
    }

    fn displacement_of(&self, dof: usize) -> f64 {
        self.runs.borrow().deflections(dof).0[self.lane]
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity())
    }

    fn limits(&self) -> &Bounds {
        &self.system.bounds
    }

    fn energies(&self) -> Result<Energies> {
        let System { engine, stiffness, mass, .. } = self.system;
        let u = self.displacement();
        let elastic = 0.5 * engine.multiply(stiffness, u, &mut vec![0.0; u.len()])?;
        let mut v = vec![0.0; engine.velocities(mass)];
        let kinetic = self.system.kinetic_energy(&self.central_velocity(), &mut v)?;
        Ok(Energies { kinetic, elastic, work: self.runs.borrow().work(self.lane, u)? })
    }

    fn approach(&self, bound: usize) -> Approach {
        let runs = self.runs.borrow();
        let LaneLevels { u, u_before, .. } = &runs.levels;
        let deflection = u[bound].0[self.lane];
        let velocity = match self.record.step {
            0 => runs.starts[self.lane].bounded_velocity[bound],
            _ => (deflection - u_before[bound].0[self.lane]) / self.record.dt,
        };
        Approach { time: self.record.time(), deflection, velocity }
    }

    fn balance(&mut self) -> Result<StepBalance> {
        Err(Error::Usage("a run in lock step keeps no balance of forces".into()))
    }

    fn archive(&mut self, _: &mut Archive) -> Result<()> {
        Err(Error::Usage("a run in lock step cannot be saved".into()))
    }

    fn factorisations(&self) -> u64 {
        0
    }
}
