//! Newmark runs of equal systems in lock step: one scheme over all of them, seen as one scheme per
//! system.

use super::{Newmark, NewmarkParameters};
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::vectors::add;
use crate::linalg::{Engine, Ensemble, Form, Native};
use crate::obstacle::Bounds;
use crate::scheme::{Approach, Scheme, Start, StepBalance, StepRecord, System, TimeDependence};
use crate::vi::Condensed;
use std::cell::{OnceCell, RefCell};
use std::rc::Rc;

/// Largest number of bounds per system for which the dense contact problem on all of them is cheap.
const MOST_BOUNDS: usize = 80;

/// Equal systems side by side as one system; lanes without a system stay at rest.
pub struct SideBySide {
    system: System<Ensemble>,
}

impl SideBySide {
    /// Returns whether a system can go in lock step with others: its obstacles and supports stay
    /// where they are, and no damping acts on single modes but those of a modal mass.
    pub fn takes(system: &System<Native>) -> bool {
        let System { bounds, drive, mass, .. } = system;
        let is_plain = drive.supports.is_empty()
            && drive.bounds.is_none()
            && (drive.modal.is_none() || matches!(mass, Form::Modal { .. }))
            && drive.dashpots.is_none();
        is_plain && bounds.hertz.is_none() && bounds.len() <= MOST_BOUNDS
    }

    /// Returns whether two systems have the same matrices and bounded dofs, so that they can share
    /// a factor.
    pub fn are_equal(a: &System<Native>, b: &System<Native>) -> bool {
        let rates = |of: &System<Native>| of.drive.modal.as_ref().map(|modal| modal.rates().to_vec());
        let are_same = a.damping == b.damping && a.bounds.dofs == b.bounds.dofs && rates(a) == rates(b);
        are_same && a.stiffness.equals(&b.stiffness) && a.mass.equals(&b.mass)
    }

    /// Puts up to [`Ensemble::SYSTEMS`] equal systems side by side, each found by `system_of` in
    /// its owner.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for no system, or for a modal mass.
    pub fn new<M: 'static>(
        owners: &[Rc<M>],
        system_of: impl Fn(&M) -> &System<Native> + Copy + 'static,
    ) -> Result<SideBySide> {
        let refused = || Error::Usage("lock step takes equal systems with a mass of cells".into());
        let first = owners.first().map(|owner| system_of(owner)).ok_or_else(refused)?;
        let engine = Ensemble::new(first.engine.dofs());
        let stiffness = engine.form(&first.stiffness).ok_or_else(refused)?;
        let mass = engine.form(&first.mass).ok_or_else(refused)?;
        let systems: Vec<&System<Native>> = owners.iter().map(|owner| system_of(owner)).collect();
        let load = systems.iter().any(|system| system.load.is_some()).then(|| {
            let mut load = vec![0.0; engine.dofs()];
            for (lane, system) in systems.iter().enumerate() {
                system.load.iter().for_each(|of_one| Ensemble::put(lane, of_one, &mut load));
            }
            load
        });
        let mut drive = TimeDependence::default();
        if systems.iter().any(|system| system.drive.varies()) {
            drive.load = Some(Box::new(load_of_time(owners.to_vec(), system_of)));
        }
        let bounds = bounds_of(&systems);
        let damping = first.damping;
        let system = System { engine, stiffness, mass, damping, load, bounds, bound_numbers: None, drive };
        Ok(SideBySide { system })
    }

    /// Starts one Newmark run per system, with the same step matrix and coefficient of restitution.
    /// The runs advance in turn, each by one step.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the step matrix is not positive definite.
    pub fn start<'s>(
        &'s self,
        systems: &[&'s System<Native>],
        parameters: NewmarkParameters,
        starts: &[Start],
    ) -> Result<Vec<LaneRun<'s>>> {
        let System { engine, bounds, .. } = &self.system;
        let zeros = vec![0.0; engine.dofs()];
        let mut start = Start { displacement: zeros.clone(), velocity: zeros };
        for (lane, of_one) in starts.iter().enumerate() {
            Ensemble::put(lane, &of_one.displacement, &mut start.displacement);
            Ensemble::put(lane, &of_one.velocity, &mut start.velocity);
        }
        let solver = Condensed::on_all(engine, &Newmark::matrix(&self.system, parameters), bounds)?;
        let all = Newmark::with_solver(&self.system, parameters, start, Box::new(solver))?;
        let all = Rc::new(RefCell::new(all));
        let run = |(lane, &system): (usize, &&'s System<Native>)| {
            let record = StepRecord::new(parameters.step, system.bounds.len());
            let all = all.clone();
            let mut run = LaneRun { all, lane, system, record, shown: OnceCell::new() };
            run.refresh();
            run
        };
        Ok(systems.iter().enumerate().map(run).collect())
    }
}

/// Returns the bounds of all systems; lanes without a system have none.
fn bounds_of(systems: &[&System<Native>]) -> Bounds {
    let lanes = 0..Ensemble::SYSTEMS;
    let first = &systems[0].bounds;
    let each = |of: fn(&Bounds) -> &[f64], absent: f64| -> Vec<f64> {
        let of_bound = |i: usize| {
            lanes.clone().map(move |lane| systems.get(lane).map_or(absent, |system| of(&system.bounds)[i]))
        };
        (0..first.len()).flat_map(of_bound).collect()
    };
    Bounds {
        dofs: first
            .dofs
            .iter()
            .flat_map(|dof| lanes.clone().map(move |lane| lanes.end * dof + lane))
            .collect(),
        lower: each(|bounds| &bounds.lower, f64::NEG_INFINITY),
        upper: each(|bounds| &bounds.upper, f64::INFINITY),
        size: systems.iter().map(|system| system.bounds.size).fold(0.0, f64::max),
        hertz: None,
    }
}

