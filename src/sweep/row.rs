//! Row of a sweep: the values and the measures of a run.

use super::measures::Measures;
use super::plan::{Direction, PlannedRun};
use crate::scene::{Probe, Scene};
use serde::{Deserialize, Serialize};

/// Run of a sweep: its values, and its measures or the reason why there are none.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepRow {
    /// Index of the run in the plan.
    pub index: usize,
    /// Values of the swept keys.
    pub values: Vec<f64>,
    /// Sense in which the run continues another.
    pub direction: Direction,
    /// Measures; `None` where the run failed.
    pub measures: Option<Measures>,
    /// Reason of a failure.
    pub failure: Option<String>,
}

impl SweepRow {
    /// Creates the row of a run.
    pub(super) fn new(run: &PlannedRun, outcome: std::result::Result<Measures, String>) -> SweepRow {
        let PlannedRun { index, values, direction } = run.clone();
        let failure = outcome.as_ref().err().cloned();
        SweepRow { index, values, direction, measures: outcome.ok(), failure }
    }
}

/// Probe of a sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ProbeHead {
    /// Name of the probe.
    pub name: String,
    /// Quantity and its unit.
    pub quantity: String,
    /// Unit of the quantity.
    pub unit: String,
}

impl ProbeHead {
    /// Returns the probes of a scene.
    pub fn of_scene(scene: &Scene) -> Vec<ProbeHead> {
        let head = |probe: &Probe| {
            let (quantity, unit) = probe.quantity.axis();
            ProbeHead { name: probe.name.clone(), quantity: quantity.into(), unit: unit.into() }
        };
        scene.output.probes.iter().map(head).collect()
    }
}
