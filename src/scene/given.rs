//! What a scene gives as a *field*: a formula of place and time, or a table of time, and where on the plate it holds.

use super::Time;
use crate::element::adaptive::Integrand;
use crate::error::{Error, Result};
use crate::field::{
    Break, Breaks, Condition, Enclosure, Fault, Field, Interpolation, Interval, Jet, Missed, Names, Table,
};
use crate::mesh::Point;

/// A number, a formula of x, y (m) and t (s), or a table of t times a formula of x and y.
#[derive(Debug, Clone, PartialEq)]
pub struct Given {
    /// The key that gives it, for messages.
    pub key: String,
    /// What is given.
    pub value: Value,
}

/// What a [`Given`] is.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number or a formula.
    Formula(Field),
    /// Measured over time.
    Table {
        /// The file, as the scene writes it.
        file: String,
        /// Where it was found.
        path: String,
        /// Between its rows.
        interpolation: Interpolation,
        /// Its values.
        table: Table,
        /// What they are multiplied by: a formula of x and y.
        shape: Field,
    },
}

impl Given {
    /// A number.
    pub fn constant(key: &str, value: f64) -> Given {
        Given { key: key.into(), value: Value::Formula(value.into()) }
    }

    /// The number, if it is one.
    pub fn number(&self) -> Option<f64> {
        match &self.value {
            Value::Formula(field) => field.constant(),
            Value::Table { .. } => None,
        }
    }

    /// Whether it is the number zero: as good as absent.
    pub fn is_zero(&self) -> bool {
        self.number() == Some(0.0)
    }

    /// Whether it may change with time.
    pub fn changes(&self) -> bool {
        match &self.value {
            Value::Formula(field) => field.depends_on(Names::T),
            Value::Table { .. } => true,
        }
    }

    /// Whether it is the same at all places.
    pub fn is_even(&self) -> bool {
        match &self.value {
            Value::Formula(field) => !field.depends_on(Names::XY),
            Value::Table { shape, .. } => !shape.depends_on(Names::XY),
        }
    }

