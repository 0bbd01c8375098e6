//! Reduced potential `$\varphi(p)$` of the cell means p of the deflection, and its minimiser U(p).
//!
//! With the singular mass `$M = B^T C^{-1} B$` (paper, section 3) only `$p = C^{-1} B U$` has
//! inertia. The rest of U, the *massless* part in the kernel of B, minimises the elastic energy at
//! every instant:
//!
//! ```math
//! \varphi(p) = \min \{ \tfrac12 U^T K U - F^T U \;:\; B U = C p,\; l \le G U \le u \}, \qquad
//! U(p) \text{ its minimiser}.
//! ```
//!
//! The semi-discrete impact problem (paper, equation 5) is then the ordinary differential equation
//!
//! ```math
//! C \ddot p = -\nabla \varphi(p), \qquad \nabla \varphi(p) = C \lambda \text{ where } K U - F -
//! G^T r = B^T \lambda .
//! ```
//!
//! - *U(p) is unique*, since K is positive definite on the kernel of B.
//! - *`$\varphi$` is convex*, as the minimum over U of a function convex in (p, U).
//! - *`$\varphi$` is `$C^{1,1}$`*. While the set of active bounds does not change, U and
//!   `$\lambda$` are affine in p. The pieces are finitely many polyhedra, and U, being unique,
//!   agrees where they meet. `$\lambda$` is unique because the reactions r are: by the inf-sup
//!   condition no combination of active bounds is a combination of rows of B. Hence
//!   `$\nabla\varphi$` is continuous and affine on each piece, and Lipschitz.
//!
//! The equation therefore has exactly one solution. It conserves `$\tfrac12 v^T C v + \varphi(p)$`,
//! its velocity never jumps, and it needs no law of restitution. With time-dependent loads F and
//! bounds l, u, `$\varphi$` and U(p) are those of the instant. Mass-proportional damping alpha M
//! gives `$C (\ddot p + \alpha \dot p) = -\nabla \varphi(p)$`. Stiffness-proportional damping is
//! excluded: the massless part of U then has a rate of its own and is no function of p.
//!
//! # Friction
//!
//! Where nodes touch with friction, the massless rest remembers: U at the end of a step is the
//! minimiser for which the moments obey Coulomb's law, for the slip of the slopes since the start
//! of the step (`scheme/coulomb.rs`). Slopes that stick keep their place, and the moments of slopes
//! that slide follow their reactions.
//!
//! # Computing U(p)
//!
//! U(p) is found by the method of multipliers (Hestenes 1969, Powell 1969): U minimises the energy
//! with the penalty `$\tfrac{s}{2} |p - C^{-1} B U|_C^2$` and an estimate of `$\lambda$`; then
//! `$\lambda$` grows by `$s (p - C^{-1} B U)$`. Each round is one contact solve with the symmetric
//! positive definite matrix K + s M, by the same factor and condensed solver as a time step, on any
//! engine; no saddle-point matrix is factored. A round multiplies the error of p by at most
//! `$\omega^2 / (\omega^2 + s)$`, with `$\omega$` the highest angular frequency of the
//! semi-discrete problem, and its result is U of *its own* p for any `$\lambda$`.
//!
//! The penalty does not limit the accuracy. Every round starts from the residual
//! `$F - K U + B^T \lambda$`, with K applied cell by cell, and corrects the rounding errors of the
//! previous round. Long waves, for which an assembled K loses digits as h^-4, are dominated by s M.
//! Measured on the paper's plate, triangles, from the middle of a step on, with
//! `$s = 10^4 \omega^2$`: the first round leaves an error of 1e-10 (at most 5e-7) of the
//! displacement of p on 10 x 4 cells and 1e-13 (at most 8e-8) on 80 x 32; the second leaves
//! rounding errors. A single round is not enough on fine meshes: with `$s = 10^8 \omega^2$` it
//! meets p at once, but leaves U so far from equilibrium on 80 x 32 cells that energies are wrong
//! by 1e-6.

mod rate;

