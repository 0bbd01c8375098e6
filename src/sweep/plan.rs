//! Runs of a sweep: their values, their order, and which of them carry the state on.

use crate::scene::{SweepOrder, SweepSpec};
use serde::{Deserialize, Serialize};

/// Sense in which a run continues the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Direction {
    /// The run starts as the scene says.
    #[serde(rename = "-")]
    Apart,
    /// The run continues that of the value before.
    #[serde(rename = "up")]
    Up,
    /// The run continues that of the value after.
    #[serde(rename = "down")]
    Down,
}

impl Direction {
    /// Returns the word in the column `direction`.
    pub fn word(self) -> &'static str {
        match self {
            Direction::Apart => "-",
            Direction::Up => "up",
            Direction::Down => "down",
        }
    }
}

/// Run of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct PlannedRun {
    /// Index of its row.
    pub index: usize,
    /// Values of the swept keys.
    pub values: Vec<f64>,
    /// Sense in which it continues the run before in its group.
    pub direction: Direction,
}

/// Returns the runs of a sweep in groups: a run continues the one before in its group, and no group
/// depends on another. The first key varies within a group of runs that carry their state on.
pub fn groups(sweep: &SweepSpec) -> Vec<Vec<PlannedRun>> {
    if let Some(random) = &sweep.random {
        let run = |(index, values)| vec![PlannedRun { index, values, direction: Direction::Apart }];
        return random.draws().into_iter().enumerate().map(run).collect();
    }
    let first = &sweep.over[0].values;
    let up = || first.iter().map(|value| (*value, Direction::Up));
    let down = || first.iter().rev().map(|value| (*value, Direction::Down));
    let legs: Vec<(f64, Direction)> = match sweep.direction {
        SweepOrder::Apart => first.iter().map(|value| (*value, Direction::Apart)).collect(),
        SweepOrder::Up => up().collect(),
        SweepOrder::Down => down().collect(),
        SweepOrder::UpAndDown => up().chain(down()).collect(),
    };
    let mut others = vec![Vec::new()];
    for swept in &sweep.over[1..] {
        let with =
            |value: &f64| others.iter().map(|other| [&other[..], &[*value]].concat()).collect::<Vec<_>>();
        others = swept.values.iter().flat_map(with).collect();
    }
    let mut count = 0;
    let mut groups: Vec<Vec<PlannedRun>> = Vec::new();
    for other in others {
        let runs = legs.iter().map(|&(value, direction)| {
            count += 1;
            let values = std::iter::once(value).chain(other.iter().copied()).collect();
            PlannedRun { index: count - 1, values, direction }
        });
        match sweep.direction {
            SweepOrder::Apart => groups.extend(runs.map(|run| vec![run])),
            _ => groups.push(runs.collect()),
        }
    }
    groups
}

/// Returns a run that stands for all: the one of the medians of random keys, which no draw spoils,
/// else the first of the plan.
pub fn typical_run(sweep: &SweepSpec) -> Option<PlannedRun> {
    match &sweep.random {
        Some(random) => Some(PlannedRun { index: 0, values: random.medians(), direction: Direction::Apart }),
        None => groups(sweep).into_iter().flatten().next(),
    }
}
