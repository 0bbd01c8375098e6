//! The condensed solver: factor once, and meet contact in a small dense problem on the candidates.
//!
//! A step is a forward elimination down to the candidates, their dense box-constrained problem, and a back substitution:
//! the cost of one solve. Nodes that come into reach become candidates, in growing lots, and the matrix is factored again with
//! them last. Where contact is wide (a plate thrown flat) the dense problem would cost more than a sparse factor: from
//! [`DENSE_LIMIT`] candidates on, and until nothing touches any more, the active dofs are pinned in the sparse matrix
//! instead, on the same symbolic analysis. Both are exact active-set methods.

use super::Solver;
use super::active_set::{self, Exchange, Side};
use crate::error::Result;
use crate::linalg::{Engine, Factor, Sum};
use crate::obstacle::Bounds;

/// Number of candidates from which on active dofs are pinned in the sparse matrix.
pub const DENSE_LIMIT: usize = 512;

/// Candidates taken at least when a node comes into reach.
const FIRST_LOT: usize = 4;

/// The condensed solver; see the [module page](self).
#[derive(Debug)]
pub struct Condensed<E: Engine> {
    factor: E::Factor,
    method: Method,
    /// Where each bounded dof was last.
    sides: Vec<Side>,
    factorisations: u64,
}

#[derive(Debug)]
enum Method {
    /// A dense problem on these bounds (indices into them, ascending).
    Dense { candidates: Vec<usize> },
    /// Active dofs pinned in the sparse matrix; the sides that it was last factored for.
    Pinned { pinned: Vec<Side> },
}

impl<E: Engine> Condensed<E> {
    /// Factors the matrix, with no candidates yet, for bounds on `bounded` dofs.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where the sum is not positive definite.
    pub fn new(engine: &E, sum: &Sum<E>, bounded: usize) -> Result<Condensed<E>> {
        Ok(Condensed {
            factor: engine.factor(sum, &[])?,
            method: Method::Dense { candidates: Vec::new() },
            sides: vec![Side::Free; bounded],
            factorisations: 1,
        })
    }

    /// Makes the bounds that x breaks candidates, with those nearest to their bounds, and factors again.
    fn grow(&mut self, engine: &E, sum: &Sum<E>, bounds: &Bounds, x: &[f64]) -> Result<()> {
        let Method::Dense { candidates } = &mut self.method else { return Ok(()) };
        let gap = |i: usize| {
            let x = x[bounds.dofs[i]];
            (x - bounds.lower[i]).min(bounds.upper[i] - x)
        };
        let mut chosen = vec![false; bounds.len()];
        for &i in candidates.iter() {
            chosen[i] = true;
        }
        let mut others: Vec<usize> = (0..bounds.len()).filter(|&i| !chosen[i]).collect();
        others.sort_by(|&i, &j| gap(i).total_cmp(&gap(j)));
        let broken = others.iter().take_while(|&&i| gap(i) < 0.0).count();
        let lot = broken.max(candidates.len()).max(FIRST_LOT).min(others.len());
        if candidates.len() + broken > DENSE_LIMIT {
            self.factor = engine.factor(sum, &[])?;
            self.method = Method::Pinned { pinned: vec![Side::Free; bounds.len()] };
        } else {
            let lot = lot.min(DENSE_LIMIT - candidates.len());
            candidates.extend(&others[..lot]);
            candidates.sort_unstable();
            let dofs: Vec<usize> = candidates.iter().map(|&i| bounds.dofs[i]).collect();
            self.factor = engine.factor(sum, &dofs)?;
        }
        self.factorisations += 1;
        Ok(())
    }

    fn solve_dense(&mut self, b: &[f64], bounds: &Bounds, x: &mut [f64], reaction: &mut [f64]) -> u32 {
        let Method::Dense { candidates } = &self.method else { return 0 };
        reaction.fill(0.0);
        if candidates.is_empty() {
            x.copy_from_slice(b);
            self.factor.solve(x);
            return 0;
        }
        let pick = |values: &[f64]| -> Vec<f64> { candidates.iter().map(|&i| values[i]).collect() };
        let (lower, upper) = (pick(&bounds.lower), pick(&bounds.upper));
        let within = |&i: &usize| self.sides[i].within(bounds.lower[i], bounds.upper[i]);
        let mut sides: Vec<Side> = candidates.iter().map(within).collect();
        let mut h = vec![0.0; candidates.len()];
        let mut values = vec![0.0; candidates.len()];
        self.factor.condense(b, &mut h);
        active_set::unconstrained(&self.factor, &h, &mut values);
        let inside = values.iter().zip(lower.iter().zip(&upper)).all(|(x, (l, u))| (l..=u).contains(&x));
        let mut iterations = 0;
        if inside {
            // The unconstrained minimiser is admissible, hence the answer.
            sides.fill(Side::Free);
        } else {
            let mut forces = vec![0.0; candidates.len()];
            let schur = self.factor.schur();
            iterations =
                1 + active_set::dense(schur, &h, &lower, &upper, &mut sides, &mut values, &mut forces);
            for (&i, force) in candidates.iter().zip(forces) {
                reaction[i] = force;
            }
        }
        for (&i, side) in candidates.iter().zip(sides) {
            self.sides[i] = side;
        }
        self.factor.expand(&values, x);
        iterations
    }

