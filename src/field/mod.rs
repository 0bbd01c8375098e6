//! Fields of a scene: numbers or formulas of x, y (m) and t (s), and tables of time.
//!
//! | | |
//! |---|---|
//! | operators, loosest first | `or`, `and`, `not`, `< <= > >= == !=`, `+ -`, `* /`, signs, `^` |
//! | functions | `sin cos tan asin acos atan atan2 sinh cosh tanh exp ln log10 sqrt abs sign floor ceil round step heaviside hypot pow mod min max clamp if` |
//! | constants | `pi`, `e`, and the [`Parameters`] of a scene |
//!
//! A power binds more tightly than a sign, and associates to the right: `-x^2` is `-(x^2)`, `2^3^2`
//! is `2^9`. A product needs its `*`: `2x` is an error, and `1e-3*x` a number times x. Angles are
//! in radians. `step(u)`, also called `heaviside`, is 1 from u = 0 on; `mod(u, v)` has the sign of
//! v; `round` rounds halves away from 0; `clamp(u, low, high)` limits u; in
//! `if(condition, yes, no)` only the selected branch must be finite. Conditions are no numbers:
//! `100*(x > 1)` is an error; write `100*step(x - 1)`. A formula has at most 65536 bytes and
//! 100 levels of nesting.
//!
//! The parser is written by hand because no crate reads all of this: exmex 0.21 takes -x^2 for
//! (-x)^2, 2^3^2 for (2^3)^2 and refuses 1e-3; evalexpr 13.1 takes 2^3^2 for (2^3)^2 and overflows
//! its stack on nested parentheses; fasteval 0.2 takes -x^2 for (-x)^2; meval 0.2 has no
//! conditions. None reports the column of an unknown name.
//!
//! ```
//! use rebond::field::{Field, Names};
//! use rebond::geometry::Point;
//!
//! let pressure = Field::parse("-100*sin(2*pi*50*t)*(1 - x)", Names::XYT)?;
//! let value = pressure.value(Point::new(0.25, 0.0), 0.005)?;
//! assert!((value + 75.0).abs() < 1e-12);
//!
//! // The load vector is integrated once and scaled at each step.
//! let terms = pressure.terms().expect("a product of time and place");
//! assert_eq!(terms.len(), 1);
//! assert!(!terms[0].place.depends_on(Names::T) && !terms[0].time.depends_on(Names::XY));
//!
//! let error = Field::parse("2*sine(x)", Names::XY).unwrap_err();
//! assert_eq!(error.to_string(), "column 3: sine is no function (did you mean sin?)");
//! # Ok::<(), rebond::field::ParseError>(())
//! ```

mod breaks;
mod code;
mod enclosure;
mod interval;
mod jet;
mod names;
mod parameters;
mod parse;
mod print;
mod sampling;
mod separate;
mod sided;
mod table;

use std::fmt::{self, Display};
use std::ops::Range;

use serde::{Serialize, Serializer};

use crate::error::cut;
use crate::geometry::Point;
pub use breaks::{Break, Breaks, MOST_LOOKS};
use code::{Binary, Instruction, LANES, Lanes, Number, Stack, Unary};
pub use enclosure::Enclosure;
pub use interval::{Interval, NOTHING};
pub use jet::Derivatives;
use names::Name;
pub use names::Names;
pub use parameters::Parameters;
use parse::Kind;
pub use parse::check_parameter;
pub use sampling::{Missed, WINDOW};
use sided::Sided;
pub use table::{Interpolation, Overshoot, Table};

/// Deflection w (m) of a plate for which none is given.
const FLAT: f64 = 0.0;

/// Error in a formula, with its position.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("column {column}: {wrong}")]
pub struct ParseError {
    /// Column in the formula, in characters, counted from 1.
    pub column: usize,
    /// Description of the error and of what was expected.
    pub wrong: String,
}

impl ParseError {
    fn new(text: &str, offset: usize, wrong: impl Into<String>) -> ParseError {
        ParseError { column: text[..offset].chars().count() + 1, wrong: wrong.into() }
    }
}

