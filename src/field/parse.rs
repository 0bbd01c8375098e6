//! Pratt parser from the text of a formula to postfix code; every error has its column.

use std::ops::Range;

use super::ParseError;
use super::code::{Binary, Instruction, Unary};
use super::names::{Name, Names};
use super::parameters::Parameters;
use crate::error::{cut, suggestion};

/// Largest length of a formula, in bytes.
const LONGEST: usize = 1 << 16;

/// Largest depth of nested parentheses, functions, signs and powers.
const DEEPEST: usize = 100;

/// Instructions, each with the part of the text that it computes.
pub(super) type Spanned = Vec<(Instruction, Range<usize>)>;

/// Kind of the value of a formula or of a part of it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Number,
    Condition,
}

impl Kind {
    fn words(self) -> &'static str {
        match self {
            Kind::Number => "a number",
            Kind::Condition => "a condition",
        }
    }

    fn example(self) -> &'static str {
        match self {
            Kind::Number => "such as if(x > 0.5, 1, 0)",
            Kind::Condition => "such as x > 0.5",
        }
    }
}

/// Meaning of a name before parentheses.
#[derive(Clone, Copy)]
pub(super) enum Function {
    Unary(Unary),
    Binary(Binary),
    /// Function of two arguments or more, applied pairwise from the left.
    Fold(Binary),
    /// Function `clamp(u, low, high)`.
    Clamp,
    /// Function `if(condition, yes, no)`.
    If,
}

/// Table of functions. `step` is 1 from 0 on; `mod` has the sign of its second argument; `round`
/// rounds halves away from 0.
pub(super) const FUNCTIONS: [(&str, Function); 28] = [
    ("sin", Function::Unary(Unary::Sin)),
    ("cos", Function::Unary(Unary::Cos)),
    ("tan", Function::Unary(Unary::Tan)),
    ("asin", Function::Unary(Unary::Asin)),
    ("acos", Function::Unary(Unary::Acos)),
    ("atan", Function::Unary(Unary::Atan)),
    ("atan2", Function::Binary(Binary::Atan2)),
    ("sinh", Function::Unary(Unary::Sinh)),
    ("cosh", Function::Unary(Unary::Cosh)),
    ("tanh", Function::Unary(Unary::Tanh)),
    ("exp", Function::Unary(Unary::Exp)),
    ("ln", Function::Unary(Unary::Ln)),
    ("log10", Function::Unary(Unary::Log10)),
    ("sqrt", Function::Unary(Unary::Sqrt)),
    ("abs", Function::Unary(Unary::Abs)),
    ("sign", Function::Unary(Unary::Sign)),
    ("floor", Function::Unary(Unary::Floor)),
    ("ceil", Function::Unary(Unary::Ceil)),
    ("round", Function::Unary(Unary::Round)),
    ("step", Function::Unary(Unary::Step)),
    ("heaviside", Function::Unary(Unary::Step)),
    ("hypot", Function::Binary(Binary::Hypot)),
    ("pow", Function::Binary(Binary::Power)),
    ("mod", Function::Binary(Binary::Mod)),
    ("min", Function::Fold(Binary::Min)),
    ("max", Function::Fold(Binary::Max)),
    ("clamp", Function::Clamp),
    ("if", Function::If),
];

/// Units that stand in formulas by mistake.
const UNITS: [&str; 22] = [
    "Pa", "kPa", "MPa", "GPa", "bar", "Hz", "kHz", "rpm", "N", "kN", "m", "cm", "mm", "um", "s", "ms", "us",
    "deg", "rad", "g", "kg", "J",
];

/// Hint at the units that a user writes behind numbers.
const NO_UNITS: &str = "; a formula has no units, its key has one";

/// Constants by name.
const CONSTANTS: [(&str, f64); 2] = [("pi", std::f64::consts::PI), ("e", std::f64::consts::E)];

