//! Bounds that yield by the law of Hertz, in compliance form.
//!
//! The reaction of such a bound is `$k d^{3/2}$` at the depth d beyond it. Newton's method replaces
//! the law by its tangent at a depth `$d_0$`, with the stiffness `$t = \tfrac32 k \sqrt{d_0}$`: a
//! rigid bound that lies `$d_0 / 3$` deeper, on a compliance 1/t of its own, which joins the
//! diagonal of R,
//!
//! ```math
//! d = \tfrac13 d_0 + r / t .
//! ```
//!
//! Each iteration solves the problem with these bounds and the rigid ones exactly. As in the dense
//! problem of [`condensed`](crate::vi::condensed) it converges from any start, since the least
//! energy on the way is taken where the energy rises at its end. The start is the depth of each
//! bound alone, so that few iterations follow whatever the stiffness.

use super::{ComplianceProblem, ComplianceSolver};
use crate::obstacle::{hertz_depth, hertz_tangent};
use crate::vi::hertz::{Convergence, HertzBound, MAX_ITERATIONS, ROUNDING, least_on_way};
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
    pub(super) fn solve_yielding(&mut self, problem: ComplianceProblem, x: &mut [f64], reaction: &mut [f64]) {
        let ComplianceProblem { compliance, free, lower, upper, hertz } = problem;
        self.prepare_softness();
        self.softness.fill([0.0; 2]);
        let bound = |(entry, stiffness): (usize, &[f64; 2])| HertzBound {
            entry,
            limits: [lower[entry], upper[entry]],
            stiffness: *stiffness,
        };
        let yielding: Vec<HertzBound> =
            hertz.iter().enumerate().filter(|(_, k)| k.iter().any(|k| k.is_finite())).map(bound).collect();
        let mut at = free.to_vec();
        yielding.iter().for_each(|of| at[of.entry] = alone(of, free[of.entry], compliance));
        let mut limits = [lower.to_vec(), upper.to_vec()];
        let (mut convergence, mut iterations) = (Convergence::default(), 0);
        let mut from: Option<[Vec<f64>; 2]> = None;
        for _ in 0..MAX_ITERATIONS {
            for of in &yielding {
                self.take_tangent(of, at[of.entry], &mut limits);
            }
            let [lower, upper] = limits.each_ref().map(|of| &**of);
            self.solve_rigid(ComplianceProblem { lower, upper, ..problem }, x, reaction);
            iterations += 1 + self.iterations;
            if convergence.ends(law_error(&yielding, x, reaction)) {
                break;
            }
            if let Some([from_x, from_r]) = &from {
                shorten(&yielding, [from_x, from_r], [x, reaction]);
            }
            at.copy_from_slice(x);
            from = Some([x.to_vec(), reaction.to_vec()]);
        }
        self.iterations = iterations;
        let magnitude = largest(reaction);
        for of in &yielding {
            let (x, r) = (&mut x[of.entry], reaction[of.entry]);
            let side = usize::from(r < 0.0);
            let length = x.abs() + of.limits[side].abs();
            if length.is_finite() {
                self.residual = self.residual.max(length * of.error(*x, r, magnitude));
            }
            let depth = hertz_depth(of.stiffness[side], r.abs());
            let held = if side == 0 { of.limits[0] - depth } else { of.limits[1] + depth };
            // A reaction that is small beside others tells less of the depth than the deflection.
            if r != 0.0 && of.stiffness[side].is_finite() && (*x - held).abs() <= ROUNDING * length {
                *x = held;
            }
        }
    }

    /// Replaces the law of each side of a bound by its tangent at a deflection, in m.
    fn take_tangent(&mut self, of: &HertzBound, at: f64, limits: &mut [Vec<f64>; 2]) {
        for (side, away) in [(0, -1.0), (1, 1.0)] {
            let (k, limit) = (of.stiffness[side], of.limits[side]);
            if k.is_infinite() {
                continue;
            }
            let depth = away * (at - limit);
            // A tangent of 0 has no reaction.
            let tangent = hertz_tangent(k, depth);
            let [place, softness] = match tangent > 0.0 {
                true => [limit + away * depth / 3.0, 1.0 / tangent],
                false => [away * f64::INFINITY, 0.0],
            };
            limits[side][of.entry] = place;
            self.softness[of.entry][side] = softness;
        }
    }
}

/// Returns the deflection of a bounded dof, in m, on which no other reactions act, given the one
/// without reactions.
fn alone(of: &HertzBound, free: f64, compliance: &Mat<f64>) -> f64 {
    let own = compliance[(of.entry, of.entry)].max(0.0);
    for (side, away) in [(0, -1.0), (1, 1.0)] {
        let (k, depth) = (of.stiffness[side], away * (free - of.limits[side]));
        if k.is_finite() && depth > 0.0 {
            return of.limits[side] + away * depth_of(depth, own * k);
        }
    }
    free
}

/// Returns the root d of d + a d^{3/2} = depth, with a in m^{-1/2}.
fn depth_of(depth: f64, a: f64) -> f64 {
    // In s, the root of d, the left-hand side is convex.
    let mut s = depth.sqrt().min((depth / a).cbrt());
    for _ in 0..MAX_ROOT_ITERATIONS {
        let next = s - (s * (1.0 + a * s) - depth / s) / (2.0 + 3.0 * a * s);
        if next >= s {
            break;
        }
        s = next;
    }
    s * s
}

/// Returns the largest magnitude of reactions, in N.
fn largest(reaction: &[f64]) -> f64 {
    reaction.iter().fold(0.0, |most, r| r.abs().max(most))
}

/// Returns the largest error of reactions as values of the law at the deflections.
fn law_error(yielding: &[HertzBound], x: &[f64], reaction: &[f64]) -> f64 {
    let magnitude = largest(reaction);
    let of = yielding.iter().map(|of| of.error(x[of.entry], reaction[of.entry], magnitude));
    of.fold(0.0, |worst, of| if of <= worst { worst } else { of })
}

/// Moves x and the reactions back towards those of the iteration before, to the least energy on the
/// way, where the energy rises too much at its end. The reactions are linear along the way, since
/// `$x = y + R r$`.
fn shorten(yielding: &[HertzBound], [from_x, from_r]: [&[f64]; 2], [x, r]: [&mut [f64]; 2]) {
    let ways: Vec<[f64; 2]> = (0..x.len()).map(|i| [x[i] - from_x[i], r[i] - from_r[i]]).collect();
    let (mut first, mut second) = (0.0, 0.0);
    for ([dx, dr], from) in ways.iter().zip(from_r) {
        first += dx * from;
        second += dx * dr;
    }
    let slope = |part: f64| {
        let of_bounds = yielding.iter().map(|of| {
            let (dx, from) = (ways[of.entry][0], from_x[of.entry]);
            dx * of.reaction(from + part * dx)
        });
        first + part * second - of_bounds.sum::<f64>()
    };
    if let Some(part) = least_on_way(slope) {
        for (i, [dx, dr]) in ways.iter().enumerate() {
            (x[i], r[i]) = (from_x[i] + part * dx, from_r[i] + part * dr);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_depth_of_a_bound_alone_solves_its_equation() {
        for depth in [1e-12, 1e-3, 1.0, 1e9] {
            for a in [0.0, 1e-9, 1.0, 1e6, 1e20] {
                let d = depth_of(depth, a);
                assert!((d + a * d * d.sqrt() - depth).abs() <= 1e-14 * depth, "{depth:e}, {a:e}: {d:e}");
            }
        }
    }
}
