//! Decomposition of a formula into a sum of products of a function of time and a function of place.

use super::code::{Binary, Instruction, Unary, pop};
use super::names::Names;

/// Largest number of terms. A term costs a vector, and adding it at each step.
const MOST_TERMS: usize = 32;

/// Largest length of the code of all terms of a part; expanding products copies their factors.
const LONGEST: usize = 1 << 14;

type Code = Vec<Instruction>;

/// Product g(t) h(x, y), each factor by its code.
#[derive(Clone)]
pub(super) struct Product {
    pub time: Code,
    pub place: Code,
}

const ZERO: Instruction = Instruction::Constant(0.0);
const ONE: Instruction = Instruction::Constant(1.0);

impl Product {
    fn of_time(time: Code) -> Product {
        Product { time, place: vec![ONE] }
    }

    fn of_place(place: Code) -> Product {
        Product { time: vec![ONE], place }
    }

    /// Applies an operation to the factor of place, or to that of time if there is no other.
    fn map(mut self, op: Unary) -> Product {
        let factor = if self.place == [ONE] { &mut self.time } else { &mut self.place };
        factor.push(Instruction::Unary(op));
        self
    }

    /// Moves numbers that multiply or divide the factor of time, and its sign, to that of place, so
    /// that laws of time that differ in their amplitude alone become equal.
    fn with_bare_time(mut self) -> Product {
        while let Some((last, operands)) = self.time.split_last() {
            let (op, number, rest) = match (last, operands) {
                (Instruction::Unary(Unary::Negate), rest) => (Binary::Multiply, -1.0, rest),
                (
                    Instruction::Binary(op @ (Binary::Multiply | Binary::Divide)),
                    [rest @ .., Instruction::Constant(number)],
                ) => (*op, *number, rest),
                (Instruction::Binary(Binary::Multiply), [Instruction::Constant(number), rest @ ..])
                    if is_one_value(rest) =>
                {
                    (Binary::Multiply, *number, rest)
                }
                _ => break,
            };
            match op {
                Binary::Multiply if number == -1.0 && self.place != [ONE] => {
                    self.place.push(Instruction::Unary(Unary::Negate));
                }
                _ => self.place = apply(op, self.place, &[Instruction::Constant(number)]),
            }
            self.time = rest.to_vec();
        }
        self
    }

    fn combine(&self, other: &Product, op: Binary) -> Product {
        Product {
            time: apply(op, self.time.clone(), &other.time),
            place: apply(op, self.place.clone(), &other.place),
        }
    }
}

/// Returns whether code leaves one value and takes none from before it.
fn is_one_value(code: &[Instruction]) -> bool {
    let depth =
        code.iter().try_fold(0_usize, |depth, instruction| Some(depth.checked_sub(instruction.arity())? + 1));
    depth == Some(1)
}

/// Returns the code of `left op right`, without products by one.
fn apply(op: Binary, mut left: Code, right: &[Instruction]) -> Code {
    match op {
        Binary::Multiply if left == [ONE] => right.to_vec(),
        Binary::Multiply | Binary::Divide if right == [ONE] => left,
        _ => {
            left.extend_from_slice(right);
            left.push(Instruction::Binary(op));
            left
        }
    }
}

/// Part of the formula: its code if it depends on time alone or on place alone, otherwise its sum
/// of products.
struct Part {
    names: Names,
    code: Code,
    sum: Vec<Product>,
}

impl Part {
    /// Returns whether the part depends on time alone or on place alone.
    fn is_pure(&self) -> bool {
        !(self.names.meets(Names::T) && self.names.meets(Names::XY))
    }

    fn products(self) -> Vec<Product> {
        match self {
            part if !part.is_pure() => part.sum,
            part if part.names.meets(Names::T) => vec![Product::of_time(part.code)],
            part => vec![Product::of_place(part.code)],
        }
    }
}

/// Returns the products whose sum is the formula, if it has such a form: sums, products, quotients
/// by a single product, integer powers of one, `if` with a condition of time or of place, and the
/// sine and cosine of a sum (a travelling wave).
pub(super) fn separate(code: &[Instruction]) -> Option<Vec<Product>> {
    let mut stack: Vec<Part> = Vec::new();
    for &instruction in code {
        let operands = stack.split_off(stack.len() - instruction.arity());
        let names = match instruction {
            Instruction::Variable(name) => name.set(),
            _ => operands.iter().fold(Names::NONE, |names, part| names | part.names),
        };
        let mut part = Part { names, code: Vec::new(), sum: Vec::new() };
        if part.is_pure() {
            let mut operands = operands.into_iter().map(|operand| operand.code);
            part.code = operands.next().unwrap_or_default();
            operands.for_each(|operand| part.code.extend(operand));
            part.code.push(instruction);
        } else {
            part.sum = expand(instruction, operands)?;
        }
        stack.push(part);
    }
    Some(merge(pop(&mut stack).products().into_iter().map(Product::with_bare_time).collect()))
}

