//! Kinds of values that keys take: numbers with ranges, fields, counts, words, texts, lists.

use super::document::{Document, Value, join, quote, spell};
use super::entry::{Kind, Range, Schema, Table as _, object, table};
use super::given::{FieldInput, MeasuredTable};
use super::words::Choice;
use crate::error::{Error, Result, suggestion};
use crate::field::{Condition, Field, Interpolation, Names, Parameters, Table, check_parameter};
use serde_json::json;
use std::fmt::Display;
use std::path::Path;
use std::rc::Rc;

/// Largest and smallest magnitude of a number other than 0: products of a few such numbers neither
/// overflow nor lose digits to underflow.
const MAGNITUDES: [f64; 2] = [1e50, 1e-300];

/// Describes what is wrong with a number; `None` for a valid one.
fn fault(number: f64, range: Range) -> Option<String> {
    let [largest, smallest] = MAGNITUDES;
    let holds = |(keyword, limit): &(&str, f64)| match *keyword {
        "minimum" => number >= *limit,
        "exclusiveMinimum" => number > *limit,
        "maximum" => number <= *limit,
        _ => number < *limit,
    };
    if !number.is_finite() {
        Some("is not a finite number".into())
    } else if !range.iter().all(holds) {
        let words = match range {
            [("exclusiveMinimum", 0.0)] => "is not positive",
            [("minimum", 0.0)] => "is negative",
            [_] => "is too small",
            _ => "is out of range",
        };
        Some(words.into())
    } else if number.abs() > largest {
        Some(format!("is beyond {largest:e} in magnitude"))
    } else if number != 0.0 && number.abs() < smallest {
        Some(format!("is below {smallest:e} in magnitude, and not 0"))
    } else {
        None
    }
}

/// Number of any size, with a unit.
pub(super) fn number(what: &str, unit: &'static str) -> Kind<f64> {
    within(what, unit, &[])
}

/// Number greater than 0.
pub(super) fn positive(what: &str, unit: &'static str) -> Kind<f64> {
    within(what, unit, &[("exclusiveMinimum", 0.0)])
}

/// Number of at least 0.
pub(super) fn not_negative(what: &str, unit: &'static str) -> Kind<f64> {
    within(what, unit, &[("minimum", 0.0)])
}

/// Number within a range.
pub(super) fn within(what: &str, unit: &'static str, range: Range) -> Kind<f64> {
    let of_unit = if unit.is_empty() { String::new() } else { format!(" in {unit}") };
    let limits = match range {
        [] => String::new(),
        [("minimum", low), ("maximum", high)] => format!(" from {low} to {high}"),
        [("minimum", low)] => format!(" of at least {low}"),
        [(_, low)] => format!(" greater than {low}"),
        [(_, low), (_, high), ..] => format!(" greater than {low} and less than {high}"),
    };
    let expected = format!("expected {what}{of_unit}{limits}");
    let wanted = expected.clone();
    let read = move |doc: &Document, key: &str| {
        let (number, written) = match doc.value(key) {
            Some(Value::Integer(integer)) => (*integer as f64, integer.to_string()),
            Some(Value::Float(float)) => (*float, spell(*float)),
            other => return Err(doc.unfit(key, other, &wanted)),
        };
        let wrong = |fault| Err(doc.fault(key, format!("{written} {fault}; {wanted}")));
        fault(number, range).map_or(Ok(number), wrong)
    };
    let schema = move || of_number(json!("number"), range);
    let kind = Kind::new(expected, schema, read, |value, _| shortest(*value)).says(unit);
    Kind { unit, range, ..kind }
}

fn of_number(types: serde_json::Value, range: Range) -> Schema {
    let mut schema = object([("type", types)]);
    schema.extend(range.iter().map(|(keyword, limit)| ((*keyword).to_owned(), json!(limit))));
    schema
}

