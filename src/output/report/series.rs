//! Rows of `history.csv` as charts of the page.

use super::blob::PageData;
use crate::output::answers::EQUAL;
use crate::output::history::{ProbeChart, Table};
use serde_json::{Value, json};

/// Approximate limit on the values of all curves.
const MOST_VALUES: usize = 60_000;

/// Chart: title, unit, level lines and curves.
#[derive(Debug)]
struct Chart {
    title: String,
    unit: &'static str,
    /// Heights of obstacles, in m, drawn beside deflections.
    rules: Vec<f64>,
    curves: Vec<LabelledCurve>,
}

/// Curve of a chart.
#[derive(Debug)]
struct LabelledCurve {
    label: String,
    values: Vec<f64>,
    /// Numbers of its colour and its dashes, where the page does not choose them.
    style: Option<[usize; 2]>,
}

/// Stores the curves of all charts and returns the descriptions of the charts with the number of
/// rows shown.
///
/// `rules` are heights of obstacles (m), drawn beside deflections.
pub fn store(table: &Table, rules: &[f64], data: &mut PageData) -> (Value, usize) {
    let (times, charts) = thinned(table, rules, MOST_VALUES);
    let rows = times.len();
    (put(&times, &charts, data), rows)
}

/// Stores the curves of two runs, A and B, in the same charts, and returns their descriptions.
///
/// Each curve has values at the times of both runs, interpolated linearly, which leaves its picture
/// as it is; beyond the end of its run it has none. Curves of one name have one colour, and those
/// of B are dashed.
pub fn store_two(runs: [(&Table, Vec<f64>); 2], data: &mut PageData) -> Value {
    let runs = runs.map(|(table, rules)| thinned(table, &rules, MOST_VALUES / 2));
    let mut times: Vec<f64> = runs.iter().flat_map(|(times, _)| times).copied().collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut charts: Vec<Chart> = Vec::new();
    let mut names: Vec<Vec<String>> = Vec::new();
    for (number, (ends, of_run)) in runs.into_iter().enumerate() {
        for Chart { title, unit, rules, curves } in of_run {
            let is_same = |other: &Chart| other.title == title && other.unit == unit;
            let index = charts.iter().position(is_same).unwrap_or_else(|| {
                charts.push(Chart { title, unit, rules: Vec::new(), curves: Vec::new() });
                names.push(Vec::new());
                charts.len() - 1
            });
            let (chart, names) = (&mut charts[index], &mut names[index]);
            chart.rules.extend(rules);
            chart.rules.sort_by(f64::total_cmp);
            chart.rules.dedup();
            for LabelledCurve { label, values, .. } in curves {
                let color = names.iter().position(|name| *name == label).unwrap_or(names.len());
                let values = times.iter().map(|&time| interpolated(&ends, &values, time)).collect();
                let (shown, style) = (format!("{label}, {}", ["A", "B"][number]), Some([color, number]));
                chart.curves.push(LabelledCurve { label: shown, values, style });
                if color == names.len() {
                    names.push(label);
                }
            }
        }
    }
    put(&times, &charts, data)
}

/// Returns the value at a time between rows; NaN before the first and after the last one.
fn interpolated(times: &[f64], values: &[f64], time: f64) -> f64 {
    let next = times.partition_point(|other| *other < time);
    match (next.checked_sub(1), times.get(next)) {
        (_, Some(&end)) if end == time => values[next],
        (Some(last), Some(&end)) => {
            let share = (time - times[last]) / (end - times[last]);
            values[last] + share * (values[next] - values[last])
        }
        _ => f64::NAN,
    }
}

/// Stores charts whose curves have values at `times`, and returns their descriptions.
fn put(times: &[f64], charts: &[Chart], data: &mut PageData) -> Value {
    data.doubles("row_times", times);
    let mut number = 0;
    let mut described = Vec::new();
    for Chart { title, unit, rules, curves } in charts {
        let mut columns = Vec::new();
        for LabelledCurve { label, values, style } in curves {
            let array = format!("curve_{number}");
            data.floats(&array, values.iter().copied());
            let mut column = json!({ "label": label, "array": array });
            if let Some(style) = style {
                column["style"] = json!(style);
            }
            columns.push(column);
            number += 1;
        }
        described.push(json!({ "title": title, "unit": unit, "rules": rules, "columns": columns }));
    }
    described.into()
}

