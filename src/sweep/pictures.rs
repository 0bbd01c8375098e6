//! Pictures of a sweep: bifurcation diagram and response curves over one key, maps over two; those
//! of random values and of more keys have files of their own.

use super::basins::Basins;
use super::measures::Measures;
use super::parallel::{self, shade};
use super::plan::Direction;
use super::random_pictures;
use super::report::SweepReport;
use super::row::ProbeHead;
use crate::geometry::range;
use crate::output::plot::{Axis, Bar, Color, Curve, Figure, Panel, Ramp};
use crate::scene::unit;

/// Names of the pictures, without their extensions.
pub const PICTURES: [&str; 8] =
    ["bifurcation", "response", "map", "parallel", "histograms", "distributions", "sensitivities", "basins"];

/// Largest number of attractors in the key of a picture.
const MOST_NAMED: usize = 7;

/// Largest number of probes with a panel of their own.
const MOST_PROBES: usize = 4;

/// Directions with their names and styles.
const DIRECTIONS: [(Direction, &str); 3] =
    [(Direction::Apart, ""), (Direction::Up, "up"), (Direction::Down, "down")];

/// Returns the pictures of a sweep with their names.
pub fn figures(report: &SweepReport) -> Vec<(&'static str, Figure)> {
    let mut figures = Vec::new();
    if let Some(statistics) = &report.statistics {
        figures.extend(random_pictures::figures(report, statistics));
    } else if report.keys.len() == 1 {
        if !report.probes.is_empty() {
            figures.push((PICTURES[0], bifurcation(report)));
        }
        figures.push((PICTURES[1], response(report)));
    } else if report.keys.len() == 2 {
        figures.push((PICTURES[2], map(report)));
    }
    if let Some(basins) = report.basins.as_ref().filter(|_| report.keys.len() == 2) {
        figures.push((PICTURES[7], basins_of(report, basins)));
    }
    if report.keys.len() > 2 {
        figures.push((PICTURES[3], parallel::figure(report)));
    }
    figures.into_iter().map(|(name, figure)| (name, figure.note(&report.command))).collect()
}

/// Returns the values and measures of the runs of a direction that did not fail.
fn runs_of(report: &SweepReport, direction: Direction) -> impl Iterator<Item = (Vec<f64>, Measures)> {
    let runs = report.rows.iter().filter(move |row| row.direction == direction);
    runs.filter_map(|row| Some((row.values, row.measures?)))
}

/// Returns the directions that occur, each with its name and its place in the palette.
fn directions(report: &SweepReport) -> impl Iterator<Item = (Direction, &'static str, usize)> {
    let named = DIRECTIONS.into_iter().filter(|(way, _)| report.rows.iter().any(|row| row.direction == *way));
    named.map(|(way, name)| (way, name, usize::from(way == Direction::Down)))
}

/// Returns the axis of the swept values.
fn key_axis(report: &SweepReport, key: usize) -> Axis {
    let name = report.keys.get(key).cloned().unwrap_or_default();
    let unit = unit(&name).unwrap_or_default();
    Axis::linear(name, unit).with(report.rows.iter().map(|row| row.values[key])).tight()
}

/// Plots the section of each probe over the swept key.
fn bifurcation(report: &SweepReport) -> Figure {
    let panel = |(index, probe): (usize, &ProbeHead)| {
        let panel = Panel::new(key_axis(report, 0), Axis::linear(label(report, probe), &*probe.unit));
        let curves = directions(report).map(|(direction, name, color)| {
            let points = runs_of(report, direction).flat_map(|(values, mut measures)| {
                let section = std::mem::take(&mut measures.probes[index].section);
                section.into_iter().map(move |value| [values[0], value])
            });
            Curve::new(name, points.collect()).distinct().palette(color).marks(0).size(0.12).scattered()
        });
        panel.height(if report.probes.len() == 1 { 150.0 } else { 110.0 }).curves(curves)
    };
    let panels = report.probes.iter().take(MOST_PROBES).enumerate().map(panel);
    panels.fold(Figure::new(format!("{}: once per period", report.title)), Figure::panel)
}

