//! Conserving scheme: the midpoint rule with a relaxation that keeps the energy, external work
//! included, exact at every state.
//!
//! With the singular mass the impact problem is `$C \ddot p = -\nabla \varphi(p)$` with `$\varphi$`
//! convex, `$C^{1,1}$` and piecewise quadratic, see [`super::Potential`]. A state is (p, v), with
//! displacement U(p) and energy `$E(p, v) = \tfrac12 |v|_C^2 + \varphi(p)$`. A midpoint step
//! (paper, equation 6) gives
//!
//! ```math
//! dp = \Delta t\, (v + \tfrac12 dv), \qquad dv = -\Delta t\, C^{-1} \nabla \varphi(p + \tfrac12
//! dp) .
//! ```
//!
//! While the active bounds do not change, `$\varphi$` is quadratic along dp and the step conserves
//! E exactly. Where they change it does not, and the scheme then takes the relaxed step
//!
//! ```math
//! (p, v) \to (p + \gamma\, dp,\; v + \gamma\, dv), \quad t \to t + \gamma \Delta t, \qquad E(p +
//! \gamma\, dp, v + \gamma\, dv) = E_0
//! ```
//!
//! (relaxation after Ketcheson, SIAM J. Numer. Anal. 57, 2019; here for a potential that is only
//! `$C^{1,1}$`).
//!
//! # Such a gamma exists, is unique, and is at least 1/2
//!
//! Let m = p + dp/2 and w = v + dv/2 be the midpoint state. Since `$\varphi$` is convex and
//! `$m - p = \tfrac12 \Delta t\, w$`,
//!
//! ```math
//! \varphi(p) \ge \varphi(m) - \nabla\varphi(m) \cdot (m - p) = \varphi(m) + \tfrac12 w \cdot C\,
//! dv, \qquad
//!    \tfrac12 |v|_C^2 = \tfrac12 |w|_C^2 - \tfrac12 w \cdot C\, dv + \tfrac18 |dv|_C^2 ,
//! ```
//!
//! so that `$E(p, v) \ge E(m, w) + \tfrac18 |dv|_C^2$`: at gamma = 1/2 the energy is below its
//! value at gamma = 0. As a function of gamma the energy is convex and piecewise quadratic, and
//! grows without bound like `$\gamma^2 |dv|_C^2 / 2$`. It therefore returns to `$E_0$` exactly
//! once, at some gamma of at least 1/2. This holds for steps of any length: the scheme neither
//! gains nor loses energy. The root is found by Newton's method, with the curvature from the last
//! two slopes (exact once both lie in one quadratic piece) inside a bracket. Each trial evaluates
//! one U(p).
//!
//! There is no upper bound on gamma. A step whose midpoint is in stiff contact and whose end is in
//! free flight has a large gamma. A step that leaves contact for a force-free flight before its
//! midpoint has dv = 0, and no root unless it meets another obstacle. A step with gamma above
//! [`LONGEST`] is repeated with half the length, with a factor that is kept. For short enough steps
//! the midpoint has the active bounds of the start, and gamma is 1.
//!
//! # Damping, time-dependent loads and obstacles
//!
//! Mass-proportional damping, D = alpha M, dissipates `$\gamma \Delta t\, \alpha |w|_C^2$` in a
//! step, and E must return to `$E_0$` less the total dissipated. At the midpoint now
//! `$C\,dv = -\Delta t\,(\nabla\varphi(m) + \alpha C w)$`, so that the first inequality above gains
//! `$\tfrac12 \Delta t\, \alpha |w|_C^2$` on its right-hand side:
//!
//! ```math
//! E(p, v) \ge E(m, w) + \tfrac12 \Delta t\, \alpha |w|_C^2 + \tfrac18 |dv|_C^2 ,
//! ```
//!
//! and at gamma = 1/2 the energy is again below its target, a linear function of gamma. The rest of
//! the argument is unchanged. Stiffness-proportional damping is refused, since U is then no
//! function of p.
//!
//! Time-dependent loads and obstacles do the work
//!
//! ```math
//! \tfrac12 (F_0 + F_1) \cdot (U_\gamma - U_0) + r \cdot (l_\gamma - l_0) ,
//! ```
//!
//! with the loads `$F_0$`, `$F_1$` at the ends of the whole step, whose mean acts at the midpoint,
//! the midpoint reactions r, and the obstacles l in contact. A state is U(p) under the load and
//! within the obstacles of its own instant. While the active bounds do not change, U is affine in
//! p, F and l together, and the midpoint is the mean of both ends: this work is then exactly the
//! change of E at gamma = 1, and the step is a midpoint step at the cost of one. (With the load at
//! the midpoint's own instant, gamma - 1 would be of order dt in free flight.) Where the active
//! bounds change, a root gamma is not guaranteed. Where none is found after [`MOST_HALVINGS`]
//! halvings the energy target is kept, and later steps make up the difference.
//!
//! Where supports move, deflections are measured during a step relative to a frame that moves
//! uniformly to the support places one whole step later, see [`super::midpoint`]. No inertial force
//! arises in this frame for any gamma, and the above holds. The next step starts from where the
//! frame has arrived, the fraction gamma of the way, so that no kink is lost or counted twice.
//!
//! # Friction
//!
//! Where nodes touch with friction, a state also has the moments m of the massless rest, which
//! obey Coulomb's law for the slip from the state before, see [`super::Potential`]. The moments of
//! the midpoint do the work `$m_{1/2} \cdot (\nabla w_\gamma - \nabla w_0)$`, which is the work of
//! the obstacles' motion less the heat, and E must return to `$E_0$` plus this work. Where contacts
//! last and each node sticks or slides on in one direction, gamma = 1 does so, and the step costs
//! no search. Sliding that turns is relaxed like a change of contact.
//!
//! # Forces that depend on the deflection
//!
//! A plate whose mid-plane stretches has the further energy `$W(p) = V(\bar U(p))$`, with
//! `$\bar U(p)$` the displacement without obstacles: the massless rest only bends. A load that
//! depends on the deflection adds the negative of its work to W. A step from t to
//! `$t + \gamma \Delta t$` kicks the velocity by `$-\tfrac12 \Delta t\, C^{-1} \nabla W$`, then
//! takes the relaxed step above, which keeps its own part of the energy, and kicks by
//! `$-(\gamma - \tfrac12) \Delta t\, C^{-1} \nabla W$` at its end (Strang splitting).
//! `$C^{-1} \nabla W$` is the multiplier of the massless equilibrium at p = 0 under `$-V'$` and the
//! load. What the splitting changes the energy by, of third order in the step where contact does
//! not change, is taken from the rates of vibration; momentum and angular momentum stay. A step
//! that changes more than a hundredth of the kinetic energy of vibration is repeated with half the
//! length.
//!
//! # Order
//!
//! In free flight and in lasting contact gamma is 1 and the scheme is the midpoint rule, of second
//! order. A step in which contact changes has an error of `$O(\Delta t^2)$` for any gamma, since
//! only the slope of the acceleration jumps there. With finitely many contact changes the scheme is
//! again of second order, once the step resolves the fastest vibration. Measured on the paper's
//! plate, 10 x 4 cells, against the exact trajectory, root mean square error at the corners of the
//! tip:
//!
//! | element, highest frequency | time span | errors (m) at steps (s) |
//! |---|---|---|
//! | fvs, 9.1 kHz | 0.05 s, free flight | 1.1e-7 at 5e-6, 1.7e-8 at 2e-6, 4.4e-9 at 1e-6 |
//! | fvs | 0.1 s, one impact | 2.8e-5 at 5e-6, 4.9e-6 at 2e-6, 1.3e-6 at 1e-6 |
//! | fvs | 0.3 s, two impacts | 3.1e-3 at 5e-6, 3.9e-4 at 2e-6, 7.5e-5 at 1e-6 |
//! | hct, 61 kHz | 0.05 s, free flight | 9.6e-9 at 1e-6, 5.2e-10 at 2e-7, 2.6e-10 at 1e-7 (the reference's) |
//! | hct | 0.1 s, one impact | 1.8e-4 at 1e-6, 6.5e-5 at 5e-7, 6.2e-6 at 2e-7, 1.5e-6 at 1e-7 |
//!
//! At longer steps the order after an impact is about 1. Energy conservation alone does not
//! guarantee the trajectory: at these steps the errors of the plain midpoint rule are as large, and
//! two to three times as large at 1e-3 s, where its energy multiplies.
//!
//! # Cost
//!
//! A step whose active bounds do not change costs a midpoint step. A step in which they change
//! takes about four trials of gamma, with two or three multiplier rounds each. Processor time
//! relative to Newmark (measured): 1.2 at the paper's 5e-6 s; at 1e-4 s 1.5 on 10 x 4 cells and 2.2
//! on 80 x 32 cells, where a tenth of the steps are relaxed. The midpoint scheme, which needs U(p)
//! without a gamma, takes 1.1 to 1.3.
//!
//! # Reported quantities
//!
//! Steps of length gamma dt do not end at the grid instants n dt. The scheme advances until it has
//! reached or passed t = n dt and reports
//!
//! - the displacement interpolated linearly between the two states around t: admissible, since both
//!   are and the bounds are convex, and as accurate as the scheme (the interpolation error is
//!   `$\Delta t^2 / 8$` times the acceleration);
//! - the velocity as the rate of U(p) for the linearly interpolated V, so that the momentum is
//!   interpolated linearly too;
//! - the energies *of the state at or just after* t, without interpolation; states whose steps have
//!   gamma = 1 lie on the grid instants, whatever their rounding errors;
//! - the impulses of the obstacles from (n - 1) dt to n dt. A step changes the momentum by
//!   `$\gamma \Delta t\,(F - K U + G^T r)$` at its midpoint, divided among grid intervals in
//!   proportion to time, so that the impulses add up to the change of the reported momentum;
//! - the mean reactions over that time, i.e. the impulses divided by dt; at the start those at
//!   U(p).