/// Compiled formula of some of x, y, t and w, displayed as it was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    text: String,
    code: Vec<Instruction>,
    /// Part of the text that each instruction computes.
    spans: Vec<Range<usize>>,
    names: Names,
}

/// Term g(t) h(x, y) of a sum.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// Factor g, of t alone.
    pub time: Field,
    /// Factor h, of x and y alone.
    pub place: Field,
}

impl Field {
    /// Parses a formula of these variables whose value is a number.
    pub fn parse(text: &str, names: Names) -> Result<Field, ParseError> {
        Field::parse_with(text, names, Parameters::NONE)
    }

    /// Works as [`Field::parse`], with parameters that the formula may use too.
    pub fn parse_with(text: &str, names: Names, parameters: &Parameters) -> Result<Field, ParseError> {
        Field::read(text, names, parameters, Kind::Number)
    }

    fn read(text: &str, names: Names, parameters: &Parameters, kind: Kind) -> Result<Field, ParseError> {
        let folded = code::fold(parse::parse(text, names, parameters, kind)?);
        for (instruction, span) in &folded {
            if let Instruction::Constant(value) = instruction
                && !value.is_finite()
            {
                let wrong = format!("{} is {value}; expected a finite number", cut(&text[span.clone()]));
                return Err(ParseError::new(text, span.start, wrong));
            }
        }
        let (code, spans): (Vec<_>, Vec<_>) = folded.into_iter().unzip();
        let names = code.iter().fold(Names::NONE, |names, instruction| match instruction {
            Instruction::Variable(name) => names | name.set(),
            _ => names,
        });
        Ok(Field { text: text.to_owned(), code, spans, names })
    }

    /// Returns the number, if the field is constant.
    pub fn constant(&self) -> Option<f64> {
        match self.code[..] {
            [Instruction::Constant(value)] => Some(value),
            _ => None,
        }
    }

    /// Returns the field whose clock starts at an instant (s) of this one.
    pub fn from_time(&self, start: f64) -> Field {
        let mut later = Field { code: Vec::new(), spans: Vec::new(), ..self.clone() };
        for (instruction, span) in self.code.iter().zip(&self.spans) {
            let shift = [Instruction::Constant(start), Instruction::Binary(Binary::Add)];
            let shift = if *instruction == Instruction::Variable(Name::T) { &shift[..] } else { &[] };
            for part in std::iter::once(instruction).chain(shift) {
                later.code.push(*part);
                later.spans.push(span.clone());
            }
        }
        later
    }

    /// Returns the field at an instant (s) as a function of x, y and the deflection (m), which
    /// takes the place of t.
    pub fn of_deflection(&self, t: f64) -> Field {
        let replaced = |instruction: &Instruction| match instruction {
            Instruction::Variable(Name::T) => Instruction::Constant(t),
            Instruction::Variable(Name::W) => Instruction::Variable(Name::T),
            other => *other,
        };
        // Parts of time alone become numbers, which all places and deflections share.
        let folded = code::fold(self.code.iter().map(replaced).zip(self.spans.clone()).collect());
        let (code, spans) = folded.into_iter().unzip();
        Field { code, names: Names::XYT, text: self.text.clone(), spans }
    }

    /// Returns whether the value may depend on any of these variables.
    pub fn depends_on(&self, names: Names) -> bool {
        self.names.meets(names)
    }

    /// Returns the value at a point (m) and a time (s). An error is returned where it is not
    /// finite.
    pub fn value(&self, point: Point, t: f64) -> Result<f64, ParseError> {
        self.finite(point, t, code::run(&self.code, &mut Stack::new(), variable(point, t)))
    }

