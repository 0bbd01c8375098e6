//! The potential of the cells' mean deflections, and the displacement that goes with them.
//!
//! With the singular mass M = B^T C^-1 B only p = C^-1 B U has inertia. All else of U, the *massless* part in the kernel of B,
//! is at every instant where the elastic energy is least:
//!
//! ```math
//! \varphi(p) = \min \{ \tfrac12 U^T K U - F^T U \;:\; B U = C p,\; l \le G U \le u \}, \qquad U(p) \text{ its minimiser},
//! ```
//!
//! and the semi-discrete impact problem is the ordinary differential equation
//!
//! ```math
//! C \ddot p = -\nabla \varphi(p), \qquad \nabla \varphi(p) = C \lambda \text{ where } K U - F - G^T r = B^T \lambda .
//! ```
//!
//! *U(p) is unique*: K is positive definite on the kernel of B. *φ is convex*, as the least value over U of a function convex in
//! (p, U) together. *φ is C^1,1*: while the set of active bounds stays, U and λ are affine in p; the pieces are finitely many
//! polyhedra on which U, being unique, agrees where they meet; and λ is unique with it, because the reactions r are: the inf-sup
//! condition says that no combination of active bounds is a combination of rows of B. So ∇φ is continuous and affine on each
//! piece, hence Lipschitz. The equation then has one solution; it conserves ½ v^T C v + φ(p), its velocity never jumps, and
//! it asks for no law of restitution. With loads F and bounds l, u that change with time φ and U(p) are those of the instant, and
//! damping alpha M makes it `$C (\ddot p + \alpha \dot p) = -\nabla \varphi(p)$`. Damping by stiffness leaves no such equation: then the massless
//! part of U has a rate of its own and is no function of p.
//!
//! # How U(p) is found
//!
//! By multipliers (Hestenes 1969, Powell 1969): U minimises the energy with the penalty s/2 |p - C^-1 B U|_C^2 added and a
//! guess of λ; then λ grows by s (p - C^-1 B U). A round is one contact step with the matrix K + s M, symmetric positive
//! definite, by the same factor and condensed solver as a step of time, on any engine: no saddle point is factored. It
//! shrinks the error of p by at least w^2 / (w^2 + s), w the fastest frequency of the semi-discrete problem, and its answer is U of
//! *its own* p whatever λ was.
//!
//! The penalty costs no digits in the end. Every round starts from the residual F - K U + B^T λ, with K applied cell by cell, and
//! restores what the one before rounded off; the long waves, where an assembled K loses digits as h^-4, are ruled by s M. Measured
//! on the paper's plate, triangles, from the middle of a step on, s = 10^4 w^2: the first round leaves 1e-10 (at most 5e-7) of
//! p's way on 10 x 4 cells and 1e-13 (at most 8e-8) on 80 x 32, the second some roundings. One round is not enough on fine
//! meshes: with s = 10^8 w^2 it hits p at once, but leaves U so far from equilibrium that energies are off by 1e-6 on 80 x 32.

mod rate;

use super::System;
use super::drive::Moment;
use super::half_step::{HalfStep, Images, State};
use crate::archive::Archive;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::kkt::Judge;
use crate::vi::{Condensed, Side, Solver, Verdict};
use std::rc::Rc;

/// The penalty over the square of the fastest frequency: what is aimed at, and what is accepted.
const STIFFNESS: f64 = 1e4;
const STIFF_ENOUGH: std::ops::Range<f64> = 1e3..1e6;

/// Attempts at a penalty, and power iterations of each: its order of magnitude is enough.
const ATTEMPTS: usize = 8;
const POWERS: usize = 6;

/// Strain over that of its parts below which a motion is rigid, as all that have inertia may be on a few cells: then no frequency is the
/// fastest, and the first penalty will do. Cells n times as long as wide have motions of n^-2, rounding is below 1e-12.
const RIGID: f64 = 1e-10;

