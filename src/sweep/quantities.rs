//! Measures that are one number each, as columns of the table, as criteria and statistics see them.

use super::measures::{Measures, ProbeMeasures};
use super::row::{ProbeHead, SweepRow};

/// Function that returns a number of a run, if there is one.
type Reading<'q> = Box<dyn Fn(&Measures) -> Option<f64> + 'q>;

/// Measure that is one number per run.
pub(super) struct Quantity<'q> {
    /// Name of the column.
    pub name: String,
    pub unit: &'q str,
    /// Returns the value, if a run has one.
    pub value: Reading<'q>,
}

impl Quantity<'_> {
    /// Returns the value of the quantity in a row; `None` where the run failed or does not have it.
    pub fn of_row(&self, row: &SweepRow) -> Option<f64> {
        row.measures.as_ref().and_then(&self.value)
    }
}

/// Returns the measures of all probes, and then those of the whole plate.
pub(super) fn quantities(probes: &[ProbeHead]) -> Vec<Quantity<'_>> {
    let of_probes = probes.iter().enumerate().flat_map(|(index, probe)| of_probe(index, probe));
    of_probes.chain(of_plate()).collect()
}

/// Returns whether a measure is one of those that pictures of many keys show: the largest values of
/// probes, and the peak force.
pub(super) fn is_main(name: &str) -> bool {
    name.ends_with("_max") || name == "peak_force"
}

/// Returns the measures of a probe.
pub(super) fn of_probe(index: usize, probe: &ProbeHead) -> [Quantity<'_>; 5] {
    let quantity = |measure: &str, unit, value: fn(&ProbeMeasures) -> f64| Quantity {
        name: format!("{}_{measure}", probe.name),
        unit,
        value: Box::new(move |run| run.probes.get(index).map(value)),
    };
    let unit = probe.unit.as_str();
    [
        quantity("max", unit, |probe| probe.max),
        quantity("min", unit, |probe| probe.min),
        quantity("rms", unit, |probe| probe.rms),
        quantity("amplitude", unit, |probe| probe.amplitude),
        quantity("phase", "rad", |probe| probe.phase),
    ]
}

/// Returns the measures of the whole plate.
pub(super) fn of_plate() -> [Quantity<'static>; 8] {
    let quantity = |name: &str, unit, value: fn(&Measures) -> Option<f64>| Quantity {
        name: name.to_owned(),
        unit,
        value: Box::new(value),
    };
    [
        quantity("period", "", |run| run.period.map(|period| period as f64)),
        quantity("lyapunov", "1/s", |run| run.lyapunov),
        quantity("peak_force", "N", |run| Some(run.peak_force)),
        quantity("impulse", "N s", |run| Some(run.impulse)),
        quantity("impacts", "", |run| Some(run.impacts)),
        quantity("impact_velocity", "m/s", |run| Some(run.impact_velocity)),
        quantity("work", "J", |run| Some(run.work)),
        quantity("loss", "J", |run| Some(run.loss)),
    ]
}
