//! Forces of named obstacles over the gap to the plate.

use super::run::panels;
use super::{Axis, Curve, Figure, Panel};
use crate::output::history::Table;
use serde_json::Value;
use std::collections::BTreeMap;

/// Plots the force of each named obstacle at rest over the gap at each probe of a deflection that
/// faces it; `None` if there is no such pair.
///
/// `scene` is the resolved scene, and `opposite` has the heights of the obstacles that each probe
/// faces, in m. A gap is negative where a compliant stop yields.
pub fn over_gap(
    table: &Table,
    scene: &Value,
    title: &str,
    opposite: &BTreeMap<String, Vec<f64>>,
) -> Option<Figure> {
    let mut rows = Vec::new();
    for obstacle in scene["obstacle"].as_array().into_iter().flatten() {
        let (Some(name), Some(height)) = (obstacle["name"].as_str(), obstacle["height"].as_f64()) else {
            continue;
        };
        let Some((_, force)) = table.forces().find(|(other, _)| *other == name) else { continue };
        let sign = if obstacle["side"] == "below" { 1.0 } else { -1.0 };
        for (index, probe, deflection) in table.deflections() {
            if opposite.get(probe).is_some_and(|heights| heights.contains(&height)) {
                let points = deflection.iter().zip(force).map(|(w, f)| [sign * (w - height), *f]);
                let curve = Curve::new(probe, near_contact(points.collect())).style(index);
                let gap = Axis::linear("gap", "m").with([0.0]);
                let panel = Panel::new(gap, Axis::linear(format!("force of {name}"), "N").with([0.0]));
                rows.push(panel.height(100.0).curve(curve.dashes(0).width(0.5)));
            }
        }
    }
    (!rows.is_empty()).then(|| panels(Figure::new(title), rows))
}

/// Leaves out the points, each a gap and a force, whose gap is far from those under a force.
fn near_contact(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let gaps = points.iter().filter(|[_, force]| *force != 0.0).map(|[gap, _]| *gap);
    let [least, most] = gaps.fold([0.0_f64; 2], |[least, most], gap| [least.min(gap), most.max(gap)]);
    let room = most - least;
    if room > 0.0 {
        let is_far = |gap: f64| gap < least - room || gap > most + room;
        // A NaN interrupts the line.
        points.iter_mut().filter(|[gap, _]| is_far(*gap)).for_each(|point| *point = [f64::NAN; 2]);
    }
    points
}
