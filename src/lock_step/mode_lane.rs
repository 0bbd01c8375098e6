//! Solution of one of several runs in lock step.

use super::lane_levels::{LaneLevels, MasslessPart};
use super::mode_runs::ModeRuns;
use crate::energy::Energies;
use crate::error::Result;
use crate::kernels::Lanes;
use crate::linalg::Native;
use crate::obstacle::Bounds;
use crate::scheme::{Approach, Solution, StepRecord, System};
use std::cell::OnceCell;

/// Newmark run of one of several equal systems in lock step, at the last step of all.
pub struct ModeLane<'r, 's> {
    runs: &'r mut ModeRuns<'s>,
    lane: usize,
    record: StepRecord,
    /// Displacement, in m, one entry per dof, where it was asked for.
    shown: OnceCell<Vec<f64>>,
}

impl<'s> ModeRuns<'s> {
    /// Returns a run at the last step.
    pub fn lane(&mut self, lane: usize) -> ModeLane<'_, 's> {
        let levels = &self.levels;
        let each = |lanes: &[Lanes]| -> Vec<f64> { lanes.iter().map(|values| values.0[lane]).collect() };
        let (before, reaction) = (each(&levels.reaction_before), each(&levels.reaction));
        let impulses = before.iter().zip(&reaction).map(|(before, now)| 0.5 * self.dt * (before + now));
        let record = StepRecord {
            step: self.step,
            dt: self.dt,
            admissible: each(&levels.admissible),
            impulses: impulses.collect(),
            reaction,
            candidates: None,
            report: levels.report(lane),
        };
        ModeLane { runs: self, lane, record, shown: OnceCell::new() }
    }
}

impl<'s> ModeLane<'_, 's> {
    /// Returns the system of the run.
    fn system(&self) -> &'s System<Native> {
        self.runs.systems[self.lane]
    }

    /// Returns the central velocity, in m/s, one entry per dof.
    fn central_velocity(&self) -> Vec<f64> {
        let runs = &*self.runs;
        if runs.step == 0 && runs.shared.massless == MasslessPart::Swings {
            return runs.starts[self.lane].velocity.clone();
        }
        let LaneLevels { d, d_next, .. } = &runs.levels;
        let twice = 2.0 * self.record.dt;
        runs.vector(self.lane, |j| (d[j].0[self.lane] + d_next[j].0[self.lane]) / twice)
    }
}

impl Solution for ModeLane<'_, '_> {
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        self.shown.get_or_init(|| {
            let levels = &self.runs.levels;
            let mut u = self.runs.vector(self.lane, |j| levels.z[j].0[self.lane]);
            let bounds = self.system().bounds.dofs.iter().zip(&levels.u);
            bounds.for_each(|(&dof, deflection)| u[dof] = deflection.0[self.lane]);
            u
        })
    }

    fn displacement_of(&self, dof: usize) -> f64 {
        self.runs.deflections(dof).0[self.lane]
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity())
    }

    fn limits(&self) -> &Bounds {
        &self.system().bounds
    }

    fn energies(&self) -> Result<Energies> {
        let [elastic, kinetic] = self.system().energies(self.displacement(), &self.central_velocity())?;
        Ok(Energies { kinetic, elastic, work: self.runs.energies()[self.lane].work })
    }

    fn approach(&self, bound: usize) -> Approach {
        let runs = &*self.runs;
        let LaneLevels { u, u_before, .. } = &runs.levels;
        let deflection = u[bound].0[self.lane];
        let velocity = match self.record.step {
            0 => runs.starts[self.lane].bounded_velocity[bound],
            _ => (deflection - u_before[bound].0[self.lane]) / self.record.dt,
        };
        Approach { time: self.record.time(), deflection, velocity }
    }
}
