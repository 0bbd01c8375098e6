//! Conserving scheme for the modal mass: exact rotation of the modes between kicks of the contact
//! forces, with a relaxation that keeps the energy.
//!
//! With the [mass of the lowest modes](crate::linalg::MassModes) a displacement splits into modes q
//! and a massless rest, which follows at once. The bounded deflections are
//!
//! ```math
//! x = A q + R r + G W, \qquad A = G \Phi,
//! ```
//!
//! with the compliance R of the rest and its response W to the loads, and the reactions r solve the
//! bound-constrained problem [in compliance form](crate::vi::compliance). They are a Lipschitz
//! function of q, so that
//!
//! ```math
//! \ddot q + D \dot q + \Omega^2 q = \Phi^T F + A^T r(q)
//! ```
//!
//! is an ordinary differential equation, with the energy
//! `$E = \tfrac12 |\dot q|^2 + \tfrac12 q^T \Omega^2 q + \tfrac12 r^T R\, r$` besides the work of
//! loads. A step changes the velocity by `$\tfrac12 \Delta t\, A^T r$`, moves the modes
//! [exactly](rotation) over the step, and changes the velocity again by half the impulse of the
//! reactions at the new position (Strang splitting: explicit, symplectic, of second order, stable
//! while `$\Delta t < 2 / w$` for the fastest motion in contact). No step solves for more than the
//! reactions of the nodes in contact, and the cost does not depend on the mesh.
//!
//! Without contact a step is exact, and keeps the energy to rounding whatever its length. In
//! contact the scheme takes the relaxed step `$(q + \gamma\, dq,\; \dot q + \gamma\, d \dot q)$`,
//! `$t + \gamma \Delta t$`, with gamma such that the energy changes by the work of loads and
//! obstacles and by damping alone, as [`super::conserving`] does. A step without such a gamma is
//! repeated with half the length.
//!
//! # Damping, loads, obstacles and supports in time
//!
//! Damping acts on the modes, each with its own decay rate: alpha + beta w^2, and twice the damping
//! ratio times w. The rest of the displacement has no rate of its own and stays elastic. Loads and
//! bounds are linear in time between the instants of a step; the modes move under the mean force,
//! so that the balance of energy holds to rounding in flight. Moving supports are treated as in
//! [`super::midpoint`]: the frame moves uniformly during a step, and its change of velocity is an
//! impulse.
//!
//! # Reported quantities
//!
//! In flight states lie on the grid of the output. In contact, where steps of length gamma dt pass
//! the grid instants, the reported state is the cubic interpolation of q from the two states around
//! the instant, with the reactions that belong to it; energies are those of the state at or just
//! after it. Impulses and mean reactions are those of [`super::conserving`].

mod data;
mod reach;
mod relaxation;
mod rotation;
mod state;

use super::exact::modal_saddle_point::ModalSaddlePoint;
use super::exact::reduction::ReducedModel;
use super::exact::velocity_basis::VelocityBasis;
use super::{Approach, RelaxationStatistics, Scheme, Start, StepRecord, System};
use crate::archive::Archive;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, difference, divide, dot, sum, waxpy};
use crate::linalg::{Engine, Form, MassModes};
use crate::obstacle::Bounds;
use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver, StepReport};
use data::{Limits, ModalData, ModalLoads};
use faer::Mat;
use reach::{Finding, Reach};
use rotation::Rotation;
use state::{State, add_product};
use std::cell::OnceCell;
use std::f64::consts::TAU;
use std::ops::Range;
use std::rc::Rc;

/// Range of gamma that is accepted.
const RANGE: Range<f64> = 0.5..2.0;
/// Relative change of energy above which a step is relaxed, and at which the search ends.
const MOVED: f64 = 1e-13;
const KEPT: f64 = 4.0 * f64::EPSILON;
/// Largest number of halvings of a step whose energy has no root in range; afterwards the step is
/// taken as it is, and later steps make up the difference. With data that change in time no root
/// may exist.
const ALL_HALVINGS: usize = 40;
/// Longest part of a step, in periods of the fastest mode.
const PART: f64 = 0.1;
/// Relative difference of times that is rounding.
const SAME_TIME: f64 = 1e-9;

