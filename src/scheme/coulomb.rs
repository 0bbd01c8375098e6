//! Friction of obstacles at the nodes that touch.
//!
//! The faces of a plate slide although its middle plane does not: the point that touches an
//! obstacle below lies half the thickness under it, and moves in the plane by `$a \nabla w$` with
//! the arm a = h/2 (by `$-a \nabla w$` at an obstacle above). Coulomb's law for its slip is one for
//! the slopes of the node, see [`crate::vi::coulomb`]: a moment m of at most `$\mu N a$`, against
//! the slip of the slopes relative to the obstacle's path b,
//!
//! ```math
//! s = \nabla w^{n+1} - \nabla w^n \mp \frac{b^{n+1} - b^n}{a} .
//! ```
//!
//! For Newmark with e = 0 that is the slip to the bounded configuration `$U^{n+1}$`; for the
//! midpoint rule the slip to `$U^{n+1/2}$` is half of it. A massless rest in equilibrium obeys the
//! law once more at the end of a step, for the slip from its start, see [`super::Potential`].
//!
//! # Solution of a step
//!
//! With given moments the step is a problem like any other, and its solver gives reactions and
//! slips. The moments that go with them follow from a dense problem on the nodes that touch: the
//! compliance of their slopes while the present contacts stay closed, and the reactions that their
//! moments cause. The two problems alternate until the law holds for the solver's own answer. The
//! compliance comes from one solve for each node and slope, kept from step to step.
//!
//! # Energy
//!
//! The moments do the work `$m \cdot (s + b/a)$` in a step: the obstacle's motion puts in
//! `$m \cdot b/a$`, and `$-m \cdot s$` becomes heat. For the midpoint rule both are exact, and the heat
//! is never negative while the slopes go straight on. In Newmark's scheme each instant has a heat:
//! the moment there works along `$\tfrac12 (U^{n+1} - U^{n-1})$`. A step takes the mean of the heat
//! of its two instants. The energy balances to rounding, too, but this mean may be negative by a
//! little where a node turns round.

mod compliances;

use crate::archive::{Archive, VectorKind};
use crate::communicator::Communicator;
use crate::contact_law::ContactLaw;
use crate::error::Result;
use crate::linalg::vectors::largest;
use crate::linalg::{Engine, LinearCombination};
use crate::obstacle::Bounds;
use crate::vi::coulomb::{CoulombProblem, law_error};
use compliances::ContactCompliances;
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use std::fmt;

/// Largest number of rounds in a step: its own problem, then the moments.
const MOST_ROUNDS: u32 = 60;
/// Number of rounds after which moments move only half of the way.
const EAGER_ROUNDS: u32 = 20;
/// Relative error of the law that ends the rounds of a step.
const CLOSE: f64 = 1e-13;
/// Relative error of the law that ends them once a round does not halve it.
const ACCEPTED: f64 = 1e-11;
/// Compliance that every slope has beside its own, relative to the largest one, since supports may
/// hold it.
const HELD: f64 = 1e-13;

/// Path of an obstacle along x and y, in m, as a function of a node's number, its side (0 below, 1
/// above) and two instants, in s.
pub type PathOfObstacle = dyn Fn(usize, usize, [f64; 2]) -> Result<[f64; 2]>;

/// Obstacles with friction, and the nodes of this rank that they face.
pub struct ContactFriction {
    /// Nodes that face an obstacle with friction.
    pub nodes: Vec<FrictionalNode>,
    /// Number of obstacles of the scene.
    pub obstacles: usize,
    /// Paths of the obstacles in their plane; `None` where all stand still.
    pub path: Option<Box<PathOfObstacle>>,
}

impl fmt::Debug for ContactFriction {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("ContactFriction").field("nodes", &self.nodes).finish_non_exhaustive()
    }
}

/// Node that faces an obstacle with friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionalNode {
    /// Index of the bound of its deflection.
    pub bound: usize,
    /// Dof of w_x and of w_y, and the factor of each; `None` where a support holds it.
    pub slopes: [Option<(usize, f64)>; 2],
    /// Friction of the obstacle below and of the one above.
    pub sides: [Option<FrictionalSide>; 2],
}

