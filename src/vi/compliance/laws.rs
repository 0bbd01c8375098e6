//! Bounds that yield by laws of contact, in compliance form.
//!
//! The tangent of a law at a depth `$d_0$`, with its force f and stiffness t there, is a rigid
//! bound that lies `$d_0 - f / t$` deeper, on a compliance 1/t of its own, which joins the diagonal
//! of R:
//!
//! ```math
//! d = d_0 - f / t + r / t .
//! ```
//!
//! Each iteration of [Newton's method](crate::vi::laws) solves the problem with these bounds and
//! the rigid ones exactly. The start is the depth of each bound alone, so that few iterations
//! follow whatever the stiffness.

use super::{ComplianceProblem, ComplianceSolver};
use crate::contact_law::{ContactLaw, Laws, Tangent};
use crate::linalg::vectors::{axpy, largest};
use crate::vi::laws::{self, Linearised, ROUNDING, YieldingBound};
use faer::Mat;

/// Largest number of iterations for the depth of a bound alone, which converges at order 2 from
/// above.
const MAX_ROOT_ITERATIONS: u32 = 60;

impl ComplianceSolver {
    /// Prepares for bounds of which some yield.
    pub(crate) fn prepare_softness(&mut self) {
        self.softness.resize(self.sides.len(), [0.0; 2]);
    }

    /// Returns whether some bounds yield.
    pub(crate) fn yields(&self) -> bool {
        !self.softness.is_empty()
    }

    /// Solves a problem of which some bounds yield.
    pub(super) fn solve_yielding(
        &mut self,
        problem: ComplianceProblem,
        laws: &Laws,
        x: &mut [f64],
        reaction: &mut [f64],
    ) {
        let ComplianceProblem { compliance, free, lower, upper, .. } = problem;
        self.prepare_softness();
        if problem.softness.is_empty() {
            self.softness.fill([0.0; 2]);
        }
        let bound = |entry: usize| YieldingBound {
            entry,
            limits: [lower[entry], upper[entry]],
            laws: laws.numbered(laws.numbers(entry)),
        };
        let yielding: Vec<YieldingBound> =
            (0..free.len()).filter(|&entry| laws.has(entry)).map(bound).collect();
        x.copy_from_slice(free);
        reaction.fill(0.0);
        yielding.iter().for_each(|bound| x[bound.entry] = alone(bound, free[bound.entry], compliance));
        let (free, limits) = (free.to_vec(), [lower.to_vec(), upper.to_vec()]);
        let mut linearised =
            LinearisedCompliance { solver: self, problem, yielding: &yielding, free, limits, solves: 0 };
        self.iterations = laws::solve(&mut linearised, &yielding, x, reaction);
        let magnitude = largest(reaction.iter().copied());
        for bound in &yielding {
            let (x, r) = (&mut x[bound.entry], reaction[bound.entry]);
            let side = usize::from(r < 0.0);
            let length = x.abs() + bound.limits[side].abs();
            if length.is_finite() {
                self.residual = self.residual.max(length * bound.error(*x, r, magnitude));
            }
            let Some(law) = &bound.laws[side] else { continue };
            let depth = law.depth(r.abs());
            let held = if side == 0 { bound.limits[0] - depth } else { bound.limits[1] + depth };
            // A reaction that is small beside others tells less of the depth than the deflection.
            if r != 0.0 && (*x - held).abs() <= ROUNDING * length {
                *x = held;
            }
        }
    }
}

/// Problem in compliance form whose free deflections and bounds contain the tangents.
struct LinearisedCompliance<'a> {
    solver: &'a mut ComplianceSolver,
    problem: ComplianceProblem<'a>,
    yielding: &'a [YieldingBound],
    free: Vec<f64>,
    limits: [Vec<f64>; 2],
    solves: u32,
}

