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

use crate::error::{Error, Result};
use crate::linalg::vectors::largest;

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
    pub dofs: Vec<usize>,
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
        Bounds { dofs, lower: vec![lower; count], upper: vec![upper; count], size: 0.0, hertz: None }
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

    /// Sets the bounds to those of `others`, over the same dofs, mapped by a function of dof and
    /// bound.
    pub fn shift(&mut self, others: &Bounds, map: impl Fn(usize, f64) -> f64) {
        let own = self.lower.iter_mut().zip(&mut self.upper);
        let others = others.dofs.iter().zip(others.lower.iter().zip(&others.upper));
        for ((own_lower, own_upper), (&dof, (lower, upper))) in own.zip(others) {
            (*own_lower, *own_upper) = (map(dof, *lower), map(dof, *upper));
        }
    }

    /// Computes G x.
    pub fn restrict(&self, x: &[f64], values: &mut [f64]) {
        for (value, &dof) in values.iter_mut().zip(&self.dofs) {
            *value = x[dof];
        }
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
        let limits = self.lower.iter().zip(&self.upper);
        // Without an early end the loop has no branches.
        self.dofs
            .iter()
            .zip(limits)
            .fold(false, |crossed, (&dof, (lower, upper))| crossed | (x[dof] < *lower) | (x[dof] > *upper))
    }

    /// Returns the largest finite magnitude of the bounds, or [`Bounds::size`] if that is larger,
    /// in m.
    pub fn magnitude(&self) -> f64 {
        let finite = |b: &f64| if b.is_finite() { *b } else { 0.0 };
        [&self.lower, &self.upper].into_iter().fold(self.size, |m, of| m.max(largest(of.iter().map(finite))))
    }
}