/// Conserving scheme for the modal mass; see the [module page](self).
pub struct ModalConserving<'s, E: Engine> {
    system: &'s System<E>,
    modes: Rc<MassModes>,
    saddle: ModalSaddlePoint<'s, E>,
    model: ReducedModel,
    loads: ModalLoads,
    /// Decay rates of the modes, in 1/s.
    decays: Vec<f64>,
    /// Exact motion over a part of a step.
    rotation: Rotation,
    /// Length of the next step in contact, in s.
    length: f64,
    contact: ComplianceSolver,
    reach: Reach,
    /// Candidates in the order in which they came near, each time ascending.
    grown: Vec<Vec<usize>>,
    now: State,
    before: State,
    /// Work space for increments of q, q' and the deflections.
    dq: Vec<f64>,
    dv: Vec<f64>,
    dy: Vec<f64>,
    /// Energy at the start besides that of the constant load, and its change since by work, in J.
    start: f64,
    work: f64,
    /// Difference of the reported total energy and the scheme's own at the start, in J.
    offset: f64,
    /// Time between the two states, and from the grid instant to the later one, in s.
    span: f64,
    ahead: f64,
    /// Mean reactions between the two states, in N.
    mean: Vec<f64>,
    /// State at the grid instant, and the solver for its reactions.
    shown: State,
    shown_contact: ComplianceSolver,
    limits: Bounds,
    shape: OnceCell<Vec<f64>>,
    free: Vec<Approach>,
    relaxation: RelaxationStatistics,
    record: StepRecord,
}

