//! The midpoint scheme (the paper's section 4.2, equation 6).
//!
//! Find U^{n+1/2} in K^h; its unknown here is the increment x = U^{n+1/2} - U^n:
//! \[ \Bigl(\frac{4}{\Delta t^2} M + K\Bigr) x = \frac{2}{\Delta t} B^T V^n - K U^n + F + G^T r, \]
//! \[ U^{n+1} = U^n + 2 x, \qquad V^{n+1} = \frac{4}{\Delta t} C^{-1} B\, x - V^n . \]
//! With the consistent mass B = C = M_r, and the scheme gains energy at impacts without bound.

use super::{Approach, Scheme, Start, System};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Solver, Step, Verdict};

/// The scheme at an instant n: U^n and V^n.
pub struct Midpoint<'s, E: Engine> {
    system: &'s System<E>,
    sum: [(f64, &'s E::Form); 2],
    solver: Step<E>,
    dt: f64,
    n: u64,
    u: Vec<f64>,
    v: Vec<f64>,
    x: Vec<f64>,
    b: Vec<f64>,
    momentum: Vec<f64>,
    rate: Vec<f64>,
    bounds: Bounds,
    /// G U^{n-1/2} of the last step, and of the two before it.
    admissible: Vec<f64>,
    earlier: Vec<f64>,
    earliest: Vec<f64>,
    reaction: Vec<f64>,
    verdict: Verdict,
}

impl<'s, E: Engine + 'static> Midpoint<'s, E>
where
    E::Factor: 'static,
{
    /// Starts with the condensed solver and a step of `dt` seconds.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where 4 M / dt^2 + K is not positive definite.
    pub fn new(system: &'s System<E>, dt: f64, start: Start) -> Result<Midpoint<'s, E>> {
        let solver = Condensed::new(&system.engine, &Self::sum(system, dt), system.bounds.len())?;
        Midpoint::with_solver(system, dt, start, Box::new(solver))
    }
}

impl<'s, E: Engine> Midpoint<'s, E> {
    /// The matrix of a step, 4 M / dt^2 + K.
    pub fn sum(system: &'s System<E>, dt: f64) -> [(f64, &'s E::Form); 2] {
        [(4.0 / (dt * dt), &system.mass), (1.0, &system.stiffness)]
    }

    /// Starts with a given solver of [`Midpoint::sum`].
    ///
    /// # Errors
    /// What the engine says.
    pub fn with_solver(
        system: &'s System<E>,
        dt: f64,
        start: Start,
        solver: Box<dyn Solver<E>>,
    ) -> Result<Midpoint<'s, E>> {
        let System { engine, mass, bounds, .. } = system;
        let dofs = engine.dofs();
        let mut v = vec![0.0; engine.velocities(mass)];
        engine.velocity(mass, &start.velocity, &mut v)?;
        // The plate comes to U^0 at its first velocity.
        let before = |steps: f64| {
            let at = |&dof: &usize| start.displacement[dof] - steps * dt * start.velocity[dof];
            bounds.dofs.iter().map(at).collect::<Vec<f64>>()
        };
        let (admissible, earlier, earliest) = (before(0.5), before(1.5), before(2.5));
        Ok(Midpoint {
            system,
            sum: Self::sum(system, dt),
            solver: Step::new(solver, engine, &Self::sum(system, dt))?,
            dt,
            n: 0,
            u: start.displacement,
            rate: vec![0.0; v.len()],
            v,
            // The increment that the first velocity makes.
            x: start.velocity.iter().map(|v| 0.5 * dt * v).collect(),
            b: vec![0.0; dofs],
            momentum: vec![0.0; dofs],
            bounds: bounds.clone(),
            admissible,
            earlier,
            earliest,
            reaction: vec![0.0; bounds.len()],
            verdict: Verdict::default(),
        })
    }
}

impl<E: Engine> Scheme for Midpoint<'_, E> {
    fn advance(&mut self) -> Result<()> {
        let System { engine, stiffness, mass, bounds, .. } = self.system;
        let dt = self.dt;
        engine.multiply(stiffness, &self.u, &mut self.b)?;
        self.system.subtract_from_load(&mut self.b);
        engine.momentum(mass, &self.v, &mut self.momentum)?;
        for (b, momentum) in self.b.iter_mut().zip(&self.momentum) {
            *b += 2.0 / dt * momentum;
        }
        for (i, &dof) in bounds.dofs.iter().enumerate() {
            self.bounds.lower[i] = bounds.lower[i] - self.u[dof];
            self.bounds.upper[i] = bounds.upper[i] - self.u[dof];
        }
        let length = self.system.length(&self.u)?;
        let sum: &Sum<E> = &self.sum;
        self.verdict =
            self.solver.solve(engine, sum, &self.b, &self.bounds, length, &mut self.x, &mut self.reaction)?;
        std::mem::swap(&mut self.earliest, &mut self.earlier);
        std::mem::swap(&mut self.earlier, &mut self.admissible);
        for (z, &dof) in self.admissible.iter_mut().zip(&bounds.dofs) {
            *z = self.u[dof] + self.x[dof];
        }
        engine.velocity(mass, &self.x, &mut self.rate)?;
        for (v, rate) in self.v.iter_mut().zip(&self.rate) {
            *v = 4.0 / dt * rate - *v;
        }
        for (u, x) in self.u.iter_mut().zip(&self.x) {
            *u += 2.0 * x;
        }
        self.n += 1;
        Ok(())
    }

    fn step(&self) -> u64 {
        self.n
    }

    fn time(&self) -> f64 {
        self.n as f64 * self.dt
    }

    fn displacement(&self) -> &[f64] {
        &self.u
    }

    /// (U^n - U^{n-1}) / dt, half a step back: with the singular mass V^n has values in cells only. At the start v_0.
    fn velocity(&self) -> Vec<f64> {
        self.x.iter().map(|x| 2.0 / self.dt * x).collect()
    }

    fn admissible(&self) -> &[f64] {
        &self.admissible
    }

    fn reaction(&self) -> &[f64] {
        &self.reaction
    }

    fn energies(&self) -> Result<Energies> {
        self.system.energies(&self.u, &self.v)
    }

    fn verdict(&self) -> Verdict {
        self.verdict
    }

    fn approach(&self, bound: usize) -> Approach {
        // The present step solved for the middle of the last interval.
        let velocity = (self.earlier[bound] - self.earliest[bound]) / self.dt;
        Approach { time: (self.n as f64 - 1.5) * self.dt, deflection: self.earlier[bound], velocity }
    }

    fn factorisations(&self) -> u64 {
        self.solver.factorisations()
    }
}