/// Returns the label of a probe's axis.
fn label(report: &SweepReport, probe: &ProbeHead) -> String {
    if report.probes.len() == 1 {
        probe.quantity.clone()
    } else {
        format!("{} {}", probe.name, probe.quantity)
    }
}

/// Quantity of a run: its name, its unit, and its value; `None` where it has none.
type Quantity<'q> = (String, &'q str, Box<dyn Fn(&Measures) -> Option<f64> + 'q>);

/// Returns half the range of some probes with their names, and what the runs have of forces, impact
/// velocities and exponents.
fn quantities(report: &SweepReport, probes: usize, name: impl Fn(&ProbeHead) -> String) -> Vec<Quantity<'_>> {
    let mut quantities: Vec<Quantity> = Vec::new();
    for (index, probe) in report.probes.iter().take(probes).enumerate() {
        let value = move |run: &Measures| run.probes.get(index).map(|probe| 0.5 * (probe.max - probe.min));
        quantities.push((name(probe), &probe.unit, Box::new(value)));
    }
    if report.has_contact {
        quantities.push(("peak force".into(), "N", Box::new(|run| Some(run.peak_force))));
        quantities.push(("impact velocity".into(), "m/s", Box::new(|run| Some(run.impact_velocity))));
    }
    if report.rows.iter().filter_map(|row| row.measures).any(|run| run.lyapunov.is_some()) {
        quantities.push(("Lyapunov exponent".into(), "1/s", Box::new(|run| run.lyapunov)));
    }
    quantities
}

/// Returns crosses at the places of runs whose motion does not repeat, if there are any: a value of
/// such a run changes with the number of periods.
fn unsettled(
    runs: impl Iterator<Item = (Vec<f64>, Measures)>,
    place: impl Fn(&[f64], &Measures) -> Option<[f64; 2]>,
) -> Option<Curve> {
    // Without a probe nothing tells whether a motion repeats.
    let unsettled = runs.filter(|(_, run)| run.period.is_none() && !run.probes.is_empty());
    let points: Vec<[f64; 2]> = unsettled.filter_map(|(values, run)| place(&values, &run)).collect();
    let name = "does not repeat";
    (!points.is_empty()).then(|| Curve::new(name, points).color(Color::GREY).marks(4).size(0.8).scattered())
}

/// Plots half the range of each probe, the peak force and the exponent over the swept key.
fn response(report: &SweepReport) -> Figure {
    let quantities =
        quantities(report, MOST_PROBES, |probe| format!("{}: half the range", label(report, probe)));
    let last = quantities.len().saturating_sub(1);
    let panel = |(index, (name, unit, value)): (usize, Quantity)| {
        let curves = directions(report).map(|(direction, name, color)| {
            let points = runs_of(report, direction)
                .map(|(values, measures)| [values[0], value(&measures).unwrap_or(f64::NAN)]);
            // A single run is no line.
            let curve = Curve::new(name, points.collect()).palette(color).dashes(color).width(0.8);
            curve.marks(color).size(0.35)
        });
        let axis = Axis::linear(name, unit).with([0.0]);
        let panel = Panel::new(key_axis(report, 0), axis).height(80.0).curves(curves);
        let runs = directions(report).flat_map(|(direction, ..)| runs_of(report, direction));
        let panel = panel.curves(unsettled(runs, |values, run| Some([values[0], value(run)?])));
        if index < last { panel.without_x_labels() } else { panel }
    };
    quantities.into_iter().enumerate().map(panel).fold(Figure::new(&report.title), Figure::panel)
}

/// Plots measures over both keys, one panel per measure and direction.
fn map(report: &SweepReport) -> Figure {
    let quantities = quantities(report, 1, |probe| format!("half the range of {}", probe.name));
    let mut figure = Figure::new(&report.title);
    for (name, unit, value) in &quantities {
        for (direction, sense, _) in directions(report) {
            let sense = if sense.is_empty() { String::new() } else { format!(", {sense}") };
            figure = figure.panel(map_panel(report, direction, [&format!("{name}{sense}"), unit], &**value));
        }
    }
    figure
}