impl<'s, E: Engine> ModalConserving<'s, E> {
    /// Starts the scheme with steps of `dt` seconds.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a mass that is not modal, or too many modes for the compliance
    /// of the contact, and the errors of the engine.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<ModalConserving<'s, E>> {
        let Form::Modal { consistent, modes } = &system.mass else {
            return Err(Error::Usage("this scheme needs time.mass = \"modal\"".into()));
        };
        let modes = modes.clone();
        let saddle = ModalSaddlePoint::new(system, consistent, &modes)?;
        let basis = Rc::new(VelocityBasis::new(system)?);
        let model = ReducedModel::new(system, basis, &saddle, &[])?;
        let loads = ModalLoads::new(system, &modes, &saddle)?;
        let decays = decays(system, &modes);
        let (bounds, count) = (&system.bounds, modes.squares.len());
        let mut now = State {
            q: vec![0.0; count],
            v: vec![0.0; count],
            y: Vec::new(),
            x: Vec::new(),
            reaction: Vec::new(),
            frame_rates: system.drive.rates(0.0)?,
            data: loads.at(system, &modes, &saddle, &[], 0.0)?.into(),
        };
        system.engine.project(&system.mass, &start.displacement, &mut now.q)?;
        system.engine.project(&system.mass, &start.velocity, &mut now.v)?;
        let before = |&dof: &usize| Approach {
            time: 0.0,
            deflection: start.displacement[dof],
            velocity: start.velocity[dof],
        };
        let fastest = modes.squares.last().map_or(0.0, |square| square.sqrt() / TAU);
        let parts = (dt * fastest / PART).ceil().max(1.0);
        let part = dt / parts;
        let mut scheme = ModalConserving {
            rotation: Rotation::new(&modes.squares, &decays, part),
            length: part,
            contact: ComplianceSolver::new(0),
            shown_contact: ComplianceSolver::new(0),
            reach: Reach::new(&model, &bounds.dofs, &now.data, part),
            grown: Vec::new(),
            dq: vec![0.0; count],
            dv: vec![0.0; count],
            dy: Vec::new(),
            start: 0.0,
            work: 0.0,
            offset: 0.0,
            span: 0.0,
            ahead: 0.0,
            mean: Vec::new(),
            shown: now.clone(),
            limits: bounds.clone(),
            shape: OnceCell::new(),
            free: bounds.dofs.iter().map(before).collect(),
            relaxation: RelaxationStatistics {
                states: 0,
                relaxed_steps: 0,
                halved_steps: 0,
                least_gamma: 1.0,
                largest_gamma: 1.0,
                dissipated: 0.0,
            },
            record: StepRecord { candidates: Some(Vec::new()), ..StepRecord::new(dt, bounds.len()) },
            before: now.clone(),
            now,
            system,
            modes,
            saddle,
            model,
            loads,
            decays,
        };
        // Reactions lift further nodes, or press them.
        loop {
            let near = scheme.check_reach().near;
            if near.is_empty() {
                break;
            }
            scheme.add_candidates(near)?;
            scheme.settle();
        }
        let State { q, reaction, data, .. } = &scheme.now;
        let [kinetic, elastic] = scheme.now.energies(&scheme.modes.squares);
        scheme.start = kinetic + elastic;
        let rest = scheme.loads.elastic(data) + dot(reaction, &data.near.shift);
        scheme.offset = rest - scheme.loads.work(data, q, &scheme.model.candidates, reaction);
        scheme.before = scheme.now.clone();
        scheme.show();
        for (k, &i) in scheme.model.candidates.iter().enumerate() {
            scheme.record.reaction[i] = scheme.now.reaction[k];
        }
        Ok(scheme)
    }

    /// Evaluates all nodes that are no candidates at the present state.
    fn check_reach(&mut self) -> Finding {
        let State { q, reaction, data, .. } = &self.now;
        let mut pull = data.force.clone();
        for (pull, (square, q)) in pull.iter_mut().zip(self.modes.squares.iter().zip(q)) {
            *pull -= square * q;
        }
        kick(&self.model.lift_at, reaction, 1.0, &mut pull);
        self.reach.check(&self.model, &self.now, dot(&pull, &pull).sqrt())
    }

    /// Adds candidates, ascending indices of bounds.
    fn add_candidates(&mut self, near: Vec<usize>) -> Result<()> {
        let old = self.model.candidates.clone();
        self.model.extend(self.system, &self.saddle, &near)?;
        let candidates = self.model.candidates.clone();
        self.grown.push(near);
        self.record.candidates = Some(candidates.clone());
        let selected = |data: &Rc<ModalData>| {
            let mut data = (**data).clone();
            data.select(&candidates);
            Rc::new(data)
        };
        let same = Rc::ptr_eq(&self.now.data, &self.before.data);
        self.now.data = selected(&self.now.data);
        self.before.data = if same { self.now.data.clone() } else { selected(&self.before.data) };
        for state in [&mut self.now, &mut self.before] {
            state.extend(&self.model, &old);
        }
        self.contact = extended(&self.contact, &candidates, &old);
        self.shown_contact = extended(&self.shown_contact, &candidates, &old);
        let mut mean = vec![0.0; candidates.len()];
        for (&of, r) in old.iter().zip(&self.mean) {
            if let Ok(k) = candidates.binary_search(&of) {
                mean[k] = *r;
            }
        }
        self.mean = mean;
        self.shown = self.now.clone();
        self.reach.update_weights(&self.model);
        self.reach.expire();
        Ok(())
    }

    /// Computes the bounded deflections and reactions of the present q.
    fn settle(&mut self) {
        let State { q, y, x, reaction, data, .. } = &mut self.now;
        let Limits { shift, lower, upper } = &data.near;
        y.copy_from_slice(shift);
        add_product(&self.model.lift_at, q, y);
        let problem = ComplianceProblem { compliance: &self.model.compliance, free: y, lower, upper };
        self.contact.solve(problem, x, reaction);
        self.relaxation_report();
    }

    /// Records iterations and residual of the last contact problem.
    fn relaxation_report(&mut self) {
        let ComplianceSolver { iterations, residual, .. } = self.contact;
        if self.contact.active().is_empty() {
            return;
        }
        let scale = self.now.y.iter().fold(self.model.bounds.magnitude(), |m, y| m.max(y.abs()));
        let kkt = if residual == 0.0 { 0.0 } else { residual / scale };
        self.record.report = self.record.report.and(StepReport { iterations, kkt, retries: 0 });
    }

    /// Measures the rates of the modes before the step in the frame that moves uniformly to the
    /// support places at its end. The change of kinetic energy counts as work.
    fn follow_supports(&mut self, next: &ModalData, seconds: f64) {
        let supports = &self.loads.support_momenta;
        let State { v, frame_rates, data, .. } = &mut self.before;
        let kinetic = dot(v, v);
        for (k, rate) in frame_rates.iter_mut().enumerate() {
            let uniform = (next.places[k] - data.places[k]) / seconds;
            axpy(*rate - uniform, supports.col_as_slice(k), v);
            *rate = uniform;
        }
        self.work += 0.5 * (dot(v, v) - kinetic);
        self.now.frame_rates.clone_from(frame_rates);
    }

    /// Makes a plain step from the state before to the present one. Returns the energies received
    /// from the loads and dissipated by damping, in J.
    fn propose(&mut self, next: Option<&Rc<ModalData>>, seconds: f64) -> [f64; 2] {
        let squares = &self.modes.squares;
        let lift_at = &self.model.lift_at;
        let State { q, v, reaction, data, .. } = &self.before;
        self.now.v.copy_from_slice(v);
        kick(lift_at, reaction, 0.5 * seconds, &mut self.now.v);
        let mean: Vec<f64>;
        let force = match next {
            Some(next) => {
                mean = data.force.iter().zip(&next.force).map(|(a, b)| 0.5 * (a + b)).collect();
                &mean
            }
            None => &data.force,
        };
        let other: Rotation;
        let rotation = if seconds == self.rotation.seconds {
            &self.rotation
        } else {
            other = Rotation::new(squares, &self.decays, seconds);
            &other
        };
        rotation.increments(squares, force, [q, &self.now.v], [&mut self.dq, &mut self.dv]);
        let received = dot(force, &self.dq);
        let is_damped = self.decays.iter().any(|decay| *decay > 0.0);
        let before = if is_damped { energy(squares, q, &self.now.v) } else { 0.0 };
        add(&self.dv, &mut self.now.v);
        waxpy(1.0, &self.dq, q, &mut self.now.q);
        let dissipated = match is_damped {
            true => received - (energy(squares, &self.now.q, &self.now.v) - before),
            false => 0.0,
        };
        self.now.data = next.unwrap_or(data).clone();
        self.settle();
        kick(&self.model.lift_at, &self.now.reaction, 0.5 * seconds, &mut self.now.v);
        [received, dissipated]
    }

    /// Finds the step length that keeps the energy, and sets the present state to it. Returns gamma
    /// and the work of the obstacles over the whole step (J); `None` if no gamma in range does.
    fn relax(&mut self, next: Option<&Rc<ModalData>>, received: f64, dissipated: f64) -> Option<(f64, f64)> {
        let squares = &self.modes.squares;
        let State { q, v, y, data, .. } = &self.before;
        let (lift, rate) = (&self.dq, &self.dv);
        let stiff = |a: &[f64], b: &[f64]| -> f64 {
            a.iter().zip(b).zip(squares).map(|((a, b), square)| square * a * b).sum()
        };
        let constant = energy(squares, q, v);
        let linear = dot(v, rate) + stiff(q, lift);
        let quadratic = 0.5 * (dot(rate, rate) + stiff(lift, lift));
        let zeros = vec![0.0; y.len()];
        let of = |next: Option<&Rc<ModalData>>, part: fn(&Limits) -> &[f64]| match next {
            // An absent obstacle has infinite bounds.
            Some(next) => part(&next.near)
                .iter()
                .zip(part(&data.near))
                .map(|(b, a)| if a.is_finite() { b - a } else { 0.0 })
                .collect(),
            None => zeros.clone(),
        };
        let [dlower, dupper, dshift] =
            [of(next, |data| &data.lower), of(next, |data| &data.upper), of(next, |data| &data.shift)];
        let bound = |side: BoundStatus, i: usize| match side {
            BoundStatus::Upper => dupper[i],
            _ => dlower[i],
        };
        let pressed = |r: f64, i: usize| if r > 0.0 { dlower[i] - dshift[i] } else { dupper[i] - dshift[i] };
        let obstacles: f64 =
            self.mean.iter().enumerate().filter(|(_, r)| **r != 0.0).map(|(i, r)| r * pressed(*r, i)).sum();
        let gain = received + obstacles - dissipated;
        let target = self.start + self.work - self.relaxation.dissipated;
        let size = self.start.abs() + constant;
        let (mut lower, mut upper) = (data.near.lower.clone(), data.near.upper.clone());
        let (contact, now, compliance, dy) =
            (&mut self.contact, &mut self.now, &self.model.compliance, &self.dy);
        let mut at = |gamma: f64| {
            waxpy(gamma, dy, y, &mut now.y);
            if next.is_some() {
                waxpy(gamma, &dlower, &data.near.lower, &mut lower);
                waxpy(gamma, &dupper, &data.near.upper, &mut upper);
            }
            let problem = ComplianceProblem { compliance, free: &now.y, lower: &lower, upper: &upper };
            contact.solve(problem, &mut now.x, &mut now.reaction);
            let (mut rest, mut slope) = (0.0, 0.0);
            for &i in contact.active() {
                let r = now.reaction[i];
                rest += 0.5 * r * (now.x[i] - now.y[i]);
                slope += r * (bound(contact.sides[i], i) - dy[i]);
            }
            let value = constant + gamma * (linear + gamma * quadratic) + rest - (target + gamma * gain);
            (value, linear + 2.0 * gamma * quadratic + slope - gain)
        };
        let (moved, _) = at(1.0);
        let gamma = match moved.abs() <= MOVED * size {
            true => Some(1.0),
            false => relaxation::root(&mut at, RANGE, KEPT * size),
        };
        at(gamma.unwrap_or(1.0));
        let gamma = gamma?;
        waxpy(gamma, &self.dq, &self.before.q, &mut self.now.q);
        waxpy(gamma, &self.dv, &self.before.v, &mut self.now.v);
        if let Some(next) = next {
            self.now.data = ModalData::between(&self.before.data, next, gamma).into();
        }
        Some((gamma, obstacles))
    }

    /// Advances from the present state, at `time` (s), by a step of `seconds` or a part of it.
    fn step_on(&mut self, time: f64, mut seconds: f64) -> Result<()> {
        self.before.clone_from(&self.now);
        let varies = self.system.drive.varies();
        let mut halvings = 0;
        loop {
            let next = match varies {
                true => Some(Rc::new(self.loads.at(
                    self.system,
                    &self.modes,
                    &self.saddle,
                    &self.model.candidates,
                    time + seconds,
                )?)),
                false => None,
            };
            if let Some(next) = &next {
                self.follow_supports(next, seconds);
            }
            let exchanged = self.propose(next.as_ref(), seconds);
            let touches = self.before.touches() || self.now.touches();
            let taken = match touches {
                true => self.keep_energy(next.as_ref(), exchanged, halvings == ALL_HALVINGS),
                false => {
                    self.mean.fill(0.0);
                    Some((1.0, 0.0))
                }
            };
            let Some((gamma, obstacles)) = taken else {
                self.relaxation.halved_steps += 1;
                self.now.clone_from(&self.before);
                halvings += 1;
                seconds *= 0.5;
                continue;
            };
            self.span = gamma * seconds;
            if !self.reach.is_safe(&self.now, self.span) {
                let Finding { near, is_late } = self.check_reach();
                if !near.is_empty() {
                    self.add_candidates(near)?;
                }
                if is_late {
                    self.now.clone_from(&self.before);
                    continue;
                }
            }
            let [received, dissipated] = exchanged;
            self.work += gamma * (received + obstacles);
            let relaxation = &mut self.relaxation;
            relaxation.dissipated += gamma * dissipated;
            relaxation.states += 1;
            relaxation.relaxed_steps += u64::from(gamma != 1.0);
            relaxation.least_gamma = relaxation.least_gamma.min(gamma);
            relaxation.largest_gamma = relaxation.largest_gamma.max(gamma);
            if touches {
                self.length = self.rotation.seconds.min(2.0 * seconds);
                self.note_approaches(time);
            }
            return Ok(());
        }
    }

    /// Relaxes a step in contact so that it keeps the energy. Returns gamma and the work of the
    /// obstacles over the whole step (J); `None` if no gamma in range does, unless this is the last
    /// trial.
    fn keep_energy(
        &mut self,
        next: Option<&Rc<ModalData>>,
        [received, dissipated]: [f64; 2],
        is_last: bool,
    ) -> Option<(f64, f64)> {
        self.mean = sum(&self.before.reaction, &self.now.reaction);
        divide(2.0, &mut self.mean);
        self.dv = difference(&self.now.v, &self.before.v);
        self.dy = difference(&self.now.y, &self.before.y);
        let plain = is_last.then(|| self.now.clone());
        let taken = self.relax(next, received, dissipated);
        match (taken, plain) {
            (None, Some(plain)) => {
                self.now = plain;
                Some((1.0, 0.0))
            }
            _ => taken,
        }
    }

    /// Adds the impulses of the reactions of the last step over a duration, in s.
    fn add_impulses(&mut self, seconds: f64) {
        for (r, &i) in self.mean.iter().zip(&self.model.candidates) {
            self.record.impulses[i] += seconds * r;
        }
    }

    /// Keeps the last state before contact of nodes that begin to touch.
    fn note_approaches(&mut self, time: f64) {
        let State { x, v, reaction, .. } = &self.before;
        for (k, &i) in self.model.candidates.iter().enumerate() {
            if reaction[k] == 0.0 && self.now.reaction[k] != 0.0 {
                let velocity = self.model.lift_at.row(k).iter().zip(v).map(|(a, v)| a * v).sum();
                self.free[i] = Approach { time, deflection: x[k], velocity };
            }
        }
    }

    /// Computes the state at the grid instant.
    fn show(&mut self) {
        self.shape.take();
        if self.ahead > 0.0 {
            let share = 1.0 - self.ahead / self.span;
            let (left, right) = (1.0 - share, share);
            // Cubic Hermite interpolation of q.
            let [of_before, of_now] = [left * left * (1.0 + 2.0 * share), right * right * (1.0 + 2.0 * left)];
            let [of_rate_before, of_rate_now] =
                [share * left * left * self.span, -left * share * share * self.span];
            let (shown, before, now) = (&mut self.shown, &self.before, &self.now);
            for k in 0..now.q.len() {
                shown.q[k] = of_before * before.q[k]
                    + of_now * now.q[k]
                    + of_rate_before * before.v[k]
                    + of_rate_now * now.v[k];
                shown.v[k] = left * before.v[k] + right * now.v[k];
            }
            shown.data = match Rc::ptr_eq(&before.data, &now.data) {
                true => now.data.clone(),
                false => ModalData::between(&before.data, &now.data, share).into(),
            };
            shown.frame_rates.clone_from(&now.frame_rates);
            let Limits { shift, lower, upper } = &shown.data.near;
            shown.y.copy_from_slice(shift);
            add_product(&self.model.lift_at, &shown.q, &mut shown.y);
            let problem =
                ComplianceProblem { compliance: &self.model.compliance, free: &shown.y, lower, upper };
            self.shown_contact.solve(problem, &mut shown.x, &mut shown.reaction);
        } else {
            self.shown.clone_from(&self.now);
        }
        let State { x, data, .. } = &self.shown;
        if self.system.drive.varies() {
            self.limits.lower.copy_from_slice(&data.all.lower);
            self.limits.upper.copy_from_slice(&data.all.upper);
        }
        // Nodes out of reach have the deflections of the last check.
        if self.reach.is_fresh() || self.system.drive.varies() {
            self.record.admissible.copy_from_slice(&self.reach.deflections);
        }
        for (x, &i) in x.iter().zip(&self.model.candidates) {
            self.record.admissible[i] = *x;
        }
    }

    /// Returns the displacement of the shown state, in m, one entry per dof.
    fn shape(&self) -> Vec<f64> {
        let State { q, reaction, data, .. } = &self.shown;
        let mut u = vec![0.0; self.system.engine.dofs()];
        add_product(&self.model.lift, q, &mut u);
        self.loads.add_response(data, &mut u);
        for (i, r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            axpy(*r, self.model.flexibility.col_as_slice(i), &mut u);
        }
        for (x, &dof) in self.shown.x.iter().zip(&self.model.bounds.dofs) {
            u[dof] = *x;
        }
        u
    }
}

