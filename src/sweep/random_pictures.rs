//! Pictures of a sweep with random values: histograms and distributions of the measures, and
//! sensitivity indices.

use super::quantities::{Quantity, is_main, quantities};
use super::report::SweepReport;
use super::statistics::{MeasureStatistics, Sensitivity, SweepStatistics};
use crate::output::plot::{Axis, Bar, Color, Curve, Figure, Panel};

/// Colours of the bars: the whole, and a part of it.
const BARS: [Color; 2] = [Color(166, 206, 227), Color(0, 114, 178)];

/// Returns the pictures with their names.
pub(super) fn figures(report: &SweepReport, statistics: &SweepStatistics) -> Vec<(&'static str, Figure)> {
    let (mut histograms, mut distributions) = (Vec::new(), Vec::new());
    for quantity in quantities(&report.probes) {
        let varies = |one: &MeasureStatistics| one.measure == quantity.name && one.varies();
        if statistics.quantiles.iter().any(varies) {
            let values = sorted(report, &quantity);
            histograms.push(histogram(&quantity, &values));
            distributions.push(distribution(&quantity, &values));
        }
    }
    let page = |panels: Vec<Panel>| {
        panels.into_iter().fold(Figure::new(&report.title).page().columns(3), Figure::panel)
    };
    let mut figures = Vec::new();
    if !histograms.is_empty() {
        figures.extend([("histograms", page(histograms)), ("distributions", page(distributions))]);
    }
    let shown: Vec<&Sensitivity> =
        statistics.sensitivities.iter().filter(|index| is_main(&index.measure)).collect();
    if !shown.is_empty() {
        let title = format!("{}: first order (dark) and total", report.title);
        let panels = shown.chunk_by(|one, other| one.measure == other.measure).map(sensitivities);
        figures.push(("sensitivities", panels.fold(Figure::new(title), Figure::panel)));
    }
    figures
}

/// Returns the values of a measure in ascending order.
fn sorted(report: &SweepReport, quantity: &Quantity) -> Vec<f64> {
    let mut values: Vec<f64> = report.rows.iter().filter_map(|row| quantity.of_row(&row)).collect();
    values.sort_by(f64::total_cmp);
    values
}

/// Plots how many runs have which values.
fn histogram(quantity: &Quantity, sorted: &[f64]) -> Panel {
    let (low, high) = (sorted[0], sorted[sorted.len() - 1]);
    // The rule of Rice.
    let count = (2.0 * (sorted.len() as f64).cbrt()).ceil().clamp(5.0, 60.0);
    let mut runs = vec![0_u32; count as usize];
    for value in sorted {
        runs[((value - low) / (high - low) * count).min(count - 1.0) as usize] += 1;
    }
    let end = |i: usize| low + (high - low) * i as f64 / count;
    let bar = |(i, runs): (usize, &u32)| Bar {
        x: [end(i), end(i + 1)],
        y: [0.0, f64::from(*runs)],
        color: BARS[1],
    };
    let runs = runs.iter().enumerate().map(bar);
    Panel::new(Axis::linear(&quantity.name, quantity.unit), Axis::linear("runs", "").with([0.0])).bars(runs)
}

/// Plots the share of the runs up to each value, with a step where several have the same.
fn distribution(quantity: &Quantity, sorted: &[f64]) -> Panel {
    let (mut points, mut runs) = (Vec::new(), 0);
    for equal in sorted.chunk_by(|one, other| one == other) {
        let before = runs;
        runs += equal.len();
        points.extend([before, runs].map(|runs| [equal[0], runs as f64 / sorted.len() as f64]));
    }
    let shares = Axis::linear("share of the runs", "").within(0.0, 1.0);
    Panel::new(Axis::linear(&quantity.name, quantity.unit), shares).curve(Curve::new("", points).distinct())
}

/// Plots the indices of one measure to all keys.
fn sensitivities(indices: &[&Sensitivity]) -> Panel {
    let bars = indices.iter().enumerate().flat_map(|(i, index)| {
        let place = (i + 1) as f64;
        [(index.total, 0.35, BARS[0]), (index.first, 0.2, BARS[1])].map(|(share, half, color)| Bar {
            x: [0.0_f64.min(share), share.max(0.0)],
            y: [place - half, place + half],
            color,
        })
    });
    let keys = Axis::linear("", "").named(indices.iter().map(|index| index.key.clone()));
    let keys = keys.within(0.5, indices.len() as f64 + 0.5);
    let shares = Axis::linear("share of the variance", "").with([0.0, 1.0]);
    let height = 22.0 * indices.len() as f64 + 10.0;
    Panel::new(shares, keys).heading(&indices[0].measure).height(height).bars(bars)
}
