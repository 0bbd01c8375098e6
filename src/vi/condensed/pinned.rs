//! Steps with the active dofs pinned in the sparse matrix, and bounds that yield beside them.

use super::{Condensed, Method, active_dofs, touching};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::hash;
use crate::linalg::vectors::{add, axpy, waxpy};
use crate::linalg::{BoundedDofs, Engine, Factor, multiply_sum};
use crate::obstacle::Bounds;
use crate::vi::active_set::{self, BoundStatus, BoundValues, Exchange, Move};
use crate::vi::laws::{YieldingBound, YieldingProblem};
use crate::vi::{Answer, DenseProblem, Problem};
use faer::linalg::solvers::DenseSolveCore;
use faer::{Mat, Side as Triangle};

/// Number of violated conditions above which the active set is first sought on coarse meshes. Fewer
/// take at most some five exchanges more without, which cost as much.
const FEW: usize = 64;

impl Condensed {
    /// Solves a step with the active dofs pinned in the sparse matrix.
    pub(super) fn solve_pinned(
        &mut self,
        engine: &impl Engine,
        problem: &Problem,
        answer: &mut Answer,
    ) -> Result<u32> {
        let Method::Pinned { .. } = &self.method else { return Ok(0) };
        let bounds = problem.bounds;
        for (i, side) in self.sides.iter_mut().enumerate() {
            *side = side.within(bounds.lower[i], bounds.upper[i]);
        }
        let rigid: Vec<[f64; 2]> = (0..bounds.len()).map(|i| bounds.rigid(i)).collect();
        let [lower, upper] = [0, 1].map(|side| rigid.iter().map(|limits| limits[side]).collect::<Vec<_>>());
        let mut yields = 0;
        let mut exchange = Exchange::new(engine.comm().all_reduce_sum(bounds.len()));
        // A few digits suffice to find most of the active dofs. Once these stay, or come back, the
        // answers have all digits.
        let mut is_rough = self.factor.cascade().is_some();
        answer.x.fill(0.0);
        loop {
            self.pin_active(engine, bounds)?;
            yields += self.solve_with_pinned(engine, problem, is_rough, answer.x)?;
            let broken = self.broken(engine, problem, [&lower, &upper], answer)?;
            // Gather each rank's number of violated conditions and its fingerprint: from these
            // follow the rank that moves the last index, and the fingerprint of all active sets
            // together.
            let print = active_set::fingerprint(&self.sides);
            let ranks = engine.comm().all_gather_one((broken.len(), print));
            let last = ranks.iter().rposition(|(count, _)| *count > 0);
            let print = ranks.iter().fold(0, |print, (_, next)| hash::extend(print, *next));
            let count: usize = ranks.iter().map(|(count, _)| count).sum();
            let next = exchange.next(count, || print);
            if is_rough && next != Some(Move::All) {
                is_rough = false;
                exchange.forget();
                continue;
            }
            if is_rough
                && exchange.iterations == 1
                && count > FEW
                && self.find_contact(problem, [&lower, &upper], answer.x)?
            {
                exchange.forget();
                continue;
            }
            match next {
                None => break,
                Some(Move::All) => active_set::exchange(&mut self.sides, &broken),
                Some(Move::Last) if last == Some(engine.comm().rank()) => {
                    active_set::exchange(&mut self.sides, &broken[broken.len() - 1..]);
                }
                Some(Move::Last) => {}
            }
        }
        Ok(exchange.iterations + yields + u32::from(engine.comm().all_reduce_any(touching(&self.sides))))
    }

    /// Pins the active dofs where they have changed on any rank. Collective.
    fn pin_active(&mut self, engine: &impl Engine, bounds: &Bounds) -> Result<()> {
        let Method::Pinned { pinned } = &mut self.method else { return Ok(()) };
        if engine.comm().all_reduce_any(*pinned != self.sides) {
            self.factor.pin(&active_dofs(bounds, &self.sides))?;
            self.factorisations += 1;
            pinned.copy_from_slice(&self.sides);
        }
        Ok(())
    }

