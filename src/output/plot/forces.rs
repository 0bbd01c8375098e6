//! Forces of stops: over time and the gap where they yield, as impulses where they are rigid.

use super::run::{joined, panels, time};
use super::{Axis, Curve, Figure, Panel};
use crate::geometry::range;
use crate::output::answers::force_of;
use crate::output::contacts::Contact;
use crate::output::history::Table;
use crate::output::text::typeset;
use crate::simulation::JOINED;
use serde_json::Value;
use std::collections::BTreeMap;

/// Contacts of a stop, each with an instant (s) and an impulse (N s).
type Impulses = Vec<[f64; 2]>;

/// Largest number of stops with panels of their own.
const MOST_STOPS: usize = 12;
/// Part of the largest force of a stop that is rounding of a difference.
const ROUNDING: f64 = 1e-9;
/// Part of the run below which a panel shows the time of the contacts alone.
const BRIEF: f64 = 0.1;

/// Plots each obstacle and ball that was touched, under what the run tells of it: the force of a
/// compliant one over time, with the peak of all steps, and over the gap at each probe of a
/// deflection that faces it at rest, or a ball whose height is a probe; otherwise the impulse of
/// each contact, since the force of a rigid one depends on the time step; the peak alone where
/// contacts are not told apart. `None` if there is nothing to plot.
///
/// The history has the force of a named stop; the sum of all has the force of the only one without
/// a name. `opposite` has the heights of the obstacles that each probe faces, in m. A gap is
/// negative where a compliant stop yields.
pub fn forces(
    table: &Table,
    contacts: &[Contact],
    summary: &Value,
    title: &str,
    opposite: &BTreeMap<String, Vec<f64>>,
) -> Option<Figure> {
    let times = table.column("time").unwrap_or_default();
    let (stops, has_one_nameless) = touched(summary);
    let nodes: Vec<Option<usize>> = stops.iter().map(|stop| stop.node(contacts)).collect();
    let panels_of = |stop: &TouchedStop| {
        let TouchedStop { name, entry, told, is_ball, .. } = stop;
        let of_stop = stop.contacts(contacts, &nodes, &summary["scene"]["time"]["step"]);
        let time = || around(table, of_stop.as_deref().unwrap_or_default());
        let named = table.forces().find(|(other, _)| other == name).map(|(_, force)| force.to_vec());
        let sign = if *is_ball { -1.0 } else { 1.0 };
        let is_rest = has_one_nameless && entry["name"].is_null();
        let rest = || rest(table, summary, told).map(|force| sign * force).collect();
        let force = named.or_else(|| is_rest.then(rest)).filter(|_: &Vec<f64>| !entry["stiffness"].is_null());
        let axis = || Axis::linear(format!("force of {name}"), "N").with([0.0]);
        let peak = told["time_of_peak"].as_f64().zip(told["peak"].as_f64());
        let peak = Curve::new("peak of all steps", peak.map(<[f64; 2]>::from).into_iter().collect());
        let peak = peak.marks(3).size(0.7).scattered();
        let mut panels = Vec::new();
        if let Some(force) = force {
            let curve = Curve::of("", times, &force).palette(1).width(0.6);
            panels.push(Panel::new(time(), axis()).height(HEIGHT).curves([peak, curve]));
            let probes = &summary["scene"]["output"]["probes"];
            panels.extend(over_gap(table, stop, &force, probes, opposite, axis).into_iter().flatten());
        } else if let Some(of_stop) = &of_stop {
            let impulse = |(_, [begin, _], impulse): &(usize, [f64; 2], f64)| [*begin, sign * impulse];
            panels.push(stems(time(), name, of_stop.iter().map(impulse).collect()));
        } else if let Some(impulses) = table.column(&format!("impulse_{name}")) {
            panels.push(stems(time(), name, impulses_of_contacts(times, impulses)));
        } else {
            panels.push(Panel::new(time(), axis()).height(HEIGHT).curve(peak));
        }
        if let Some(first) = panels.first_mut() {
            first.heading = format!("{name}: {}", typeset(&force_of(told)));
        }
        panels
    };
    let drawn: Vec<Panel> = stops.iter().take(MOST_STOPS).flat_map(panels_of).collect();
    (!drawn.is_empty()).then(|| panels(Figure::new(title), drawn))
}

/// Obstacle or ball that was touched.
struct TouchedStop<'s> {
    /// Name that the scene gives it, or else the summary.
    name: String,
    /// Table of the resolved scene.
    entry: &'s Value,
    /// Forces in the summary.
    told: &'s Value,
    is_ball: bool,
    /// Number in its table, from 0.
    number: usize,
}

