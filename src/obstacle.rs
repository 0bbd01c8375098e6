//! Rigid obstacles as bounds on deflection dofs: the discrete convex set K^h of section 3 of the
//! paper.

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
}

impl Bounds {
    /// Creates the same bounds on each dof.
    pub fn uniform(dofs: Vec<usize>, lower: f64, upper: f64) -> Bounds {
        let count = dofs.len();
        Bounds { dofs, lower: vec![lower; count], upper: vec![upper; count], size: 0.0 }
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

    /// Sets the bounds to those of `others`, over the same dofs, mapped by a function of dof and
    /// bound.
    pub fn shift(&mut self, others: &Bounds, map: impl Fn(usize, f64) -> f64) {
        for (i, &dof) in others.dofs.iter().enumerate() {
            self.lower[i] = map(dof, others.lower[i]);
            self.upper[i] = map(dof, others.upper[i]);
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

    /// Returns the largest violation of a bound by x, in m; 0 inside.
    pub fn violation(&self, x: &[f64]) -> f64 {
        self.dofs
            .iter()
            .zip(self.lower.iter().zip(&self.upper))
            .map(|(&dof, (lower, upper))| (lower - x[dof]).max(x[dof] - upper))
            .fold(0.0, f64::max)
    }

    /// Returns the largest finite magnitude of the bounds, or [`Bounds::size`] if that is larger,
    /// in m.
    pub fn magnitude(&self) -> f64 {
        let bounds = self.lower.iter().chain(&self.upper).map(|b| b.abs());
        bounds.fold(self.size, |m, b| if b > m && b.is_finite() { b } else { m })
    }
}
