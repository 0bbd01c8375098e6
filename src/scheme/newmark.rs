//! Newmark-e-beta scheme with coefficient of restitution (paper, section 4.1; Paoli and Schatzman
//! 2007).
//!
//! The scheme finds `$U^{n+1,e} = (U^{n+1} + e\,U^{n-1}) / (1 + e)$` in `$K^h$` such that, with
//! `$F = \beta F^{n+1} + (1 - 2 \beta) F^n + \beta F^{n-1}$`,
//!
//! ```math
//! M \frac{U^{n+1} - 2 U^n + U^{n-1}}{\Delta t^2} + K\,(\beta U^{n+1} + (1 - 2 \beta) U^n + \beta U^{n-1}) = F + G^T r .
//! ```
//!
//! The unknown solved for is the second difference `$x = U^{n+1} - 2 U^n + U^{n-1}$`:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr) x = F - K U^n + G^T r, \qquad U^{n+1,e} = U^n + \frac{x + (1 - e)(U^n - U^{n-1})}{1 + e} .
//! ```
//!
//! # Start
//!
//! The ghost value `$U^{-1} = U^1 - 2 \Delta t\, v_0$` makes the energy at t = 0 exact. `$U^1$`
//! follows from half a trapezoidal step:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr)\, 2 (U^1 - U^0) = \frac{2}{\Delta t} M v_0 + F - K U^0 + G^T r .
//! ```
//!
//! The start is second order and depends on `$v_0$` only through the momentum `$M v_0$`. It gains
//! no energy however rough `$v_0$` is (a clamped plate thrown as a whole, a single node): for beta
//! = 1/2, no load, no contact, `$y = U^1 - U^0$` and `$A = M / \Delta t^2 + K / 2$`,
//!
//! ```math
//! H^{1/2} - \tfrac12 |U^0|_K^2 = \tfrac12 y \cdot A y + \tfrac12 y \cdot K U^0
//!    = \tfrac12 \Bigl|\frac{M v_0}{\Delta t}\Bigr|_{A^{-1}}^2 - \tfrac18 |K U^0|_{A^{-1}}^2 \le \tfrac12 |v_0|_M^2 .
//! ```
//!
//! # Damping, time-dependent loads and obstacles
//!
//! The damping matrix D = alpha M + beta_d K multiplies the central velocity
//! `$(U^{n+1} - U^{n-1}) / 2 \Delta t = (2 d + x) / 2 \Delta t$` with `$d = U^n - U^{n-1}$`: the
//! step matrix gains `$D / 2 \Delta t$`, the right-hand side `$-D d / \Delta t$`. At the start D
//! multiplies `$(U^1 - U^0) / \Delta t$`.
//!
//! The load F is the beta-average of its values at the three instants, and the bounds l, u are
//! averaged with the weights of `$U^{n+1,e}$`:
//!
//! ```math
//! \frac{l^{n+1} + e\, l^{n-1}}{1 + e} \le G U^{n+1,e} \le \frac{u^{n+1} + e\, u^{n-1}}{1 + e} .
//! ```
//!
//! The motion relative to an obstacle therefore obeys the same law of restitution at any speed of
//! the obstacle, and a plate carried along with its obstacle at constant speed moves as it does at
//! rest. Loads and obstacles are extrapolated linearly to the instant before the start. Modal
//! damping ([`super::ModalDamping`]) acts on the extrapolated velocity
//! `$(3 d - d_{before}) / 2 \Delta t$`.
//!
//! Time-dependent loads and obstacles do the work `$W_n$`, with r the reactions and l the obstacle
//! (lower or upper) in contact:
//!
//! ```math
//! w_n = \tfrac12 F_\beta^n \cdot (U^{n+1} - U^{n-1}) + \tfrac12 r^n \cdot (l^{n+1} - l^{n-1}), \qquad W_n = W_{n-1} + \tfrac12 (w_{n-1} + w_n),
//! ```
//!
//! This work closes the balance of the beta = 1/2 invariant to rounding: H grows by `$w_n$`, less
//! `$\Delta t\, V^T D V$` with V the central velocity, less the energy lost in contact.
//!
//! # Momentum
//!
//! The reported velocity is the central difference `$V^n = (U^{n+1} - U^{n-1}) / 2 \Delta t$`; the
//! ghost value makes `$V^0 = v_0$`. Two equations of successive instants add up to
//!
//! ```math
//! M\,(V^n - V^{n-1}) = \tfrac{\Delta t}{2} \bigl( f^{n-1} + G^T r^{n-1} + f^n + G^T r^n \bigr) ,
//! ```
//!
//! with f all other forces, from n = 1 on, since the equation of the start is that of instant 0.
//! The impulse of the obstacles over a step is therefore the trapezoidal sum of the reactions at
//! its ends. The reported reactions are those of the instant itself.
//!
//! # Moving supports
//!
//! U is measured relative to the shape `$R s(t)$` that the support motion s gives the plate. The
//! scheme for U + R s equals the scheme for U with the additional load
//! `$-M R\,(s^{n+1} - 2 s^n + s^{n-1}) / \Delta t^2$` at instant n, for any s: this is the mean
//! acceleration weighted with a hat function of width 2 dt, which includes jumps of the velocity.
//! The ghost value at the start is `$s^{-1} = s^1 - 2 \Delta t\, s'(0)$`, analogous to `$U^{-1}$`.

