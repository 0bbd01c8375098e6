//! Special motions of a branch, where something changes between two of its motions.

use super::orbit::{Orbit, modulus};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Kind of a special motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PointKind {
    /// The branch turns back: a stable motion meets an unstable one.
    Fold,
    /// A multiplier passes -1: motions of twice the period branch off.
    Flip,
    /// A multiplier passes 1: another branch of the same period crosses.
    Branch,
    /// A pair of multipliers leaves the unit circle: motions with a second frequency branch off.
    Torus,
    /// A contact begins or ends to be part of the motion.
    Grazing,
}

impl PointKind {
    /// Returns all kinds.
    pub const ALL: [PointKind; 5] =
        [PointKind::Fold, PointKind::Flip, PointKind::Branch, PointKind::Torus, PointKind::Grazing];

    /// Returns the kind in the column `point`.
    pub fn word(self) -> &'static str {
        match self {
            PointKind::Fold => "fold",
            PointKind::Flip => "flip",
            PointKind::Branch => "branch",
            PointKind::Torus => "torus",
            PointKind::Grazing => "grazing",
        }
    }
}

impl fmt::Display for PointKind {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// Criterion by which a special motion is found.
pub(super) enum Test {
    /// Sign change of a function of a motion and of the direction of the branch in its parameter.
    Crossing(fn(&Orbit, f64) -> f64),
    /// Change of a count.
    Count(fn(&Orbit) -> usize),
}

/// Returns what changes between two motions, each given with the direction of the branch in its
/// parameter.
pub(super) fn between(a: (&Orbit, f64), b: (&Orbit, f64), folds: bool) -> Vec<(PointKind, Test)> {
    let crosses = |value: fn(&Orbit, f64) -> f64| value(a.0, a.1) * value(b.0, b.1) < 0.0;
    let mut changes = Vec::new();
    let fold: fn(&Orbit, f64) -> f64 = |_, direction| direction;
    let flip: fn(&Orbit, f64) -> f64 = |orbit, _| orbit.product(|multiplier| multiplier + 1.0);
    let branch: fn(&Orbit, f64) -> f64 = |orbit, _| orbit.product(|multiplier| multiplier - 1.0);
    let gap: fn(&Orbit, f64) -> f64 = |orbit, _| orbit.gap;
    let turns = folds && crosses(fold);
    if turns {
        changes.push((PointKind::Fold, Test::Crossing(fold)));
    }
    if crosses(flip) {
        changes.push((PointKind::Flip, Test::Crossing(flip)));
    }
    if crosses(branch) && !turns {
        changes.push((PointKind::Branch, Test::Crossing(branch)));
    }
    if changes.is_empty() && a.0.unstable.abs_diff(b.0.unstable) == 2 && has_pair(a.0) && has_pair(b.0) {
        changes.push((PointKind::Torus, Test::Count(|orbit| orbit.unstable)));
    }
    if a.0.gap.is_finite() && b.0.gap.is_finite() && crosses(gap) {
        changes.push((PointKind::Grazing, Test::Crossing(gap)));
    } else if a.0.contacts != b.0.contacts {
        changes.push((PointKind::Grazing, Test::Count(|orbit| orbit.contacts)));
    }
    changes
}

/// Returns whether the largest multipliers are a pair.
fn has_pair(orbit: &Orbit) -> bool {
    let [first, second] = [orbit.multipliers.first(), orbit.multipliers.get(1)];
    first.zip(second).is_some_and(|(a, b)| a[1] != 0.0 && (modulus(*a) - modulus(*b)).abs() < 1e-9)
}
