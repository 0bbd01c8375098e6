//! Condensed solver: one factorisation, and contact in a small dense problem on the candidates.
//!
//! A step is a forward elimination down to the candidates, their dense box-constrained problem, and
//! a back substitution: the cost of one solve. Nodes that come into reach become candidates, in
//! growing lots, and the matrix is factored again with them last. Where contact is wide (a plate
//! thrown flat), the dense problem would cost more than a sparse factor. Above [`DENSE_LIMIT`]
//! candidates, and until nothing touches any more, the active dofs are therefore pinned in the
//! sparse matrix, natively on the same symbolic analysis. So they are with factors that have no
//! Schur complement. Both are exact active-set methods.
//!
//! Bounds that yield are candidates like others, of a dense problem that Newton's method solves;
//! beside pinned dofs their forces follow from the displacements that unit forces cause.

mod pinned;

use super::active_set::{self, BoundStatus};
use super::laws::{self, YieldingProblem};
use super::{Answer, DenseProblem, Problem, Solver};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::hash;
use crate::linalg::vectors::{clear, is_zero};
use crate::linalg::{Engine, Factor, LinearCombination, estimate_factor_error};
use crate::obstacle::Bounds;
use faer::Mat;

/// Number of candidates above which active dofs are pinned in the sparse matrix.
pub const DENSE_LIMIT: usize = 512;

/// Smallest number of candidates added when a node comes into reach.
const FIRST_LOT: usize = 4;

/// Largest KKT residual, dimensionless, that is accepted from the Schur complement. Above it the
/// step is solved again with the active dofs pinned: neighbouring dofs may be nearly dependent.
const MAX_SCHUR_RESIDUAL: f64 = 1e-11;

/// Condensed solver; see the [module page](self).
pub struct Condensed {
    factor: Box<dyn Factor>,
    method: Method,
    /// Status of each bound in the last answer.
    sides: Vec<BoundStatus>,
    factorisations: u64,
    /// Error of the first factor, and of the present one where digits were added to it.
    factor_error: f64,
    error_with_digits: Option<f64>,
    /// Whether the first rank's dense answers count for all, since ranks have disagreed.
    is_led: bool,
    work: DenseWork,
}

/// Work space of the dense problem, one entry per candidate of all ranks.
#[derive(Debug, Default)]
struct DenseWork {
    /// Lower bounds, upper bounds (m) and codes of statuses, one after the other.
    shared: Vec<f64>,
    sides: Vec<BoundStatus>,
    /// Right-hand side, in N.
    h: Vec<f64>,
    /// Unknown x, in m, and reactions, in N.
    values: Vec<f64>,
    forces: Vec<f64>,
}

#[derive(Debug)]
enum Method {
    /// Dense problem on these bounds (ascending indices into them), the first of which is the
    /// candidate `first` of all ranks.
    Dense { candidates: Vec<usize>, first: usize },
    /// Active dofs pinned in the sparse matrix, with the statuses for which it was last factored.
    Pinned { pinned: Vec<BoundStatus> },
}

impl Condensed {
    /// Factors the matrix, with no candidates yet, for bounds on `bounded` dofs.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the matrix is not positive definite.
    pub fn new(engine: &impl Engine, matrix: &LinearCombination, bounded: usize) -> Result<Condensed> {
        let mut factor = engine.factor(matrix, &[])?;
        let error = estimate_factor_error(engine, matrix, factor.as_mut())?;
        Condensed::with_factor(engine, factor, error, bounded)
    }

    /// Takes a factor without contact dofs whose [`estimate_factor_error`] is `error`.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where rounding spoils the factor too much.
    pub fn with_factor(
        engine: &impl Engine,
        factor: Box<dyn Factor>,
        error: f64,
        bounded: usize,
    ) -> Result<Condensed> {
        super::require_convergence(error, engine.dofs())?;
        Ok(Condensed {
            factor_error: error,
            error_with_digits: None,
            factor,
            method: Method::Dense { candidates: Vec::new(), first: 0 },
            is_led: false,
            sides: vec![BoundStatus::Free; bounded],
            factorisations: 1,
            work: DenseWork::default(),
        })
    }

    /// Returns how many corrections by the residual an answer needs.
    pub fn corrections(&self) -> u32 {
        super::corrections(self.error_with_digits.unwrap_or(self.factor_error))
    }

