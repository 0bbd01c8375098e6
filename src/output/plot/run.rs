//! Plots of a run, from the files of its folder.

use super::axis::unit;
use super::paper::blend;
use super::plan::plan;
use super::{Axis, Bar, Color, Curve, Figure, Obstacle, Panel, Ramp, short};
use crate::geometry::range;
use crate::output::contacts::Contact;
use crate::output::history::{ProbeChart, Table};
use crate::scene::ProbeQuantity;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use std::collections::BTreeMap;

/// Largest number of probes with a panel of their own.
const MOST_PROBES: usize = 4;
/// Approximate limit on the bars of a contact map.
const MOST_BARS: f64 = 10_000.0;
/// Height of the panel of forces, in points.
const FORCES: f64 = 90.0;
/// Least initial energy, relative to the largest, to which energies are related.
const LEAST_START: f64 = 0.05;

/// Plots the deflections at the probes with the obstacles, their other quantities, the forces of
/// named supports and obstacles, and the energies relative to their start.
///
/// Panels without curves are left out.
pub fn history(table: &Table, title: &str, obstacles: &[Obstacle]) -> Figure {
    let times = column(table, "time");
    let quantity = |ProbeChart { title, unit, probes }: ProbeChart| {
        let curves = probes.into_iter();
        let curves = curves.map(|(index, name, values)| Curve::of(name, times, values).style(index));
        let obstacles = if title == "deflection" { obstacles } else { &[] };
        let panel = Panel::new(time(table), Axis::linear(title, unit));
        panel.curves(curves).obstacles(obstacles).without_x_labels()
    };
    let start = start(table);
    let axis = match start {
        Some(start) => Axis::linear("energy / initial", "").per(start),
        None => Axis::linear("energy", "J"),
    };
    let energies = Panel::new(time(table), axis.with([0.0])).height(66.0).curves(energies(table));
    let panels = table.charts().into_iter().map(quantity);
    let figure = panels.fold(Figure::new(title), Figure::panel);
    if table.forces().next().is_none() {
        return figure.panel(energies);
    }
    let curves = table.forces().enumerate();
    let curves = curves.map(|(index, (name, values))| Curve::of(name, times, values).style(index));
    let forces = Panel::new(time(table), Axis::linear("force", "N").with([0.0]));
    figure.panel(forces.height(FORCES).curves(curves).without_x_labels()).panel(energies)
}

/// Plots the energies, the change of their sum since the start, and the force of the obstacles. Of
/// a driven plate it plots what was put in and lost in place of that change.
pub fn energy(table: &Table, title: &str) -> Figure {
    let times = column(table, "time");
    let energies = Panel::new(time(table), Axis::linear("energy", "J").with([0.0])).curves(energies(table));
    let work = |name, work: &[f64]| Curve::of(name, times, work).palette(2).dashes(2);
    let [energies, drift] = match start(table) {
        Some(start) => {
            let works = is_any(table, "work").then(|| work("work", column(table, "work")));
            let change = table.since_start("energy", 1.0 / start);
            let change = Curve::of("", times, &change).color(Color::BLACK);
            let change =
                Panel::new(time(table), Axis::linear("change / initial", "").with([0.0])).curve(change);
            [energies.curves(works), change]
        }
        None => {
            let lost = Curve::of("lost", times, &table.since_start("energy", -1.0)).palette(1);
            let exchanged = [work("put in", &table.since_start("work", 1.0)), lost];
            let axis = Axis::linear("since the start", "J").with([0.0]);
            [energies, Panel::new(time(table), axis).curves(exchanged)]
        }
    };
    let (energies, drift) = (energies.without_x_labels(), drift.height(56.0));
    let has_force = is_any(table, "contact_force");
    let drift = if has_force { drift.without_x_labels() } else { drift };
    let figure = Figure::new(title).panel(energies).panel(drift);
    if !has_force {
        return figure;
    }
    let force = Curve::of("", times, column(table, "contact_force")).palette(1).width(0.6);
    figure.panel(Panel::new(time(table), Axis::linear("obstacle force", "N")).height(56.0).curve(force))
}

