//! Event-driven scheme: the exact motion of the semi-discrete problem (paper, equation 5).
//!
//! The scheme has no time discretisation error. Between two changes of the set of nodes in contact
//! the motion is a sum of sinusoids, and each change is located to rounding. The time grid only
//! determines the instants of output.
//!
//! # The motion in a potential
//!
//! Let B U = C p relate displacements to the cells' velocities p' = v, let K be positive definite
//! on ker B, and define
//!
//! ```math
//! \varphi(p) = \min \{ \tfrac12 U^T K U - F^T U : B U = C p, \; l \le G U \le u \}.
//! ```
//!
//! **Fact 1: `$\varphi$` is convex, `$C^{1,1}$` and piecewise quadratic.** *Proof.* The admissible
//! pairs (p, U) form a convex polyhedron, and the function is convex in U; its minimum over U is
//! convex in p, and piecewise quadratic (parametric quadratic programming). On the piece with
//! active set A the optimality conditions `$K U = F + B^T \mu + G^T r$`, with r = 0 off A, are
//! linear, and `$\nabla\varphi = C \mu$`. The minimiser U(p) is unique, since K is definite on ker
//! B. Suppose moreover that G maps ker B onto all deflections (the paper's inf-sup condition,
//! section 3: `$\inf_Q \sup_{W \in \ker B} Q \cdot G W / |Q||W| > 0$`). Then the feasible set is
//! never empty, and r, and hence `$\mu$`, is unique: on ker B the conditions read K U - F = G^T r,
//! and G is onto. Two pieces that meet at p therefore have the same `$\mu$` there:
//! `$\nabla\varphi$` is continuous and, being piecewise linear with finitely many pieces,
//! Lipschitz. ∎
//!
//! **Fact 2: the semi-discrete problem with the singular mass is** `$C p'' = -\nabla \varphi(p)$`.
//! *Proof.* `$M U'' + K U = F + G^T r$` with `$M = B^T C^{-1} B$` is `$K U = F - B^T p'' + G^T r$`:
//! the conditions above with `$\mu = -p''$`. ∎ With a regular mass the problem needs a law of
//! restitution and is still not well posed. With the singular mass it is an ordinary differential
//! equation with a Lipschitz right-hand side: each start has exactly one motion, forwards and
//! backwards in time; velocities never jump, and reactions are continuous (Renard, *The singular
//! dynamic method for constrained second order hyperbolic equations*, J. Comput. Appl. Math. 234,
//! 2010).
//!
//! **Fact 3: energy is conserved.** *Proof.*
//! `$\frac{d}{dt} (\tfrac12 v^T C v + \varphi(p)) = v^T (C p'' + \nabla\varphi(p)) = 0$`, across
//! changes of piece too, since `$\varphi$` is `$C^1$`. ∎ With damping alpha M the equation is
//! `$C (p'' + \alpha p') = -\nabla \varphi(p)$`, with a Lipschitz right-hand side as well, and the
//! energy decreases at the rate `$\alpha v^T C v$`. An impact converts energy into vibration and
//! conserves the sum. The formulas here conserve it to rounding, since each piece is advanced by
//! its exact solution.
//!
//! **Fact 4: failure without the inf-sup condition.** Suppose that a reaction Q acts on no W in ker
//! B. Then Q . G U is a function of p alone: the obstacle bounds p itself, `$\varphi$` is infinite
//! beyond, and the velocity must jump. (An example is P1 displacements with P0 velocities on a bar,
//! where ker B = {0}.) [`Exact::new`] computes the compliance `$G S G^T$` of the bounded dofs on
//! ker B, which is positive definite if and only if the inf-sup condition holds, and returns an
//! error otherwise.
//!
//! # Algorithm
//!
//! The module `reduction` solves the saddle-point problem behind `$\varphi$`; `modes` diagonalises
//! the motion of each active set once and caches the result; `event_detection` certifies intervals
//! without events and locates the next event; `event_resolution` determines the active set after
//! it. The cost is N^3 per new active set for N cells, and N times the number of bounded dofs per
//! certified interval and per instant of output. The cache of modes takes further memory
//! ([`ExactOptions::memory`]).
//!
//! Mass-proportional damping damps all modes alike and is exact. Stiffness-proportional damping and
//! time-dependent loads or obstacles are not supported: the massless part of U would have a rate of
//! its own, and modes would need the particular solution of each load.

mod eigen;
mod event_detection;
mod event_resolution;
mod modes;
mod motion;
mod reduction;
mod velocity_basis;

