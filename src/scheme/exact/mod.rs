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
//! The module `reduction` solves the saddle-point problem behind `$\varphi$`; `spectrum`
//! diagonalises the motion of each active set once, and `cache` keeps the result; `event_detection`
//! certifies intervals without events and locates the next event; `event_resolution` determines the
//! active set after it. The cost is N^3 per new active set for N cells, and N times the number of
//! bounded dofs per certified interval and per instant of output. With many velocities of modes the
//! eigenvectors of a set follow from those of the set before, at a fraction of the cost. The cache
//! of modes takes further memory ([`ExactOptions::memory`]).
//!
//! With velocities of modes (`modal_saddle_point`) the event detection watches only the nodes near
//! an obstacle. The module `reach` proves that no other node touches, and adds nodes as they come
//! near. N is then the number of modes, and no cost but that of the shape depends on the mesh.
//!
//! Mass-proportional damping damps all modes alike and is exact. With the singular mass of the
//! cells, damping proportional to the stiffness would give the massless part of U a rate of its
//! own, and is not supported. With the modal mass that part stays elastic, and modes may decay at
//! any rates. Contact then couples them, and `modes` takes the motion of a set from a nonsymmetric
//! eigenproblem of twice the size, for which a run takes six to eight times as long. Time-dependent
//! loads or obstacles are not supported: loads would need their particular solution for each mode.

mod cache;
mod decoupling;
mod energies;
mod event_detection;
mod event_resolution;
mod modes;
mod motion;
mod options;
mod reach;
pub(super) mod reduction;
mod residual;
pub(super) mod responses;
mod secular;
mod spectrum;
mod start;
mod stepping;

use super::massless::modal_saddle_point::ModalSaddlePoint;
use super::massless::saddle_point::{CellSaddlePoint, SaddlePointSolver};
use super::massless::velocity_basis::VelocityBasis;
use super::{Approach, Event, EventStatistics, Start, StepRecord, System};
use crate::error::{Error, Result};
use crate::linalg::{Engine, Form};
use crate::vi::BoundStatus;
use crate::vi::kkt::KktCheck;
use cache::Cache;
use event_detection::EventSearch;
use faer::Mat;
use motion::ModalSolution;
use options::require_memory;
pub use options::{ExactOptions, estimated_memory, expected_candidates};
use reach::Reach;
use reduction::ReducedModel;
use start::{check_rigid, first_sides};
use std::cell::OnceCell;
use std::rc::Rc;

