//! Advice that a study ends with: the run to take, and the larger part of its error.

use super::front::{ACCURACIES, Axis, front};
use super::report::horizon_words;
use super::{Accuracy, Run};
use crate::output::text::{engineering, two_digits};
use crate::scene::Mass;

/// Ratio of the whole error of a run to the least error of the meshes, up to which the step is
/// short enough: neither part is then larger than that error.
const ENOUGH: f64 = 2.0;

/// Ratio of errors below which the refinement between two runs has removed most of the error.
const MOST: f64 = 0.5;

impl Accuracy {
    /// Returns the advice in one sentence; `None` without runs.
    ///
    /// It names the cheapest run whose whole error is at most twice the least error in space (in a
    /// study without limits, the least whole error), or else the most accurate run.
    pub fn advice(&self) -> Option<String> {
        let runs: Vec<&Run> = self.runs.iter().collect();
        let least = runs.iter().map(|run| error_of_space(run)).fold(f64::INFINITY, f64::min);
        let enough = (ENOUGH * least).max(ACCURACIES[ACCURACIES.len() - 1]);
        let front = front(&runs, Axis::Whole);
        let run = front.iter().find(|run| run.error() <= enough).or(front.last())?;
        let seconds = engineering(run.seconds(), "s");
        let (error, until) = (two_digits(run.error()), horizon_words(self.until));
        let part = self.largest_part(run).map_or(String::new(), |part| format!(", mostly by the {part}"));
        let doubt = if self.at_once > 1 { " (seconds of simultaneous runs are unreliable)" } else { "" };
        Some(format!("take {}: {seconds} of computing{doubt}, error {error} {until}{part}", run.case))
    }

    /// Returns what most of a run's error comes from: the step, the mesh or the modes; `None` where
    /// the study does not tell.
    ///
    /// Limits tell the step from the rest. A run that is refined in one respect only tells that
    /// part, if it has less than half of the error.
    fn largest_part(&self, run: &Run) -> Option<&'static str> {
        if run.error() < ACCURACIES[ACCURACIES.len() - 1] {
            return None;
        }
        match run.dominating() {
            Some("time") => return Some("step"),
            Some(_) if run.case.method.mass != Mass::Modal => return Some("mesh"),
            _ => {}
        }
        let error = error_of_space(run);
        let best = |is_finer: &dyn Fn(&Run) -> bool| {
            let finer = self.runs.iter().filter(|other| is_finer(other)).map(error_of_space);
            finer.fold(f64::INFINITY, f64::min)
        };
        let (case, method) = (&run.case, &run.case.method);
        let by_mesh = best(&|other| {
            let is_same = other.case.method == *method && other.case.step == case.step;
            is_same && other.case.grid.element == case.grid.element && other.dofs > run.dofs
        });
        let by_modes = best(&|other| {
            let is_same = other.case.grid == case.grid && other.case.step == case.step;
            is_same && other.case.method.scheme == method.scheme && other.case.method.modes > method.modes
        });
        let by_step = best(&|other| {
            other.case.grid == case.grid && other.case.method == *method && other.case.step < case.step
        });
        let parts = [(by_mesh, "mesh"), (by_modes, "number of modes"), (by_step, "step")];
        let (least, part) = parts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        match run.space_error {
            _ if least < MOST * error => Some(part),
            Some(_) => Some("mesh and the modes"),
            None => None,
        }
    }
}

/// Returns the error in space of a run, or its whole error in a study without limits.
fn error_of_space(run: &Run) -> f64 {
    run.space_error.unwrap_or(run.whole_error)
}