/// Plots the attractor of each run over both keys, in a colour each; motions that do not repeat are
/// grey, failed runs white.
fn basins_of(report: &SweepReport, basins: &Basins) -> Figure {
    let edges = [0, 1].map(|key| edges(report.rows.iter().map(|row| row.values[key]).collect()));
    let runs = report.rows.iter().filter(|row| row.measures.is_some());
    let bars = runs.filter_map(|row| {
        let [x, y] = [0, 1].map(|key| cell(&edges[key], row.values[key]));
        let color = basins.labels.get(&row.index).map_or(Color::SHADE, |label| Color::of_palette(*label));
        Some(Bar { x: x?, y: y?, color })
    });
    let names = basins.attractors.iter().enumerate().take(MOST_NAMED).map(|(index, attractor)| {
        let name = format!("period {}, {:.1} %", attractor.period, 100.0 * attractor.fraction);
        Curve::new(name, vec![[f64::NAN; 2]]).color(Color::of_palette(index)).marks(1).scattered()
    });
    let axis = |key: usize| key_axis(report, key).with(edges[key].iter().flat_map(|edge| edge.1)).tight();
    let panel = Panel::new(axis(0), axis(1)).height(200.0).bars(bars).curves(names);
    Figure::new(format!("{}: attractors", report.title)).panel(panel)
}

/// Returns the ends of the cell of a value.
fn cell(edges: &[(f64, [f64; 2])], value: f64) -> Option<[f64; 2]> {
    edges.iter().find(|edge| edge.0 == value).map(|edge| edge.1)
}

/// Plots one measure over both keys; failed runs stay white.
fn map_panel(
    report: &SweepReport,
    direction: Direction,
    [quantity, unit]: [&str; 2],
    value: &dyn Fn(&Measures) -> Option<f64>,
) -> Panel {
    let cells: Vec<([f64; 2], f64)> = runs_of(report, direction)
        .filter_map(|(values, measures)| Some(([values[0], values[1]], value(&measures)?)))
        .collect();
    let [low, high] = range(cells.iter().map(|cell| cell.1));
    let edges = [0, 1].map(|key| edges(report.rows.iter().map(|row| row.values[key]).collect()));
    let bars = cells.iter().filter_map(|(place, value)| {
        let [x, y] = [0, 1].map(|key| cell(&edges[key], place[key]));
        let share = if high > low { (value - low) / (high - low) } else { 0.0 };
        Some(Bar { x: x?, y: y?, color: shade(share) })
    });
    let axis = |key: usize| {
        let ends = edges[key].iter().flat_map(|edge| edge.1);
        key_axis(report, key).with(ends).tight()
    };
    let ramp = Ramp::new(quantity, unit, [low, high], shade);
    let place = |values: &[f64], run: &Measures| value(run).map(|_| [values[0], values[1]]);
    // Grey would not show on colours between the ends.
    let crosses = unsettled(runs_of(report, direction), place).map(|crosses| crosses.palette(1));
    Panel::new(axis(0), axis(1)).height(130.0).bars(bars).curves(crosses).ramp(ramp)
}

/// Returns different values, each with the ends of its cell, half-way to its neighbours.
fn edges(mut values: Vec<f64>) -> Vec<(f64, [f64; 2])> {
    values.sort_by(f64::total_cmp);
    values.dedup();
    let last = values.len() - 1;
    let between = |i: usize| 0.5 * (values[i] + values[i + 1]);
    let cell = |i: usize| {
        let low = if i > 0 { between(i - 1) } else { values[0] - 0.5 * (values[last.min(1)] - values[0]) };
        let high =
            if i < last { between(i) } else { values[i] + 0.5 * (values[i] - values[i.saturating_sub(1)]) };
        (values[i], [low, high])
    };
    (0..values.len()).map(cell).collect()
}