    /// Solves with the active dofs held at their bounds. An iteration improves x; a factor finds it
    /// from the bounds alone. Returns the number of iterations of bounds that yield. Collective.
    fn solve_with_pinned(
        &mut self,
        engine: &impl Engine,
        problem: &Problem,
        is_rough: bool,
        x: &mut [f64],
    ) -> Result<u32> {
        let Problem { matrix, rhs: b, bounds, .. } = *problem;
        let improves = self.factor.cascade().is_some();
        let [mut product, mut residual, mut increment] = [(); 3].map(|()| vec![0.0; b.len()]);
        let mut subtract_product = |x: &[f64], increment: &mut [f64]| {
            multiply_sum(engine, matrix, x, &mut product, &mut residual)?;
            waxpy(-1.0, &residual, b, increment);
            Ok::<_, Error>(if improves { engine.dot(x, &residual)?.max(0.0).sqrt() } else { 0.0 })
        };
        let value = |i: usize, side: BoundStatus| side.value(bounds.lower[i], bounds.upper[i]);
        let held = self.sides.iter().enumerate();
        let held = held.filter_map(|(i, side)| Some((bounds.dofs[i], value(i, *side)?)));
        let held: Vec<(usize, f64)> = held.collect();
        if !improves {
            x.fill(0.0);
        }
        held.iter().for_each(|(dof, value)| x[*dof] = *value);
        let norm = subtract_product(x, &mut increment)?;
        held.iter().for_each(|(dof, value)| increment[*dof] = if improves { 0.0 } else { *value });
        match self.factor.cascade() {
            Some(factor) if is_rough => factor.solve_roughly(&mut increment)?,
            Some(factor) => factor.solve_correction(norm, &mut increment)?,
            None => self.factor.solve(&mut increment)?,
        }
        if improves {
            add(&increment, x);
        } else {
            x.copy_from_slice(&increment);
        }
        if bounds.laws.are_rigid() {
            return Ok(0);
        }
        let (iterations, loads) = add_yielding(engine, self.factor.as_mut(), bounds, x)?;
        if engine.comm().all_reduce_any(loads.iter().any(|(_, force)| *force != 0.0)) {
            // The sum of the displacements without these forces and by them has lost the digits in
            // which both cancel.
            subtract_product(x, &mut increment)?;
            loads.iter().for_each(|(dof, force)| increment[*dof] += force);
            held.iter().for_each(|(dof, _)| increment[*dof] = 0.0);
            self.factor.solve(&mut increment)?;
            add(&increment, x);
        }
        Ok(iterations)
    }

    /// Computes the reactions, and returns the bounds that violate a condition. Collective.
    fn broken(
        &self,
        engine: &impl Engine,
        problem: &Problem,
        [lower, upper]: [&[f64]; 2],
        answer: &mut Answer,
    ) -> Result<Vec<(usize, BoundStatus)>> {
        let Problem { matrix, rhs: b, bounds, .. } = *problem;
        let [mut product, mut magnitude] = [(); 2].map(|()| vec![0.0; b.len()]);
        engine.multiply_with_magnitude(matrix, answer.x, [&mut product, &mut magnitude])?;
        active_set::set_reactions(&self.sides, problem, &product, answer);
        let Answer { x, reaction } = answer;
        let x: Vec<f64> = bounds.dofs.iter().map(|&dof| x[dof]).collect();
        let magnitude: Vec<f64> = bounds.dofs.iter().map(|&dof| magnitude[dof] + b[dof].abs()).collect();
        let values = BoundValues { lower, upper, x: &x, reaction, magnitude: &magnitude };
        Ok(active_set::broken(&self.sides, values))
    }

    /// Seeks the active set on coarse meshes. Returns whether they have one. Collective.
    fn find_contact(&mut self, problem: &Problem, limits: [&[f64]; 2], x: &mut [f64]) -> Result<bool> {
        let Some(factor) = self.factor.cascade() else { return Ok(false) };
        let bounded = BoundedDofs { dofs: &problem.bounds.dofs, limits };
        let mut signs: Vec<i8> = self.sides.iter().map(|side| side.sign()).collect();
        let has_answer = factor.find_contact(problem.rhs, &bounded, x, &mut signs)?;
        if has_answer {
            self.sides = signs.into_iter().map(|sign| BoundStatus::of_sign(sign.into())).collect();
        }
        Ok(has_answer)
    }
}

/// Displacement that a unit force on a bound that yields causes.
struct UnitResponse {
    /// Place of the bound among those that yield.
    place: usize,
    /// Displacement of this rank's dofs, and of all bounds that yield, in m/N.
    dofs: Vec<f64>,
    bounds: Vec<f64>,
}

