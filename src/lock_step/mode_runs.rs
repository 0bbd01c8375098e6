//! Runs of several systems in lock step, with what is computed from their coordinates.

use super::lane_contacts::ZERO;
use super::lane_levels::{Data, LaneLevels, Launch, MasslessPart, each};
use super::lane_start::LaneStart;
use super::lane_sums::along;
use super::load_laws::{LoadLaws, load_of};
use super::shared_modes::SharedModes;
use crate::error::Result;
use crate::kernels::Lanes;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, Native};
use crate::obstacle::Bounds;
use crate::scheme::modal::data::{ModalData, ModalLoads};
use crate::scheme::{NewmarkParameters, Start, System};
use faer::Mat;
use std::cell::RefCell;
use std::collections::BTreeMap;

/// Newmark runs of equal systems in lock step. Read together they cost much less than as one
/// [`ModeLane`](super::ModeLane) each.
pub struct ModeRuns<'s> {
    pub(super) shared: &'s SharedModes<'s>,
    pub(super) systems: Vec<&'s System<Native>>,
    laws: LoadLaws<'s>,
    pub(super) levels: LaneLevels,
    loads: Vec<ModalLoads>,
    pub(super) starts: Vec<LaneStart>,
    /// Index of the last step.
    pub step: u64,
    /// Time step, in s.
    pub(super) dt: f64,
    at_dofs: RefCell<BTreeMap<usize, DofRow>>,
}

/// Deflections of a dof per unit of the coordinates, and the present ones.
struct DofRow {
    shared: Vec<f64>,
    own: Vec<Lanes>,
    deflections: Lanes,
    step: u64,
}

impl<'s> SharedModes<'s> {
    /// Starts one Newmark run per system, up to as many as a register has lanes, with the same
    /// parameters.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the loads.
    pub fn start(
        &'s self,
        systems: &[&'s System<Native>],
        parameters: NewmarkParameters,
        starts: &[Start],
    ) -> Result<ModeRuns<'s>> {
        let shared = self;
        let loads = systems
            .iter()
            .map(|system| ModalLoads::new(system, &shared.modes, &shared.saddle, &shared.global));
        let loads: Vec<ModalLoads> = loads.collect::<Result<_>>()?;
        let laws = LoadLaws::new(systems, parameters.step, &shared.factors);
        let terms = laws.count();
        let [mut now, mut next] = [0.0, parameters.step].map(|_| vec![ZERO; terms]);
        laws.set(0, &mut now)?;
        laws.set(1, &mut next)?;
        let lanes = systems.iter().zip(starts).zip(&loads).enumerate();
        let lanes = lanes.map(|(lane, ((_, start), loads))| LaneStart::new(shared, lane, start, loads, &now));
        let lanes: Vec<LaneStart> = lanes.collect();
        let (z, launch) = gathered_starts(shared, terms, &now, &lanes);
        let data = lane_data(shared, systems, terms, &loads, &lanes)?;
        let equations = shared.equations(parameters, z.len());
        let levels = LaneLevels::new(equations, data, systems.len(), z, [now, next], &launch);
        Ok(ModeRuns {
            shared,
            systems: systems.to_vec(),
            laws,
            levels,
            loads,
            starts: lanes,
            step: 0,
            dt: parameters.step,
            at_dofs: RefCell::default(),
        })
    }
}

impl<'s> ModeRuns<'s> {
    /// Makes one step of all runs.
    ///
    /// # Errors
    /// Returns the errors of the loads.
    pub fn advance(&mut self) -> Result<()> {
        self.step += 1;
        let ModeRuns { laws, levels, step, .. } = self;
        let mut outcome = Ok(());
        levels.advance(|factors| outcome = laws.set(*step + 1, factors));
        outcome
    }

    /// Returns the largest relative KKT residual of the last step, NaN where any is.
    pub fn kkt(&self) -> f64 {
        let worse = |worst: f64, kkt: f64| if kkt <= worst { worst } else { kkt };
        self.levels.kkt.0[..self.systems.len()].iter().copied().fold(0.0, worse)
    }

    /// Returns the sums of the magnitudes of all reactions (N) and of all impulses (N s) of the
    /// last step, one per run; `None` where no run is in contact.
    pub(crate) fn contacts(&self) -> Option<[Lanes; 2]> {
        let LaneLevels { presses, reaction, reaction_before, .. } = &self.levels;
        if !presses.iter().any(|mask| mask.any()) {
            return None;
        }
        let half = 0.5 * self.dt;
        let (mut forces, mut impulses) = (ZERO, ZERO);
        for (before, now) in reaction_before.iter().zip(reaction) {
            forces += now.abs();
            impulses += (half * (*before + *now)).abs();
        }
        Some([forces, impulses])
    }

    /// Returns the vector over the dofs of one lane with given coordinates.
    pub(super) fn vector(&self, lane: usize, coordinate: impl Fn(usize) -> f64) -> Vec<f64> {
        let SharedModes { system, modes, massless, model, .. } = self.shared;
        let mut u = vec![0.0; system.engine.dofs()];
        let mut place = modes.count();
        (0..place).for_each(|k| axpy(coordinate(k), modes.shapes.col_as_slice(k), &mut u));
        if *massless == MasslessPart::None {
            return u;
        }
        for column in &model.flexibility {
            axpy(coordinate(place), column, &mut u);
            place += 1;
        }
        let terms = self.levels.factors[1].len();
        let factors = (place..place + self.loads[lane].count()).map(&coordinate).collect();
        self.loads[lane].add_response(&ModalData { factors, ..ModalData::default() }, &mut u);
        if *massless == MasslessPart::Swings {
            axpy(coordinate(place + terms), &self.starts[lane].massless, &mut u);
        }
        u
    }