use super::penalty::PenalisedStiffness;
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, aypx, copy_scaled, largest, scale, subtract, waxpy};
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::scheme::coulomb::{CoulombFriction, Rounds};
use crate::scheme::drive::InstantData;
use crate::scheme::midpoint::MidpointRule;
use crate::scheme::state::{State, SupportVelocities};
use crate::scheme::{StepBalance, System};
use crate::vi::kkt::KktCheck;
use crate::vi::{Answer, BoundStatus, Condensed, Problem, Solver, StepReport};
use std::rc::Rc;

/// Error of `$\lambda$`, relative to its size, before the last round without obstacles.
const MULTIPLIER_TOLERANCE: f64 = 1e-8;
/// Error of p, relative to its displacement, at which the rounds end.
const MEAN_TOLERANCE: f64 = 1e-12;
/// Relative error of p above rounding, from which U(p) is taken not to exist. Observed are about
/// 1e-7 after one round where the inf-sup condition holds, and 1e-6 where a plate carries 1e9 times
/// its own mass.
const MAX_MEAN_ERROR: f64 = 1e-4;
/// Least and largest number of rounds. The second round corrects the rounding errors of the first.
const ROUNDS: std::ops::RangeInclusive<u32> = 2..=40;

/// Solver for U(p); see the [module page](self).
pub struct Potential<'s, E: Engine> {
    system: &'s System<E>,
    /// Penalty s, in 1/s^2.
    penalty: f64,
    /// Matrices K + s M and K.
    sum: LinearCombination<'s>,
    stiffness: LinearCombination<'s>,
    solver: Condensed,
    /// Friction of the nodes that touch, from one state on a line to the next.
    friction: Option<CoulombFriction<'s>>,
    check: KktCheck,
    factorisations: u64,
    bounds: Bounds,
    b: Vec<f64>,
    x: Vec<f64>,
    /// Work vectors per velocity dof: C^-1 B x, the residual of p, and the augmented multiplier, λ
    /// plus s times that residual.
    projected: Vec<f64>,
    residual: Vec<f64>,
    augmented: Vec<f64>,
    /// Last solution: U, λ and reactions.
    u: Vec<f64>,
    multiplier: Vec<f64>,
    reaction: Vec<f64>,
    /// U, λ and residual of p at which the rounds started.
    from: [Vec<f64>; 3],
}

