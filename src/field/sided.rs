//! Record of the branches that a formula takes at its jumps and kinks.

use super::code::{Binary, Instruction, Number, Unary};
use crate::hash;

/// Number with a record of the branch taken at every jump and kink.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sided {
    value: f64,
    pub side: u64,
}

impl Sided {
    /// Records one more branch, by a number of its own (FNV-1a hash).
    fn choose(self, value: f64, choice: f64) -> Sided {
        Sided { value, side: hash::extend(self.side, choice.to_bits()) }
    }

    fn mix(self, other: Sided) -> u64 {
        if other.side == 0 { self.side } else { self.side.rotate_left(17) ^ other.side }
    }
}

impl Number for Sided {
    fn constant(value: f64) -> Self {
        Sided { value, side: 0 }
    }

    fn unary(self, op: Unary) -> Self {
        let value = self.value.unary(op);
        match op {
            Unary::Abs => self.choose(value, f64::from(self.value.is_sign_negative())),
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Step => {
                self.choose(value, value)
            }
            // Only the outcome of a condition counts.
            Unary::Not => Sided { value, side: 0 },
            _ => Sided { value, ..self },
        }
    }

    fn binary(self, op: Binary, right: Self) -> Self {
        let value = self.value.binary(op, right.value);
        let both = Sided { value, side: self.mix(right) };
        match op {
            Binary::Min => if self.value < right.value { self } else { right }
                .choose(value, f64::from(self.value < right.value)),
            Binary::Max => if self.value > right.value { self } else { right }
                .choose(value, f64::from(self.value > right.value)),
            Binary::Mod => both.choose(value, (self.value / right.value).floor()),
            Binary::Atan2 if right.value < 0.0 => {
                both.choose(value, f64::from(self.value.is_sign_negative()))
            }
            _ if Instruction::Binary(op).is_condition() => Sided { value, side: 0 },
            _ => both,
        }
    }

    fn select(self, yes: Self, no: Self) -> Self {
        let branch = if self.value == 0.0 { no } else { yes };
        branch.choose(self.value.select(yes.value, no.value), f64::from(self.value != 0.0))
    }
}