/// Returns the load in time of all systems. Terms that share their number are scaled together.
fn load_of_time<M: 'static>(
    owners: Vec<Rc<M>>,
    system_of: impl Fn(&M) -> &System<Native> + 'static,
) -> impl Fn(f64, &mut [f64]) -> Result<()> {
    let count = owners.iter().map(|owner| system_of(owner).drive.terms.len()).max().unwrap_or(0);
    let size = system_of(&owners[0]).engine.dofs();
    let term = |number: usize| {
        let mut term = vec![0.0; Ensemble::SYSTEMS * size];
        for (lane, owner) in owners.iter().enumerate() {
            let own = system_of(owner).drive.terms.get(number);
            own.into_iter().for_each(|own| Ensemble::put(lane, &own.load, &mut term));
        }
        term
    };
    let terms: Vec<Vec<f64>> = (0..count).map(term).collect();
    move |time, load| {
        for (number, term) in terms.iter().enumerate() {
            let mut factors = [0.0; Ensemble::SYSTEMS];
            for (factor, owner) in factors.iter_mut().zip(&owners) {
                let own = system_of(owner).drive.terms.get(number);
                *factor = own.map_or(Ok(0.0), |own| (own.factor)(time))?;
            }
            let groups = load.as_chunks_mut::<{ Ensemble::SYSTEMS }>().0.iter_mut();
            for (group, of_term) in groups.zip(term.as_chunks::<{ Ensemble::SYSTEMS }>().0) {
                for lane in 0..Ensemble::SYSTEMS {
                    group[lane] += factors[lane] * of_term[lane];
                }
            }
        }
        for (lane, owner) in owners.iter().enumerate() {
            let System { engine, drive, .. } = system_of(owner);
            if let Some(of_one) = &drive.load {
                let mut own = vec![0.0; engine.dofs()];
                of_one(time, &mut own)?;
                let mut wide = vec![0.0; load.len()];
                Ensemble::put(lane, &own, &mut wide);
                add(&wide, load);
            }
        }
        Ok(())
    }
}

/// Run of one of the systems of [`SideBySide`].
///
/// The first of the runs that advances solves the step for all. None may be two steps ahead of
/// another. Residual and iterations are the largest of all runs.
pub struct LaneRun<'s> {
    all: Rc<RefCell<Newmark<'s, Ensemble>>>,
    lane: usize,
    system: &'s System<Native>,
    record: StepRecord,
    /// Displacement, in m, one entry per dof, where it was asked for.
    shown: OnceCell<Vec<f64>>,
}

impl LaneRun<'_> {
    /// Copies the own part of the record of all runs.
    fn refresh(&mut self) {
        let all = self.all.borrow();
        let StepRecord { step, admissible, reaction, impulses, report, .. } = &all.record;
        (self.record.step, self.record.report) = (*step, *report);
        for i in 0..self.record.reaction.len() {
            let place = Ensemble::SYSTEMS * i + self.lane;
            self.record.admissible[i] = admissible[place];
            self.record.reaction[i] = reaction[place];
            self.record.impulses[i] = impulses[place];
        }
        drop(all);
        self.shown.take();
    }

    /// Returns the own vector over the dofs of the mesh, given that of all.
    fn own(&self, all: &[f64]) -> Vec<f64> {
        Ensemble::take(self.lane, all)
    }

    /// Returns the central velocity, in m/s, one entry per dof.
    fn central_velocity(&self) -> Vec<f64> {
        self.own(&self.all.borrow().central_velocity().collect::<Vec<f64>>())
    }
}

impl Scheme for LaneRun<'_> {
    fn advance(&mut self) -> Result<()> {
        let others = self.all.borrow().record.step;
        match others.checked_sub(self.record.step) {
            Some(0) => self.all.borrow_mut().advance()?,
            Some(1) => {}
            _ => return Err(Error::Usage("runs in lock step advance in turn".into())),
        }
        self.refresh();
        Ok(())
    }

    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        self.shown.get_or_init(|| self.own(&self.all.borrow().levels.u_n))
    }

    fn displacement_of(&self, dof: usize) -> f64 {
        self.all.borrow().levels.u_n[Ensemble::SYSTEMS * dof + self.lane]
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity())
    }

    fn limits(&self) -> &Bounds {
        &self.system.bounds
    }

    fn energies(&self) -> Result<Energies> {
        let System { engine, stiffness, .. } = self.system;
        let u = self.displacement();
        let elastic = 0.5 * engine.multiply(stiffness, u, &mut vec![0.0; u.len()])?;
        let mut v = vec![0.0; engine.velocities(&self.system.mass)];
        let kinetic = self.system.kinetic_energy(&self.central_velocity(), &mut v)?;
        let by_time = self.all.borrow().levels.instants.as_ref().map_or(0.0, |of| of.work[self.lane]);
        Ok(Energies { kinetic, elastic, work: self.system.work(u)? + by_time })
    }

    fn approach(&self, bound: usize) -> Approach {
        self.all.borrow().approach(Ensemble::SYSTEMS * bound + self.lane)
    }

    fn balance(&mut self) -> Result<StepBalance> {
        Err(Error::Usage("a run in lock step keeps no balance of forces".into()))
    }

    fn archive(&mut self, _: &mut Archive) -> Result<()> {
        Err(Error::Usage("a run in lock step cannot be saved".into()))
    }

    fn factorisations(&self) -> u64 {
        self.all.borrow().factorisations()
    }
}