impl<'s, E: Engine> Potential<'s, E> {
    /// Chooses the penalty and factors K + s M.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where K + s M is not positive definite or the highest frequency
    /// cannot be estimated, and [`Error::Usage`] for stiffness-proportional damping.
    pub fn new(system: &'s System<E>) -> Result<Potential<'s, E>> {
        if system.damping.stiffness != 0.0 {
            return Err(Error::Usage(
                "damping.stiffness: the part of the plate without mass then follows its own history, not the rest of the plate; \
                 set time.massless = \"reflected\" with time.scheme = \"midpoint\", or time.scheme = \"newmark\""
                    .into(),
            ));
        }
        system.drive.refuse_dashpots()?;
        Potential::factor(system)
    }

    /// Returns the velocities V of least energy that have the momentum of the support shapes at 1
    /// m/s, one vector per motion.
    ///
    /// The equation M R = B^T V is solved iteratively with K + s M; each iteration leaves the
    /// fraction `$\omega^2 / (\omega^2 + s)$` of a vibration of angular frequency `$\omega$`.
    pub(in crate::scheme) fn support_velocities(system: &System<E>) -> Result<Rc<SupportVelocities>> {
        let System { engine, mass, drive, .. } = system;
        if drive.supports.is_empty() {
            return Ok(Rc::new([]));
        }
        let mut potential = Potential::factor(system)?;
        let Potential { solver, sum, penalty, b, x, projected, .. } = &mut potential;
        let mut image = |momentum: &[f64]| {
            let mut image = vec![0.0; projected.len()];
            for _ in 0..*ROUNDS.end() {
                engine.project_transpose(mass, &image, b)?;
                aypx(-1.0, momentum, b);
                scale(*penalty, b);
                let problem = Problem { matrix: sum, rhs: b, bounds: &Bounds::default(), length: 0.0 };
                solver.solve(engine, &problem, &mut Answer { x, reaction: &mut [] })?;
                engine.project(mass, x, projected)?;
                add(projected, &mut image);
                let [rest_norm, image_norm] =
                    [&*projected, &image].map(|v| engine.mass_norm_squared(mass, v));
                if rest_norm?.sqrt() <= f64::EPSILON * image_norm?.sqrt() {
                    break;
                }
            }
            Ok(image)
        };
        drive.supports.iter().map(|motion| image(&motion.momentum)).collect()
    }

    /// Factors K + s M.
    pub(in crate::scheme) fn factor(system: &'s System<E>) -> Result<Potential<'s, E>> {
        let System { engine, stiffness, mass, bounds, drive, .. } = system;
        let PenalisedStiffness { penalty, sum, solver, factorisations } = PenalisedStiffness::new(system)?;
        let alone = LinearCombination::from(stiffness);
        let friction = |given| CoulombFriction::new(given, engine, &sum, bounds, 1.0);
        let [dofs, velocities] = [engine.dofs(), engine.velocities(mass)].map(|length| vec![0.0; length]);
        Ok(Potential {
            system,
            friction: drive.friction.as_ref().map(friction).transpose()?,
            penalty,
            check: KktCheck::with_inertia(engine, &alone, &sum, 0.0)?,
            sum,
            solver,
            stiffness: alone,
            factorisations,
            bounds: bounds.clone(),
            b: dofs.clone(),
            x: dofs.clone(),
            projected: velocities.clone(),
            residual: velocities.clone(),
            augmented: velocities.clone(),
            u: dofs,
            multiplier: velocities,
            reaction: vec![0.0; bounds.len()],
            from: Default::default(),
        })
    }

    /// Moves a displacement to U(p) of its own `$p = C^{-1} B U$` at `time` (s) and sets the
    /// reactions of the obstacles there, in N.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn settle(&mut self, time: f64, u: &mut [f64], reaction: &mut [f64]) -> Result<StepReport> {
        let instant = self.system.instant(time)?;
        self.settle_at(&instant, u, reaction)
    }

    /// Moves a state to U(p) at its own instant.
    pub(in crate::scheme) fn settle_state(&mut self, state: &mut State) -> Result<StepReport> {
        let State { instant, u, reaction, .. } = state;
        let report = self.settle_at(instant, u, reaction)?;
        state.update_energies(self.system)?;
        Ok(report)
    }

    fn settle_at(
        &mut self,
        instant: &InstantData,
        u: &mut [f64],
        reaction: &mut [f64],
    ) -> Result<StepReport> {
        let System { engine, mass, .. } = self.system;
        self.u.copy_from_slice(u);
        self.multiplier.fill(0.0);
        self.residual.fill(0.0);
        engine.project(mass, &self.u, &mut self.projected)?;
        let increment = engine.mass_norm_squared(mass, &self.projected)?.sqrt();
        let report = self.reach(increment, instant, None)?;
        u.copy_from_slice(&self.u);
        reaction.copy_from_slice(&self.reaction);
        Ok(report)
    }

    /// Moves U to the minimiser of `$\tfrac12 U^T K U - f^T U$` at its own p without obstacles, for
    /// a force f (N, one entry per dof), and sets its `$\lambda$` (m/s^2, one entry per velocity
    /// dof), from an estimate of both. Collective.
    pub(in crate::scheme) fn unobstructed(
        &mut self,
        force: &[f64],
        u: &mut [f64],
        multiplier: &mut [f64],
    ) -> Result<()> {
        let Potential { system, penalty, solver, b, x, projected, residual, augmented, .. } = self;
        let System { engine, stiffness, mass, bounds, .. } = system;
        residual.fill(0.0);
        solver.without_bounds(bounds, |solve| {
            let mut distance = f64::INFINITY;
            for round in 1..=*ROUNDS.end() {
                waxpy(*penalty, residual, multiplier, augmented);
                engine.project_transpose(mass, augmented, x)?;
                engine.multiply(stiffness, u, b)?;
                subtract(b, x);
                add(force, x);
                solve(x)?;
                add(x, u);
                engine.project(mass, x, projected)?;
                subtract(projected, residual);
                axpy(*penalty, residual, multiplier);
                let [missed, size] = [&**residual, &*multiplier].map(|v| engine.mass_norm_squared(mass, v));
                let before = std::mem::replace(&mut distance, missed?.sqrt());
                let reached =
                    *penalty * distance <= MULTIPLIER_TOLERANCE * size?.sqrt() || distance > 0.5 * before;
                if round >= *ROUNDS.start() && reached {
                    break;
                }
            }
            Ok(())
        })
    }

    /// Sets the acceleration of a balance to that of the last solution, `$-\lambda$`, which
    /// contains the damping.
    pub(in crate::scheme) fn set_acceleration(&self, balance: &mut StepBalance) {
        copy_scaled(-1.0, &self.multiplier, &mut balance.acceleration);
    }

    /// Returns the line of states along a solved midpoint step that starts at `time` (s).
    pub(in crate::scheme) fn line<'l>(
        &'l mut self,
        from: &'l State,
        rule: &'l MidpointRule<'s, E>,
        time: f64,
    ) -> Result<Line<'l, 's, E>> {
        Ok(Line {
            potential: self,
            from,
            rule,
            time,
            dissipated_power: rule.dissipated_power()?,
            gamma: None,
            kinetic_slope: None,
            report: StepReport::default(),
            same_piece: false,
        })
    }