    /// Its value at a place (m) and a time (s).
    ///
    /// # Errors
    /// [`Error::Scene`] naming the key where the formula has no finite value.
    pub fn at(&self, at: Point, t: f64) -> Result<f64> {
        match &self.value {
            Value::Formula(field) => field.value(at, t).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                Ok(table.value(t) * shape.value(at, t).map_err(|fault| self.fault(&fault))?)
            }
        }
    }

    /// Its value at a place (m) and its slopes along x and y; at time 0, if that matters.
    ///
    /// # Errors
    /// As [`Given::at`], and where the formula is not smooth.
    pub fn gradient(&self, at: Point) -> Result<[f64; 3]> {
        let of = |field: &Field| field.gradient(at, 0.0).map_err(|fault| self.fault(&fault));
        match &self.value {
            Value::Formula(field) => of(field),
            Value::Table { table, shape, .. } => Ok(of(shape)?.map(|value| table.value(0.0) * value)),
        }
    }

    /// Its values at a time (s), one a place (m).
    ///
    /// # Errors
    /// As [`Given::at`].
    pub fn values(&self, points: &[Point], t: f64, values: &mut [f64]) -> Result<()> {
        match &self.value {
            Value::Formula(field) => field.values(points, t, values).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                shape.values(points, t, values).map_err(|fault| self.fault(&fault))?;
                let factor = table.value(t);
                values.iter_mut().for_each(|value| *value *= factor);
                Ok(())
            }
        }
    }

    /// The value at a time (s) of what does not depend on the place, with its first two derivatives.
    ///
    /// # Errors
    /// As [`Given::at`], and where the formula is not smooth.
    pub fn jet(&self, t: f64) -> Result<Jet> {
        match &self.value {
            Value::Formula(field) => field.jet(Point::origin(), t).map_err(|fault| self.fault(&fault)),
            Value::Table { table, shape, .. } => {
                let scale = shape.value(Point::origin(), t).map_err(|fault| self.fault(&fault))?;
                let Jet { value, first, second } = table.jet(t);
                Ok(Jet { value: scale * value, first: scale * first, second: scale * second })
            }
        }
    }

    /// Its kinks and jumps at a place (m) up to an instant (s), found in at most so many looks: see [`Field::breaks`].
    pub fn breaks(&self, at: Point, end: f64, looks: usize) -> Breaks {
        match &self.value {
            Value::Formula(field) => field.breaks(at, 0.0, end, looks),
            Value::Table { table, .. } => table.breaks(0.0, end),
        }
    }

    /// Tells the first jump at a place (m) before the end, and the remedy; `None` without one. Sought in at most so many looks.
    pub fn jump(&self, at: Point, time: &Time, looks: usize) -> Option<String> {
        let breaks = self.breaks(at, time.end, looks);
        let Break { time: instant, jump, .. } = breaks.found.into_iter().find(|of| of.jump != 0.0)?;
        let place = if self.is_even() { String::new() } else { format!(" at ({}, {})", at.x, at.y) };
        let [jump, ramp] = [jump, 10.0 * time.step].map(|of| format!("{of:.5e}").parse().unwrap_or(of));
        Some(format!(
            "jumps by {jump:?} m at t = {instant:?} s{place}, which nothing rigid can do; expected no jump, as of a ramp over 10 \
             steps: {jump:?}*clamp((t - {instant:?})/{ramp:?}, 0, 1)"
        ))
    }

    /// Where steps from the start to the end see least of it, less a number, at a place (m): see [`Field::missed`].
    pub fn missed(&self, at: Point, less: f64, time: &Time) -> Option<Missed> {
        match &self.value {
            Value::Formula(field) => field.missed(at, less, time.step, time.steps()),
            Value::Table { table, shape, .. } => {
                let scale = shape.value(at, 0.0).ok()?;
                table.missed(less / scale, time.step, time.steps())
            }
        }
    }

    /// The terms g(t) h(x, y) whose sum it is, if it has such a form: pairs of g and h, each with the name of the key.
    pub fn terms(&self) -> Option<Vec<[Given; 2]>> {
        let part = |field| Given { key: self.key.clone(), value: Value::Formula(field) };
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

    /// Its formula of place, whose value at a time (s) a factor multiplies.
    fn place(&self, t: f64) -> (&Field, f64) {
        match &self.value {
            Value::Formula(field) => (field, 1.0),
            Value::Table { table, shape, .. } => (shape, table.value(t)),
        }
    }

    /// Whether it is a polynomial in x and y of so low a degree that a rule of degree 6 gives its load without error.
    pub fn is_low(&self) -> bool {
        self.place(0.0).0.degree().is_some_and(|degree| degree <= 3)
    }

    /// Whether it is a polynomial in x and y of any degree.
    pub fn is_polynomial(&self) -> bool {
        self.place(0.0).0.degree().is_some()
    }

    /// Bounds over the rectangle between two corners (m), between two times (s).
    pub fn enclose(&self, low: Point, high: Point, t: Interval) -> Enclosure {
        let (field, factor) = self.place(t.low);
        field.enclose(low, high, t).scaled(factor)
    }

    /// The field at a time (s), to be integrated over the plate.
    pub fn still(&self, t: f64) -> Still<'_> {
        Still { given: self, t }
    }

    /// The error of its formula.
    fn fault(&self, fault: &Fault) -> Error {
        Error::Scene(format!("{}: {fault}", self.key))
    }
}

/// A field at an instant.
#[derive(Debug, Clone, Copy)]
pub struct Still<'g> {
    given: &'g Given,
    t: f64,
}

impl Integrand for Still<'_> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        self.given.values(points, self.t, values)
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure {
        self.given.enclose(low, high, Interval::point(self.t))
    }

    fn side(&self, at: Point) -> u64 {
        self.given.place(self.t).0.side(at, self.t)
    }
}

/// The sum of some fields.
impl Integrand for Vec<Still<'_>> {
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()> {
        values.fill(0.0);
        let mut terms = vec![0.0; points.len()];
        for of in self {
            of.values(points, &mut terms)?;
            values.iter_mut().zip(&terms).for_each(|(sum, term)| *sum += term);
        }
        Ok(())
    }

    fn enclose(&self, low: Point, high: Point) -> Enclosure {
        let mut all = self.iter().map(|of| of.enclose(low, high));
        let first = all.next().unwrap_or(Enclosure::ZERO);
        all.fold(first, Enclosure::plus)
    }

    fn side(&self, at: Point) -> u64 {
        self.iter().fold(0, |side: u64, of| side.rotate_left(17) ^ of.side(at))
    }
}

/// Which part of the plate something concerns.
#[derive(Debug, Clone, PartialEq)]
pub enum Region {
    /// All of it.
    All,
    /// Where a condition on x and y holds.
    Where(Condition),
    /// The cells of a physical group.
    Group(String),
    /// One node.
    At([f64; 2]),
    /// The nodes of a physical point.
    Point(String),
    /// The nodes on a line from one point to another.
    Line([[f64; 2]; 2]),
}
