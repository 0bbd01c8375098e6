//! Picture of runs in parallel coordinates: a line per run, which meets one axis per key and per
//! main measure.

use super::quantities::{is_main, quantities};
use super::report::SweepReport;
use super::row::SweepRow;
use crate::geometry::range;
use crate::output::plot::perspective::spread;
use crate::output::plot::{Axis, Color, Curve, Figure, Panel, Ramp};
use crate::output::text::{engineering, significant, typeset};
use crate::scene::unit;

/// Largest number of runs that are drawn.
const MOST_RUNS: usize = 400;

/// Returns the picture, whose colours tell the last of the measures that vary.
pub(super) fn figure(report: &SweepReport) -> Figure {
    let measured = || report.rows.iter().filter(|row| row.measures.is_some());
    let numbers: Vec<usize> = (0..measured().count()).collect();
    let drawn = spread(&numbers, MOST_RUNS);
    let is_drawn = |run: &usize| drawn.binary_search(&run).is_ok();
    let runs: Vec<SweepRow> =
        (0..).zip(measured()).filter(|(run, _)| is_drawn(run)).map(|(_, row)| row).collect();
    let mut axes = Vec::new();
    for (key, name) in report.keys.iter().enumerate() {
        let values: Vec<f64> = runs.iter().map(|row| row.values[key]).collect();
        axes.push((name.clone(), unit(name).unwrap_or_default(), values));
    }
    for quantity in quantities(&report.probes).into_iter().filter(|quantity| is_main(&quantity.name)) {
        let values = runs.iter().map(|row| quantity.of_row(row).unwrap_or(f64::NAN));
        axes.push((quantity.name.clone(), quantity.unit.to_owned(), values.collect()));
    }
    axes.retain(|(_, _, values)| values.iter().any(|value| *value != values[0]));
    let Some((name, unit, colored)) = axes.last() else { return Figure::new(&report.title) };
    let ends: Vec<[f64; 2]> = axes.iter().map(|(_, _, values)| range(values.iter().copied())).collect();
    let share = |axis: usize, run: usize| {
        let [low, high] = ends[axis];
        (axes[axis].2[run] - low) / (high - low)
    };
    // Earlier curves are drawn on top.
    let mut order: Vec<usize> = (0..runs.len()).collect();
    order.sort_by(|one, other| colored[*other].total_cmp(&colored[*one]));
    let curves = order.into_iter().map(|run| {
        let points = (0..axes.len()).map(|axis| [share(axis, run), (axes.len() - axis) as f64]);
        let color = shade(share(axes.len() - 1, run));
        Curve::new("", points.collect()).color(color).width(0.4)
    });
    let names = axes.iter().zip(&ends).map(|((name, unit, _), ends)| {
        // A prefix without a unit would look like one.
        let word = |end| if unit.is_empty() { significant(end) } else { typeset(&engineering(end, unit)) };
        let [low, high] = ends.map(word);
        format!("{name}, {low} to {high}")
    });
    let y = Axis::linear("", "").named(names.rev()).within(0.8, axes.len() as f64 + 0.2);
    let x = Axis::linear("share of the range", "").within(0.0, 1.0);
    let ramp = Ramp::new(name, unit, ends[ends.len() - 1], shade);
    let panel = Panel::new(x, y).height(32.0 * axes.len() as f64).curves(curves).ramp(ramp);
    Figure::new(&report.title).page().panel(panel)
}

/// Returns the colour of a share from 0, pale yellow, to 1, dark blue.
pub(super) fn shade(share: f64) -> Color {
    Color(255, 247, 188).towards(Color(8, 48, 107), share)
}