mod kicks;

use super::coulomb::NodalFriction;
use super::drive::InstantData;
use super::massless::potential::Line;
use super::midpoint::MidpointRule;
use super::relaxation::{RelaxedStep, SAME_TIME, root};
use super::state::{State, SupportVelocities, change_frame};
use super::{Approach, Potential, Scheme, Solution, Start, Statistics, StepBalance, StepRecord, System};
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{axpy, divide};
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, SolverFactory};
use kicks::Kicks;
use std::ops::Range;
use std::rc::Rc;

/// Largest gamma accepted; after [`MOST_HALVINGS`] halvings the longest step, in units of dt.
pub const LONGEST: f64 = 2.5;
/// Largest number of halvings of a step whose gamma is above [`LONGEST`].
pub const MOST_HALVINGS: usize = 3;
/// Largest number of halvings where a root gamma exists up to rounding: contact that holds 1e-13 of
/// the energy ends within 1e-7 of its own period.
const ALL_HALVINGS: usize = 40;

/// Relative change of energy above which a step is relaxed: above the rounding error of a step, far
/// below the effect of a contact change.
const MOVED: f64 = 1e-13;
/// Relative energy error at which the search for gamma ends.
const KEPT: f64 = 4.0 * f64::EPSILON;
/// Range of gamma in which a step without a contact change makes up for earlier ones.
const STRAIGHT: Range<f64> = 0.9..1.1;
/// Largest relative change of energy that is rounding where contact does not change. It is removed
/// by scaling the velocity, since gamma would move the states off the grid instants, on either side
/// of them; with as little kinetic energy it is left to later steps.
const ROUNDED: f64 = 1e-10;
/// Statistics of the relaxation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct RelaxationStatistics {
    /// Number of steps of any length taken between the grid instants.
    pub states: u64,
    /// Number of steps with gamma other than 1, because contact changed.
    pub relaxed_steps: u64,
    /// Number of steps repeated with half the length.
    pub halved_steps: u64,
    /// Smallest gamma.
    pub least_gamma: f64,
    /// Largest gamma.
    pub largest_gamma: f64,
    /// Energy dissipated by damping and by dashpots of stops, in J.
    pub dissipated: f64,
    /// Part of it that dashpots of stops took, in J.
    pub dissipated_by_stops: f64,
}

