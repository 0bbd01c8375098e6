//! `history.csv`: rows of a run, written as it advances, and their reader.

use super::Lines;
use crate::error::{Error, Result};
use crate::geometry::range;
use crate::hash::Extent;
use crate::input;
pub use crate::scene::HISTORY_COLUMNS as COLUMNS;
use crate::scene::{ColumnNumber, ProbeQuantity};
pub use crate::simulation::Row;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "history.csv";

/// Writer of `history.csv`.
///
/// Every number reads back as the same `f64`. Rows reach the file whole, at most about a second
/// after the row before, and when the history is finished or dropped, so that an interrupted run
/// keeps its rows.
#[derive(Debug)]
pub struct History {
    lines: Lines,
    /// Numbers of columns of probes, and of forces.
    columns: [usize; 2],
}

impl History {
    /// Creates `history.csv` in `folder`, which is created if necessary.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] for a name of a probe that cannot head a column, and [`Error::Io`]
    /// where the file cannot be written.
    pub fn create(folder: &Path, probes: &[String], forces: &[String]) -> Result<Self> {
        for (i, name) in probes.iter().enumerate() {
            let is_formula = name.trim_start().starts_with(['=', '+', '-', '@']);
            if name.is_empty() || is_formula || name.contains([',', '"']) || name.contains(char::is_control) {
                return Err(Error::Scene(format!(
                    "probe name {name:?}: it heads a column of {FILE}, so it must not be empty nor hold commas, \
                     double quotes or control characters, nor begin with =, +, - or @"
                )));
            }
            if COLUMNS.contains(&name.as_str()) || probes[..i].contains(name) {
                return Err(Error::Scene(format!(
                    "probe name {name:?}: {FILE} already has a column of that name"
                )));
            }
        }
        let named = probes.iter().chain(forces).map(String::as_str);
        let names: Vec<&str> = COLUMNS.into_iter().chain(named).collect();
        let columns = [probes.len(), forces.len()];
        Ok(History { lines: Lines::create(folder, FILE, &names.join(","))?, columns })
    }

    /// Continues after what the file had at a checkpoint; `columns` are the numbers of columns
    /// of probes and of forces.
    pub fn resume(folder: &Path, columns: [usize; 2], written: Extent) -> Result<Self> {
        Ok(History { lines: Lines::resume(folder, FILE, written)?, columns })
    }

    /// Writes everything to the disk and returns what the file has.
    pub fn position(&mut self) -> Result<Extent> {
        self.lines.position()
    }

    /// Adds a row.
    ///
    /// # Panics
    ///
    /// Panics where the row has more or fewer probes or forces than the header.
    pub fn push(&mut self, row: &Row) -> Result<()> {
        let columns = [row.probes.len(), row.forces.len()];
        assert_eq!(columns, self.columns, "a row needs one value per probe and force");
        self.lines.push(|line| row.write(line))
    }

    /// Passes all rows to the operating system, and reports errors of the last write, which a drop
    /// ignores.
    pub fn flush(&mut self) -> Result<()> {
        self.lines.flush()
    }
}

/// Appends numbers, each after a comma.
pub(super) fn numbers(line: &mut String, values: impl IntoIterator<Item = f64>) {
    for value in values {
        line.push(',');
        value.write(line);
    }
}

/// History read back: named columns of equal length, [`COLUMNS`] first.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    names: Vec<String>,
    columns: Vec<Vec<f64>>,
    /// Quantity of each probe.
    quantities: Vec<ProbeQuantity>,
    /// Whether each probe is of a ball.
    balls: Vec<bool>,
}

/// Ratio of the ranges of balls and of the plate above which one chart does not show both.
const FAR: f64 = 5.0;

/// Number, name and values of a probe.
type Probe<'t> = (usize, &'t str, &'t [f64]);

/// Probes of one chart.
pub struct ProbeChart<'t> {
    /// Quantity that they show.
    pub title: String,
    /// Unit of their values.
    pub unit: &'static str,
    /// Their numbers, names and values.
    pub probes: Vec<Probe<'t>>,
}

