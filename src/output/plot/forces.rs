//! Forces of obstacles: over time and the gap where they yield, as impulses where they are rigid.

use super::run::{panels, time};
use super::{Axis, Curve, Figure, Panel};
use crate::output::contacts::Contact;
use crate::output::history::Table;
use serde_json::Value;
use std::collections::BTreeMap;

/// Contacts of an obstacle, each with an instant (s) and an impulse (N s).
type Impulses = Vec<[f64; 2]>;

/// Plots each named obstacle in panels of its own: the force of a compliant one over time, and over
/// the gap at each probe of a deflection that faces it at rest; the impulse of each contact of a
/// rigid one, since its force depends on the time step. Where no obstacle has a name and one is
/// rigid, each contact of a node is an impulse. `None` if there is nothing to plot.
///
/// `scene` is the resolved scene, and `opposite` has the heights of the obstacles that each probe
/// faces, in m. A gap is negative where a compliant stop yields.
pub fn forces(
    table: &Table,
    contacts: &[Contact],
    scene: &Value,
    title: &str,
    opposite: &BTreeMap<String, Vec<f64>>,
) -> Option<Figure> {
    let times = table.column("time").unwrap_or_default();
    let obstacles: Vec<&Value> = scene["obstacle"].as_array().into_iter().flatten().collect();
    let (mut compliant, mut rigid) = (Vec::new(), Vec::new());
    for obstacle in &obstacles {
        let Some(name) = obstacle["name"].as_str() else { continue };
        let Some((_, force)) = table.forces().find(|(other, _)| *other == name) else { continue };
        if obstacle["stiffness"].is_null() {
            let impulses = table.column(&format!("impulse_{name}")).unwrap_or_default();
            rigid.push(stems(table, &format!("impulse of {name}"), impulses_of_contacts(times, impulses)));
            continue;
        }
        let axis = || Axis::linear(format!("force of {name}"), "N").with([0.0]);
        let curve = Curve::of("", times, force).palette(1).width(0.6);
        compliant.push(Panel::new(time(table), axis()).height(HEIGHT).curve(curve));
        compliant.extend(over_gap(table, obstacle, force, opposite, axis));
    }
    if compliant.is_empty() && rigid.is_empty() && obstacles.iter().any(|stop| stop["stiffness"].is_null()) {
        let impulses: Impulses = contacts.iter().map(|contact| [contact.begin, contact.impulse]).collect();
        if !impulses.is_empty() {
            rigid.push(stems(table, "impulse on a node", impulses));
        }
    }
    compliant.append(&mut rigid);
    (!compliant.is_empty()).then(|| panels(Figure::new(title), compliant))
}

/// Height of a panel, in points.
const HEIGHT: f64 = 100.0;

/// Plots impulses as lines from zero.
fn stems(table: &Table, label: &str, impulses: Impulses) -> Panel {
    // A NaN interrupts the line.
    let stem = |[time, impulse]: [f64; 2]| [[time, 0.0], [time, impulse], [f64::NAN; 2]];
    let stems = Curve::new("", impulses.into_iter().flat_map(stem).collect()).palette(1).width(0.7);
    Panel::new(time(table), Axis::linear(label, "N s").with([0.0])).height(HEIGHT).curve(stems)
}

/// Returns the contacts in the impulses since the last row, which are zero between contacts; each
/// is at its first row.
fn impulses_of_contacts(times: &[f64], impulses: &[f64]) -> Impulses {
    let rows: Vec<(f64, f64)> = times.iter().copied().zip(impulses.iter().copied()).collect();
    let contacts = rows.chunk_by(|(_, before), (_, after)| (*before != 0.0) == (*after != 0.0));
    let sum = |rows: &[(f64, f64)]| [rows[0].0, rows.iter().map(|(_, impulse)| impulse).sum()];
    contacts.map(sum).filter(|[_, impulse]| *impulse != 0.0).collect()
}

/// Plots the force of an obstacle at rest over the gap at each probe of a deflection that faces it.
fn over_gap(
    table: &Table,
    obstacle: &Value,
    force: &[f64],
    opposite: &BTreeMap<String, Vec<f64>>,
    axis: impl Fn() -> Axis,
) -> Vec<Panel> {
    let Some(height) = obstacle["height"].as_f64() else { return Vec::new() };
    let sign = if obstacle["side"] == "below" { 1.0 } else { -1.0 };
    let is_opposite = |probe: &str| opposite.get(probe).is_some_and(|heights| heights.contains(&height));
    let panel = |(index, probe, deflection): (usize, &str, &[f64])| {
        let points = deflection.iter().zip(force).map(|(w, f)| [sign * (w - height), *f]);
        let curve = Curve::new(probe, near_contact(points.collect())).style(index).dashes(0).width(0.5);
        Panel::new(Axis::linear("gap", "m").with([0.0]), axis()).height(HEIGHT).curve(curve)
    };
    table.deflections().filter(|(_, probe, _)| is_opposite(probe)).map(panel).collect()
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The sum of the contacts is the whole impulse, and each begins at its first row.
    #[test]
    fn rows_in_contact_that_follow_each_other_are_one_contact() {
        let times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        let contacts = impulses_of_contacts(&times, &[0.0, 1.0, 2.0, 0.0, 0.0, 4.0]);
        assert_eq!(contacts, [[0.1, 3.0], [0.5, 4.0]]);
        assert!(impulses_of_contacts(&times, &[0.0; 6]).is_empty());
    }
}
