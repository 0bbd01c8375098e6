//! Static equilibrium, to the last digit.

use crate::error::Result;
use crate::linalg::{Engine, Sum};
use crate::obstacle::Bounds;
use crate::vi::kkt::Judge;
use crate::vi::{Condensed, Step, Verdict};

/// Corrections after the first solve. The first removes what rounding the entries of the factored K has spoilt
/// (some 1e-16 h^-4); the second is there for the finest meshes.
const CORRECTIONS: usize = 2;

/// Proximal steps at most, in all and without one that halves the residual.
const MOST_STEPS: u32 = 2000;
const MOST_IDLE_STEPS: u32 = 200;

/// An increment that is below this part of the largest one of a bounded deflection stays where it is.
const STAYS: f64 = 1e-12;

/// Relative KKT residual below which proximal steps go on only as long as each halves it.
const CLOSE: f64 = 1e-12;

/// Equilibrium under a load within bounds: K U = F + G^T r. Returns U, r and what the solver reached.
///
/// The factored K loses digits as h^-4; corrections by its residual, K applied cell by cell, bring them back.
///
/// # Errors
/// [`crate::Error::Singular`] where K is: the structure is a mechanism.
pub fn equilibrium<E: Engine + 'static>(
    engine: &E,
    stiffness: &E::Form,
    load: &[f64],
    bounds: &Bounds,
) -> Result<(Vec<f64>, Vec<f64>, Verdict)>
where
    E::Factor: 'static,
{
    let sum = [(1.0, stiffness)];
    let mut search = Search::new(engine, &sum, stiffness, load, bounds)?;
    for _ in 0..=CORRECTIONS {
        search.increment()?;
        search.add(1.0);
    }
    Ok((search.u, search.reaction, search.verdict))
}

/// Equilibrium under a load within bounds of a structure that only the bounds hold: K is singular, and the minimum of
/// U^T K U / 2 - F^T U within the bounds exists nevertheless. Returns U, r and what the solver reached.
///
/// Proximal steps: each solves the problem with K + c H, H a positive definite form such as a mass, for the increment of U, and goes
/// on along it, within the bounds, to the least energy. While the same bounds bear, increments are made conjugate as in the method
/// of conjugate gradients: rigid motions, which K + c H holds back most, take a few steps. What holds back the increment
/// vanishes with it: the limit is the equilibrium itself, judged with K alone. Of several equilibria, as of a plate that balances
/// on a ridge, it is one near U = 0.
///
/// # Errors
/// [`crate::Error::Singular`] where K + c H is.
pub fn equilibrium_on_bounds<E: Engine + 'static>(
    engine: &E,
    stiffness: &E::Form,
    (c, hold): (f64, &E::Form),
    load: &[f64],
    bounds: &Bounds,
) -> Result<(Vec<f64>, Vec<f64>, Verdict)>
where
    E::Factor: 'static,
{
    let held = [(1.0, stiffness), (c, hold)];
    let mut search = Search::new(engine, &held, stiffness, load, bounds)?;
    let alone = [(1.0, stiffness)];
    let mut judge = Judge::new(engine, &alone)?;
    let mut last = Last::default();
    let (mut best, mut idle) = (f64::INFINITY, 0);
    for _ in 0..MOST_STEPS {
        let length = search.increment()?;
        search.conjugate(&mut last)?;
        let reach = search.reach(&mut last)?;
        search.add(reach);
        let Search { u, reaction, .. } = &search;
        let kkt = judge.residual(engine, &alone, &[load], bounds, length, u, reaction)?;
        search.verdict.kkt = kkt;
        (best, idle) = if kkt < 0.5 * best { (kkt, 0) } else { (best, idle + 1) };
        // An answer as good as rounding allows gets no better.
        if kkt.is_nan() || (kkt <= CLOSE && idle > 0) || idle == MOST_IDLE_STEPS {
            break;
        }
    }
    Ok((search.u, search.reaction, search.verdict))
}

/// The increment of the step before.
#[derive(Default)]
struct Last {
    increment: Vec<f64>,
    /// K times it, and its product with that.
    force: Vec<f64>,
    curvature: f64,
    /// Whether no bound ended the step.
    is_free: bool,
    /// Whether this step's increment was made conjugate to it.
    is_used: bool,
}

/// A search for the equilibrium by increments, each from what the deflection so far leaves of the problem.
struct Search<'s, E: Engine> {
    engine: &'s E,
    sum: &'s Sum<'s, E>,
    stiffness: &'s E::Form,
    load: &'s [f64],
    bounds: &'s Bounds,
    step: Step<E>,
    u: Vec<f64>,
    /// The last increment.
    x: Vec<f64>,
    /// F - K U before it.
    b: Vec<f64>,
    /// The bounds on it.
    left: Bounds,
    reaction: Vec<f64>,
    verdict: Verdict,
}