use super::drive::InstantData;
use super::{Approach, Scheme, Start, System};
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Answer, CheckedSolver, Condensed, Problem, Solver, StepReport};

/// Parameters of [`Newmark`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewmarkParameters {
    /// Newmark parameter beta, at least 1/4 (unconditionally stable); 1/2 in the paper.
    pub beta: f64,
    /// Coefficient of restitution e, from 0 (absorbing) to 1 (perfect).
    pub restitution: f64,
    /// Time step `$\Delta t$`, in s.
    pub step: f64,
}

/// Newmark-e-beta scheme at instant n, with the step to `$U^{n+1}$` already solved.
pub struct Newmark<'s, E: Engine> {
    system: &'s System<E>,
    sum: [(f64, &'s E::Form); 2],
    solver: CheckedSolver<E>,
    parameters: NewmarkParameters,
    n: u64,
    /// `$U^n$`, in m.
    u: Vec<f64>,
    /// `$U^n - U^{n-1}$`, in m.
    d: Vec<f64>,
    /// `$U^{n+1} - U^n$`, in m.
    d_next: Vec<f64>,
    x: Vec<f64>,
    b: Vec<f64>,
    /// Work space for D times a vector; empty without damping.
    product: Vec<f64>,
    bounds: Bounds,
    admissible: Vec<f64>,
    reaction: Vec<f64>,
    /// Impulses of the obstacles from n - 1 to n, in N s, one entry per bound.
    impulses: Vec<f64>,
    /// Initial velocity `$G v_0$` at the bounded dofs, in m/s, one entry per bound.
    arriving: Vec<f64>,
    elastic: f64,
    /// Data of the instants n - 1, n and n + 1, present if any of them depends on time.
    varying: Option<Varying>,
    /// Modal coordinates of `$U^n - U^{n-1}$` in the damped modes.
    shares: Option<Vec<f64>>,
    verdict: StepReport,
}

/// Time-dependent data at instants n - 1, n and n + 1.
struct Varying {
    before: InstantData,
    now: InstantData,
    next: InstantData,
    /// Bounds on `$U^{n+1,e}$`, in m.
    limits: Option<Bounds>,
    /// Accumulated work `$W_n$` and increment `$w_n$`, in J.
    work: f64,
    given: f64,
}

impl Varying {
    /// Evaluates the data at the start; the instant -1 is extrapolated linearly.
    fn new<E: Engine>(system: &System<E>, parameters: NewmarkParameters) -> Result<Varying> {
        let now = system.moment(0.0)?;
        let next = system.moment(parameters.step)?;
        let mut before = now.clone();
        before.extrapolate(&now, &next, -1.0);
        // The ghost place s^{-1} is s^1 less two steps at the initial velocity.
        let ways = system.drive.rates(0.0)?.into_iter().map(|rate| 2.0 * parameters.step * rate);
        let places: Vec<f64> = next.places.iter().zip(ways).map(|(next, way)| next - way).collect();
        before.carry(&system.drive, &places);
        let mut varying = Varying { limits: now.bounds.clone(), before, now, next, work: 0.0, given: 0.0 };
        varying.limit(parameters.restitution);
        Ok(varying)
    }

    /// Saves all data to an archive or restores them from it.
    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.work)?;
        archive.value(&mut self.given)?;
        for moment in [&mut self.before, &mut self.now, &mut self.next] {
            moment.archive(archive)?;
        }
        let Some(Bounds { lower, upper, .. }) = &mut self.limits else { return Ok(()) };
        archive.vector(VectorKind::Bounds, lower)?;
        archive.vector(VectorKind::Bounds, upper)
    }

    /// Moves one step ahead; `next` is the time of the new instant n + 1, in s.
    fn advance<E: Engine>(&mut self, system: &System<E>, restitution: f64, next: f64) -> Result<()> {
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.next);
        self.next.set(&system.drive, next)?;
        self.limit(restitution);
        Ok(())
    }

    /// Sets the bounds on `$U^{n+1,e}$`. Where one of the two instants has no obstacle, the bound
    /// of n + 1 is used alone.
    fn limit(&mut self, e: f64) {
        let of = |before: f64, next: f64| {
            let average = (next + e * before) / (1.0 + e);
            if before.is_finite() && next.is_finite() { average } else { next }
        };
        if let (Some(limits), Some(before), Some(next)) =
            (&mut self.limits, &self.before.bounds, &self.next.bounds)
        {
            for i in 0..limits.len() {
                limits.lower[i] = of(before.lower[i], next.lower[i]);
                limits.upper[i] = of(before.upper[i], next.upper[i]);
            }
        }
    }

    /// Returns the beta-averaged load, in N, one entry per dof; empty where no load depends on
    /// time.
    fn load(&self, beta: f64) -> impl Iterator<Item = f64> {
        let [before, now, next] =
            [&self.before, &self.now, &self.next].map(|moment| moment.load.as_deref().unwrap_or(&[]));
        let instants = now.iter().zip(before.iter().zip(next));
        instants.map(move |(now, (before, next))| now + beta * (next - 2.0 * now + before))
    }

    /// Returns second differences of the support places over dt^2, in m/s^2, one entry per motion.
    fn accelerations(&self, dt: f64) -> Vec<f64> {
        let [before, now, next] = [&self.before, &self.now, &self.next].map(|moment| &moment.places);
        let instants = now.iter().zip(before.iter().zip(next));
        instants.map(|(now, (before, next))| ((next - now) - (now - before)) / (dt * dt)).collect()
    }
}