impl Kind<f64> {
    /// Returns the kind of a number, a formula of these variables, or a table of time where time is
    /// one of them.
    pub fn field(self, names: Names) -> Kind<FieldInput> {
        let (expected, comment, unit, range) =
            (self.expected.clone(), self.comment.clone(), self.unit, self.range);
        let takes_tables = names.meets(Names::T);
        let read = move |doc: &Document, key: &str| match doc.value(key) {
            Some(Value::Text(text)) => Ok(FieldInput::new(key, formula(doc, key, text, names, &self)?)),
            Some(Value::Table(_)) if takes_tables => over_time(doc, key, names),
            Some(Value::Integer(_) | Value::Float(_)) => Ok(FieldInput::new(key, doc.required(key, &self)?)),
            other => Err(doc.unfit(key, other, format!("{}, or a formula", self.expected))),
        };
        let schema = move || {
            let plain = of_number(json!(["number", "string"]), range);
            if takes_tables { object([("anyOf", json!([plain, OverTime::keys().schema()]))]) } else { plain }
        };
        let write = |given: &FieldInput, by_path: bool| {
            let formula = field_text(&given.formula);
            let Some(MeasuredTable { file, path, interpolation, .. }) = &given.table else { return formula };
            let file = string(if by_path { path } else { file });
            let interpolation = string(interpolation.word());
            format!("{{ table = {file}, interpolation = {interpolation}, times = {formula} }}")
        };
        Kind { unit, ..Kind::new(expected, schema, read, write).says(comment) }
    }
}

/// Reads a formula whose value is a number of this kind.
fn formula(doc: &Document, key: &str, text: &str, names: Names, number: &Kind<f64>) -> Result<Field> {
    let field = Field::parse_with(text, names, doc.parameters()?).map_err(|fault| doc.fault(key, fault))?;
    if let Some(constant) = field.constant()
        && let Some(fault) = fault(constant, number.range)
    {
        return Err(doc.fault(key, format!("{} {fault}; {}", spell(constant), number.expected)));
    }
    // Zero counts as absent, however it is written.
    Ok(if field.constant() == Some(0.0) { 0.0.into() } else { field })
}

table! {
    /// Field that is a table of values over time.
    struct OverTime {
        /// CSV file with rows `time,value` (in s and in the unit of the key), in the folder of the
        /// scene, with at least two rows with ascending times; a header is optional, and `#` starts
        /// a comment.
        table: String = text("expected the name of a CSV file with rows of time,value", |_, _| None);
        /// `"linear"`, or `"spline"` for the natural cubic spline; `rebond check` warns where the
        /// spline exceeds the values of the table by more than a tenth of their range. The first
        /// value holds before the first row, and the last value after the last row.
        interpolation: Interpolation = word();
        /// Factor on the values: a number, or a formula of x and y where the key takes such
        /// formulas.
        times: FieldInput = factor().field(Names::XY).or(FieldInput::new("", 1.0));
    }
}

fn factor() -> Kind<f64> {
    number("a factor", "")
}

/// Reads a table of values over time.
fn over_time(doc: &Document, key: &str, names: Names) -> Result<FieldInput> {
    doc.allow(key, OverTime::keys())?;
    let times = join(key, "times");
    if let (Some(Value::Text(text)), false) = (doc.value(&times), names.meets(Names::XY)) {
        formula(doc, &times, text, Names::NONE, &factor())?;
    }
    let OverTime { table: file, interpolation, times } = OverTime::read(doc, key)?;
    let path = doc.beside(&file);
    let rows = Table::read(Path::new(&path), interpolation).map_err(|error| match error {
        Error::Io { .. } => doc.fault(&join(key, "table"), error),
        other => other,
    })?;
    let table = Some(MeasuredTable { file, path, interpolation, rows });
    Ok(FieldInput { key: key.to_owned(), table, ..times })
}

impl Document<'_> {
    /// Returns the parameters that all formulas may use, which are read once.
    pub fn parameters(&self) -> Result<&Parameters> {
        if let Some(parameters) = self.parameters.get() {
            return Ok(parameters);
        }
        let mut parameters = Parameters::default();
        match self.value("parameters") {
            None => {}
            Some(Value::Table(entries)) => {
                for (name, (place, _)) in entries {
                    let key = join("parameters", name);
                    check_parameter(name).map_err(|wrong| self.fault_at(*place, &key, wrong))?;
                    parameters.set(name, self.required(&key, &parameter())?);
                }
            }
            other => return Err(self.unfit("parameters", other, "expected a table of names and numbers")),
        }
        Ok(self.parameters.get_or_init(|| parameters))
    }

    /// Reads an array of two values.
    pub fn pair<V>(&self, key: &str, [one, two]: [&Kind<V>; 2], expected: &str) -> Result<[V; 2]> {
        match self.entries(key, expected)? {
            2 => Ok([self.required(&join(key, "0"), one)?, self.required(&join(key, "1"), two)?]),
            length => {
                let comma = if length > 2 { "; a decimal point is written ." } else { "" };
                Err(self.fault(key, format!("found an array of length {length}; {expected}{comma}")))
            }
        }
    }
}

/// Value of a parameter.
pub(super) fn parameter() -> Kind<f64> {
    number("a number", "")
}

