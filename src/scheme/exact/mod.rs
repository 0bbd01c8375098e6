//! The exact motion of the semi-discrete problem, from event to event.
//!
//! No step error: between two changes of the set of touching nodes the motion is a sum of sinusoids, and each change is found to the
//! last digit. The grid of instants only says where to look.
//!
//! # The motion is that of a potential
//!
//! Let B U = C p tie displacements to the cells' velocities p' = v, K be positive definite on ker B, and
//!
//! ```math
//! \varphi(p) = \min \{ \tfrac12 U^T K U - F^T U : B U = C p, \; l \le G U \le u \}.
//! ```
//!
//! **Fact 1: phi is convex and `$C^{1,1}$`, and piecewise quadratic.** *Proof.* The set of pairs (p, U) that are admissible is a convex
//! polyhedron, and the function is convex in U; its minimum over U is convex in p, and piecewise quadratic (parametric quadratic
//! programming). On the piece with active set A the optimality conditions K U = F + B^T mu + G^T r, with r = 0 off A, are linear, and
//! grad phi = C mu. The minimiser U(p) is unique, for K is definite on ker B. If moreover G maps ker B onto all deflections (the inf-sup
//! condition: `$\inf_Q \sup_{W \in \ker B} Q \cdot G W / |Q||W| > 0$`), the feasible set is never empty, and r, with it mu, is unique:
//! take the conditions on ker B, where K U - F = G^T r, and G is onto. Two pieces that meet at p therefore have the same mu there: grad phi
//! is continuous, and being piecewise linear with finitely many pieces, Lipschitz. ∎
//!
//! **Fact 2: the semi-discrete problem with the singular mass is** `$C p'' = -\nabla \varphi(p)$`. *Proof.* M U'' + K U = F + G^T r with
//! M = B^T C^-1 B is K U = F - B^T p'' + G^T r: the conditions above with mu = -p''. ∎ So the problem, which for a regular mass needs a law of
//! restitution and is still not well posed, is an ordinary differential equation with a Lipschitz right-hand side: one motion goes
//! from each start, forwards and backwards in time; velocities never jump and reactions are continuous (Renard, *The singular
//! dynamic method for constrained second order hyperbolic equations*, J. Comput. Appl. Math. 234, 2010).
//!
//! **Fact 3: energy is conserved.** *Proof.* d/dt (v^T C v / 2 + phi(p)) = v^T (C p'' + grad phi(p)) = 0, across changes of piece too, because phi is
//! `$C^1$`. ∎ With damping alpha M, `$C (p'' + \alpha p') = -\nabla \varphi(p)$`, whose right-hand side is as Lipschitz, it falls by alpha v^T C v. An impact turns energy into vibration, all of which is kept; so do these formulas, to rounding, since each piece is
//! advanced by its exact solution.
//!
//! **Fact 4: what fails without inf-sup.** Take G and ker B with a reaction Q that no W in ker B feels. Then Q . G U is a function of p
//! alone: the obstacle bounds p itself, phi is infinite beyond, and the velocity must jump. (P1 displacements with P0 velocities
//! on a bar: ker B = {0}.) [`Exact::new`] computes the compliance G S G^T of the bounded dofs on ker B, which is positive definite if and only
//! if inf-sup holds, and refuses where it is not.
//!
//! # How it moves
//!
//! `reduction` solves the saddle point behind phi for all that follows; `modes` diagonalises the motion of an active set, once, and
//! remembers it; `search` certifies that nothing happens up to the next event, and locates that; `switch` decides what touches
//! after it. What it costs: N^3 for each new active set of N cells, N times the bounded dofs for each interval certified and each instant
//! looked at; and memory for the sets remembered ([`ExactOptions::memory`]).
//!
//! Damping by mass is each mode's own alike, and exact; damping by stiffness, or loads and obstacles that change with time, are not: the
//! massless part of U would have a rate of its own, and modes would need the particular solution of each load.

mod frame;
mod modes;
mod motion;
mod reduction;
mod search;
mod switch;