/// Error of p, relative to the way it goes, at which the rounds end.
const CLOSE: f64 = 1e-12;
/// Error of p, likewise, that no rounding makes: there is no such U. Met are some 1e-7 by one round, where inf-sup holds, and 1e-6 where a
/// plate carries 1e9 times its own mass.
const MISSED: f64 = 1e-4;
/// The first round leaves what its solve rounds off, the second does not.
const ROUNDS: std::ops::RangeInclusive<u32> = 2..=40;

/// Finds U(p); see the [module page](self).
pub struct Potential<'s, E: Engine> {
    system: &'s System<E>,
    /// s, in 1/s^2.
    penalty: f64,
    sum: [(f64, &'s E::Form); 2],
    solver: Condensed<E>,
    judge: Judge,
    factorisations: u64,
    bounds: Bounds,
    b: Vec<f64>,
    x: Vec<f64>,
    /// Velocities: C^-1 B x, what p lacks, λ + s of that.
    moved: Vec<f64>,
    lack: Vec<f64>,
    pull: Vec<f64>,
    /// The last answer: U, λ and reactions.
    u: Vec<f64>,
    multiplier: Vec<f64>,
    reaction: Vec<f64>,
    /// U, λ and the lack of p that rounds began with.
    from: [Vec<f64>; 3],
}

impl<'s, E: Engine> Potential<'s, E> {
    /// Chooses the penalty and factors K + s M.
    ///
    /// # Errors
    /// [`Error::Singular`] where that is not positive definite, or no estimate of the fastest frequency holds.
    /// [`Error::Usage`] for damping by stiffness.
    pub fn new(system: &'s System<E>) -> Result<Potential<'s, E>> {
        if system.damping.stiffness != 0.0 {
            return Err(Error::Usage(
                "damping.stiffness: the part of the plate without mass then follows its own history, not the rest of the plate; \
                 set time.massless = \"reflected\" with time.scheme = \"midpoint\", or time.scheme = \"newmark\""
                    .into(),
            ));
        }
        Potential::factor(system)
    }

    /// Velocities that have the momenta of the shapes of moving supports, one per motion: those of least energy.
    ///
    /// M R = B^T V is solved by K + s M, which misses w^2 / (w^2 + s) of a motion of frequency w each time.
    pub(super) fn images(system: &System<E>) -> Result<Rc<Images>> {
        let System { engine, mass, drive, .. } = system;
        if drive.supports.is_empty() {
            return Ok(Rc::new([]));
        }
        let mut potential = Potential::factor(system)?;
        let Potential { solver, sum, penalty, b, x, moved, .. } = &mut potential;
        let mut image = |momentum: &[f64]| {
            let mut image = vec![0.0; moved.len()];
            for _ in 0..*ROUNDS.end() {
                engine.momentum(mass, &image, b)?;
                b.iter_mut().zip(momentum).for_each(|(b, m)| *b = *penalty * (m - *b));
                solver.solve(engine, sum, b, &Bounds::default(), x, &mut [])?;
                engine.velocity(mass, x, moved)?;
                image.iter_mut().zip(&*moved).for_each(|(image, moved)| *image += moved);
                let [more, all] = [&*moved, &image].map(|v| engine.vis_viva(mass, v));
                if more?.sqrt() <= f64::EPSILON * all?.sqrt() {
                    break;
                }
            }
            Ok(image)
        };
        drive.supports.iter().map(|motion| image(&motion.momentum)).collect()
    }

    /// Chooses the penalty and factors K + s M.
    pub(super) fn factor(system: &'s System<E>) -> Result<Potential<'s, E>> {
        let System { engine, stiffness, mass, bounds, .. } = system;
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        let (mut b, mut x) = (vec![0.0; dofs], vec![0.0; dofs]);
        let (mut moved, mut pull) = (vec![0.0; velocities], vec![0.0; velocities]);
        // A rough displacement first guesses the fastest frequency, of which each factor then gives an estimate.
        let diagonal = engine.diagonal(&[(1.0, stiffness)])?;
        let rough = |i: usize| (0.618_033_988_749_895 * (i + 1) as f64).fract() - 0.5;
        for (i, (x, d)) in x.iter_mut().zip(&diagonal).enumerate() {
            *x = if *d > 0.0 { rough(i) / d.sqrt() } else { 0.0 };
        }
        let elastic = engine.multiply(stiffness, &x, &mut b)?;
        let first = STIFFNESS * elastic / engine.multiply(mass, &x, &mut b)?;
        let (mut penalty, mut all_rigid) = (first, false);
        let (mut sizes, mut factorisations) = (vec![0.0; dofs], 0);
        for _ in 0..ATTEMPTS {
            let sum = [(1.0, stiffness), (penalty, mass)];
            let mut solver = Condensed::new(engine, &sum, bounds.len())?;
            factorisations += 1;
            // T = s C^-1 B (K + s M)^-1 B^T has the eigenvalues s / (w^2 + s) on the velocities that displacements give, and 0 on
            // those that none gives: a checkerboard, on a uniform grid held all around. T (1 - T) leaves these out.
            let mut apply = |v: &[f64], image: &mut [f64]| -> Result<()> {
                engine.momentum(mass, v, &mut b)?;
                solver.solve(engine, &sum, &b, &Bounds::default(), &mut x, &mut [])?;
                engine.velocity(mass, &x, image)?;
                image.iter_mut().for_each(|v| *v *= penalty);
                Ok(())
            };
            pull.iter_mut().enumerate().for_each(|(i, v)| *v = rough(i));
            let mut largest = 0.0;
            for _ in 0..POWERS {
                let norm = engine.vis_viva(mass, &pull)?.sqrt();
                if norm == 0.0 {
                    break;
                }
                pull.iter_mut().for_each(|v| *v /= norm);
                apply(&pull, &mut moved)?;
                pull.iter_mut().zip(&moved).for_each(|(v, m)| *v -= m);
                apply(&pull, &mut moved)?;
                std::mem::swap(&mut pull, &mut moved);
                largest = engine.vis_viva(mass, &pull)?.sqrt();
            }
            // Rayleigh's quotient of the displacement that gave this velocity.
            engine.multiply_with_magnitude(&sum[..1], &x, &mut b, &mut sizes)?;
            let elastic = engine.multiply(stiffness, &x, &mut b)?;
            x.iter_mut().for_each(|x| *x = x.abs());
            all_rigid |= elastic <= RIGID * RIGID * engine.dot(&x, &sizes)?;
            let fastest = elastic * (penalty / largest).powi(2);
            if all_rigid && penalty == first || STIFF_ENOUGH.contains(&(penalty / fastest)) {
                return Ok(Potential {
                    system,
                    penalty,
                    sum,
                    solver,
                    judge: Judge::new(engine, &sum[..1])?,
                    factorisations: factorisations - 1,
                    bounds: bounds.clone(),
                    b,
                    x,
                    moved,
                    lack: vec![0.0; velocities],
                    pull,
                    u: vec![0.0; dofs],
                    multiplier: vec![0.0; velocities],
                    reaction: vec![0.0; bounds.len()],
                    from: Default::default(),
                });
            }
            penalty = if all_rigid { first } else { STIFFNESS * fastest };
            if !(penalty.is_finite() && penalty > 0.0) {
                break;
            }
        }
        Err(Error::Singular("no estimate of the fastest natural frequency holds".into()))
    }

    /// Moves a displacement to U(p) of its own p = C^-1 B U at an instant; sets the reactions of the obstacles there.
    ///
    /// # Errors
    /// What the engine says.
    pub fn settle(&mut self, time: f64, u: &mut [f64], reaction: &mut [f64]) -> Result<Verdict> {
        let moment = self.system.moment(time)?;
        self.settle_at(&moment, u, reaction)
    }

    /// Settles a state at its own moment.
    pub(super) fn settle_state(&mut self, state: &mut State) -> Result<Verdict> {
        let State { moment, u, reaction, .. } = state;
        let verdict = self.settle_at(moment, u, reaction)?;
        state.weigh(self.system)?;
        Ok(verdict)
    }

    fn settle_at(&mut self, moment: &Moment, u: &mut [f64], reaction: &mut [f64]) -> Result<Verdict> {
        let System { engine, mass, .. } = self.system;
        self.u.copy_from_slice(u);
        self.multiplier.fill(0.0);
        self.lack.fill(0.0);
        engine.velocity(mass, &self.u, &mut self.moved)?;
        let way = engine.vis_viva(mass, &self.moved)?.sqrt();
        let verdict = self.reach(way, moment)?;
        u.copy_from_slice(&self.u);
        reaction.copy_from_slice(&self.reaction);
        Ok(verdict)
    }

    /// The states on the line of a half step from an instant.
    pub(super) fn line<'l>(
        &'l mut self,
        from: &'l State,
        half: &'l HalfStep<'s, E>,
        time: f64,
    ) -> Result<Line<'l, 's, E>> {
        Ok(Line {
            potential: self,
            from,
            half,
            time,
            loss: half.loss()?,
            gamma: None,
            kinetic_slope: None,
            verdict: Verdict::default(),
            same_piece: false,
        })
    }

    /// Moves the last answer to U(p + lack) at a moment, which exists wherever the inf-sup condition holds; `way` is the length, in
    /// the norm of C, that p goes in all.
    fn reach(&mut self, way: f64, moment: &Moment) -> Result<Verdict> {
        let System { engine, bounds, .. } = self.system;
        let length = self.system.length(moment.bounds(bounds), &self.u)?;
        for (kept, from) in self.from.iter_mut().zip([&self.u, &self.multiplier, &self.lack]) {
            kept.clone_from(from);
        }
        let (mut verdict, mut missed) = self.rounds(way, length, moment)?;
        // The penalty makes the flexibility of neighbours alike: where both touch, their Schur complement may be all rounding.
        let poor = missed || verdict.kkt.is_nan() || verdict.kkt > self.solver.tolerance();
        if poor && self.solver.distrust(engine, &self.sum)? {
            for (kept, to) in self.from.iter().zip([&mut self.u, &mut self.multiplier, &mut self.lack]) {
                to.clone_from(kept);
            }
            let again;
            (again, missed) = self.rounds(way, length, moment)?;
            verdict = Verdict { iterations: verdict.iterations + again.iterations, retries: 1, ..again };
        }
        if missed {
            return Err(Error::Singular(
                "no deflection between the obstacles has the means over cells that the motion leads to: the inf-sup \
                 condition fails on this mesh; set time.scheme = \"newmark\", or take quadrilaterals, or a finer mesh"
                    .into(),
            ));
        }
        Ok(verdict)
    }

    /// The rounds that lead there; whether they miss p. `length` is the scale of the deflection, in m, that gaps are measured against.
    fn rounds(&mut self, way: f64, length: f64, moment: &Moment) -> Result<(Verdict, bool)> {
        let System { engine, mass, bounds, .. } = self.system;
        let bounds = moment.bounds(bounds);
        let mut verdict = Verdict { kkt: f64::INFINITY, ..Verdict::default() };
        let (mut distance, mut farthest) = (f64::INFINITY, way);
        let least = ROUNDS.start() + self.solver.corrections();
        for round in 1..=*ROUNDS.end() {
            for (pull, (multiplier, lack)) in self.pull.iter_mut().zip(self.multiplier.iter().zip(&self.lack))
            {
                *pull = multiplier + self.penalty * lack;
            }
            engine.momentum(mass, &self.pull, &mut self.x)?;
            self.system.force(&self.u, &mut self.b)?;
            self.b.iter_mut().zip(&self.x).for_each(|(b, pull)| *b += pull);
            moment.push(&mut self.b);
            self.bounds.shift(bounds, |dof, bound| bound - self.u[dof]);
            let (sum, b, within) = (&self.sum, &self.b, &self.bounds);
            let iterations = self.solver.solve(engine, sum, b, within, &mut self.x, &mut self.reaction)?;
            verdict.iterations += iterations;
            self.u.iter_mut().zip(&self.x).for_each(|(u, x)| *u += x);
            engine.velocity(mass, &self.x, &mut self.moved)?;
            for (multiplier, (lack, moved)) in
                self.multiplier.iter_mut().zip(self.lack.iter_mut().zip(&self.moved))
            {
                *lack -= moved;
                *multiplier += self.penalty * *lack;
            }
            farthest = farthest.max(engine.vis_viva(mass, &self.moved)?.sqrt());
            let before = std::mem::replace(&mut distance, engine.vis_viva(mass, &self.lack)?.sqrt());
            let reached = distance <= CLOSE * way || distance > 0.5 * before;
            if round < least || !reached && round < *ROUNDS.end() {
                continue;
            }
            // K U = F + B^T λ + G^T r within the bounds.
            engine.momentum(mass, &self.multiplier, &mut self.b)?;
            let [load, varying] =
                [&self.system.load, &moment.load].map(|load| load.as_deref().unwrap_or(&[]));
            let (sum, terms) = (&self.sum[..1], [&self.b, load, varying]);
            let kkt = self.judge.residual(engine, sum, &terms, bounds, length, &self.u, &self.reaction)?;
            let last = std::mem::replace(&mut verdict.kkt, kkt);
            // Where cells differ much in size, p is reached before U is in equilibrium.
            if kkt <= self.solver.tolerance() || kkt.is_nan() || kkt > 0.5 * last {
                break;
            }
        }
        Ok((verdict, distance > MISSED * farthest))
    }

    /// Shows an archive the solver: each answer begins anew.
    pub(super) fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.solver.state(&self.system.engine, &self.sum, &self.system.bounds, archive)
    }

    /// Numeric factorisations so far.
    pub fn factorisations(&self) -> u64 {
        self.factorisations + self.solver.factorisations()
    }
}

/// The states (p + gamma dp, V + gamma dV) of a half step; gamma = 1 is the midpoint rule's.
pub(super) struct Line<'l, 's, E: Engine> {
    potential: &'l mut Potential<'s, E>,
    from: &'l State,
    half: &'l HalfStep<'s, E>,
    /// When it begins, in s.
    time: f64,
    /// Rate of the energy that damping takes, in W.
    loss: f64,
    /// Where the potential's last answer lies, once it lies on this line.
    gamma: Option<f64>,
    /// The kinetic energy's slope in the middle, and its curvature.
    kinetic_slope: Option<[f64; 2]>,
    /// What solves on this line have reached.
    pub verdict: Verdict,
    /// Whether the last state has the same active bounds as the start.
    pub same_piece: bool,
}

impl<E: Engine> Line<'_, '_, E> {
    /// Makes `to` the state at gamma.
    ///
    /// While the active bounds stay, U(p) is affine on the line, and the middle lies on it: no solve. So it is where the load or the
    /// bounds change, at gamma = 1, whose are the means that the middle has.
    pub fn at(&mut self, gamma: f64, to: &mut State) -> Result<()> {
        let Line { half, from, time, .. } = *self;
        half.extend(from, gamma, to);
        half.reach(from, time, gamma, &mut to.moment)?;
        self.same_piece = self.goes_straight(gamma, to)?;
        if !self.same_piece || gamma != 1.0 && self.potential.system.drive.varies() {
            self.solve(gamma, &to.moment)?;
            to.u.copy_from_slice(&self.potential.u);
            to.reaction.copy_from_slice(&self.potential.reaction);
        }
        to.weigh(self.potential.system)
    }

    /// Energy, in J, that came in up to the state last made, and what damping took.
    pub fn exchange(&self, gamma: f64, at: &State) -> Result<[f64; 2]> {
        Ok([self.half.given(self.from, at)?, gamma * self.half.dt * self.loss])
    }

    /// Rate with gamma, in J, of the energy that is not accounted for, at the state last made:
    /// dV^T C V - 2 x^T (F - K U + G^T r), and what damping takes. F is that of the middle, whose work counts as given; so does the work
    /// of the middle's reactions where bounds move, here at an even velocity.
    pub fn slope(&mut self, gamma: f64, at: &State) -> Result<f64> {
        let System { engine, mass, bounds, .. } = self.potential.system;
        let work = &mut self.potential.b;
        let [middle, rise] = match self.kinetic_slope {
            Some(known) => known,
            None => {
                // V = 2/dt C^-1 B x in the middle, where gamma = 1/2.
                engine.momentum(mass, &self.half.dv, work)?;
                let middle = 2.0 / self.half.dt * engine.dot(work, &self.half.x)?;
                *self.kinetic_slope.insert([middle, engine.vis_viva(mass, &self.half.dv)?])
            }
        };
        work.copy_from_slice(&at.force);
        self.half.push(work);
        bounds.add_transposed(&at.reaction, work);
        let elastic = -2.0 * engine.dot(work, &self.half.x)?;
        let Line { from, half, potential: Potential { system, .. }, .. } = self;
        let carried = match &at.moment.bounds {
            None => 0.0,
            Some(_) => {
                let by = |reaction| from.moment.carried(&at.moment, reaction);
                system.total(by(&at.reaction) - by(&half.reaction))? / gamma
            }
        };
        Ok(middle + (gamma - 0.5) * rise + elastic + carried + half.dt * self.loss)
    }

    /// Whether the extended displacement is admissible with the active bounds of the start and of the middle, that is,
    /// satisfies all conditions of U(p). Sets its reactions.
    fn goes_straight(&self, gamma: f64, to: &mut State) -> Result<bool> {
        let System { engine, bounds, .. } = self.potential.system;
        let bounds = to.moment.bounds(bounds);
        let mut straight = true;
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            let (start, middle) = (self.from.reaction[i], self.half.reaction[i]);
            let reaction = start + 2.0 * gamma * (middle - start);
            to.reaction[i] = reaction;
            match side(start) {
                Side::Free => straight &= (bounds.lower[i]..=bounds.upper[i]).contains(&to.u[dof]),
                Side::Lower => to.u[dof] = bounds.lower[i],
                Side::Upper => to.u[dof] = bounds.upper[i],
            }
            straight &= side(start) == side(middle) && side(start) == side(reaction);
        }
        Ok(engine.maximum(f64::from(u8::from(!straight)))? == 0.0)
    }

    /// Makes the potential's answer that at gamma, from its last on this line or from the middle.
    fn solve(&mut self, gamma: f64, moment: &Moment) -> Result<()> {
        let (potential, half) = (&mut *self.potential, self.half);
        let last = match self.gamma.replace(gamma) {
            Some(last) => last,
            None => {
                for (u, (from, x)) in potential.u.iter_mut().zip(self.from.u.iter().zip(&half.x)) {
                    *u = from + x;
                }
                // The midpoint rule: dV = -dt (λ + alpha V) in the middle, where V = 2/dt C^-1 B x.
                let damping = potential.system.damping.mass * 2.0 / half.dt;
                let middle = half.dv.iter().zip(&half.rate);
                for (multiplier, (dv, rate)) in potential.multiplier.iter_mut().zip(middle) {
                    *multiplier = -dv / half.dt - damping * rate;
                }
                0.5
            }
        };
        for (lack, rate) in potential.lack.iter_mut().zip(&half.rate) {
            *lack = 2.0 * (gamma - last) * rate;
        }
        let System { engine, mass, .. } = potential.system;
        let way = 2.0 * engine.vis_viva(mass, &half.rate)?.sqrt();
        self.verdict = self.verdict.and(potential.reach(way, moment)?);
        Ok(())
    }
}

/// The bound that a reaction belongs to.
fn side(reaction: f64) -> Side {
    match reaction {
        r if r > 0.0 => Side::Lower,
        r if r < 0.0 => Side::Upper,
        _ => Side::Free,
    }
}