    /// Moves the last solution to U(p) at p plus the residual, for the data of one instant. The
    /// solution exists wherever the inf-sup condition holds. `increment` is the norm, by C, of the
    /// whole displacement of p, in m kg^1/2. Nodes with friction slip from a displacement
    /// `slip_from` (m, one entry per dof); without it there is none.
    fn reach(
        &mut self,
        increment: f64,
        instant: &InstantData,
        slip_from: Option<&[f64]>,
    ) -> Result<StepReport> {
        let System { engine, bounds, .. } = self.system;
        let limits = instant.bounds(bounds);
        let length = self.system.length(limits, limits.magnitude(), &self.u);
        for (kept, from) in self.from.iter_mut().zip([&self.u, &self.multiplier, &self.residual]) {
            kept.clone_from(from);
        }
        let (mut report, mut missed) = self.rounds(increment, length, instant, slip_from)?;
        // The penalty gives neighbouring nodes nearly equal flexibility: where both touch, their
        // Schur complement may consist of rounding errors.
        let poor = missed || report.kkt.is_nan() || report.kkt > Solver::<E>::tolerance(&self.solver);
        if poor && self.solver.distrust(engine, &self.sum)? {
            for (kept, to) in self.from.iter().zip([&mut self.u, &mut self.multiplier, &mut self.residual]) {
                to.clone_from(kept);
            }
            let again;
            (again, missed) = self.rounds(increment, length, instant, slip_from)?;
            report = StepReport { iterations: report.iterations + again.iterations, retries: 1, ..again };
        }
        if missed && !bounds.laws.are_rigid() {
            return Err(Error::Singular(
                "no deflection has the means over cells that the motion leads to: a stop with a law of its own is too stiff for \
                 a mass that sits on it or for a ball over a held node, or the inf-sup condition fails on this mesh; set \
                 time.scheme = \"newmark\", or take a finer mesh"
                    .into(),
            ));
        }
        if missed {
            return Err(Error::Singular(
                "no deflection between the obstacles has the means over cells that the motion leads to: the inf-sup \
                 condition fails on this mesh; set time.scheme = \"newmark\", or take quadrilaterals, or a finer mesh"
                    .into(),
            ));
        }
        Ok(report)
    }