impl<'s, E: Engine + 'static> Search<'s, E>
where
    E::Factor: 'static,
{
    /// Starts at U = 0, with increments from the matrix of a sum.
    fn new(
        engine: &'s E,
        sum: &'s Sum<'s, E>,
        stiffness: &'s E::Form,
        load: &'s [f64],
        bounds: &'s Bounds,
    ) -> Result<Search<'s, E>> {
        let zeros = || vec![0.0; engine.dofs()];
        let solver = Box::new(Condensed::new(engine, sum, bounds.len())?);
        Ok(Search {
            engine,
            sum,
            stiffness,
            load,
            bounds,
            step: Step::new(solver, engine, sum)?,
            u: zeros(),
            x: zeros(),
            b: zeros(),
            left: bounds.clone(),
            reaction: vec![0.0; bounds.len()],
            verdict: Verdict::default(),
        })
    }

    /// Solves for the next increment. Returns the scale of the deflection, in m. Collective.
    fn increment(&mut self) -> Result<f64> {
        let Search { engine, sum, u, b, left, bounds, .. } = self;
        engine.multiply(self.stiffness, u, b)?;
        b.iter_mut().zip(self.load).for_each(|(b, f)| *b = f - *b);
        left.shift(bounds, |dof, bound| bound - u[dof]);
        let length = engine.maximum(u.iter().fold(bounds.magnitude(), |m, u| m.max(u.abs())))?;
        let step = self.step.solve(engine, sum, b, left, length, &mut self.x, &mut self.reaction)?;
        self.verdict = Verdict {
            iterations: self.verdict.iterations + step.iterations,
            kkt: step.kkt,
            retries: self.verdict.retries + step.retries,
        };
        Ok(length)
    }

    /// Largest magnitude of a bounded deflection, in m. Collective.
    fn largest(&self, x: &[f64]) -> Result<f64> {
        self.engine.maximum(self.left.dofs.iter().fold(0.0, |most: f64, &dof| most.max(x[dof].abs())))
    }

    /// Whether deflections that something bears on stay where they are. Collective.
    fn bearing_stays(&self, x: &[f64]) -> Result<bool> {
        let stays = STAYS * self.largest(x)?;
        let moves = |(r, &dof): (&f64, &usize)| *r != 0.0 && x[dof].abs() > stays;
        let moves = self.reaction.iter().zip(&self.left.dofs).any(moves);
        Ok(self.engine.maximum(f64::from(u8::from(moves)))? == 0.0)
    }

    /// Makes the increment conjugate to the last one, where the same bounds bear. Collective.
    fn conjugate(&mut self, last: &mut Last) -> Result<()> {
        let same = last.is_free && last.curvature > 0.0;
        last.is_used = same && self.bearing_stays(&last.increment)? && self.bearing_stays(&self.x)?;
        if last.is_used {
            let part = self.engine.dot(&self.x, &last.force)? / last.curvature;
            let with: Vec<f64> = self.x.iter().zip(&last.increment).map(|(x, p)| x - part * p).collect();
            last.is_used = self.engine.dot(&self.b, &with)? > 0.0;
            if last.is_used {
                self.x = with;
            }
        }
        Ok(())
    }

    /// How many times the increment the deflection goes, within the bounds, to the least energy; at least 1 unless it was made
    /// conjugate, for all of an answer is within the bounds. Collective.
    fn reach(&self, last: &mut Last) -> Result<f64> {
        let Search { engine, x, b, left, .. } = self;
        let stays = STAYS * self.largest(x)?;
        let room = |(i, &dof): (usize, &usize)| match x[dof] {
            x if x > stays => left.upper[i] / x,
            x if x < -stays => left.lower[i] / x,
            _ => f64::INFINITY,
        };
        let room = left.dofs.iter().enumerate().map(room).fold(f64::INFINITY, f64::min);
        let room = -engine.maximum(-room)?;
        last.force.resize(x.len(), 0.0);
        last.increment.clone_from(x);
        last.curvature = engine.multiply(self.stiffness, x, &mut last.force)?;
        let least = engine.dot(b, x)? / last.curvature;
        last.is_free = room > least;
        let reach = room.min(least);
        Ok(match reach.is_finite() {
            false => 1.0,
            true if last.is_used => reach,
            true => reach.max(1.0),
        })
    }

    fn add(&mut self, reach: f64) {
        self.u.iter_mut().zip(&self.x).for_each(|(u, x)| *u += reach * x);
    }
}