/// Adds the displacement by the forces of bounds that yield to x, the answer without them. Returns
/// the number of iterations, and the dofs and forces (N) of this rank. Collective.
///
/// With the displacements that unit forces on the loaded bounds cause, these forces solve a dense
/// problem whose matrix is the inverse of that compliance.
fn add_yielding(
    engine: &impl Engine,
    factor: &mut dyn Factor,
    bounds: &Bounds,
    x: &mut [f64],
) -> Result<(u32, Vec<(usize, f64)>)> {
    let comm = engine.comm();
    let indices: Vec<usize> = (0..bounds.len()).filter(|&i| bounds.laws.has(i)).collect();
    let numbers =
        |&i: &usize| (x[bounds.dofs[i]], [bounds.lower[i], bounds.upper[i]], bounds.laws.numbers(i));
    let (yielding, first) = comm.all_gather_with_offset(&indices.iter().map(numbers).collect::<Vec<_>>());
    let index = |place: usize| place.checked_sub(first).and_then(|k| indices.get(k)).copied();
    let bound = |place: usize, entry: usize| {
        let (_, limits, numbers) = yielding[place];
        YieldingBound { entry, limits, laws: bounds.laws.numbered(numbers) }
    };
    let free: Vec<f64> = yielding.iter().map(|(free, ..)| *free).collect();
    let (mut values, mut responses, mut forces) = (free.clone(), Vec::<UnitResponse>::new(), Vec::new());
    let mut iterations = 0;
    loop {
        let is_new = |place: &usize| {
            let is_loaded = responses.iter().any(|response| response.place == *place);
            !is_loaded && bound(*place, 0).reaction(values[*place]) != 0.0
        };
        let places: Vec<usize> = (0..yielding.len()).filter(is_new).collect();
        if places.is_empty() {
            break;
        }
        for place in places {
            let mut dofs = vec![0.0; x.len()];
            index(place).into_iter().for_each(|i| dofs[bounds.dofs[i]] = 1.0);
            factor.solve(&mut dofs)?;
            let values: Vec<f64> = indices.iter().map(|&i| dofs[bounds.dofs[i]]).collect();
            responses.push(UnitResponse { place, dofs, bounds: comm.all_gather(&values) });
        }
        let size = responses.len();
        let entry = |i: usize, j: usize| responses[j].bounds[responses[i].place];
        let compliance = Mat::from_fn(size, size, |i, j| 0.5 * (entry(i, j) + entry(j, i)));
        let stiffness = match compliance.llt(Triangle::Lower) {
            Ok(llt) => llt.inverse(),
            // A NaN is left to the KKT check.
            Err(_) => Mat::from_fn(size, size, |_, _| f64::NAN),
        };
        let force = |i: usize| (0..size).map(|j| stiffness[(i, j)] * free[responses[j].place]).sum();
        let rhs: Vec<f64> = (0..size).map(force).collect();
        let loaded: Vec<YieldingBound> =
            responses.iter().enumerate().map(|(entry, response)| bound(response.place, entry)).collect();
        let limits = [f64::NEG_INFINITY, f64::INFINITY].map(|limit| vec![limit; size]);
        let rigid = DenseProblem { matrix: &stiffness, rhs: &rhs, lower: &limits[0], upper: &limits[1] };
        let problem = YieldingProblem { rigid, yielding: &loaded };
        let mut sides = vec![BoundStatus::Free; size];
        forces = vec![0.0; size];
        let mut depths = vec![0.0; size];
        iterations += problem.solve(&mut sides, &mut Answer { x: &mut depths, reaction: &mut forces });
        // Rounding may decide which bounds are loaded, so the first rank decides for all.
        comm.broadcast(&mut forces);
        values.clone_from(&free);
        responses
            .iter()
            .zip(&forces)
            .for_each(|(response, force)| axpy(*force, &response.bounds, &mut values));
    }
    responses.iter().zip(&forces).for_each(|(response, force)| axpy(*force, &response.dofs, x));
    let load = |(response, force): (&UnitResponse, &f64)| Some((bounds.dofs[index(response.place)?], *force));
    Ok((iterations, responses.iter().zip(&forces).filter_map(load).collect()))
}
