//! Texts of a scene's values and tables in TOML, aligned and commented.

use super::given::{FieldInput, Region, Value};
use super::tables::{Compliance, StopLaw};
use super::typed::Choice;
use crate::field::Field;

/// Line of a table: key, value, comment.
pub(super) type Row = (&'static str, String, &'static str);

/// Formats a number, a formula, or a table.
pub(super) fn given(given: &FieldInput, found: bool) -> String {
    match &given.value {
        Value::Formula(field) => formula(field),
        Value::Table { file, path, interpolation, shape, .. } => {
            let file = string(if found { path } else { file });
            let interpolation = word(*interpolation);
            format!("{{ table = {file}, interpolation = {interpolation}, times = {} }}", formula(shape))
        }
    }
}

pub(super) fn formula(field: &Field) -> String {
    field.constant().map_or_else(|| string(&field.to_string()), number)
}

/// Formats a place, by the name of its physical point if it has one.
pub(super) fn place(at: &[f64; 2], point: Option<&str>) -> Row {
    point.map_or_else(|| ("at", numbers(at), "m"), |name| ("point", string(name), ""))
}

pub(super) fn region(region: &Region) -> Vec<Row> {
    match region {
        Region::All => vec![],
        Region::Where(condition) => vec![("where", string(&condition.to_string()), "")],
        Region::Group(name) => vec![("group", string(name), "")],
        Region::At(at) => vec![("at", numbers(at), "m")],
        Region::Point(name) => vec![("point", string(name), "")],
        Region::Line([from, to]) => vec![("line", format!("[{}, {}]", numbers(from), numbers(to)), "m")],
    }
}

/// Formats the compliance of a stop, given the units of a linear one; nothing for a rigid one.
pub(super) fn compliance(compliance: Option<Compliance>, units: [&'static str; 2]) -> Vec<Row> {
    match compliance {
        None => vec![],
        Some(Compliance { law: StopLaw::Linear, stiffness, damping }) => {
            vec![("stiffness", number(stiffness), units[0]), ("damping", number(damping), units[1])]
        }
        Some(Compliance { law: StopLaw::Hertz, stiffness, .. }) => {
            vec![("law", word(StopLaw::Hertz), "linear | hertz"), ("stiffness", number(stiffness), "N/m^1.5")]
        }
    }
}

pub(super) fn words(choices: &[impl Choice]) -> String {
    let words: Vec<String> = choices.iter().map(|choice| word(*choice)).collect();
    format!("[{}]", words.join(", "))
}

pub(super) fn numbers(values: &[f64]) -> String {
    let numbers: Vec<String> = values.iter().map(|value| number(*value)).collect();
    format!("[{}]", numbers.join(", "))
}

/// Appends a table with aligned equal signs and comments.
pub(super) fn section(text: &mut String, header: &str, rows: &[Row]) {
    let key_width = rows.iter().map(|(key, ..)| key.len()).max().unwrap_or(0);
    let value_width = rows.iter().map(|(_, value, _)| value.len()).max().unwrap_or(0);
    *text += &format!("\n{header}\n");
    for (key, value, comment) in rows {
        let hash = if comment.is_empty() { "" } else { "  # " };
        let row = format!("{key:key_width$} = {value:value_width$}{hash}{comment}");
        *text += row.trim_end();
        *text += "\n";
    }
}

/// Formats a number as the shortest text that reads back as the same number.
pub(super) fn number(value: f64) -> String {
    let (plain, scientific) = (format!("{value:?}"), format!("{value:e}"));
    if plain.len() > 9 && scientific.len() < plain.len() { scientific } else { plain }
}

pub(super) fn word(choice: impl Choice) -> String {
    string(choice.word())
}

pub(super) fn string(text: &str) -> String {
    toml::Value::from(text).to_string()
}

/// Formats the name of a support, an obstacle or a slider, if it has one.
pub(super) fn name(name: Option<&String>) -> Vec<Row> {
    name.map(|name| ("name", string(name), "")).into_iter().collect()
}
