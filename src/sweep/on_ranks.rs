//! Execution of the runs of a sweep on PETSc, each on a group of ranks.
//!
//! The groups share the work without messages: those runs that continue each other stay in one
//! group, and the others go round. The first rank of each group keeps its rows in a file of its
//! own, so that no rank waits for another one but those of its own run.

use super::conduct::{Loader, scene_at};
use super::plan::{Plan, PlannedRun};
use super::prepared_run::{CarriedState, Finished, PreparedRun};
use super::row::SweepRow;
use super::store::SweepPart;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::petsc::Context;
use crate::scene::SweepSpec;
use crate::simulation::Model;
use std::ops::Range;
use std::rc::Rc;
use std::time::Duration;

/// Sweep on groups of ranks.
pub struct RankedSweep<'s> {
    /// Keys and measures.
    pub sweep: &'s SweepSpec,
    /// Loader of the scene with further settings.
    pub load: &'s Loader<'s>,
    /// PETSc on the own group of ranks.
    pub context: &'s Rc<Context>,
    /// Indices of the rows that are known from before, in ascending order.
    pub known: &'s [usize],
    /// Time that a failed rank waits for the others of its group to fail too.
    pub patience: Duration,
}

impl RankedSweep<'_> {
    /// Makes the own group's share of the runs that are not known; the first rank of the group adds
    /// their rows to its part. `told` receives each row. Collective over the group.
    ///
    /// # Errors
    /// Returns the errors of the part and of options that nothing has used, and [`Error::Stopped`]
    /// once `interrupts` says so on any rank. The failure of a run is a row, and no error.
    pub fn conduct(
        &self,
        mut part: Option<SweepPart>,
        told: &mut dyn FnMut(&SweepRow),
        interrupts: &dyn Fn() -> bool,
    ) -> Result<()> {
        let comm = self.context.comm();
        let stops = || comm.all_reduce_any(interrupts());
        let plan = Plan::new(self.sweep);
        let mut rest = self.count();
        for runs in self.own_groups() {
            let mut state = None;
            for planned in runs.clone().map(|run| plan.run(run)) {
                let made = self.make(&planned, state.as_ref(), &stops);
                // All ranks of the group stop at the same step.
                if matches!(made, Err(Error::Interrupted { .. })) {
                    return Err(Error::Stopped(format!("{rest} runs of a group of ranks are left")));
                }
                let made = self.context.agree(made, self.patience);
                self.context.refuse_unused_options()?;
                let outcome = made.map(|(measures, last)| {
                    state = (runs.len() > 1).then_some(last);
                    measures
                });
                let row = SweepRow::new(&planned, outcome.map_err(|why| why.to_string()));
                rest -= 1;
                told(&row);
                comm.all_ok(part.as_mut().map_or(Ok(0), |part| part.add(&row)))?;
            }
        }
        Ok(())
    }

    /// Returns the number of runs that the own group makes.
    pub fn count(&self) -> usize {
        self.own_groups().iter().map(Range::len).sum()
    }

    /// Returns the runs that the own group makes. Runs that continue each other are made again from
    /// the first one where any of them is missing, since no state is kept.
    fn own_groups(&self) -> Vec<Range<usize>> {
        let (group, count) = self.context.group();
        let is_missing =
            |runs: &Range<usize>| runs.clone().any(|run| self.known.binary_search(&run).is_err());
        let plan = Plan::new(self.sweep);
        let missing = plan.groups().filter(is_missing).enumerate();
        missing.filter(|(place, _)| place % count == group).map(|(_, runs)| runs).collect()
    }

    /// Makes one run. Collective over the group.
    fn make(
        &self,
        planned: &PlannedRun,
        state: Option<&CarriedState>,
        stops: &dyn Fn() -> bool,
    ) -> Result<Finished> {
        let (scene, sweep) = scene_at(self.sweep, self.load, &planned.values)?;
        let run = PreparedRun::new(scene, sweep, state, |scene| Model::distributed(scene, self.context))?;
        let solver = run.model.solver(&run.scene);
        run.run_alone(&solver, stops)
    }
}