/// Friction of an obstacle at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionalSide {
    /// Number of the obstacle in the scene.
    pub obstacle: usize,
    /// Coefficient of friction, dimensionless.
    pub coefficient: f64,
    /// Distance a of the face from the middle plane, in m.
    pub arm: f64,
}

impl FrictionalSide {
    /// Returns the largest moment per force of the contact, in m.
    fn grip(self) -> f64 {
        self.coefficient * self.arm
    }
}

/// Friction at a node in the last step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct NodalFriction {
    /// Index of the bound of its deflection.
    pub bound: usize,
    /// Moments on w_x and w_y of the plate, in N m.
    pub moment: [f64; 2],
    /// Slip of the face relative to the obstacle over the step, along x and y, in m.
    pub slip: [f64; 2],
    /// Whether the node sticks.
    pub sticks: bool,
}

/// Rounds of one step: its own problem, then the moments.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rounds {
    /// Number of rounds.
    round: u32,
    /// Iterations of the law.
    pub iterations: u32,
    /// Error of the law for the last answer, relative to the step, and to all slopes.
    last: f64,
    pub error: f64,
}

impl Rounds {
    /// Solves a step in rounds, until a round returns that no further one is needed.
    pub fn run(mut round: impl FnMut(&mut Rounds) -> Result<bool>) -> Result<Rounds> {
        let mut rounds = Rounds::default();
        while round(&mut rounds)? {}
        Ok(rounds)
    }
}

impl Default for Rounds {
    fn default() -> Rounds {
        Rounds { round: 0, iterations: 0, last: f64::INFINITY, error: f64::INFINITY }
    }
}

/// State of a node in the last step.
#[derive(Debug, Clone, Copy, Default)]
struct NodeState {
    /// Moment on w_x and w_y, in N m.
    moment: [f64; 2],
    /// Slip of the slopes to the bounded configuration.
    slip: [f64; 2],
    /// Radius of the disc of its moments, in N m.
    radius: f64,
    /// Side of the obstacle that it presses on: 0 below, 1 above; `None` off both.
    side: Option<usize>,
}

/// Friction of the steps of one scheme.
pub(super) struct CoulombFriction<'s> {
    given: &'s ContactFriction,
    /// Share of a step that lies before its bounded configuration.
    share: f64,
    states: Vec<NodeState>,
    /// Slopes that the paths of the obstacles amount to over the present step and the one before,
    /// below and above.
    paths: Vec<[[f64; 2]; 2]>,
    paths_before: Vec<[[f64; 2]; 2]>,
    /// Slip that does not depend on x, below and above, and the weight of x in the slip.
    constant: Vec<[[f64; 2]; 2]>,
    weight: f64,
    /// Largest slope of u, from which the step starts.
    steepest: f64,
    /// Stiffness by which an error of the slip is measured, in N m, one entry per node.
    rho: Vec<f64>,
    compliance: ContactCompliances,
    /// Work of the obstacles' motion, then the heat of each obstacle, in J, each with its present
    /// increment.
    ledger: Vec<[f64; 2]>,
}