    /// Computes the values at a time (s), one entry per point (m). Parts that do not depend on the
    /// place are computed once.
    pub fn values(&self, points: &[Point], t: f64, values: &mut [f64]) -> Result<(), ParseError> {
        if !self.depends_on(Names::XY) {
            if !points.is_empty() {
                values.fill(self.value(Point::origin(), t)?);
            }
            return Ok(());
        }
        let mut stack: Stack<Lanes> = Stack::new();
        for (points, values) in points.chunks(LANES).zip(values.chunks_mut(LANES)) {
            let last = points.len() - 1;
            let place = |axis: usize| std::array::from_fn(|lane| points[lane.min(last)][axis]);
            let (x, y) = (place(0), place(1));
            let lanes = code::run(&self.code, &mut stack, |name| match name {
                Name::X => x,
                Name::Y => y,
                Name::T => Lanes::constant(t),
                Name::W => Lanes::constant(FLAT),
            });
            for ((&point, value), lane) in points.iter().zip(values).zip(lanes) {
                *value = self.finite(point, t, lane)?;
            }
        }
        Ok(())
    }

    /// Returns bounds on the value over the rectangle between two corners (m) and between two times
    /// (s), and on its slopes along x, y and t.
    pub fn enclose(&self, low: Point, high: Point, t: Interval) -> Enclosure<3> {
        code::run(&self.code, &mut Stack::new(), |name| match name {
            Name::X => Enclosure::variable(0, low.x, high.x),
            Name::Y => Enclosure::variable(1, low.y, high.y),
            Name::T => Enclosure::variable(2, t.low, t.high),
            Name::W => Number::constant(FLAT),
        })
    }

    /// Returns a number that is equal for two points (m) at a time (s) where the formula takes the
    /// same branch at every condition, jump and kink.
    pub fn side(&self, point: Point, t: f64) -> u64 {
        code::run(&self.code, &mut Stack::new(), |name| Sided::constant(variable(point, t)(name))).side
    }

    /// Returns the degree in x and y, if the formula is a polynomial in these; its coefficients may
    /// depend on time.
    pub fn degree(&self) -> Option<u32> {
        let mut stack: Vec<Option<u32>> = Vec::new();
        let mut before = None;
        for &instruction in &self.code {
            let operands = stack.split_off(stack.len() - instruction.arity());
            let degrees: Option<Vec<u32>> = operands.iter().copied().collect();
            let is_free = degrees.as_ref().is_some_and(|degrees| degrees.iter().all(|degree| *degree == 0));
            stack.push(match (instruction, degrees.as_deref()) {
                (Instruction::Variable(Name::X | Name::Y), _) => Some(1),
                (_, Some(_)) if is_free => Some(0),
                (Instruction::Unary(Unary::Negate), Some(&[a])) => Some(a),
                (Instruction::Binary(Binary::Add | Binary::Subtract), Some(&[a, b])) => Some(a.max(b)),
                (Instruction::Binary(Binary::Multiply), Some(&[a, b])) => a.checked_add(b),
                (Instruction::Binary(Binary::Divide), Some(&[a, 0])) => Some(a),
                (Instruction::Binary(Binary::Power), Some(&[a, 0])) => match before {
                    Some(Instruction::Constant(n)) if n.fract() == 0.0 && (0.0..=100.0).contains(&n) => {
                        a.checked_mul(n as u32)
                    }
                    _ => None,
                },
                _ => None,
            });
            before = Some(instruction);
        }
        code::pop(&mut stack)
    }

    /// Returns the value and its first two time derivatives at a point (m) and a time (s). An error
    /// is returned where the first is not finite.
    ///
    /// At a kink of `abs`, `min` or `max` the derivatives are those just after it. At any other
    /// kink and at a jump they are those of the side that the value belongs to: those of `step(t)`
    /// are 0 everywhere.
    pub fn jet(&self, point: Point, t: f64) -> Result<Derivatives, ParseError> {
        let jet = code::run(&self.code, &mut Stack::new(), |name| match name {
            Name::T => Derivatives::moving(t),
            place => Derivatives::constant(variable(point, t)(place)),
        });
        self.finite(point, t, jet.value)?;
        if jet.first.is_finite() {
            return Ok(jet);
        }
        let wrong = format!("no velocity{}; expected a smooth formula", self.describe(point, t));
        Err(ParseError::new(&self.text, 0, wrong))
    }

