//! Names that head columns of `history.csv`.

use super::document::quote;
use super::entry::Kind;
use super::kinds::text;

/// Columns of `history.csv` before the probes, whose names must differ from these.
pub const HISTORY_COLUMNS: [&str; 10] = [
    "step",
    "time",
    "energy",
    "kinetic",
    "elastic",
    "work",
    "contact_nodes",
    "contact_force",
    "vi_iterations",
    "kkt",
];

/// Beginnings of the columns of a named support or obstacle; only supports have moments.
pub const FORCE_COLUMNS: [&str; 4] = ["force", "impulse", "moment_x", "moment_y"];

/// Name that is valid as a column of the history.
pub(super) fn column() -> Kind<String> {
    let expected =
        "expected a name without commas, quotes and control characters, and without =, +, - or @ first";
    text(expected, |name, expected| {
        if HISTORY_COLUMNS.contains(&name) {
            return Some(format!("{} is a column of history.csv; expected another name", quote(name)));
        }
        let is_bad = |c: char| matches!(c, ',' | '"' | '\'') || c.is_control();
        // A spreadsheet evaluates a text that begins like a formula.
        let is_formula = name.trim_start().starts_with(['=', '+', '-', '@']);
        let is_wrong = name.trim().is_empty() || name.contains(is_bad) || is_formula;
        is_wrong.then(|| format!("{} cannot head a column; {expected}", quote(name)))
    })
}