impl Default for RelaxationStatistics {
    fn default() -> RelaxationStatistics {
        RelaxationStatistics {
            states: 0,
            relaxed_steps: 0,
            halved_steps: 0,
            least_gamma: 1.0,
            largest_gamma: 1.0,
            dissipated: 0.0,
            dissipated_by_stops: 0.0,
        }
    }
}

impl RelaxationStatistics {
    /// Counts a step with the energy (J) dissipated in it. Only a step that may be relaxed counts
    /// as such.
    pub(super) fn note(&mut self, gamma: f64, dissipated: f64, may_be_relaxed: bool) {
        self.dissipated += dissipated;
        self.states += 1;
        self.relaxed_steps += u64::from(may_be_relaxed && gamma != 1.0);
        self.least_gamma = self.least_gamma.min(gamma);
        self.largest_gamma = self.largest_gamma.max(gamma);
    }
}

/// Conserving scheme at grid instant n; see the [module page](self).
pub struct Conserving<'s, E: Engine> {
    system: &'s System<E>,
    /// Midpoint rules with steps of dt, dt/2, dt/4, ..., built as needed.
    rules: Vec<MidpointRule<'s, E>>,
    /// Index of the rule that led to the present state.
    last: usize,
    solver: &'s SolverFactory<E>,
    potential: Potential<'s, E>,
    kicks: Option<Kicks<'s, E>>,
    support_velocities: Rc<SupportVelocities>,
    /// Energy at the start, and work of time-dependent data and net work of friction since then,
    /// in J.
    start: f64,
    work: f64,
    /// State at or just after n dt, the state before it, the time between them (s), and the time
    /// from n dt to the later one (s).
    now: State,
    before: State,
    span: f64,
    ahead: f64,
    /// Reported U at n dt, in m.
    u: Vec<f64>,
    /// Bounds at n dt, where they move.
    limits: InstantData,
    /// Rates in the last step (m/s), and the last states without reaction, one entry per bound.
    rates: Vec<f64>,
    free: Vec<Approach>,
    relaxation: RelaxationStatistics,
    record: StepRecord,
    /// Balances of the last step of any length and of the last interval of the grid, if kept.
    balances: Option<[StepBalance; 2]>,
}

