//! Newmark-e-beta with restitution (the paper's section 4.1, after Paoli and Schatzman 2007).
//!
//! Find U^{n+1,e} = (U^{n+1} + e U^{n-1}) / (1 + e) in K^h such that, with beta-averages of U and F,
//!
//! ```math
//! M \frac{U^{n+1} - 2 U^n + U^{n-1}}{\Delta t^2} + K\,(\beta U^{n+1} + (1 - 2 \beta) U^n + \beta U^{n-1}) = F + G^T r .
//! ```
//!
//! Its unknown here is the second difference x = U^{n+1} - 2 U^n + U^{n-1}:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr) x = F - K U^n + G^T r, \qquad U^{n+1,e} = U^n + \frac{x + (1 - e)(U^n - U^{n-1})}{1 + e} .
//! ```
//!
//! # The start
//!
//! The ghost value U^{-1} = U^1 - 2 dt v_0 makes the energy at 0 exact, and U^1 is that of half a trapezoidal step:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr)\, 2 (U^1 - U^0) = \frac{2}{\Delta t} M v_0 + F - K U^0 + G^T r .
//! ```
//!
//! It is second order, sees v_0 through the momentum M v_0 alone, and gains no energy however rough that is (a clamped plate thrown as a
//! whole, a single node): for beta = 1/2 and y = U^1 - U^0, with `$A = M / \Delta t^2 + K / 2$`, no load and nothing touching,
//!
//! ```math
//! H^{1/2} - \tfrac12 |U^0|_K^2 = \tfrac12 y \cdot A y + \tfrac12 y \cdot K U^0
//!    = \tfrac12 \Bigl|\frac{M v_0}{\Delta t}\Bigr|_{A^{-1}}^2 - \tfrac18 |K U^0|_{A^{-1}}^2 \le \tfrac12 |v_0|_M^2 .
//! ```
//!
//! # Damping, loads and obstacles that change with time
//!
//! D = alpha M + beta_d K acts on the central velocity `$(U^{n+1} - U^{n-1}) / 2 \Delta t = (2 d + x) / 2 \Delta t$`, d = U^n - U^{n-1}: the
//! matrix of a step gains D / (2 dt), its right-hand side - D d / dt; at the start it acts on `$(U^1 - U^0) / \Delta t$`.
//!
//! F is the beta-average of its instants too, and the obstacles are those of their own:
//!
//! ```math
//! \frac{l^{n+1} + e\, l^{n-1}}{1 + e} \le G U^{n+1,e} \le \frac{u^{n+1} + e\, u^{n-1}}{1 + e} .
//! ```
//!
//! So the motion relative to the obstacle has the same law of restitution whatever the obstacle's speed; a plate and its obstacle
//! carried along at a constant one move as they do at rest. Before the start both are taken to have gone on evenly. Damping of single
//! modes ([`super::ModalDamping`]) acts on the extrapolated velocity `$(3 d - d_{before}) / 2 \Delta t$`.
//!
//! The work that both give, with r at the obstacles that it touches (l stands for either),
//!
//! ```math
//! w_n = \tfrac12 F_\beta^n \cdot (U^{n+1} - U^{n-1}) + \tfrac12 r^n \cdot (l^{n+1} - l^{n-1}), \qquad W_n = W_{n-1} + \tfrac12 (w_{n-1} + w_n),
//! ```
//!
//! balances the invariant of beta = 1/2 to rounding: H grows by w_n, less dt V^T D V of the central velocity V, less what contact
//! takes.
//!
//! # Momentum
//!
//! The velocity reported is the central one, `$V^n = (U^{n+1} - U^{n-1}) / 2 \Delta t$`, and `$V^0 = v_0$` by the ghost value. Two equations of
//! successive instants add up to
//!
//! ```math
//! M\,(V^n - V^{n-1}) = \tfrac{\Delta t}{2} \bigl( f^{n-1} + G^T r^{n-1} + f^n + G^T r^n \bigr) ,
//! ```
//!
//! with f all other forces, from n = 1 on, for the start's equation is that of the instant 0: the obstacles' impulse over a step is
//! the trapezoidal sum of the reactions at its ends. The reactions are those of the instant itself.
//!
//! # Supports that move
//!
//! U is counted from the shape R s(t) that their motion s gives the plate. The scheme for U + R s is the scheme for U with the load
//! `$-M R\,(s^{n+1} - 2 s^n + s^{n-1}) / \Delta t^2$` at its instant, whatever s: the acceleration's mean with a hat of width
//! 2 dt, jumps of the velocity included. At the start `$s^{-1} = s^1 - 2 \Delta t\, s'(0)$`, as U^{-1} is.

use super::drive::Moment;
use super::{Approach, Scheme, Start, System};
use crate::archive::{Archive, Over};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, Step, Verdict};