    /// Runs the rounds of multipliers. Returns also whether they miss p. `length` is the length
    /// scale of gaps, in m.
    fn rounds(
        &mut self,
        increment: f64,
        length: f64,
        instant: &InstantData,
        slip_from: Option<&[f64]>,
    ) -> Result<(StepReport, bool)> {
        let System { engine, mass, bounds, .. } = self.system;
        let bounds = instant.bounds(bounds);
        let mut report = StepReport { kkt: f64::INFINITY, ..StepReport::default() };
        let (mut distance, mut farthest) = (f64::INFINITY, increment);
        let least = ROUNDS.start() + self.solver.corrections();
        for round in 1..=*ROUNDS.end() {
            waxpy(self.penalty, &self.residual, &self.multiplier, &mut self.augmented);
            engine.project_transpose(mass, &self.augmented, &mut self.x)?;
            self.system.force(&self.u, &mut self.b)?;
            add(&self.x, &mut self.b);
            instant.add_load(&mut self.b);
            self.bounds.shift(bounds, &self.u);
            let (iterations, law_error) = match slip_from {
                Some(from) => self.solve_with_friction(length, from)?,
                None => (self.solve_within_bounds(length)?, 0.0),
            };
            report.iterations += iterations;
            add(&self.x, &mut self.u);
            engine.project(mass, &self.x, &mut self.projected)?;
            subtract(&self.projected, &mut self.residual);
            axpy(self.penalty, &self.residual, &mut self.multiplier);
            farthest = farthest.max(engine.mass_norm_squared(mass, &self.projected)?.sqrt());
            let before =
                std::mem::replace(&mut distance, engine.mass_norm_squared(mass, &self.residual)?.sqrt());
            let reached = distance <= MEAN_TOLERANCE * increment || distance > 0.5 * before;
            if round < least || !reached && round < *ROUNDS.end() {
                continue;
            }
            // Check K U = F + B^T λ + G^T r within the bounds.
            engine.project_transpose(mass, &self.multiplier, &mut self.b)?;
            if let (Some(friction), Some(_)) = (&self.friction, slip_from) {
                friction.add_moments(&mut self.b);
            }
            let [load, varying] =
                [&self.system.load, &instant.load].map(|load| load.as_deref().unwrap_or(&[]));
            let problem = Problem { matrix: &self.stiffness, rhs: &self.b, bounds, length };
            let answer = Answer { x: &mut self.u, reaction: &mut self.reaction };
            let kkt = self.check.residual(engine, &problem, &[load, varying], &answer)?;
            let kkt = largest([kkt, law_error].into_iter());
            let last = std::mem::replace(&mut report.kkt, kkt);
            // Where cell sizes differ much, p converges before U is in equilibrium.
            if kkt <= Solver::<E>::tolerance(&self.solver) || kkt.is_nan() || kkt > 0.5 * last {
                break;
            }
        }
        Ok((report, distance > MAX_MEAN_ERROR * farthest))
    }

    /// Solves for x with the present right-hand side and bounds. Returns the number of iterations.
    fn solve_within_bounds(&mut self, length: f64) -> Result<u32> {
        let problem = Problem { matrix: &self.sum, rhs: &self.b, bounds: &self.bounds, length };
        let mut answer = Answer { x: &mut self.x, reaction: &mut self.reaction };
        self.solver.solve(&self.system.engine, &problem, &mut answer)
    }

    /// Solves for x with the friction of nodes that slip from a displacement (m). Returns the
    /// number of iterations and the error of the law.
    fn solve_with_friction(&mut self, length: f64, from: &[f64]) -> Result<(u32, f64)> {
        let Some(mut friction) = self.friction.take() else {
            return Ok((self.solve_within_bounds(length)?, 0.0));
        };
        friction.begin_step(1.0, |dof| self.u[dof] - from[dof], |dof| self.u[dof]);
        let (base, mut iterations) = (self.b.clone(), 0);
        let rounds = Rounds::run(|rounds| {
            self.b.copy_from_slice(&base);
            friction.add_moments(&mut self.b);
            iterations += self.solve_within_bounds(length)?;
            let (engine, answer) = (&self.system.engine, [&*self.x, &*self.reaction]);
            friction.improve(engine, &self.sum, &self.bounds, answer, rounds)
        });
        self.friction = Some(friction);
        rounds.map(|rounds| (iterations + rounds.iterations, rounds.error))
    }

