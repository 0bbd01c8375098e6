//! The conserving scheme: the midpoint rule, relaxed so that every state has the energy of the start, and what came in since.
//!
//! With the singular mass the impact problem is `$C \ddot p = -\nabla \varphi(p)$`, with φ convex, C^1,1 and piecewise
//! quadratic, see [`super::potential`]; a state is (p, v), its displacement U(p), its energy
//! `$E(p, v) = \tfrac12 |v|_C^2 + \varphi(p)$`. A midpoint step gives
//!
//! ```math
//! dp = \Delta t\, (v + \tfrac12 dv), \qquad dv = -\Delta t\, C^{-1} \nabla \varphi(p + \tfrac12 dp) .
//! ```
//!
//! Where the active bounds stay, φ is quadratic along dp and the step keeps E exactly. Where they change it does not; then the
//! scheme goes
//!
//! ```math
//! (p, v) \to (p + \gamma\, dp,\; v + \gamma\, dv), \quad t \to t + \gamma \Delta t, \qquad E(p + \gamma\, dp, v + \gamma\, dv) = E_0
//! ```
//!
//! (relaxation: Ketcheson, SIAM J. Numer. Anal. 57, 2019; here for a potential that is only C^1,1).
//!
//! # Such a gamma exists, is unique, and is at least 1/2
//!
//! Let m = p + dp/2 be the middle and w = v + dv/2. As φ is convex and `$m - p = \tfrac12 \Delta t\, w$`,
//!
//! ```math
//! \varphi(p) \ge \varphi(m) - \nabla\varphi(m) \cdot (m - p) = \varphi(m) + \tfrac12 w \cdot C\, dv, \qquad
//!    \tfrac12 |v|_C^2 = \tfrac12 |w|_C^2 - \tfrac12 w \cdot C\, dv + \tfrac18 |dv|_C^2 ,
//! ```
//!
//! so that `$E(p, v) \ge E(m, w) + \tfrac18 |dv|_C^2$`: at gamma = 1/2 the energy is below its value at gamma = 0. In gamma it is
//! convex, piecewise quadratic, and tends to infinity with `$\gamma^2 |dv|_C^2 / 2$`: it comes back to E_0 once, at some gamma
//! of at least 1/2. This holds at every step, however long: the scheme never gains nor loses energy. The root is found by Newton's
//! method, with the curvature of the last two slopes (exact as soon as they lie in one piece) inside a bracket; each trial is one U(p).
//!
//! Above, gamma has no bound: a step that meets its middle in stiff contact and leaves in free flight comes out long; and one that leaves
//! contact for a flight without force before its middle has dv = 0, and no root unless it meets another obstacle. Past [`LONGEST`] it is done
//! again with half the step, on a factor that is kept. Of a step short enough the middle lies where the start does, and gamma is 1.
//!
//! # Damping, loads and obstacles that change with time
//!
//! Damping by mass, D = alpha M, takes `$\gamma \Delta t\, \alpha |w|_C^2$` of a step, and E must come back to E_0 less all that. In the middle
//! `$C\,dv = -\Delta t\,(\nabla\varphi(m) + \alpha C w)$` now, so that the first inequality above has `$\tfrac12 \Delta t\, \alpha |w|_C^2$` more on its right:
//!
//! ```math
//! E(p, v) \ge E(m, w) + \tfrac12 \Delta t\, \alpha |w|_C^2 + \tfrac18 |dv|_C^2 ,
//! ```
//!
//! and at gamma = 1/2 the energy is again below its target, a linear function of gamma. All else holds as it stands. Damping by
//! stiffness makes U no function of p, and is refused.
//!
//! What changes with time gives a step the work
//!
//! ```math
//! \tfrac12 (F_0 + F_1) \cdot (U_\gamma - U_0) + r \cdot (l_\gamma - l_0) ,
//! ```
//!
//! with the loads at the ends of the whole step, whose mean the middle has, the middle's reactions r, and the obstacles l that they belong
//! to; a state is U(p) under the load and within the obstacles of its own instant. While the active bounds stay, U is affine in p, F
//! and l together, and the middle is the mean of both ends: then this is the change of E at gamma = 1, exactly, and the step is a
//! midpoint step at its cost. (The load of the middle's own instant would leave gamma - 1 of order dt in free flight.) Where contact
//! changes nothing proves that a gamma exists; where none is found after [`MOST_HALVINGS`] the target stays, and later steps make up
//! for it.
//!
//! Where supports move, the deflections are counted during a step from a frame that goes evenly to the supports' place a whole step
//! later, see [`super::midpoint`]: nothing is inertial there, whatever gamma, and all above holds. The next step starts from where the
//! frame has come to, gamma of the way, so that no kink is lost or counted twice.
//!
//! # Order
//!
//! In free flight and in lasting contact gamma is 1 and the scheme is the midpoint rule: order 2. A step in which contact changes is off by
//! O(dt^2) whatever gamma, for the acceleration is continuous there and only its slope jumps: with finitely many changes order
//! 2 again, once the step follows the fastest motion. Measured on the paper's plate, 10 x 4 cells, against the exact trajectory, root mean
//! square error of the tip's corners:
//!
//! | element, fastest motion | up to | errors (m) at steps (s) |
//! |---|---|---|
//! | fvs, 9.1 kHz | 0.05 s, free flight | 1.1e-7 at 5e-6, 1.7e-8 at 2e-6, 4.4e-9 at 1e-6 |
//! | fvs | 0.1 s, one impact | 2.8e-5 at 5e-6, 4.9e-6 at 2e-6, 1.3e-6 at 1e-6 |
//! | fvs | 0.3 s, two impacts | 3.1e-3 at 5e-6, 3.9e-4 at 2e-6, 7.5e-5 at 1e-6 |
//! | hct, 61 kHz | 0.05 s, free flight | 9.6e-9 at 1e-6, 5.2e-10 at 2e-7, 2.6e-10 at 1e-7 (the reference's) |
//! | hct | 0.1 s, one impact | 1.8e-4 at 1e-6, 6.5e-5 at 5e-7, 6.2e-6 at 2e-7, 1.5e-6 at 1e-7 |
//!
//! At longer steps the order after an impact is about 1. Keeping the energy does not by itself keep to the trajectory: at these steps the
//! plain midpoint rule errs as much; where it multiplies its energy, at 1e-3 s, two to three times as much.
//!
//! # Cost
//!
//! A step whose active bounds stay is a midpoint step. One in which they change takes some four trials of gamma, two or three
//! rounds each. Over Newmark's time (measured, processor time): 1.2 at the paper's 5e-6 s; at 1e-4 s 1.5 on 10 x 4 and 2.2
//! on 80 x 32 cells, where a tenth of the steps are relaxed. The midpoint scheme, which needs U(p) without a gamma, takes 1.1 to 1.3.
//!
//! # What is reported
//!
//! Steps of gamma dt do not meet the grid of instants n dt. The scheme goes on until it has reached or passed t = n dt and reports
//! - the displacement on the chord between the two states around t: admissible, as both are and the bounds are convex, and as
//!   accurate as the scheme (the chord is off by dt^2/8 of the acceleration);
//! - the velocity on the chord between theirs, as the rate of U(p) that goes with it: its momentum is on the chord of momenta;
//! - the energies *of the state at or just after* t, an actual state of the scheme: nothing is interpolated there;
//! - the impulses of the obstacles from (n - 1) dt to n dt. A step changes the momentum by `$\gamma \Delta t\,(F - K U + G^T r)$` of its middle, and
//!   gives each instant between its ends its share: so the impulses add up to the change of the momentum reported;
//! - the reactions' mean over that time: their impulse over dt; at the start those at U(p).

