//! Conditions on the lanes of the processor's registers.
//!
//! The compiler turns a choice between two numbers into a jump or into a choice between their
//! addresses, neither of which works on whole registers. A choice by bits does.

use super::lane_values::{LANES, Lanes, operators};
use std::ops::{BitAnd, BitOr, Not};

/// Condition on each lane: all bits of a lane are 1 where it holds, and 0 where not.
#[derive(Debug, Clone, Copy, Default)]
#[repr(align(64))]
pub(crate) struct LaneMask([u64; LANES]);

impl LaneMask {
    /// Creates a condition that holds on the given lanes.
    pub fn of(lanes: [bool; LANES]) -> LaneMask {
        LaneMask(lanes.map(|holds| u64::from(holds).wrapping_neg()))
    }

    /// Returns the numbers where the condition holds, and 0 where not.
    #[inline(always)]
    pub fn keep(self, mut lanes: Lanes) -> Lanes {
        for lane in 0..LANES {
            lanes.0[lane] = f64::from_bits(lanes.0[lane].to_bits() & self.0[lane]);
        }
        lanes
    }

    /// Returns whether the condition holds on a lane.
    pub fn holds(self, lane: usize) -> bool {
        self.0[lane] != 0
    }

    /// Returns whether the condition holds on some lane.
    #[inline(always)]
    pub fn any(self) -> bool {
        self.0.iter().fold(0, |bits, lane| bits | lane) != 0
    }

    /// Returns the numbers of `yes` where the condition holds, and of `no` where not.
    #[inline(always)]
    pub fn pick(self, yes: Lanes, no: Lanes) -> Lanes {
        let mut picked = Lanes::default();
        for lane in 0..LANES {
            let (yes, no) = (yes.0[lane].to_bits(), no.0[lane].to_bits());
            picked.0[lane] = f64::from_bits((yes & self.0[lane]) | (no & !self.0[lane]));
        }
        picked
    }
}

impl Lanes {
    /// Returns where the numbers are less than others.
    #[inline(always)]
    pub fn is_below(self, other: Lanes) -> LaneMask {
        let mut mask = LaneMask::default();
        for lane in 0..LANES {
            mask.0[lane] = u64::from(self.0[lane] < other.0[lane]).wrapping_neg();
        }
        mask
    }
}

operators! { LaneMask: BitAnd, bitand, &=; BitOr, bitor, |=; }

impl Not for LaneMask {
    type Output = LaneMask;

    #[inline(always)]
    fn not(mut self) -> LaneMask {
        for lane in 0..LANES {
            self.0[lane] = !self.0[lane];
        }
        self
    }
}
