//! Obstacles as bounds on deflection dofs: the discrete convex set K^h of section 3 of the paper.
//!
//! # Bounds that yield
//!
//! A bound may yield by the law of Hertz (1881) for elastic bodies with curved surfaces: x may lie
//! beyond the bound by a depth d, where the reaction and the energy stored are
//!
//! ```math
//! r = k\, d_+^{3/2}, \qquad \varphi = \tfrac25\, k\, d_+^{5/2} .
//! ```
//!
//! The energy is convex with a continuous second derivative, so that a step remains a convex
//! problem. Rigid bounds are the limit of infinite k.

mod dofs_in_reach;

pub use dofs_in_reach::DofsInReach;

use crate::error::{Error, Result};
use crate::linalg::vectors::{Largest, largest};

/// Reaction of Hertz's law for a stiffness k (N/m^1.5) and a depth d (m), in N.
pub fn hertz_force(k: f64, d: f64) -> f64 {
    if d > 0.0 { k * d * d.sqrt() } else { 0.0 }
}

/// Depth (m) at which Hertz's law with a stiffness k (N/m^1.5) has a reaction r (N).
pub fn hertz_depth(k: f64, r: f64) -> f64 {
    let root = (r / k).cbrt();
    root * root
}

/// Derivative of Hertz's law for a stiffness k (N/m^1.5) at a depth d (m), in N/m.
pub fn hertz_tangent(k: f64, d: f64) -> f64 {
    if d > 0.0 { 1.5 * k * d.sqrt() } else { 0.0 }
}

/// Bounds on some dofs, `lower[i] <= x[dofs[i]] <= upper[i]`, infinite where there is none.
#[derive(Debug, Clone, Default, PartialEq)]
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
    /// Stiffnesses (N/m^1.5) with which the lower and the upper bound of each dof yield, infinite
    /// where a bound is rigid. It is `None` where the bounds of all ranks are rigid.
    pub hertz: Option<Vec<[f64; 2]>>,
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
            hertz: None,
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

    /// Returns whether the two bounds of a dof coincide: it cannot leave them, and its reaction may
    /// have any sign.
    pub fn holds(&self, bound: usize) -> bool {
        self.lower[bound] == self.upper[bound]
    }

    /// Returns an error where bounds may yield and `what`, a scheme, does not take them.
    ///
    /// # Errors
    /// Returns [`Error::Usage`].
    pub fn refuse_hertz(&self, what: &str) -> Result<()> {
        match self.hertz {
            None => Ok(()),
            Some(_) => Err(Error::Usage(format!(
                "{what} takes no stops with law = \"hertz\"; set law = \"linear\", or time.scheme = \"conserving\""
            ))),
        }
    }

    /// Returns the stiffness (N/m^1.5) of the lower (0) or upper (1) bound of a dof if it yields.
    pub fn yields(&self, bound: usize, side: usize) -> Option<f64> {
        let stiffness = self.hertz.as_ref()?[bound][side];
        stiffness.is_finite().then_some(stiffness)
    }

    /// Returns the lower and upper bound of a dof, infinite where they yield.
    pub fn rigid(&self, bound: usize) -> [f64; 2] {
        let rigid = |side, limit, absent| if self.yields(bound, side).is_some() { absent } else { limit };
        [rigid(0, self.lower[bound], f64::NEG_INFINITY), rigid(1, self.upper[bound], f64::INFINITY)]
    }

    /// Returns how far a value lies beyond the lower (0) or upper (1) bound of a dof, in m;
    /// negative inside.
    pub fn depth(&self, bound: usize, side: usize, value: f64) -> f64 {
        if side == 0 { self.lower[bound] - value } else { value - self.upper[bound] }
    }

    /// Returns the reaction of the bounds of a dof that yield at a value, in N, positive upwards.
    pub fn reaction(&self, bound: usize, value: f64) -> f64 {
        let of = |side: usize, sign: f64| {
            let stiffness = self.yields(bound, side);
            stiffness.map_or(0.0, |k| sign * hertz_force(k, self.depth(bound, side, value)))
        };
        of(0, 1.0) + of(1, -1.0)
    }

    /// Returns the stiffness (N/m) of a dof's bound that yields under a reaction (N); `None` for a
    /// rigid one.
    pub fn stiffness_under(&self, bound: usize, reaction: f64) -> Option<f64> {
        let stiffness = self.yields(bound, usize::from(reaction < 0.0))?;
        Some(hertz_tangent(stiffness, hertz_depth(stiffness, reaction.abs())))
    }

    /// Returns the energy stored in the bounds that yield, in J, given the value at each bound.
    pub fn stored_energy(&self, value: impl Fn(usize) -> f64) -> f64 {
        let Some(hertz) = &self.hertz else { return 0.0 };
        let sides = hertz.as_flattened().iter().enumerate().filter(|(_, stiffness)| stiffness.is_finite());
        let stored = |(place, &stiffness): (usize, &f64)| {
            let depth = self.depth(place / 2, place % 2, value(place / 2));
            0.4 * depth * hertz_force(stiffness, depth)
        };
        sides.map(stored).sum()
    }

    /// Sets the stiffnesses for bounds on an unknown that moves the bounded values at a rate: the
    /// reaction is that of the bounded values in `others`.
    pub fn scale_stiffness(&mut self, others: &Bounds, rate: f64) {
        if let (Some(own), Some(others)) = (&mut self.hertz, &others.hertz) {
            let scale = rate * rate.sqrt();
            let others = others.as_flattened().iter();
            own.as_flattened_mut().iter_mut().zip(others).for_each(|(own, other)| *own = scale * other);
        }
    }

    /// Sets the bounds to those on x for which `u + c x + s d` is within `others`, over the same
    /// dofs.
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

    /// Sets the bounds to those of `others`, over the same dofs, relative to x.
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
            |x, []| largest.note(x),
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
        let beyond = |(i, &dof): (usize, &usize)| {
            let [lower, upper] = self.rigid(i);
            (lower - x[dof]).max(x[dof] - upper)
        };
        self.dofs.iter().enumerate().map(beyond).fold(0.0, f64::max)
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
        let mut found = 0;
        self.dofs.for_each(
            x,
            [&self.lower, &self.upper],
            #[inline(always)]
            |x, [lower, upper]| found |= u64::from(condition(x, lower, upper)),
        );
        found > 0
    }

    /// Returns the largest finite magnitude of the bounds, or [`Bounds::size`] if that is larger,
    /// in m.
    pub fn magnitude(&self) -> f64 {
        let finite = |b: &f64| if b.is_finite() { *b } else { 0.0 };
        [&self.lower, &self.upper].into_iter().fold(self.size, |m, of| m.max(largest(of.iter().map(finite))))
    }
}