impl<'s, E: Engine + 'static> Conserving<'s, E> {
    /// Starts the scheme with the condensed solver and steps of `dt` seconds.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where `$4 M / \Delta t^2 + K$` is not positive definite,
    /// and [`crate::Error::Usage`] for stiffness-proportional or modal damping.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<Conserving<'s, E>> {
        Conserving::with_solver(system, dt, start, &|engine, sum, bounded| {
            Ok(Box::new(Condensed::new(engine, sum, bounded)?) as Box<dyn Solver<E>>)
        })
    }
}

impl<'s, E: Engine> Conserving<'s, E> {
    /// Starts the scheme with a factory of solvers for the step matrices `$4 M / \Delta t^2 + K$`,
    /// called as step lengths are needed. U(p) is always found by the condensed solver.
    ///
    /// # Errors
    /// Returns the same errors as [`Conserving::new`].
    pub fn with_solver(
        system: &'s System<E>,
        dt: f64,
        start: Start,
        solver: &'s SolverFactory<E>,
    ) -> Result<Conserving<'s, E>> {
        system.drive.refuse_modal("conserving")?;
        let bounds = &system.bounds;
        let mut now = State::new(system, start.displacement, &start.velocity)?;
        let support_velocities = Potential::support_velocities(system)?;
        let mut potential = Potential::new(system)?;
        let mut record = StepRecord::new(dt, bounds.len());
        record.report = potential.settle_state(&mut now)?;
        let kicks = Kicks::new(system, &mut potential, &mut now)?;
        record.reaction.copy_from_slice(&now.reaction);
        bounds.restrict(&now.u, &mut record.admissible);
        let mut rates = vec![0.0; bounds.len()];
        bounds.restrict(&start.velocity, &mut rates);
        let free = Approach::at_start(bounds, &now.u, &start.velocity);
        let mut scheme = Conserving {
            system,
            rules: Vec::new(),
            last: 0,
            solver,
            potential,
            kicks,
            support_velocities,
            start: now.energies.total(),
            work: 0.0,
            before: now.clone(),
            span: 0.0,
            ahead: 0.0,
            u: now.u.clone(),
            limits: now.instant.clone(),
            now,
            rates,
            free,
            relaxation: RelaxationStatistics::default(),
            record,
            balances: None,
        };
        scheme.add_rule(dt)?;
        scheme.rules[0].begin(&start.velocity, &scheme.now)?;
        Ok(scheme)
    }

    /// Adds the midpoint rule with a step of `dt` seconds.
    fn add_rule(&mut self, dt: f64) -> Result<()> {
        let System { engine, bounds, .. } = self.system;
        let solver = (self.solver)(engine, &MidpointRule::matrix(self.system, dt), bounds.len())?;
        self.rules.push(MidpointRule::new(self.system, dt, solver, self.support_velocities.clone())?);
        Ok(())
    }

    /// Adds the impulses of the reactions of the last step over a duration, in s, and its part of
    /// the balance.
    fn add_impulses(&mut self, seconds: f64) {
        let rule = &self.rules[self.last];
        axpy(seconds, &rule.driver.reaction, &mut self.record.impulses);
        if let Some([last, mean]) = &mut self.balances {
            mean.add(seconds / self.record.dt, last);
        }
    }

    /// Keeps the balance of the last step, from the state before it at `time` (s).
    fn keep_last_balance(&mut self, time: f64) -> Result<()> {
        let Some([last, _]) = &mut self.balances else { return Ok(()) };
        let rule = &self.rules[self.last];
        *last = rule.balance(&self.before.u, time)?;
        if let Some(kicks) = &self.kicks {
            let gamma = self.span / rule.dt;
            kicks.add_to(last, [0.5 / gamma, (gamma - 0.5) / gamma]);
        }
        Ok(())
    }

    /// Advances from the present state, at `time` (s), to the next.
    fn step_on(&mut self, time: f64) -> Result<()> {
        std::mem::swap(&mut self.now, &mut self.before);
        self.kicks.iter_mut().for_each(Kicks::begin_step);
        let balance = self.start + self.work - self.relaxation.dissipated;
        let exchanged = self.start.abs().max(self.work.abs()).max(self.relaxation.dissipated);
        let (mut halvings, mut lost_share) = (0, f64::INFINITY);
        loop {
            if halvings == self.rules.len() {
                self.add_rule(0.5 * self.rules[halvings - 1].dt)?;
            }
            let rule = &mut self.rules[halvings];
            let kicked = self.kicks.as_ref().map(|kicks| kicks.kicked(&self.before, rule.dt)).transpose()?;
            // After a kick the step keeps the energy that it has then.
            let (from, target) = match &kicked {
                Some(kicked) => (kicked, kicked.energies.total()),
                None => (&self.before, balance),
            };
            (self.now.stretching, self.now.followed) = (from.stretching, from.followed);
            let report = rule.solve(from, time)?;
            let mut line = self.potential.line(from, rule, time)?;
            line.at(1.0, &mut self.now)?;
            let straight = line.same_piece;
            let range = match halvings {
                _ if straight => STRAIGHT,
                _ if halvings < MOST_HALVINGS || kicked.is_some() => 0.5..LONGEST,
                _ => 0.5..LONGEST * f64::exp2(halvings as f64),
            };
            let most = if self.system.drive.varies() { MOST_HALVINGS } else { ALL_HALVINGS };
            let last = straight || halvings == most;
            let mut search = LineSearch { line: &mut line, target, exchanged, gamma: 1.0, to: &mut self.now };
            let [moved, _] = search.excess()?;
            let size = search.size();
            let mut gamma = Some(1.0);
            if straight && moved.abs() <= ROUNDED * size {
                if moved.abs() > MOVED * size && moved.abs() <= ROUNDED * self.now.energies.kinetic {
                    self.now.remove_energy(moved);
                }
            } else if moved.abs() > MOVED * size {
                gamma = root(&mut search, range)?;
                if gamma.is_none() && last {
                    line.at(1.0, &mut self.now)?;
                    gamma = Some(1.0);
                }
            }
            self.record.report = self.record.report.and(report).and(line.report);
            let relaxation = &mut self.relaxation;
            let Some(gamma) = gamma else {
                relaxation.halved_steps += 1;
                halvings += 1;
                continue;
            };
            let [work, dissipated] = line.exchange(gamma, &self.now)?;
            if let Some(kicks) = &mut self.kicks {
                let end = time + gamma * rule.dt;
                kicks.kick(&mut self.potential, &mut self.now, end, (gamma - 0.5) * rule.dt)?;
                let total = self.now.energies.total();
                let gained = total - (self.before.energies.total() + work - dissipated);
                let is_rounding = gained.abs() <= ROUNDED * exchanged.max(total.abs());
                let excess = total - (balance + work - dissipated);
                let share = gained.abs() / kicks.remove_energy(&mut self.now, excess)?;
                let is_small = is_rounding || share <= kicks::SCALED;
                // Where halving does not help, later steps make up the difference.
                if !is_small && halvings < most && share <= 0.5 * lost_share {
                    lost_share = share;
                    relaxation.halved_steps += 1;
                    halvings += 1;
                    continue;
                }
            }
            self.work += work;
            relaxation.note(gamma, dissipated, !straight);
            rule.driver.add_friction(gamma, [&self.before.u, &self.now.u]);
            self.span = gamma * rule.dt;
            self.work += self.now.follow_supports(self.system, &self.support_velocities, time + self.span)?;
            self.last = halvings;
            return Ok(());
        }
    }
}

