//! Aligned text for reports and tables.

pub use crate::memory::grouped;
use std::fmt;

/// SI prefixes of the powers of 1000 from -5 to 4.
pub const PREFIXES: [&str; 10] = ["f", "p", "n", "u", "m", "", "k", "M", "G", "T"];

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

/// Formats five significant digits without trailing zeros, with an exponent outside 0.001 to 1e6.
pub fn significant(value: f64) -> String {
    significant_digits(value, 5)
}

/// Formats some significant digits as [`significant`] formats five.
pub fn significant_digits(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".into(); // which -0.0 is too
    }
    if !value.is_finite() {
        return value.to_string();
    }
    let magnitude = value.abs().log10().floor();
    if !(-3.0..6.0).contains(&magnitude) {
        let digits = format!("{value:.*e}", digits - 1);
        let (mantissa, exponent) = digits.split_once('e').unwrap_or((&digits, "0"));
        return format!("{}e{exponent}", without_idle_zeros(mantissa));
    }
    let decimals = (digits as f64 - 1.0 - magnitude).max(0.0) as usize;
    without_idle_zeros(&format!("{value:.decimals$}")).to_owned()
}

/// Formats a number in SI units with four significant digits and the prefix of the unit that leaves
/// one to three digits before the point.
///
/// ```
/// use rebond::output::text::engineering;
///
/// assert_eq!(engineering(-0.2085, "m"), "-208.5 mm");
/// assert_eq!(engineering(20.169e6, "Pa"), "20.17 MPa");
/// assert_eq!(engineering(0.0, "N s"), "0 N s");
/// ```
pub fn engineering(value: f64, unit: &str) -> String {
    let (scale, prefix) = prefix(value);
    format!("{} {prefix}{unit}", significant_digits(value / scale, 4))
}

/// Raises the exponents of a unit.
pub fn raised(unit: &str) -> String {
    unit.replace("m2", "m²").replace("m3", "m³").replace("s2", "s²")
}

/// Sets a text: micro, minus and times signs, and each unit beside its number.
pub fn typeset(text: &str) -> String {
    let mut words: Vec<String> = Vec::new();
    for word in text.split(' ') {
        let unit = word.trim_end_matches([',', ';']);
        let bare = |prefix: &&str| unit.strip_prefix(*prefix);
        let is_unit = PREFIXES.iter().filter_map(bare).any(|unit| UNITS.contains(&unit));
        let is_number = |last: &String| last.ends_with(|c: char| c.is_ascii_digit() || ")N".contains(c));
        match (words.last_mut(), word.strip_prefix('u')) {
            (Some(last), Some(rest)) if is_unit && is_number(last) => *last += &format!("\u{a0}\u{b5}{rest}"),
            (Some(last), None) if is_unit && is_number(last) => *last += &format!("\u{a0}{word}"),
            _ if word == "x" => words.push("\u{d7}".into()),
            _ => words.push(word.replace('-', "\u{2212}")),
        }
    }
    words.join(" ")
}

/// Units in texts.
const UNITS: [&str; 14] =
    ["m", "s", "Pa", "N", "J", "Hz", "g", "%", "m/s", "W", "N/m", "N/m²", "N/m³", "N/m^1.5"];

/// Formats the coordinates of a point, given in m, with four digits of the larger one.
pub fn place(point: [f64; 2]) -> String {
    let largest = point[0].abs().max(point[1].abs());
    let (scale, prefix) = prefix(largest);
    place_in(point, scale, &format!("{prefix}m"))
}

/// Formats the coordinates of a point, given in m, in a unit of some metres.
pub fn place_in(point: [f64; 2], scale: f64, unit: &str) -> String {
    let largest = point[0].abs().max(point[1].abs());
    let decimals = (3.0 - (largest / scale).log10().floor()).clamp(0.0, 6.0) as usize;
    let [x, y] = point.map(|x| {
        let digits = format!("{:.decimals$}", x / scale);
        let digits = without_idle_zeros(&digits);
        if digits == "-0" { "0".to_owned() } else { digits.to_owned() }
    });
    format!("({x}, {y}) {unit}")
}

/// Returns the power of 1000 that leaves one to three digits of a value before the point, after
/// rounding to four digits, and its prefix.
pub fn prefix(value: f64) -> (f64, &'static str) {
    if value == 0.0 || !value.is_finite() {
        return (1.0, "");
    }
    // 0.99995 and more round up to 1.
    let power = ((value.abs() / 0.99995).log10() / 3.0).floor().clamp(-5.0, 4.0);
    (1000_f64.powf(power), prefix_of(3 * power as i32).unwrap_or_default())
}

/// Returns the SI prefix of a power of ten; `None` where it has none.
pub fn prefix_of(exponent: i32) -> Option<&'static str> {
    let number = usize::try_from(exponent / 3 + 5).ok().filter(|_| exponent % 3 == 0)?;
    PREFIXES.get(number).copied()
}

/// Formats two digits as [`significant`] formats five.
pub fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return significant(value);
    }
    let digit = 10f64.powf(value.abs().log10().floor() - 1.0);
    significant((value / digit).round() * digit)
}

/// Formats two significant digits with an exponent, as errors and residuals are told.
pub fn two_digits(value: f64) -> String {
    if value == 0.0 { "0".into() } else { format!("{value:.1e}") }
}

fn without_idle_zeros(decimal: &str) -> &str {
    if decimal.contains('.') { decimal.trim_end_matches('0').trim_end_matches('.') } else { decimal }
}
