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
    /// Value of the field.
    pub value: Value,
}

/// Value of a [`FieldInput`].
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Number or formula.
    Formula(Field),
    /// Table of measured values over time.
    Table {
        /// File name as the scene writes it.
        file: String,
        /// Path where the file was found.
        path: String,
        /// Interpolation between the rows.
        interpolation: Interpolation,
        /// Rows of the table.
        table: Table,
        /// Formula of x and y that multiplies the table.
        shape: Field,
    },
}

impl FieldInput {
    /// Creates a constant field.
    pub fn constant(key: &str, value: f64) -> FieldInput {
        FieldInput { key: key.into(), value: Value::Formula(value.into()) }
    }

    /// Returns the number if the field is a constant formula.
    pub fn number(&self) -> Option<f64> {
        match &self.value {
            Value::Formula(field) => field.constant(),
            Value::Table { .. } => None,
        }
    }

    /// Returns whether the field is the number zero, which counts as absent.
    pub fn is_zero(&self) -> bool {
        self.number() == Some(0.0)
    }

    /// Returns the field whose clock starts at an instant (s) of this one.
    pub fn from_time(&self, start: f64) -> FieldInput {
        let mut later = self.clone();
        match &mut later.value {
            Value::Formula(field) => *field = field.from_time(start),
            Value::Table { table, .. } => *table = table.from_time(start),
        }
        later
    }

    /// Returns whether the field may change with time.
    pub fn changes(&self) -> bool {
        match &self.value {
            Value::Formula(field) => field.depends_on(Names::T),
            Value::Table { .. } => true,
        }
    }

    /// Returns whether the field is independent of the place.
    pub fn is_even(&self) -> bool {
        match &self.value {
            Value::Formula(field) => !field.depends_on(Names::XY),
            Value::Table { shape, .. } => !shape.depends_on(Names::XY),
        }
    }

    /// Returns the value at a place (m) and a time (s).
    ///
    /// # Errors
    /// Returns [`Error::Scene`] naming the key where the formula has no finite value.
    pub fn at(&self, at: Point, t: f64) -> Result<f64> {
        match &self.value {
            Value::Formula(field) => field.value(at, t).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                Ok(table.value(t) * shape.value(at, t).map_err(|fault| self.fault(&fault))?)
            }
        }
    }

    /// Returns the value and the slopes along x and y at a place (m), at time 0.
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`], and [`Error::Scene`] where the formula is not
    /// smooth.
    pub fn gradient(&self, at: Point) -> Result<[f64; 3]> {
        let of = |field: &Field| field.gradient(at, 0.0).map_err(|fault| self.fault(&fault));
        match &self.value {
            Value::Formula(field) => of(field),
            Value::Table { table, shape, .. } => Ok(of(shape)?.map(|value| table.value(0.0) * value)),
        }
    }

    /// Writes the values at a time (s), one per place (m).
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`].
    pub fn values(&self, points: &[Point], t: f64, values: &mut [f64]) -> Result<()> {
        match &self.value {
            Value::Formula(field) => field.values(points, t, values).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                shape.values(points, t, values).map_err(|fault| self.fault(&fault))?;
                scale(table.value(t), values);
                Ok(())
            }
        }
    }

    /// Returns the value of a field without dependence on place, with two derivatives in time (s).
    ///
    /// # Errors
    /// Returns the errors of [`FieldInput::at`], and [`Error::Scene`] where the formula is not
    /// smooth.
    pub fn jet(&self, t: f64) -> Result<Derivatives> {
        match &self.value {
            Value::Formula(field) => field.jet(Point::origin(), t).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                let scale = shape.value(Point::origin(), t).map_err(|fault| self.fault(&fault))?;
                let Derivatives { value, first, second } = table.jet(t);
                Ok(Derivatives { value: scale * value, first: scale * first, second: scale * second })
            }
        }
    }

    /// Finds kinks and jumps at a place (m) up to an instant (s) in at most `looks` evaluations.
    ///
    /// See [`Field::breaks`].
    pub fn breaks(&self, at: Point, end: f64, looks: usize) -> Breaks {
        match &self.value {
            Value::Formula(field) => field.breaks(at, 0.0, end, looks),
            Value::Table { table, .. } => table.breaks(0.0, end),
        }
    }

    /// Returns bounds on the values at a place (m) between two instants (s).
    pub fn range(&self, at: Point, from: f64, to: f64) -> Interval {
        match &self.value {
            Value::Formula(field) => field.range(at, from, to),
            Value::Table { table, shape, .. } => table.range(from, to).times(shape.range(at, from, to)),
        }
    }

    /// Splits the field into a sum of products g(t) h(x, y), if it has such a form.
    ///
    /// Each pair is g and h, with the name of the key.
    pub fn terms(&self) -> Option<Vec<[FieldInput; 2]>> {
        let part = |field| FieldInput { key: self.key.clone(), value: Value::Formula(field) };
        match &self.value {
            Value::Formula(field) => {
                Some(field.terms()?.into_iter().map(|term| [part(term.time), part(term.place)]).collect())
            }
            Value::Table { shape, .. } => {
                let mut time = self.clone();
                if let Value::Table { shape, .. } = &mut time.value {
                    *shape = 1.0.into();
                }
                Some(vec![[time, part(shape.clone())]])
            }
        }
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

    /// Returns the formula, if the field is one.
    pub fn formula(&self) -> Option<&Field> {
        match &self.value {
            Value::Formula(field) => Some(field),
            Value::Table { .. } => None,
        }
    }

    /// Returns the formula of place and the factor that multiplies it at a time (s).
    fn place(&self, t: f64) -> (&Field, f64) {
        match &self.value {
            Value::Formula(field) => (field, 1.0),
            Value::Table { table, shape, .. } => (shape, table.value(t)),
        }
    }

    /// Returns whether a quadrature rule of degree 6 integrates the load of this field exactly.
    ///
    /// This holds for polynomials of degree 3 or less in x and y.
    pub fn is_low(&self) -> bool {
        self.place(0.0).0.degree().is_some_and(|degree| degree <= 3)
    }

    /// Returns whether the field is a polynomial in x and y.
    pub fn is_polynomial(&self) -> bool {
        self.place(0.0).0.degree().is_some()
    }

    /// Encloses the values over the rectangle between two corners (m) and between two times (s).
    pub fn enclose(&self, low: Point, high: Point, t: Interval) -> Enclosure<3> {
        let (field, factor) = self.place(t.low);
        field.enclose(low, high, t).scaled(factor)
    }

    /// Freezes the field at a time (s), for integration over the plate.
    pub fn still(&self, t: f64) -> Still<'_> {
        Still { given: self, t }
    }

    /// Creates the error of a formula, with the key.
    fn fault(&self, fault: &ParseError) -> Error {
        Error::Scene(format!("{}: {fault}", self.key))
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

    fn side(&self, at: Point) -> u64 {
        self.given.place(self.t).0.side(at, self.t)
    }
}

/// Sum of several fields.
impl Integrand for Vec<Still<'_>> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        values.fill(0.0);
        let mut terms = vec![0.0; points.len()];
        for of in self {
            of.values(points, &mut terms)?;
            add(&terms, values);
        }
        Ok(())
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure<3> {
        self.iter().map(|of| of.enclose(low, high)).fold(Enclosure::ZERO, Enclosure::plus)
    }

    fn side(&self, at: Point) -> u64 {
        self.iter().fold(0, |side: u64, of| side.rotate_left(17) ^ of.side(at))
    }
}

/// Region of the plate.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// WholeNumber plate.
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