/// Returns the obstacles and balls of a run that were touched, and whether just one of the scene's
/// has no name.
fn touched(summary: &Value) -> (Vec<TouchedStop<'_>>, bool) {
    let stop = |kind: &'static str| {
        let entries = summary["scene"][kind].as_array().into_iter().flatten().enumerate();
        entries.map(move |(number, entry)| {
            let name = entry["name"].as_str().map_or_else(|| format!("{kind}_{}", number + 1), str::to_owned);
            TouchedStop { told: &summary["forces"][&name], name, entry, is_ball: kind == "ball", number }
        })
    };
    let mut stops: Vec<TouchedStop> = ["obstacle", "ball"].into_iter().flat_map(stop).collect();
    let has_one_nameless = stops.iter().filter(|stop| stop.entry["name"].is_null()).count() == 1;
    stops.retain(|stop| stop.told["impacts"].as_u64() > Some(0));
    (stops, has_one_nameless)
}

/// Returns what the named obstacles leave of the sum of all reactions, in N: the reaction of a stop
/// without a name, whose largest force is told.
fn rest<'t>(table: &'t Table, summary: &Value, told: &Value) -> impl Iterator<Item = f64> + use<'t> {
    let obstacles = summary["scene"]["obstacle"].as_array().into_iter().flatten();
    let is_obstacle = |name: &str| obstacles.clone().any(|obstacle| obstacle["name"] == name);
    let named: Vec<&[f64]> =
        table.forces().filter(|(name, _)| is_obstacle(name)).map(|(_, force)| force).collect();
    let rounding = ROUNDING * told["peak"].as_f64().unwrap_or_default().abs();
    table.column("contact_force").unwrap_or_default().iter().enumerate().map(move |(row, sum)| {
        let rest = sum - named.iter().map(|force| force[row]).sum::<f64>();
        if rest.abs() > rounding { rest } else { 0.0 }
    })
}

impl TouchedStop<'_> {
    /// Returns the node of a stop at a point.
    fn node(&self, contacts: &[Contact]) -> Option<usize> {
        let [x, y]: [f64; 2] = serde_json::from_value(self.entry["at"].clone()).ok()?;
        let distance = |contact: &Contact| (contact.at[0] - x).hypot(contact.at[1] - y);
        contacts.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).map(|contact| contact.node)
    }

    /// Returns the contacts of the stop, with their intervals (s) and impulses (N s).
    ///
    /// A stop has one node, or all nodes that are not `nodes` of other stops; contacts of several
    /// nodes at once are one. `None` where these do not have the stop's impulse, since others touch
    /// there too.
    fn contacts(
        &self,
        contacts: &[Contact],
        nodes: &[Option<usize>],
        step: &Value,
    ) -> Option<Vec<(usize, [f64; 2], f64)>> {
        let sense = if (self.entry["side"] == "below") == self.is_ball { -1.0 } else { 1.0 };
        let node = self.node(contacts);
        let is_node = |other: usize| match node {
            Some(node) => node == other,
            None => !nodes.contains(&Some(other)),
        };
        let is_of = |contact: &&Contact| sense * contact.impulse >= 0.0 && is_node(contact.node);
        let together = |contact: &Contact| Contact { node: node.unwrap_or_default(), ..*contact };
        let mut rows: Vec<Contact> = contacts.iter().filter(is_of).map(together).collect();
        rows.sort_by(|a, b| a.begin.total_cmp(&b.begin));
        let rows = joined(&rows, JOINED * step.as_f64()?);
        let sum = rows.iter().map(|(.., impulse)| impulse.abs()).sum::<f64>();
        let told = self.told["impulse"].as_f64()?.abs();
        ((sum - told).abs() <= 1e-6 * told).then_some(rows)
    }
}

/// Creates the axis of all times or, where contacts take a small part of them, of that part.
fn around(table: &Table, contacts: &[(usize, [f64; 2], f64)]) -> Axis {
    let [begin, end] = range(contacts.iter().flat_map(|(_, ends, _)| *ends));
    let room = 0.2 * (end - begin);
    let last = table.column("time").and_then(<[f64]>::last).copied().unwrap_or_default();
    let is_brief = room > 0.0 && end - begin < BRIEF * last;
    let part = || Axis::linear("time", "s").within((begin - room).max(0.0), (end + room).min(last));
    if is_brief { part() } else { time(table) }
}

/// Height of a panel, in points.
const HEIGHT: f64 = 100.0;

/// Plots impulses as lines from zero.
fn stems(time: Axis, name: &str, impulses: Impulses) -> Panel {
    // A NaN interrupts the line.
    let stem = |[time, impulse]: [f64; 2]| [[time, 0.0], [time, impulse], [f64::NAN; 2]];
    let stems = Curve::new("", impulses.into_iter().flat_map(stem).collect()).palette(1).width(0.7);
    let axis = Axis::linear(format!("impulse of {name}"), "N s").with([0.0]);
    Panel::new(time, axis).height(HEIGHT).curve(stems)
}