/// Plots the contacts of each node over time, and a map of the nodes.
///
/// Nodes are ordered by their position along the plate. `outline` is the boundary of the plate, as
/// pairs of points in m.
pub fn contacts(contacts: &[Contact], table: &Table, title: &str, outline: &[[[f64; 2]; 2]]) -> Figure {
    let mut nodes: Vec<&Contact> = contacts.iter().collect();
    nodes.sort_by(|a, b| {
        a.at[0].total_cmp(&b.at[0]).then(a.at[1].total_cmp(&b.at[1])).then(a.node.cmp(&b.node))
    });
    nodes.dedup_by_key(|contact| contact.node);
    let place: BTreeMap<usize, usize> =
        nodes.iter().enumerate().map(|(i, contact)| (contact.node, i)).collect();
    let mut total = vec![0.0; nodes.len()];
    for contact in contacts {
        total[place[&contact.node]] += contact.impulse.abs();
    }
    let end = column(table, "time").last().copied().unwrap_or(0.0);
    let rows = nodes.len() as f64;
    let bars = joined(contacts, end * rows / MOST_BARS);
    let largest = bars.iter().map(|bar| bar.2.abs()).fold(0.0, f64::max);
    // Impulses extend over decades, of which three are shown.
    let share = move |impulse: f64| 1.0 + (impulse.abs() / largest).max(1e-3).log10() / 3.0;
    let bar = |&(node, x, impulse): &(usize, [f64; 2], f64)| {
        let y = place[&node] as f64;
        Bar { x, y: [y + 0.55, y + 1.45], color: heat(share(impulse)) }
    };
    // The numbers are those of contacts.csv.
    let numbers = nodes.iter().map(|contact| contact.node.to_string());
    let axis = Axis::linear("contact node", "").named(numbers).within(0.5, rows + 0.5);
    let map = Panel::new(time(table), axis)
        .height((7.0 * rows).clamp(60.0, 150.0))
        .bars(bars.iter().map(bar))
        .ramp(Ramp::new("impulse", "N s", [1e-3 * largest, largest], heat));
    let most = total.iter().copied().fold(0.0, f64::max);
    let (plan, _) = plan(outline, nodes.iter().map(|contact| contact.at));
    let mut plan = plan.heading("Where the nodes are; impulse of the whole run:");
    for (contact, impulse) in nodes.iter().zip(&total) {
        let size = (impulse / most).sqrt().max(0.25);
        plan = plan.curve(Curve::new("", vec![contact.at]).palette(1).marks(0).size(size).scattered());
    }
    let (newton_second, one) = unit("N s", most);
    let largest_node = format!("{} {newton_second}", short(most / one));
    let largest_node = Curve::new(largest_node, Vec::new()).palette(1).marks(0).scattered();
    let plan = plan.curve(largest_node);
    Figure::new(title).panel(map).panel(plan)
}

/// Returns node, interval (s) and impulse (N s) of contacts, joined where closer than `apart` s.
pub(super) fn joined(contacts: &[Contact], apart: f64) -> Vec<(usize, [f64; 2], f64)> {
    let mut of_node: BTreeMap<usize, Vec<(usize, [f64; 2], f64)>> = BTreeMap::new();
    for &Contact { node, begin, end, impulse, .. } in contacts {
        let bars = of_node.entry(node).or_default();
        match bars.last_mut() {
            Some((_, [_, last], sum)) if begin - *last < apart => {
                *last = last.max(end);
                *sum += impulse;
            }
            _ => bars.push((node, [begin, end], impulse)),
        }
    }
    of_node.into_values().flatten().collect()
}

/// Plots velocity over deflection of each probe of a deflection, with the heights (m) of the
/// obstacles it faces.
///
/// `opposite` has these heights by name of the probe, and `obstacles` names them.
pub fn phase(
    table: &Table,
    title: &str,
    opposite: &BTreeMap<String, Vec<f64>>,
    obstacles: &[Obstacle],
) -> Figure {
    let named = |height: f64| {
        let mut names = obstacles.iter().filter_map(|obstacle| match obstacle {
            Obstacle::Part(place, name) if *place == height => Some(&**name),
            _ => None,
        });
        (height, names.next().unwrap_or("obstacle"))
    };
    let times = column(table, "time");
    let panel = |(index, name, values): (usize, &str, &[f64])| {
        let rate = |i: usize| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(values.len() - 1));
            (values[b] - values[a]) / (times[b] - times[a])
        };
        let points: Vec<[f64; 2]> = (0..values.len()).map(|i| [values[i], rate(i)]).collect();
        let walls = opposite.get(name).into_iter().flatten().map(|&height| named(height));
        let span = values.iter().copied().filter(|w| w.is_finite()).fold(0.0, |m: f64, w| m.max(w.abs()));
        let panel =
            Panel::new(Axis::linear("deflection", "m"), Axis::linear("velocity", "m/s")).height(100.0);
        let panel = faded(points, Curve::new(name, Vec::new()).style(index).dashes(0).width(0.5))
            .into_iter()
            .fold(panel, Panel::curve);
        walls
            .filter(|(height, _)| height.abs() <= 3.0 * span)
            .fold(panel, |panel, (height, remark)| panel.rule_at_x(height, remark))
    };
    panels(Figure::new(title), table.deflections().take(MOST_PROBES).map(panel).collect())
}