use super::{Approach, Event, EventStatistics, Scheme, Start, StepRecord, System};
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::linalg::vectors::{add, scale, sum};
use crate::memory;
use crate::obstacle::Bounds;
use crate::vi::kkt::KktCheck;
use crate::vi::{Answer, BoundStatus, DenseProblem, Problem};
use event_detection::EventSearch;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use faer::{Mat, Side as Triangle};
use modes::{Cache, Modes};
use motion::ModalSolution;
use reduction::{ReducedModel, SaddlePointSolver};
use std::cell::OnceCell;

/// Number of grid instants per check of the residual; instants after an event are always checked.
const CHECK_EVERY: u64 = 16;

/// KKT residual, dimensionless, above which a shape is corrected. Residuals of up to 1e-9 occur at
/// held nodes where a motion that the velocities hardly resolve is soft, such as two cells that can
/// almost turn without changing their means.
const MAX_SHAPE_RESIDUAL: f64 = 1e-11;

/// Largest total size of the dense arrays, in bytes. Beyond it the first diagonalisation alone
/// takes minutes, and impacts need hundreds.
const MAX_DENSE_MEMORY: usize = 1 << 33;

/// Returns the estimated peak memory of the dense arrays, in bytes.
pub fn estimated_memory(dofs: usize, cells: usize, bounded: usize) -> usize {
    // Number of arrays of these sizes held at once: in the solution for R, and in the
    // diagonalisation of a set.
    let (lifts, squares) = (7 * dofs * cells, 8 * cells * cells);
    let at_bounds = bounded * (2 * dofs + 4 * cells + 3 * bounded);
    // An impact visits about as many active sets as there are nodes that come into contact.
    let cached = bounded.max(1).saturating_mul(size_of::<f64>() * cells * (cells + bounded));
    size_of::<f64>() * (lifts + squares + at_bounds) + cached.min(ExactOptions::default().memory)
}

/// Options of the event detection. The motion depends on them only through rounding.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExactOptions {
    /// Multiple of the rounding error of a gap or reaction within which it counts as zero.
    pub roundings: f64,
    /// First interval of the search, in units of 1/w of the fastest mode.
    pub stride: f64,
    /// Memory of the cache of modes, in bytes.
    pub memory: usize,
    /// Largest number of events per grid step.
    pub events_per_step: u64,
}

impl Default for ExactOptions {
    fn default() -> ExactOptions {
        ExactOptions { roundings: 64.0, stride: 4.0, memory: 1 << 29, events_per_step: 1_000_000 }
    }
}

/// Event-driven scheme at instant n of the time grid.
pub struct Exact<'s, E: Engine> {
    system: &'s System<E>,
    options: ExactOptions,
    saddle: SaddlePointSolver<'s, E>,
    reduction: ReducedModel,
    cache: Cache,
    motion: ModalSolution,
    search: EventSearch,
    /// Modal state (q, q'), and the watched quantities with their rates.
    state: Mat<f64>,
    watched: Mat<f64>,
    /// U and v at the present instant, computed on request.
    shape: OnceCell<Shape>,
    events: Vec<Event>,
    touches: Vec<Approach>,
    check: KktCheck,
    record: StepRecord,
    statistics: EventStatistics,
}

/// State in the dofs of the structure.
#[derive(Debug)]
struct Shape {
    displacement: Vec<f64>,
    velocity: Vec<f64>,
    /// Acceleration v' + alpha v, needed for the residual.
    acceleration: Vec<f64>,
}