impl Linearised for LinearisedCompliance<'_> {
    fn solve(&mut self, tangents: &[[Tangent; 2]], x: &mut [f64], reaction: &mut [f64]) -> u32 {
        let ComplianceProblem { compliance, free, .. } = self.problem;
        self.free.copy_from_slice(free);
        self.solves += 1;
        let mut constant = Vec::new();
        for (bound, tangents) in self.yielding.iter().zip(tangents) {
            let i = bound.entry;
            for (side, away) in
                [(0, -1.0), (1, 1.0)].into_iter().filter(|(side, _)| bound.laws[*side].is_some())
            {
                let (limit, Tangent { force, stiffness }) = (bound.limits[side], tangents[side]);
                let depth = away * (x[i] - limit);
                let [place, softness] = match stiffness {
                    t if t.is_infinite() => [limit, 0.0],
                    t if t > 0.0 => [limit + away * (depth - force / t), 1.0 / t],
                    _ => [away * f64::INFINITY, 0.0],
                };
                (self.limits[side][i], self.solver.softness[i][side]) = (place, softness);
                if stiffness == 0.0 && force > 0.0 {
                    constant.push((i, -away * force));
                }
            }
            // A law holds x from both sides.
            if let Some(side) = (0..2).find(|&side| tangents[side].stiffness.is_infinite()) {
                self.limits.iter_mut().for_each(|limits| limits[i] = bound.limits[side]);
            }
        }
        for (i, force) in &constant {
            axpy(*force, compliance.col_as_slice(*i), &mut self.free);
        }
        let [lower, upper] = &self.limits;
        self.solver.solve_rigid(
            ComplianceProblem { free: &self.free, lower, upper, ..self.problem },
            x,
            reaction,
        );
        constant.iter().for_each(|(i, force)| reaction[*i] += force);
        self.solver.iterations
    }

    fn law_error(&mut self, x: &[f64], reaction: &mut [f64]) -> f64 {
        let magnitude = largest(reaction.iter().copied());
        let error = |bound: &YieldingBound| bound.error(x[bound.entry], reaction[bound.entry], magnitude);
        largest(self.yielding.iter().map(error))
    }

    /// The reactions are linear along the way, since `$x = y + R r$`; but at the start.
    fn slopes(&self, from: [&[f64]; 2], to: [&[f64]; 2]) -> [f64; 2] {
        if self.solves < 2 {
            return [f64::INFINITY, 0.0];
        }
        let (mut first, mut second) = (0.0, 0.0);
        for i in 0..to[0].len() {
            let [dx, dr] = [0, 1].map(|k| to[k][i] - from[k][i]);
            first += dx * from[1][i];
            second += dx * dr;
        }
        [first, second]
    }
}

/// Returns the deflection of a bounded dof, in m, on which no other reactions act, given the one
/// without reactions.
fn alone(bound: &YieldingBound, free: f64, compliance: &Mat<f64>) -> f64 {
    let softness = compliance[(bound.entry, bound.entry)].max(0.0);
    for (side, away) in [(0, -1.0), (1, 1.0)] {
        let depth = away * (free - bound.limits[side]);
        if let Some(law) = &bound.laws[side]
            && depth > 0.0
        {
            return bound.limits[side] + away * depth_under(law, depth, softness);
        }
    }
    free
}

/// Returns the root d of d + c f(d) = depth, with a law f and a compliance c in m/N.
fn depth_under(law: &impl ContactLaw, depth: f64, c: f64) -> f64 {
    let mut d = depth.min(law.depth(depth / c));
    for _ in 0..MAX_ROOT_ITERATIONS {
        let Tangent { force, stiffness } = law.linearised(d, law.force(d));
        let next = d - (d + c * force - depth) / (1.0 + c * stiffness);
        if next.is_nan() || next >= d || next < 0.0 {
            break;
        }
        d = next;
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contact_law::Hertz;

    #[test]
    fn the_depth_of_a_bound_alone_solves_its_equation() {
        for depth in [1e-12, 1e-3, 1.0, 1e9] {
            for a in [0.0, 1e-9, 1.0, 1e6, 1e20] {
                let d = depth_under(&Hertz(1.0), depth, a);
                assert!((d + a * d * d.sqrt() - depth).abs() <= 1e-14 * depth, "{depth:e}, {a:e}: {d:e}");
            }
        }
    }
}
