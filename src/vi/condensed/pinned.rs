//! Steps with the active dofs pinned in the sparse matrix, and bounds that yield beside them.

use super::{Condensed, Method, touching};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::hash;
use crate::linalg::vectors::{add, axpy, waxpy};
use crate::linalg::{BoundedDofs, Engine, Factor};
use crate::obstacle::Bounds;
use crate::vi::active_set::{self, BoundStatus, BoundValues, Exchange, Move};
use crate::vi::laws::{YieldingBound, YieldingProblem};
use crate::vi::{Answer, DenseProblem, Problem, apply};
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
        let Method::Pinned { pinned } = &mut self.method else { return Ok(0) };
        let Problem { matrix, rhs: b, bounds, .. } = *problem;
        let Answer { x, reaction } = answer;
        for (i, side) in self.sides.iter_mut().enumerate() {
            *side = side.within(bounds.lower[i], bounds.upper[i]);
        }
        let rigid: Vec<[f64; 2]> = (0..bounds.len()).map(|i| bounds.rigid(i)).collect();
        let [lower, upper] = [0, 1].map(|side| rigid.iter().map(|limits| limits[side]).collect::<Vec<_>>());
        let mut yields = 0;
        let mut exchange = Exchange::new(engine.comm().all_reduce_sum(bounds.len()));
        let mut product = vec![0.0; b.len()];
        let mut residual = vec![0.0; b.len()];
        let mut magnitude = vec![0.0; b.len()];
        let mut at_bounds = vec![0.0; bounds.len()];
        let mut scales = vec![0.0; bounds.len()];
        // A few digits suffice to find most of the active dofs. Once these stay, or come back, the
        // answers have all digits.
        let improves = self.factor.cascade().is_some();
        let mut is_rough = improves;
        let mut increment = vec![0.0; b.len()];
        x.fill(0.0);
        loop {
            if engine.comm().all_reduce_any(*pinned != self.sides) {
                let held = |i: &usize| self.sides[*i] != BoundStatus::Free;
                let dofs: Vec<usize> = (0..bounds.len()).filter(held).map(|i| bounds.dofs[i]).collect();
                self.factor.pin(&dofs)?;
                self.factorisations += 1;
                pinned.copy_from_slice(&self.sides);
            }
            let fixed = |i: usize| match self.sides[i] {
                BoundStatus::Free => None,
                BoundStatus::Lower => Some(bounds.lower[i]),
                BoundStatus::Upper => Some(bounds.upper[i]),
            };
            // An iteration improves the answer so far; a factor finds it from the bounds alone.
            if !improves {
                x.fill(0.0);
            }
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                x[dof] = fixed(i).unwrap_or(x[dof]);
            }
            apply(engine, matrix, x, &mut product, &mut residual)?;
            let norm = if improves { engine.dot(x, &residual)?.max(0.0).sqrt() } else { 0.0 };
            waxpy(-1.0, &residual, b, &mut increment);
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                if let Some(value) = fixed(i) {
                    increment[dof] = if improves { 0.0 } else { value };
                }
            }
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
            if !bounds.laws.are_rigid() {
                let (iterations, loads) = add_yielding(engine, self.factor.as_mut(), bounds, x)?;
                yields += iterations;
                if engine.comm().all_reduce_any(loads.iter().any(|(_, force)| *force != 0.0)) {
                    // The sum of the displacements without these forces and by them has lost the
                    // digits in which both cancel.
                    apply(engine, matrix, x, &mut product, &mut residual)?;
                    waxpy(-1.0, &residual, b, &mut increment);
                    loads.iter().for_each(|(dof, force)| increment[*dof] += force);
                    let held = (0..bounds.len()).filter(|&i| fixed(i).is_some());
                    held.for_each(|i| increment[bounds.dofs[i]] = 0.0);
                    self.factor.solve(&mut increment)?;
                    add(&increment, x);
                }
            }
            engine.multiply_with_magnitude(matrix, x, [&mut residual, &mut magnitude])?;
            for (i, &dof) in bounds.dofs.iter().enumerate() {
                at_bounds[i] = x[dof];
                let force = residual[dof] - b[dof];
                let law = bounds.reaction(i, x[dof]);
                reaction[i] = match self.sides[i] {
                    BoundStatus::Free if law * force > 0.0 => force,
                    BoundStatus::Free => 0.0,
                    _ => force,
                };
                scales[i] = magnitude[dof] + b[dof].abs();
            }
            let values =
                BoundValues { lower: &lower, upper: &upper, x: &at_bounds, reaction, magnitude: &scales };
            let broken = active_set::broken(&self.sides, values);
            // Gather each rank's number of violated conditions and its fingerprint: from these
            // follow the rank that moves the last index, and the fingerprint of all active sets
            // together.
            let print = active_set::fingerprint(&self.sides);
            let all = engine.comm().all_gather_one((broken.len(), print));
            let last = all.iter().rposition(|(count, _)| *count > 0);
            let print = all.iter().fold(0, |print, (_, own)| hash::extend(print, *own));
            let count: usize = all.iter().map(|(count, _)| count).sum();
            let next = exchange.next(count, || print);
            if is_rough && next != Some(Move::All) {
                is_rough = false;
                exchange.forget();
                continue;
            }
            if is_rough && exchange.iterations == 1 && count > FEW {
                let bounded = BoundedDofs { dofs: &bounds.dofs, limits: [&lower, &upper] };
                let mut signs: Vec<i8> = self.sides.iter().map(|side| side.sign()).collect();
                if let Some(factor) = self.factor.cascade()
                    && factor.find_contact(b, &bounded, x, &mut signs)?
                {
                    self.sides = signs.into_iter().map(BoundStatus::of_sign).collect();
                    exchange.forget();
                    continue;
                }
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
}

