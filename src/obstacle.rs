//! Obstacles as bounds on deflection dofs: the discrete convex set K^h of section 3 of the paper.
//!
//! A bound may yield by a [law of contact](crate::contact_law): x then lies beyond it by a depth,
//! which gives the reaction and the stored energy. The energy is convex, so that a step remains a
//! convex problem. Rigid bounds are the limit of stiff laws.

mod dofs_in_reach;

pub use dofs_in_reach::DofsInReach;

use crate::contact_law::{ContactLaw, Laws, RIGID};
use crate::linalg::vectors::{Largest, largest};

/// Bounds on some dofs, `lower[i] <= x[dofs[i]] <= upper[i]`; infinite where there is none.
#[derive(Debug, Clone, Default)]
pub struct Bounds {
    /// Dofs in reach of an obstacle, ascending: the rows of G.
    pub dofs: DofsInReach,
    /// Lower bounds, in m.
    pub lower: Vec<f64>,
    /// Upper bounds, in m.
    pub upper: Vec<f64>,
    /// Size of the bounded motions, in m, where neither the bounds nor the deflections show it, as
    /// for a gap that may stay near 0.
    pub size: f64,
    /// Laws by which the bounds yield.
    pub laws: Laws,
}

impl Bounds {
    /// Creates the same bounds on each dof.
    pub fn uniform(dofs: Vec<usize>, lower: f64, upper: f64) -> Bounds {
        let count = dofs.len();
        Bounds {
            dofs: dofs.into_iter().collect(),
            lower: vec![lower; count],
            upper: vec![upper; count],
            size: 0.0,
            laws: Laws::default(),
        }
    }

    /// Returns the number of bounded dofs.
    pub fn len(&self) -> usize {
        self.dofs.len()
    }

    /// Returns whether nothing is bounded.
    pub fn is_empty(&self) -> bool {
        self.dofs.is_empty()
    }

    /// Returns whether the two bounds of a dof coincide, so that they give its value, and its
    /// reaction may have any sign.
    pub fn holds(&self, bound: usize) -> bool {
        self.lower[bound] == self.upper[bound]
    }

    /// Returns the lower and upper bound of a dof, infinite where they yield.
    pub fn rigid(&self, bound: usize) -> [f64; 2] {
        let [lower, upper] = self.laws.numbers(bound);
        [
            if lower == RIGID { self.lower[bound] } else { f64::NEG_INFINITY },
            if upper == RIGID { self.upper[bound] } else { f64::INFINITY },
        ]
    }

    /// Returns how far a value lies beyond the lower (0) or upper (1) bound of a dof, in m;
    /// negative inside.
    pub fn depth(&self, bound: usize, side: usize, value: f64) -> f64 {
        if side == 0 { self.lower[bound] - value } else { value - self.upper[bound] }
    }

    /// Returns the reaction of the bounds of a dof that yield at a value, in N, positive upwards.
    pub fn reaction(&self, bound: usize, value: f64) -> f64 {
        let force = |side: usize| {
            self.laws.get(bound, side).map_or(0.0, |law| law.force(self.depth(bound, side, value)))
        };
        force(0) - force(1)
    }

    /// Returns the energy stored in the bounds that yield, in J, given the value at each bound.
    pub fn stored_energy(&self, value: impl Fn(usize) -> f64) -> f64 {
        let energy = |bound: usize, side: usize| {
            self.laws.get(bound, side).map_or(0.0, |law| law.energy(self.depth(bound, side, value(bound))))
        };
        let count = if self.laws.are_rigid() { 0 } else { self.len() };
        (0..count).map(|bound| energy(bound, 0) + energy(bound, 1)).sum()
    }

    /// Sets bounds on x that keep `u + c x + s d` within `others`, over the same dofs.
    pub fn pull_back(&mut self, others: &Bounds, [u, d]: [&[f64]; 2], [c, s]: [f64; 2]) {
        let Bounds { dofs, lower, upper, .. } = others;
        let factor = 1.0 / c;
        dofs.map(
            [u, d],
            [lower, upper],
            [&mut self.lower, &mut self.upper],
            #[inline(always)]
            |[u, d], bounds| bounds.map(|bound| factor * ((bound - u) - s * d)),
        );
    }

    /// Sets the bounds to `others - x`, over the same dofs.
    pub fn shift(&mut self, others: &Bounds, x: &[f64]) {
        let Bounds { dofs, lower, upper, .. } = others;
        dofs.map(
            [x],
            [lower, upper],
            [&mut self.lower, &mut self.upper],
            #[inline(always)]
            |[x], bounds| bounds.map(|bound| bound - x),
        );
    }

    /// Computes G x.
    pub fn restrict(&self, x: &[f64], values: &mut [f64]) {
        self.dofs.map(
            [x],
            [],
            [values],
            #[inline(always)]
            |x, []| x,
        );
    }

    /// Returns the largest magnitude of G x, and NaN if one is.
    pub fn largest(&self, x: &[f64]) -> f64 {
        let mut largest = Largest::default();
        self.dofs.for_each(
            x,
            [],
            #[inline(always)]
            |x, []| largest.raise(x),
        );
        largest.value()
    }

    /// Adds G^T r to y.
    pub fn add_transposed(&self, r: &[f64], y: &mut [f64]) {
        for (r, &dof) in r.iter().zip(&self.dofs) {
            y[dof] += r;
        }
    }

    /// Returns the largest violation of a rigid bound by x, in m; 0 inside.
    pub fn violation(&self, x: &[f64]) -> f64 {
        self.worst(x).map_or(0.0, |(_, violation)| violation.max(0.0))
    }

    /// Returns the index of the rigid bound that x violates most and the violation, in m, which is
    /// negative inside; `None` without bounds.
    pub fn worst(&self, x: &[f64]) -> Option<(usize, f64)> {
        let beyond = |(i, &dof): (usize, &usize)| {
            let [lower, upper] = self.rigid(i);
            (i, (lower - x[dof]).max(x[dof] - upper))
        };
        self.dofs.iter().enumerate().map(beyond).max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Returns whether x lies beyond any bound, rigid or not.
    pub fn are_crossed(&self, x: &[f64]) -> bool {
        self.any(
            x,
            #[inline(always)]
            |x, lower, upper| (x < lower) | (x > upper),
        )
    }

    /// Returns whether x lies within all bounds, rigid or not; where a number is NaN, it does not.
    pub fn contain(&self, x: &[f64]) -> bool {
        !self.any(
            x,
            #[inline(always)]
            |x, lower, upper| !((x >= lower) & (x <= upper)),
        )
    }

    /// Returns whether any value and its bounds satisfy a condition, which must be marked
    /// `#[inline(always)]`.
    fn any(&self, x: &[f64], condition: impl Fn(f64, f64, f64) -> bool) -> bool {
        // Without an early end the loop has no branches, and registers hold a number for each
        // value.
        let mut matches = 0;
        self.dofs.for_each(
            x,
            [&self.lower, &self.upper],
            #[inline(always)]
            |x, [lower, upper]| matches |= u64::from(condition(x, lower, upper)),
        );
        matches > 0
    }

    /// Returns the largest finite magnitude of the bounds, or [`Bounds::size`] if that is larger,
    /// in m.
    pub fn magnitude(&self) -> f64 {
        let finite = |b: &f64| if b.is_finite() { *b } else { 0.0 };
        [&self.lower, &self.upper].into_iter().fold(self.size, |m, b| m.max(largest(b.iter().map(finite))))
    }
}