/// Returns times and charts of the rows to show, with about `most` values.
fn thinned(table: &Table, rules: &[f64], most: usize) -> (Vec<f64>, Vec<Chart>) {
    let mut charts = charts(table, rules);
    let curves: Vec<&[f64]> =
        charts.iter().flat_map(|chart| &chart.curves).map(|curve| curve.values.as_slice()).collect();
    let rows = chosen(table.rows(), &curves, most);
    let taken = |values: &[f64]| rows.iter().map(|&row| values[row]).collect::<Vec<f64>>();
    let times = taken(table.column("time").unwrap_or_default());
    for curve in charts.iter_mut().flat_map(|chart| &mut chart.curves) {
        curve.values = taken(&curve.values);
    }
    (times, charts)
}

/// Returns the charts of a run, with all rows.
fn charts(table: &Table, rules: &[f64]) -> Vec<Chart> {
    let column = |name: &str| table.column(name).unwrap_or_default();
    let line = |name: &str, values: &[f64]| LabelledCurve {
        label: name.to_owned(),
        values: values.to_vec(),
        style: None,
    };
    let chart = |title: &str, unit, curves| Chart { title: title.into(), unit, rules: Vec::new(), curves };
    let mut charts = Vec::new();
    for ProbeChart { title, unit, probes } in table.charts() {
        let lines = probes.into_iter().map(|(_, name, values)| line(name, values)).collect();
        let rules = if title == "deflection" { rules.to_vec() } else { Vec::new() };
        charts.push(Chart { rules, ..chart(&title, unit, lines) });
    }
    let moves = |values: &[f64]| values.iter().any(|value| *value != 0.0);
    let stored = table.stored();
    let parts =
        [("kinetic", column("kinetic")), ("elastic", column("elastic")), ("kinetic + elastic", &stored)];
    charts.push(chart("energy of the plate", "J", parts.map(|(name, values)| line(name, values)).into()));
    let exchanged = [("put in", "work", 1.0), ("lost", "energy", -1.0)].into_iter();
    let exchanged = exchanged.map(|(name, column, sign)| (name, table.since_start(column, sign)));
    let exchanged = exchanged.filter(|(name, values)| *name == "lost" || moves(values));
    let exchanged: Vec<_> = exchanged.map(|(name, values)| line(name, &values)).collect();
    let largest = |values: &[f64]| values.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    if exchanged.iter().any(|curve| largest(&curve.values) > EQUAL * largest(&stored)) {
        charts.push(chart("energy since the start", "J", exchanged));
    }
    let mut forces: Vec<LabelledCurve> = table.forces().map(|(name, values)| line(name, values)).collect();
    if moves(column("contact_force")) {
        forces.insert(0, line("all obstacles", column("contact_force")));
    }
    charts.push(chart("force on the plate, upward", "N", forces));
    charts.retain(|chart| !chart.curves.is_empty());
    charts
}

/// Returns the rows to show: all, or those with the least and greatest value of some curve among
/// neighbours, so that no peak is lost.
fn chosen(rows: usize, curves: &[&[f64]], most_values: usize) -> Vec<usize> {
    let most = most_values / curves.len().max(1);
    if rows <= most {
        return (0..rows).collect();
    }
    let parts = (most / (2 * curves.len().max(1))).max(2);
    let mut kept = vec![0, rows - 1];
    for part in 0..parts {
        let range = part * rows / parts..(part + 1) * rows / parts;
        for values in curves {
            let order = |a: &usize, b: &usize| values[*a].total_cmp(&values[*b]);
            kept.extend(range.clone().min_by(order));
            kept.extend(range.clone().max_by(order));
        }
    }
    kept.sort_unstable();
    kept.dedup();
    kept
}