impl<'s> CoulombFriction<'s> {
    /// Prepares steps with a matrix, whose bounded configuration lies after a share of the step.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new<E: Engine>(
        given: &'s ContactFriction,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        share: f64,
    ) -> Result<CoulombFriction<'s>> {
        let diagonal = engine.diagonal(matrix)?;
        let rho = |node: &FrictionalNode| {
            node.slopes.iter().flatten().map(|(dof, _)| diagonal[*dof]).fold(0.0, f64::max)
        };
        let count = given.nodes.len();
        Ok(CoulombFriction {
            given,
            share,
            states: vec![NodeState::default(); count],
            paths: vec![[[0.0; 2]; 2]; count],
            paths_before: vec![[[0.0; 2]; 2]; count],
            constant: vec![[[0.0; 2]; 2]; count],
            weight: 1.0,
            steepest: 0.0,
            rho: given.nodes.iter().map(rho).collect(),
            compliance: ContactCompliances::new(bounds, given.nodes.iter().flat_map(|node| node.slopes)),
            ledger: vec![[0.0; 2]; 1 + given.obstacles],
        })
    }

    /// Computes the paths of the obstacles between two instants (s), a step apart. Collective.
    ///
    /// # Errors
    /// Returns the errors of the obstacles' velocities.
    pub fn set_paths(&mut self, comm: &impl Communicator, times: [f64; 2]) -> Result<()> {
        let Some(path) = &self.given.path else { return Ok(()) };
        let path = |(number, node): (usize, &FrictionalNode)| {
            let mut slopes = [[0.0; 2]; 2];
            for (side, friction) in node.sides.iter().enumerate() {
                let Some(FrictionalSide { arm, .. }) = friction else { continue };
                let arm = if side == 0 { *arm } else { -arm };
                slopes[side] = path(number, side, times)?.map(|part| part / arm);
            }
            Ok(slopes)
        };
        let paths = comm.all_ok(self.given.nodes.iter().enumerate().map(path).collect())?;
        self.paths_before = std::mem::replace(&mut self.paths, paths);
        Ok(())
    }

    /// Begins the solution of a step whose bounded configuration is u, c x and a constant part,
    /// given c, and that part and u by dof, in m.
    pub fn begin_step(&mut self, c: f64, constant: impl Fn(usize) -> f64, u: impl Fn(usize) -> f64) {
        self.weight = c;
        let slopes = self.given.nodes.iter().flat_map(|node| node.slopes).flatten();
        self.steepest = slopes.map(|(dof, factor)| (factor * u(dof)).abs()).fold(0.0, f64::max);
        for ((node, sides), paths) in self.given.nodes.iter().zip(&mut self.constant).zip(&self.paths) {
            let slope = node.slopes.map(|slope| slope.map_or(0.0, |(dof, factor)| factor * constant(dof)));
            for (slip, path) in sides.iter_mut().zip(paths) {
                *slip = [0, 1].map(|k| slope[k] - self.share * path[k]);
            }
        }
    }

    /// Adds the moments to a load, in N, one entry per dof.
    pub fn add_moments(&self, load: &mut [f64]) {
        for (node, state) in self.given.nodes.iter().zip(&self.states) {
            for (slope, moment) in node.slopes.iter().zip(state.moment) {
                slope.iter().for_each(|&(dof, factor)| load[dof] += factor * moment);
            }
        }
    }

    /// Takes sides, radii and slips out of an answer (x in m, reactions in N). Returns the error of
    /// the moments, relative to the radii or, if that is smaller, of the slip relative to the
    /// slopes of the step; then the same relative to all slopes, which rounding is a part of.
    /// Collective.
    fn read_answer(&mut self, comm: &impl Communicator, [x, reaction]: [&[f64]; 2]) -> [f64; 2] {
        let [mut largest_moment, mut largest_slope] = [0.0_f64; 2];
        let nodes = self.given.nodes.iter().zip(&mut self.states);
        for ((node, state), constant) in nodes.zip(&self.constant) {
            let r = reaction[node.bound];
            let side = usize::from(r < 0.0);
            let friction = node.sides[side].filter(|_| r != 0.0);
            state.side = friction.map(|_| side);
            state.radius = friction.map_or(0.0, |side| side.grip() * r.abs());
            let slope = |k: usize| node.slopes[k].map_or(0.0, |(dof, factor): (usize, f64)| factor * x[dof]);
            state.slip = [0, 1].map(|k| constant[side][k] + self.weight * slope(k));
            largest_moment = largest_moment.max(state.radius).max(state.moment[0].hypot(state.moment[1]));
            for k in 0..2 {
                largest_slope =
                    largest_slope.max(constant[side][k].abs()).max((self.weight * slope(k)).abs());
            }
        }
        let [largest_moment, largest_slope, steepest] =
            comm.all_reduce_max_each([largest_moment, largest_slope, self.steepest]);
        if largest_moment == 0.0 {
            return [0.0; 2];
        }
        let errors = [largest_slope, largest_slope.max(steepest)].map(|slope| {
            let error = |(state, rho): (&NodeState, &f64)| {
                let rho = rho / self.weight;
                if rho == 0.0 {
                    let excess = state.moment[0].hypot(state.moment[1]) - state.radius;
                    return excess.max(0.0) / largest_moment;
                }
                let error = law_error(state.moment, state.slip, state.radius, rho);
                (error / largest_moment).min(error / (rho * slope))
            };
            largest(self.states.iter().zip(&self.rho).map(error))
        });
        comm.all_reduce_max_each(errors)
    }

    /// Takes an answer to the step with the present moments (x in m, reactions in N). Returns
    /// whether the moments changed, so that it is to be solved again. Collective.
    ///
    /// # Errors
    /// Returns the errors of [`CoulombFriction::solve_moments`].
    pub fn improve<E: Engine>(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        answer: [&[f64]; 2],
        rounds: &mut Rounds,
    ) -> Result<bool> {
        let [now, of_all] = self.read_answer(engine.comm(), answer);
        let before = std::mem::replace(&mut rounds.last, now);
        rounds.error = of_all;
        let is_accepted = now > 0.5 * before && (now <= ACCEPTED || of_all <= CLOSE);
        let is_done = now <= CLOSE || is_accepted || !now.is_finite();
        if is_done || rounds.round >= MOST_ROUNDS {
            return Ok(false);
        }
        rounds.iterations += self.solve_moments(engine, matrix, bounds, answer, rounds.round)?;
        rounds.round += 1;
        Ok(true)
    }

    /// Solves the law for the moments, while the contacts of an answer stay closed, after `round`
    /// rounds. Returns the number of iterations. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Usage`] where too many nodes touch, and the errors of the engine.
    fn solve_moments<E: Engine>(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        [x, reaction]: [&[f64]; 2],
        round: u32,
    ) -> Result<u32> {
        let comm = engine.comm();
        let softness = |bound: usize| softness(bounds, bound, x, reaction);
        let closed: Vec<(usize, f64)> =
            (0..bounds.len()).filter_map(|bound| Some((bound, softness(bound)?))).collect();
        let is_loaded = |node: &usize| {
            let NodeState { moment, side, .. } = self.states[*node];
            side.is_some() || moment != [0.0; 2]
        };
        let loaded: Vec<usize> = (0..self.states.len()).filter(is_loaded).collect();
        let (problem, first) = self.problem(engine, matrix, &closed, &loaded)?;
        let mut moments: Vec<[f64; 2]> =
            comm.all_gather(&loaded.iter().map(|&node| self.states[node].moment).collect::<Vec<_>>());
        let before = moments.clone();
        let iterations = problem.solve(&mut moments);
        // Rounding on unlike processors may differ.
        comm.broadcast(&mut moments);
        let part = if round < EAGER_ROUNDS { 1.0 } else { 0.5 };
        for (k, &node) in loaded.iter().enumerate() {
            let (to, from) = (moments[first + k], before[first + k]);
            self.states[node].moment = [0, 1].map(|k| from[k] + part * (to[k] - from[k]));
        }
        Ok(iterations)
    }

    /// Returns the dense problem of all ranks, and the place of this rank's first node in it, given
    /// its closed bounds with their compliances (m/N) and its loaded nodes. Collective.
    fn problem<E: Engine>(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        closed: &[(usize, f64)],
        loaded: &[usize],
    ) -> Result<(CoulombProblem, usize)> {
        let comm = engine.comm();
        let CoulombFriction { given, states, compliance, weight, .. } = self;
        let at_bounds: Vec<usize> = closed.iter().map(|(bound, _)| *bound).collect();
        let at_slopes: Vec<usize> = loaded.iter().flat_map(|&node| compliance.slopes(node)).collect();
        let [bounds, slopes] =
            [&at_bounds, &at_slopes].map(|local| ContactCompliances::everywhere(comm, local));
        compliance.extend(engine, matrix, &[&*bounds, &slopes].concat())?;
        // Deflections at closed bounds, and slopes, that unit forces and moments cause.
        let mut at_closed = compliance.block(comm, &at_bounds, &bounds);
        let softness = comm.all_gather(&closed.iter().map(|(_, softness)| *softness).collect::<Vec<_>>());
        softness.iter().enumerate().for_each(|(i, softness)| at_closed[(i, i)] += softness);
        let between = compliance.block(comm, &at_bounds, &slopes);
        let open = compliance.block(comm, &at_slopes, &slopes);
        // Reactions of the closed bounds to the moments.
        let mut reactions = -&between;
        match at_closed.llt(Side::Lower) {
            Ok(root) => root.solve_in_place(&mut reactions),
            // Bounds that depend on each other to rounding stay out.
            Err(_) => reactions.fill(0.0),
        }
        let total = open + between.transpose() * &reactions;
        let size = slopes.len();
        let mut slips = Mat::from_fn(size, size, |i, j| 0.5 * *weight * (total[(i, j)] + total[(j, i)]));
        let largest = (0..size).map(|i| slips[(i, i)]).fold(0.0, f64::max);
        let floor = HELD * if largest > 0.0 { largest } else { 1.0 };
        (0..size).for_each(|i| slips[(i, i)] += floor);

        let first_bound: usize = comm.all_gather_one(closed.len())[..comm.rank()].iter().sum();
        let node = |&node: &usize| {
            let (FrictionalNode { bound, sides, .. }, NodeState { slip, radius, side, .. }) =
                (given.nodes[node], states[node]);
            // The reaction of an obstacle above is negative.
            let sign = if side == Some(1) { -1.0 } else { 1.0 };
            let grip = side.and_then(|side| sides[side]).map_or(0.0, |side| sign * side.grip());
            let place = at_bounds.binary_search(&bound).map_or(usize::MAX, |place| first_bound + place);
            (place, grip, slip, radius)
        };
        let nodes: Vec<(usize, f64, [f64; 2], f64)> =
            comm.all_gather(&loaded.iter().map(node).collect::<Vec<_>>());
        let radius_rate = Mat::from_fn(nodes.len(), size, |node, column| match nodes[node] {
            (usize::MAX, ..) => 0.0,
            (place, grip, ..) => grip * reactions[(place, column)],
        });
        let problem = CoulombProblem {
            compliance: slips,
            slip: nodes.iter().map(|(.., slip, _)| *slip).collect(),
            radius: nodes.iter().map(|(.., radius)| *radius).collect(),
            radius_rate,
        };
        Ok((problem, comm.all_gather_one(loaded.len())[..comm.rank()].iter().sum()))
    }

    /// Returns the path of the obstacle that a node presses on, as slopes; 0 off obstacles.
    fn path(&self, node: usize) -> [f64; 2] {
        self.states[node].side.map_or([0.0; 2], |side| self.paths[node][side])
    }

    /// Returns the change of a node's slopes for a displacement by dof.
    fn change(&self, node: usize, displacement: impl Fn(usize) -> f64) -> [f64; 2] {
        self.given.nodes[node]
            .slopes
            .map(|slope| slope.map_or(0.0, |(dof, factor)| factor * displacement(dof)))
    }

    /// Returns work of the obstacles' motion and heat by obstacle (J) for a displacement by dof,
    /// and paths as slopes, of all ranks. Collective.
    fn exchange<E: Engine>(
        &self,
        engine: &E,
        displacement: impl Fn(usize) -> f64,
        path: impl Fn(usize) -> [f64; 2],
    ) -> Vec<f64> {
        let mut sums = vec![0.0; self.ledger.len()];
        for (number, (node, state)) in self.given.nodes.iter().zip(&self.states).enumerate() {
            let Some(FrictionalSide { obstacle, .. }) = state.side.and_then(|side| node.sides[side]) else {
                continue;
            };
            let (change, path) = (self.change(number, &displacement), path(number));
            for k in 0..2 {
                sums[0] += state.moment[k] * path[k];
                sums[1 + obstacle] -= state.moment[k] * (change[k] - path[k]);
            }
        }
        engine.comm().all_reduce_sum_slice(&sums)
    }

    /// Adds work and heat of a part of a step with constant moments to the ledger, given the
    /// displacement over it by dof, in m. Collective.
    pub fn add_step<E: Engine>(&mut self, engine: &E, displacement: impl Fn(usize) -> f64, part: f64) {
        let sums = self.exchange(engine, displacement, |node| self.path(node).map(|path| part * path));
        self.ledger.iter_mut().zip(sums).for_each(|(total, sum)| total[0] += sum);
    }

    /// Returns the work of the obstacles' motion less the heat, in J, over a displacement by dof
    /// (m) with the moments of the step. Collective.
    pub fn net_work<E: Engine>(&self, engine: &E, displacement: impl Fn(usize) -> f64) -> f64 {
        let work = |(node, state): (usize, &NodeState)| dot(state.moment, self.change(node, &displacement));
        engine.comm().all_reduce_sum(self.states.iter().enumerate().map(work).sum())
    }

    /// Extends the moments `from` of a state (N m, one entry per bound) to the fraction gamma of
    /// the step from it, in a straight line through the moments of its midpoint.
    /// Returns whether they obey the law there, with reactions in N, where all slopes go straight
    /// on. Collective.
    pub fn extend(
        &self,
        comm: &impl Communicator,
        gamma: f64,
        from: &[[f64; 2]],
        reaction: &[f64],
        to: &mut [[f64; 2]],
    ) -> bool {
        let (mut errors, mut largest_moment) = (Vec::new(), 0.0_f64);
        for ((node, state), rho) in self.given.nodes.iter().zip(&self.states).zip(&self.rho) {
            let (start, r) = (from[node.bound], reaction[node.bound]);
            let moment = [0, 1].map(|k| start[k] + 2.0 * gamma * (state.moment[k] - start[k]));
            let radius = node.sides[usize::from(r < 0.0)].map_or(0.0, |side| side.grip() * r.abs());
            let slip = state.slip.map(|slip| 2.0 * gamma * slip);
            errors.push(law_error(moment, slip, radius, rho / self.weight));
            largest_moment = largest_moment.max(radius).max(moment[0].hypot(moment[1]));
            to[node.bound] = moment;
        }
        let [error, largest_moment] = comm.all_reduce_max_each([largest(errors.into_iter()), largest_moment]);
        error <= ACCEPTED * largest_moment
    }

    /// Takes the moments of another step from the same state as a first guess.
    pub fn guess(&mut self, step: &CoulombFriction) {
        self.states.clone_from(&step.states);
    }

    /// Takes a part of the paths of another step.
    pub fn take_paths(&mut self, step: &CoulombFriction, part: f64) {
        for (paths, whole) in self.paths.iter_mut().zip(&step.paths) {
            *paths = whole.map(|path| path.map(|slope| part * slope));
        }
    }

    /// Writes the moments, in N m, one entry per bound.
    pub fn write_moments(&self, moments: &mut [[f64; 2]]) {
        for (node, state) in self.given.nodes.iter().zip(&self.states) {
            moments[node.bound] = state.moment;
        }
    }

    /// Returns the work of moments (N m, one entry per bound) over a displacement by dof (m), of
    /// this rank's nodes, in J.
    pub fn work_of(&self, moments: &[[f64; 2]], displacement: impl Fn(usize) -> f64) -> f64 {
        let work = |(number, node): (usize, &FrictionalNode)| {
            dot(moments[node.bound], self.change(number, &displacement))
        };
        self.given.nodes.iter().enumerate().map(work).sum()
    }

    /// Returns the dofs of this rank's slopes that stick, each with its rate in a step of `dt`
    /// seconds.
    pub fn stuck_slopes(&self, dt: f64) -> Vec<(usize, f64)> {
        let mut stuck: Vec<(usize, f64)> = Vec::new();
        for number in (0..self.states.len()).filter(|&number| self.sticks(number)) {
            for (slope, path) in self.given.nodes[number].slopes.iter().zip(self.path(number)) {
                let Some((dof, factor)) = *slope else { continue };
                if stuck.last().is_none_or(|(last, _)| *last != dof) {
                    stuck.push((dof, path / (factor * dt)));
                }
            }
        }
        stuck
    }

    /// Returns whether a node touches an obstacle with friction and sticks there.
    fn sticks(&self, number: usize) -> bool {
        let (state, rho) = (&self.states[number], self.rho[number] / self.weight);
        let trial = [0, 1].map(|k| state.moment[k] - rho * state.slip[k]);
        state.side.is_some() && trial[0].hypot(trial[1]) <= state.radius * (1.0 + ACCEPTED)
    }

    /// Adds the mean of work and heat at the instants n - 1 and n to the ledger, given the
    /// displacement from n - 1 to n + 1 by dof, in m. Collective.
    pub fn add_instant<E: Engine>(&mut self, n: u64, engine: &E, displacement: impl Fn(usize) -> f64) {
        let path = |node: usize| {
            let side = self.states[node].side.unwrap_or(0);
            // Before the start the obstacles moved as in the first step.
            let before = if n > 0 { &self.paths_before } else { &self.paths };
            [0, 1].map(|k| before[node][side][k] + self.paths[node][side][k])
        };
        let sums = self.exchange(engine, displacement, path);
        for (total, sum) in self.ledger.iter_mut().zip(sums) {
            let increment = 0.5 * sum;
            if n > 0 {
                total[0] += 0.5 * (total[1] + increment);
            }
            total[1] = increment;
        }
    }

    /// Returns the work of the obstacles' motion, in J, and its present increment.
    pub fn work(&self) -> [f64; 2] {
        self.ledger[0]
    }

    /// Returns the heat of each obstacle, in J.
    pub fn heat(&self) -> Vec<f64> {
        self.ledger[1..].iter().map(|[heat, _]| *heat).collect()
    }

    /// Returns the friction at the nodes that touched in the last step.
    pub fn at_nodes(&self) -> Vec<NodalFriction> {
        let node = |(number, node): (usize, &FrictionalNode)| {
            let NodeState { moment, slip, side, .. } = self.states[number];
            let (side, bound) = (side?, node.bound);
            let arm = node.sides[side]?.arm;
            let arm = if side == 0 { arm } else { -arm } / self.share;
            Some(NodalFriction { bound, moment, slip: slip.map(|s| arm * s), sticks: self.sticks(number) })
        };
        self.given.nodes.iter().enumerate().filter_map(node).collect()
    }

    /// Saves or restores the moments and the ledger.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, bounds: usize, archive: &mut Archive) -> Result<()> {
        let mut states = vec![NodeState::default(); bounds];
        for (node, state) in self.given.nodes.iter().zip(&self.states) {
            states[node.bound] = *state;
        }
        archive.items(
            VectorKind::Bounds,
            &mut states,
            |&NodeState { moment: [x, y], slip: [u, v], radius, side }| {
                [x, y, u, v, radius, side.map_or(-1.0, |side| side as f64)]
            },
            |[x, y, u, v, radius, side]| NodeState {
                moment: [x, y],
                slip: [u, v],
                radius,
                side: (side >= 0.0).then_some(side as usize),
            },
        )?;
        for (node, state) in self.given.nodes.iter().zip(&mut self.states) {
            *state = states[node.bound];
        }
        let mut paths = vec![[[0.0; 2]; 2]; bounds];
        self.given.nodes.iter().zip(&self.paths).for_each(|(node, path)| paths[node.bound] = *path);
        archive.items(
            VectorKind::Bounds,
            &mut paths,
            |&[[a, b], [c, d]]| [a, b, c, d],
            |[a, b, c, d]| [[a, b], [c, d]],
        )?;
        self.given.nodes.iter().zip(&mut self.paths).for_each(|(node, path)| *path = paths[node.bound]);
        archive.value(&mut self.ledger)
    }
}

/// Returns the product of two moments or slopes.
fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Returns the compliance of a closed bound (m/N), 0 for a rigid one; `None` for an open one, or
/// one whose force does not depend on x.
fn softness(bounds: &Bounds, bound: usize, x: &[f64], reaction: &[f64]) -> Option<f64> {
    let r = reaction[bound];
    if r == 0.0 {
        return None;
    }
    let Some(law) = bounds.laws.pressed(bound, r) else { return Some(0.0) };
    let depth = bounds.depth(bound, usize::from(r < 0.0), x[bounds.dofs[bound]]);
    let stiffness = law.linearised(depth, r.abs()).stiffness;
    (stiffness > 0.0).then(|| 1.0 / stiffness)
}