    /// Returns the deflections of a dof, in m, one per run.
    pub(crate) fn deflections(&self, dof: usize) -> Lanes {
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
        let mut varied: Vec<Lanes> = Vec::new();
        if *massless != MasslessPart::None {
            shared.extend(model.flexibility.iter().map(|column| column[dof]));
            let terms = self.levels.factors[1].len();
            let response = |load: usize| {
                each(|k| self.loads.get(k).map_or(0.0, |loads| entry(&loads.responses, dof, load)))
            };
            varied.extend((0..terms).map(response));
        }
        if *massless == MasslessPart::Swings {
            varied.push(each(|k| self.starts.get(k).map_or(0.0, |start| start.massless[dof])));
        }
        let deflections = along(&shared, &varied, &self.levels.z);
        DofRow { shared, own: varied, deflections, step: self.step }
    }
}

/// Returns the coordinates at the start, and the initial velocities.
fn gathered_starts(
    shared: &SharedModes,
    terms: usize,
    factors: &[Lanes],
    lanes: &[LaneStart],
) -> (Vec<Lanes>, Launch) {
    let gathered = |vector: &dyn Fn(&LaneStart) -> &[f64], count: usize| -> Vec<Lanes> {
        (0..count).map(|j| each(|k| lanes.get(k).map_or(0.0, |lane| vector(lane)[j]))).collect()
    };
    let modes = shared.modes.count();
    let mut z = gathered(&|lane| &lane.q, modes);
    let launch = Launch {
        modes: gathered(&|lane| &lane.v, modes),
        bounded: gathered(&|lane| &lane.bounded_velocity, shared.rows.ncols()),
    };
    if shared.massless != MasslessPart::None {
        z.extend(gathered(&|lane| &lane.reaction, shared.model.candidates.len()));
        z.extend(&factors[..terms]);
    }
    if shared.massless == MasslessPart::Swings {
        z.push(each(|_| 1.0));
    }
    (z, launch)
}

/// Returns loads, bounds and starts of all lanes.
fn lane_data(
    shared: &SharedModes,
    systems: &[&System<Native>],
    terms: usize,
    loads: &[ModalLoads],
    lanes: &[LaneStart],
) -> Result<Data> {
    let bounded = &shared.system.bounds.dofs;
    let (has_massless, swings) =
        (shared.massless != MasslessPart::None, shared.massless == MasslessPart::Swings);
    let of_load = |matrix: &dyn Fn(&ModalLoads) -> &Mat<f64>, row: usize, load: usize| {
        each(|k| loads.get(k).map_or(0.0, |loads| entry(matrix(loads), row, load)))
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
    let on_start = |load: usize| {
        let work = |k: usize, start: &LaneStart| {
            load_of(systems[k], load).map_or(0.0, |force| dot(force, &start.massless))
        };
        each(|k| lanes.get(k).map_or(0.0, |start| work(k, start)))
    };
    let mut stiffness: Vec<Vec<Lanes>> = Vec::new();
    if has_massless {
        let others = |load| (0..terms).map(move |other| of_load(&|loads| &loads.energies, other, load));
        stiffness.extend((0..terms).map(|load| others(load).collect()));
    }
    if swings {
        let mut of_start: Vec<Lanes> = (0..terms).map(on_start).collect();
        stiffness.iter_mut().zip(&of_start).for_each(|(row, energy)| row.push(*energy));
        let System { engine, stiffness: matrix, .. } = shared.system;
        let mut energies = ZERO;
        for (energies, start) in energies.0.iter_mut().zip(lanes) {
            *energies = engine.multiply(matrix, &start.massless, &mut vec![0.0; engine.dofs()])?;
        }
        of_start.push(energies);
        stiffness.push(of_start);
    }
    let force = |load: usize| {
        let modes = 0..shared.modes.count();
        let mut forces: Vec<Lanes> = modes.map(|mode| of_load(&|loads| &loads.forces, mode, load)).collect();
        if swings {
            forces.extend((0..bounded.len()).map(|i| of_load(&|loads| &loads.shifts, i, load)));
            forces.extend(&stiffness[load]);
        }
        forces
    };
    let bound = |side: fn(&Bounds) -> &[f64], absent: f64| -> Vec<Lanes> {
        let values = |i: usize| each(|k| systems.get(k).map_or(absent, |system| side(&system.bounds)[i]));
        (0..bounded.len()).map(values).collect()
    };
    let forces: Vec<Vec<Lanes>> = (0..terms).map(force).collect();
    Ok(Data {
        pushing: (0..terms).filter(|&load| forces[load].iter().any(|force| *force != ZERO)).collect(),
        rows: (0..bounded.len()).map(row).collect(),
        forces,
        stiffness,
        lower: bound(|bounds| &bounds.lower, f64::NEG_INFINITY),
        upper: bound(|bounds| &bounds.upper, f64::INFINITY),
        magnitude: each(|k| systems.get(k).map_or(0.0, |system| system.bounds.magnitude())),
    })
}

/// Returns an entry of a matrix, 0 beyond its columns.
fn entry(matrix: &Mat<f64>, row: usize, column: usize) -> f64 {
    if row < matrix.nrows() && column < matrix.ncols() { matrix[(row, column)] } else { 0.0 }
}