/// States on the line of a step, with the energy at its start.
struct LineSearch<'a, 'l, 's, E: Engine> {
    line: &'a mut Line<'l, 's, E>,
    target: f64,
    /// Largest of the energies that the target is the sum of, in J.
    exchanged: f64,
    gamma: f64,
    to: &'a mut State,
}

impl<E: Engine> LineSearch<'_, '_, '_, E> {
    /// Returns the scale of the rounding errors of the excess, in J.
    fn size(&self) -> f64 {
        let Energies { kinetic, elastic, work } = self.to.energies;
        self.exchanged.max(kinetic + elastic + work.abs())
    }
}

impl<E: Engine> RelaxedStep for LineSearch<'_, '_, '_, E> {
    fn move_to(&mut self, gamma: f64) -> Result<()> {
        self.gamma = gamma;
        self.line.at(gamma, self.to)
    }

    /// Returns the energy beyond the target plus the work done and less the energy dissipated since
    /// the start of the line.
    fn excess(&self) -> Result<[f64; 2]> {
        let [work, dissipated] = self.line.exchange(self.gamma, self.to)?;
        let excess = self.to.energies.total() - (self.target + work - dissipated);
        Ok([excess, KEPT * self.size()])
    }

    fn slope(&mut self) -> Result<f64> {
        self.line.slope(self.gamma, self.to)
    }
}