impl Table {
    /// Returns the number of rows.
    pub fn rows(&self) -> usize {
        self.columns[0].len()
    }

    /// Returns the column of that name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        let index = self.names.iter().position(|n| n == name)?;
        Some(&self.columns[index])
    }

    /// Returns kinetic and elastic energy together, in J.
    pub fn stored(&self) -> Vec<f64> {
        let [kinetic, elastic] = ["kinetic", "elastic"].map(|name| self.column(name).unwrap_or_default());
        kinetic.iter().zip(elastic).map(|(kinetic, elastic)| kinetic + elastic).collect()
    }

    /// Returns the change of a column since the first row, times a factor.
    pub fn since_start(&self, name: &str, factor: f64) -> Vec<f64> {
        let values = self.column(name).unwrap_or_default();
        values.iter().map(|value| factor * (value - values[0])).collect()
    }

    /// Sets from the name of each probe its quantity and whether it is of a ball; by default all
    /// are deflections of the plate.
    pub fn with_quantities(mut self, quantity_of: impl Fn(&str) -> (ProbeQuantity, bool)) -> Table {
        let names = self.names.iter().skip(COLUMNS.len());
        (self.quantities, self.balls) = names.map(|name| quantity_of(name)).unzip();
        self
    }

    /// Returns the charts of the probes: one per quantity, and another one for balls that go much
    /// farther than the plate.
    pub fn charts(&self) -> Vec<ProbeChart<'_>> {
        let mut charts = Vec::new();
        for (quantity, unit) in self.axes() {
            let probes: Vec<Probe> = self.probes_of((quantity, unit)).collect();
            let (balls, plate): (Vec<Probe>, _) = probes.iter().partition(|probe| self.balls[probe.0]);
            let span = |probes: &[Probe]| {
                let values = probes.iter().flat_map(|probe| probe.2).copied();
                let [low, high] = range(values.filter(|value| value.is_finite()));
                high - low
            };
            if plate.is_empty() || span(&balls) <= FAR * span(&plate) {
                charts.push(ProbeChart { title: quantity.into(), unit, probes });
            } else {
                let of_balls = if quantity == "deflection" { "height" } else { quantity };
                charts.push(ProbeChart { title: quantity.into(), unit, probes: plate });
                charts.push(ProbeChart { title: format!("{of_balls} of balls"), unit, probes: balls });
            }
        }
        charts
    }

    /// Returns number, name and values of each probe of a deflection (m).
    pub fn deflections(&self) -> impl Iterator<Item = (usize, &str, &[f64])> {
        self.probes_of(ProbeQuantity::Deflection.axis())
    }

    /// Returns number, name and values of each probe whose quantity has a certain name and unit.
    pub fn probes_of(
        &self,
        axis: (&'static str, &'static str),
    ) -> impl Iterator<Item = (usize, &str, &[f64])> {
        let probes = self.probes().enumerate().zip(&self.quantities);
        let on_axis = move |(_, quantity): &(_, &ProbeQuantity)| quantity.axis() == axis;
        probes.filter(on_axis).map(|((number, (name, values)), _)| (number, name, values))
    }

    /// Returns name, quantity and values of each probe.
    pub fn probes_with_quantities(&self) -> impl Iterator<Item = (&str, ProbeQuantity, &[f64])> {
        self.probes().zip(&self.quantities).map(|((name, values), quantity)| (name, *quantity, values))
    }

    /// Returns the names and units of the probes' quantities, each once, in the probes' order.
    pub fn axes(&self) -> Vec<(&'static str, &'static str)> {
        let mut axes = Vec::new();
        for axis in self.probes().zip(&self.quantities).map(|(_, quantity)| quantity.axis()) {
            if !axes.contains(&axis) {
                axes.push(axis);
            }
        }
        axes
    }

    /// Returns name and values of each probe.
    pub fn probes(&self) -> impl Iterator<Item = (&str, &[f64])> {
        let columns = self.names.iter().zip(&self.columns).take(self.first_force()).skip(COLUMNS.len());
        columns.map(|(name, values)| (name.as_str(), values.as_slice()))
    }

    /// Returns name and force (N) of each named support and obstacle.
    pub fn forces(&self) -> impl Iterator<Item = (&str, &[f64])> {
        let columns = self.names.iter().zip(&self.columns).skip(self.first_force());
        columns.filter_map(|(name, values)| Some((name.strip_prefix("force_")?, values.as_slice())))
    }

    /// Returns the index of the first column of a force, which is followed by the impulse of the
    /// same support or obstacle.
    fn first_force(&self) -> usize {
        let is_force = |pair: &[String]| match pair[0].strip_prefix("force_") {
            Some(name) => pair[1].strip_prefix("impulse_") == Some(name),
            None => false,
        };
        let first = self.names[COLUMNS.len()..].windows(2).position(is_force);
        first.map_or(self.names.len(), |index| COLUMNS.len() + index)
    }
}

