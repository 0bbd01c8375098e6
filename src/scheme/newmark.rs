//! Newmark-e-beta with restitution (the paper's section 4.1, after Paoli and Schatzman 2007).
//!
//! Find U^{n+1,e} = (U^{n+1} + e U^{n-1}) / (1 + e) in K^h such that, with beta-averages of U and F,
//! \[ M \frac{U^{n+1} - 2 U^n + U^{n-1}}{\Delta t^2} + K\,(\beta U^{n+1} + (1 - 2 \beta) U^n + \beta U^{n-1}) = F + G^T r . \]
//! Its unknown here is the second difference x = U^{n+1} - 2 U^n + U^{n-1}:
//! \[ \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr) x = F - K U^n + G^T r, \qquad U^{n+1,e} = U^n + \frac{x + (1 - e)(U^n - U^{n-1})}{1 + e} . \]
//! # The start
//!
//! The ghost value U^{-1} = U^1 - 2 dt v_0 makes the energy at 0 exact, and U^1 is that of half a trapezoidal step:
//! \[ \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr)\, 2 (U^1 - U^0) = \frac{2}{\Delta t} M v_0 + F - K U^0 + G^T r . \]
//! It is second order, sees v_0 through the momentum M v_0 alone, and gains no energy however rough that is (a clamped plate thrown as a
//! whole, a single node): for beta = 1/2 and y = U^1 - U^0, with \( A = M / \Delta t^2 + K / 2 \), no load and nothing touching,
//! \[ H^{1/2} - \tfrac12 |U^0|_K^2 = \tfrac12 y \cdot A y + \tfrac12 y \cdot K U^0
//!    = \tfrac12 \Bigl|\frac{M v_0}{\Delta t}\Bigr|_{A^{-1}}^2 - \tfrac18 |K U^0|_{A^{-1}}^2 \le \tfrac12 |v_0|_M^2 . \]

use super::{Approach, Scheme, Start, System};
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
    bounds: Bounds,
    admissible: Vec<f64>,
    reaction: Vec<f64>,
    elastic: f64,
    verdict: Verdict,
}

impl<'s, E: Engine + 'static> Newmark<'s, E>
where
    E::Factor: 'static,
{
    /// Starts with the condensed solver.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where M / dt^2 + beta K is not positive definite.
    pub fn new(system: &'s System<E>, parameters: NewmarkParameters, start: Start) -> Result<Newmark<'s, E>> {
        let sum = Self::sum(system, parameters);
        let solver = Condensed::new(&system.engine, &sum, system.bounds.len())?;
        Newmark::with_solver(system, parameters, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Newmark<'s, E> {
    /// The matrix of a step, M / dt^2 + beta K.
    pub fn sum(system: &'s System<E>, parameters: NewmarkParameters) -> [(f64, &'s E::Form); 2] {
        let NewmarkParameters { beta, step: dt, .. } = parameters;
        [(1.0 / (dt * dt), &system.mass), (beta, &system.stiffness)]
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
            bounds: system.bounds.clone(),
            admissible: vec![0.0; count],
            reaction: vec![0.0; count],
            elastic: 0.0,
            verdict: Verdict::default(),
        };
        // x = 2 (U^1 - U^0), and U^{0,e} = U^0 + x / 2 - 2 dt v_0 e / (1 + e).
        let NewmarkParameters { restitution: e, step: dt, .. } = parameters;
        let drift = |dof: usize| -2.0 * dt * start.velocity[dof] * e / (1.0 + e);
        let mut v = vec![0.0; system.engine.velocities(&system.mass)];
        system.engine.velocity(&system.mass, &start.velocity, &mut v)?;
        let mut momentum = vec![0.0; dofs];
        system.engine.momentum(&system.mass, &v, &mut momentum)?;
        momentum.iter_mut().for_each(|momentum| *momentum *= 2.0 / dt);
        scheme.solve(2.0, drift, Some(&momentum))?;
        for ((d, d_next), (x, v)) in
            scheme.d.iter_mut().zip(&mut scheme.d_next).zip(scheme.x.iter().zip(&start.velocity))
        {
            *d = 2.0 * dt * v - 0.5 * x;
            *d_next = 0.5 * x;
        }
        Ok(scheme)
    }

    /// Solves for x, where the bounded configuration is U^n + x / stretch + drift; `push` adds to the forces.
    fn solve(&mut self, stretch: f64, drift: impl Fn(usize) -> f64, push: Option<&[f64]>) -> Result<()> {
        let System { engine, bounds, .. } = self.system;
        self.elastic = self.system.force(&self.u, &mut self.b)?;
        if let Some(push) = push {
            self.b.iter_mut().zip(push).for_each(|(b, push)| *b += push);
        }
        self.bounds.shift(bounds, |dof, bound| ((bound - self.u[dof]) - drift(dof)) * stretch);
        let length = self.system.length(&self.u)?;
        let sum: &Sum<E> = &self.sum;
        self.verdict =
            self.solver.solve(engine, sum, &self.b, &self.bounds, length, &mut self.x, &mut self.reaction)?;
        let share = 1.0 / stretch;
        for (z, &dof) in self.admissible.iter_mut().zip(&bounds.dofs) {
            *z = self.u[dof] + (share * self.x[dof] + drift(dof));
        }
        Ok(())
    }

    /// The discrete invariant of beta = 1/2 between n and n + 1, in J:
    /// \( H = \frac12 |\frac{U^{n+1} - U^n}{\Delta t}|_M^2 + \frac14 (|U^{n+1}|_K^2 + |U^n|_K^2) - \frac12 F (U^{n+1} + U^n) \).
    /// Constant in free flight; for e = 0 it never rises.
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
        Ok(0.5 * kinetic + 0.25 * elastic - 0.5 * work)
    }
}

impl<E: Engine> Scheme for Newmark<'_, E> {
    fn advance(&mut self) -> Result<()> {
        self.n += 1;
        for (u, d) in self.u.iter_mut().zip(&self.d_next) {
            *u += d;
        }
        std::mem::swap(&mut self.d, &mut self.d_next);
        let e = self.parameters.restitution;
        let d = std::mem::take(&mut self.d);
        let drift = (1.0 - e) / (1.0 + e);
        let solved = self.solve(1.0 + e, |dof| d[dof] * drift, None);
        self.d = d;
        for ((d_next, d), x) in self.d_next.iter_mut().zip(&self.d).zip(&self.x) {
            *d_next = d + x;
        }
        solved
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
    fn velocity(&self) -> Vec<f64> {
        self.d.iter().zip(&self.d_next).map(|(d, e)| (d + e) / (2.0 * self.parameters.step)).collect()
    }

    fn admissible(&self) -> &[f64] {
        &self.admissible
    }

    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    /// The paper's E_n, of the central difference.
    fn energies(&self) -> Result<Energies> {
        let System { engine, mass, .. } = self.system;
        let rate = self.velocity();
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.velocity(mass, &rate, &mut v)?;
        let kinetic = 0.5 * engine.vis_viva(mass, &v)?;
        Ok(Energies { kinetic, elastic: self.elastic, work: self.system.work(&self.u)? })
    }

    fn invariant(&self) -> Result<f64> {
        Newmark::invariant(self)
    }

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        let dof = self.system.bounds.dofs[bound];
        Approach { time: self.time(), deflection: self.u[dof], velocity: self.d[dof] / self.parameters.step }
    }

    fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