/// Number of shades of a path over time.
const SHADES: usize = 12;

/// Returns a path in the style of a curve, from pale at its start to full colour at its end.
fn faded(points: Vec<[f64; 2]>, style: Curve) -> Vec<Curve> {
    let part = points.len().div_ceil(SHADES).max(2);
    let count = points.len().div_ceil(part).max(1);
    let shade = |(number, first): (usize, usize)| {
        let last = (first + part + 1).min(points.len());
        let mut curve = style.clone();
        curve.points = points[first..last].to_vec();
        let age = (count - 1 - number) as f64 / count as f64;
        curve.pen.color = curve.pen.color.towards(Color::WHITE, 0.8 * age);
        if number + 1 < count {
            curve.name.clear();
        }
        curve
    };
    (0..points.len()).step_by(part).enumerate().map(shade).collect()
}

/// Arranges one panel in a column, several in two columns as wide as a page.
pub(super) fn panels(figure: Figure, panels: Vec<Panel>) -> Figure {
    let figure = if panels.len() > 1 { figure.page().columns(2) } else { figure };
    panels.into_iter().fold(figure, Figure::panel)
}

/// Plots the amplitude of each probe's oscillations over frequency, with a Hann window: a panel per
/// quantity, and natural frequencies (Hz) as thin lines with the numbers of the modes.
pub fn spectrum(table: &Table, title: &str, natural: &[f64]) -> Figure {
    let times = column(table, "time");
    let uniform = uniform(times);
    let panel = |axis: (&'static str, &'static str)| {
        let spectra: Vec<(&str, Vec<[f64; 2]>)> = table
            .probes_of(axis)
            .map(|(_, name, values)| (name, amplitudes(&times[..uniform], &values[..uniform])))
            .collect();
        let points = || spectra.iter().flat_map(|(_, points)| points);
        let largest = points().map(|p| p[1]).fold(0.0, f64::max);
        let [first, last] = range(points().map(|p| p[0]));
        let lines = natural_lines(natural, [first, last]);
        let quantity = if axis == ProbeQuantity::Deflection.axis() { "amplitude" } else { axis.0 };
        let mut amplitude = Axis::log(quantity, axis.1);
        let mut frequency = Axis::log("frequency", "Hz").tight();
        if largest > 0.0 && first > 0.0 {
            // Smaller amplitudes are due to rounding or to the window; numbers stand above curves.
            let room = if lines.is_empty() { 2.0 } else { 20.0 };
            amplitude = amplitude.within(1e-7 * largest, room * largest).in_unit_of(largest);
            frequency = frequency.within(first, last);
        }
        let curves = spectra
            .into_iter()
            .enumerate()
            .map(|(i, (name, points))| Curve::new(name, points).style(i).width(0.6));
        let panel = Panel::new(frequency, amplitude).height(110.0).curves(curves);
        lines.into_iter().fold(panel, |panel, (line, remark)| panel.rule_at_x(line, remark))
    };
    table.axes().into_iter().map(panel).fold(Figure::new(title), Figure::panel)
}

/// Part of a logarithmic axis within which the numbers of modes stand together, such as "12–17".
const APART: f64 = 0.14;

/// Returns the natural frequencies (Hz, ascending) between two ends with the numbers of their
/// modes, where those of close ones are beside the first.
fn natural_lines(natural: &[f64], [low, high]: [f64; 2]) -> Vec<(f64, String)> {
    let mut lines: Vec<(f64, String)> = Vec::new();
    let mut labelled = (0, 0);
    for (&frequency, number) in natural.iter().zip(1..).filter(|(f, _)| (low..=high).contains(*f)) {
        let (line, first) = labelled;
        let mut remark = String::new();
        match lines.get_mut(line) {
            Some((start, remarks)) if frequency < *start * (high / low).powf(APART) => {
                *remarks = format!("{first}\u{2013}{number}");
            }
            _ => (labelled, remark) = ((lines.len(), number), number.to_string()),
        }
        lines.push((frequency, remark));
    }
    lines
}