/// Returns the contacts in the impulses since the last row, which are zero between contacts; each
/// is at its first row.
fn impulses_of_contacts(times: &[f64], impulses: &[f64]) -> Impulses {
    let rows: Vec<(f64, f64)> = times.iter().copied().zip(impulses.iter().copied()).collect();
    let contacts = rows.chunk_by(|(_, before), (_, after)| (*before != 0.0) == (*after != 0.0));
    let sum = |rows: &[(f64, f64)]| [rows[0].0, rows.iter().map(|(_, impulse)| impulse).sum()];
    contacts.map(sum).filter(|[_, impulse]| *impulse != 0.0).collect()
}

/// Plots the force of an obstacle at rest, or of a ball whose height is a probe, over the gap at
/// each probe of a deflection that faces it. `None` where no height is known.
fn over_gap(
    table: &Table,
    stop: &TouchedStop,
    force: &[f64],
    probes: &Value,
    opposite: &BTreeMap<String, Vec<f64>>,
    axis: impl Fn() -> Axis,
) -> Option<Vec<Panel>> {
    let &TouchedStop { entry, is_ball, number, .. } = stop;
    let probes = probes.as_array().into_iter().flatten();
    let height = entry["height"].as_f64()?;
    let heights = match is_ball {
        true => table.column(probes.clone().find(|probe| probe["ball"] == number)?["name"].as_str()?)?,
        false => &vec![height; force.len()],
    };
    let sign = if entry["side"] == "below" { 1.0 } else { -1.0 };
    let is_site = |probe: &Value| ["at", "point"].iter().any(|k| !probe[k].is_null() && probe[k] == entry[k]);
    let is_opposite = |name: &str| match is_ball {
        true => probes.clone().any(|probe| probe["name"] == name && is_site(probe)),
        false => opposite.get(name).is_some_and(|heights| heights.contains(&height)),
    };
    let panel = |(index, probe, deflection): (usize, &str, &[f64])| {
        let places = deflection.iter().zip(heights).map(|(w, height)| sign * (w - height));
        let points = places.zip(force).map(|(gap, force)| [gap, *force]);
        let curve = Curve::new(probe, near_contact(points.collect())).style(index).dashes(0).width(0.5);
        Panel::new(Axis::linear("gap", "m").with([0.0]), axis()).height(HEIGHT).curve(curve)
    };
    Some(table.deflections().filter(|(_, probe, _)| is_opposite(probe)).map(panel).collect())
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
    use serde_json::json;

    /// Stops without a name have their own contacts, also where a release lasted a single step;
    /// contacts that two of them share belong to none.
    #[test]
    fn contacts_belong_to_the_stop_at_their_node() {
        let contact = |node: usize, begin: f64, end: f64, impulse: f64| Contact {
            node,
            at: [node as f64, 0.0],
            begin,
            end,
            impulse,
        };
        let contacts = [contact(3, 0.5, 0.6, 2.0), contact(1, 0.2, 0.3, 1.0), contact(3, 0.8, 0.9, 4.0)];
        let mut summary = json!({
            "scene": {
                "time": { "step": 0.1 },
                "obstacle": [{ "side": "below", "at": [1, 0] }, { "side": "below", "where": "x > 2" }],
                "ball": [{ "side": "above", "at": [8, 0] }],
            },
            "forces": {
                "obstacle_1": { "impacts": 1, "impulse": 1.0 },
                "obstacle_2": { "impacts": 1, "impulse": 6.0 },
                "ball_1": { "impacts": 0, "impulse": 0.0 },
            },
        });
        let told = |summary: &Value| {
            let (stops, has_one_nameless) = touched(summary);
            assert!(
                !has_one_nameless && stops.iter().map(|stop| &stop.name).eq(["obstacle_1", "obstacle_2"])
            );
            let nodes: Vec<_> = stops.iter().map(|stop| stop.node(&contacts)).collect();
            let step = &summary["scene"]["time"]["step"];
            stops.iter().map(|stop| stop.contacts(&contacts, &nodes, step)).collect::<Vec<_>>()
        };
        let expected = [vec![(1, [0.2, 0.3], 1.0)], vec![(0, [0.5, 0.9], 6.0)]];
        assert_eq!(told(&summary), expected.map(Some));
        summary["scene"]["obstacle"][0]["at"] = Value::Null;
        assert_eq!(told(&summary), [None, None]);
    }

    /// The sum of the contacts is the whole impulse, and each begins at its first row.
    #[test]
    fn rows_in_contact_that_follow_each_other_are_one_contact() {
        let times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        let contacts = impulses_of_contacts(&times, &[0.0, 1.0, 2.0, 0.0, 0.0, 4.0]);
        assert_eq!(contacts, [[0.1, 3.0], [0.5, 4.0]]);
        assert!(impulses_of_contacts(&times, &[0.0; 6]).is_empty());
    }
}