use super::drive::Moment;
use super::half_step::{HalfStep, Images, State, change_frame};
use super::potential::Line;
use super::{Approach, Potential, Scheme, Start, System};
use crate::archive::{Archive, Over};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, SolverFactory, Verdict};
use std::ops::Range;
use std::rc::Rc;

/// The longest gamma accepted. After [`MOST_HALVINGS`] it is the longest step, in dt.
pub const LONGEST: f64 = 2.5;
/// Halvings that shorten a step which comes out long.
pub const MOST_HALVINGS: usize = 3;
/// Halvings where a gamma exists, but for rounding: contact that holds 1e-13 of the energy ends within 1e-7 of its own period.
const ALL_HALVINGS: usize = 40;

/// A step moves the energy if by more than this part of it: above what a step rounds off, far below what contact changes.
const MOVED: f64 = 1e-13;
/// The energy is kept if to this part of it.
const KEPT: f64 = 4.0 * f64::EPSILON;
/// What rounding alone has moved is put right within this range of gamma.
const ROUNDING: Range<f64> = 0.9..1.1;
/// Where that cannot, no force being at work, it is taken from the velocity if to this part of the kinetic energy, or left to a later step.
const ROUNDED: f64 = 1e-10;
/// Trials of gamma. Some four are enough; where rounding hides the root, bisection closes the bracket.
const MOST_TRIALS: usize = 60;