/// Word of an enum.
pub(super) fn word<T: Choice>() -> Kind<T> {
    let words: Vec<&str> = T::WORDS.iter().map(|(word, _)| *word).collect();
    let (comment, list) = (words.join(" | "), words.clone());
    let expected = format!("expected one of \"{}\"", words.join("\", \""));
    let read = move |doc: &Document, key: &str| {
        let word = doc.one_of(key, &words)?;
        let case = T::WORDS.iter().find(|(other, _)| *other == word);
        case.map(|(_, case)| *case).ok_or_else(|| doc.missing(key, word))
    };
    let schema = move || object([("enum", json!(list))]);
    Kind::new(expected, schema, read, |value: &T, _| string(value.word())).says(comment)
}

/// Whole number of at least `least`.
pub(super) fn count<N: WholeNumber>(what: &str, least: u32) -> Kind<N> {
    let expected = format!("expected {what} of at least {least}");
    let wanted = expected.clone();
    let read = move |doc: &Document, key: &str| match doc.value(key) {
        Some(Value::Integer(count)) if *count >= i64::from(least) => Ok(N::saturated(count.unsigned_abs())),
        Some(Value::Integer(count)) => Err(doc.fault(key, format!("{count} is too small; {wanted}"))),
        other => Err(doc.unfit(key, other, &wanted)),
    };
    let schema = move || object([("type", json!("integer")), ("minimum", json!(least))]);
    Kind::new(expected, schema, read, |value: &N, _| value.to_string())
}

/// Whole number in memory.
pub(super) trait WholeNumber: Copy + PartialEq + Display + 'static {
    /// Converts a count, or returns the largest number of the type.
    fn saturated(count: u64) -> Self;
}

macro_rules! whole {
    ($($number:ty),+) => {$(
        impl WholeNumber for $number {
            fn saturated(count: u64) -> Self {
                count.try_into().unwrap_or(<$number>::MAX)
            }
        }
    )+};
}

whole!(u32, u64, usize);

/// True or false.
pub(super) fn truth() -> Kind<bool> {
    let expected = "expected true or false";
    let read = move |doc: &Document, key: &str| match doc.value(key) {
        Some(Value::Truth(truth)) => Ok(*truth),
        other => Err(doc.unfit(key, other, expected)),
    };
    Kind::new(expected, || object([("type", json!("boolean"))]), read, |value, _| value.to_string())
}

/// Text; `fault` describes what is wrong with a text, given what is expected.
pub(super) fn text(expected: &'static str, fault: fn(&str, &str) -> Option<String>) -> Kind<String> {
    let read = move |doc: &Document, key: &str| {
        let text = doc.text(key, expected)?;
        fault(text, expected).map_or(Ok(text.to_owned()), |wrong| Err(doc.fault(key, wrong)))
    };
    Kind::new(expected, of_text, read, |value: &String, _| string(value))
}

/// Name of something, which is not empty.
pub(super) fn name(expected: &'static str) -> Kind<String> {
    text(expected, |name, expected| {
        name.trim().is_empty().then(|| format!("{} names nothing; {expected}", quote(name)))
    })
}

/// Name of a part of a mesh file, whose number needs quotes too.
pub(super) fn tag(expected: &'static str) -> Kind<String> {
    let kind = name(expected);
    let read = move |doc: &Document, key: &str| match doc.value(key) {
        value @ Some(Value::Integer(number)) => {
            let shell = if doc.is_overridden(key) { "'" } else { "" };
            Err(doc.unfit(key, value, format!("{expected} in quotes, {shell}\"{number}\"{shell}")))
        }
        _ => (kind.read)(doc, key),
    };
    Kind { read: Box::new(read), ..name(expected) }
}

/// Condition on x and y.
pub(super) fn condition() -> Kind<Condition> {
    let expected = "expected a condition on x and y, such as \"x > 0.5 and y < 0.2\"";
    let read = move |doc: &Document, key: &str| {
        let text = doc.text(key, expected)?;
        Condition::parse(text, Names::XY, doc.parameters()?).map_err(|fault| doc.fault(key, fault))
    };
    Kind::new(expected, of_text, read, |value: &Condition, _| string(&value.to_string()))
}