use super::{Approach, Event, Scheme, Start, System, Tally};
use crate::archive::{Archive, Over};
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::memory;
use crate::obstacle::Bounds;
use crate::vi::kkt::Judge;
use crate::vi::{self, Side, Verdict};
use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side as Triangle};
use modes::{Cache, Modes};
use motion::Motion;
use reduction::{Reduction, Saddle};
use search::Search;
use std::cell::OnceCell;

/// Instants between those that are judged, as are all that follow an event.
const JUDGE_EVERY: u64 = 16;

/// Residual from which a shape is corrected. Where a motion that the velocities hardly see is soft, as of two cells that can all but turn
/// without moving their means, held nodes lose the digits that its compliance takes: residuals of up to 1e-9 were met.
const SPOILT: f64 = 1e-11;

/// Bytes of dense arrays beyond which nothing is begun: the first diagonalisation alone would take minutes, and impacts need hundreds.
const LARGEST: usize = 1 << 33;

/// Bytes at the peak of the dense arrays, estimated: for so many dofs, cells and bounded dofs.
pub fn estimated_memory(dofs: usize, cells: usize, bounded: usize) -> usize {
    // Of those sizes at once: in the solution for R, and in the diagonalisation of a set.
    let (lifts, squares) = (7 * dofs * cells, 8 * cells * cells);
    let at_bounds = bounded * (2 * dofs + 4 * cells + 3 * bounded);
    // An impact goes through about as many active sets as there are nodes to touch.
    let cached = bounded.max(1).saturating_mul(size_of::<f64>() * cells * (cells + bounded));
    size_of::<f64>() * (lifts + squares + at_bounds) + cached.min(ExactOptions::default().memory)
}

/// What the event search trusts and allows. The motion does not depend on any of it, but for rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExactOptions {
    /// Roundings of a gap or reaction within which it counts as at its limit.
    pub roundings: f64,
    /// First interval of the search, in periods of the fastest mode over 2 pi.
    pub stride: f64,
    /// Bytes of modes kept for active sets that may come back.
    pub memory: usize,
    /// Most events in a step of the grid.
    pub events_per_step: u64,
}

impl Default for ExactOptions {
    fn default() -> ExactOptions {
        ExactOptions { roundings: 64.0, stride: 4.0, memory: 1 << 29, events_per_step: 1_000_000 }
    }
}

/// The motion at an instant n of the grid.
pub struct Exact<'s, E: Engine> {
    system: &'s System<E>,
    options: ExactOptions,
    saddle: Saddle<'s, E>,
    reduction: Reduction,
    cache: Cache,
    motion: Motion,
    search: Search,
    dt: f64,
    n: u64,
    /// q, q' and what is watched now, with rates.
    state: Mat<f64>,
    watched: Mat<f64>,
    /// G U and reactions now.
    admissible: Vec<f64>,
    reaction: Vec<f64>,
    /// Impulses of the obstacles over the last step, in N s.
    impulses: Vec<f64>,
    /// U and v now, once asked for.
    shape: OnceCell<Shape>,
    events: Vec<Event>,
    touches: Vec<Approach>,
    judge: Judge,
    verdict: Verdict,
    tally: Tally,
}

/// A state in the dofs of the structure.
#[derive(Debug)]
struct Shape {
    displacement: Vec<f64>,
    velocity: Vec<f64>,
    /// v' + alpha v, which the judge needs.
    acceleration: Vec<f64>,
}

