//! Static equilibrium, accurate to rounding.

mod nonlinear;

pub use nonlinear::{NonlinearPlate, TangentOf, TangentPart};

use super::conjugate_gradients;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{axpy, aypx};
use crate::linalg::{Engine, Factor, Form, LinearCombination, MOST_SPOILT, estimate_factor_error};
use crate::obstacle::Bounds;
use crate::vi::kkt::KktCheck;
use crate::vi::{Answer, CheckedSolver, Condensed, Problem, StepReport};

/// Number of corrections after the first solve. The first removes the effect of rounding the
/// entries of the factored K (about 1e-16 h^-4); the second is needed on the finest meshes.
const CORRECTIONS: usize = 2;

/// Relative KKT residual up to which an equilibrium by conjugate gradients is accepted.
const ACCURATE: f64 = 1e-12;

/// Largest number of proximal steps, in all and in succession without halving the residual.
const MAX_STEPS: u32 = 2000;
const MAX_IDLE_STEPS: u32 = 200;

/// Relative size, compared with the largest increment of a bounded deflection, below which an
/// increment counts as zero.
const ZERO_INCREMENT: f64 = 1e-12;

/// Relative KKT residual below which proximal steps continue only while each halves it.
const CONVERGED_RESIDUAL: f64 = 1e-12;

/// Largest multiple of an increment, and number of bisections, of the search for the least energy
/// with bounds that yield.
const MAX_MULTIPLE: f64 = 1e15;
const BISECTIONS: usize = 60;

/// Displacement U (m, one entry per dof), reactions r (N, one entry per bound), and the accuracy
/// that the solver reached.
pub type Equilibrium = (Vec<f64>, Vec<f64>, StepReport);

/// Solves the static equilibrium K U = F + G^T r under bounds. Returns U (m), r (N) and the
/// accuracy that the solver reached.
///
/// The factored K loses digits as h^-4; corrections with the residual, K applied cell by cell,
/// restore them. Where too few are left for that, conjugate gradients find an equilibrium that
/// touches nothing, and for others K is factored with more digits.
///
/// # Errors
/// Returns [`crate::Error::Singular`] where K is singular, i.e. the structure is a mechanism.
pub fn equilibrium<E: Engine + 'static>(
    engine: &E,
    stiffness: &Form,
    load: &[f64],
    bounds: &Bounds,
) -> Result<Equilibrium> {
    let plate = PlateUnderLoad { engine, stiffness, load, bounds };
    let matrix = stiffness.into();
    if let Some(mut rough) = engine.rough_factor(&matrix)? {
        let error = estimate_factor_error(engine, &matrix, rough.as_mut())?;
        if error <= MOST_SPOILT {
            let solver = Condensed::with_factor(engine, rough, error, bounds.len())?;
            return plate.corrected(solver, &matrix);
        }
        if let Some(answer) = plate.free_equilibrium(rough)? {
            return Ok(answer);
        }
    }
    let solver = Condensed::new(engine, &matrix, bounds.len())?;
    plate.corrected(solver, &matrix)
}

/// Plate in equilibrium under a load F (N) and bounds, with its stiffness K.
struct PlateUnderLoad<'s, E> {
    engine: &'s E,
    stiffness: &'s Form,
    load: &'s [f64],
    bounds: &'s Bounds,
}

impl<'s, E: Engine + 'static> PlateUnderLoad<'s, E> {
    /// Solves the static equilibrium by a solver and corrections with the residual.
    fn corrected(self, solver: Condensed, matrix: &'s LinearCombination<'s>) -> Result<Equilibrium> {
        let mut search = Search::new(self, solver, matrix)?;
        let mut length = 0.0;
        for _ in 0..=CORRECTIONS {
            length = search.increment()?;
            search.add(1.0);
        }
        search.measure(length)?;
        Ok((search.u, search.reaction, search.report))
    }

    /// Solves the static equilibrium with a factor of K that rounding has spoilt. Returns `None`
    /// where the plate would cross a bound, or the answer is not accurate. Collective.
    fn free_equilibrium(&self, mut factor: Box<dyn Factor>) -> Result<Option<Equilibrium>> {
        let PlateUnderLoad { engine, stiffness, load, bounds } = *self;
        let Some(mut u) = conjugate_gradients::solve(engine, stiffness, factor.as_mut(), load)? else {
            return Ok(None);
        };
        if engine.comm().all_reduce_any(bounds.are_crossed(&u)) {
            return Ok(None);
        }
        let mut reaction = vec![0.0; bounds.len()];
        let largest = u.iter().fold(bounds.magnitude(), |m, u| m.max(u.abs()));
        let matrix = stiffness.into();
        let length = engine.comm().all_reduce_max(largest);
        let problem = Problem { matrix: &matrix, rhs: load, bounds, length };
        let answer = Answer { x: &mut u, reaction: &mut reaction };
        let kkt = KktCheck::new(engine, &matrix)?.residual(engine, &problem, &[], &answer)?;
        let report = StepReport { kkt, ..StepReport::default() };
        Ok((kkt <= ACCURATE).then_some((u, reaction, report)))
    }
}

