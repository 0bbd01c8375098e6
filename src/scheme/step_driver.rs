//! Solution of one step, the same for every scheme that has a step matrix.
//!
//! A scheme supplies the matrix A and its [`Formulas`]: the right-hand side b, the bounds on the
//! unknown x, and the bounded configuration that x leads to. The [`StepDriver`] adds the modal
//! damping, solves
//!
//! ```math
//! A x = b + G^T r, \qquad x \text{ within its bounds},
//! ```
//!
//! checks the answer, and keeps what the next step starts from.
//!
//! # Residuals fed forward
//!
//! Rounding the entries of A spoils the slow motions of fine meshes: the answer to a right-hand
//! side leaves a residual `$\delta = A x - b - G^T r$`, with a relative error `$\varepsilon$` of x
//! that [`Engine::estimate_factor_error`] tells. In place of a correction within the step, the step
//! from `$U^n$` is solved for `$b^n - 2 \delta^{n-1} + \delta^{n-2}$`. What its equation misses is
//! then
//!
//! ```math
//! A x - b^n - G^T r = \delta^n - 2 \delta^{n-1} + \delta^{n-2} .
//! ```
//!
//! The sums of these impulses, and the sums of the sums, do not grow with the number of steps: a
//! motion of frequency `$\omega$` keeps `$(\omega \Delta t)^2 \varepsilon$` of the error, and at
//! most `$4 \varepsilon$` where `$\omega \Delta t$` is large. Up to `$\varepsilon$` = 1e-10 no
//! answer is corrected within its step: motions with `$\omega \Delta t \le 0.5$` keep 3e-11, as if
//! they were, and no motion keeps as much as the 1e-9 that promises on the energy allow. Above it,
//! answers are corrected within the step and nothing is fed forward, nor where A is factored with
//! twice the digits: there rounding errors of the products themselves, fed forward, change the
//! energy by 5e-8 in a step (cells of aspect ratio 1000). A step whose forces are so much smaller
//! than those before it that its residual is above [`MAX_FED_RESIDUAL`], as in rigid flight, is
//! solved again by itself.

use super::drive::ModalDamping;
use super::{StepRecord, System};
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::vectors::{add, subtract, waxpby};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::vi::{Answer, CheckedSolver, Problem, Solver, StepReport, StiffnessProduct};

/// KKT residual above which a step that fed residuals forward is solved again without them,
/// dimensionless.
const MAX_FED_RESIDUAL: f64 = 1e-11;

/// Formulas of a scheme for the step from `$U^n$`.
pub(super) trait Formulas<E: Engine> {
    /// Returns `$U^n$`, in m, one entry per dof.
    fn displacement(&self) -> &[f64];

    /// Returns the bounds on the bounded configuration of the step, in m.
    fn limits(&self) -> &Bounds;

    /// Sets b, in N, one entry per dof, without modal damping.
    fn right_hand_side(&mut self, b: &mut [f64]) -> Result<()>;

    /// Returns the velocity that modal damping acts on, in modal coordinates. Collective.
    fn modal_velocities(&self, modal: &ModalDamping) -> Result<Vec<f64>>;

    /// Returns the bound on x, in m, that a bound `alpha` (m) on the bounded configuration implies
    /// at a dof.
    fn bound_on_unknown(&self, alpha: f64, dof: usize) -> f64;

    /// Returns the bounded configuration, in m, that the unknown x (m) leads to at a dof.
    fn bounded_configuration(&self, x: f64, dof: usize) -> f64;

    /// Returns the derivative of the bounded configuration with respect to x.
    fn rate_of_configuration(&self) -> f64;
}

