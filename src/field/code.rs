//! Postfix code of a formula: a flat list of instructions, run on a stack of any number type.

use std::ops::Range;

use super::names::Name;
use smallvec::SmallVec;

/// Number of points in [`Lanes`].
pub(super) const LANES: usize = 16;

/// Values of one number at several points.
pub(super) type Lanes = [f64; LANES];

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Instruction {
    Constant(f64),
    Variable(Name),
    Unary(Unary),
    Binary(Binary),
    /// Selects, from a condition and two values, the first value if the condition is true, else the
    /// second.
    Select,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unary {
    Negate,
    Not,
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Log10,
    Sqrt,
    Abs,
    Sign,
    Floor,
    Ceil,
    Round,
    Step,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Binary {
    Add,
    Subtract,
    Multiply,
    Divide,
    Power,
    Min,
    Max,
    Atan2,
    Hypot,
    Mod,
    Less,
    LessEqual,
    Greater,
    GreaterEqual,
    Equal,
    NotEqual,
    And,
    Or,
}

impl Instruction {
    /// Returns whether the value is a condition.
    pub fn is_condition(self) -> bool {
        match self {
            Instruction::Unary(op) => op == Unary::Not,
            Instruction::Binary(op) => matches!(
                op,
                Binary::Less
                    | Binary::LessEqual
                    | Binary::Greater
                    | Binary::GreaterEqual
                    | Binary::Equal
                    | Binary::NotEqual
                    | Binary::And
                    | Binary::Or
            ),
            _ => false,
        }
    }

    /// Returns the number of operands taken from the stack.
    pub fn arity(self) -> usize {
        match self {
            Instruction::Constant(_) | Instruction::Variable(_) => 0,
            Instruction::Unary(_) => 1,
            Instruction::Binary(_) => 2,
            Instruction::Select => 3,
        }
    }
}

/// Number type of the evaluation. A condition is 1 where it is true, and 0 where it is false.
pub(super) trait Number: Copy {
    fn constant(value: f64) -> Self;
    fn unary(self, op: Unary) -> Self;
    fn binary(self, op: Binary, right: Self) -> Self;
    /// Returns `yes` where the condition `self` is true, else `no`.
    fn select(self, yes: Self, no: Self) -> Self;
}

/// Returns a condition on two operands, NaN if one of them is; otherwise `sqrt(x) > 1` would be
/// false for a negative x.
fn truth(operands: [f64; 2], holds: bool) -> f64 {
    if operands.iter().any(|value| value.is_nan()) { f64::NAN } else { f64::from(holds) }
}

impl Number for f64 {
    fn constant(value: f64) -> Self {
        value
    }

    #[inline]
    fn unary(self, op: Unary) -> Self {
        match op {
            Unary::Negate => -self,
            Unary::Not => 1.0 - self,
            Unary::Sin => self.sin(),
            Unary::Cos => self.cos(),
            Unary::Tan => self.tan(),
            Unary::Asin => self.asin(),
            Unary::Acos => self.acos(),
            Unary::Atan => self.atan(),
            Unary::Sinh => self.sinh(),
            Unary::Cosh => self.cosh(),
            Unary::Tanh => self.tanh(),
            Unary::Exp => self.exp(),
            Unary::Ln => self.ln(),
            Unary::Log10 => self.log10(),
            Unary::Sqrt => self.sqrt(),
            Unary::Abs => self.abs(),
            Unary::Sign if self == 0.0 => 0.0,
            Unary::Sign => self.signum(),
            Unary::Floor => self.floor(),
            Unary::Ceil => self.ceil(),
            Unary::Round => self.round(),
            Unary::Step => truth([self, 0.0], self >= 0.0),
        }
    }

    #[inline]
    fn binary(self, op: Binary, right: Self) -> Self {
        let operands = [self, right];
        match op {
            Binary::Add => self + right,
            Binary::Subtract => self - right,
            Binary::Multiply => self * right,
            Binary::Divide => self / right,
            Binary::Power if right == 2.0 => self * self,
            Binary::Power => self.powf(right),
            Binary::Min if self.is_nan() || self < right => self,
            Binary::Max if self.is_nan() || self > right => self,
            Binary::Min | Binary::Max => right,
            Binary::Atan2 => self.atan2(right),
            Binary::Hypot => self.hypot(right),
            Binary::Mod => {
                let remainder = self % right;
                let is_across = remainder != 0.0 && (remainder < 0.0) != (right < 0.0);
                if is_across { remainder + right } else { remainder }
            }
            Binary::Less => truth(operands, self < right),
            Binary::LessEqual => truth(operands, self <= right),
            Binary::Greater => truth(operands, self > right),
            Binary::GreaterEqual => truth(operands, self >= right),
            Binary::Equal => truth(operands, self == right),
            Binary::NotEqual => truth(operands, self != right),
            // The right operand counts only where the left one leaves the result open: "x > 0 and
            // ln(x) < 1" has a value.
            Binary::And if self == 1.0 => right,
            Binary::Or if self == 0.0 => right,
            Binary::And | Binary::Or => self,
        }
    }

    #[inline]
    fn select(self, yes: Self, no: Self) -> Self {
        if self.is_nan() {
            self
        } else if self == 0.0 {
            no
        } else {
            yes
        }
    }
}

impl Number for Lanes {
    fn constant(value: f64) -> Self {
        [value; LANES]
    }

    #[inline]
    fn unary(self, op: Unary) -> Self {
        self.map(|value| value.unary(op))
    }

    #[inline]
    fn binary(self, op: Binary, right: Self) -> Self {
        std::array::from_fn(|i| self[i].binary(op, right[i]))
    }

    #[inline]
    fn select(self, yes: Self, no: Self) -> Self {
        std::array::from_fn(|i| self[i].select(yes[i], no[i]))
    }
}

/// Number with the index of the instruction at which it ceased to be finite.
#[derive(Clone, Copy)]
struct Traced {
    value: f64,
    culprit: Option<usize>,
}

impl Number for Traced {
    fn constant(value: f64) -> Self {
        Traced { value, culprit: None }
    }

    fn unary(self, op: Unary) -> Self {
        Traced { value: self.value.unary(op), ..self }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        Traced { value: self.value.binary(op, right.value), culprit: self.culprit.or(right.culprit) }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        let branch = if self.value == 0.0 { no } else { yes };
        Traced { value: self.value.select(yes.value, no.value), culprit: self.culprit.or(branch.culprit) }
    }
}

/// Condition on code that the parser and its checks guarantee.
const OPERANDS: &str = "every instruction finds its operands on the stack";

/// Operands of the instructions that follow, which need no allocation in formulas as people write
/// them.
pub(super) type Stack<T> = SmallVec<[T; 8]>;

/// Returns the value of code that leaves one value. The stack is work space; `done` receives the
/// result of every instruction.
#[inline]
fn trace<T: Number>(
    code: &[Instruction],
    stack: &mut Stack<T>,
    variable: impl Fn(Name) -> T,
    done: impl Fn(usize, &mut T),
) -> T {
    stack.clear();
    for (index, &instruction) in code.iter().enumerate() {
        let mut value = match instruction {
            Instruction::Constant(value) => T::constant(value),
            Instruction::Variable(name) => variable(name),
            Instruction::Unary(op) => operand(stack).unary(op),
            Instruction::Binary(op) => {
                let right = operand(stack);
                operand(stack).binary(op, right)
            }
            Instruction::Select => {
                let (no, yes) = (operand(stack), operand(stack));
                operand(stack).select(yes, no)
            }
        };
        done(index, &mut value);
        stack.push(value);
    }
    operand(stack)
}

fn operand<T>(stack: &mut Stack<T>) -> T {
    stack.pop().expect(OPERANDS)
}

/// Returns the value of code that leaves one value. The stack is work space.
#[inline]
pub(super) fn run<T: Number>(code: &[Instruction], stack: &mut Stack<T>, variable: impl Fn(Name) -> T) -> T {
    trace(code, stack, variable, |_, _| {})
}

/// Returns the first instruction with a value that is not finite and affects the result, if the
/// result is not finite.
pub(super) fn culprit(code: &[Instruction], variable: impl Fn(Name) -> f64) -> Option<(usize, f64)> {
    let blame = |index, number: &mut Traced| {
        number.culprit = (!number.value.is_finite()).then(|| number.culprit.unwrap_or(index));
    };
    let result = trace(code, &mut Stack::new(), |name| Traced::constant(variable(name)), blame);
    let index = result.culprit?;
    let start = starts(code)[index];
    Some((index, run(&code[start..=index], &mut Stack::new(), variable)))
}

pub(super) fn pop<T>(stack: &mut Vec<T>) -> T {
    stack.pop().expect(OPERANDS)
}

/// Returns, for each instruction, the start of the code of its value; operands precede the
/// instruction.
pub(super) fn starts(code: &[Instruction]) -> Vec<usize> {
    let mut stack = Vec::new();
    let start = |(index, instruction): (usize, &Instruction)| {
        let start = (0..instruction.arity()).fold(index, |_, _| pop(&mut stack));
        stack.push(start);
        start
    };
    code.iter().enumerate().map(start).collect()
}

/// Folds the constants: every part without variables is replaced by its value, with the spans kept.
/// Conditions stay, so that a constant is always a number.
pub(super) fn fold(code: Vec<(Instruction, Range<usize>)>) -> Vec<(Instruction, Range<usize>)> {
    let mut folded: Vec<(Instruction, Range<usize>)> = Vec::with_capacity(code.len());
    for (instruction, span) in code {
        let operands = folded.len() - instruction.arity();
        let is_constant = |(operand, _): &(Instruction, _)| matches!(operand, Instruction::Constant(_));
        let has_operands = operands < folded.len() && !instruction.is_condition();
        let folds = has_operands && folded[operands..].iter().all(is_constant);
        if !folds {
            folded.push((instruction, span));
            continue;
        }
        let mut part: Vec<Instruction> = folded.drain(operands..).map(|(operand, _)| operand).collect();
        part.push(instruction);
        let value = run(&part, &mut Stack::new(), |_| f64::NAN);
        folded.push((Instruction::Constant(value), span));
    }
    folded
}