/// Returns the decay rates of the modes, in 1/s: those of Rayleigh damping, and of single modes
/// that are no rigid motions.
fn decays<E: Engine>(system: &System<E>, modes: &MassModes) -> Vec<f64> {
    let mut decays: Vec<f64> =
        modes.squares.iter().map(|square| system.damping.mass + system.damping.stiffness * square).collect();
    if let Some(modal) = &system.drive.modal {
        let elastic = decays.iter_mut().zip(&modes.squares).filter(|(_, square)| **square > 0.0);
        elastic.zip(modal.rates()).for_each(|((decay, _), rate)| *decay += rate);
    }
    decays
}

/// Returns a contact solver for more candidates, those that are new without contact.
fn extended(solver: &ComplianceSolver, candidates: &[usize], old: &[usize]) -> ComplianceSolver {
    let mut more = ComplianceSolver::new(candidates.len());
    more.factorisations = solver.factorisations;
    for (of, side) in old.iter().zip(&solver.sides) {
        if let Ok(k) = candidates.binary_search(of) {
            more.sides[k] = *side;
        }
    }
    more
}

/// Adds A^T r over a duration (s) to the rates of the modes.
fn kick(lift_at: &Mat<f64>, reaction: &[f64], seconds: f64, v: &mut [f64]) {
    for (i, r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
        for (v, a) in v.iter_mut().zip(lift_at.row(i).iter()) {
            *v += seconds * r * a;
        }
    }
}

