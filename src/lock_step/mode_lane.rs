//! One of several runs in lock step, as a [`Scheme`].

use super::lane_levels::{LaneLevels, MasslessPart};
use super::lane_runs::LaneRuns;
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::{Engine, Native};
use crate::obstacle::Bounds;
use crate::scheme::{Approach, Scheme, StepBalance, StepRecord, System};
use std::cell::{OnceCell, RefCell};
use std::rc::Rc;

/// Newmark run of one of several equal systems in lock step.
pub struct ModeLane<'s> {
    runs: Rc<RefCell<LaneRuns<'s>>>,
    lane: usize,
    system: &'s System<Native>,
    record: StepRecord,
    /// Displacement, in m, one entry per dof, where it was asked for.
    shown: OnceCell<Vec<f64>>,
}

impl<'s> ModeLane<'s> {
    /// Shows one of the runs at its present step.
    pub(super) fn new(
        runs: &Rc<RefCell<LaneRuns<'s>>>,
        lane: usize,
        system: &'s System<Native>,
    ) -> ModeLane<'s> {
        let record = StepRecord {
            candidates: Some(Vec::new()),
            ..StepRecord::new(runs.borrow().dt, system.bounds.len())
        };
        let mut run = ModeLane { runs: runs.clone(), lane, system, record, shown: OnceCell::new() };
        run.refresh(&runs.borrow());
        run
    }
}

impl ModeLane<'_> {
    /// Shows the last step of the runs, which may have advanced by several.
    pub(super) fn catch_up(&mut self) {
        let runs = self.runs.clone();
        let all = runs.borrow();
        if self.record.step != all.step {
            self.refresh(&all);
        }
    }

    /// Copies the own part of the record of all runs.
    fn refresh(&mut self, runs: &LaneRuns) {
        let (lane, levels) = (self.lane, &runs.levels);
        let StepRecord { dt, step, admissible, reaction, impulses, candidates, report } = &mut self.record;
        (*step, *report) = (runs.step, levels.report(lane));
        let listed = candidates.get_or_insert_default();
        for i in listed.drain(..) {
            (reaction[i], impulses[i]) = (0.0, 0.0);
        }
        let presses = levels.presses.iter().any(|of| of.holds(lane));
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
    /// Advances all runs.
    fn advance(&mut self) -> Result<()> {
        self.runs.borrow_mut().advance()?;
        self.catch_up();
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
        Ok(Energies { kinetic, elastic, work: self.runs.borrow().energies()[self.lane].work })
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