impl<'s, E: Engine> Exact<'s, E> {
    /// Starts the scheme from initial position and velocity, with output every `dt` seconds.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the mass is not singular, the inf-sup condition fails, or
    /// some motion has neither stiffness nor inertia, and [`Error::Usage`] where the dense matrices
    /// would be too large or the damping or loads are not supported.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<Exact<'s, E>> {
        Exact::with_options(system, dt, start, ExactOptions::default())
    }

    /// Starts the scheme like [`Exact::new`], with given options of the event detection.
    ///
    /// # Errors
    /// Returns the same errors as [`Exact::new`].
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
        if needed > MAX_DENSE_MEMORY {
            return Err(Error::Usage(format!(
                "time.scheme = \"exact\" would need {:.0} GB of dense matrices for {cells} cells; \
                 coarsen the mesh or set time.scheme = \"conserving\"",
                needed as f64 / 1e9
            )));
        }
        memory::require(needed as u64, &format!("time.scheme = \"exact\" with {cells} cells"), |_| {
            "coarsen the mesh or set time.scheme = \"conserving\"".into()
        })?;
        let saddle = SaddlePointSolver::new(system)?;
        let reduction = ReducedModel::new(&saddle)?;
        let of = [&start.displacement, &start.velocity];
        let state = reduction.basis.of(system, &Mat::from_fn(engine.dofs(), 2, |i, j| of[j][i]))?;
        let sides = first_sides(system, &reduction, &state, options.roundings);
        let mut cache = Cache::new(options.memory);
        let modes = cache.get(system, &reduction, &sides)?;
        let modal = modes.vectors.transpose() * &state;
        let motion = ModalSolution::new(modes, 0.0, &modal);
        check_rigid(system, &reduction, &motion.modes, &modal, &start.displacement)?;
        let search = EventSearch::new(&motion, options.stride, options.roundings, 0);
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
            watched: Mat::zeros(bounded, 2),
            shape: OnceCell::new(),
            events: Vec::new(),
            touches: bounds.dofs.iter().map(before).collect(),
            check: KktCheck::new(engine, &stiffness.into())?,
            record: StepRecord::new(dt, bounded),
            statistics: EventStatistics::default(),
            saddle,
            reduction,
            state,
        };
        exact.move_to(0.0);
        exact.check_shape()?;
        Ok(exact)
    }

    /// Sets the state to that of the present motion at an instant, in s.
    fn move_to(&mut self, at: f64) {
        self.motion.state(at, &mut self.state);
        self.watch();
    }

    /// Adds the impulses of the present motion over a duration (s) from the state on; `step` tells
    /// that the duration is a grid step.
    fn add_impulses(&mut self, seconds: f64, step: bool) {
        let modes = self.motion.modes.clone();
        let touching: Vec<usize> =
            (0..modes.sides.len()).filter(|&i| modes.sides[i] != BoundStatus::Free).collect();
        if touching.is_empty() || seconds == 0.0 {
            return;
        }
        let integral = self.motion.integral(&self.state, seconds, step);
        touching.iter().for_each(|&i| self.record.impulses[i] += seconds * modes.offset[i]);
        for (k, integral) in integral.into_iter().enumerate() {
            let column = modes.rows.col_as_slice(k);
            touching.iter().for_each(|&i| self.record.impulses[i] += integral * column[i]);
        }
    }

    /// Evaluates the watched quantities at the state.
    fn watch(&mut self) {
        let System { bounds, .. } = self.system;
        self.shape.take();
        self.motion.watch(&self.state, &mut self.watched);
        for (i, side) in self.motion.modes.sides.iter().enumerate() {
            let y = self.watched[(i, 0)];
            (self.record.admissible[i], self.record.reaction[i]) = match side {
                BoundStatus::Free => (y, 0.0),
                BoundStatus::Lower => (bounds.lower[i], y),
                BoundStatus::Upper => (bounds.upper[i], y),
            };
        }
    }

    /// Returns U and v of the state, computed on first use.
    fn shape(&self) -> &Shape {
        self.shape.get_or_init(|| {
            let ReducedModel { lift, flexibility, rest, basis, .. } = &self.reduction;
            let modes = &self.motion.modes;
            let z = &modes.vectors * &self.state;
            let forces = Mat::from_fn(self.record.reaction.len(), 1, |i, _| self.record.reaction[i]);
            let mut u = rest + lift * z.get(.., ..1);
            if self.record.reaction.iter().any(|r| *r != 0.0) {
                u += flexibility * forces;
            }
            for (i, (&dof, side)) in self.system.bounds.dofs.iter().zip(&modes.sides).enumerate() {
                if *side != BoundStatus::Free {
                    u[(dof, 0)] = self.record.admissible[i];
                }
            }
            let modal = |k: usize| modes.force[k] - modes.frequencies[k].powi(2) * self.state[(k, 0)];
            let acceleration = &modes.vectors * Mat::from_fn(modes.force.len(), 1, |k, _| modal(k));
            Shape {
                displacement: u.col_as_slice(0).to_vec(),
                velocity: basis.velocity(z.col_as_slice(1)),
                acceleration: basis.velocity(acceleration.col_as_slice(0)),
            }
        })
    }

    /// Checks the residual of the present shape, and corrects the shape where rounding is too large
    /// and the correction helps.
    fn check_shape(&mut self) -> Result<()> {
        self.record.report.kkt = self.residual()?;
        if self.record.report.kkt > MAX_SHAPE_RESIDUAL {
            let (shape, reaction) = self.corrected()?;
            let kept = (
                std::mem::replace(&mut self.shape, shape.into()),
                std::mem::replace(&mut self.record.reaction, reaction),
            );
            let corrected = self.residual()?;
            if corrected < self.record.report.kkt {
                self.record.report.kkt = corrected;
            } else {
                (self.shape, self.record.reaction) = kept;
            }
        }
        Ok(())
    }

    /// Returns the inertial force `$-B^T (v' + \alpha v)$` of the present shape, in N, one entry
    /// per dof.
    fn inertia(&self) -> Result<Vec<f64>> {
        let System { engine, mass, .. } = self.system;
        let mut b = vec![0.0; engine.dofs()];
        engine.project_transpose(mass, &self.shape().acceleration, &mut b)?;
        scale(-1.0, &mut b);
        Ok(b)
    }

    /// Returns the relative residual of `$K U = F - B^T (v' + \alpha v) + G^T r$` and of the
    /// bounds.
    fn residual(&mut self) -> Result<f64> {
        let System { engine, stiffness, bounds, load, .. } = self.system;
        let inertia = self.inertia()?;
        let mut displacement = self.shape().displacement.clone();
        let length = self.system.length(bounds, &displacement)?;
        let load = load.as_deref().unwrap_or(&[]);
        let problem = Problem { matrix: &stiffness.into(), rhs: load, bounds, length };
        let answer = Answer { x: &mut displacement, reaction: &mut self.record.reaction };
        self.check.residual(engine, &problem, &[&inertia], &answer)
    }

    /// Returns the present shape and reactions corrected by a solution of the saddle-point problem
    /// for their residual, with the active bounds held.
    fn corrected(&self) -> Result<(Shape, Vec<f64>)> {
        let System { bounds, .. } = self.system;
        let ReducedModel { lift_at, flexibility, compliance, basis, .. } = &self.reduction;
        let modes = &self.motion.modes;
        let Shape { displacement, velocity, acceleration } = self.shape();
        let column = |of: &[f64]| Mat::from_fn(of.len(), 1, |i, _| of[i]);
        let mut force = vec![0.0; displacement.len()];
        self.system.force(displacement, &mut force)?;
        add(&self.inertia()?, &mut force);
        bounds.add_transposed(&self.record.reaction, &mut force);
        let position = &modes.vectors * self.state.get(.., ..1);
        let position = position - basis.of(self.system, &column(displacement))?;
        let (mut du, mut da) = self.saddle.solve(column(&force), position)?;
        // The compliance of the active bounds is as definite as when the modes were found.
        let active: Vec<usize> = (0..bounds.len()).filter(|&i| modes.sides[i] != BoundStatus::Free).collect();
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
        du += flexibility * &forces;
        da += lift_at.transpose() * &forces;
        for &i in &active {
            du[(bounds.dofs[i], 0)] = 0.0;
        }
        let shape = Shape {
            displacement: sum(displacement, du.col_as_slice(0)),
            velocity: velocity.clone(),
            acceleration: sum(acceleration, &basis.velocity(da.col_as_slice(0))),
        };
        Ok((shape, sum(&self.record.reaction, forces.col_as_slice(0))))
    }

    /// Switches the active set at an event of the present motion, at the instant `at` (s).
    fn resolve_event(&mut self, at: f64, bound: usize) -> Result<()> {
        self.move_to(at);
        let before = self.motion.modes.clone();
        let mut undecided = self.search.at_limit(&self.motion, &self.watched);
        if undecided.iter().all(|(i, _)| *i != bound) {
            let middle = 0.5 * (before.limits[bound][0] + before.limits[bound][1]);
            let side = match before.sides[bound] {
                BoundStatus::Free if self.watched[(bound, 0)] > middle => BoundStatus::Upper,
                BoundStatus::Free => BoundStatus::Lower,
                side => side,
            };
            undecided.push((bound, side));
        }
        let state = &before.vectors * &self.state;
        let reduction = &self.reduction;
        let sides = event_resolution::next_sides(
            reduction,
            &before.sides,
            &undecided,
            &state,
            &self.record.reaction,
            self.options.roundings,
        );
        let arriving = self.watched.clone();
        let force = self.record.reaction.iter().sum();
        let modes = self.cache.get(self.system, reduction, &sides)?;
        let modal = modes.vectors.transpose() * state;
        let time = self.motion.start + at;
        self.statistics.evaluations += self.search.evaluations;
        let ExactOptions { stride, roundings, .. } = self.options;
        self.motion = ModalSolution::new(modes, time, &modal);
        self.search = EventSearch::new(&self.motion, stride, roundings, self.search.level);
        self.move_to(0.0);
        for (i, (&was, &is)) in before.sides.iter().zip(&sides).enumerate() {
            if was == is {
                continue;
            }
            let closes = is != BoundStatus::Free;
            let velocity = if closes { arriving[(i, 1)] } else { self.watched[(i, 1)] };
            self.events.push(Event { time, bound: i, closes, velocity, force });
            self.statistics.events += 1;
            if closes {
                self.touches[i] = Approach { time, deflection: self.record.admissible[i], velocity };
            }
        }
        Ok(())
    }

    /// Returns the velocity `$V = C^{-1} B U'$` at the present instant, in m/s, one entry per cell.
    pub fn cell_velocity(&self) -> &[f64] {
        &self.shape().velocity
    }
}