    fn solve_pinned(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<u32> {
        let Method::Pinned { pinned } = &mut self.method else { return Ok(0) };
        for (i, side) in self.sides.iter_mut().enumerate() {
            *side = side.within(bounds.lower[i], bounds.upper[i]);
        }
        let mut exchange = Exchange::new(bounds.len());
        let mut product = vec![0.0; b.len()];
        let mut residual = vec![0.0; b.len()];
        let mut magnitude = vec![0.0; b.len()];
        let mut at_bounds = vec![0.0; bounds.len()];
        let mut scales = vec![0.0; bounds.len()];
        loop {
            if *pinned != self.sides {
                let free = |i: &usize| self.sides[*i] != Side::Free;
                let dofs: Vec<usize> = (0..bounds.len()).filter(free).map(|i| bounds.dofs[i]).collect();
                self.factor.pin(&dofs)?;
                self.factorisations += 1;
                pinned.copy_from_slice(&self.sides);
            }
            let fixed = |i: usize| match self.sides[i] {
                Side::Free => None,
                Side::Lower => Some(bounds.lower[i]),
                Side::Upper => Some(bounds.upper[i]),
            };
            x.fill(0.0);
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                x[dof] = fixed(i).unwrap_or(0.0);
            }
            apply(engine, sum, x, &mut product, &mut residual);
            for ((x, r), b) in x.iter_mut().zip(&residual).zip(b) {
                *x = b - r;
            }
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                if let Some(value) = fixed(i) {
                    x[dof] = value;
                }
            }
            self.factor.solve(x);
            engine.multiply_with_magnitude(sum, x, &mut residual, &mut magnitude);
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                at_bounds[i] = x[dof];
                reaction[i] = if self.sides[i] == Side::Free { 0.0 } else { residual[dof] - b[dof] };
                scales[i] = magnitude[dof] + b[dof].abs();
            }
            if !exchange.next(&mut self.sides, &at_bounds, reaction, &scales, &bounds.lower, &bounds.upper) {
                let touching = self.sides.iter().any(|&side| side != Side::Free);
                return Ok(exchange.iterations + u32::from(touching));
            }
        }
    }
}

/// y = A x for a sum of forms.
fn apply<E: Engine>(engine: &E, sum: &Sum<E>, x: &[f64], product: &mut [f64], y: &mut [f64]) {
    y.fill(0.0);
    for (scale, form) in sum {
        engine.multiply(form, x, product);
        for (y, p) in y.iter_mut().zip(product.iter()) {
            *y += scale * p;
        }
    }
}

impl<E: Engine> Solver<E> for Condensed<E> {
    fn solve(
        &mut self,
        engine: &E,
        sum: &Sum<E>,
        b: &[f64],
        bounds: &Bounds,
        x: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<u32> {
        let mut iterations = 0;
        while let Method::Dense { candidates } = &self.method {
            let all = candidates.len() == bounds.len();
            iterations += self.solve_dense(b, bounds, x, reaction);
            // The candidates' own violations are beneath rounding; only the others' can be real. A NaN is the judge's.
            if all || !outside(bounds, candidates_of(&self.method), x) {
                return Ok(iterations);
            }
            self.grow(engine, sum, bounds, x)?;
        }
        iterations += self.solve_pinned(engine, sum, b, bounds, x, reaction)?;
        if self.sides.iter().all(|&side| side == Side::Free) {
            // Nothing touches and nothing is pinned: the factor is that of the matrix itself again.
            self.method = Method::Dense { candidates: Vec::new() };
        }
        Ok(iterations)
    }

    fn factorisations(&self) -> u64 {
        self.factorisations
    }
}

fn candidates_of(method: &Method) -> &[usize] {
    match method {
        Method::Dense { candidates } => candidates,
        Method::Pinned { .. } => &[],
    }
}

/// Whether x breaks a bound that is not among the candidates (ascending).
fn outside(bounds: &Bounds, candidates: &[usize], x: &[f64]) -> bool {
    let mut candidates = candidates.iter().peekable();
    bounds.dofs.iter().enumerate().any(|(i, &dof)| {
        candidates.next_if(|&&candidate| candidate == i).is_none()
            && (x[dof] < bounds.lower[i] || x[dof] > bounds.upper[i])
    })
}