impl<'s, E: Engine + 'static> Newmark<'s, E>
where
    E::Factor: 'static,
{
    /// Starts the scheme with the condensed solver.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the step matrix is not positive definite.
    pub fn new(system: &'s System<E>, parameters: NewmarkParameters, start: Start) -> Result<Newmark<'s, E>> {
        let sum = Self::sum(system, parameters);
        let solver = Condensed::new(&system.engine, &sum, system.bounds.len())?;
        Newmark::with_solver(system, parameters, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Newmark<'s, E> {
    /// Returns the step matrix `$M / \Delta t^2 + \beta K + D / 2 \Delta t$` (paper, section 4.1,
    /// with damping).
    pub fn sum(system: &'s System<E>, parameters: NewmarkParameters) -> [(f64, &'s E::Form); 2] {
        let System { mass, stiffness, damping, .. } = system;
        let NewmarkParameters { beta, step: dt, .. } = parameters;
        let half_rate = 0.5 / dt;
        [
            (1.0 / (dt * dt) + half_rate * damping.mass, mass),
            (beta + half_rate * damping.stiffness, stiffness),
        ]
    }

    /// Starts the scheme with a given solver for the matrix [`Newmark::sum`].
    ///
    /// # Errors
    /// Returns the errors of the solver.
    pub fn with_solver(
        system: &'s System<E>,
        parameters: NewmarkParameters,
        start: Start,
        solver: Box<dyn Solver<E>>,
    ) -> Result<Newmark<'s, E>> {
        let dofs = system.engine.dofs();
        let count = system.bounds.len();
        let varying = if system.drive.varies() { Some(Varying::new(system, parameters)?) } else { None };
        let mut scheme = Newmark {
            system,
            sum: Self::sum(system, parameters),
            solver: CheckedSolver::new(solver, &system.engine, &Self::sum(system, parameters))?,
            parameters,
            n: 0,
            u: start.displacement,
            d: vec![0.0; dofs],
            d_next: vec![0.0; dofs],
            x: vec![0.0; dofs],
            b: vec![0.0; dofs],
            product: if system.damping.is_none() { Vec::new() } else { vec![0.0; dofs] },
            bounds: system.bounds.clone(),
            admissible: vec![0.0; count],
            reaction: vec![0.0; count],
            impulses: vec![0.0; count],
            arriving: system.bounds.dofs.iter().map(|&dof| start.velocity[dof]).collect(),
            elastic: 0.0,
            varying,
            shares: None,
            verdict: StepReport::default(),
        };
        if let Some(modal) = &system.drive.modal {
            modal.check(parameters.step)?;
        }
        // At the start x = 2 (U^1 - U^0), and U^{0,e} = U^0 + x / 2 - 2 dt v_0 e / (1 + e).
        let NewmarkParameters { restitution: e, step: dt, .. } = parameters;
        let drift = |dof: usize| -2.0 * dt * start.velocity[dof] * e / (1.0 + e);
        let mut v = vec![0.0; system.engine.velocities(&system.mass)];
        system.engine.project(&system.mass, &start.velocity, &mut v)?;
        let mut momentum = vec![0.0; dofs];
        system.engine.project_transpose(&system.mass, &v, &mut momentum)?;
        momentum.iter_mut().for_each(|momentum| *momentum *= 2.0 / dt);
        scheme.solve(2.0, drift, |_, b, _| {
            b.iter_mut().zip(&momentum).for_each(|(b, momentum)| *b += momentum);
            if let Some(modal) = &system.drive.modal {
                modal.resist(modal.of_rate(&system.engine, &start.velocity)?.into_iter(), b);
            }
            Ok(())
        })?;
        for ((d, d_next), (x, v)) in
            scheme.d.iter_mut().zip(&mut scheme.d_next).zip(scheme.x.iter().zip(&start.velocity))
        {
            *d = 2.0 * dt * v - 0.5 * x;
            *d_next = 0.5 * x;
        }
        if let Some(modal) = &system.drive.modal {
            scheme.shares = Some(modal.of_rate(&system.engine, &scheme.d)?);
        }
        scheme.weigh()?;
        Ok(scheme)
    }

    /// Solves for x, where the bounded configuration is U^n + x / stretch + drift. The closure
    /// `push` adds further forces to the right-hand side and may use its last argument as work
    /// space.
    fn solve(
        &mut self,
        stretch: f64,
        drift: impl Fn(usize) -> f64,
        push: impl FnOnce(&System<E>, &mut [f64], &mut [f64]) -> Result<()>,
    ) -> Result<()> {
        let System { engine, .. } = self.system;
        self.elastic = self.system.force(&self.u, &mut self.b)?;
        if let Some(varying) = &self.varying {
            self.b.iter_mut().zip(varying.load(self.parameters.beta)).for_each(|(b, f)| *b += f);
            let accelerations = varying.accelerations(self.parameters.step);
            self.system.drive.subtract_inertia(&accelerations, &mut self.b);
        }
        push(self.system, &mut self.b, &mut self.product)?;
        let limits = self.varying.as_ref().and_then(|varying| varying.limits.as_ref());
        let limits = limits.unwrap_or(&self.system.bounds);
        self.bounds.shift(limits, |dof, bound| ((bound - self.u[dof]) - drift(dof)) * stretch);
        let length = self.system.length(limits, &self.u)?;
        let problem = Problem { matrix: &self.sum, rhs: &self.b, bounds: &self.bounds, length };
        let mut answer = Answer { x: &mut self.x, reaction: &mut self.reaction };
        self.verdict = self.solver.solve(engine, &problem, &mut answer)?;
        let share = 1.0 / stretch;
        for (z, &dof) in self.admissible.iter_mut().zip(&limits.dofs) {
            *z = self.u[dof] + (share * self.x[dof] + drift(dof));
        }
        Ok(())
    }

    /// Updates the work `$W_n$`, `$w_n$` of the time-dependent loads and obstacles.
    fn weigh(&mut self) -> Result<()> {
        let Some(varying) = &mut self.varying else { return Ok(()) };
        let ways = self.d.iter().zip(&self.d_next).map(|(d, d_next)| d + d_next);
        let mut loads: f64 =
            varying.load(self.parameters.beta).zip(ways.clone()).map(|(f, way)| f * way).sum();
        let accelerations = varying.accelerations(self.parameters.step);
        for (motion, a) in self.system.drive.supports.iter().zip(accelerations) {
            loads -= a * motion.momentum.iter().zip(ways.clone()).map(|(m, way)| m * way).sum::<f64>();
        }
        let given = 0.5 * self.system.total(loads + varying.before.carried(&varying.next, &self.reaction))?;
        if self.n > 0 {
            varying.work += 0.5 * (varying.given + given);
        }
        varying.given = given;
        Ok(())
    }

    /// Returns the central velocity `$(U^{n+1} - U^{n-1}) / 2 \Delta t$`, in m/s.
    fn central_velocity(&self) -> Vec<f64> {
        self.d.iter().zip(&self.d_next).map(|(d, e)| (d + e) / (2.0 * self.parameters.step)).collect()
    }

    /// Returns the accumulated work `$W_n$`, in J.
    fn given(&self) -> f64 {
        self.varying.as_ref().map_or(0.0, |varying| varying.work)
    }

    /// Returns the discrete invariant of beta = 1/2 between n and n + 1, in J:
    ///
    /// ```math
    /// H = \frac12 \Bigl|\frac{U^{n+1} - U^n}{\Delta t}\Bigr|_M^2 + \frac14 \bigl(|U^{n+1}|_K^2 + |U^n|_K^2\bigr) - \frac12 F \cdot (U^{n+1} + U^n) - W_n - \frac12 w_n ,
    /// ```
    ///
    /// with the constant load F and the work `$W_n$`, `$w_n$` of time-dependent data. H is constant
    /// in free flight without damping; for e = 0 it never rises.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn invariant(&self) -> Result<f64> {
        let System { engine, stiffness, mass, .. } = self.system;
        let rate: Vec<f64> = self.d_next.iter().map(|d| d / self.parameters.step).collect();
        let next: Vec<f64> = self.u.iter().zip(&self.d_next).map(|(u, d)| u + d).collect();
        let mut product = vec![0.0; next.len()];
        let kinetic = engine.multiply(mass, &rate, &mut product)?;
        let elastic = engine.multiply(stiffness, &next, &mut product)? + 2.0 * self.elastic;
        let work = self.system.work(&self.u)? + self.system.work(&next)?;
        let given = self.varying.as_ref().map_or(0.0, |varying| varying.work + 0.5 * varying.given);
        Ok(0.5 * kinetic + 0.25 * elastic - 0.5 * work - given)
    }
}