/// Strain of a motion, relative to that of its parts, below which it is rigid to rounding.
const RIGID_STRAIN: f64 = 1e-12;
/// Largest part of the initial elastic energy that may lie in motions taken for rigid.
const MAX_HIDDEN_ENERGY: f64 = 1e-6;

/// Checks that the rigid part of the initial state has no strain: the slowest modes of a strip ten
/// thousand times longer than wide are lost in the rounding error of the fastest.
fn check_rigid<E: Engine>(
    system: &System<E>,
    reduction: &ReducedModel,
    modes: &Modes,
    state: &Mat<f64>,
    start: &[f64],
) -> Result<()> {
    let System { engine, stiffness, .. } = system;
    let rigid = modes.vectors.get(.., ..modes.rigid) * state.get(..modes.rigid, ..1);
    let shape = &reduction.lift * rigid;
    let x = shape.col_as_slice(0);
    let (mut force, mut sizes) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    engine.multiply_with_magnitude(&stiffness.into(), x, &mut force, &mut sizes)?;
    let size = engine.dot(&sizes, &x.iter().map(|x| x.abs()).collect::<Vec<_>>())?;
    let energy = engine.multiply(stiffness, x, &mut force)?;
    let whole = engine.multiply(stiffness, start, &mut force)?;
    if energy > RIGID_STRAIN.powi(2) * size && energy > MAX_HIDDEN_ENERGY * whole {
        return Err(Error::Singular(
            "time.scheme = \"exact\": the slowest motions are lost in the rounding of the fastest; \
             set time.scheme = \"conserving\", or take cells that are less slender"
                .into(),
        ));
    }
    Ok(())
}

