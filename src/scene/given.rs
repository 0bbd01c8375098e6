//! Fields of a scene: formulas of place and time, tables of time, and the region where they hold.

use crate::element::adaptive::Integrand;
use crate::error::{Error, Result};
use crate::field::{
    Breaks, Condition, Derivatives, Enclosure, Field, Interpolation, Interval, Names, ParseError, Table,
};
use crate::linalg::vectors::{add, scale};
use crate::mesh::Point;

/// Field input: a number, a formula of x, y (m) and t (s), or a table of t times a formula of x and
/// y.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldInput {
    /// Key that gives the field, for messages.
    pub key: String,
    /// Number or formula; beside a table, of x and y only.
    pub formula: Field,
    /// Table of measured values over time, which multiplies the formula.
    pub table: Option<MeasuredTable>,
}

/// Table of measured values over time, and where it was found.
#[derive(Debug, Clone, PartialEq)]
pub struct MeasuredTable {
    /// File name as the scene writes it.
    pub file: String,
    /// Path where the file was found.
    pub path: String,
    /// Interpolation between the rows.
    pub interpolation: Interpolation,
    /// Rows of the table.
    pub rows: Table,
}

/// Width of the range that a pole lies in, relative to the deflection.
const SAME: f64 = 1e-9;

/// Field at one instant, as a function of place and deflection.
pub struct OfDeflection<'f> {
    input: &'f FieldInput,
    /// Formula in which t stands for the deflection.
    field: Field,
    factor: f64,
}

impl OfDeflection<'_> {
    /// Returns the value at a place (m) under a deflection (m).
    ///
    /// # Errors
    /// Returns [`Error::Scene`] naming the key where the formula has no finite value.
    pub fn value(&self, place: Point, deflection: f64) -> Result<f64> {
        let value = self.field.value(place, deflection);
        Ok(self.factor * value.map_err(|_| self.fault(deflection))?)
    }

    /// Returns the value and its two derivatives by the deflection (m) at a place (m).
    ///
    /// # Errors
    /// Returns [`Error::Scene`] naming the key where the formula has no finite value or is not
    /// smooth.
    pub fn jet(&self, place: Point, deflection: f64) -> Result<[f64; 3]> {
        let jet = self.field.jet(place, deflection);
        let Derivatives { value, first, second } = jet.map_err(|_| self.fault(deflection))?;
        Ok([value, first, second].map(|part| self.factor * part))
    }

    /// Returns a deflection between 0 and this one (m) at which the field has a pole at a place
    /// (m), if any.
    pub fn pole(&self, place: Point, deflection: f64) -> Option<f64> {
        let mut parts = vec![[deflection.min(0.0), deflection.max(0.0)]];
        while let Some([low, high]) = parts.pop() {
            if self.field.range(place, low, high).magnitude().is_finite() {
                continue;
            }
            let middle = 0.5 * (low + high);
            if high - low <= SAME * deflection.abs() {
                return Some(middle);
            }
            parts.extend([[low, middle], [middle, high]]);
        }
        None
    }

    fn fault(&self, deflection: f64) -> Error {
        Error::Scene(format!(
            "{}: \"{}\" has no finite value and slope where the deflection is {deflection:.4e} m",
            self.input.key, self.input.formula
        ))
    }
}

impl FieldInput {
    /// Creates the field of a formula.
    pub fn new(key: &str, formula: impl Into<Field>) -> FieldInput {
        FieldInput { key: key.into(), formula: formula.into(), table: None }
    }

    /// Returns the number if the field is a constant formula.
    pub fn number(&self) -> Option<f64> {
        self.lone_formula()?.constant()
    }

    /// Returns whether the field is the number zero, which counts as absent.
    pub fn is_zero(&self) -> bool {
        self.number() == Some(0.0)
    }

    /// Returns the formula that gives the whole field; `None` beside a table.
    pub fn lone_formula(&self) -> Option<&Field> {
        self.table.is_none().then_some(&self.formula)
    }

    /// Returns the field as a function of the time since an instant (s).
    pub fn from_time(&self, start: f64) -> FieldInput {
        let mut later = FieldInput { formula: self.formula.from_time(start), ..self.clone() };
        later.table.iter_mut().for_each(|table| table.rows = table.rows.from_time(start));
        later
    }

    /// Returns whether the field may change with time.
    pub fn changes(&self) -> bool {
        self.table.is_some() || self.formula.depends_on(Names::T)
    }

    /// Returns whether the field may depend on the deflection.
    pub fn follows_deflection(&self) -> bool {
        self.formula.depends_on(Names::W)
    }