impl<'s, E: Engine> Exact<'s, E> {
    /// Starts from the position and velocity of a start, looked at every `dt` seconds.
    ///
    /// # Errors
    /// [`Error::Singular`] where the mass is not singular, the inf-sup condition fails, or some motion has neither stiffness nor
    /// inertia; [`Error::Usage`] where the matrices, which are dense, would be too large, or the damping or the loads are not for this scheme.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<Exact<'s, E>> {
        Exact::with_options(system, dt, start, ExactOptions::default())
    }

    /// As [`Exact::new`], with an event search of one's own.
    ///
    /// # Errors
    /// As [`Exact::new`].
    pub fn with_options(
        system: &'s System<E>,
        dt: f64,
        start: Start,
        options: ExactOptions,
    ) -> Result<Exact<'s, E>> {
        let System { engine, stiffness, mass, bounds, damping, drive, .. } = system;
        if damping.stiffness != 0.0 {
            return Err(Error::Usage(
                "time.scheme = \"exact\" takes damping by mass, not damping.stiffness; set time.scheme = \"newmark\"".into(),
            ));
        }
        drive.refuse_modal("exact")?;
        if drive.varies() {
            return Err(Error::Usage(
                "time.scheme = \"exact\" takes loads and obstacles that do not change with time; \
                 set time.scheme = \"conserving\" or \"newmark\""
                    .into(),
            ));
        }
        let cells = engine.velocities(mass);
        let needed = estimated_memory(engine.dofs(), cells, bounds.len());
        if needed > LARGEST {
            return Err(Error::Usage(format!(
                "time.scheme = \"exact\" would need {:.0} GB of dense matrices for {cells} cells; \
                 coarsen the mesh or set time.scheme = \"conserving\"",
                needed as f64 / 1e9
            )));
        }
        memory::require(needed as u64, &format!("time.scheme = \"exact\" with {cells} cells"), |_| {
            "coarsen the mesh or set time.scheme = \"conserving\"".into()
        })?;
        let saddle = Saddle::new(system)?;
        let reduction = Reduction::new(&saddle)?;
        let of = [&start.displacement, &start.velocity];
        let state = reduction.frame.of(system, &Mat::from_fn(engine.dofs(), 2, |i, j| of[j][i]))?;
        let sides = first_sides(system, &reduction, &state, options.roundings);
        let mut cache = Cache::new(options.memory);
        let modes = cache.get(system, &reduction, &sides)?;
        let modal = modes.vectors.transpose() * &state;
        let motion = Motion::new(modes, 0.0, &modal);
        check_rigid(system, &reduction, &motion.modes, &modal, &start.displacement)?;
        let search = Search::new(&motion, options.stride, options.roundings, 0);
        let before = |&dof: &usize| Approach {
            time: 0.0,
            deflection: start.displacement[dof],
            velocity: start.velocity[dof],
        };
        let bounded = bounds.len();
        let mut exact = Exact {
            system,
            options,
            cache,
            motion,
            search,
            dt,
            n: 0,
            watched: Mat::zeros(bounded, 2),
            admissible: vec![0.0; bounded],
            reaction: vec![0.0; bounded],
            impulses: vec![0.0; bounded],
            shape: OnceCell::new(),
            events: Vec::new(),
            touches: bounds.dofs.iter().map(before).collect(),
            judge: Judge::new(engine, &[(1.0, stiffness)])?,
            verdict: Verdict::default(),
            tally: Tally::default(),
            saddle,
            reduction,
            state,
        };
        exact.look(0.0);
        exact.judge()?;
        Ok(exact)
    }

    /// Takes the state at an instant of the present motion.
    fn look(&mut self, at: f64) {
        self.motion.state(at, &mut self.state);
        self.watch();
    }

    /// Adds the impulses of so many seconds of the present motion from the state on; `step` where these are a step of the grid.
    fn add_impulses(&mut self, seconds: f64, step: bool) {
        let modes = self.motion.modes.clone();
        let touching: Vec<usize> = (0..modes.sides.len()).filter(|&i| modes.sides[i] != Side::Free).collect();
        if touching.is_empty() || seconds == 0.0 {
            return;
        }
        let integral = self.motion.integral(&self.state, seconds, step);
        touching.iter().for_each(|&i| self.impulses[i] += seconds * modes.offset[i]);
        for (k, integral) in integral.into_iter().enumerate() {
            let column = modes.rows.col_as_slice(k);
            touching.iter().for_each(|&i| self.impulses[i] += integral * column[i]);
        }
    }

    /// Takes what is watched from the state.
    fn watch(&mut self) {
        let System { bounds, .. } = self.system;
        self.shape.take();
        self.motion.watch(&self.state, &mut self.watched);
        for (i, side) in self.motion.modes.sides.iter().enumerate() {
            let y = self.watched[(i, 0)];
            (self.admissible[i], self.reaction[i]) = match side {
                Side::Free => (y, 0.0),
                Side::Lower => (bounds.lower[i], y),
                Side::Upper => (bounds.upper[i], y),
            };
        }
    }

    /// U and v of the state.
    fn shape(&self) -> &Shape {
        self.shape.get_or_init(|| {
            let Reduction { lift, push, rest, frame, .. } = &self.reduction;
            let modes = &self.motion.modes;
            let z = &modes.vectors * &self.state;
            let forces = Mat::from_fn(self.reaction.len(), 1, |i, _| self.reaction[i]);
            let mut u = rest + lift * z.get(.., ..1);
            if self.reaction.iter().any(|r| *r != 0.0) {
                u += push * forces;
            }
            for (i, (&dof, side)) in self.system.bounds.dofs.iter().zip(&modes.sides).enumerate() {
                if *side != Side::Free {
                    u[(dof, 0)] = self.admissible[i];
                }
            }
            let pull = |k: usize| modes.force[k] - modes.frequencies[k].powi(2) * self.state[(k, 0)];
            let acceleration = &modes.vectors * Mat::from_fn(modes.force.len(), 1, |k, _| pull(k));
            Shape {
                displacement: u.col_as_slice(0).to_vec(),
                velocity: frame.velocity(z.col_as_slice(1)),
                acceleration: frame.velocity(acceleration.col_as_slice(0)),
            }
        })
    }

    /// Judges the present shape, corrected where rounding spoils it and that helps.
    fn judge(&mut self) -> Result<()> {
        self.verdict.kkt = self.residual()?;
        if self.verdict.kkt > SPOILT {
            let (shape, reaction) = self.corrected()?;
            let kept = (
                std::mem::replace(&mut self.shape, shape.into()),
                std::mem::replace(&mut self.reaction, reaction),
            );
            let corrected = self.residual()?;
            if corrected < self.verdict.kkt {
                self.verdict.kkt = corrected;
            } else {
                (self.shape, self.reaction) = kept;
            }
        }
        Ok(())
    }

    /// -B^T (v' + alpha v) of the present shape.
    fn inertia(&self) -> Result<Vec<f64>> {
        let System { engine, mass, .. } = self.system;
        let mut b = vec![0.0; engine.dofs()];
        engine.momentum(mass, &self.shape().acceleration, &mut b)?;
        b.iter_mut().for_each(|b| *b = -*b);
        Ok(b)
    }

    /// The relative residual of K U = F - B^T (v' + alpha v) + G^T r and of the bounds.
    fn residual(&mut self) -> Result<f64> {
        let System { engine, stiffness, bounds, load, .. } = self.system;
        let b = self.inertia()?;
        let terms: Vec<&[f64]> = load.iter().map(Vec::as_slice).chain([b.as_slice()]).collect();
        let displacement = self.shape().displacement.clone();
        let length = self.system.length(bounds, &displacement)?;
        let sum = [(1.0, stiffness)];
        self.judge.residual(engine, &sum, &terms, bounds, length, &displacement, &self.reaction)
    }

    /// The present shape and reactions, with what their residual gives in the saddle point where the active bounds hold.
    fn corrected(&self) -> Result<(Shape, Vec<f64>)> {
        let System { bounds, .. } = self.system;
        let Reduction { lift_at, push, compliance, frame, .. } = &self.reduction;
        let modes = &self.motion.modes;
        let Shape { displacement, velocity, acceleration } = self.shape();
        let column = |of: &[f64]| Mat::from_fn(of.len(), 1, |i, _| of[i]);
        let mut force = vec![0.0; displacement.len()];
        self.system.force(displacement, &mut force)?;
        force.iter_mut().zip(self.inertia()?).for_each(|(force, inertia)| *force += inertia);
        bounds.add_transposed(&self.reaction, &mut force);
        let position = &modes.vectors * self.state.get(.., ..1);
        let position = position - frame.of(self.system, &column(displacement))?;
        let (mut du, mut da) = self.saddle.solve(column(&force), position)?;
        // Reactions that hold the active bounds: as definite as when the modes were found.
        let active: Vec<usize> = (0..bounds.len()).filter(|&i| modes.sides[i] != Side::Free).collect();
        let block = Mat::from_fn(active.len(), active.len(), |i, j| compliance[(active[i], active[j])]);
        let llt = block.llt(Triangle::Lower).map_err(|_| {
            Error::Singular(format!(
                "{} nodes in contact: their compliance is not positive definite",
                active.len()
            ))
        })?;
        let held = llt.solve(&Mat::from_fn(active.len(), 1, |k, _| -du[(bounds.dofs[active[k]], 0)]));
        let mut forces = Mat::zeros(bounds.len(), 1);
        for (k, &i) in active.iter().enumerate() {
            forces[(i, 0)] = held[(k, 0)];
        }
        du += push * &forces;
        da += lift_at.transpose() * &forces;
        for &i in &active {
            du[(bounds.dofs[i], 0)] = 0.0;
        }
        let sum = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + b).collect::<Vec<f64>>();
        let shape = Shape {
            displacement: sum(displacement, du.col_as_slice(0)),
            velocity: velocity.clone(),
            acceleration: sum(acceleration, &frame.velocity(da.col_as_slice(0))),
        };
        Ok((shape, sum(&self.reaction, forces.col_as_slice(0))))
    }

    /// Goes through the event at an instant of the present motion.
    fn switch(&mut self, at: f64, bound: usize) -> Result<()> {
        self.look(at);
        let before = self.motion.modes.clone();
        let mut undecided = self.search.at_limit(&self.motion, &self.watched);
        if undecided.iter().all(|(i, _)| *i != bound) {
            let middle = 0.5 * (before.limits[bound][0] + before.limits[bound][1]);
            let side = match before.sides[bound] {
                Side::Free if self.watched[(bound, 0)] > middle => Side::Upper,
                Side::Free => Side::Lower,
                side => side,
            };
            undecided.push((bound, side));
        }
        let state = &before.vectors * &self.state;
        let reduction = &self.reduction;
        let sides = switch::next_sides(
            reduction,
            &before.sides,
            &undecided,
            &state,
            &self.reaction,
            self.options.roundings,
        );
        let arriving = self.watched.clone();
        let force = self.reaction.iter().sum();
        let modes = self.cache.get(self.system, reduction, &sides)?;
        let modal = modes.vectors.transpose() * state;
        let time = self.motion.start + at;
        self.tally.evaluations += self.search.evaluations;
        let ExactOptions { stride, roundings, .. } = self.options;
        self.motion = Motion::new(modes, time, &modal);
        self.search = Search::new(&self.motion, stride, roundings, self.search.level);
        self.look(0.0);
        for (i, (&was, &is)) in before.sides.iter().zip(&sides).enumerate() {
            if was == is {
                continue;
            }
            let closes = is != Side::Free;
            let velocity = if closes { arriving[(i, 1)] } else { self.watched[(i, 1)] };
            self.events.push(Event { time, bound: i, closes, velocity, force });
            self.tally.events += 1;
            if closes {
                self.touches[i] = Approach { time, deflection: self.admissible[i], velocity };
            }
        }
        Ok(())
    }

    /// V = C^-1 B U' of the present instant, one a cell, in m/s.
    pub fn cell_velocity(&self) -> &[f64] {
        &self.shape().velocity
    }
}