    /// Makes candidates of the bounds that x violates and of those nearest to their bounds.
    fn grow(
        &mut self,
        engine: &impl Engine,
        matrix: &LinearCombination,
        bounds: &Bounds,
        x: &[f64],
    ) -> Result<()> {
        if self.factor.schur_factor().is_none() {
            return self.pin(engine, matrix);
        }
        let Method::Dense { candidates, first } = &mut self.method else { return Ok(()) };
        let gap = |i: usize| {
            let x = x[bounds.dofs[i]];
            (x - bounds.lower[i]).min(bounds.upper[i] - x)
        };
        let mut others = vec![true; bounds.len()];
        for &i in candidates.iter() {
            others[i] = false;
        }
        let others: Vec<usize> = (0..bounds.len()).filter(|&i| others[i]).collect();
        let mut gaps: Vec<f64> = others.iter().map(|&i| gap(i)).collect();
        let broken = gaps.iter().filter(|gap| **gap < 0.0).count();
        let [broken, present] = engine.comm().all_reduce_sum([broken, candidates.len()]);
        if present + broken > DENSE_LIMIT {
            return self.pin(engine, matrix);
        }
        // All ranks agree on how small a gap counts as near. No lot is larger than the limit, so
        // that the smallest gaps of each rank suffice.
        gaps.sort_by(f64::total_cmp);
        gaps.truncate(DENSE_LIMIT);
        let mut gaps = engine.comm().all_gather(&gaps);
        gaps.sort_by(f64::total_cmp);
        let lot = broken.max(present).max(FIRST_LOT).min(gaps.len()).min(DENSE_LIMIT - present);
        let near = gaps[lot - 1];
        // `total_cmp` orders NaN too, as the sort above did, so that each round adds candidates.
        candidates.extend(others.into_iter().filter(|&i| gap(i).total_cmp(&near).is_le()));
        candidates.sort_unstable();
        *first = place(engine.comm(), candidates);
        let dofs: Vec<usize> = candidates.iter().map(|&i| bounds.dofs[i]).collect();
        match self.change_contact_dofs(engine, matrix, &dofs) {
            // The matrix itself has a factor; only the Schur complement lost its to rounding.
            Err(Error::Singular(_)) => self.pin(engine, matrix),
            changed => changed,
        }
    }

    /// Changes the contact dofs of the factor, which has the digits of the first one then.
    fn change_contact_dofs(
        &mut self,
        engine: &impl Engine,
        matrix: &LinearCombination,
        dofs: &[usize],
    ) -> Result<()> {
        if self.factor.schur_factor().is_some() {
            self.factor.release();
            self.factor = engine.factor(matrix, dofs)?;
            self.factorisations += 1;
        }
        self.error_with_digits = None;
        Ok(())
    }

    /// Pins active dofs in the sparse matrix from now on, until nothing touches any more.
    fn pin(&mut self, engine: &impl Engine, matrix: &LinearCombination) -> Result<()> {
        self.change_contact_dofs(engine, matrix, &[])?;
        self.method = Method::Pinned { pinned: vec![BoundStatus::Free; self.sides.len()] };
        Ok(())
    }

    /// Returns the number of candidates of all ranks.
    fn candidates_of_all(&mut self) -> usize {
        self.factor.schur_factor().map_or(0, |factor| factor.schur().nrows())
    }