    /// Saves or restores the solver; each solution starts afresh.
    pub(in crate::scheme) fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.solver.archive(&self.system.engine, &self.sum, &self.system.bounds, archive)
    }

    /// Returns the number of numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.factorisations + Solver::<E>::factorisations(&self.solver)
    }
}

/// Line of the states (p + gamma dp, V + gamma dV) of a step; gamma = 1 is the midpoint rule.
pub(in crate::scheme) struct Line<'l, 's, E: Engine> {
    potential: &'l mut Potential<'s, E>,
    from: &'l State,
    rule: &'l MidpointRule<'s, E>,
    /// Time at the start of the line, in s.
    time: f64,
    /// Power dissipated by damping, in W.
    dissipated_power: f64,
    /// Value of gamma of the last solution, once it lies on this line.
    gamma: Option<f64>,
    /// Slope of the kinetic energy at the midpoint, and its curvature.
    kinetic_slope: Option<[f64; 2]>,
    /// Accuracy that the solves on this line have reached.
    pub report: StepReport,
    /// Whether the last state has the same active bounds as the start.
    pub same_piece: bool,
}

impl<E: Engine> Line<'_, '_, E> {
    /// Sets `to` to the state at gamma.
    ///
    /// While the active bounds do not change, U(p) is affine on the line and passes through the
    /// midpoint: no solve is needed. With time-dependent data the same holds at gamma = 1 only,
    /// since the midpoint has the mean data of both ends.
    pub fn at(&mut self, gamma: f64, to: &mut State) -> Result<()> {
        let Line { rule, from, time, .. } = *self;
        rule.update(from, gamma, to);
        rule.instants.reach(from, time, gamma, &mut to.instant)?;
        self.same_piece = self.goes_straight(gamma, to)?;
        if !self.same_piece || gamma != 1.0 && self.potential.system.drive.varies() {
            self.solve(gamma, &to.instant)?;
            to.u.copy_from_slice(&self.potential.u);
            to.reaction.copy_from_slice(&self.potential.reaction);
            if let (Some(friction), Some(moments)) = (&self.potential.friction, &mut to.moments) {
                friction.write_moments(moments);
            }
        }
        to.update_energies(self.potential.system)
    }

    /// Returns the work done, by friction too, and the energy that damping dissipates, in J, up to
    /// the last state, which is at gamma.
    pub fn exchange(&self, gamma: f64, state: &State) -> Result<[f64; 2]> {
        let Line { from, rule, potential: Potential { system, .. }, .. } = self;
        let by_friction = rule
            .driver
            .friction
            .as_ref()
            .map_or(0.0, |friction| friction.net_work(&system.engine, |dof| state.u[dof] - from.u[dof]));
        Ok([rule.work(from, state)? + by_friction, gamma * rule.dt * self.dissipated_power])
    }

    /// Returns the derivative with respect to gamma, in J, of the energy less work and dissipation,
    /// at the last state: `$dV^T C V - 2 x^T (F - K U + G^T r)$` plus dissipation. F is the
    /// midpoint load, whose work is counted as external; so is the work of the midpoint reactions
    /// where bounds move, and of the midpoint moments of friction, taken here at uniform velocity.
    pub fn slope(&mut self, gamma: f64, state: &State) -> Result<f64> {
        let System { engine, mass, bounds, .. } = self.potential.system;
        let work = &mut self.potential.b;
        let [middle, rise] = match self.kinetic_slope {
            Some(slope) => slope,
            None => {
                // At the midpoint, gamma = 1/2, V = 2/dt C^-1 B x.
                engine.project_transpose(mass, &self.rule.dv, work)?;
                let middle = 2.0 / self.rule.dt * engine.dot(work, &self.rule.driver.x)?;
                *self.kinetic_slope.insert([middle, engine.mass_norm_squared(mass, &self.rule.dv)?])
            }
        };
        work.copy_from_slice(&state.force);
        self.rule.instants.add_load(work);
        bounds.add_transposed(&state.reaction, work);
        let elastic = -2.0 * engine.dot(work, &self.rule.driver.x)?;
        let Line { from, rule, potential: Potential { system, .. }, .. } = self;
        let obstacles = match &state.instant.bounds {
            None => 0.0,
            Some(_) => {
                let by = |reaction| from.instant.boundary_work(&state.instant, reaction);
                system.total(by(&state.reaction) - by(&rule.driver.reaction))? / gamma
            }
        };
        let x = &rule.driver.x;
        let change = |dof: usize| (state.u[dof] - from.u[dof]) / gamma;
        let friction = match (&rule.driver.friction, &state.moments) {
            (Some(friction), Some(moments)) => {
                let beyond = friction.work_of(moments, |dof| change(dof) - 2.0 * x[dof]);
                system.total(beyond)? - friction.net_work(&system.engine, change)
            }
            _ => 0.0,
        };
        let dissipated = rule.dt * self.dissipated_power;
        Ok(middle + (gamma - 0.5) * rise + elastic + obstacles + friction + dissipated)
    }

