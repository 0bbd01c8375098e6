//! Names that head columns of `history.csv`.

use crate::error::Result;
use crate::scene::HISTORY_COLUMNS;
use crate::scene::document::{Document, quote};

const EXPECTED: &str =
    "expected a name without commas, quotes and control characters, and without =, +, - or @ first";

/// Reads a name that is valid as a column of the history.
pub(super) fn needed(doc: &Document, key: &str) -> Result<String> {
    let name = doc.optional_text(key, EXPECTED)?.ok_or_else(|| doc.missing(key, EXPECTED))?;
    if HISTORY_COLUMNS.contains(&name) {
        return Err(
            doc.fault(key, format!("{} is a column of history.csv; expected another name", quote(name)))
        );
    }
    let is_bad = |c: char| matches!(c, ',' | '"' | '\'') || c.is_control();
    // A spreadsheet takes what begins like a formula for one.
    let is_formula = name.trim_start().starts_with(['=', '+', '-', '@']);
    if name.trim().is_empty() || name.contains(is_bad) || is_formula {
        return Err(doc.fault(key, format!("{} cannot head a column; {EXPECTED}", quote(name))));
    }
    Ok(name.to_owned())
}

/// Reads the name of a support or an obstacle, if it has one.
pub(in crate::scene) fn optional(doc: &Document, key: &str) -> Result<Option<String>> {
    doc.get(key).map(|_| needed(doc, key)).transpose()
}