    /// Switches to pinned dofs after an answer that lost digits. Returns whether this is a change.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn distrust(&mut self, engine: &impl Engine, matrix: &LinearCombination) -> Result<bool> {
        let dense = matches!(self.method, Method::Dense { .. }) && self.candidates_of_all() > 0;
        if dense {
            self.pin(engine, matrix)?;
            self.sides.fill(BoundStatus::Free);
        }
        Ok(dense)
    }

    /// Calls `act` with a function that solves A x = b without any bound, in place, and restores
    /// the solver for the next steps. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of `act`.
    pub fn without_bounds<R>(
        &mut self,
        bounds: &Bounds,
        act: impl FnOnce(&mut dyn FnMut(&mut [f64]) -> Result<()>) -> Result<R>,
    ) -> Result<R> {
        let Condensed { factor, method, .. } = self;
        let Method::Pinned { pinned } = method else { return act(&mut |x| factor.solve(x)) };
        factor.pin(&[])?;
        let done = act(&mut |x| factor.solve(x))?;
        factor.pin(&active_dofs(bounds, pinned))?;
        Ok(done)
    }

    fn solve_dense(&mut self, engine: &impl Engine, problem: &Problem, answer: &mut Answer) -> Result<u32> {
        let size = self.candidates_of_all();
        let Method::Dense { candidates, first } = &self.method else { return Ok(0) };
        let Problem { rhs: b, bounds, .. } = *problem;
        let Answer { x, reaction } = answer;
        clear(reaction);
        let Some(factor) = self.factor.schur_factor().filter(|_| size > 0) else {
            x.copy_from_slice(b);
            self.factor.solve(x)?;
            return Ok(0);
        };
        // Every rank solves the same dense problem, from the bounds and statuses of all ranks.
        let DenseWork { shared, sides, h, values, forces } = &mut self.work;
        shared.clear();
        shared.resize(3 * size, 0.0);
        let entries = *first..first + candidates.len();
        for (entry, &i) in entries.clone().zip(candidates) {
            let (lower, upper) = (bounds.lower[i], bounds.upper[i]);
            let code = f64::from(self.sides[i].within(lower, upper) as u8);
            [lower, upper, code]
                .into_iter()
                .enumerate()
                .for_each(|(k, value)| shared[k * size + entry] = value);
        }
        [&mut *h, values, forces].into_iter().for_each(|v| v.resize(size, 0.0));
        forces.fill(0.0);
        factor.forward_to_schur(b, h, shared)?;
        let (lower, rest) = shared.split_at_mut(size);
        let (upper, codes) = rest.split_at_mut(size);
        sides.clear();
        sides.extend(codes.iter().map(|code| BoundStatus::from_code(*code as u8)));
        // Dofs in contact in the last step mostly stay so, and the dense problem is solved from
        // there at once.
        let mut inside = [!touching(sides) && {
            values.copy_from_slice(h);
            factor.solve_schur(values);
            values.iter().zip(lower.iter().zip(upper.iter())).all(|(x, (l, u))| (l..=u).contains(&x))
        }];
        // Laws are gathered below, by all ranks or by none.
        if self.is_led || !bounds.laws.are_rigid() {
            engine.comm().broadcast(&mut inside);
        }
        let iterations = if inside[0] {
            // The unconstrained minimiser is admissible and hence the answer.
            sides.fill(BoundStatus::Free);
            0
        } else {
            let yielding =
                laws::yielding(engine, bounds, (candidates, entries.start), [&mut *lower, &mut *upper]);
            let rigid = DenseProblem { matrix: factor.schur(), rhs: h, lower, upper };
            let mut answer = Answer { x: values, reaction: forces };
            let exchanges = YieldingProblem { rigid, yielding: &yielding }.solve(sides, &mut answer);
            let exchanges = if self.is_led {
                lead(engine.comm(), [&mut *values, forces], sides, exchanges)
            } else {
                exchanges
            };
            // A step without reactions counts no iteration, even if it began with active bounds.
            if is_zero(forces) { 0 } else { 1 + exchanges }
        };
        for (entry, &i) in entries.zip(candidates) {
            (reaction[i], self.sides[i]) = (forces[entry], sides[entry]);
        }
        factor.back_substitute(values, x)?;
        Ok(iterations)
    }
}

impl<E: Engine> Solver<E> for Condensed {
    fn solve(&mut self, engine: &E, problem: &Problem, answer: &mut Answer) -> Result<u32> {
        let mut iterations = 0;
        while matches!(self.method, Method::Dense { .. }) {
            let of_dense = self.solve_dense(engine, problem, answer)?;
            // The candidates' own violations are below rounding; only the other bounds' can be
            // real. A NaN is left to the KKT check.
            let Method::Dense { candidates, .. } = &self.method else { break };
            let is_outside = f64::from(outside(problem.bounds, candidates, answer.x));
            let is_alone = engine.comm().size() == 1;
            let code = if is_alone { 0.0 } else { fingerprint(&self.work.sides, of_dense) };
            let [is_outside, most, least] = engine.comm().all_reduce_max_each([is_outside, code, -code]);
            if most != -least {
                // Rounding on unlike processors may decide which nodes touch.
                self.is_led = true;
                continue;
            }
            iterations += of_dense;
            if is_outside == 0.0 {
                return Ok(iterations);
            }
            self.grow(engine, problem.matrix, problem.bounds, answer.x)?;
        }
        iterations += self.solve_pinned(engine, problem, answer)?;
        let touches = touching(&self.sides) || answer.reaction.iter().any(|r| *r != 0.0);
        if !engine.comm().all_reduce_any(touches) {
            // Nothing touches and nothing is pinned, so the matrix itself is factored again.
            self.method = Method::Dense { candidates: Vec::new(), first: 0 };
        }
        Ok(iterations)
    }

    fn solve_without_bounds(&mut self, x: &mut Mat<f64>) -> Result<bool> {
        let is_dense = matches!(self.method, Method::Dense { .. });
        if is_dense {
            self.factor.solve_columns(x)?;
        }
        Ok(is_dense)
    }

    fn factorisations(&self) -> u64 {
        self.factorisations
    }