/// Solver of the steps of one scheme, with the answer to the last step.
pub(super) struct StepDriver<'s, E: Engine> {
    pub system: &'s System<E>,
    matrix: LinearCombination<'s>,
    solver: CheckedSolver<E>,
    b: Vec<f64>,
    /// Product K x, in N, one entry per dof, and whether the last step gave it.
    product: Vec<f64>,
    has_product: bool,
    feedback: Option<Feedback>,
    /// Bounds on x, in m.
    bounds: Bounds,
    /// Modal velocities of the last step, present after the first step with modal damping.
    modal_velocities: Option<Vec<f64>>,
    /// Modal velocities that the damping of the last step acted on.
    pub damped: Option<Vec<f64>>,
    /// Unknown x, in m, one entry per dof.
    pub x: Vec<f64>,
    /// Reactions r, in N, one entry per bound.
    pub reaction: Vec<f64>,
    /// Bounded configuration, in m, one entry per bound.
    pub admissible: Vec<f64>,
    pub report: StepReport,
}

/// Residuals of the last two steps, which the right-hand side of the next one makes up for.
#[derive(Debug)]
struct Feedback {
    /// Residuals `$\delta_{n-1}$` and `$\delta_{n-2}$`, each of the right-hand side that was solved
    /// for, in N, one entry per dof.
    residuals: [Vec<f64>; 2],
    /// Term `$2 \delta_{n-1} - \delta_{n-2}$` that the right-hand side of a step is reduced by, in N.
    term: Vec<f64>,
}

impl Feedback {
    fn new(dofs: usize) -> Feedback {
        Feedback { residuals: [vec![0.0; dofs], vec![0.0; dofs]], term: vec![0.0; dofs] }
    }

    /// Reduces the right-hand side of a step.
    fn apply(&mut self, b: &mut [f64]) {
        let [last, earlier] = &self.residuals;
        waxpby(2.0, last, -1.0, earlier, &mut self.term);
        subtract(&self.term, b);
    }

    /// Forgets the residuals.
    fn clear(&mut self) {
        let [last, earlier] = &mut self.residuals;
        [last, earlier, &mut self.term].into_iter().for_each(|vector| vector.fill(0.0));
    }

    /// Takes the residual of the step for the right-hand side without the reduction.
    fn take(&mut self, residual: &[f64]) {
        self.residuals.swap(0, 1);
        waxpby(1.0, residual, 1.0, &self.term, &mut self.residuals[0]);
    }
}