/// Binding powers of operators: to the left, and the least accepted to the right.
pub(super) mod binding {
    pub const OR: (u8, u8) = (1, 2);
    pub const AND: (u8, u8) = (3, 4);
    pub const NOT: u8 = 5;
    pub const COMPARISON: (u8, u8) = (6, 7);
    pub const SUM: (u8, u8) = (8, 9);
    pub const PRODUCT: (u8, u8) = (10, 11);
    pub const SIGN: u8 = 12;
    /// Associates to the right: 2^3^2 is 2^9.
    pub const POWER: (u8, u8) = (14, 13);
}

/// Infix operators with their binding powers.
pub(super) const INFIX: [(&str, Binary, (u8, u8)); 13] = [
    ("or", Binary::Or, binding::OR),
    ("and", Binary::And, binding::AND),
    ("<", Binary::Less, binding::COMPARISON),
    ("<=", Binary::LessEqual, binding::COMPARISON),
    (">", Binary::Greater, binding::COMPARISON),
    (">=", Binary::GreaterEqual, binding::COMPARISON),
    ("==", Binary::Equal, binding::COMPARISON),
    ("!=", Binary::NotEqual, binding::COMPARISON),
    ("+", Binary::Add, binding::SUM),
    ("-", Binary::Subtract, binding::SUM),
    ("*", Binary::Multiply, binding::PRODUCT),
    ("/", Binary::Divide, binding::PRODUCT),
    ("^", Binary::Power, binding::POWER),
];

/// Spellings of other notations, with those of a formula.
const FOREIGN: [(&str, &str); 17] = [
    ("**", "^"),
    ("&&", "and"),
    ("&", "and"),
    ("||", "or"),
    ("|", "or"),
    ("!", "not"),
    ("=", "=="),
    ("%", "mod(a, b)"),
    ("\u{2212}", "-"),
    ("\u{2013}", "-"),
    ("×", "*"),
    ("·", "*"),
    ("÷", "/"),
    ("≤", "<="),
    ("≥", ">="),
    ("≠", "!="),
    ("²", "^2"),
];

#[derive(Clone, Copy, PartialEq)]
enum Token<'a> {
    Number(f64),
    Word(&'a str),
    Symbol(&'static str),
    End,
}

struct Parser<'a> {
    text: &'a str,
    names: Names,
    parameters: &'a Parameters,
    /// Next token and its position.
    token: Token<'a>,
    span: Range<usize>,
    /// End of the previous token.
    end: usize,
    depth: usize,
    code: Spanned,
}

/// Parsed part: its kind, and where it starts.
#[derive(Clone, Copy)]
struct Part {
    kind: Kind,
    start: usize,
}

/// Returns the code of a formula of these variables and parameters, without constant folding.
pub(super) fn parse(
    text: &str,
    names: Names,
    parameters: &Parameters,
    kind: Kind,
) -> Result<Spanned, ParseError> {
    if text.len() > LONGEST {
        let wrong = format!("{} bytes are too many; expected at most {LONGEST}", text.len());
        return Err(ParseError::new(text, 0, wrong));
    }
    let mut parser =
        Parser { text, names, parameters, token: Token::End, span: 0..0, end: 0, depth: 0, code: Vec::new() };
    parser.advance()?;
    let part = parser.expression(0)?;
    parser.expect_end()?;
    parser.check(part, kind)?;
    Ok(parser.code)
}

impl<'a> Parser<'a> {
    fn fault<T>(&self, offset: usize, wrong: impl Into<String>) -> Result<T, ParseError> {
        Err(ParseError::new(self.text, offset, wrong))
    }

    /// Reads the next token.
    fn advance(&mut self) -> Result<(), ParseError> {
        self.end = self.span.end;
        let rest = self.text[self.end..].trim_start();
        let start = self.text.len() - rest.len();
        let Some(first) = rest.chars().next() else {
            (self.token, self.span) = (Token::End, start..start);
            return Ok(());
        };
        let length = if first.is_ascii_digit() || first == '.' {
            let length = number_length(rest);
            self.token = Token::Number(self.number(start, &rest[..length])?);
            length
        } else if first.is_alphabetic() || first == '_' {
            let is_part = |c: char| c.is_alphabetic() || c.is_ascii_digit() || c == '_';
            let length = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
            self.token = Token::Word(&rest[..length]);
            length
        } else {
            let symbol = self.symbol(start, rest)?;
            self.token = Token::Symbol(symbol);
            symbol.len()
        };
        self.span = start..start + length;
        Ok(())
    }