    fn archive(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        bounds: &Bounds,
        archive: &mut Archive,
    ) -> Result<()> {
        BoundStatus::archive(&mut self.sides, archive)?;
        let mut pins = matches!(self.method, Method::Pinned { .. });
        archive.value(&mut pins)?;
        let mut has_more_digits = self.error_with_digits.is_some();
        archive.value(&mut has_more_digits)?;
        // The statuses that are pinned, or any status but free for a candidate.
        let mut marks = vec![BoundStatus::Free; bounds.len()];
        match &self.method {
            Method::Dense { candidates, .. } => {
                candidates.iter().for_each(|&i| marks[i] = BoundStatus::Lower);
            }
            Method::Pinned { pinned } => marks.copy_from_slice(pinned),
        }
        BoundStatus::archive(&mut marks, archive)?;
        if !archive.saves() {
            let dofs = active_dofs(bounds, &marks);
            // A factor depends on its matrix and these dofs alone, not on its history.
            self.method = if pins {
                self.factor.pin(&dofs)?;
                Method::Pinned { pinned: marks }
            } else {
                self.change_contact_dofs(engine, matrix, &dofs)?;
                let candidates: Vec<usize> = active(&marks).collect();
                Method::Dense { first: place(engine.comm(), &candidates), candidates }
            };
            if has_more_digits {
                self.add_digits(engine, matrix)?;
            }
        }
        archive.value(&mut self.factorisations)
    }

    fn factor_error(&self) -> f64 {
        self.error_with_digits.unwrap_or(self.factor_error)
    }

    fn has_twice_the_digits(&self) -> bool {
        self.factor.has_twice_the_digits()
    }

    fn cost_of_digits(&self) -> Option<u32> {
        match self.method {
            Method::Dense { .. } => self.factor.cost_of_digits(),
            Method::Pinned { .. } => None,
        }
    }

    fn add_digits(&mut self, engine: &E, matrix: &LinearCombination) -> Result<()> {
        if self.factor.add_digits(matrix)? {
            self.factorisations += 1;
            self.error_with_digits = Some(estimate_factor_error(engine, matrix, self.factor.as_mut())?);
        }
        Ok(())
    }

    fn tolerance(&self) -> f64 {
        MAX_SCHUR_RESIDUAL
    }

    fn retry(
        &mut self,
        attempt: u32,
        engine: &E,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<Option<u32>> {
        if !engine.comm().all_reduce_any(answer.reaction.iter().any(|r| *r != 0.0)) {
            return Ok(None);
        }
        // Answers of pinned dofs are corrected by the same method.
        let corrects = attempt == 0 && self.corrections() > 0;
        if !(self.distrust(engine, problem.matrix)? || corrects) {
            return Ok(None);
        }
        self.solve(engine, problem, answer).map(Some)
    }
}

/// Returns the place of this rank's first candidate among all candidates. Collective.
fn place(comm: &impl Communicator, candidates: &[usize]) -> usize {
    comm.all_gather_one(candidates.len())[..comm.rank()].iter().sum()
}

/// Returns an integer below 2^53 that tells apart the statuses and exchanges of unlike answers.
fn fingerprint(sides: &[BoundStatus], exchanges: u32) -> f64 {
    (hash::extend(active_set::fingerprint(sides), exchanges.into()) >> 11) as f64
}

/// Sets an answer to the first rank's. Returns its number of exchanges. Collective.
fn lead(
    comm: &impl Communicator,
    [values, forces]: [&mut [f64]; 2],
    sides: &mut [BoundStatus],
    exchanges: u32,
) -> u32 {
    let answer = values.iter().zip(&*forces).zip(&*sides);
    let mut answer: Vec<(f64, f64, u8, u32)> =
        answer.map(|((x, r), side)| (*x, *r, *side as u8, exchanges)).collect();
    comm.broadcast(&mut answer);
    for (k, &(x, r, code, _)) in answer.iter().enumerate() {
        (values[k], forces[k], sides[k]) = (x, r, BoundStatus::from_code(code));
    }
    answer[0].3
}

/// Returns the indices of the active bounds.
fn active(sides: &[BoundStatus]) -> impl Iterator<Item = usize> {
    (0..sides.len()).filter(|&i| sides[i] != BoundStatus::Free)
}

/// Returns the dofs of the active bounds.
fn active_dofs(bounds: &Bounds, sides: &[BoundStatus]) -> Vec<usize> {
    active(sides).map(|i| bounds.dofs[i]).collect()
}

/// Returns whether any bound is active.
fn touching(sides: &[BoundStatus]) -> bool {
    active(sides).next().is_some()
}

/// Returns whether x violates a bound that is not among the candidates (ascending).
fn outside(bounds: &Bounds, candidates: &[usize], x: &[f64]) -> bool {
    let are_crossed = bounds.are_crossed(x);
    if candidates.is_empty() || !are_crossed {
        return are_crossed;
    }
    let mut candidates = candidates.iter().copied();
    let mut candidate = candidates.next();
    for (i, &dof) in bounds.dofs.iter().enumerate() {
        if candidate == Some(i) {
            candidate = candidates.next();
        } else if x[dof] < bounds.lower[i] || x[dof] > bounds.upper[i] {
            return true;
        }
    }
    false
}
