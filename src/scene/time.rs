//! Time scheme, its steps, and the mass matrix.

use crate::modes::ModeRange;
use crate::scheme::{Massless, SchemeSpec};
use serde::{Deserialize, Serialize};

/// Time scheme and its steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Time {
    /// Time scheme.
    pub scheme: SchemeSpec,
    /// Mass matrix.
    pub mass: Mass,
    /// Modes that carry the inertia with the modal mass; `None` for a number that suits the mesh.
    pub modes: Option<ModeRange>,
    /// Time step in s.
    pub step: f64,
    /// End time in s.
    ///
    /// A run makes [`Time::steps`] steps, so that its last time is the multiple of the step nearest
    /// to `end`.
    pub end: f64,
}

impl Time {
    /// Returns the number of factors, all of the same size, that the scheme holds at once.
    pub fn factors(&self) -> usize {
        let [singular, consistent] = self.scheme.capabilities().factors;
        match self.mass {
            Mass::Singular => singular,
            Mass::Consistent => consistent,
            // The factor of K serves the modes and the compliance of the rest.
            Mass::Modal => 1,
        }
    }

    /// Returns the number of steps, `end / step` rounded to the nearest integer.
    pub fn steps(&self) -> u64 {
        (self.end / self.step).round() as u64
    }
}

/// Mass matrix.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mass {
    /// Singular mass, from velocities that are constant on each cell.
    Singular,
    /// Consistent mass.
    Consistent,
    /// Singular mass of the lowest modes of the consistent mass.
    Modal,
}

impl Mass {
    /// Returns whether the mass leaves part of the displacement without inertia.
    pub fn is_singular(self) -> bool {
        self != Mass::Consistent
    }

    /// Returns the midpoint scheme's default treatment of the massless part of the displacement.
    pub fn massless(self) -> Massless {
        match self {
            Mass::Singular | Mass::Modal => Massless::Equilibrium,
            Mass::Consistent => Massless::Reflected,
        }
    }
}
