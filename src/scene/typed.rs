//! Typed reading of keys: numbers with ranges, counts, words, text, and their errors.

use std::fmt::Display;
use std::path::Path;

use super::document::{Document, Value, cut, quote, spell};
pub(super) use super::keys::{Choice, Quantity, Range};
use super::keys::{TableKeys, ValueKind, key, words};
use super::{self as scene, FieldInput};
use crate::error::{Error, Result, suggestion};
use crate::field::{Condition, Field, Interpolation, Names, Parameters, Table, check_parameter};

/// Value of a parameter.
pub(super) const PARAMETER: Quantity = Quantity::new("a number", Range::ANY);

/// Largest and smallest magnitude of a number other than 0: products of a few such numbers neither
/// overflow nor lose digits to underflow.
const MAGNITUDES: [f64; 2] = [1e50, 1e-300];

/// Returns what is wrong with a number of any key; `None` for one that can be computed with.
fn fault_of(number: f64, range: &Range) -> Option<String> {
    let [largest, smallest] = MAGNITUDES;
    if !number.is_finite() {
        Some("is not a finite number".into())
    } else if !(range.holds)(number) {
        Some(range.fault.into())
    } else if number.abs() > largest {
        Some(format!("is beyond {largest:e} in magnitude"))
    } else if number != 0.0 && number.abs() < smallest {
        Some(format!("is below {smallest:e} in magnitude, and not 0"))
    } else {
        None
    }
}

/// Factor on the values of a table of time.
const FACTOR: Quantity = Quantity::new("a factor", Range::ANY);

/// Keys of a field that is a table of values over time.
pub(super) static OVER_TIME: TableKeys = TableKeys {
    groups: &[&[
        key("table", ValueKind::Text, "CSV file with rows time,value, beside the scene"),
        key("interpolation", ValueKind::Word(words::<Interpolation>), "between the rows"),
        key(
            "times",
            ValueKind::Field(&FACTOR, Names::XY),
            "factor on the values, where the key takes formulas of x and y such a formula too; default 1",
        ),
    ]],
    needed: &["table", "interpolation"],
    one_of: &[],
};

