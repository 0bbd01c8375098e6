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
//! The solution exists and is unique. Each iteration needs the factor of the block of R of the dofs
//! in contact only. These dofs are few, and the factor is updated for those that join and
//! leave. Bounds that yield add to the diagonal of R, as `laws.rs` beside this file tells.

mod active_factor;
mod laws;

use super::active_set::{BoundStatus, BoundValues, Exchange, broken};
use crate::archive::Archive;
use crate::contact_law::Laws;
use crate::error::Result;
use crate::kernels::wide::widest;
use crate::linalg::vectors::largest;
use active_factor::ActiveFactor;
use faer::Mat;
use pulp::Arch;

/// Solver of the problem in compliance form, warm-started from its last active set; see the
/// [module page](self).
#[derive(Debug, Clone, Default)]
pub struct ComplianceSolver {
    /// Contact status of each bounded dof in the last answer.
    pub sides: Vec<BoundStatus>,
    /// Dofs in contact in the last answer, in the order in which they joined, and the factor of
    /// their compliance.
    pub(crate) active: Vec<usize>,
    factor: ActiveFactor,
    /// Reactions of the dofs in contact, in N, in the order of the factor.
    forces: Vec<f64>,
    /// Compliances of the lower and the upper bound of each dof in the last answer, in m/N, 0 for
    /// rigid ones; empty if no bound yields.
    softness: Vec<[f64; 2]>,
    /// Number of factors so far, each of other dofs than the last.
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
    /// Laws by which the bounds yield; `None` where all are rigid.
    pub laws: Option<&'a Laws>,
    /// Compliances of bounds without laws, which join the diagonal of R, in m/N; empty where there
    /// are none.
    pub softness: &'a [f64],
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

    /// Solves for the deflections x (m) and reactions r (N). Entries are NaN where the compliance
    /// of the dofs in contact is not positive definite to rounding.
    pub fn solve(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        if !problem.softness.is_empty() {
            self.softness.clear();
            self.softness.extend(problem.softness.iter().map(|softness| [*softness; 2]));
        }
        match problem.laws.filter(|laws| !laws.are_rigid()) {
            None => self.solve_rigid(problem, x, reaction),
            Some(laws) => self.solve_yielding(problem, laws, x, reaction),
        }
    }

    /// Solves the problem with bounds that are rigid but for their own compliance.
    fn solve_rigid(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        let ComplianceProblem { compliance, free, lower, upper, .. } = problem;
        let mut rule = Exchange::new(free.len());
        (self.iterations, self.residual) = (0, 0.0);
        for (i, side) in self.sides.iter_mut().enumerate() {
            *side = side.within(lower[i], upper[i]);
        }
        loop {
            reaction.fill(0.0);
            x.copy_from_slice(free);
            if !self.factor_active(compliance) {
                self.residual = f64::INFINITY;
                self.active.iter().for_each(|&i| reaction[i] = f64::NAN);
                x.fill(f64::NAN);
                return;
            }
            self.hold(problem, x, reaction);
            let values = BoundValues { lower, upper, x, reaction, magnitude: &self.magnitude };
            let broken = broken(&self.sides, values);
            if !rule.advance(&mut self.sides, &broken) {
                break;
            }
            self.iterations = rule.iterations;
        }
    }

    /// Computes the reactions that hold the dofs in contact at their bounds, and adds the
    /// deflections by them.
    fn hold(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        if self.active.is_empty() {
            return;
        }
        let ComplianceProblem { compliance, free, lower, upper, .. } = problem;
        let held = |i: usize, side: BoundStatus| if side == BoundStatus::Upper { upper[i] } else { lower[i] };
        let ComplianceSolver { sides, active, factor, forces, magnitude, .. } = self;
        forces.clear();
        forces.extend(active.iter().map(|&i| held(i, sides[i]) - free[i]));
        factor.solve(forces);
        let largest = largest(forces.iter().copied());
        for (&i, force) in active.iter().zip(&*forces) {
            (reaction[i], magnitude[i]) = (*force, largest);
        }
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                let size = x.len();
                for (&i, force) in active.iter().zip(&*forces) {
                    let column = &compliance.col_as_slice(i)[..size];
                    for k in 0..size {
                        x[k] += force * column[k];
                    }
                }
            },
        );
        self.residual = 0.0;
        for &i in &self.active {
            let bound = held(i, self.sides[i]) - self.softness(i) * reaction[i];
            self.residual = self.residual.max((x[i] - bound).abs());
            x[i] = bound;
        }
    }

    /// Returns the compliance of the bound that a dof is at, in m/N; 0 for a rigid one.
    fn softness(&self, dof: usize) -> f64 {
        self.softness.get(dof).map_or(0.0, |sides| sides[usize::from(self.sides[dof] == BoundStatus::Upper)])
    }

    /// Solves R_AA s = b for the dofs A in contact in the last answer, in place and in their order.
    /// The compliance of bounds that yield is part of R.
    pub fn solve_active(&self, values: &mut [f64]) {
        self.factor.solve(values);
    }

    /// Saves or restores the active set of the last answer with its factor, and the count of
    /// factors.
    ///
    /// # Errors
    /// Returns the errors of [`Archive::value`].
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.sides)?;
        if !self.softness.is_empty() {
            archive.value(&mut self.softness)?;
        }
        archive.value(&mut self.factor)?;
        archive.value(&mut self.active)?;
        archive.value(&mut self.factorisations)
    }

    /// Lists the dofs in contact, and factors their compliance. Returns whether there is a factor.
    fn factor_active(&mut self, compliance: &Mat<f64>) -> bool {
        let soft = |i: usize| (i, self.softness(i));
        let is_active = |i: &usize| self.sides[*i] != BoundStatus::Free;
        let wanted: Vec<(usize, f64)> = (0..self.sides.len()).filter(is_active).map(soft).collect();
        let mut is_definite = true;
        if !self.factor.is_of(&wanted) {
            is_definite = self.factor.follow(&wanted, compliance);
            self.factorisations += 1;
        }
        self.active.clear();
        match is_definite {
            true => self.active.extend(self.factor.dofs()),
            false => self.active.extend(wanted.iter().map(|(dof, _)| *dof)),
        }
        is_definite
    }
}