/// Returns the active set at the start: that of the minimiser U(p), and for nodes just in contact,
/// the side to which they move next.
fn first_sides<E: Engine>(
    system: &System<E>,
    reduction: &ReducedModel,
    state: &Mat<f64>,
    roundings: f64,
) -> Vec<BoundStatus> {
    let bounds = &system.bounds;
    let position = state.get(.., ..1);
    let free = &reduction.rest_at + &reduction.lift_at * position;
    let mut sides = vec![BoundStatus::Free; bounds.len()];
    let mut values = free.col_as_slice(0).to_vec();
    let mut reactions = vec![0.0; bounds.len()];
    let inside = |i: usize, value: f64| (bounds.lower[i]..=bounds.upper[i]).contains(&value);
    let mut scale: Vec<f64> = (0..bounds.len()).map(|_| 0.0).collect();
    if !values.iter().enumerate().all(|(i, &value)| inside(i, value)) {
        // The compliance is positive definite: checked by the reduction.
        if let Ok(llt) = reduction.compliance.llt(Triangle::Lower) {
            let stiffness = &llt.inverse();
            let wanted = stiffness * &free;
            for (i, scale) in scale.iter_mut().enumerate() {
                *scale = (0..bounds.len()).map(|j| (stiffness[(i, j)] * free[(j, 0)]).abs()).sum();
            }
            let (rhs, Bounds { lower, upper, .. }) = (wanted.col_as_slice(0), bounds);
            let mut answer = Answer { x: &mut values, reaction: &mut reactions };
            DenseProblem { matrix: stiffness, rhs, lower, upper }.solve(&mut sides, &mut answer);
        }
    }
    let near = |a: f64, b: f64, scale: f64| (a - b).abs() <= roundings * f64::EPSILON * scale;
    let mut undecided = Vec::new();
    for i in 0..bounds.len() {
        if bounds.holds(i) {
            sides[i] = BoundStatus::Lower;
            continue;
        }
        let size: f64 = (0..state.nrows()).map(|k| (reduction.lift_at[(i, k)] * state[(k, 0)]).abs()).sum();
        let size = size + reduction.rest_at[(i, 0)].abs();
        match sides[i] {
            BoundStatus::Free if near(values[i], bounds.lower[i], size) => {
                undecided.push((i, BoundStatus::Lower))
            }
            BoundStatus::Free if near(values[i], bounds.upper[i], size) => {
                undecided.push((i, BoundStatus::Upper))
            }
            BoundStatus::Free => {}
            side if near(reactions[i], 0.0, scale[i]) => undecided.push((i, side)),
            _ => {}
        }
    }
    event_resolution::next_sides(reduction, &sides, &undecided, state, &reactions, roundings)
}