/// Returns the sum of products of a part that depends on both time and place.
fn expand(instruction: Instruction, operands: Vec<Part>) -> Option<Vec<Product>> {
    let mut operands = operands.into_iter();
    let first = operands.next()?;
    let sum = match instruction {
        Instruction::Unary(Unary::Negate) => negate(first.products()),
        Instruction::Unary(op @ (Unary::Sin | Unary::Cos)) => wave(op, first.products())?,
        Instruction::Binary(Binary::Add) => {
            let mut sum = first.products();
            sum.extend(operands.next()?.products());
            sum
        }
        Instruction::Binary(Binary::Subtract) => {
            let mut sum = first.products();
            sum.extend(negate(operands.next()?.products()));
            sum
        }
        Instruction::Binary(Binary::Multiply) => {
            let (left, right) = (first.products(), operands.next()?.products());
            if left.len() * right.len() > MOST_TERMS {
                return None;
            }
            left.iter().flat_map(|l| right.iter().map(|r| l.combine(r, Binary::Multiply))).collect()
        }
        Instruction::Binary(Binary::Divide) => {
            let (left, right) = (first.products(), operands.next()?.products());
            let [right] = &right[..] else { return None };
            left.iter().map(|left| left.combine(right, Binary::Divide)).collect()
        }
        Instruction::Binary(Binary::Power) => power(first.products(), &operands.next()?.code)?,
        Instruction::Select => select(first, operands.next()?, operands.next()?)?,
        _ => return None,
    };
    let length: usize = sum.iter().map(|product| product.time.len() + product.place.len()).sum();
    (sum.len() <= MOST_TERMS && length <= LONGEST).then_some(sum)
}

fn negate(sum: Vec<Product>) -> Vec<Product> {
    sum.into_iter().map(|product| product.map(Unary::Negate)).collect()
}

/// Expands sin(a + b) = sin a cos b + cos a sin b or cos(a + b) = cos a cos b - sin a sin b, with a
/// of time and b of place.
fn wave(op: Unary, argument: Vec<Product>) -> Option<Vec<Product>> {
    let argument = merge(argument);
    let (time, place) = match &argument[..] {
        [a, b] if a.place == [ONE] && b.time == [ONE] => (&a.time, &b.place),
        [b, a] if a.place == [ONE] && b.time == [ONE] => (&a.time, &b.place),
        _ => return None,
    };
    let unary = |code: &Code, op| [&code[..], &[Instruction::Unary(op)]].concat();
    let product = |in_time, in_place| Product { time: unary(time, in_time), place: unary(place, in_place) };
    Some(match op {
        Unary::Sin => vec![product(Unary::Sin, Unary::Cos), product(Unary::Cos, Unary::Sin)],
        _ => {
            let sines = product(Unary::Sin, Unary::Sin).map(Unary::Negate);
            vec![product(Unary::Cos, Unary::Cos), sines]
        }
    })
}

/// Expands (g h)^n = g^n h^n, which holds for integer n.
fn power(base: Vec<Product>, exponent: &[Instruction]) -> Option<Vec<Product>> {
    let ([base], [Instruction::Constant(n)]) = (&base[..], exponent) else { return None };
    let raise = |code: &Code| apply(Binary::Power, code.clone(), exponent);
    (n.fract() == 0.0).then(|| vec![Product { time: raise(&base.time), place: raise(&base.place) }])
}

/// Keeps each branch under its condition, so that a branch not selected is not computed.
fn select(condition: Part, yes: Part, no: Part) -> Option<Vec<Product>> {
    if !condition.is_pure() {
        return None;
    }
    let zero = vec![ZERO];
    let under = |mut product: Product, is_yes: bool| {
        let in_time = condition.names.meets(Names::T);
        let factor = if in_time { &mut product.time } else { &mut product.place };
        let (yes, no) = if is_yes { (&*factor, &zero) } else { (&zero, &*factor) };
        *factor = [&condition.code[..], yes, no, &[Instruction::Select]].concat();
        product
    };
    let branches = [(yes, true), (no, false)];
    let mut sum = Vec::new();
    for (branch, is_yes) in branches {
        let products = branch.products().into_iter().filter(|product| product.place != [ZERO]);
        sum.extend(products.map(|product| under(product, is_yes)));
    }
    Some(sum)
}

/// Merges products with the same factor of time, then those with the same factor of place: x + 2 x
/// t + y is (x + y) 1 + x (2 t).
fn merge(sum: Vec<Product>) -> Vec<Product> {
    let add = |left: &mut Code, right: Code| {
        left.extend(right);
        left.push(Instruction::Binary(Binary::Add));
    };
    let mut by_time: Vec<Product> = Vec::new();
    for product in sum {
        match by_time.iter_mut().find(|other| other.time == product.time) {
            Some(other) => add(&mut other.place, product.place),
            None => by_time.push(product),
        }
    }
    let mut merged: Vec<Product> = Vec::new();
    for product in by_time {
        match merged.iter_mut().find(|other| other.place == product.place) {
            Some(other) => add(&mut other.time, product.time),
            None => merged.push(product),
        }
    }
    merged
}