/// Strain of a rigid motion relative to that of its parts: rounding.
const RIGID_STRAIN: f64 = 1e-12;
/// Part of the start's elastic energy that may hide in motions taken for rigid.
const HIDDEN: f64 = 1e-6;

/// Checks that what of a start goes into rigid motions bends nothing: the slowest motions of a strip ten thousand times longer than wide
/// are lost in the rounding of the fastest.
fn check_rigid<E: Engine>(
    system: &System<E>,
    reduction: &Reduction,
    modes: &Modes,
    state: &Mat<f64>,
    start: &[f64],
) -> Result<()> {
    let System { engine, stiffness, .. } = system;
    let rigid = modes.vectors.get(.., ..modes.rigid) * state.get(..modes.rigid, ..1);
    let shape = &reduction.lift * rigid;
    let x = shape.col_as_slice(0);
    let (mut force, mut sizes) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    engine.multiply_with_magnitude(&[(1.0, stiffness)], x, &mut force, &mut sizes)?;
    let size = engine.dot(&sizes, &x.iter().map(|x| x.abs()).collect::<Vec<_>>())?;
    let energy = engine.multiply(stiffness, x, &mut force)?;
    let whole = engine.multiply(stiffness, start, &mut force)?;
    if energy > RIGID_STRAIN.powi(2) * size && energy > HIDDEN * whole {
        return Err(Error::Singular(
            "time.scheme = \"exact\": the slowest motions are lost in the rounding of the fastest; \
             set time.scheme = \"conserving\", or take cells that are less slender"
                .into(),
        ));
    }
    Ok(())
}