    fn number(&self, start: usize, digits: &str) -> Result<f64, ParseError> {
        match digits.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(value),
            Ok(_) => self.fault(start, format!("{} is too large for a number", cut(digits))),
            Err(_) => self.fault(start, format!("{} is not a number", cut(digits))),
        }
    }

    fn symbol(&self, start: usize, rest: &str) -> Result<&'static str, ParseError> {
        let symbols = INFIX.iter().map(|(symbol, ..)| *symbol).chain(["(", ")", ","]);
        let longest = |symbol: &&str| symbol.len();
        let symbol = symbols.filter(|symbol| rest.starts_with(symbol)).max_by_key(longest);
        let foreign = FOREIGN.iter().filter(|(symbol, _)| rest.starts_with(symbol)).max_by_key(|f| f.0.len());
        match (symbol, foreign) {
            (Some(symbol), Some((foreign, _))) if symbol.len() >= foreign.len() => Ok(symbol),
            (Some(symbol), None) => Ok(symbol),
            (_, Some((symbol, meant))) => self.fault(start, format!("found {symbol}; write {meant}")),
            (None, None) => {
                let wrong = rest.chars().next().unwrap_or_default();
                self.fault(start, format!("{wrong:?} has no meaning in a formula"))
            }
        }
    }

    /// Parses an expression whose operators bind at least as strongly as `least`.
    fn expression(&mut self, least: u8) -> Result<Part, ParseError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            return self
                .fault(self.span.start, format!("nested too deep; expected at most {DEEPEST} levels"));
        }
        let mut left = self.primary()?;
        while let Some((symbol, op, binding)) = self.infix().filter(|(.., (left, _))| *left >= least) {
            let offset = self.span.start;
            self.advance()?;
            let right = self.expression(binding.1)?;
            left = self.combine(left, symbol, op, offset, right)?;
        }
        self.depth -= 1;
        Ok(left)
    }

    fn infix(&self) -> Option<(&'static str, Binary, (u8, u8))> {
        let (Token::Word(written) | Token::Symbol(written)) = self.token else { return None };
        INFIX.into_iter().find(|(symbol, ..)| *symbol == written)
    }

    fn combine(
        &mut self,
        left: Part,
        symbol: &str,
        op: Binary,
        offset: usize,
        right: Part,
    ) -> Result<Part, ParseError> {
        let instruction = Instruction::Binary(op);
        let kind = if instruction.is_condition() { Kind::Condition } else { Kind::Number };
        let operand = if matches!(op, Binary::And | Binary::Or) { Kind::Condition } else { Kind::Number };
        if kind != operand && left.kind == Kind::Condition {
            return self.fault(offset, format!("{symbol} after a comparison; write a < b and b < c"));
        }
        self.check(left, operand)?;
        self.check(right, operand)?;
        Ok(self.emit(instruction, left.start, kind))
    }

    /// Parses a number, a name, a call, parentheses, or one of them after a sign or `not`.
    fn primary(&mut self) -> Result<Part, ParseError> {
        let start = self.span.start;
        match self.token {
            Token::Number(value) => {
                self.advance()?;
                Ok(self.emit(Instruction::Constant(value), start, Kind::Number))
            }
            Token::Word("not") => {
                self.advance()?;
                let part = self.expression(binding::NOT)?;
                self.check(part, Kind::Condition)?;
                Ok(self.emit(Instruction::Unary(Unary::Not), start, Kind::Condition))
            }
            Token::Word(word) if self.infix().is_none() => {
                self.advance()?;
                if self.token == Token::Symbol("(") { self.call(word, start) } else { self.name(word, start) }
            }
            Token::Symbol(sign @ ("-" | "+")) => {
                self.advance()?;
                let part = self.expression(binding::SIGN)?;
                self.check(part, Kind::Number)?;
                if sign == "-" {
                    self.emit(Instruction::Unary(Unary::Negate), start, Kind::Number);
                }
                Ok(Part { kind: Kind::Number, start })
            }
            Token::Symbol("(") => {
                self.advance()?;
                let part = self.expression(0)?;
                self.close(start)?;
                Ok(Part { start, ..part })
            }
            Token::End => self.fault(start, "the formula ends; expected a number, a name or ("),
            Token::Word(word) | Token::Symbol(word) => {
                self.fault(start, format!("found {word}; expected a number, a name or ("))
            }
        }
    }

    fn name(&mut self, word: &str, start: usize) -> Result<Part, ParseError> {
        if let Some((_, value)) = CONSTANTS.iter().find(|(name, _)| *name == word) {
            return Ok(self.emit(Instruction::Constant(*value), start, Kind::Number));
        }
        // A parameter hides the deflection.
        if let Some(value) = self.parameters.get(word) {
            return Ok(self.emit(Instruction::Constant(value), start, Kind::Number));
        }
        if let Some(name) = self.names.iter().find(|name| name.word() == word) {
            return Ok(self.emit(Instruction::Variable(name), start, Kind::Number));
        }
        if FUNCTIONS.iter().any(|(name, _)| *name == word) {
            return self.fault(start, format!("{word} is a function; expected ( after it"));
        }
        let expected = self.values();
        let (others, last) = expected.split_at(expected.len() - 1);
        let expected = format!("expected {} or {}", others.join(", "), last[0]);
        if Name::ALL.iter().any(|name| name.word() == word) {
            return self.fault(start, format!("{word} is not known here; {expected}"));
        }
        let hint = if self.is_unit(word) { NO_UNITS.to_owned() } else { self.hint(word) };
        self.fault(start, format!("{} is not known; {expected}, or a function{hint}", cut(word)))
    }

    /// Parses a function call after its name, at the parenthesis.
    fn call(&mut self, word: &str, start: usize) -> Result<Part, ParseError> {
        let Some((_, function)) = FUNCTIONS.iter().find(|(name, _)| *name == word) else {
            let is_value = self.values().contains(&word) || Name::ALL.iter().any(|name| name.word() == word);
            let wrong = match is_value {
                true => "is no function; a product is written with *".to_owned(),
                false => format!("is no function{}", self.hint(word)),
            };
            return self.fault(start, format!("{} {wrong}", cut(word)));
        };
        let open = self.span.start;
        self.advance()?;
        let mut count = 0;
        loop {
            if count == 0 && self.token == Token::Symbol(")") {
                break;
            }
            let argument = self.expression(0)?;
            count += 1;
            let is_condition = matches!((function, count), (Function::If, 1));
            self.check(argument, if is_condition { Kind::Condition } else { Kind::Number })?;
            match (function, count) {
                (Function::Fold(op), 2..) => {
                    self.emit(Instruction::Binary(*op), start, Kind::Number);
                }
                (Function::Clamp, 2) => {
                    self.emit(Instruction::Binary(Binary::Max), start, Kind::Number);
                }
                _ => {}
            }
            if self.token != Token::Symbol(",") {
                break;
            }
            self.advance()?;
        }
        self.close(open)?;
        let (arity, last) = match function {
            Function::Unary(op) => ("1 argument", (count == 1).then_some(Some(Instruction::Unary(*op)))),
            Function::Binary(op) => ("2 arguments", (count == 2).then_some(Some(Instruction::Binary(*op)))),
            Function::Fold(_) => ("at least 2 arguments", (count >= 2).then_some(None)),
            Function::Clamp => {
                let last = Instruction::Binary(Binary::Min);
                ("3 arguments (u, low, high)", (count == 3).then_some(Some(last)))
            }
            Function::If => {
                ("3 arguments (condition, yes, no)", (count == 3).then_some(Some(Instruction::Select)))
            }
        };
        match last {
            None => self.fault(start, format!("{word} takes {arity}; found {count}")),
            Some(None) => {
                if let Some((_, span)) = self.code.last_mut() {
                    span.end = self.end;
                }
                Ok(Part { kind: Kind::Number, start })
            }
            Some(Some(last)) => Ok(self.emit(last, start, Kind::Number)),
        }
    }

    /// Parses the closing parenthesis of the one at `open`.
    fn close(&mut self, open: usize) -> Result<(), ParseError> {
        match self.token {
            Token::Symbol(")") => self.advance(),
            Token::End => self.fault(open, "this ( is never closed; expected )"),
            _ => self.expect_operator("an operator, a comma or )"),
        }
    }

    fn expect_end(&self) -> Result<(), ParseError> {
        match self.token {
            Token::End => Ok(()),
            Token::Symbol(")") => self.fault(self.span.start, "this ) closes nothing"),
            _ => self.expect_operator("an operator or the end"),
        }
    }

    /// Returns the error for a token after a complete part.
    fn expect_operator(&self, expected: &str) -> Result<(), ParseError> {
        let token = cut(&self.text[self.span.clone()]);
        let hint = match self.token {
            Token::Symbol(",") => "; a decimal point is written .",
            _ if self.is_unit(&self.text[self.span.clone()]) => NO_UNITS,
            Token::Symbol(_) if self.infix().is_some() => "",
            _ => "; a product is written with *",
        };
        self.fault(self.span.start, format!("found {token}; expected {expected}{hint}"))
    }

    fn check(&self, part: Part, kind: Kind) -> Result<(), ParseError> {
        if part.kind == kind {
            return Ok(());
        }
        let words = part.kind.words();
        self.fault(part.start, format!("found {words}; expected {}, {}", kind.words(), kind.example()))
    }

    fn hint(&self, word: &str) -> String {
        if word == "log" {
            return " (did you mean ln or log10?)".to_owned();
        }
        let names = [self.values(), FUNCTIONS.map(|(name, _)| name).to_vec()].concat();
        suggestion(word, &names)
    }

    /// Returns whether a word is a unit, and no name of this formula.
    fn is_unit(&self, word: &str) -> bool {
        UNITS.contains(&word) && !self.values().contains(&word)
    }

    /// Returns the names of variables, parameters and constants.
    fn values(&self) -> Vec<&str> {
        let mut names: Vec<&str> = self.names.iter().map(Name::word).collect();
        names.extend(self.parameters.names());
        names.extend(CONSTANTS.map(|(name, _)| name));
        names
    }

    fn emit(&mut self, instruction: Instruction, start: usize, kind: Kind) -> Part {
        self.code.push((instruction, start..self.end));
        Part { kind, start }
    }
}

