//! Runs of a sweep: their values, their order, and which of them carry the state on.

use crate::scene::{Draws, SweepOrder, SweepSpec};
use serde::{Deserialize, Serialize};
use std::ops::Range;

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

/// Runs of a sweep in groups: a run continues the one before in its group, and no group depends on
/// another. Each run is made when it is asked for.
pub struct Plan<'s> {
    sweep: &'s SweepSpec,
    draws: Option<Draws<'s>>,
    /// Values of the first key, which vary within a group of runs that carry their state on.
    legs: Vec<(f64, Direction)>,
}

impl Plan<'_> {
    /// Creates the plan of a sweep.
    pub fn new(sweep: &SweepSpec) -> Plan<'_> {
        let first = || sweep.over.iter().take(1).flat_map(|swept| &swept.values);
        let up = || first().map(|value| (*value, Direction::Up));
        let mut legs: Vec<(f64, Direction)> = match sweep.direction {
            SweepOrder::Apart => first().map(|value| (*value, Direction::Apart)).collect(),
            SweepOrder::Up | SweepOrder::UpAndDown => up().collect(),
            SweepOrder::Down => Vec::new(),
        };
        if let SweepOrder::Down | SweepOrder::UpAndDown = sweep.direction {
            legs.extend(up().rev().map(|(value, _)| (value, Direction::Down)));
        }
        Plan { sweep, draws: sweep.random.as_ref().map(|random| random.draws()), legs }
    }

    /// Returns the number of runs.
    pub fn count(&self) -> usize {
        let others = self.sweep.over.iter().skip(1).map(|swept| swept.values.len()).product::<usize>();
        self.sweep.random.as_ref().map_or(self.legs.len() * others, |random| random.runs as usize)
    }

    /// Returns the number of runs of each group.
    pub fn group_size(&self) -> usize {
        if self.sweep.direction == SweepOrder::Apart { 1 } else { self.legs.len() }
    }

    /// Returns the indices of the runs of each group.
    pub fn groups(&self) -> impl Iterator<Item = Range<usize>> {
        let size = self.group_size();
        (0..self.count()).step_by(size).map(move |first| first..first + size)
    }

    /// Returns the run of an index.
    pub fn run(&self, index: usize) -> PlannedRun {
        if let Some(draws) = &self.draws {
            return PlannedRun { index, values: draws.values(index), direction: Direction::Apart };
        }
        let (value, direction) = self.legs[index % self.legs.len()];
        let (mut values, mut place) = (vec![value], index / self.legs.len());
        for swept in &self.sweep.over[1..] {
            values.push(swept.values[place % swept.values.len()]);
            place /= swept.values.len();
        }
        PlannedRun { index, values, direction }
    }

    /// Returns a run that stands for all: the one of the medians of random keys, which no draw
    /// spoils, else the first.
    pub fn typical_run(&self) -> PlannedRun {
        match &self.sweep.random {
            Some(random) => PlannedRun { index: 0, values: random.medians(), direction: Direction::Apart },
            None => self.run(0),
        }
    }
}