/// Solves the static equilibrium under bounds of a structure supported by the bounds alone: K is
/// singular, but U^T K U / 2 - F^T U has a minimum within the bounds. Returns U (m), r (N) and the
/// accuracy that the solver reached.
///
/// The method uses proximal steps. Each solves the problem with K + H for the increment of U, where
/// `hold` = H is positive definite, such as a multiple of a mass matrix, and goes along it, within
/// the bounds, to the least energy. While the active bounds do not change, increments are conjugate
/// as in the method of conjugate gradients, so that rigid motions, which K + H restrains most, take
/// few steps. The proximal term vanishes with the increment: the limit is the equilibrium itself,
/// checked with K alone. Of several equilibria, for instance of a plate balanced on a ridge, it is
/// one near U = 0.
///
/// # Errors
/// Returns [`crate::Error::Singular`] where K + H is singular.
pub fn equilibrium_on_bounds<'f, E: Engine + 'static>(
    engine: &E,
    stiffness: &'f Form,
    hold: LinearCombination<'f>,
    load: &[f64],
    bounds: &Bounds,
) -> Result<Equilibrium> {
    let held = stiffness + hold;
    let solver = Condensed::new(engine, &held, bounds.len())?;
    let plate = PlateUnderLoad { engine, stiffness, load, bounds };
    let mut search = Search::new(plate, solver, &held)?;
    let mut last = Last::default();
    let (mut best, mut idle) = (f64::INFINITY, 0);
    for _ in 0..MAX_STEPS {
        let length = search.increment()?;
        search.conjugate(&mut last)?;
        let multiple = search.step_length(&mut last)?;
        search.add(multiple);
        let kkt = search.measure(length)?;
        (best, idle) = if kkt < 0.5 * best { (kkt, 0) } else { (best, idle + 1) };
        // An answer accurate to rounding cannot improve.
        if kkt.is_nan() || (kkt <= CONVERGED_RESIDUAL && idle > 0) || idle == MAX_IDLE_STEPS {
            break;
        }
    }
    Ok((search.u, search.reaction, search.report))
}

/// Increment of the previous step.
#[derive(Default)]
struct Last {
    increment: Vec<f64>,
    /// Product of K with the increment, and the curvature x^T K x.
    force: Vec<f64>,
    curvature: f64,
    /// Whether no bound limited the step.
    is_free: bool,
    /// Whether the increment of the present step was made conjugate to it.
    is_used: bool,
}

/// Iteration for the equilibrium by increments of the deflection.
struct Search<'s, E: Engine> {
    plate: PlateUnderLoad<'s, E>,
    matrix: &'s LinearCombination<'s>,
    step: CheckedSolver<E>,
    /// Check of the whole deflection, with K alone.
    check: KktCheck,
    u: Vec<f64>,
    /// Last increment, in m, one entry per dof.
    x: Vec<f64>,
    /// Residual F - K U before the increment, in N, one entry per dof.
    b: Vec<f64>,
    /// Bounds on the increment, in m.
    remaining: Bounds,
    reaction: Vec<f64>,
    report: StepReport,
}