impl<E: Engine> Solution for Conserving<'_, E> {
    /// Returns the record of the last step. Its bounded configuration is the reported displacement,
    /// and its reactions are the mean over the last dt; at the start they are those at U(p).
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        &self.u
    }

    /// Returns the rate of U(p) for the V interpolated between the states around the instant, with
    /// the nodes in contact at the later state following their obstacles, in m/s. At the start it
    /// is `$v_0$`.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let rule = &self.rules[self.last];
        if self.record.step == 0 {
            return Ok(rule.mean_rate());
        }
        let frame_rates = &rule.instants.frame_rates;
        // Measure both velocities relative to the frame of the step between the two states.
        let seen = |state: &State| {
            let mut v = state.v.clone();
            change_frame(&self.support_velocities, &state.frame_rates, frame_rates, &mut v);
            v
        };
        let (mut v, before) = (seen(&self.now), seen(&self.before));
        let share = self.ahead / self.span;
        v.iter_mut().zip(before).for_each(|(v, before)| *v += share * (before - *v));
        let rates = self.system.data_rates(self.time(), self.record.dt, frame_rates)?;
        let stuck = rule.driver.stuck_slopes(rule.dt);
        self.potential.rate(&v, &self.now.reaction, &rates, &stuck)
    }

    /// Returns the frame velocities during the last step, in m/s; at the start those of the
    /// motions.
    fn support_rates(&self) -> Result<Vec<f64>> {
        match self.record.step {
            0 => self.system.drive.rates(0.0),
            _ => Ok(self.rules[self.last].instants.frame_rates.clone()),
        }
    }

    /// Returns the bounds interpolated between the two states around the instant, in m.
    fn limits(&self) -> &Bounds {
        self.limits.bounds(&self.system.bounds)
    }

    /// Returns the energies of the state at or just after the instant.
    fn energies(&self) -> Result<Energies> {
        let energies = self.now.energies;
        let heat: f64 = self.dissipated_by_obstacles().iter().sum();
        Ok(Energies { work: energies.work + self.work + heat, ..energies })
    }

    /// Returns the friction in the last step, whatever its length, with its slip in a time dt.
    fn friction_at_nodes(&self) -> Vec<NodalFriction> {
        let rule = &self.rules[self.last];
        let mut nodes = rule.driver.friction_at_nodes();
        let steps = self.record.dt / rule.dt;
        nodes.iter_mut().flat_map(|node| &mut node.slip).for_each(|slip| *slip *= steps);
        nodes
    }

    fn approach(&self, bound: usize) -> Approach {
        self.free[bound]
    }
}