/// What it took to keep the energy.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Relaxation {
    /// Steps, of any length, that the scheme took between the instants of its grid.
    pub states: u64,
    /// Those with gamma other than 1 because contact changed.
    pub relaxed_steps: u64,
    /// Steps done again with half the length.
    pub halved_steps: u64,
    /// Least gamma.
    pub least_gamma: f64,
    /// Largest gamma.
    pub largest_gamma: f64,
    /// What damping has taken, in J.
    pub dissipated: f64,
}

/// The scheme at an instant n of its grid; see the [module page](self).
pub struct Conserving<'s, E: Engine> {
    system: &'s System<E>,
    /// Of dt, dt/2, dt/4, ... as far as they have been needed.
    halves: Vec<HalfStep<'s, E>>,
    /// Which of them led to the present state.
    last: usize,
    solver: &'s SolverFactory<E>,
    potential: Potential<'s, E>,
    images: Rc<Images>,
    /// The energy of the start, and the work that what changes with time has given since, in J.
    start: f64,
    given: f64,
    n: u64,
    /// The state at or just after n dt, the one before it, the time between them, and from n dt to the later one, in s.
    now: State,
    before: State,
    span: f64,
    ahead: f64,
    /// U at n dt, at the bounds, and mean reactions over the last dt.
    u: Vec<f64>,
    admissible: Vec<f64>,
    /// The bounds there, where they move.
    limits: Moment,
    reaction: Vec<f64>,
    /// Impulses of the obstacles over the last dt, in N s.
    impulses: Vec<f64>,
    /// Each bounded dof's rate in the last step, and where it last was without reaction.
    rates: Vec<f64>,
    free: Vec<Approach>,
    relaxation: Relaxation,
    verdict: Verdict,
}

impl<'s, E: Engine + 'static> Conserving<'s, E>
where
    E::Factor: 'static,
{
    /// Starts with the condensed solver and steps of `dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where 4 M / dt^2 + K is not positive definite; [`crate::Error::Usage`] for damping by stiffness or of
    /// single modes.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<Conserving<'s, E>> {
        Conserving::with_solver(system, dt, start, &|engine, sum, bounded| {
            Ok(Box::new(Condensed::new(engine, sum, bounded)?) as Box<dyn Solver<E>>)
        })
    }
}

