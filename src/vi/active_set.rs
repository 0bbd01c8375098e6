//! Active sets: block principal pivoting, and the dense box-constrained problem.
//!
//! Each iteration exchanges every index that breaks a condition (the primal-dual active set method). Should it come back to sets
//! that it has tried, single exchanges of the last such index follow until fewer break than ever (Murty 1974; Júdice and
//! Pires 1994): finite for every symmetric positive definite matrix, however degenerate.

use crate::archive::{Archive, Over};
use crate::error::Result;
use crate::linalg::Factor;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side as Triangle};
use std::collections::HashSet;

/// Where a bounded dof is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
pub enum Side {
    /// Between its bounds.
    #[default]
    Free,
    /// On its lower bound.
    Lower,
    /// On its upper bound.
    Upper,
}

impl Side {
    /// The side of a number made by `side as u8`.
    pub(super) fn from_code(code: f64) -> Side {
        [Side::Free, Side::Lower, Side::Upper][code as usize % 3]
    }

    /// Shows an archive sides, one a bound.
    pub(super) fn archive(sides: &mut [Side], archive: &mut Archive) -> Result<()> {
        archive.items(Over::Bounds, sides, |&side| [f64::from(side as u8)], |[code]| Side::from_code(code))
    }

    /// This side if there is a bound on it, else free: a bound may have gone since the last step.
    pub(super) fn within(self, lower: f64, upper: f64) -> Side {
        match self {
            Side::Lower if lower.is_finite() => Side::Lower,
            Side::Upper if upper.is_finite() => Side::Upper,
            _ => Side::Free,
        }
    }
}

/// Reactions are trusted to this many roundings of the magnitude of their row.
const ROUNDINGS: f64 = 64.0;

/// Which of the indices that break a condition move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Move {
    /// All of them.
    All,
    /// The last one.
    Last,
}

/// The exchange rule and its memory.
#[derive(Debug)]
pub(super) struct Exchange {
    /// Fingerprints of the sets tried.
    tried: HashSet<u64>,
    /// Fewest indices that broke a condition.
    fewest: usize,
    /// Single exchanges go on until fewer than this break.
    single_above: Option<usize>,
    /// Exchanges made so far.
    pub iterations: u32,
    limit: u32,
}

impl Exchange {
    pub fn new(size: usize) -> Exchange {
        let limit = u32::try_from(size).unwrap_or(u32::MAX).saturating_mul(64).saturating_add(256);
        Exchange { tried: HashSet::new(), fewest: usize::MAX, single_above: None, iterations: 0, limit }
    }

    /// What to do about as many indices as break a condition with the sets of this fingerprint; `None` when there is none, or
    /// at the limit.
    pub fn next(&mut self, broken: usize, fingerprint: u64) -> Option<Move> {
        if broken == 0 || self.iterations == self.limit {
            return None;
        }
        self.iterations += 1;
        self.fewest = self.fewest.min(broken);
        if self.single_above.is_some_and(|bound| broken < bound) {
            self.single_above = None;
        }
        if self.single_above.is_none() && !self.tried.insert(fingerprint) {
            self.single_above = Some(self.fewest);
        }
        Some(if self.single_above.is_some() { Move::Last } else { Move::All })
    }
}

/// A number that sets share only if they are the same, or by a chance of 1 in 2^52 (it fits into a float).
pub(super) fn fingerprint(sides: &[Side]) -> u64 {
    let mix = |hash: u64, side: &Side| (hash ^ *side as u64).wrapping_mul(0x0100_0000_01b3);
    sides.iter().fold(0xcbf2_9ce4_8422_2325, mix) >> 12
}

/// The indices that break a condition, ascending, and the sides they want.
///
/// `magnitude` is that of each reaction's row: a reaction pulls only if it does so by more than its rounding.
pub(super) fn broken(
    sides: &[Side],
    x: &[f64],
    reaction: &[f64],
    magnitude: &[f64],
    lower: &[f64],
    upper: &[f64],
) -> Vec<(usize, Side)> {
    let wanted = |i: usize| {
        let rounding = ROUNDINGS * f64::EPSILON * magnitude[i];
        match sides[i] {
            Side::Free if x[i] < lower[i] => Side::Lower,
            Side::Free if x[i] > upper[i] => Side::Upper,
            Side::Lower if reaction[i] < -rounding && lower[i] < upper[i] => Side::Free,
            Side::Upper if reaction[i] > rounding && lower[i] < upper[i] => Side::Free,
            stays => stays,
        }
    };
    (0..sides.len()).map(|i| (i, wanted(i))).filter(|(i, side)| *side != sides[*i]).collect()
}

/// Moves indices to the sides they want.
pub(super) fn exchange(sides: &mut [Side], moves: &[(usize, Side)]) {
    for &(i, side) in moves {
        sides[i] = side;
    }
}

/// Solves H x = h + r with bounds on every entry, from the sets in `sides` on; returns the number of exchanges.
pub fn dense(
    schur: &Mat<f64>,
    h: &[f64],
    lower: &[f64],
    upper: &[f64],
    sides: &mut [Side],
    x: &mut [f64],
    reaction: &mut [f64],
) -> u32 {
    let size = h.len();
    let mut rule = Exchange::new(size);
    let mut magnitude = vec![0.0; size];
    loop {
        solve_fixed(schur, h, lower, upper, sides, x);
        for i in 0..size {
            (reaction[i], magnitude[i]) = (-h[i], h[i].abs());
        }
        for (j, &value) in x.iter().enumerate() {
            for (i, &entry) in schur.col(j).iter().enumerate() {
                reaction[i] += entry * value;
                magnitude[i] += (entry * value).abs();
            }
        }
        let broken = broken(sides, x, reaction, &magnitude, lower, upper);
        match rule.next(broken.len(), fingerprint(sides)) {
            None => break,
            Some(Move::All) => exchange(sides, &broken),
            Some(Move::Last) => exchange(sides, &broken[broken.len() - 1..]),
        }
    }
    for (r, side) in reaction.iter_mut().zip(sides.iter()) {
        if *side == Side::Free {
            *r = 0.0;
        }
    }
    rule.iterations
}

/// Puts the active entries on their bounds and solves for the others.
fn solve_fixed(schur: &Mat<f64>, h: &[f64], lower: &[f64], upper: &[f64], sides: &[Side], x: &mut [f64]) {
    let mut free = Vec::with_capacity(h.len());
    for (i, side) in sides.iter().enumerate() {
        match side {
            Side::Free => free.push(i),
            Side::Lower => x[i] = lower[i],
            Side::Upper => x[i] = upper[i],
        }
    }
    if free.is_empty() {
        return;
    }
    let fixed = |j: &usize| sides[*j] != Side::Free;
    let mut rhs = Mat::from_fn(free.len(), 1, |k, _| {
        let column = schur.col(free[k]);
        h[free[k]] - (0..h.len()).filter(fixed).map(|j| column[j] * x[j]).sum::<f64>()
    });
    let block = Mat::from_fn(free.len(), free.len(), |i, j| schur[(free[i], free[j])]);
    match block.llt(Triangle::Lower) {
        Ok(llt) => llt.solve_in_place(&mut rhs),
        // Not positive definite to rounding: leave a NaN for the judge.
        Err(_) => rhs.fill(f64::NAN),
    }
    for (k, &i) in free.iter().enumerate() {
        x[i] = rhs[(k, 0)];
    }
}

/// The candidates' values without any bound.
pub(super) fn unconstrained(factor: &impl Factor, h: &[f64], x: &mut [f64]) {
    x.copy_from_slice(h);
    factor.solve_candidates(x);
}
