//! Columns of `history.csv`: their names and numbers.

use super::document::quote;
use super::entry::Kind;
use super::kinds::text;
use std::fmt::Write as _;

macro_rules! columns {
    ($($(#[$doc:meta])* $name:ident: $number:ty,)*) => {
        /// Columns of `history.csv` before the probes, whose names must differ from these.
        pub const HISTORY_COLUMNS: [&str; [$(stringify!($name)),*].len()] = [$(stringify!($name)),*];

        /// Row of the history.
        #[derive(Debug, Clone, Copy)]
        pub struct HistoryRow<'r> {
            $($(#[$doc])* pub $name: $number,)*
            /// Quantities at the probes, such as the deflections in m.
            pub probes: &'r [f64],
            /// Forces and impulses by name, in the order of
            /// [`Scene::force_columns`](super::Scene::force_columns).
            pub forces: &'r [f64],
        }

        impl HistoryRow<'_> {
            /// Returns the numbers of all columns.
            pub fn numbers(&self) -> impl Iterator<Item = f64> {
                let told = [$(ColumnNumber::value(self.$name)),*];
                told.into_iter().chain(self.probes.iter().chain(self.forces).copied())
            }

            /// Appends the numbers of all columns to a line, separated by commas.
            pub fn write(&self, line: &mut String) {
                $(
                    self.$name.write(line);
                    line.push(',');
                )*
                line.pop();
                for number in self.probes.iter().chain(self.forces) {
                    line.push(',');
                    number.write(line);
                }
            }
        }
    };
}

columns! {
    /// Index of the step.
    step: u64,
    /// Time, in s.
    time: f64,
    /// Energy of the scheme, in J.
    energy: f64,
    /// Kinetic energy, in J.
    kinetic: f64,
    /// Elastic energy, in J.
    elastic: f64,
    /// Work of the external loads, in J.
    work: f64,
    /// Number of nodes in contact at this instant.
    contact_nodes: u64,
    /// Sum of the reactions of the obstacles at this instant, in N, positive upwards.
    contact_force: f64,
    /// Iterations of the contact solver since the last row.
    vi_iterations: u64,
    /// Largest relative KKT residual since the last row.
    kkt: f64,
}

/// Number of a column, which reads back as the same bits.
pub trait ColumnNumber {
    /// Returns the number, rounded where it has more than 53 bits.
    fn value(self) -> f64;

    /// Appends the number to a line.
    fn write(&self, line: &mut String);
}

impl ColumnNumber for u64 {
    fn value(self) -> f64 {
        self as f64
    }

    fn write(&self, line: &mut String) {
        write!(line, "{self}").expect("a string takes everything");
    }
}

impl ColumnNumber for f64 {
    fn value(self) -> f64 {
        self
    }

    /// The shortest decimals that read back, with an exponent if that is easier to read.
    fn write(&self, line: &mut String) {
        let plain = *self == 0.0 || (1e-3..1e7).contains(&self.abs());
        if plain { write!(line, "{self}") } else { write!(line, "{self:e}") }
            .expect("a string takes everything");
    }
}

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
