//! Aligned text for reports and tables.

pub use crate::memory::grouped;
pub use crate::quantity::{
    PREFIXES, engineering, place, place_in, prefix, prefix_of, raised, short, significant,
    significant_digits, two_digits, typeset,
};
use std::fmt;

/// Rows of label, value and unit, with the numbers aligned on their decimal points.
///
/// ```
/// use rebond::output::text::Report;
///
/// let mut report = Report::new("a bouncing plate");
/// report.text("effects", "contact").count("steps", 100_000, "");
/// report.number("first impact", 0.0594, "s");
/// assert_eq!(
///     report.to_string(),
///     "a bouncing plate\n  \
///        effects       contact\n  \
///        steps         100 000\n  \
///        first impact        0.0594 s\n"
/// );
/// ```
#[derive(Debug, Clone)]
pub struct Report {
    title: String,
    rows: Vec<Row>,
}

#[derive(Debug, Clone)]
struct Row {
    label: String,
    value: Value,
}

#[derive(Debug, Clone)]
enum Value {
    Text(String),
    Number { whole: String, fraction: String, unit: &'static str },
}

impl Report {
    /// Creates a report with a title and no rows.
    pub fn new(title: impl Into<String>) -> Self {
        Report { title: title.into(), rows: Vec::new() }
    }

    /// Adds a row with a text.
    pub fn text(&mut self, label: impl Into<String>, text: impl Into<String>) -> &mut Self {
        self.row(label.into(), Value::Text(text.into()))
    }

    /// Adds a row with a number of five significant digits.
    pub fn number(&mut self, label: impl Into<String>, value: f64, unit: &'static str) -> &mut Self {
        let digits = significant(value);
        let split = digits.find(['.', 'e']).unwrap_or(digits.len());
        let (whole, fraction) = digits.split_at(split);
        self.row(label.into(), Value::Number { whole: whole.into(), fraction: fraction.into(), unit })
    }

    /// Adds a row with a number if there is one.
    pub fn optional(&mut self, label: &str, value: Option<f64>, unit: &'static str) -> &mut Self {
        if let Some(value) = value {
            self.number(label, value, unit);
        }
        self
    }

    /// Adds a row with a count, shown with all its digits.
    pub fn count(&mut self, label: impl Into<String>, value: u64, unit: &'static str) -> &mut Self {
        self.row(label.into(), Value::Number { whole: grouped(value), fraction: String::new(), unit })
    }

    fn row(&mut self, label: String, value: Value) -> &mut Self {
        self.rows.push(Row { label, value });
        self
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let length = |text: &str| text.chars().count();
        let labels = self.rows.iter().map(|row| length(&row.label)).max().unwrap_or(0);
        let (mut wholes, mut fractions) = (0, 0);
        for row in &self.rows {
            if let Value::Number { whole, fraction, unit } = &row.value {
                wholes = wholes.max(length(whole));
                // A number without a unit may extend below the units.
                fractions = fractions.max(if unit.is_empty() { 0 } else { length(fraction) });
            }
        }
        writeln!(f, "{}", self.title)?;
        for Row { label, value } in &self.rows {
            let line = match value {
                Value::Text(text) => format!("  {label:labels$}  {text}"),
                Value::Number { whole, fraction, unit } => {
                    format!("  {label:labels$}  {whole:>wholes$}{fraction:fractions$} {unit}")
                }
            };
            writeln!(f, "{}", line.trim_end())?;
        }
        Ok(())
    }
}

/// Rows of cells under heads of one or more lines: the first column to the left, the others to the
/// right.
///
/// ```
/// use rebond::output::text::Table;
///
/// let mut table = Table::new(&["solver", "seconds\na step", "steps"]);
/// table.row(["one".into(), "0.25".into(), "1 000".into()]).note("slow");
/// assert_eq!(
///     table.to_string(),
///     "          seconds\n  solver   a step  steps\n  one        0.25  1 000\n    slow\n"
/// );
/// ```
#[derive(Debug, Clone)]
pub struct Table {
    /// Rows of cells, or notes across the table.
    lines: Vec<std::result::Result<Vec<String>, String>>,
}

impl Table {
    /// Creates a table without rows.
    pub fn new(heads: &[&str]) -> Self {
        let heads: Vec<Vec<&str>> = heads.iter().map(|head| head.lines().collect()).collect();
        let height = heads.iter().map(Vec::len).max().unwrap_or(0);
        // All heads end on the same line.
        let cell = |head: &Vec<&str>, line: usize| {
            (line + head.len()).checked_sub(height).map_or(String::new(), |line| head[line].into())
        };
        let line = |line| Ok(heads.iter().map(|head| cell(head, line)).collect());
        Table { lines: (0..height).map(line).collect() }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) -> &mut Self {
        self.lines.push(Ok(cells.into_iter().collect()));
        self
    }

    /// Adds a note below the last row.
    pub fn note(&mut self, words: impl Into<String>) -> &mut Self {
        self.lines.push(Err(words.into()));
        self
    }
}

/// Columns of a table: their heads, and the functions that give the entries of an item.
pub struct TableColumns<'a, T>(Vec<(String, Entry<'a, T>)>);

type Entry<'a, T> = Box<dyn Fn(&T) -> String + 'a>;

impl<T> Default for TableColumns<'_, T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<'a, T> TableColumns<'a, T> {
    /// Adds a column.
    pub fn add(&mut self, head: impl Into<String>, entry: impl Fn(&T) -> String + 'a) {
        self.0.push((head.into(), Box::new(entry)));
    }

    /// Returns the heads.
    pub fn heads(&self) -> Vec<&str> {
        self.0.iter().map(|(head, _)| head.as_str()).collect()
    }

    /// Returns the entries of an item.
    pub fn row(&self, item: &T) -> Vec<String> {
        self.0.iter().map(|(_, entry)| entry(item)).collect()
    }

    /// Returns the table of some items.
    pub fn table<'t>(&self, items: impl IntoIterator<Item = &'t T>) -> Table
    where
        T: 't,
    {
        let mut table = Table::new(&self.heads());
        table.lines.extend(items.into_iter().map(|item| Ok(self.row(item))));
        table
    }
}

impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let mut widths: Vec<usize> = Vec::new();
        for cells in self.lines.iter().flatten() {
            widths.resize(widths.len().max(cells.len()), 0);
            for (width, cell) in widths.iter_mut().zip(cells) {
                *width = (*width).max(cell.chars().count());
            }
        }
        for line in &self.lines {
            let text = match line {
                Err(words) => format!("    {words}"),
                Ok(cells) => {
                    let mut text = String::new();
                    for (column, (cell, &width)) in cells.iter().zip(&widths).enumerate() {
                        text += &match column {
                            0 => format!("  {cell:width$}"),
                            _ => format!("  {cell:>width$}"),
                        };
                    }
                    text
                }
            };
            writeln!(f, "{}", text.trim_end())?;
        }
        Ok(())
    }
}

/// Returns a word in quotes where a shell would not take it as it stands.
pub fn quoted(word: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_./,:=+@%".contains(letter);
    if !word.is_empty() && word.chars().all(is_plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', r"'\''"))
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn words_are_quoted_for_the_shell() {
        assert_eq!(quoted("time.step=1e-5"), "time.step=1e-5");
        assert_eq!(quoted("mesh.cells=[4, 2]"), "'mesh.cells=[4, 2]'");
        assert_eq!(quoted("load.pressure=2*sin(t)"), "'load.pressure=2*sin(t)'");
        assert_eq!(quoted("title=the plate's"), r"'title=the plate'\''s'");
        assert_eq!(quoted(""), "''");
    }
}
