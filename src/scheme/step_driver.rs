//! Solution of one step, the same for every scheme that has a step matrix.
//!
//! A scheme supplies the matrix A and its [`Formulas`]: the right-hand side b and the bounded
//! configuration that the unknown x leads to. The [`StepDriver`] adds the modal damping, solves
//!
//! ```math
//! A x = b + G^T r, \qquad x \text{ within its bounds},
//! ```
//!
//! checks the answer, and keeps what the next step starts from. The residuals of past steps may
//! enter the right-hand side, see [`super::feedback`].

use super::coulomb::{CoulombFriction, NodalFriction, Rounds};
use super::drive::ModalDamping;
use super::feedback::Feedback;
use super::quadratisation::{RankOne, RootSearch};
use super::sliding::Sliding;
use super::stop_dashpots::StopDashpots;
use super::{StepBalance, StepRecord, System};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{axpy, dot_of_sum, is_zero, largest, waxpy};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::vi::{Answer, CheckedSolver, Problem, Solver, StepReport, StiffnessProduct};
use faer::Mat;

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

    /// Returns a known vector d of the step, one entry per dof: an increment (m) or a velocity
    /// (m/s).
    fn known(&self) -> &[f64];

    /// Returns the weights c and s of x and d in the bounded configuration `$U^n + c\,x + s\,d$`.
    fn bounded_configuration(&self) -> [f64; 2];

    /// Returns the weights of x and d in the displacement over which the forces of the step do
    /// their work.
    fn displacement_of_forces(&self) -> [f64; 2];

    /// Returns the term that [stretching](super::quadratisation) adds to the step matrix; `None`
    /// for a plate that only bends.
    fn stretching(&self) -> Option<RankOne<'_>>;
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
    /// Search for the force of stretching.
    root_search: RootSearch,
    /// Sliders; `None` where no rank has any.
    pub sliding: Option<Sliding>,
    /// Friction of obstacles; `None` where none has any.
    pub friction: Option<CoulombFriction<'s>>,
    /// Dashpots of stops; `None` where no rank has any.
    pub dashpots: Option<StopDashpots<'s>>,
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
    pub report: StepReport,
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
            root_search: RootSearch::default(),
            sliding: None,
            friction: None,
            dashpots: StopDashpots::new(system),
            bounds: bounds.clone(),
            modal_velocities: None,
            damped: None,
            x: vec![0.0; engine.dofs()],
            reaction: vec![0.0; bounds.len()],
            report: StepReport::default(),
        })
    }

    /// Feeds residuals forward from the first step on, where rounding spoils the factored matrix;
    /// the plate has an energy, in J.
    pub fn feed_residuals_forward(&mut self, energy: f64) {
        if self.solver.may_feed() {
            self.feedback = Some(Feedback::new(self.x.len(), energy));
        }
    }

    /// Takes note of an energy of the plate, in J.
    pub fn note_energy(&mut self, energy: f64) {
        self.feedback.iter_mut().for_each(|feedback| feedback.note_energy(energy));
    }

    /// Returns the product K x of the last step, in N, one entry per dof, which the next step
    /// replaces; `None` where it is not accurate enough to be summed over steps, or the engine does
    /// not compute it with the check of the answer.
    pub fn stiffness_product(&mut self) -> Option<&mut Vec<f64>> {
        self.has_product.then_some(&mut self.product)
    }

    /// Solves a step.
    ///
    /// # Errors
    /// Returns the errors of the formulas and of the solver.
    pub fn solve(&mut self, formulas: &mut impl Formulas<E>) -> Result<()> {
        formulas.right_hand_side(&mut self.b)?;
        self.damp_modes(formulas)?;
        let may_feed = self.solver.may_feed();
        let begin = |feedback: &mut Feedback| feedback.begin_step(may_feed, &mut self.b);
        let feeds = self.feedback.as_mut().is_some_and(begin);
        self.solver.set_feeding(feeds);
        self.solve_for_right_hand_side(formulas)?;
        if may_feed && self.feedback.is_some() {
            self.take_residual(formulas, feeds)?;
        }
        self.slip(formulas);
        Ok(())
    }

    /// Prepares sliders before the first step, relaxed and anchored at displacements (m), see
    /// [`Sliding::new`].
    pub fn begin_sliding(&mut self, u: &[f64], extent: f64) {
        let sliders = self.system.drive.sliders.as_ref();
        self.sliding = sliders.map(|sliders| Sliding::new(sliders, &self.bounds, u, extent));
    }

    /// Prepares the friction of obstacles for steps whose bounded configuration lies after a share
    /// of the step.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn begin_friction(&mut self, share: f64) -> Result<()> {
        let System { engine, drive, .. } = self.system;
        let friction = |given| CoulombFriction::new(given, engine, &self.matrix, &self.bounds, share);
        self.friction = drive.friction.as_ref().map(friction).transpose()?;
        Ok(())
    }

    /// Computes the paths of obstacles with friction between two instants (s), a step apart.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the obstacles' velocities.
    pub fn set_obstacle_paths(&mut self, times: [f64; 2]) -> Result<()> {
        let comm = self.system.engine.comm();
        self.friction.as_mut().map_or(Ok(()), |friction| friction.set_paths(comm, times))
    }

    /// Returns the work that obstacles with friction do by their motion, in J, and its present
    /// increment.
    pub fn friction_work(&self) -> [f64; 2] {
        self.friction.as_ref().map_or([0.0; 2], CoulombFriction::work)
    }

    /// Returns the energy that the friction of each obstacle has dissipated, in J.
    pub fn friction_heat(&self) -> Vec<f64> {
        self.friction.as_ref().map_or(Vec::new(), CoulombFriction::heat)
    }

    /// Returns the energy that friction and dashpots of each obstacle have dissipated, in J.
    pub fn heat(&self) -> Vec<f64> {
        let mut heat = self.friction_heat();
        let taken = self.dashpots.iter().flat_map(StopDashpots::taken);
        taken.enumerate().for_each(|(obstacle, taken)| {
            heat.resize(heat.len().max(obstacle + 1), 0.0);
            heat[obstacle] += taken;
        });
        heat
    }

    /// Returns the dofs of this rank's slopes that friction holds, each with its rate in a step of
    /// `dt` seconds.
    pub fn stuck_slopes(&self, dt: f64) -> Vec<(usize, f64)> {
        self.friction.as_ref().map_or(Vec::new(), |friction| friction.stuck_slopes(dt))
    }

    /// Adds the work and the heat of friction to the ledger, for the part gamma of a step that
    /// leads from one displacement to another (m). Collective.
    pub fn add_friction(&mut self, gamma: f64, [from, to]: [&[f64]; 2]) {
        let engine = &self.system.engine;
        let friction = self.friction.iter_mut();
        friction.for_each(|friction| friction.add_step(engine, |dof| to[dof] - from[dof], gamma));
    }

    /// Adds the energy that dashpots of stops take to the ledger, in a step of `dt` seconds that
    /// leads from one displacement to another (m). Collective.
    pub fn add_dashpots(&mut self, dt: f64, [from, to]: [&[f64]; 2]) {
        let dashpots = self.dashpots.iter_mut();
        dashpots.for_each(|dashpots| {
            dashpots.add(&self.system.engine, |dof| to[dof] - from[dof], dt, [0.0, 1.0]);
        });
    }

    /// Writes the moments of friction in the last step into a balance.
    pub fn balance_friction(&self, balance: &mut StepBalance) {
        if let (Some(friction), Some(moments)) = (&self.friction, &mut balance.friction) {
            friction.write_moments(moments);
        }
    }

    /// Returns the friction at this rank's nodes that touched in the last step.
    pub fn friction_at_nodes(&self) -> Vec<NodalFriction> {
        self.friction.as_ref().map_or(Vec::new(), CoulombFriction::at_nodes)
    }

    /// Moves the anchors of the sliders by the answer to a step.
    fn slip(&mut self, formulas: &impl Formulas<E>) {
        let StepDriver { sliding: Some(sliding), bounds, x, reaction, .. } = self else { return };
        let ([c, s], u, d) = (formulas.bounded_configuration(), formulas.displacement(), formulas.known());
        sliding.slip(bounds, reaction, |dof| u[dof] + (c * x[dof] + s * d[dof]), |dof| u[dof]);
    }

    /// Takes what the answer to a step misses, for the steps after it. Where its right-hand side
    /// was reduced and too much is missing, the step is solved again by itself. Collective.
    fn take_residual(&mut self, formulas: &impl Formulas<E>, was_reduced: bool) -> Result<()> {
        let mut work = self.missing_work(formulas)?;
        let Some(feedback) = &mut self.feedback else { return Ok(()) };
        if !was_reduced {
            feedback.take(self.solver.uncorrected_residual());
        } else if !feedback.fails(self.report.kkt, work) {
            feedback.take(self.solver.residual());
        } else {
            feedback.withdraw(self.solver.residual(), &mut self.b);
            self.solver.set_feeding(false);
            let retries = self.report.retries;
            self.solve_for_right_hand_side(formulas)?;
            self.report.retries += retries + 1;
            work = self.missing_work(formulas)?;
        }
        self.feedback.iter_mut().for_each(|feedback| feedback.work += work);
        Ok(())
    }

    /// Returns the work of what the equation of the step misses, in J. Collective.
    fn missing_work(&self, formulas: &impl Formulas<E>) -> Result<f64> {
        let weights = formulas.displacement_of_forces();
        self.system.total(dot_of_sum(self.solver.residual(), weights, [&self.x, formulas.known()]))
    }

    /// Solves a step for the right-hand side b, from which the term of the feedback is subtracted.
    fn solve_for_right_hand_side(&mut self, formulas: &impl Formulas<E>) -> Result<()> {
        let System { engine, .. } = self.system;
        let limits = formulas.limits();
        // alpha <= U + c x + s d where ((alpha - U) - s d) / c <= x.
        let weights @ [rate, _] = formulas.bounded_configuration();
        self.bounds.pull_back(limits, [formulas.displacement(), formulas.known()], weights);
        self.bounds.laws.rate = rate;
        if let Some(sliding) = &self.sliding {
            let ([c, s], u, d) = (weights, formulas.displacement(), formulas.known());
            sliding.bound(&mut self.bounds, |dof| u[dof] + s * d[dof], c);
        }
        if let Some(friction) = &mut self.friction {
            let ([c, s], u, d) = (weights, formulas.displacement(), formulas.known());
            friction.begin_step(c, |dof| s * d[dof], |dof| u[dof]);
        }
        let length = limits.magnitude().max(limits.largest(formulas.displacement()));
        let Some(term @ RankOne { weight, gradient, scale }) = formulas.stretching() else {
            return self.solve_within_bounds(length);
        };
        let base = self.b.clone();
        let (mut iterations, mut search) = (0, self.root_search);
        let missing = if self.solve_untouched(&term, length)? {
            search = self.root_search;
            engine.dot(gradient, &self.x)? - search.last
        } else {
            search.run(scale, |share| {
                waxpy(-weight * share, gradient, &base, &mut self.b);
                self.solve_within_bounds(length)?;
                iterations += self.report.iterations;
                Ok(engine.dot(gradient, &self.x)? - share)
            })?
        };
        // The force that the root misses counts like any other, beside the one of stretching.
        let steepest = largest(gradient.iter().copied());
        let scale = largest(self.b.iter().copied()).max(scale.abs() * steepest);
        let [force, scale] =
            [weight * missing.abs() * steepest, scale].map(|share| engine.comm().all_reduce_max(share));
        let missing = if force == 0.0 { 0.0 } else { force / scale };
        let kkt = largest([self.report.kkt, missing].into_iter());
        self.report = StepReport { iterations, kkt, ..self.report };
        (self.root_search, self.b) = (search, base);
        Ok(())
    }

    /// Solves a step that stretches for x and its share of the force of stretching at once, where
    /// nothing touches, as nothing did in the step before. Returns whether this succeeded; `length`
    /// is the scale of deflections, in m. Collective.
    fn solve_untouched(&mut self, RankOne { weight, gradient, .. }: &RankOne, length: f64) -> Result<bool> {
        let System { engine, .. } = self.system;
        let touches = self.friction.is_some() || !is_zero(&self.reaction);
        let last = self.root_search.last;
        let mut columns = Mat::from_fn(self.b.len(), 2, |i, j| match j {
            0 => self.b[i] - weight * last * gradient[i],
            _ => gradient[i],
        });
        if engine.comm().all_reduce_any(touches) || !self.solver.solve_without_bounds(&mut columns)? {
            return Ok(false);
        }
        let [x, y] = [0, 1].map(|j| columns.col_as_slice(j));
        let slope = 1.0 + weight * engine.dot(gradient, y)?;
        let change = (engine.dot(gradient, x)? - last) / slope;
        waxpy(-weight * change, y, x, &mut self.x);
        let Bounds { dofs, lower, upper, .. } = &self.bounds;
        let is_inside = |(i, &dof): (usize, &usize)| (lower[i]..=upper[i]).contains(&self.x[dof]);
        if !engine.comm().all_reduce_all(dofs.iter().enumerate().all(is_inside)) {
            return Ok(false);
        }
        axpy(-weight * (last + change), gradient, &mut self.b);
        self.answer_with_moments(length, true)?;
        self.root_search = RootSearch { last: last + change, slope };
        Ok(self.report.kkt <= self.solver.tolerance())
    }

    /// Solves a step within the bounds on x that are set, with the friction of obstacles; `length`
    /// is the scale of deflections, in m.
    fn solve_within_bounds(&mut self, length: f64) -> Result<()> {
        let Some(mut friction) = self.friction.take() else { return self.answer_with_moments(length, false) };
        let solved = self.solve_with_friction(&mut friction, length);
        self.friction = Some(friction);
        solved
    }

    /// Alternates between the step with given moments of friction and their law.
    fn solve_with_friction(&mut self, friction: &mut CoulombFriction, length: f64) -> Result<()> {
        let System { engine, .. } = self.system;
        let (base, mut report) = (self.b.clone(), StepReport::default());
        let rounds = Rounds::run(|rounds| {
            self.b.copy_from_slice(&base);
            friction.add_moments(&mut self.b);
            self.answer_with_moments(length, false)?;
            report = StepReport { kkt: self.report.kkt, ..report.and(self.report) };
            friction.improve(engine, &self.matrix, &self.bounds, [&*self.x, &*self.reaction], rounds)
        });
        self.b = base;
        let Rounds { error, iterations, .. } = rounds?;
        let kkt = largest([report.kkt, error].into_iter());
        self.report = StepReport { iterations: report.iterations + iterations, kkt, ..report };
        Ok(())
    }

    /// Solves a step within the bounds on x that are set, whose right-hand side has the moments of
    /// friction, or measures the present answer.
    fn answer_with_moments(&mut self, length: f64, is_given: bool) -> Result<()> {
        let System { engine, stiffness, .. } = self.system;
        let problem = Problem { matrix: &self.matrix, rhs: &self.b, bounds: &self.bounds, length };
        let mut answer = Answer { x: &mut self.x, reaction: &mut self.reaction };
        let more = self.feedback.as_ref().and_then(Feedback::term);
        let mut product = StiffnessProduct { stiffness, product: &mut self.product, is_known: false };
        let (more, solver) = (more.as_slice(), &mut self.solver);
        self.report = match is_given {
            false => solver.solve_step(engine, &problem, more, &mut answer, Some(&mut product))?,
            true => StepReport {
                kkt: solver.measure(engine, &problem, more, &answer, Some(&mut product))?,
                ..StepReport::default()
            },
        };
        self.has_product = product.is_known && self.solver.has_accurate_products;
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

    /// Sets the bounded configuration of the last step, in m, one entry per bound, given the
    /// formulas of that step.
    pub fn restrict(&self, formulas: &impl Formulas<E>, admissible: &mut [f64]) {
        let [c, s] = formulas.bounded_configuration();
        formulas.limits().dofs.map(
            [formulas.displacement(), &self.x, formulas.known()],
            [],
            [admissible],
            #[inline(always)]
            |[u, x, d], []| [u + (c * x + s * d)],
        );
    }

    /// Writes the bounded configuration and the report of the last step into a record, given the
    /// formulas of that step.
    pub fn report_to(&self, formulas: &impl Formulas<E>, record: &mut StepRecord) {
        self.restrict(formulas, &mut record.admissible);
        record.report = self.report;
    }

    /// Saves or restores all that the next step depends on.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit, and the errors of the
    /// solver.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.root_search)?;
        archive.value(&mut self.modal_velocities)?;
        archive.value(&mut self.damped)?;
        self.feedback.as_mut().map_or(Ok(()), |feedback| feedback.archive(archive))?;
        let bounds = self.bounds.len();
        self.sliding.as_mut().map_or(Ok(()), |sliding| sliding.archive(bounds, archive))?;
        self.friction.as_mut().map_or(Ok(()), |friction| friction.archive(bounds, archive))?;
        self.dashpots.as_mut().map_or(Ok(()), |dashpots| dashpots.archive(archive))?;
        self.solver.archive(&self.system.engine, &self.matrix, &self.system.bounds, archive)
    }

    /// Returns the number of numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