/// Event-driven scheme at instant n of the time grid.
pub struct Exact<'s, E: Engine> {
    system: &'s System<E>,
    options: ExactOptions,
    saddle: Box<dyn SaddlePointSolver + 's>,
    reduction: ReducedModel,
    /// Nodes out of reach; `None` where all bounds are candidates.
    reach: Option<Reach>,
    cache: Cache,
    motion: ModalSolution,
    search: EventSearch,
    /// State of the modes' equations and its rate, and the watched quantities of the candidates
    /// with their rates.
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
    /// Acceleration v' + D v with the decay rates D, needed for the residual.
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
        let is_modal = matches!(mass, Form::Modal { .. });
        if !is_modal {
            if damping.stiffness != 0.0 {
                return Err(Error::Usage(
                    "time.scheme = \"exact\" takes damping by mass, not damping.stiffness; set time.scheme = \"newmark\" \
                     or time.mass = \"modal\""
                        .into(),
                ));
            }
            drive.refuse_modal("exact")?;
            drive.refuse_dashpots()?;
        } else {
            drive.refuse_viscous_tips()?;
        }
        if !bounds.laws.are_rigid() {
            return Err(Error::Usage(
                "time.scheme = \"exact\" takes no stops with a law other than \"linear\"; set law = \"linear\", or \
                 time.scheme = \"conserving\""
                    .into(),
            ));
        }
        if drive.varies() {
            return Err(Error::Usage(
                "time.scheme = \"exact\" takes loads and obstacles that do not change with time; \
                 set time.scheme = \"conserving\" or \"newmark\""
                    .into(),
            ));
        }
        require_memory(system, if is_modal { expected_candidates(bounds.len()) } else { bounds.len() })?;
        let inertia = match mass {
            Form::Modal { consistent, .. } => &Form::Cells(consistent.clone()),
            _ => mass,
        };
        let (basis, saddle): (_, Box<dyn SaddlePointSolver>) = match mass {
            Form::Modal { modes, .. } => (
                Rc::new(VelocityBasis::new(system)?),
                Box::new(ModalSaddlePoint::new(system, inertia, modes)?),
            ),
            _ => {
                let saddle = CellSaddlePoint::new(system)?;
                (saddle.basis.clone(), Box::new(saddle))
            }
        };
        // A ball has no stiffness: its rows are measured by its inertia.
        let with_mass = stiffness + inertia * saddle.shift();
        let check = KktCheck::with_inertia(engine, &stiffness.into(), &with_mass, bounds.magnitude())?;
        let first: Vec<usize> = if is_modal { Vec::new() } else { (0..bounds.len()).collect() };
        let mut reduction = ReducedModel::new(system, basis, &*saddle, &first)?;
        let mut reach = is_modal.then(|| Reach::new(&reduction, bounds, &options, dt));
        let columns = [&start.displacement, &start.velocity];
        let state = reduction.basis.of(system, &Mat::from_fn(engine.dofs(), 2, |i, j| columns[j][i]))?;
        let takes_changes = is_modal && reduction.stiffness.nrows() >= options.changes_from;
        let mut cache = Cache::new(options.memory, takes_changes);
        let (modal, motion) = loop {
            let sides = first_sides(&reduction, &state, options.roundings);
            let modes = cache.get(system, &reduction, &sides, None)?;
            let modal = modes.state(&state);
            let motion = ModalSolution::new(modes, 0.0, &modal);
            let near = reach.as_mut().map(|reach| reach.check(&reduction, bounds, &motion, 0.0));
            match near.filter(|near| !near.is_empty()) {
                Some(near) => grow(system, &*saddle, &mut reduction, &mut reach, near)?,
                None => break (modal, motion),
            }
        };
        check_rigid(system, &with_mass, &reduction, &motion.modes, &modal, &start.displacement)?;
        let search = EventSearch::new(&motion, options.stride, options.roundings, 0);
        let bounded = bounds.len();
        let mut exact = Exact {
            system,
            options,
            cache,
            motion,
            search,
            watched: Mat::zeros(reduction.candidates.len(), 2),
            shape: OnceCell::new(),
            events: Vec::new(),
            touches: Approach::at_start(bounds, &start.displacement, &start.velocity),
            check,
            record: StepRecord::new(dt, bounded),
            statistics: EventStatistics::default(),
            saddle,
            reduction,
            reach,
            state,
        };
        exact.record_far();
        exact.move_to(0.0);
        exact.check_shape()?;
        Ok(exact)
    }

    /// Sets the state to that of the present motion at an instant, in s.
    fn move_to(&mut self, time: f64) {
        self.motion.state(time, &mut self.state);
        self.watch();
    }

    /// Evaluates the watched quantities at the state.
    fn watch(&mut self) {
        let ReducedModel { candidates, bounds, .. } = &self.reduction;
        self.shape.take();
        self.motion.watch(&self.state, &mut self.watched);
        for (i, (side, &bound)) in self.motion.modes.sides.iter().zip(candidates).enumerate() {
            let y = self.watched[(i, 0)];
            (self.record.admissible[bound], self.record.reaction[bound]) = match side {
                BoundStatus::Free => (y, 0.0),
                BoundStatus::Lower => (bounds.lower[i], y),
                BoundStatus::Upper => (bounds.upper[i], y),
            };
        }
    }

    /// Records the deflections of the nodes out of reach, those of the last check.
    fn record_far(&mut self) {
        let Some(reach) = &self.reach else { return };
        let mut candidates = self.reduction.candidates.iter().peekable();
        for (i, place) in self.record.admissible.iter_mut().enumerate() {
            if candidates.next_if_eq(&&i).is_none() {
                *place = reach.values[(i, 0)];
            }
        }
    }

    /// Returns the reactions of the candidates, in N.
    fn reactions(&self) -> Vec<f64> {
        self.reduction.candidates.iter().map(|&bound| self.record.reaction[bound]).collect()
    }

    /// Returns the reactions of the candidates that belong to the state, in N: those of the record
    /// may be corrected with the shape.
    fn reactions_of_modes(&self) -> Vec<f64> {
        let reaction = |(i, side): (usize, &BoundStatus)| {
            if *side == BoundStatus::Free { 0.0 } else { self.watched[(i, 0)] }
        };
        self.motion.modes.sides.iter().enumerate().map(reaction).collect()
    }

    /// Returns U and v of the state, computed on first use.
    fn shape(&self) -> &Shape {
        self.shape.get_or_init(|| {
            let ReducedModel { lift, flexibility, rest, basis, candidates, bounds, .. } = &self.reduction;
            let modes = &self.motion.modes;
            let z = modes.place(&self.state);
            let reactions = self.reactions();
            let mut u = rest + lift * z.get(.., ..1);
            if reactions.iter().any(|r| *r != 0.0) {
                u += flexibility * Mat::from_fn(reactions.len(), 1, |i, _| reactions[i]);
            }
            for ((&dof, &bound), side) in bounds.dofs.iter().zip(candidates).zip(&modes.sides) {
                if *side != BoundStatus::Free {
                    u[(dof, 0)] = self.record.admissible[bound];
                }
            }
            let acceleration = modes.pull(&self.state);
            Shape {
                displacement: u.col_as_slice(0).to_vec(),
                velocity: basis.velocity(z.col_as_slice(1)),
                acceleration: basis.velocity(acceleration.col_as_slice(0)),
            }
        })
    }

    /// Returns the velocity `$V = C^{-1} B U'$` at the present instant, in m/s, one entry per cell.
    pub fn cell_velocity(&self) -> &[f64] {
        &self.shape().velocity
    }
}

/// Adds nodes that came into reach to the candidates.
fn grow<E: Engine>(
    system: &System<E>,
    saddle: &dyn SaddlePointSolver,
    reduction: &mut ReducedModel,
    reach: &mut Option<Reach>,
    near: Vec<usize>,
) -> Result<()> {
    require_memory(system, reduction.candidates.len() + near.len())?;
    reduction.extend(system, saddle, &near)?;
    reach.iter_mut().for_each(|reach| reach.grown.push(near.clone()));
    Ok(())
}
