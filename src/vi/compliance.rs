//! Bound-constrained problem in compliance form: deflections and reactions of the bounded dofs of
//! a structure whose other unknowns are eliminated.
//!
//! Given the deflections y of the structure without reactions and its compliance R, symmetric
//! positive definite, the problem is
//!
//! ```math
//! x = y + R r, \qquad l \le x \le u, \qquad
//! r \ge 0 \text{ at } l,\; r \le 0 \text{ at } u,\; r = 0 \text{ between}.
//! ```
//!
//! The solution exists and is unique. Each iteration factors the block of R of the dofs in contact
//! only. These dofs are few, and the solver keeps the factor while they stay the same. Bounds that
//! yield add to the diagonal of R, see [`yielding`].

pub mod yielding;

use super::active_set::{BoundStatus, BoundValues, Exchange, Move, broken, exchange, fingerprint};
use crate::archive::Archive;
use crate::error::Result;
use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side as Triangle};

/// Solver of the problem in compliance form, warm-started from its last active set; see the
/// [module page](self).
#[derive(Debug, Default)]
pub struct ComplianceSolver {
    /// Contact status of each bounded dof in the last answer.
    pub sides: Vec<BoundStatus>,
    /// Dofs in contact, ascending, and the factor of their compliance.
    active: Vec<usize>,
    factor: Option<Llt<f64>>,
    /// Dofs that the factor belongs to, each with the compliance of its bound, in m/N.
    factored: Vec<(usize, f64)>,
    /// Compliances of the lower and the upper bound of each dof in the last answer, in m/N, 0 for
    /// rigid ones; empty if no bound yields.
    softness: Vec<[f64; 2]>,
    /// Number of factorisations so far.
    pub factorisations: u64,
    /// Largest distance of a dof in contact from its bound before it is put there, in m: the
    /// rounding error of the last answer.
    pub residual: f64,
    /// Number of exchanges in the last solve.
    pub iterations: u32,
    magnitude: Vec<f64>,
}

/// Data of the problem, one entry per bounded dof.
#[derive(Clone, Copy)]
pub struct ComplianceProblem<'a> {
    /// Compliance R, in m/N.
    pub compliance: &'a Mat<f64>,
    /// Deflections y without reactions, in m.
    pub free: &'a [f64],
    /// Lower bounds l, in m.
    pub lower: &'a [f64],
    /// Upper bounds u, in m.
    pub upper: &'a [f64],
    /// Stiffnesses (N/m^1.5) with which the lower and the upper bounds yield by the law of Hertz,
    /// infinite for rigid ones; empty if none yields.
    pub hertz: &'a [[f64; 2]],
}

impl ComplianceSolver {
    /// Creates a solver for a number of bounded dofs, none in contact.
    pub fn new(size: usize) -> ComplianceSolver {
        ComplianceSolver {
            sides: vec![BoundStatus::Free; size],
            magnitude: vec![0.0; size],
            ..ComplianceSolver::default()
        }
    }

    /// Returns the dofs in contact in the last answer, ascending.
    pub fn active(&self) -> &[usize] {
        &self.active
    }

    /// Solves for the deflections x (m) and reactions r (N). Entries are NaN where the compliance
    /// of the dofs in contact is not positive definite to rounding.
    pub fn solve(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        if problem.hertz.is_empty() {
            self.solve_rigid(problem, x, reaction);
        } else {
            self.solve_yielding(problem, x, reaction);
        }
    }

    /// Solves the problem with bounds that are rigid but for their own compliance.
    fn solve_rigid(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        let ComplianceProblem { compliance, free, lower, upper, .. } = problem;
        let mut rule: Option<Exchange> = None;
        (self.iterations, self.residual) = (0, 0.0);
        for (i, side) in self.sides.iter_mut().enumerate() {
            *side = side.within(lower[i], upper[i]);
        }
        loop {
            self.factor_active(compliance);
            reaction.fill(0.0);
            x.copy_from_slice(free);
            let held =
                |i: usize, side: BoundStatus| if side == BoundStatus::Upper { upper[i] } else { lower[i] };
            if !self.active.is_empty() {
                let missing =
                    |k: usize| held(self.active[k], self.sides[self.active[k]]) - free[self.active[k]];
                let mut forces = Mat::from_fn(self.active.len(), 1, |k, _| missing(k));
                match &self.factor {
                    Some(llt) => llt.solve_in_place(&mut forces),
                    None => forces.fill(f64::NAN),
                }
                let largest = forces.norm_max();
                for (k, &i) in self.active.iter().enumerate() {
                    reaction[i] = forces[(k, 0)];
                    self.magnitude[i] = largest;
                    let column = compliance.col_as_slice(i);
                    x.iter_mut().zip(column).for_each(|(x, c)| *x += c * forces[(k, 0)]);
                }
                self.residual = 0.0;
                for &i in &self.active {
                    let bound = held(i, self.sides[i]) - self.softness(i) * reaction[i];
                    self.residual = self.residual.max((x[i] - bound).abs());
                    x[i] = bound;
                }
                if largest.is_nan() {
                    x.fill(f64::NAN);
                    return;
                }
            }
            let values = BoundValues { lower, upper, x, reaction, magnitude: &self.magnitude };
            let broken = broken(&self.sides, values);
            if broken.is_empty() {
                break;
            }
            let rule = rule.get_or_insert_with(|| Exchange::new(free.len()));
            match rule.next(broken.len(), fingerprint(&self.sides)) {
                None => break,
                Some(Move::All) => exchange(&mut self.sides, &broken),
                Some(Move::Last) => exchange(&mut self.sides, &broken[broken.len() - 1..]),
            }
            self.iterations = rule.iterations;
        }
    }

    /// Returns the compliance of the bound that a dof is at, in m/N; 0 for a rigid one.
    fn softness(&self, dof: usize) -> f64 {
        self.softness.get(dof).map_or(0.0, |of| of[usize::from(self.sides[dof] == BoundStatus::Upper)])
    }

    /// Solves R_AA s = b for the dofs A in contact in the last answer, in place. The compliance of
    /// bounds that yield is part of R.
    pub fn solve_active(&self, values: &mut Mat<f64>) {
        if let Some(llt) = &self.factor {
            llt.solve_in_place(values);
        }
    }

    /// Saves or restores the active set of the last answer and the count of factorisations.
    ///
    /// # Errors
    /// Returns the errors of [`Archive::value`].
    pub fn archive(&mut self, compliance: &Mat<f64>, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.sides)?;
        if !self.softness.is_empty() {
            archive.value(&mut self.softness)?;
        }
        if !archive.saves() {
            self.factor_active(compliance);
        }
        archive.value(&mut self.factorisations)
    }

    /// Factors the compliance of the dofs in contact, unless they are those of the last factor.
    fn factor_active(&mut self, compliance: &Mat<f64>) {
        self.active.clear();
        self.active.extend((0..self.sides.len()).filter(|&i| self.sides[i] != BoundStatus::Free));
        let soft: Vec<(usize, f64)> = self.active.iter().map(|&i| (i, self.softness(i))).collect();
        if soft == self.factored {
            return;
        }
        let block = Mat::from_fn(soft.len(), soft.len(), |i, j| {
            let ((row, softness), (column, _)) = (soft[i], soft[j]);
            compliance[(row, column)] + if i == j { softness } else { 0.0 }
        });
        self.factor = block.llt(Triangle::Lower).ok();
        self.factored = soft;
        self.factorisations += 1;
    }
}
