//! Runs of equal systems in lock step, which advance and are read together.

use super::lane_contacts::ZERO;
use super::lane_levels::LaneLevels;
use super::lane_runs::LaneRuns;
use super::mode_lane::ModeLane;
use super::shared_modes::SharedModes;
use crate::energy::Energies;
use crate::error::Result;
use crate::kernels::Lanes;
use crate::linalg::Native;
use crate::scheme::{NewmarkParameters, Start, System};
use std::cell::RefCell;
use std::rc::Rc;

/// Newmark runs of equal systems in lock step. Read together they cost much less than as one
/// [`ModeLane`] each.
pub struct ModeRuns<'s> {
    runs: Rc<RefCell<LaneRuns<'s>>>,
    lanes: Vec<ModeLane<'s>>,
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
        let runs = Rc::new(RefCell::new(LaneRuns::new(self, systems, parameters, starts)?));
        let lane = |(lane, system): (usize, &&'s System<Native>)| ModeLane::new(&runs, lane, system);
        let lanes = systems.iter().enumerate().map(lane).collect();
        Ok(ModeRuns { runs, lanes })
    }
}

impl<'s> ModeRuns<'s> {
    /// Makes one step of all runs.
    ///
    /// # Errors
    /// Returns the errors of the loads.
    pub fn advance(&mut self) -> Result<()> {
        self.runs.borrow_mut().advance()
    }

    /// Returns the index of the last step.
    pub fn step(&self) -> u64 {
        self.runs.borrow().step
    }

    /// Returns a run at the last step.
    pub fn lane(&mut self, lane: usize) -> &mut ModeLane<'s> {
        let own = &mut self.lanes[lane];
        own.catch_up();
        own
    }

    /// Returns the largest relative KKT residual of the last step, NaN where any is.
    pub fn kkt(&self) -> f64 {
        let runs = self.runs.borrow();
        let worse = |worst: f64, kkt: f64| if kkt <= worst { worst } else { kkt };
        runs.levels.kkt.0[..self.lanes.len()].iter().copied().fold(0.0, worse)
    }

    /// Returns the energies of each run at the last step, from its coordinates. Those of a
    /// [`ModeLane`] come from the matrices instead, at a much higher cost.
    pub fn energies(&self) -> Vec<Energies> {
        self.runs.borrow().energies()
    }

    /// Returns the deflections of a dof, in m, one per run.
    pub(crate) fn deflections(&self, dof: usize) -> Lanes {
        self.runs.borrow().deflections(dof)
    }

    /// Returns the sums of the magnitudes of all reactions (N) and of all impulses (N s) of the
    /// last step, one per run; `None` where no run is in contact.
    pub(crate) fn contacts(&self) -> Option<[Lanes; 2]> {
        let runs = self.runs.borrow();
        let LaneLevels { presses, reaction, reaction_before, .. } = &runs.levels;
        if !presses.iter().any(|of| of.any()) {
            return None;
        }
        let half = 0.5 * runs.dt;
        let (mut forces, mut impulses) = (ZERO, ZERO);
        for (before, now) in reaction_before.iter().zip(reaction) {
            forces += now.abs();
            impulses += (half * (*before + *now)).abs();
        }
        Some([forces, impulses])
    }
}