/// Reads a text `"KEY=..."` that gives a key of the scene, or a parameter, something. Returns the
/// name as written, the key of the scene, and what stands behind the equal sign.
pub(super) fn assigned(doc: &Document, key: &str, expected: &str) -> Result<[String; 3]> {
    let text = doc.text(key, expected)?;
    let fault = |wrong: String| doc.fault(key, format!("{wrong}; {expected}"));
    let parts = text.split_once('=');
    let (name, behind) = parts.ok_or_else(|| fault(format!("{} has no \"=\"", quote(text))))?;
    let name = name.trim();
    let parameters = doc.parameters()?;
    let is_parameter = parameters.get(name).is_some();
    let full = if is_parameter { join("parameters", name) } else { name.to_owned() };
    let is_word = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_alphanumeric() || c == '_');
    if !full.contains('.') || !full.split('.').all(is_word) {
        let hint = suggestion(name, &parameters.names().collect::<Vec<_>>());
        let wrong = "is neither a parameter nor a key such as load.pressure";
        return Err(fault(format!("{} {wrong}{hint}", quote(name))));
    }
    Ok([name.to_owned(), full, behind.trim().to_owned()])
}

/// Returns the schema of a text.
pub(super) fn of_text() -> Schema {
    object([("type", json!("string"))])
}

impl<V: Clone + PartialEq + 'static> Kind<V> {
    /// Returns the kind of an array of two values.
    pub fn pair(self, expected: &'static str) -> Kind<[V; 2]> {
        let (unit, item) = (self.unit, Rc::new(self));
        let (of_items, writer) =
            (items(&item, [("minItems", json!(2)), ("maxItems", json!(2))]), Rc::clone(&item));
        let read = move |doc: &Document, key: &str| doc.pair(key, [&item, &item], expected);
        let write = move |pair: &[V; 2], by_path: bool| array(pair, |value| (writer.write)(value, by_path));
        Kind { unit, ..Kind::new(expected, of_items, read, write).says(unit) }
    }

    /// Returns the kind of an array of at least one value, all different.
    pub fn list(self) -> Kind<Vec<V>> {
        let (unit, item) = (self.unit, Rc::new(self));
        let of_items = items(&item, [("minItems", json!(1)), ("uniqueItems", json!(true))]);
        let (writer, expected) = (Rc::clone(&item), item.expected.clone());
        let read = move |doc: &Document, key: &str| {
            let expected = "expected an array of at least one entry";
            let mut list = Vec::new();
            for index in 0..doc.entries(key, expected)? {
                let entry = format!("{key}.{index}");
                let value = (item.read)(doc, &entry)?;
                if let Some(first) = list.iter().position(|earlier| *earlier == value) {
                    return Err(doc.fault(&entry, format!("the same as {key}.{first}; expected each once")));
                }
                list.push(value);
            }
            let wrong = || doc.fault(key, format!("found an empty array; {expected}"));
            if list.is_empty() { Err(wrong()) } else { Ok(list) }
        };
        let write = move |list: &Vec<V>, by_path: bool| array(list, |value| (writer.write)(value, by_path));
        Kind { unit, ..Kind::new(expected, of_items, read, write).says(unit) }
    }

    /// Returns the kind of an array of any number of values.
    pub fn array(self, expected: &'static str) -> Kind<Vec<V>> {
        let item = Rc::new(self);
        let (of_items, writer) = (items(&item, []), Rc::clone(&item));
        let read = move |doc: &Document, key: &str| {
            let entry = |index: usize| doc.required(&format!("{key}.{index}"), &item);
            (0..doc.entries(key, expected)?).map(entry).collect()
        };
        let write = move |list: &Vec<V>, by_path: bool| array(list, |value| (writer.write)(value, by_path));
        Kind::new(expected, of_items, read, write)
    }
}

/// Returns the schema of an array of values of a kind, with more keywords.
fn items<V: 'static, const N: usize>(
    item: &Rc<Kind<V>>,
    keywords: [(&'static str, serde_json::Value); N],
) -> impl Fn() -> Schema + 'static {
    let item = Rc::clone(item);
    move || {
        let mut schema = object([("type", json!("array")), ("items", (item.schema)().into())]);
        schema.extend(object(keywords.clone()));
        schema
    }
}

fn array<V>(values: &[V], write: impl Fn(&V) -> String) -> String {
    format!("[{}]", values.iter().map(write).collect::<Vec<_>>().join(", "))
}

/// Formats a formula.
pub(super) fn field_text(field: &Field) -> String {
    field.constant().map_or_else(|| string(&field.to_string()), shortest)
}

/// Formats a number as the shortest text that reads back as the same number.
pub(super) fn shortest(value: f64) -> String {
    let (plain, scientific) = (format!("{value:?}"), format!("{value:e}"));
    if plain.len() > 9 && scientific.len() < plain.len() { scientific } else { plain }
}

pub(super) fn string(text: &str) -> String {
    toml::Value::from(text).to_string()
}
