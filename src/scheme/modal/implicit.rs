//! Implicit rules for the modes, in place of the splitting: the midpoint rule and the Newmark
//! scheme.
//!
//! The matrix of an implicit step, `$a M + b K$` besides damping, is diagonal in the modes and a
//! multiple of K on the rest of the displacement. A step is therefore a problem [in compliance
//! form](crate::vi::compliance) at the candidates, with
//!
//! ```math
//! S = A\, \mathrm{diag}\Bigl( \frac{1}{a + b\,w^2 + c\,d} \Bigr) A^T + \frac{1}{b} R ,
//! ```
//!
//! where d are the decay rates of the modes and c = 2 / dt or 1 / (2 dt). A step costs the products
//! of the candidates with the modes, on any mesh. [`midpoint`](super::midpoint) and
//! [`newmark`](super::newmark) tell the formulas. Since they move the modes otherwise than freely,
//! the certificates of [`super::reach`] are tested after each step.

use super::contact_model::{ContactModel, extended};
use super::coordinates::Coordinates;
use super::limits::Limits;
use super::state::State;
use crate::archive::Archive;
use crate::error::Result;
use crate::linalg::Engine;
use crate::scheme::NewmarkParameters;
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver};
use faer::Mat;

/// Formulas of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum StepRule {
    /// Exact motion between kicks of the reactions, which needs no matrix.
    Splitting,
    /// Midpoint rule.
    Midpoint,
    /// Newmark scheme.
    Newmark(NewmarkParameters),
}

/// Rule of the steps with its matrices, and the answer to the last implicit step.
pub(super) struct Implicit {
    pub rule: StepRule,
    /// Inverse of the step matrix on the modes.
    pub inverse: Vec<f64>,
    /// Weight 1 / b of the compliance of the rest.
    rest: f64,
    /// Compliance S of the candidates, in m/N.
    compliance: Mat<f64>,
    pub contact: ComplianceSolver,
    /// Bounded configuration at the candidates, in m, and reactions of the step, in N.
    pub x: Vec<f64>,
    pub reaction: Vec<f64>,
    /// State at the instant n + 1 of the Newmark scheme.
    pub next: State,
    /// Modal force of the step.
    pub force: Vec<f64>,
    /// Energies stored in bounds that yield in the bounded configurations of the Newmark scheme at
    /// the instants n and n + 1, in J.
    pub stored: [f64; 2],
    /// Work of data in time up to the instant n, and its increment there, in J.
    pub work: [f64; 2],
}

impl Implicit {
    /// Prepares steps of `dt` seconds, for modes of given squared frequencies ((rad/s)^2) and decay
    /// rates (1/s).
    pub fn new(rule: StepRule, dt: f64, squares: &[f64], decays: &[f64]) -> Implicit {
        let [of_mass, of_stiffness, of_rate] = match rule {
            StepRule::Newmark(parameters) => parameters.matrix_weights(),
            _ => [4.0 / (dt * dt), 1.0, 2.0 / dt],
        };
        let inverse = |(square, decay)| 1.0 / (of_mass + of_stiffness * square + of_rate * decay);
        Implicit {
            rule,
            inverse: squares.iter().zip(decays).map(inverse).collect(),
            rest: 1.0 / of_stiffness,
            compliance: Mat::new(),
            contact: ComplianceSolver::new(0),
            x: Vec::new(),
            reaction: Vec::new(),
            next: State::default(),
            force: Vec::new(),
            stored: [0.0; 2],
            work: [0.0; 2],
        }
    }

    /// Computes the compliance of more candidates beside the `old` ones, given the mode shapes of
    /// all in columns.
    pub fn extend(&mut self, model: &ContactModel, rows: &Mat<f64>, old: &[usize]) {
        if self.rule == StepRule::Splitting {
            return;
        }
        let scaled = Mat::from_fn(rows.nrows(), rows.ncols(), |k, i| self.inverse[k] * rows[(k, i)]);
        let sum = rows.transpose() * scaled + &model.compliance * faer::Scale(self.rest);
        self.compliance = Mat::from_fn(sum.nrows(), sum.ncols(), |i, j| 0.5 * (sum[(i, j)] + sum[(j, i)]));
        let last_reaction = |number| old.binary_search(number).map_or(0.0, |k| self.reaction[k]);
        self.reaction = model.candidates.iter().map(last_reaction).collect();
        self.x = vec![0.0; model.candidates.len()];
        self.contact = extended(&self.contact, model, old);
    }

    /// Solves for the reactions that keep the bounded configuration within its limits, given the
    /// one without reactions, in m. The reactions displace it by their `share` of the compliance S.
    pub fn solve(&mut self, share: f64, model: &ContactModel, mut free: Vec<f64>, limits: &Limits) {
        let scaled =
            |deflections: &[f64]| -> Vec<f64> { deflections.iter().map(|value| value / share).collect() };
        free.iter_mut().for_each(|value| *value /= share);
        let (lower, upper) = (scaled(&limits.lower), scaled(&limits.upper));
        // The depth of the unknown is that of the configuration divided by the share.
        let mut laws = model.laws.clone();
        laws.rate = share;
        let problem = ComplianceProblem {
            free: &free,
            lower: &lower,
            upper: &upper,
            compliance: &self.compliance,
            laws: Some(&laws),
            softness: &[],
        };
        self.contact.solve(problem, &mut self.x, &mut self.reaction);
        let sides = self.contact.sides.iter().enumerate();
        for ((i, side), x) in sides.zip(&mut self.x) {
            *x = match side {
                _ if model.laws.pressed(i, self.reaction[i]).is_some() => *x * share,
                BoundStatus::Free => *x * share,
                BoundStatus::Lower => limits.lower[i],
                BoundStatus::Upper => limits.upper[i],
            };
        }
    }

    /// Saves or restores what the next step depends on. Collective.
    pub fn archive<E: Engine>(&mut self, archive: &mut Archive, modal: &Coordinates<E>) -> Result<()> {
        if self.rule == StepRule::Splitting {
            return Ok(());
        }
        archive.value(&mut self.reaction)?;
        archive.value(&mut self.work)?;
        if self.contact.yields() {
            archive.value(&mut self.stored)?;
        }
        if let StepRule::Newmark(_) = self.rule {
            self.next.archive(archive, modal)?;
        }
        self.contact.archive(archive)
    }
}