/// Returns how many of the first times are equally spaced; the last row of a run may come early.
pub fn uniform(times: &[f64]) -> usize {
    let Some(step) = times.get(1).map(|second| second - times[0]) else { return times.len() };
    let even = |ends: &[f64]| (ends[1] - ends[0] - step).abs() < 1e-3 * step;
    times.windows(2).position(|ends| !even(ends)).map_or(times.len(), |odd| odd + 1)
}

/// Returns frequencies (Hz) and amplitudes of equally spaced values, by a windowed Fourier
/// transform.
///
/// With the Hann window, an oscillation at the centre of a bin has its own amplitude there, and
/// half of it in the adjacent bins.
pub fn amplitudes(times: &[f64], values: &[f64]) -> Vec<[f64; 2]> {
    let count = values.len();
    if count < 8 || values.iter().any(|value| !value.is_finite()) {
        return Vec::new();
    }
    let mean = values.iter().sum::<f64>() / count as f64;
    let turn = std::f64::consts::TAU / count as f64;
    // The mean of the window is one half.
    let window = |i: usize| 0.5 - 0.5 * (turn * i as f64).cos();
    let mut transform: Vec<Complex<f64>> =
        values.iter().enumerate().map(|(i, value)| Complex::new((value - mean) * window(i), 0.0)).collect();
    FftPlanner::new().plan_fft_forward(count).process(&mut transform);
    let duration = (times[count - 1] - times[0]) * count as f64 / (count - 1) as f64;
    let bin = |i: usize| [i as f64 / duration, 4.0 * transform[i].norm() / count as f64];
    (1..=count / 2).map(bin).collect()
}

fn column<'t>(table: &'t Table, name: &str) -> &'t [f64] {
    table.column(name).unwrap_or_default()
}

/// Creates the axis of all times.
pub(super) fn time(table: &Table) -> Axis {
    let times = column(table, "time");
    Axis::linear("time", "s").with(times.first().into_iter().chain(times.last()).copied()).tight()
}

/// Creates the energy curves, in colours that differ in grey, for data too dense for dashes.
fn energies(table: &Table) -> [Curve; 3] {
    let curve = |name| Curve::of(name, column(table, "time"), column(table, name));
    let whole = match start(table) {
        Some(_) => curve("energy"),
        None => Curve::of("kinetic + elastic", column(table, "time"), &table.stored()),
    };
    [whole.color(Color::BLACK).width(1.5), curve("elastic").palette(0), curve("kinetic").palette(4).dashes(1)]
}

/// Returns the initial energy, if it is large enough as a reference for others.
fn start(table: &Table) -> Option<f64> {
    let energies = ["energy", "elastic", "kinetic"].into_iter().flat_map(|name| column(table, name));
    let largest =
        energies.filter(|e| e.is_finite()).fold(0.0, |largest: f64, energy| largest.max(energy.abs()));
    let start = column(table, "energy").iter().copied().find(|energy| energy.is_finite())?;
    (start > LEAST_START * largest && start < 1e100 && start > 1e-100).then_some(start)
}

fn is_any(table: &Table, name: &str) -> bool {
    column(table, name).iter().any(|value| *value != 0.0)
}

/// Returns a colour from light to dark.
fn heat(share: f64) -> Color {
    let stops = [Color(254, 224, 182), Color(230, 130, 60), Color(160, 40, 40), Color(40, 5, 30)];
    blend(&stops, share)
}

#[cfg(test)]
mod tests {
    use super::natural_lines;

    #[test]
    fn numbers_of_close_modes_stand_together() {
        let lines = natural_lines(&[0.0, 10.0, 12.0, 13.0, 20.0, 300.0], [5.0, 100.0]);
        let expected = [(10.0, "2\u{2013}4"), (12.0, ""), (13.0, ""), (20.0, "5")];
        assert_eq!(lines, expected.map(|(frequency, remark)| (frequency, remark.to_owned())));
    }
}