impl<'s, E: Engine> Conserving<'s, E> {
    /// Starts with solvers of the midpoint rule's matrices, 4 M / dt^2 + K, made as they are needed. U(p) is found by the
    /// condensed solver whatever these are.
    ///
    /// # Errors
    /// As [`Conserving::new`].
    pub fn with_solver(
        system: &'s System<E>,
        dt: f64,
        start: Start,
        solver: &'s SolverFactory<E>,
    ) -> Result<Conserving<'s, E>> {
        system.drive.refuse_modal("conserving")?;
        let bounds = &system.bounds;
        let mut now = State::new(system, start.displacement, &start.velocity)?;
        let images = Potential::images(system)?;
        let mut potential = Potential::new(system)?;
        let verdict = potential.settle_state(&mut now)?;
        let (mut admissible, mut rates) = (vec![0.0; bounds.len()], vec![0.0; bounds.len()]);
        bounds.restrict(&now.u, &mut admissible);
        bounds.restrict(&start.velocity, &mut rates);
        let starts = |(&deflection, &velocity)| Approach { time: 0.0, deflection, velocity };
        let free = admissible.iter().zip(&rates).map(starts).collect();
        let mut scheme = Conserving {
            system,
            halves: Vec::new(),
            last: 0,
            solver,
            potential,
            images,
            start: now.energies.total(),
            given: 0.0,
            n: 0,
            before: now.clone(),
            span: 0.0,
            ahead: 0.0,
            u: now.u.clone(),
            admissible,
            limits: now.moment.clone(),
            reaction: now.reaction.clone(),
            impulses: vec![0.0; bounds.len()],
            now,
            rates,
            free,
            relaxation: Relaxation {
                states: 0,
                relaxed_steps: 0,
                halved_steps: 0,
                least_gamma: 1.0,
                largest_gamma: 1.0,
                dissipated: 0.0,
            },
            verdict,
        };
        scheme.add_half(dt)?;
        scheme.halves[0].begin(&start.velocity, &scheme.now.moment)?;
        Ok(scheme)
    }

    fn add_half(&mut self, dt: f64) -> Result<()> {
        let System { engine, bounds, .. } = self.system;
        let solver = (self.solver)(engine, &HalfStep::sum(self.system, dt), bounds.len())?;
        self.halves.push(HalfStep::new(self.system, dt, solver, self.images.clone())?);
        Ok(())
    }

    /// Adds the impulses of so many seconds of the last step.
    fn add_impulses(&mut self, seconds: f64) {
        let reactions = &self.halves[self.last].reaction;
        self.impulses.iter_mut().zip(reactions).for_each(|(impulse, r)| *impulse += seconds * r);
    }

    /// dt, in s.
    fn dt(&self) -> f64 {
        self.halves[0].dt
    }

    /// Goes to the next state, from an instant.
    fn step_on(&mut self, time: f64) -> Result<()> {
        std::mem::swap(&mut self.now, &mut self.before);
        let target = self.start + self.given - self.relaxation.dissipated;
        let mut halvings = 0;
        loop {
            if halvings == self.halves.len() {
                self.add_half(0.5 * self.halves[halvings - 1].dt)?;
            }
            let half = &mut self.halves[halvings];
            let verdict = half.solve(&self.before, time)?;
            let mut line = self.potential.line(&self.before, half, time)?;
            line.at(1.0, &mut self.now)?;
            let straight = line.same_piece;
            let range = match halvings {
                _ if straight => ROUNDING,
                0..MOST_HALVINGS => 0.5..LONGEST,
                _ => 0.5..LONGEST * f64::exp2(halvings as f64),
            };
            let most = if self.system.drive.varies() { MOST_HALVINGS } else { ALL_HALVINGS };
            let last = straight || halvings == most;
            let moved = excess(&line, target, 1.0, &self.now)?;
            let mut gamma = Some(1.0);
            if moved.abs() > MOVED * size(&self.now) {
                gamma = keep_energy(&mut line, target, range, &mut self.now)?;
                if gamma.is_none() && last {
                    line.at(1.0, &mut self.now)?;
                    gamma = Some(1.0);
                    if straight && moved.abs() <= ROUNDED * self.now.energies.kinetic {
                        self.now.shed(moved);
                    }
                }
            }
            self.verdict = self.verdict.and(verdict).and(line.verdict);
            let relaxation = &mut self.relaxation;
            let Some(gamma) = gamma else {
                relaxation.halved_steps += 1;
                halvings += 1;
                continue;
            };
            let [given, dissipated] = line.exchange(gamma, &self.now)?;
            self.given += given;
            relaxation.dissipated += dissipated;
            relaxation.states += 1;
            relaxation.relaxed_steps += u64::from(!straight && gamma != 1.0);
            relaxation.least_gamma = relaxation.least_gamma.min(gamma);
            relaxation.largest_gamma = relaxation.largest_gamma.max(gamma);
            self.span = gamma * half.dt;
            self.given += self.now.ride(self.system, &self.images, time + self.span)?;
            self.last = halvings;
            return Ok(());
        }
    }
}