impl<'s, E: Engine> StepDriver<'s, E> {
    /// Prepares steps of `dt` seconds with a solver for the step matrix.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] where the step is too long for a damped mode, and the errors
    /// of the engine.
    pub fn new(
        system: &'s System<E>,
        matrix: LinearCombination<'s>,
        dt: f64,
        solver: Box<dyn Solver<E>>,
    ) -> Result<StepDriver<'s, E>> {
        let System { engine, bounds, drive, .. } = system;
        if let Some(modal) = &drive.modal {
            modal.check(dt)?;
        }
        Ok(StepDriver {
            system,
            solver: CheckedSolver::new(solver, engine, &matrix)?,
            matrix,
            b: vec![0.0; engine.dofs()],
            product: vec![0.0; engine.dofs()],
            has_product: false,
            feedback: None,
            bounds: bounds.clone(),
            modal_velocities: None,
            damped: None,
            x: vec![0.0; engine.dofs()],
            reaction: vec![0.0; bounds.len()],
            admissible: vec![0.0; bounds.len()],
            report: StepReport::default(),
        })
    }

    /// Feeds residuals forward from the next step on, where rounding spoils the factored matrix.
    pub fn feed_residuals_forward(&mut self) {
        self.set_feedback(self.solver.may_feed());
    }

    fn set_feedback(&mut self, feeds: bool) {
        self.feedback = feeds.then(|| Feedback::new(self.x.len()));
        self.solver.set_feeding(feeds);
    }

    /// Returns the product K x of the last step, in N, one entry per dof; `None` where it is not
    /// accurate enough to be summed over steps, or the engine does not compute it with the check of
    /// the answer.
    pub fn stiffness_product(&self) -> Option<&[f64]> {
        self.has_product.then_some(&self.product)
    }

    /// Solves a step.
    ///
    /// # Errors
    /// Returns the errors of the formulas and of the solver.
    pub fn solve(&mut self, formulas: &mut impl Formulas<E>) -> Result<()> {
        formulas.right_hand_side(&mut self.b)?;
        self.damp_modes(formulas)?;
        if let Some(feedback) = &mut self.feedback {
            feedback.apply(&mut self.b);
        }
        self.solve_for_right_hand_side(formulas)?;
        let is_poor = self.report.kkt.is_nan() || self.report.kkt > MAX_FED_RESIDUAL;
        if let Some(feedback) = self.feedback.as_mut().filter(|_| is_poor) {
            // Beside the small forces of this step, the residuals of the last ones are no rounding.
            add(&feedback.term, &mut self.b);
            feedback.clear();
            self.solver.set_feeding(false);
            let retries = self.report.retries;
            self.solve_for_right_hand_side(formulas)?;
            self.report.retries += retries + 1;
            self.solver.set_feeding(true);
        }
        if let Some(feedback) = &mut self.feedback {
            feedback.take(self.solver.residual());
        }
        for (z, &dof) in self.admissible.iter_mut().zip(&formulas.limits().dofs) {
            *z = formulas.bounded_configuration(self.x[dof], dof);
        }
        Ok(())
    }

    /// Solves a step for the right-hand side b, from which the term of the feedback is subtracted.
    fn solve_for_right_hand_side(&mut self, formulas: &impl Formulas<E>) -> Result<()> {
        let System { engine, .. } = self.system;
        let limits = formulas.limits();
        self.bounds.shift(limits, |dof, alpha| formulas.bound_on_unknown(alpha, dof));
        self.bounds.scale_stiffness(limits, formulas.rate_of_configuration());
        let problem = Problem {
            matrix: &self.matrix,
            rhs: &self.b,
            bounds: &self.bounds,
            length: self.system.length(limits, formulas.displacement())?,
        };
        let mut answer = Answer { x: &mut self.x, reaction: &mut self.reaction };
        let more = self.feedback.as_ref().map(|feedback| feedback.term.as_slice());
        let mut product = StiffnessProduct {
            stiffness: &self.system.stiffness,
            product: &mut self.product,
            is_known: false,
        };
        self.report =
            self.solver.solve_step(engine, &problem, more.as_slice(), &mut answer, Some(&mut product))?;
        self.has_product = product.is_known && self.solver.has_accurate_products();
        Ok(())
    }

    /// Subtracts the modal damping force, with the velocity extrapolated from the last two steps.
    fn damp_modes(&mut self, formulas: &impl Formulas<E>) -> Result<()> {
        let Some(modal) = &self.system.drive.modal else { return Ok(()) };
        let now = formulas.modal_velocities(modal)?;
        let before = self.modal_velocities.as_ref().unwrap_or(&now);
        let extrapolated: Vec<f64> =
            now.iter().zip(before).map(|(now, before)| 1.5 * now - 0.5 * before).collect();
        modal.subtract_damping(extrapolated.iter().copied(), &mut self.b);
        self.damped = Some(extrapolated);
        self.modal_velocities = Some(now);
        Ok(())
    }

    /// Makes the modal velocities of these formulas those of the last step.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn restart_modal_damping(&mut self, formulas: &impl Formulas<E>) -> Result<()> {
        let modal = self.system.drive.modal.as_ref();
        self.modal_velocities = modal.map(|modal| formulas.modal_velocities(modal)).transpose()?;
        Ok(())
    }

    /// Copies the answer to the last step into a record.
    pub fn report_to(&self, record: &mut StepRecord) {
        record.admissible.copy_from_slice(&self.admissible);
        record.reaction.copy_from_slice(&self.reaction);
        record.report = self.report;
    }

    /// Saves or restores all that the next step depends on.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit, and the errors of the
    /// solver.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.modal_velocities)?;
        archive.value(&mut self.damped)?;
        let mut feeds = self.feedback.is_some();
        archive.value(&mut feeds)?;
        if !archive.saves() {
            self.set_feedback(feeds);
        }
        for residual in self.feedback.iter_mut().flat_map(|feedback| &mut feedback.residuals) {
            archive.vector(VectorKind::Dofs, residual)?;
        }
        self.solver.archive(&self.system.engine, &self.matrix, &self.system.bounds, archive)
    }

    /// Returns the number of numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
