//! Variables on which a formula may depend.

use std::fmt::{self, Display};
use std::ops::BitOr;

/// Variable of a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Name {
    X,
    Y,
    T,
    /// Deflection at the place.
    W,
}

impl Name {
    pub const ALL: [Name; 4] = [Name::X, Name::Y, Name::T, Name::W];

    pub fn word(self) -> &'static str {
        match self {
            Name::X => "x",
            Name::Y => "y",
            Name::T => "t",
            Name::W => "w",
        }
    }

    pub fn set(self) -> Names {
        Names(1 << self as u8)
    }
}

/// Set of the variables x, y (m), t (s) and w (m).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Names(u8);

impl Names {
    /// Empty set, for constants.
    pub const NONE: Names = Names(0);
    /// Time t.
    pub const T: Names = Names(0b100);
    /// Place x, y.
    pub const XY: Names = Names(0b011);
    /// Place x, y and time t.
    pub const XYT: Names = Names(0b111);
    /// Deflection w.
    pub const W: Names = Names(0b1000);
    /// Place x, y, time t and deflection w.
    pub const XYTW: Names = Names(0b1111);

    /// Returns whether the two sets have a variable in common.
    pub fn meets(self, other: Names) -> bool {
        self.0 & other.0 != 0
    }

    pub(super) fn iter(self) -> impl Iterator<Item = Name> {
        Name::ALL.into_iter().filter(move |name| self.meets(name.set()))
    }
}

impl BitOr for Names {
    type Output = Names;

    fn bitor(self, other: Names) -> Names {
        Names(self.0 | other.0)
    }
}

impl Display for Names {
    /// Writes the names, as in `x, y, t`.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let words: Vec<&str> = self.iter().map(Name::word).collect();
        f.write_str(&words.join(", "))
    }
}