/// Energies of a state without their signs: what its energy is rounded to.
fn size(state: &State) -> f64 {
    let Energies { kinetic, elastic, work } = state.energies;
    kinetic + elastic + work.abs()
}

/// What the energy of a state on the line has beyond the target at the line's start and what has come in and been taken since, in J.
fn excess<E: Engine>(line: &Line<E>, target: f64, gamma: f64, state: &State) -> Result<f64> {
    let [given, dissipated] = line.exchange(gamma, state)?;
    Ok(state.energies.total() - (target + given - dissipated))
}

/// From gamma = 1, finds the larger gamma on the line at which the energy has no excess, and makes `to` the state there; `None`
/// if it is not in the range.
fn keep_energy<E: Engine>(
    line: &mut Line<E>,
    target: f64,
    range: Range<f64>,
    to: &mut State,
) -> Result<Option<f64>> {
    let (mut below, mut above) = (None, None);
    let mut gamma = 1.0;
    let mut last: Option<(f64, f64)> = None;
    let mut best = (f64::INFINITY, gamma);
    for _ in 0..MOST_TRIALS {
        let excess = excess(line, target, gamma, to)?;
        if excess.abs() <= KEPT * size(to) {
            return Ok(Some(gamma));
        }
        if excess.abs() < best.0 {
            best = (excess.abs(), gamma);
        }
        if gamma <= range.start && excess > 0.0 || gamma >= range.end && excess < 0.0 {
            return Ok(None);
        }
        if excess < 0.0 {
            below = Some(gamma)
        } else {
            above = Some(gamma)
        }
        let slope = line.slope(gamma, to)?;
        let curvature = last.map_or(0.0, |(at, before)| ((slope - before) / (gamma - at)).max(0.0));
        last = Some((gamma, slope));
        // The larger root of excess + slope h + curvature h^2 / 2.
        let root = (slope * slope - 2.0 * excess * curvature).max(0.0).sqrt();
        let mut next = gamma - 2.0 * excess / (slope + root);
        let nearest = |next: f64| (next - gamma).abs() <= f64::EPSILON * gamma;
        let (low, high) = (below.unwrap_or(range.start), above.unwrap_or(range.end));
        if !(low < next && next < high || nearest(next)) {
            next = match (below, above) {
                (None, _) => low,
                (_, None) => high.min(2.0 * gamma),
                _ => 0.5 * (low + high),
            };
        }
        if nearest(next) {
            break;
        }
        gamma = next;
        line.at(gamma, to)?;
    }
    // No number lies nearer to the root, or rounding hides it.
    if gamma != best.1 {
        line.at(best.1, to)?;
    }
    Ok(Some(best.1))
}