impl<E: Engine> Scheme for Exact<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.record.begin_step();
        let time = self.time();
        let mut events = 0;
        // Time of the state, counted from the start of the motion.
        let mut from = (self.record.step - 1) as f64 * self.record.dt - self.motion.start;
        loop {
            let until = time - self.motion.start;
            self.search.extend(&self.motion, until);
            let Some((at, bound)) = self.search.next.filter(|(at, _)| *at <= until) else { break };
            if events == self.options.events_per_step {
                let place = format!("bound {bound}");
                return Err(Error::Events {
                    step: self.record.step,
                    time: self.motion.start + at,
                    count: events,
                    bound,
                    place,
                });
            }
            events += 1;
            self.add_impulses(at - from, false);
            self.resolve_event(at, bound)?;
            from = 0.0;
        }
        match events {
            0 => self.add_impulses(self.record.dt, true),
            _ => self.add_impulses(time - self.motion.start, false),
        }
        self.motion.walk(time - self.motion.start, self.record.dt, &mut self.state);
        self.watch();
        if events > 0 || self.record.step.is_multiple_of(CHECK_EVERY) {
            self.check_shape()?;
        }
        self.record.report.iterations = u32::try_from(events).unwrap_or(u32::MAX);
        Ok(())
    }

    /// Returns the record of the last step. Its reactions are those of the present instant, and its
    /// impulses the integrals of the reactions, in closed form from event to event.
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        &self.shape().displacement
    }

    fn velocity(&mut self) -> Result<Vec<f64>> {
        let ReducedModel { lift, flexibility, .. } = &self.reduction;
        let modes = &self.motion.modes;
        let touching = |i: usize| modes.sides[i] != BoundStatus::Free;
        let forces =
            Mat::from_fn(modes.sides.len(), 1, |i, _| if touching(i) { self.watched[(i, 1)] } else { 0.0 });
        let rates = lift * (&modes.vectors * self.state.get(.., 1..)) + flexibility * forces;
        Ok(rates.col_as_slice(0).to_vec())
    }

    fn limits(&self) -> &Bounds {
        &self.system.bounds
    }

    fn energies(&self) -> Result<Energies> {
        let Shape { displacement, velocity, .. } = self.shape();
        let elastic = self.system.force(displacement, &mut vec![0.0; displacement.len()])?;
        let kinetic = 0.5 * self.system.engine.mass_norm_squared(&self.system.mass, velocity)?;
        Ok(Energies { kinetic, elastic, work: self.system.work(displacement)? })
    }

    fn approach(&self, bound: usize) -> Approach {
        self.touches[bound]
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        archive.value(&mut self.statistics)?;
        archive.value(&mut self.events)?;
        Approach::archive(&mut self.touches, archive)?;
        let mut state = [0, 1].map(|j| self.state.col_as_slice(j).to_vec());
        archive.value(&mut state)?;
        let mut sides = self.motion.modes.sides.clone();
        archive.value(&mut sides)?;
        if !archive.saves() {
            self.state = Mat::from_fn(self.state.nrows(), 2, |k, j| state[j][k]);
            let modes = self.cache.get(self.system, &self.reduction, &sides)?;
            self.motion = ModalSolution::new(modes, 0.0, &self.state);
        }
        self.cache.archive(archive)?;
        self.motion.archive(archive)?;
        if !archive.saves() {
            let ExactOptions { stride, roundings, .. } = self.options;
            self.search = EventSearch::new(&self.motion, stride, roundings, 0);
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

    fn event_statistics(&self) -> Option<EventStatistics> {
        Some(EventStatistics {
            active_sets: self.cache.computed,
            cached_bytes: self.cache.peak,
            evaluations: self.statistics.evaluations + self.search.evaluations,
            ..self.statistics
        })
    }
}