    /// Returns whether the extended displacement satisfies all conditions of U(p) with the active
    /// bounds of the start and of the midpoint, none of which yields, and sets its reactions.
    fn goes_straight(&self, gamma: f64, to: &mut State) -> Result<bool> {
        let System { engine, bounds, .. } = self.potential.system;
        let bounds = to.instant.bounds(bounds);
        let mut straight = true;
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            let (start, middle) = (self.from.reaction[i], self.rule.driver.reaction[i]);
            let reaction = start + 2.0 * gamma * (middle - start);
            to.reaction[i] = reaction;
            match side(start) {
                BoundStatus::Free => straight &= (bounds.lower[i]..=bounds.upper[i]).contains(&to.u[dof]),
                BoundStatus::Lower => to.u[dof] = bounds.lower[i],
                BoundStatus::Upper => to.u[dof] = bounds.upper[i],
            }
            straight &= side(start) == side(middle) && side(start) == side(reaction);
            // U(p) bends where a bound yields.
            straight &= start == 0.0 || bounds.laws.pressed(i, start).is_none();
        }
        let straight = engine.comm().all_reduce_all(straight);
        let moments = self.from.moments.as_ref().zip(to.moments.as_mut());
        Ok(match self.rule.driver.friction.as_ref().zip(moments) {
            None => straight,
            Some((friction, (from, moments))) => {
                friction.extend(engine.comm(), gamma, from, &to.reaction, moments) && straight
            }
        })
    }

    /// Moves the solution to gamma, from the last one on this line or from the midpoint.
    fn solve(&mut self, gamma: f64, instant: &InstantData) -> Result<()> {
        let (potential, rule) = (&mut *self.potential, self.rule);
        if let (Some(friction), Some(step)) = (&mut potential.friction, &rule.driver.friction) {
            friction.take_paths(step, gamma);
            if self.gamma.is_none() {
                friction.guess(step);
            }
        }
        let last = match self.gamma.replace(gamma) {
            Some(last) => last,
            None => {
                waxpy(1.0, &rule.driver.x, &self.from.u, &mut potential.u);
                // The midpoint rule has dV = -dt (λ + alpha V) with the midpoint velocity V = 2/dt
                // C^-1 B x.
                let damping = potential.system.damping.mass * 2.0 / rule.dt;
                let middle = rule.dv.iter().zip(&rule.half_dp);
                for (multiplier, (dv, half_dp)) in potential.multiplier.iter_mut().zip(middle) {
                    *multiplier = -dv / rule.dt - damping * half_dp;
                }
                0.5
            }
        };
        copy_scaled(2.0 * (gamma - last), &rule.half_dp, &mut potential.residual);
        let System { engine, mass, .. } = potential.system;
        let increment = 2.0 * engine.mass_norm_squared(mass, &rule.half_dp)?.sqrt();
        self.report = self.report.and(potential.reach(increment, instant, Some(&self.from.u))?);
        Ok(())
    }
}

/// Returns the side of the bound that a reaction belongs to.
fn side(reaction: f64) -> BoundStatus {
    match reaction {
        r if r > 0.0 => BoundStatus::Lower,
        r if r < 0.0 => BoundStatus::Upper,
        _ => BoundStatus::Free,
    }
}