    /// Returns the value and its derivatives along x and y at a point (m) and a time (s).
    ///
    /// At a jump or a kink the derivatives are those of the side that the value belongs to.
    pub fn gradient(&self, point: Point, t: f64) -> Result<[f64; 3], ParseError> {
        let value = self.value(point, t)?;
        let mut stack = Stack::new();
        let mut along = |axis: Name| {
            let jet = code::run(&self.code, &mut stack, |name| match variable(point, t)(name) {
                value if name == axis => Derivatives::moving(value),
                value => Derivatives::constant(value),
            });
            if jet.first.is_finite() {
                return Ok(jet.first);
            }
            let wrong = format!("no slope along {}{}", axis.word(), self.describe(point, t));
            Err(ParseError::new(&self.text, 0, format!("{wrong}; expected a smooth formula")))
        };
        Ok([value, along(Name::X)?, along(Name::Y)?])
    }

    /// Returns the terms whose sum is the field, or `None` where no such sum is found and the field
    /// must be evaluated anew at each instant.
    ///
    /// The method covers sums, products, quotients, integer powers and `if` of parts that depend on
    /// time or on place, and the sine and cosine of a sum of both, as in a travelling wave. The
    /// terms agree with the field to rounding.
    pub fn terms(&self) -> Option<Vec<Term>> {
        let field = |code: Vec<Instruction>, names| Field::parse(&print::print(&code), names).ok();
        let term = |product: separate::Product| {
            Some(Term { time: field(product.time, Names::T)?, place: field(product.place, Names::XY)? })
        };
        separate::separate(&self.code)?.into_iter().map(term).collect()
    }

    /// Returns a text that is equal for formulas that compute the same in the same way.
    pub fn canonical(&self) -> String {
        print::print(&self.code)
    }

    fn finite(&self, point: Point, t: f64, value: f64) -> Result<f64, ParseError> {
        if value.is_finite() {
            return Ok(value);
        }
        let (index, value) =
            code::culprit(&self.code, variable(point, t)).unwrap_or((self.code.len() - 1, value));
        let span = &self.spans[index];
        let part = cut(&self.text[span.clone()]);
        let wrong = format!("{part} is {value}{}; expected a finite number", self.describe(point, t));
        Err(ParseError::new(&self.text, span.start, wrong))
    }

    /// Returns the text ` at x = 0.5, t = 2.0` with the variables that the formula depends on.
    fn describe(&self, point: Point, t: f64) -> String {
        let name = |name: Name| format!("{} = {:?}", name.word(), variable(point, t)(name));
        let names: Vec<String> = self.names.iter().map(name).collect();
        format!(" at {}", names.join(", "))
    }
}

fn variable(point: Point, t: f64) -> impl Fn(Name) -> f64 + Copy {
    move |name| match name {
        Name::X => point.x,
        Name::Y => point.y,
        Name::T => t,
        Name::W => FLAT,
    }
}

impl From<f64> for Field {
    /// Converts a constant, which must be finite; zero has no sign.
    fn from(value: f64) -> Field {
        let value = value + 0.0;
        let text = format!("{value:?}");
        let span = 0..text.len();
        Field { text, code: vec![Instruction::Constant(value)], spans: vec![span], names: Names::NONE }
    }
}

impl Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Serialize for Field {
    /// Serialises the field as a scene writes it: a number, or the text of a formula.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.text.trim().parse::<f64>() {
            Ok(value) => serializer.serialize_f64(value),
            Err(_) => serializer.serialize_str(&self.text),
        }
    }
}

/// Compiled condition, such as `x > 0.5 and y < 0.2`, displayed as it was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition(Field);

impl Condition {
    /// Parses a condition on these variables and parameters.
    pub fn parse(text: &str, names: Names, parameters: &Parameters) -> Result<Condition, ParseError> {
        Field::read(text, names, parameters, Kind::Condition).map(Condition)
    }

    /// Returns whether the condition holds at a point (m) and a time (s). An error is returned
    /// where an operand has no value.
    pub fn holds(&self, point: Point, t: f64) -> Result<bool, ParseError> {
        Ok(self.0.value(point, t)? != 0.0)
    }
}

impl Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Serialize for Condition {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.0.serialize(serializer)
    }
}