/// Returns the length of the number at the start of the text: digits, one point, and an exponent if
/// it has digits.
fn number_length(text: &str) -> usize {
    let bytes = text.as_bytes();
    let digits = |from: usize| bytes[from..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    let mut length = digits(0);
    if bytes.get(length) == Some(&b'.') {
        length += 1;
        length += digits(length);
    }
    if matches!(bytes.get(length), Some(b'e' | b'E')) {
        let sign = usize::from(matches!(bytes.get(length + 1), Some(b'+' | b'-')));
        let exponent = digits((length + 1 + sign).min(bytes.len()));
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    length
}

/// Refuses names of parameters that a formula would read as something else, in words.
///
/// # Errors
/// Returns the reason and what was expected.
pub fn check_parameter(name: &str) -> Result<(), String> {
    let starts = name.starts_with(|c: char| c.is_alphabetic() || c == '_');
    if !starts || !name.chars().all(|c| c.is_alphabetic() || c.is_ascii_digit() || c == '_') {
        return Err("expected a name of letters, digits and _ that does not begin with a digit".into());
    }
    let mut variables = Name::ALL.into_iter().filter(|variable| *variable != Name::W);
    let taken = if variables.any(|variable| variable.word() == name) {
        "a variable of formulas"
    } else if CONSTANTS.iter().any(|(constant, _)| *constant == name) {
        "a constant of formulas"
    } else if FUNCTIONS.iter().any(|(function, _)| *function == name) {
        "a function of formulas"
    } else if name == "not" || INFIX.iter().any(|(operator, ..)| *operator == name) {
        "an operator of formulas"
    } else {
        return Ok(());
    };
    Err(format!("{name} is {taken}; expected another name"))
}