/// The active set at a start: that of the minimiser in phi(p), and where a node just touches, what it does next.
fn first_sides<E: Engine>(
    system: &System<E>,
    reduction: &Reduction,
    state: &Mat<f64>,
    roundings: f64,
) -> Vec<Side> {
    let bounds = &system.bounds;
    let position = state.get(.., ..1);
    let free = &reduction.rest_at + &reduction.lift_at * position;
    let mut sides = vec![Side::Free; bounds.len()];
    let mut values = free.col_as_slice(0).to_vec();
    let mut reactions = vec![0.0; bounds.len()];
    let inside = |i: usize, value: f64| (bounds.lower[i]..=bounds.upper[i]).contains(&value);
    let mut scale: Vec<f64> = (0..bounds.len()).map(|_| 0.0).collect();
    if !values.iter().enumerate().all(|(i, &value)| inside(i, value)) {
        // Positive definite: checked by the reduction.
        if let Ok(llt) = reduction.compliance.llt(Triangle::Lower) {
            let stiffness = llt.inverse();
            let wanted = &stiffness * &free;
            for (i, scale) in scale.iter_mut().enumerate() {
                *scale = (0..bounds.len()).map(|j| (stiffness[(i, j)] * free[(j, 0)]).abs()).sum();
            }
            let wanted = wanted.col_as_slice(0);
            vi::dense(
                &stiffness,
                wanted,
                &bounds.lower,
                &bounds.upper,
                &mut sides,
                &mut values,
                &mut reactions,
            );
        }
    }
    let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= roundings * f64::EPSILON * scale;
    let mut undecided = Vec::new();
    for i in 0..bounds.len() {
        if bounds.holds(i) {
            sides[i] = Side::Lower;
            continue;
        }
        let size: f64 = (0..state.nrows()).map(|k| (reduction.lift_at[(i, k)] * state[(k, 0)]).abs()).sum();
        let size = size + reduction.rest_at[(i, 0)].abs();
        match sides[i] {
            Side::Free if near(values[i], bounds.lower[i], size) => undecided.push((i, Side::Lower)),
            Side::Free if near(values[i], bounds.upper[i], size) => undecided.push((i, Side::Upper)),
            Side::Free => {}
            side if near(reactions[i], 0.0, scale[i]) => undecided.push((i, side)),
            _ => {}
        }
    }
    switch::next_sides(reduction, &sides, &undecided, state, &reactions, roundings)
}

