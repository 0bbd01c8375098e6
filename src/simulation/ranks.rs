//! Time that a run would take on several ranks, for the advice of `check` and `run`.

use crate::scene::{EngineName, Mass, Scene};
use serde::Serialize;
use std::num::NonZero;
use std::{fs, thread};

/// Work of all ranks together, relative to one process, and time of the messages of a step, in s
/// (`scripts/scaling.py`, on two ranks).
const WORK: f64 = 1.2;
const MESSAGES: f64 = 3e-5;

/// Time in which ranks and PETSc start, in s.
const START: f64 = 1.0;

/// Least number of dofs of a rank for which the times above were measured.
const LEAST_DOFS: usize = 3000;

/// Share of the time of one process above which ranks do not pay.
const WORTHWHILE: f64 = 0.65;

/// Number of ranks that shortens a run most, and its time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct QuickestRanks {
    /// Number of ranks.
    pub ranks: usize,
    /// Expected time of the run, in s.
    pub seconds: f64,
}

impl QuickestRanks {
    /// Returns the quickest number of ranks for a run of a scene that takes one process
    /// `seconds`, on the idle processors of this machine. Returns `None` where one process is about
    /// as quick, or the scene runs on one process only.
    pub(crate) fn new(scene: &Scene, dofs: usize, steps: u64, seconds: f64) -> Option<QuickestRanks> {
        let capabilities = scene.time.scheme.capabilities();
        let is_served = cfg!(feature = "petsc")
            && scene.solver.engine == EngineName::Native
            && capabilities.is_distributed
            && scene.time.mass != Mass::Modal;
        if is_served { quickest(idle_processors(), dofs, steps, seconds) } else { None }
    }
}

/// Returns the quickest number of ranks on some processors.
fn quickest(processors: usize, dofs: usize, steps: u64, seconds: f64) -> Option<QuickestRanks> {
    let on = |ranks: usize| START + WORK * seconds / ranks as f64 + MESSAGES * steps as f64;
    let ranks = processors.min(dofs / LEAST_DOFS);
    let quickest = QuickestRanks { ranks, seconds: on(ranks.max(1)) };
    (ranks > 1 && quickest.seconds <= WORTHWHILE * seconds).then_some(quickest)
}

/// Returns the number of processors that no other program uses, as the mean of the last minute
/// tells.
fn idle_processors() -> usize {
    let processors = thread::available_parallelism().map_or(1, NonZero::get);
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    let load: f64 = text.split_whitespace().next().and_then(|load| load.parse().ok()).unwrap_or(0.0);
    // This process may be one of those that ran.
    processors.saturating_sub((load - 1.0).max(0.0).round() as usize)
}

#[cfg(test)]
mod tests {
    use super::quickest;

    #[test]
    fn ranks_pay_for_long_runs_of_fine_meshes() {
        let two = quickest(2, 7_900, 100_000, 100.0).unwrap();
        assert_eq!(two.ranks, 2);
        assert!((two.seconds - 64.0).abs() < 1e-9, "{}", two.seconds);
        assert_eq!(quickest(8, 123_000, 1000, 50.0).unwrap().ranks, 8);
        // Too short, too coarse, too many messages for the work, one processor.
        for (processors, dofs, steps, seconds) in [
            (2, 123_000, 10, 1.0),
            (8, 150, 10_000, 60.0),
            (2, 7_900, 1_000_000, 40.0),
            (1, 123_000, 1000, 50.0),
        ] {
            assert_eq!(quickest(processors, dofs, steps, seconds), None);
        }
    }
}