impl<'s, E: Engine + 'static> Search<'s, E> {
    /// Starts at U = 0, with increments from this solver of this matrix.
    fn new(
        plate: PlateUnderLoad<'s, E>,
        solver: Condensed,
        matrix: &'s LinearCombination<'s>,
    ) -> Result<Search<'s, E>> {
        let PlateUnderLoad { engine, stiffness, bounds, .. } = plate;
        let zeros = || vec![0.0; engine.dofs()];
        Ok(Search {
            plate,
            matrix,
            step: CheckedSolver::new(Box::new(solver), engine, matrix)?,
            check: KktCheck::new(engine, &stiffness.into())?,
            u: zeros(),
            x: zeros(),
            b: zeros(),
            remaining: bounds.clone(),
            reaction: vec![0.0; bounds.len()],
            report: StepReport::default(),
        })
    }

    /// Solves for the next increment. Returns the length scale of the deflection, in m. Collective.
    fn increment(&mut self) -> Result<f64> {
        let Search { plate, matrix, u, x, b, remaining, reaction, .. } = self;
        let PlateUnderLoad { engine, stiffness, load, bounds } = *plate;
        engine.multiply(stiffness, u, b)?;
        aypx(-1.0, load, b);
        remaining.shift(bounds, u);
        let length = engine.comm().all_reduce_max(u.iter().fold(bounds.magnitude(), |m, u| m.max(u.abs())));
        let problem = Problem { matrix, rhs: b, bounds: remaining, length };
        let step = self.step.solve(engine, &problem, &mut Answer { x, reaction })?;
        self.report = StepReport { kkt: step.kkt, ..self.report.and(step) };
        Ok(length)
    }

    /// Returns the largest magnitude of a bounded deflection, in m. Collective.
    fn largest(&self, x: &[f64]) -> Result<f64> {
        let most = self.remaining.dofs.iter().fold(0.0, |most: f64, &dof| most.max(x[dof].abs()));
        Ok(self.plate.engine.comm().all_reduce_max(most))
    }

    /// Returns whether x leaves all deflections with a nonzero reaction unchanged. Collective.
    fn bearing_stays(&self, x: &[f64]) -> Result<bool> {
        let stays = ZERO_INCREMENT * self.largest(x)?;
        let moves = |(r, &dof): (&f64, &usize)| *r != 0.0 && x[dof].abs() > stays;
        let moves = self.reaction.iter().zip(&self.remaining.dofs).any(moves);
        Ok(!self.plate.engine.comm().all_reduce_any(moves))
    }

    /// Makes the increment conjugate to the last one if the active bounds are the same. Collective.
    fn conjugate(&mut self, last: &mut Last) -> Result<()> {
        let same = last.is_free && last.curvature > 0.0;
        last.is_used = same && self.bearing_stays(&last.increment)? && self.bearing_stays(&self.x)?;
        if last.is_used {
            let part = self.plate.engine.dot(&self.x, &last.force)? / last.curvature;
            let mut with = self.x.clone();
            axpy(-part, &last.increment, &mut with);
            last.is_used = self.plate.engine.dot(&self.b, &with)? > 0.0;
            if last.is_used {
                self.x = with;
            }
        }
        Ok(())
    }

    /// Returns the multiple of the increment at which the energy within the bounds is least. It is
    /// at least 1 unless the increment was made conjugate, since a full increment is within the
    /// bounds. Collective.
    fn step_length(&self, last: &mut Last) -> Result<f64> {
        let Search { plate: PlateUnderLoad { engine, stiffness, .. }, x, b, remaining, .. } = self;
        let stays = ZERO_INCREMENT * self.largest(x)?;
        let room = |(i, &dof): (usize, &usize)| match x[dof] {
            x if x > stays => remaining.rigid(i)[1] / x,
            x if x < -stays => remaining.rigid(i)[0] / x,
            _ => f64::INFINITY,
        };
        let room = remaining.dofs.iter().enumerate().map(room).fold(f64::INFINITY, f64::min);
        let room = -engine.comm().all_reduce_max(-room);
        last.force.resize(x.len(), 0.0);
        last.increment.clone_from(x);
        last.curvature = engine.multiply(stiffness, x, &mut last.force)?;
        let force = engine.dot(b, x)?;
        let least = match remaining.laws.are_rigid() {
            true => force / last.curvature,
            false => self.least_yielding([force, last.curvature], room),
        };
        last.is_free = room > least;
        let multiple = room.min(least);
        Ok(match multiple.is_finite() {
            false => 1.0,
            true if last.is_used => multiple,
            true => multiple.max(1.0),
        })
    }

    /// Returns the multiple of the increment, from 1 to `room`, at which the energy with that of
    /// bounds that yield is least. The parts of its slope are the work of the increment and its
    /// curvature without such bounds. Collective.
    fn least_yielding(&self, [work, curvature]: [f64; 2], room: f64) -> f64 {
        let Search { plate: PlateUnderLoad { engine, .. }, x, remaining, .. } = self;
        let slope = |multiple: f64| {
            let of_bound = |(i, &dof): (usize, &usize)| x[dof] * remaining.reaction(i, multiple * x[dof]);
            let share: f64 = remaining.dofs.iter().enumerate().map(of_bound).sum();
            multiple * curvature - work - engine.comm().all_reduce_sum(share)
        };
        let (mut low, mut high) = (1.0, 1.0);
        while high < room && high < MAX_MULTIPLE && slope(high) < 0.0 {
            (low, high) = (high, (2.0 * high).min(room));
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            *(if slope(middle) < 0.0 { &mut low } else { &mut high }) = middle;
        }
        high
    }

    /// Measures deflection and reactions by the KKT residual of the whole problem. Reports and
    /// returns the residual. Collective.
    ///
    /// The residual of the last increment's own problem is no measure: after convergence that
    /// increment consists of rounding errors of the whole deflection. It is the difference of two
    /// displacements, by the right-hand side and by the forces of bounds that yield, and has no
    /// correct digit.
    fn measure(&mut self, length: f64) -> Result<f64> {
        let Search { plate, check, u, reaction, report, .. } = self;
        let PlateUnderLoad { engine, stiffness, load, bounds } = *plate;
        let problem = Problem { matrix: &stiffness.into(), rhs: load, bounds, length };
        report.kkt = check.residual(engine, &problem, &[], &Answer { x: u, reaction })?;
        Ok(report.kkt)
    }

    /// Adds a multiple of the increment to the deflection.
    fn add(&mut self, multiple: f64) {
        axpy(multiple, &self.x, &mut self.u);
    }
}