/// Returns the kinetic and elastic energy of the modes, in J.
fn energy(squares: &[f64], q: &[f64], v: &[f64]) -> f64 {
    let elastic: f64 = q.iter().zip(squares).map(|(q, square)| square * q * q).sum();
    0.5 * (dot(v, v) + elastic)
}

impl<E: Engine> Scheme for ModalConserving<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.record.begin_step();
        self.record.report = StepReport::default();
        let dt = self.record.dt;
        self.add_impulses(self.ahead.min(dt));
        self.ahead -= dt;
        while self.ahead < 0.0 {
            let time = self.time() + self.ahead;
            let (left, part) = (-self.ahead, self.rotation.seconds);
            // A step in flight is exact whatever its length, and returns to the grid.
            let seconds = match self.now.touches() {
                true => self.length,
                false if left < (1.0 - SAME_TIME) * part => left,
                false => part,
            };
            self.step_on(time, seconds)?;
            self.add_impulses(self.span.min(left));
            self.ahead += self.span;
            if self.ahead.abs() <= SAME_TIME * part {
                self.ahead = 0.0;
            }
        }
        let StepRecord { reaction, impulses, .. } = &mut self.record;
        reaction.copy_from_slice(impulses);
        divide(dt, reaction);
        self.show();
        Ok(())
    }

    /// Returns the record of the last step. Its bounded configuration is that of the reported
    /// state, and its reactions are the mean over the last dt; at the start they are those at rest.
    fn record(&self) -> &StepRecord {
        &self.record
    }

    fn displacement(&self) -> &[f64] {
        self.shape.get_or_init(|| self.shape())
    }

    /// Returns the rate of the displacement, with the nodes in contact following their obstacles,
    /// in m/s.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        let mut rates = vec![0.0; self.system.engine.dofs()];
        add_product(&self.model.lift, &self.shown.v, &mut rates);
        let contact = if self.ahead > 0.0 { &self.shown_contact } else { &self.contact };
        let active = contact.active();
        if active.is_empty() || self.record.step == 0 {
            return Ok(rates);
        }
        let (now, before) = (&self.now.data, &self.before.data);
        let limit = |i: usize| {
            let [from, to] = match contact.sides[i] {
                BoundStatus::Upper => [before.near.upper[i], now.near.upper[i]],
                _ => [before.near.lower[i], now.near.lower[i]],
            };
            ((to - from) - (now.near.shift[i] - before.near.shift[i])) / self.span
        };
        let missing = |i: usize| {
            let row = self.model.lift_at.row(i);
            limit(i) - row.iter().zip(&self.shown.v).map(|(a, v)| a * v).sum::<f64>()
        };
        let mut forces = Mat::from_fn(active.len(), 1, |k, _| missing(active[k]));
        contact.solve_active(&mut forces);
        for (k, &i) in active.iter().enumerate() {
            axpy(forces[(k, 0)], self.model.flexibility.col_as_slice(i), &mut rates);
        }
        Ok(rates)
    }

    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(self.shown.frame_rates.clone())
    }

    fn limits(&self) -> &Bounds {
        &self.limits
    }

    /// Returns the energies of the state at or just after the instant.
    fn energies(&self) -> Result<Energies> {
        let State { reaction, data, .. } = &self.now;
        let [kinetic, elastic] = self.now.energies(&self.modes.squares);
        let total = self.offset + kinetic + elastic - self.work;
        let elastic = elastic + self.loads.elastic(data) + dot(reaction, &data.near.shift);
        Ok(Energies { kinetic, elastic, work: kinetic + elastic - total })
    }

    fn approach(&self, bound: usize) -> Approach {
        self.free[bound]
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.record.archive(archive)?;
        for value in [&mut self.start, &mut self.work, &mut self.offset, &mut self.span, &mut self.ahead] {
            archive.value(value)?;
        }
        archive.value(&mut self.length)?;
        archive.value(&mut self.relaxation)?;
        let mut grown = self.grown.clone();
        archive.value(&mut grown)?;
        if !archive.saves() && grown != self.grown {
            let known = self.grown.len();
            for near in grown.split_off(known.min(grown.len())) {
                self.add_candidates(near)?;
            }
        }
        self.now.archive(archive)?;
        self.before.archive(archive)?;
        self.reach.archive(archive)?;
        archive.value(&mut self.mean)?;
        self.contact.archive(&self.model.compliance, archive)?;
        self.shown_contact.archive(&self.model.compliance, archive)?;
        Approach::archive(&mut self.free, archive)?;
        if !archive.saves() {
            if !self.system.drive.varies() {
                self.before.data = self.now.data.clone();
                self.reach.share_data(&self.now.data);
            }
            let admissible = self.record.admissible.clone();
            self.show();
            self.record.admissible = admissible;
        }
        Ok(())
    }

    fn factorisations(&self) -> u64 {
        self.contact.factorisations
    }

    fn relaxation(&self) -> Option<RelaxationStatistics> {
        Some(self.relaxation)
    }
}