impl<E: Engine> Scheme for Conserving<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.n += 1;
        self.verdict = Verdict::default();
        let dt = self.dt();
        let covered = self.ahead.min(dt);
        self.impulses.fill(0.0);
        self.add_impulses(covered);
        self.ahead -= dt;
        let bounds = &self.system.bounds;
        while self.ahead < 0.0 {
            let time = self.time() + self.ahead;
            self.step_on(time)?;
            self.add_impulses(self.span.min(-self.ahead));
            let half = &self.halves[self.last];
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                if self.before.reaction[i] == 0.0 {
                    self.free[i] = Approach { time, deflection: self.before.u[dof], velocity: self.rates[i] };
                }
                self.rates[i] = 2.0 / half.dt * half.x[dof];
            }
            self.ahead += self.span;
        }
        self.reaction.iter_mut().zip(&self.impulses).for_each(|(r, impulse)| *r = impulse / dt);
        let share = self.ahead / self.span;
        for (u, (now, before)) in self.u.iter_mut().zip(self.now.u.iter().zip(&self.before.u)) {
            *u = now + share * (before - now);
        }
        bounds.restrict(&self.u, &mut self.admissible);
        self.limits.extrapolate(&self.now.moment, &self.before.moment, share);
        let drive = &self.system.drive;
        let beyond: Vec<f64> =
            drive.places(self.time())?.iter().zip(&self.limits.places).map(|(s, frame)| frame - s).collect();
        drive.add_shapes(beyond.into_iter(), &mut self.u);
        Ok(())
    }

    fn step(&self) -> u64 {
        self.n
    }

    fn time(&self) -> f64 {
        self.n as f64 * self.dt()
    }

    fn displacement(&self) -> &[f64] {
        &self.u
    }

    /// The rate of U(p) where p moves at the velocity on the chord between the states around the instant, with the rates of the obstacles at
    /// the nodes that they push in the later one. At the start v_0.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let half = &self.halves[self.last];
        if self.n == 0 {
            return Ok(half.first_velocity());
        }
        // As seen from the frame of the step between the two states.
        let seen = |state: &State| {
            let mut v = state.v.clone();
            change_frame(&self.images, &state.rates, half.chords(), &mut v);
            v
        };
        let (mut v, before) = (seen(&self.now), seen(&self.before));
        let share = self.ahead / self.span;
        v.iter_mut().zip(before).for_each(|(v, before)| *v += share * (before - *v));
        let change = self.system.change(self.time(), self.dt(), half.chords())?;
        self.potential.rate(&v, &self.now.reaction, &change)
    }

    /// Those throughout the step; at the start those of the motions.
    fn support_rates(&self) -> Result<Vec<f64>> {
        if self.n == 0 { self.system.drive.rates(0.0) } else { Ok(self.halves[self.last].chords().to_vec()) }
    }

    /// The displacement reported, at each bound.
    fn admissible(&self) -> &[f64] {
        &self.admissible
    }

    /// On the chord between the bounds of the two states around the instant.
    fn limits(&self) -> &Bounds {
        self.limits.bounds(&self.system.bounds)
    }

    /// Their mean over the last dt; at the start those at U(p).
    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    fn impulses(&self) -> &[f64] {
        &self.impulses
    }

    /// Those of the state at or just after the instant.
    fn energies(&self) -> Result<Energies> {
        let energies = self.now.energies;
        Ok(Energies { work: energies.work + self.given, ..energies })
    }

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        self.free[bound]
    }

    fn state(&mut self, archive: &mut Archive) -> Result<()> {
        for value in [&mut self.start, &mut self.given, &mut self.span, &mut self.ahead] {
            archive.value(value)?;
        }
        archive.value(&mut self.n)?;
        archive.value(&mut self.last)?;
        archive.value(&mut self.verdict)?;
        archive.value(&mut self.relaxation)?;
        self.now.archive(archive)?;
        self.before.archive(archive)?;
        self.limits.archive(archive)?;
        archive.vector(Over::Dofs, &mut self.u)?;
        for vector in [&mut self.admissible, &mut self.reaction, &mut self.impulses, &mut self.rates] {
            archive.vector(Over::Bounds, vector)?;
        }
        Approach::archive(&mut self.free, archive)?;
        let mut halves = self.halves.len();
        archive.value(&mut halves)?;
        while self.halves.len() < halves {
            self.add_half(0.5 * self.halves[self.halves.len() - 1].dt)?;
        }
        self.halves.iter_mut().try_for_each(|half| half.archive(archive))?;
        self.potential.archive(archive)
    }

    fn factorisations(&self) -> u64 {
        self.potential.factorisations() + self.halves.iter().map(HalfStep::factorisations).sum::<u64>()
    }

    fn relaxation(&self) -> Option<Relaxation> {
        Some(self.relaxation)
    }
}