    /// Returns the field at an instant (s) as a function of place and deflection.
    pub fn of_deflection(&self, t: f64) -> OfDeflection<'_> {
        OfDeflection { input: self, field: self.formula.of_deflection(t), factor: self.factor(t) }
    }

    /// Returns whether the field is independent of the place.
    pub fn is_even(&self) -> bool {
        !self.formula.depends_on(Names::XY)
    }

    /// Returns the factor on the formula at a time (s): 1 without a table.
    fn factor(&self, t: f64) -> f64 {
        self.table.as_ref().map_or(1.0, |table| table.rows.value(t))
    }

    /// Returns the value at a place (m) and a time (s).
    ///
    /// # Errors
    /// Returns [`Error::Scene`] naming the key where the formula has no finite value.
    pub fn at(&self, place: Point, t: f64) -> Result<f64> {
        Ok(self.factor(t) * self.checked(self.formula.value(place, t))?)
    }

    /// Returns the value and the slopes along x and y at a place (m), at time 0.
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`], and [`Error::Scene`] where the formula is not
    /// smooth.
    pub fn gradient(&self, place: Point) -> Result<[f64; 3]> {
        Ok(self.checked(self.formula.gradient(place, 0.0))?.map(|value| self.factor(0.0) * value))
    }

    /// Writes the values at a time (s), one per place (m).
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`].
    pub fn values(&self, points: &[Point], t: f64, values: &mut [f64]) -> Result<()> {
        self.checked(self.formula.values(points, t, values))?;
        if self.table.is_some() {
            scale(self.factor(t), values);
        }
        Ok(())
    }

    /// Returns the value of a field without dependence on place, with two derivatives in time (s).
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`], and [`Error::Scene`] where the formula is not
    /// smooth.
    pub fn jet(&self, t: f64) -> Result<Derivatives> {
        let jet = self.checked(self.formula.jet(Point::origin(), t))?;
        Ok(self.table.as_ref().map_or(jet, |table| table.rows.jet(t).times(jet)))
    }

    /// Finds kinks and jumps at a place (m) up to an instant (s) in at most `looks` evaluations.
    ///
    /// See [`Field::breaks`].
    pub fn breaks(&self, place: Point, end: f64, looks: usize) -> Breaks {
        match &self.table {
            Some(table) => table.rows.breaks(0.0, end),
            None => self.formula.breaks(place, 0.0, end, looks),
        }
    }

    /// Returns bounds on the values at a place (m) between two instants (s).
    pub fn range(&self, place: Point, from: f64, to: f64) -> Interval {
        let range = self.formula.range(place, from, to);
        self.table.as_ref().map_or(range, |table| table.rows.range(from, to).times(range))
    }

    /// Splits the field into a sum of products g(t) h(x, y), if it has such a form.
    ///
    /// Each pair is g and h, with the name of the key.
    pub fn terms(&self) -> Option<Vec<[FieldInput; 2]>> {
        let part = |formula| FieldInput::new(&self.key, formula);
        if self.table.is_some() {
            let time = FieldInput { formula: 1.0.into(), ..self.clone() };
            return Some(vec![[time, part(self.formula.clone())]]);
        }
        Some(self.formula.terms()?.into_iter().map(|term| [part(term.time), part(term.place)]).collect())
    }

    /// Splits a field of time alone into a law and the number that multiplies it.
    pub fn law(&self) -> (FieldInput, f64) {
        if let Some([[law, amplitude]]) = self.terms().as_deref()
            && let Some(amplitude) = amplitude.number()
        {
            return (law.clone(), amplitude);
        }
        (self.clone(), 1.0)
    }

    /// Returns whether a quadrature rule of degree 6 integrates the load of this field exactly.
    ///
    /// This holds for polynomials of degree 3 or less in x and y.
    pub fn is_low(&self) -> bool {
        self.formula.degree().is_some_and(|degree| degree <= 3)
    }

    /// Returns whether the field is a polynomial in x and y.
    pub fn is_polynomial(&self) -> bool {
        self.formula.degree().is_some()
    }

    /// Encloses the values over the rectangle between two corners (m) and between two times (s).
    pub fn enclose(&self, low: Point, high: Point, t: Interval) -> Enclosure<3> {
        self.formula.enclose(low, high, t).scaled(self.factor(t.low))
    }

    /// Returns the field at a fixed time (s), for integration over the plate.
    pub fn still(&self, t: f64) -> Still<'_> {
        Still { given: self, t }
    }

    /// Adds the key to the error of a formula.
    fn checked<T>(&self, result: std::result::Result<T, ParseError>) -> Result<T> {
        result.map_err(|fault| Error::Scene(format!("{}: {fault}", self.key)))
    }
}

/// Field at one instant.
#[derive(Debug, Clone, Copy)]
pub struct Still<'g> {
    given: &'g FieldInput,
    t: f64,
}

impl Integrand for Still<'_> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        self.given.values(points, self.t, values)
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure<3> {
        self.given.enclose(low, high, Interval::point(self.t))
    }

    fn side(&self, place: Point) -> u64 {
        self.given.formula.side(place, self.t)
    }
}

/// Sum of several fields.
impl Integrand for Vec<Still<'_>> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        values.fill(0.0);
        let mut terms = vec![0.0; points.len()];
        for field in self {
            field.values(points, &mut terms)?;
            add(&terms, values);
        }
        Ok(())
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure<3> {
        self.iter().map(|field| field.enclose(low, high)).fold(Enclosure::ZERO, Enclosure::plus)
    }

    fn side(&self, place: Point) -> u64 {
        self.iter().fold(0, |side: u64, field| side.rotate_left(17) ^ field.side(place))
    }
}

/// Region of the plate.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// Whole plate.
    All,
    /// Region where a condition on x and y holds.
    Where(Condition),
    /// Cells of a physical group.
    Group(String),
    /// Single node at these coordinates, in m.
    At([f64; 2]),
    /// Nodes of a physical point.
    Point(String),
    /// Nodes on the line between two points, in m.
    Line([[f64; 2]; 2]),
}