impl<E: Engine> Scheme for Exact<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.n += 1;
        let time = self.time();
        let mut switches = 0;
        // Where the state is, counted from the start of the motion.
        let mut from = (self.n - 1) as f64 * self.dt - self.motion.start;
        self.impulses.fill(0.0);
        loop {
            let until = time - self.motion.start;
            self.search.extend(&self.motion, until);
            let Some((at, bound)) = self.search.next.filter(|(at, _)| *at <= until) else { break };
            if switches == self.options.events_per_step {
                let place = format!("bound {bound}");
                return Err(Error::Events {
                    step: self.n,
                    time: self.motion.start + at,
                    count: switches,
                    bound,
                    place,
                });
            }
            switches += 1;
            self.add_impulses(at - from, false);
            self.switch(at, bound)?;
            from = 0.0;
        }
        match switches {
            0 => self.add_impulses(self.dt, true),
            _ => self.add_impulses(time - self.motion.start, false),
        }
        self.motion.walk(time - self.motion.start, self.dt, &mut self.state);
        self.watch();
        if switches > 0 || self.n.is_multiple_of(JUDGE_EVERY) {
            self.judge()?;
        }
        self.verdict.iterations = u32::try_from(switches).unwrap_or(u32::MAX);
        Ok(())
    }

    fn step(&self) -> u64 {
        self.n
    }

    fn time(&self) -> f64 {
        self.n as f64 * self.dt
    }

    fn displacement(&self) -> &[f64] {
        &self.shape().displacement
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        let Reduction { lift, push, .. } = &self.reduction;
        let modes = &self.motion.modes;
        let touching = |i: usize| modes.sides[i] != Side::Free;
        let forces =
            Mat::from_fn(modes.sides.len(), 1, |i, _| if touching(i) { self.watched[(i, 1)] } else { 0.0 });
        let rates = lift * (&modes.vectors * self.state.get(.., 1..)) + push * forces;
        Ok(rates.col_as_slice(0).to_vec())
    }

    fn admissible(&self) -> &[f64] {
        &self.admissible
    }

    fn limits(&self) -> &Bounds {
        &self.system.bounds
    }

    /// Those of the present instant.
    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    /// Integrals of the reactions, from event to event in closed form.
    fn impulses(&self) -> &[f64] {
        &self.impulses
    }

    fn energies(&self) -> Result<Energies> {
        let Shape { displacement, velocity, .. } = self.shape();
        let elastic = self.system.force(displacement, &mut vec![0.0; displacement.len()])?;
        let kinetic = 0.5 * self.system.engine.vis_viva(&self.system.mass, velocity)?;
        Ok(Energies { kinetic, elastic, work: self.system.work(displacement)? })
    }

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        self.touches[bound]
    }

    fn state(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.n)?;
        archive.value(&mut self.verdict)?;
        archive.value(&mut self.tally)?;
        archive.value(&mut self.events)?;
        Approach::archive(&mut self.touches, archive)?;
        archive.vector(Over::Bounds, &mut self.impulses)?;
        let mut state = [0, 1].map(|j| self.state.col_as_slice(j).to_vec());
        archive.value(&mut state)?;
        let mut sides = self.motion.modes.sides.clone();
        archive.value(&mut sides)?;
        if !archive.saves() {
            self.state = Mat::from_fn(self.state.nrows(), 2, |k, j| state[j][k]);
            let modes = self.cache.get(self.system, &self.reduction, &sides)?;
            self.motion = Motion::new(modes, 0.0, &self.state);
        }
        self.cache.archive(archive)?;
        self.motion.archive(archive)?;
        if !archive.saves() {
            let ExactOptions { stride, roundings, .. } = self.options;
            self.search = Search::new(&self.motion, stride, roundings, 0);
            self.watch();
        }
        self.search.archive(&self.motion, archive)
    }

    fn factorisations(&self) -> u64 {
        self.cache.computed
    }

    fn take_events(&mut self) -> Vec<Event> {
        std::mem::take(&mut self.events)
    }

    fn tally(&self) -> Option<Tally> {
        Some(Tally {
            active_sets: self.cache.computed,
            cached_bytes: self.cache.peak,
            evaluations: self.tally.evaluations + self.search.evaluations,
            ..self.tally
        })
    }
}
