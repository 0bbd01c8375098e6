//! Conversion of postfix code back to a formula.

use super::code::{Instruction, Unary, pop};
use super::parse::{FUNCTIONS, Function, INFIX, binding};

/// Text of a part, with the binding powers of its outermost operator on either side.
struct Part {
    text: String,
    left: u8,
    right: u8,
}

impl Part {
    /// Returns a part that never needs parentheses.
    fn atom(text: String) -> Part {
        Part { text, left: u8::MAX, right: u8::MAX }
    }

    fn prefix(symbol: &str, strength: u8, operand: Part) -> Part {
        let text = format!("{symbol}{}", operand.bracket(|operand| operand.left < strength));
        Part { text, left: strength, right: strength }
    }

    fn infix(left: Part, symbol: &str, (before, after): (u8, u8), right: Part) -> Part {
        let mut text = left.bracket(|left| left.right <= before);
        text.push_str(&format!(" {symbol} {}", right.bracket(|right| right.left < after)));
        Part { text, left: before, right: after }
    }

    fn call(instruction: Instruction, arguments: &[Part]) -> Part {
        let calls = |function: &Function| match (function, instruction) {
            (Function::Unary(op), Instruction::Unary(other)) => *op == other,
            (Function::Binary(op) | Function::Fold(op), Instruction::Binary(other)) => *op == other,
            (Function::If, Instruction::Select) => true,
            _ => false,
        };
        let name = FUNCTIONS.iter().find(|(_, function)| calls(function)).map_or("", |(name, _)| name);
        let arguments: Vec<&str> = arguments.iter().map(|argument| argument.text.as_str()).collect();
        Part::atom(format!("{name}({})", arguments.join(", ")))
    }

    fn bracket(self, is_needed: impl Fn(&Part) -> bool) -> String {
        if is_needed(&self) { format!("({})", self.text) } else { self.text }
    }
}

/// Returns a formula with this code, with no more parentheses than necessary.
pub(super) fn print(code: &[Instruction]) -> String {
    let mut stack = Vec::new();
    for &instruction in code {
        let part = match instruction {
            Instruction::Constant(value) if value.is_sign_negative() => {
                Part::prefix("-", binding::SIGN, Part::atom(format!("{:?}", -value)))
            }
            Instruction::Constant(value) => Part::atom(format!("{value:?}")),
            Instruction::Variable(name) => Part::atom(name.word().to_owned()),
            Instruction::Unary(Unary::Negate) => Part::prefix("-", binding::SIGN, pop(&mut stack)),
            Instruction::Unary(Unary::Not) => Part::prefix("not ", binding::NOT, pop(&mut stack)),
            Instruction::Unary(_) => Part::call(instruction, &[pop(&mut stack)]),
            Instruction::Binary(op) => {
                let (right, left) = (pop(&mut stack), pop(&mut stack));
                match INFIX.iter().find(|(_, infix, _)| *infix == op) {
                    Some((symbol, _, binding)) => Part::infix(left, symbol, *binding, right),
                    None => Part::call(instruction, &[left, right]),
                }
            }
            Instruction::Select => {
                let (no, yes, condition) = (pop(&mut stack), pop(&mut stack), pop(&mut stack));
                Part::call(instruction, &[condition, yes, no])
            }
        };
        stack.push(part);
    }
    pop(&mut stack).text
}
