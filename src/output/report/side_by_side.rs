//! Page of two runs, A and B: their plates, answers with differences, curves in the same axes, and
//! what differs between their scenes.

use super::blob::PageData;
use super::html::{
    charts_with, described, escaped, header, plate, section, state, trouble, unit_of, warnings,
};
use super::{document, scripts, series};
use crate::error::{Error, Result};
use crate::output::answers::EQUAL;
use crate::output::plot::Obstacle;
use crate::output::run_folder::RunFolder;
use crate::output::text::{engineering, grouped, short, typeset};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Figures of a run: title, place in `summary.json`, and unit; an empty one is for counts.
const FIGURES: [(&str, &str, &str); 10] = [
    ("largest deflection", "/largest_deflection/value", "m"),
    ("its time", "/largest_deflection/time", "s"),
    ("largest stress (von Mises)", "/extremes/von_mises/value", "Pa"),
    ("its time", "/extremes/von_mises/time", "s"),
    ("first impact", "/first_impact/time", "s"),
    ("upward velocity there", "/first_impact/velocity", "m/s"),
    ("energy at the start", "/energy/stored/0", "J"),
    ("energy at the end", "/energy/stored/1", "J"),
    ("energy put in", "/energy/put_in", "J"),
    ("energy lost", "/energy/lost", "J"),
];

/// Figures of how the answers of a run were computed, likewise.
const NUMERICS: [(&str, &str, &str); 6] = [
    ("degrees of freedom", "/dofs", ""),
    ("steps", "/steps", ""),
    ("steps in contact", "/contact_steps", ""),
    ("contacts of nodes", "/node_contacts", ""),
    ("worst KKT residual", "/worst_kkt", ""),
    ("time of all steps", "/seconds/stepping", "s"),
];

/// Figures of an obstacle or a support: title, key, and unit.
const FORCES: [(&str, &str, &str); 5] = [
    ("peak force", "peak", "N"),
    ("its time", "time_of_peak", "s"),
    ("impulse", "impulse", "N s"),
    ("contacts", "impacts", ""),
    ("time in contact", "time_in_contact", "s"),
];

/// Returns the page of two runs.
///
/// # Errors
/// Returns an error where the numbers cannot be compressed; `path` is the file of the page.
pub(crate) fn page_of_two(runs: &[RunFolder; 2], path: &Path) -> Result<String> {
    let summaries = runs.each_ref().map(|run| &run.summary);
    let scenes = summaries.map(|summary| &summary["scene"]);
    let titles = scenes.map(|scene| scene["title"].as_str().unwrap_or("Run of rebond"));
    let title = if titles[0] == titles[1] { titles[0].into() } else { titles.join(" / ") };
    let mut head = String::new();
    for ((name, run), scene) in ["A", "B"].into_iter().zip(runs).zip(scenes) {
        let folder = escaped(&run.folder.to_string_lossy());
        head += &format!("<p class=\"plate\"><b>{name}</b> ({folder}): {}.</p>\n", plate(scene, None));
        head += &state(&run.summary);
    }
    let mut data = PageData::default();
    let heights = |run: &RunFolder| run.obstacles().iter().map(Obstacle::height).collect();
    let charts = series::store_two(runs.each_ref().map(|run| (&run.table, heights(run))), &mut data);
    let (arrays, numbers) = data.finish().map_err(Error::io(path))?;
    let meta = json!({ "charts": charts, "arrays": arrays });
    let [of_a, of_b] = summaries.map(warnings);
    let body = [
        header(&title, &head),
        trouble().to_owned(),
        section("answers", "", "Answers", &answers(summaries)),
        section("warnings", "", "Warnings", &format!("<h3>A</h3>\n{of_a}<h3>B</h3>\n{of_b}")),
        section("scene", "", "What differs between the scenes", &differences(scenes)),
        charts_with("Full lines are A, dashed ones B. Drag across a chart to zoom all of them."),
    ]
    .concat();
    Ok(document(&escaped(&title), &body, &scripts(&meta, &numbers)))
}

/// Returns the table of what both runs answer, with the differences from A to B.
fn answers(summaries: [&Value; 2]) -> String {
    let mut rows = String::new();
    let figure = |(title, pointer, unit)| {
        let value = |summary: &Value| {
            let value = summary.pointer(pointer)?.as_f64()?;
            let stored = [0, 1].map(|end| summary["energy"]["stored"][end].as_f64().unwrap_or(0.0));
            let is_rounding = unit == "J" && value.abs() <= EQUAL * stored[0].max(stored[1]);
            Some(if is_rounding { 0.0 } else { value })
        };
        row(title, summaries.map(value), unit)
    };
    rows.extend(FIGURES.map(figure));
    for name in names(summaries.map(|summary| &summary["forces"])) {
        rows += &group(name);
        for (title, key, unit) in FORCES {
            rows += &row(title, summaries.map(|summary| summary["forces"][name][key].as_f64()), unit);
        }
    }
    for name in names(summaries.map(|summary| &summary["dissipated"])) {
        let title = format!("dissipated by {name}");
        rows += &row(&title, summaries.map(|summary| summary["dissipated"][name].as_f64()), "J");
    }
    rows += &group("numerics");
    rows.extend(NUMERICS.map(figure));
    table("answers", "", &["", "A", "B", "B \u{2212} A", "relative to A"], &rows)
}