impl<E: Engine> Scheme for Conserving<'_, E> {
    fn advance(&mut self) -> Result<()> {
        // Before the first step these are the rates of the motions, of which no step tells yet.
        let frame_rates = self.support_rates()?;
        self.record.begin_step();
        self.record.report = Default::default();
        let dt = self.record.dt;
        if let Some([_, mean]) = &mut self.balances {
            *mean = StepBalance::zero(self.system);
        }
        let covered = self.ahead.min(dt);
        self.add_impulses(covered);
        self.ahead -= dt;
        let bounds = &self.system.bounds;
        while self.ahead < 0.0 {
            let time = self.time() + self.ahead;
            self.step_on(time)?;
            self.keep_last_balance(time)?;
            self.ahead += self.span;
            if self.ahead.abs() <= SAME_TIME * dt {
                self.ahead = 0.0;
            }
            self.add_impulses(self.span - self.ahead.max(0.0));
            let rule = &self.rules[self.last];
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                if self.before.reaction[i] == 0.0 {
                    self.free[i] = Approach { time, deflection: self.before.u[dof], velocity: self.rates[i] };
                }
                self.rates[i] = 2.0 / rule.dt * rule.driver.x[dof];
            }
        }
        let StepRecord { reaction, impulses, .. } = &mut self.record;
        reaction.copy_from_slice(impulses);
        divide(dt, reaction);
        let share = self.ahead / self.span;
        for (u, (now, before)) in self.u.iter_mut().zip(self.now.u.iter().zip(&self.before.u)) {
            *u = now + share * (before - now);
        }
        bounds.restrict(&self.u, &mut self.record.admissible);
        self.limits.extrapolate(&self.now.instant, &self.before.instant, share);
        let drive = &self.system.drive;
        let beyond: Vec<f64> =
            drive.places(self.time())?.iter().zip(&self.limits.places).map(|(s, frame)| frame - s).collect();
        drive.add_shapes(beyond.into_iter(), &mut self.u);
        if let Some([_, mean]) = &mut self.balances {
            let to = &self.rules[self.last].instants.frame_rates;
            mean.change_frame(dt, [&frame_rates, to], &self.support_velocities);
        }
        Ok(())
    }

    fn dissipated_by_obstacles(&self) -> Vec<f64> {
        let obstacles = self.system.drive.friction.as_ref().map_or(0, |friction| friction.obstacles);
        let mut heat = vec![0.0; obstacles];
        for rule in &self.rules {
            heat.iter_mut().zip(rule.driver.friction_heat()).for_each(|(sum, heat)| *sum += heat);
        }
        heat
    }

    /// Keeps the balance at the start, that of U(p).
    fn keep_balance(&mut self) -> Result<()> {
        let mut start = StepBalance::at_start(self.system, &self.now)?;
        self.potential.set_acceleration(&mut start);
        if let Some(kicks) = &self.kicks {
            start.followed.clear();
            kicks.add_to(&mut start, [0.0, 1.0]);
        }
        self.balances = Some([start.clone(), start]);
        Ok(())
    }

    /// Returns the mean balance over the last dt, in which the record begins with step 1.
    fn balance(&mut self) -> Result<StepBalance> {
        Ok(self.balances.clone().map_or_else(StepBalance::default, |[_, mean]| mean))
    }

    fn has_mean_reactions(&self) -> bool {
        true
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        for balance in self.balances.iter_mut().flatten() {
            balance.archive(archive)?;
        }
        for value in [&mut self.start, &mut self.work, &mut self.span, &mut self.ahead] {
            archive.value(value)?;
        }
        archive.value(&mut self.last)?;
        archive.value(&mut self.relaxation)?;
        self.now.archive(archive)?;
        self.before.archive(archive)?;
        self.limits.archive(archive)?;
        archive.vector(VectorKind::Dofs, &mut self.u)?;
        archive.vector(VectorKind::Bounds, &mut self.rates)?;
        Approach::archive(&mut self.free, archive)?;
        let mut rules = self.rules.len();
        archive.value(&mut rules)?;
        while self.rules.len() < rules {
            self.add_rule(0.5 * self.rules[self.rules.len() - 1].dt)?;
        }
        self.rules.iter_mut().try_for_each(|rule| rule.archive(archive))?;
        self.kicks.as_mut().map_or(Ok(()), |kicks| kicks.archive(archive))?;
        self.potential.archive(archive)
    }

    fn statistics(&self) -> Statistics {
        let of_rules: u64 = self.rules.iter().map(|rule| rule.driver.factorisations()).sum();
        let factorisations = self.potential.factorisations() + of_rules;
        Statistics { factorisations, relaxation: Some(self.relaxation), ..Statistics::default() }
    }
}
