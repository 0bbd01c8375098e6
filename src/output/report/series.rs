//! Rows of `history.csv` as charts of the page.

use super::blob::PageData;
use crate::output::history::Table;
use serde_json::{Value, json};

/// Approximate limit on the values of all curves.
const MOST_VALUES: usize = 60_000;

/// Curve of a chart: label and values.
type LabelledCurve = (String, Vec<f64>);

/// Stores the curves of all charts and returns the descriptions of the charts with the number of
/// rows shown.
///
/// `rules` are heights of obstacles (m), drawn beside deflections.
pub fn store(table: &Table, rules: &[f64], data: &mut PageData) -> (Value, usize) {
    let column = |name: &str| table.column(name).unwrap_or_default();
    let line = |name: &str, values: &[f64]| -> LabelledCurve { (name.to_owned(), values.to_vec()) };
    let mut charts: Vec<(String, &str, Vec<f64>, Vec<LabelledCurve>)> = Vec::new();
    for axis in table.axes() {
        let lines = table.probes_of(axis).map(|(_, name, values)| line(name, values)).collect();
        let rules = if axis == ("deflection", "m") { rules.to_vec() } else { Vec::new() };
        charts.push((axis.0.to_owned(), axis.1, rules, lines));
    }
    let moves = |name: &&str| column(name).iter().any(|value| *value != 0.0);
    let energies = ["energy", "kinetic", "elastic", "work"].into_iter().filter(moves);
    charts.push(("energy".into(), "J", Vec::new(), energies.map(|name| line(name, column(name))).collect()));
    let start = column("energy").first().copied().unwrap_or_default();
    let change: Vec<f64> = column("energy").iter().map(|energy| energy - start).collect();
    charts.push((
        "change of the energy since the start".into(),
        "J",
        Vec::new(),
        vec![line("change", &change)],
    ));
    let mut forces: Vec<LabelledCurve> = table.forces().map(|(name, values)| line(name, values)).collect();
    if moves(&"contact_force") {
        forces.insert(0, line("all obstacles", column("contact_force")));
    }
    charts.push(("force on the plate, upward".into(), "N", Vec::new(), forces));
    charts.retain(|(.., lines)| !lines.is_empty());

    let columns: Vec<&[f64]> =
        charts.iter().flat_map(|(.., lines)| lines).map(|(_, values)| values.as_slice()).collect();
    let rows = chosen(table.rows(), &columns);
    let times = column("time");
    data.doubles("row_times", &rows.iter().map(|&row| times[row]).collect::<Vec<f64>>());
    let mut number = 0;
    let mut described = Vec::new();
    for (title, unit, rules, lines) in &charts {
        let mut columns = Vec::new();
        for (label, values) in lines {
            let array = format!("curve_{number}");
            data.floats(&array, rows.iter().map(|&row| values[row]));
            columns.push(json!({ "label": label, "array": array }));
            number += 1;
        }
        described.push(json!({ "title": title, "unit": unit, "rules": rules, "columns": columns }));
    }
    (described.into(), rows.len())
}

/// Returns the rows to show: all, or those with the least and greatest value of some curve among
/// neighbours, so that no peak is lost.
fn chosen(rows: usize, curves: &[&[f64]]) -> Vec<usize> {
    let most = MOST_VALUES / curves.len().max(1);
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