impl Document<'_> {
    /// Refuses a table with keys other than its own; an absent table passes.
    pub fn allow(&self, table: &str, of: &TableKeys) -> Result<()> {
        let Some(node) = self.get(table) else { return Ok(()) };
        let Value::Table(entries) = &node.value else {
            return Err(self.found(table, &node.value, "expected a table"));
        };
        let keys = &of.names()[..];
        let unknown = entries.iter().filter(|(key, _)| !keys.contains(&key.as_str()));
        let Some((key, (place, _))) = unknown.min_by_key(|(_, (place, _))| *place) else { return Ok(()) };
        let full = if table.is_empty() { cut(key) } else { format!("{table}.{}", cut(key)) };
        let wrong = format!("unknown key; expected one of {}{}", keys.join(", "), suggestion(key, keys));
        Err(self.fault_at(*place, &full, wrong))
    }

    /// Returns the number of entries of an array; 0 if it is absent.
    pub fn entries(&self, array: &str, expected: &str) -> Result<usize> {
        match self.get(array).map(|node| &node.value) {
            None => Ok(0),
            Some(Value::Array(items)) => Ok(items.len()),
            Some(other) => Err(self.found(array, other, expected)),
        }
    }

    /// Reads an array of at least one entry, all different; `None` if it is absent.
    pub fn list<T: PartialEq>(&self, key: &str, entry: impl Fn(&str) -> Result<T>) -> Result<Option<Vec<T>>> {
        if self.get(key).is_none() {
            return Ok(None);
        }
        let expected = "expected an array of at least one entry";
        let mut list = Vec::new();
        for index in 0..self.entries(key, expected)? {
            let at = format!("{key}.{index}");
            let value = entry(&at)?;
            if let Some(first) = list.iter().position(|earlier| *earlier == value) {
                return Err(self.fault(&at, format!("the same as {key}.{first}; expected each once")));
            }
            list.push(value);
        }
        if list.is_empty() {
            return Err(self.fault(key, format!("found an empty array; {expected}")));
        }
        Ok(Some(list))
    }

    /// Refuses a value that is no array of two.
    pub fn pair(&self, key: &str, expected: &str) -> Result<()> {
        match self.entries(key, expected)? {
            2 => Ok(()),
            0 if self.get(key).is_none() => Err(self.missing(key, expected)),
            length => Err(self.fault(key, format!("found an array of length {length}; {expected}"))),
        }
    }

    /// Reads a required number.
    pub fn number(&self, key: &str, quantity: &Quantity) -> Result<f64> {
        self.optional_number(key, quantity)?.ok_or_else(|| self.missing(key, quantity.expected()))
    }

    /// Reads an optional number, finite and within its range.
    pub fn optional_number(&self, key: &str, quantity: &Quantity) -> Result<Option<f64>> {
        let Some(node) = self.get(key) else { return Ok(None) };
        let (number, written) = match &node.value {
            Value::Integer(integer) => (*integer as f64, integer.to_string()),
            Value::Float(float) => (*float, spell(*float)),
            other => return Err(self.found(key, other, quantity.expected())),
        };
        match fault_of(number, &quantity.range) {
            None => Ok(Some(number)),
            Some(fault) => Err(self.fault(key, format!("{written} {fault}; {}", quantity.expected()))),
        }
    }

    /// Reads a required field.
    pub fn needed(&self, key: &str, quantity: &Quantity, names: Names) -> Result<FieldInput> {
        self.given(key, quantity, names)?.ok_or_else(|| self.missing(key, quantity.expected()))
    }

    /// Reads an optional field: a number within its range, a formula of the variables `names`, or a
    /// table.
    ///
    /// A table is written `{ table = "file.csv", ... }` and needs a field that may depend on time.
    pub fn given(&self, key: &str, quantity: &Quantity, names: Names) -> Result<Option<FieldInput>> {
        let Some(node) = self.get(key) else { return Ok(None) };
        let given = |value| Some(FieldInput { key: key.to_owned(), value });
        match &node.value {
            Value::Text(text) => {
                let field = self.formula(key, text, names, quantity)?;
                Ok(given(scene::Value::Formula(field)))
            }
            Value::Table(_) if names.meets(Names::T) => Ok(given(self.table(key, names)?)),
            Value::Integer(_) | Value::Float(_) => {
                let number = self.optional_number(key, quantity)?.unwrap_or_default();
                Ok(given(scene::Value::Formula(number.into())))
            }
            other => Err(self.found(key, other, format!("{}, or a formula", quantity.expected()))),
        }
    }

    fn formula(&self, key: &str, text: &str, names: Names, quantity: &Quantity) -> Result<Field> {
        let field =
            Field::parse_with(text, names, self.parameters()?).map_err(|fault| self.fault(key, fault))?;
        let fault = field.constant().and_then(|number| Some((number, fault_of(number, &quantity.range)?)));
        if let Some((number, fault)) = fault {
            return Err(self.fault(key, format!("{} {fault}; {}", spell(number), quantity.expected())));
        }
        match field.constant() {
            // Zero counts as absent, however it is written.
            Some(0.0) => Ok(0.0.into()),
            _ => Ok(field),
        }
    }

    /// Returns the parameters that all formulas may use, which are read once.
    pub fn parameters(&self) -> Result<&Parameters> {
        match self.parameters.get() {
            Some(parameters) => Ok(parameters),
            None => {
                let parameters = self.read_parameters()?;
                Ok(self.parameters.get_or_init(|| parameters))
            }
        }
    }

    fn read_parameters(&self) -> Result<Parameters> {
        let table = "parameters";
        let mut parameters = Parameters::default();
        let Some(node) = self.get(table) else { return Ok(parameters) };
        let Value::Table(entries) = &node.value else {
            return Err(self.found(table, &node.value, "expected a table of names and numbers"));
        };
        for (name, (place, _)) in entries {
            let key = format!("{table}.{name}");
            check_parameter(name).map_err(|wrong| self.fault_at(*place, &key, wrong))?;
            parameters.set(name, self.number(&key, &PARAMETER)?);
        }
        Ok(parameters)
    }

    /// Reads a table of values over time.
    fn table(&self, key: &str, names: Names) -> Result<scene::Value> {
        let of = |name: &str| format!("{key}.{name}");
        self.allow(key, &OVER_TIME)?;
        let expected = "expected the name of a CSV file with rows of time,value";
        let file = self.optional_text(&of("table"), expected)?;
        let file = file.ok_or_else(|| self.missing(&of("table"), expected))?.to_owned();
        let interpolation = self.choice(&of("interpolation"))?;
        let place = if names.meets(Names::XY) { Names::XY } else { Names::NONE };
        let shape = match self.get(&of("times")).map(|node| &node.value) {
            None => 1.0.into(),
            Some(Value::Text(text)) => self.formula(&of("times"), text, place, &FACTOR)?,
            Some(_) => self.number(&of("times"), &FACTOR)?.into(),
        };
        let path = self.beside(&file);
        let table = Table::read(Path::new(&path), interpolation).map_err(|error| match error {
            Error::Io { .. } => self.fault(&of("table"), error),
            other => other,
        })?;
        Ok(scene::Value::Table { file, path, interpolation, table, shape })
    }

    /// Reads a condition on x and y.
    pub fn condition(&self, key: &str) -> Result<Condition> {
        let expected = "expected a condition on x and y, such as \"x > 0.5 and y < 0.2\"";
        let text = self.optional_text(key, expected)?.ok_or_else(|| self.missing(key, expected))?;
        Condition::parse_with(text, Names::XY, self.parameters()?).map_err(|fault| self.fault(key, fault))
    }

    /// Reads one of these words.
    pub fn one_of<'w>(&self, key: &str, words: &[&'w str]) -> Result<&'w str> {
        let list: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
        let expected = format!("expected one of {}", list.join(", "));
        let text = self.optional_text(key, &expected)?.ok_or_else(|| self.missing(key, &expected))?;
        let found = words.iter().find(|word| **word == text);
        found.copied().ok_or_else(|| {
            self.fault(key, format!("{} is not valid; {expected}{}", quote(text), suggestion(text, words)))
        })
    }

    /// Reads an optional boolean.
    pub fn optional_truth(&self, key: &str) -> Result<Option<bool>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Truth(truth)) => Ok(Some(*truth)),
            Some(other) => Err(self.found(key, other, "expected true or false")),
        }
    }

    /// Reads a required count.
    pub fn count(&self, key: &str, what: &str, least: u32) -> Result<u64> {
        self.optional_count(key, what, least)?
            .ok_or_else(|| self.missing(key, format!("expected {what} of at least {least}")))
    }

    /// Reads an optional whole number of at least `least`.
    pub fn optional_count(&self, key: &str, what: &str, least: u32) -> Result<Option<u64>> {
        let expected = format!("expected {what} of at least {least}");
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Integer(count)) if *count >= i64::from(least) => Ok(Some(count.unsigned_abs())),
            Some(Value::Integer(count)) => Err(self.fault(key, format!("{count} is too small; {expected}"))),
            Some(other) => Err(self.found(key, other, expected)),
        }
    }

    /// Reads an optional text.
    pub fn optional_text(&self, key: &str, expected: impl Display) -> Result<Option<&str>> {
        match self.get(key).map(|node| &node.value) {
            None => Ok(None),
            Some(Value::Text(text)) => Ok(Some(text)),
            Some(other) => Err(self.found(key, other, expected)),
        }
    }

    /// Reads a required word of an enum.
    pub fn choice<T: Choice>(&self, key: &str) -> Result<T> {
        self.optional_choice(key)?.ok_or_else(|| self.missing(key, expected_words::<T>()))
    }

    /// Reads an optional word of an enum.
    pub fn optional_choice<T: Choice>(&self, key: &str) -> Result<Option<T>> {
        let Some(text) = self.optional_text(key, expected_words::<T>())? else { return Ok(None) };
        if let Some((_, case)) = T::WORDS.iter().find(|(word, _)| *word == text) {
            return Ok(Some(*case));
        }
        let words: Vec<&str> = T::WORDS.iter().map(|(word, _)| *word).collect();
        let expected = format!("{}{}", expected_words::<T>(), suggestion(text, &words));
        Err(self.fault(key, format!("{} is not valid; {expected}", quote(text))))
    }

    /// Refuses a key that another key makes meaningless.
    pub fn forbid(&self, key: &str, wrong: impl Display) -> Result<()> {
        self.get(key).map_or(Ok(()), |_| Err(self.fault(key, wrong)))
    }

    /// Works as [`Document::forbid`], for a parameter of an option that was not chosen.
    ///
    /// Where an override made the choice, parameters of the file's own choice are ignored.
    pub fn forbid_with(&self, choice: &str, key: &str, wrong: impl Display) -> Result<()> {
        let gone = self.is_overridden(choice) && !self.is_overridden(key);
        if gone { Ok(()) } else { self.forbid(key, wrong) }
    }

    /// Creates the error for a missing key.
    pub fn missing(&self, key: &str, expected: impl Display) -> Error {
        self.fault(key, format!("missing; {expected}"))
    }

    /// Creates the error for a value of the wrong type.
    pub fn found(&self, key: &str, value: &Value, expected: impl Display) -> Error {
        self.fault(key, format!("found {value}; {expected}"))
    }
}

fn expected_words<T: Choice>() -> String {
    let words: Vec<String> = T::WORDS.iter().map(|(word, _)| format!("\"{word}\"")).collect();
    format!("expected one of {}", words.join(", "))
}