/// Parameters of [`Newmark`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewmarkParameters {
    /// beta, at least 1/4 (unconditionally stable); 1/2 in the paper.
    pub beta: f64,
    /// e, from 0 (absorbing) to 1 (perfect).
    pub restitution: f64,
    /// Delta t, in s.
    pub step: f64,
}

/// The scheme at an instant n: U^n, and the step ahead to U^{n+1} already solved.
pub struct Newmark<'s, E: Engine> {
    system: &'s System<E>,
    sum: [(f64, &'s E::Form); 2],
    solver: Step<E>,
    parameters: NewmarkParameters,
    n: u64,
    /// U^n.
    u: Vec<f64>,
    /// U^n - U^{n-1}.
    d: Vec<f64>,
    /// U^{n+1} - U^n.
    d_next: Vec<f64>,
    x: Vec<f64>,
    b: Vec<f64>,
    /// A product of the damping; empty without.
    product: Vec<f64>,
    bounds: Bounds,
    admissible: Vec<f64>,
    reaction: Vec<f64>,
    /// Impulses of the obstacles from n - 1 to n, in N s.
    impulses: Vec<f64>,
    /// G v_0.
    arriving: Vec<f64>,
    elastic: f64,
    /// Where anything changes with time.
    varying: Option<Varying>,
    /// Shares of U^n - U^{n-1} in the modes that are damped.
    shares: Option<Vec<f64>>,
    verdict: Verdict,
}

/// What changes with time at n - 1, n and n + 1.
struct Varying {
    before: Moment,
    now: Moment,
    next: Moment,
    /// The bounds on U^{n+1,e}.
    limits: Option<Bounds>,
    /// W_n and w_n, in J.
    work: f64,
    given: f64,
}

impl Varying {
    /// At the start: what is before it goes on evenly through it.
    fn new<E: Engine>(system: &System<E>, parameters: NewmarkParameters) -> Result<Varying> {
        let now = system.moment(0.0)?;
        let next = system.moment(parameters.step)?;
        let mut before = now.clone();
        before.extrapolate(&now, &next, -1.0);
        // That of U^{-1}: the place at U^1, less two steps at the first velocity.
        let ways = system.drive.rates(0.0)?.into_iter().map(|rate| 2.0 * parameters.step * rate);
        let places: Vec<f64> = next.places.iter().zip(ways).map(|(next, way)| next - way).collect();
        before.carry(&system.drive, &places);
        let mut varying = Varying { limits: now.bounds.clone(), before, now, next, work: 0.0, given: 0.0 };
        varying.limit(parameters.restitution);
        Ok(varying)
    }

    /// Shows an archive all of it.
    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.work)?;
        archive.value(&mut self.given)?;
        for moment in [&mut self.before, &mut self.now, &mut self.next] {
            moment.archive(archive)?;
        }
        let Some(Bounds { lower, upper, .. }) = &mut self.limits else { return Ok(()) };
        archive.vector(Over::Bounds, lower)?;
        archive.vector(Over::Bounds, upper)
    }

    /// Goes to the instant whose next one is given.
    fn advance<E: Engine>(&mut self, system: &System<E>, restitution: f64, next: f64) -> Result<()> {
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.now, &mut self.next);
        self.next.set(&system.drive, next)?;
        self.limit(restitution);
        Ok(())
    }

    /// Sets the bounds on U^{n+1,e}. Where there is no obstacle at one of the instants, the other has the word.
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

    /// F_beta, at each dof; nothing where the load does not change.
    fn load(&self, beta: f64) -> impl Iterator<Item = f64> {
        let [before, now, next] =
            [&self.before, &self.now, &self.next].map(|moment| moment.load.as_deref().unwrap_or(&[]));
        let instants = now.iter().zip(before.iter().zip(next));
        instants.map(move |(now, (before, next))| now + beta * (next - 2.0 * now + before))
    }

    /// Second differences of the supports' places over dt^2, in m/s^2.
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
    /// Starts with the condensed solver.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where the matrix of a step is not positive definite.
    pub fn new(system: &'s System<E>, parameters: NewmarkParameters, start: Start) -> Result<Newmark<'s, E>> {
        let sum = Self::sum(system, parameters);
        let solver = Condensed::new(&system.engine, &sum, system.bounds.len())?;
        Newmark::with_solver(system, parameters, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Newmark<'s, E> {
    /// The matrix of a step, M / dt^2 + beta K + D / (2 dt).
    pub fn sum(system: &'s System<E>, parameters: NewmarkParameters) -> [(f64, &'s E::Form); 2] {
        let System { mass, stiffness, damping, .. } = system;
        let NewmarkParameters { beta, step: dt, .. } = parameters;
        let half_rate = 0.5 / dt;
        [
            (1.0 / (dt * dt) + half_rate * damping.mass, mass),
            (beta + half_rate * damping.stiffness, stiffness),
        ]
    }

    /// Starts with a given solver of [`Newmark::sum`].
    ///
    /// # Errors
    /// What the solver says.
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
            solver: Step::new(solver, &system.engine, &Self::sum(system, parameters))?,
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
            verdict: Verdict::default(),
        };
        if let Some(modal) = &system.drive.modal {
            modal.check(parameters.step)?;
        }
        // x = 2 (U^1 - U^0), and U^{0,e} = U^0 + x / 2 - 2 dt v_0 e / (1 + e).
        let NewmarkParameters { restitution: e, step: dt, .. } = parameters;
        let drift = |dof: usize| -2.0 * dt * start.velocity[dof] * e / (1.0 + e);
        let mut v = vec![0.0; system.engine.velocities(&system.mass)];
        system.engine.velocity(&system.mass, &start.velocity, &mut v)?;
        let mut momentum = vec![0.0; dofs];
        system.engine.momentum(&system.mass, &v, &mut momentum)?;
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

    /// Solves for x, where the bounded configuration is U^n + x / stretch + drift; `push` adds what else there is to the forces, and has
    /// room for a product.
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
        let sum: &Sum<E> = &self.sum;
        self.verdict =
            self.solver.solve(engine, sum, &self.b, &self.bounds, length, &mut self.x, &mut self.reaction)?;
        let share = 1.0 / stretch;
        for (z, &dof) in self.admissible.iter_mut().zip(&limits.dofs) {
            *z = self.u[dof] + (share * self.x[dof] + drift(dof));
        }
        Ok(())
    }

    /// Takes note of the work that what changes with time has given.
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

    /// (U^{n+1} - U^{n-1}) / (2 dt), in m/s.
    fn central_velocity(&self) -> Vec<f64> {
        self.d.iter().zip(&self.d_next).map(|(d, e)| (d + e) / (2.0 * self.parameters.step)).collect()
    }

    /// W_n, in J.
    fn given(&self) -> f64 {
        self.varying.as_ref().map_or(0.0, |varying| varying.work)
    }

    /// The discrete invariant of beta = 1/2 between n and n + 1, in J:
    /// `$H = \frac12 |\frac{U^{n+1} - U^n}{\Delta t}|_M^2 + \frac14 (|U^{n+1}|_K^2 + |U^n|_K^2) - \frac12 F (U^{n+1} + U^n)$`,
    /// with the constant load F, less the work `$W_n + \frac12 w_n$` of what changes with time.
    /// Constant in free flight without damping; for e = 0 it never rises.
    ///
    /// # Errors
    /// What the engine says.
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

    /// The central difference (U^{n+1} - U^{n-1}) / (2 dt).
    fn velocity(&mut self) -> Result<Vec<f64>> {
        Ok(self.central_velocity())
    }

    /// The central differences of their places.
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

    /// Those of the present instant.
    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    fn impulses(&self) -> &[f64] {
        &self.impulses
    }

    /// The paper's E_n, of the central difference.
    fn energies(&self) -> Result<Energies> {
        let System { engine, mass, .. } = self.system;
        let rate = self.central_velocity();
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.velocity(mass, &rate, &mut v)?;
        let kinetic = 0.5 * engine.vis_viva(mass, &v)?;
        let work = self.system.work(&self.u)? + self.given();
        Ok(Energies { kinetic, elastic: self.elastic, work })
    }

    fn invariant(&self) -> Result<f64> {
        Newmark::invariant(self)
    }

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        let dof = self.system.bounds.dofs[bound];
        // U^0 - U^{-1} is no way that was gone.
        let velocity = if self.n == 0 { self.arriving[bound] } else { self.d[dof] / self.parameters.step };
        Approach { time: self.time(), deflection: self.u[dof], velocity }
    }

    fn state(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.n)?;
        archive.value(&mut self.elastic)?;
        self.varying.as_mut().map_or(Ok(()), |varying| varying.archive(archive))?;
        archive.value(&mut self.verdict)?;
        for vector in [&mut self.u, &mut self.d, &mut self.d_next] {
            archive.vector(Over::Dofs, vector)?;
        }
        for vector in [&mut self.admissible, &mut self.reaction, &mut self.impulses] {
            archive.vector(Over::Bounds, vector)?;
        }
        let System { engine, bounds, drive, .. } = self.system;
        if let (Some(modal), false) = (&drive.modal, archive.saves()) {
            self.shares = Some(modal.of_rate(engine, &self.d)?);
        }
        self.solver.state(engine, &self.sum, bounds, archive)
    }

    fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