/// Displacement that a unit force on a bound that yields causes.
struct UnitResponse {
    /// Place of the bound among those that yield.
    place: usize,
    /// Displacement of this rank's dofs, and of all bounds that yield, in m/N.
    of_dofs: Vec<f64>,
    of_bounds: Vec<f64>,
}

/// Adds to x, the answer without bounds that yield, the displacement by their forces. Returns the
/// number of iterations, and the dofs and forces (N) of this rank. Collective.
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
    let own: Vec<usize> = (0..bounds.len()).filter(|&i| bounds.laws.has(i)).collect();
    let numbers =
        |&i: &usize| (x[bounds.dofs[i]], [bounds.lower[i], bounds.upper[i]], bounds.laws.numbers(i));
    let (all, first) = comm.all_gather_with_offset(&own.iter().map(numbers).collect::<Vec<_>>());
    let bound = |place: usize, entry: usize| {
        let (_, limits, numbers) = all[place];
        YieldingBound { entry, limits, laws: bounds.laws.numbered(numbers) }
    };
    let free: Vec<f64> = all.iter().map(|(free, ..)| *free).collect();
    let (mut values, mut responses, mut forces) = (free.clone(), Vec::<UnitResponse>::new(), Vec::new());
    let mut iterations = 0;
    loop {
        let is_new = |place: &usize| {
            let is_known = responses.iter().any(|of| of.place == *place);
            !is_known && bound(*place, 0).reaction(values[*place]) != 0.0
        };
        let places: Vec<usize> = (0..all.len()).filter(is_new).collect();
        if places.is_empty() {
            break;
        }
        for place in places {
            let mut of_dofs = vec![0.0; x.len()];
            if let Some(&i) = place.checked_sub(first).and_then(|k| own.get(k)) {
                of_dofs[bounds.dofs[i]] = 1.0;
            }
            factor.solve(&mut of_dofs)?;
            let at = own.iter().map(|&i| of_dofs[bounds.dofs[i]]);
            let of_bounds = comm.all_gather(&at.collect::<Vec<_>>());
            responses.push(UnitResponse { place, of_dofs, of_bounds });
        }
        let size = responses.len();
        let of = |i: usize, j: usize| responses[j].of_bounds[responses[i].place];
        let compliance = Mat::from_fn(size, size, |i, j| 0.5 * (of(i, j) + of(j, i)));
        let stiffness = match compliance.llt(Triangle::Lower) {
            Ok(llt) => llt.inverse(),
            // A NaN is left to the KKT check.
            Err(_) => Mat::from_fn(size, size, |_, _| f64::NAN),
        };
        let of_row = |i: usize| (0..size).map(|j| stiffness[(i, j)] * free[responses[j].place]).sum();
        let rhs: Vec<f64> = (0..size).map(of_row).collect();
        let yielding: Vec<YieldingBound> =
            responses.iter().enumerate().map(|(entry, of)| bound(of.place, entry)).collect();
        let limits = [f64::NEG_INFINITY, f64::INFINITY].map(|limit| vec![limit; size]);
        let rigid = DenseProblem { matrix: &stiffness, rhs: &rhs, lower: &limits[0], upper: &limits[1] };
        let problem = YieldingProblem { rigid, yielding: &yielding };
        let mut sides = vec![BoundStatus::Free; size];
        forces = vec![0.0; size];
        let mut at = vec![0.0; size];
        iterations += problem.solve(&mut sides, &mut Answer { x: &mut at, reaction: &mut forces });
        // Rounding may decide which bounds are loaded, so the first rank decides for all.
        comm.broadcast(&mut forces);
        values.clone_from(&free);
        responses.iter().zip(&forces).for_each(|(of, force)| axpy(*force, &of.of_bounds, &mut values));
    }
    responses.iter().zip(&forces).for_each(|(of, force)| axpy(*force, &of.of_dofs, x));
    let loads = responses.iter().zip(&forces).filter_map(|(of, force)| {
        let own = of.place.checked_sub(first).and_then(|k| own.get(k));
        own.map(|&i| (bounds.dofs[i], *force))
    });
    Ok((iterations, loads.collect()))
}