/// Returns the row that heads the figures below.
fn group(title: &str) -> String {
    format!("<tr class=\"group\"><th colspan=\"5\" scope=\"rowgroup\">{}</th></tr>\n", escaped(title))
}

/// Returns the row of a figure; none where neither run has it.
fn row(title: &str, values: [Option<f64>; 2], unit: &str) -> String {
    if values == [None, None] {
        return String::new();
    }
    let told = |value: f64| match unit {
        "" if value.fract() == 0.0 => {
            let sign = if value < 0.0 { "-" } else { "" };
            format!("{sign}{}", grouped(value.abs() as u64))
        }
        "" => format!("{value:.1e}"),
        unit => engineering(value, unit),
    };
    let cell = |text: String| format!("<td>{}</td>", escaped(&typeset(&text)));
    let shown = values.map(|value| cell(value.map_or_else(|| "\u{2013}".into(), told)));
    let [difference, share] = match values {
        [Some(a), Some(b)] if a == b => ["equal".into(), String::new()],
        [Some(a), Some(b)] => {
            let plus = |change: f64| if change > 0.0 { "+" } else { "" };
            let share = match 100.0 * (b - a) / a {
                _ if a == 0.0 => String::new(),
                share if share >= 1000.0 => format!("{} times", short(b / a)),
                share => format!("{}{} %", plus(share), short(share)),
            };
            [format!("{}{}", plus(b - a), told(b - a)), share]
        }
        _ => [String::new(), String::new()],
    };
    let [difference, share] = [difference, share].map(cell);
    format!("<tr><th scope=\"row\">{}</th>{}{difference}{share}</tr>\n", escaped(title), shown.concat())
}

/// Returns the keys of two tables, those of the first one first.
fn names([a, b]: [&Value; 2]) -> Vec<&str> {
    let [a, b] = [a, b].map(|table| table.as_object().into_iter().flat_map(Map::keys).map(String::as_str));
    let mut names: Vec<&str> = a.collect();
    let more: Vec<&str> = b.filter(|name| !names.contains(name)).collect();
    names.extend(more);
    names
}

/// Returns the table of the keys whose values differ between two resolved scenes.
fn differences([a, b]: [&Value; 2]) -> String {
    let mut rows = String::new();
    differing("", [a, b], &mut |key, values| {
        if key == "title" {
            return; // the head of the page has it
        }
        let cell = |value: &Value| match value {
            Value::Null => "<td>\u{2013}</td>".to_owned(),
            value => format!("<td>{}{}</td>", escaped(&described(value, key)), unit_of(value, key)),
        };
        rows += &format!("<tr><th scope=\"row\"><code>{}</code></th>", escaped(key));
        rows += &values.map(cell).concat();
        rows += "</tr>\n";
    });
    if rows.is_empty() {
        return "<p>The scenes are equal.</p>\n".into();
    }
    table("scene", " words", &["key", "A", "B"], &rows)
}

/// Calls `report` with each key, such as `obstacle.0.height`, whose values differ.
fn differing(key: &str, [a, b]: [&Value; 2], report: &mut impl FnMut(&str, [&Value; 2])) {
    let has_parts = |value: &Value| {
        value.is_object() || value.as_array().is_some_and(|list| list.iter().any(Value::is_object))
    };
    let inner = |part: &str| if key.is_empty() { part.to_owned() } else { format!("{key}.{part}") };
    if a == b {
        return;
    }
    if !has_parts(a) && !has_parts(b) {
        return report(key, [a, b]);
    }
    for part in names([a, b]) {
        differing(&inner(part), [&a[part], &b[part]], report);
    }
    let count = [a, b].map(|value| value.as_array().map_or(0, Vec::len));
    for part in 0..count[0].max(count[1]) {
        differing(&inner(&part.to_string()), [&a[part], &b[part]], report);
    }
}

/// Returns a table in the section of a name, with its heads and the text of its rows.
fn table(id: &str, class: &str, heads: &[&str], rows: &str) -> String {
    let heads: String = heads.iter().map(|head| format!("<th scope=\"col\">{head}</th>")).collect();
    format!(
        "<div class=\"wide\" tabindex=\"0\" role=\"region\" aria-labelledby=\"h-{id}\"><table class=\"pair{class}\">\
         <thead><tr>{heads}</tr></thead><tbody>\n{rows}</tbody></table></div>\n"
    )
}