impl<E: Engine> Scheme for Newmark<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.n += 1;
        let NewmarkParameters { restitution: e, step: dt, .. } = self.parameters;
        if let Some(varying) = &mut self.varying {
            varying.advance(self.system, e, (self.n + 1) as f64 * dt)?;
        }
        for (u, d) in self.u.iter_mut().zip(&self.d_next) {
            *u += d;
        }
        std::mem::swap(&mut self.d, &mut self.d_next);
        let d = std::mem::take(&mut self.d);
        let drift = (1.0 - e) / (1.0 + e);
        let mut shares = self.shares.take();
        let damp = |system: &System<E>, b: &mut [f64], product: &mut [f64]| {
            system.damp(&d, 1.0 / dt, b, product)?;
            if let Some(modal) = &system.drive.modal {
                let now = modal.of_rate(&system.engine, &d)?;
                let before = shares.as_ref().unwrap_or(&now);
                modal.resist(now.iter().zip(before).map(|(now, before)| (1.5 * now - 0.5 * before) / dt), b);
                shares = Some(now);
            }
            Ok(())
        };
        let half = 0.5 * dt;
        self.impulses.iter_mut().zip(&self.reaction).for_each(|(impulse, r)| *impulse = half * r);
        let solved = self.solve(1.0 + e, |dof| d[dof] * drift, damp);
        self.impulses.iter_mut().zip(&self.reaction).for_each(|(impulse, r)| *impulse += half * r);
        (self.d, self.shares) = (d, shares);
        for ((d_next, d), x) in self.d_next.iter_mut().zip(&self.d).zip(&self.x) {
            *d_next = d + x;
        }
        solved?;
        self.weigh()
    }

    fn step(&self) -> u64 {
        self.n
    }

    fn time(&self) -> f64 {
        self.n as f64 * self.parameters.step
    }

    fn displacement(&self) -> &[f64] {
        &self.u
    }

    /// Returns the central difference `$(U^{n+1} - U^{n-1}) / 2 \Delta t$`, in m/s.
    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity())
    }

    /// Returns central differences of the support places, in m/s, one entry per motion.
    fn support_rates(&self) -> Result<Vec<f64>> {
        let Some(Varying { before, next, .. }) = &self.varying else { return Ok(Vec::new()) };
        let ends = before.places.iter().zip(&next.places);
        Ok(ends.map(|(before, next)| (next - before) / (2.0 * self.parameters.step)).collect())
    }

    fn admissible(&self) -> &[f64] {
        &self.admissible
    }

    fn limits(&self) -> &Bounds {
        let moving = self.varying.as_ref().and_then(|varying| varying.limits.as_ref());
        moving.unwrap_or(&self.system.bounds)
    }

    /// Returns the reactions at the present instant, in N, one entry per bound.
    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    fn impulses(&self) -> &[f64] {
        &self.impulses
    }

    /// Returns the energies of the paper's `$E_n$` (section 5.2), with the central velocity.
    fn energies(&self) -> Result<Energies> {
        let System { engine, mass, .. } = self.system;
        let rate = self.central_velocity();
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.project(mass, &rate, &mut v)?;
        let kinetic = 0.5 * engine.mass_norm_squared(mass, &v)?;
        let work = self.system.work(&self.u)? + self.given();
        Ok(Energies { kinetic, elastic: self.elastic, work })
    }

    fn invariant(&self) -> Result<f64> {
        Newmark::invariant(self)
    }

    fn step_report(&self) -> StepReport {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        let dof = self.system.bounds.dofs[bound];
        // U^{-1} is a ghost value, not a displacement that occurred.
        let velocity = if self.n == 0 { self.arriving[bound] } else { self.d[dof] / self.parameters.step };
        Approach { time: self.time(), deflection: self.u[dof], velocity }
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.n)?;
        archive.value(&mut self.elastic)?;
        self.varying.as_mut().map_or(Ok(()), |varying| varying.archive(archive))?;
        archive.value(&mut self.verdict)?;
        for vector in [&mut self.u, &mut self.d, &mut self.d_next] {
            archive.vector(VectorKind::Dofs, vector)?;
        }
        for vector in [&mut self.admissible, &mut self.reaction, &mut self.impulses] {
            archive.vector(VectorKind::Bounds, vector)?;
        }
        let System { engine, bounds, drive, .. } = self.system;
        if let (Some(modal), false) = (&drive.modal, archive.saves()) {
            self.shares = Some(modal.of_rate(engine, &self.d)?);
        }
        self.solver.archive(engine, &self.sum, bounds, archive)
    }

    fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