/// Reads the `history.csv` of a run folder; the error for a malformed file names the line.
pub fn read(folder: &Path) -> Result<Table> {
    let path = folder.join(FILE);
    let file = input::open_plain(File::options().read(true), &path).map_err(Error::io(&path))?;
    parse(BufReader::new(file)).map_err(Error::io(path))
}

fn parse(mut file: impl BufRead) -> io::Result<Table> {
    let mut line = String::new();
    let mut count = 0;
    let mut next = |line: &mut String| -> io::Result<Option<usize>> {
        line.clear();
        count += 1;
        match file.read_line(line) {
            Ok(0) => return Ok(None),
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                return Err(malformed(count, "not text"));
            }
            Err(error) => return Err(error),
        }
        if line.pop() != Some('\n') {
            return Err(malformed(count, "cut short; delete this line to read the others"));
        }
        Ok(Some(count))
    };

    next(&mut line)?;
    let names: Vec<String> = line.split(',').map(str::to_owned).collect();
    if !names.iter().map(String::as_str).take(COLUMNS.len()).eq(COLUMNS) {
        return Err(malformed(1, &format!("expected a header that starts with {}", COLUMNS.join(","))));
    }

    let mut columns = vec![Vec::new(); names.len()];
    while let Some(number) = next(&mut line)? {
        let count = line.split(',').count();
        if count != names.len() {
            return Err(malformed(number, &format!("expected {} values, found {count}", names.len())));
        }
        for ((text, column), name) in line.split(',').zip(&mut columns).zip(&names) {
            let value = text.trim().parse();
            column.push(value.map_err(|_| malformed(number, &format!("{name} is not a number: {text:?}")))?);
        }
    }
    let probes = names.len() - COLUMNS.len();
    let (quantities, balls) = (vec![ProbeQuantity::Deflection; probes], vec![false; probes]);
    Ok(Table { names, columns, quantities, balls })
}

pub(super) fn malformed(line: usize, what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, format!("line {line}: {what}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn balls_have_a_chart_where_they_go_far() {
        let table = |height: f64| {
            let rows = [0.0, 1.0]
                .map(|share| format!("{}{},{}\n", "0,".repeat(COLUMNS.len()), 2.0 * share, height * share));
            let text = format!("{},tip,ball\n{}", COLUMNS.join(","), rows.concat());
            let of_probe = |name: &str| (ProbeQuantity::Deflection, name == "ball");
            parse(text.as_bytes()).unwrap().with_quantities(of_probe)
        };
        let titles = |table: &Table| table.charts().into_iter().map(|chart| chart.title).collect::<Vec<_>>();
        assert_eq!(titles(&table(9.9)), ["deflection"]);
        let far = table(10.1);
        assert_eq!(titles(&far), ["deflection", "height of balls"]);
        assert_eq!(far.charts()[1].probes[0], (1, "ball", &[0.0, 10.1][..]));
    }
}
