//! Dense problem with bounds that yield by the law of Hertz.
//!
//! The problem is strictly convex: a quadratic energy, the energies stored in the bounds that
//! yield, and rigid bounds. Newton's method replaces the law of each by its tangent and solves the
//! resulting problem with rigid bounds exactly. It converges from any start: each answer lies in a
//! direction of descent, and where the energy rises at the end of the way, the least energy on the
//! way is taken. From too large a depth d a lone contact approaches its answer by thirds of d, then
//! at order 1.5 or higher. Where the law is so stiff that the rounding of x moves its reaction, the
//! reactions follow from the equilibrium of their rows, as those of rigid bounds do.

use super::{Answer, BoundStatus, DenseProblem};
use crate::communicator::Communicator;
use crate::linalg::Engine;
use crate::obstacle::{Bounds, hertz_depth, hertz_force, hertz_tangent};

/// Largest number of Newton iterations: a start 1e30 times too deep takes about 60.
pub(super) const MAX_ITERATIONS: u32 = 200;

/// Number of iterations in succession that may fail to halve the error.
const MAX_IDLE_ITERATIONS: u32 = 30;

/// Error of a reaction relative to its row, or of a depth relative to its bound, that counts as
/// rounding.
pub(super) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Number of bisections of the way to a tangent's answer.
const BISECTIONS: usize = 60;

/// Bounds on an entry of the dense problem, of which at least one yields.
#[derive(Debug, Clone, Copy)]
pub(super) struct HertzBound {
    /// Index of the entry.
    pub entry: usize,
    /// Lower and upper bound, in m.
    pub limits: [f64; 2],
    /// Stiffness of each, in N/m^1.5; infinite where it is rigid.
    pub stiffness: [f64; 2],
}

impl HertzBound {
    /// Returns the sides that yield, each with the sign of its reaction, its stiffness, and the
    /// depth of a value beyond it.
    pub fn sides(&self, value: f64) -> impl Iterator<Item = (f64, f64, f64)> {
        let depths = [self.limits[0] - value, value - self.limits[1]];
        let sides = [1.0, -1.0].into_iter().zip(self.stiffness).zip(depths);
        sides.map(|((sign, k), depth)| (sign, k, depth)).filter(|(_, k, _)| k.is_finite())
    }

    /// Returns the reaction at a value, in N.
    pub fn reaction(&self, value: f64) -> f64 {
        self.sides(value).map(|(sign, k, depth)| sign * hertz_force(k, depth)).sum()
    }

    /// Returns the depth of a value beyond the bound that yields, in m, with the sign of the
    /// reaction; 0 inside.
    #[cfg(feature = "petsc")]
    pub fn signed_depth(&self, value: f64) -> f64 {
        self.sides(value).map(|(sign, _, depth)| sign * depth.max(0.0)).sum()
    }

    /// Returns the derivative of the reaction with respect to the depth at a value, in N/m.
    pub fn tangent(&self, value: f64) -> f64 {
        self.sides(value).map(|(_, k, depth)| hertz_tangent(k, depth)).sum()
    }

    /// Returns the error of a reaction at a value: relative to the magnitude of its row or, if that
    /// is smaller, as an error of the depth relative to value and bound.
    pub fn error(&self, value: f64, reaction: f64, magnitude: f64) -> f64 {
        let of = |(side, (sign, k, depth)): (usize, (f64, f64, f64))| {
            let pushes = (sign * reaction).max(0.0);
            let of_force = (pushes - hertz_force(k, depth)).abs() / magnitude;
            let of_depth = (depth.max(0.0) - hertz_depth(k, pushes)).abs();
            of_force.min(of_depth / (value.abs() + self.limits[side].abs()))
        };
        let first = usize::from(self.stiffness[0].is_infinite());
        // A NaN is kept, which a maximum would lose.
        (first..2).zip(self.sides(value)).map(of).fold(0.0, |worst, of| if of <= worst { worst } else { of })
    }
}

/// Collects the bounds that yield among the candidates of all ranks, of which this rank's begin at
/// the entry `first`, and removes them from the rigid bounds of all entries. Collective.
pub(super) fn yielding<E: Engine>(
    engine: &E,
    bounds: &Bounds,
    (candidates, first): (&[usize], usize),
    [lower, upper]: [&mut [f64]; 2],
) -> Vec<HertzBound> {
    let Some(hertz) = &bounds.hertz else { return Vec::new() };
    let is_soft = |of: &(usize, [f64; 2])| of.1.iter().any(|k| k.is_finite());
    let own = candidates.iter().enumerate().map(|(k, &i)| (first + k, hertz[i])).filter(is_soft);
    let all = engine.comm().all_gather(&own.collect::<Vec<_>>());
    let bound = |(entry, stiffness): (usize, [f64; 2])| {
        let limits = [lower[entry], upper[entry]];
        if stiffness[0].is_finite() {
            lower[entry] = f64::NEG_INFINITY;
        }
        if stiffness[1].is_finite() {
            upper[entry] = f64::INFINITY;
        }
        HertzBound { entry, limits, stiffness }
    };
    all.into_iter().map(bound).collect()
}

/// Dense problem with rigid bounds and bounds that yield.
#[derive(Clone, Copy)]
pub(super) struct YieldingProblem<'a> {
    /// Problem without the bounds that yield.
    pub rigid: DenseProblem<'a>,
    pub yielding: &'a [HertzBound],
}

impl YieldingProblem<'_> {
    /// Solves the problem, starting from the active sets in `sides`. Returns the number of
    /// exchanges and of Newton iterations.
    pub fn solve(&self, sides: &mut [BoundStatus], answer: &mut Answer) -> u32 {
        let YieldingProblem { rigid, yielding } = *self;
        let mut iterations = rigid.solve(sides, answer);
        if yielding.is_empty() {
            return iterations;
        }
        let (mut matrix, mut rhs) = (rigid.matrix.clone(), rigid.rhs.to_vec());
        let mut convergence = Convergence::default();
        for _ in 0..MAX_ITERATIONS {
            for of in yielding {
                let (i, value) = (of.entry, answer.x[of.entry]);
                let tangent = of.tangent(value);
                matrix[(i, i)] = rigid.matrix[(i, i)] + tangent;
                rhs[i] = rigid.rhs[i] + (of.reaction(value) + tangent * value);
            }
            let from = answer.x.to_vec();
            iterations += 1 + DenseProblem { matrix: &matrix, rhs: &rhs, ..rigid }.solve(sides, answer);
            if convergence.ends(self.react(sides, answer)) {
                break;
            }
            self.shorten(&from, answer.x);
        }
        iterations
    }

    /// Sets the reactions of the bounds that yield to those of the equilibrium of their rows.
    /// Returns their largest error as values of the law.
    fn react(&self, sides: &[BoundStatus], answer: &mut Answer) -> f64 {
        let DenseProblem { matrix, rhs, .. } = self.rigid;
        let mut worst = 0.0;
        for of in self.yielding.iter().filter(|of| sides[of.entry] == BoundStatus::Free) {
            let (mut force, mut magnitude) = (-rhs[of.entry], rhs[of.entry].abs());
            // The matrix is symmetric.
            for (entry, x) in matrix.col(of.entry).iter().zip(answer.x.iter()) {
                force += entry * x;
                magnitude += (entry * x).abs();
            }
            let law = of.reaction(answer.x[of.entry]);
            // A reaction pushes, and only where the law does.
            answer.reaction[of.entry] = if law * force > 0.0 { force } else { 0.0 };
            let error = of.error(answer.x[of.entry], force, magnitude);
            worst = if error <= worst { worst } else { error };
        }
        worst
    }

    /// Moves x back towards the start of an iteration, to the least energy on the way, where the
    /// energy rises too much at its end.
    fn shorten(&self, from: &[f64], x: &mut [f64]) {
        let DenseProblem { matrix, rhs, .. } = self.rigid;
        let way: Vec<f64> = x.iter().zip(from).map(|(to, from)| to - from).collect();
        let (mut first, mut second) = (0.0, 0.0);
        for (j, step) in way.iter().enumerate() {
            let column = matrix.col_as_slice(j);
            let dot = |values: &[f64]| column.iter().zip(values).map(|(a, b)| a * b).sum::<f64>();
            first += step * (dot(from) - rhs[j]);
            second += step * dot(&way);
        }
        let slope = |part: f64| {
            let of_bounds = self.yielding.iter().map(|of| {
                let i = of.entry;
                way[i] * of.reaction(from[i] + part * way[i])
            });
            first + part * second - of_bounds.sum::<f64>()
        };
        if let Some(part) = least_on_way(slope) {
            x.iter_mut().zip(from.iter().zip(&way)).for_each(|(x, (from, way))| *x = from + part * way);
        }
    }
}

/// Convergence of the iterations towards the law.
#[derive(Debug)]
pub(super) struct Convergence {
    last: f64,
    best: f64,
    idle: u32,
}

impl Default for Convergence {
    fn default() -> Convergence {
        Convergence { last: f64::INFINITY, best: f64::INFINITY, idle: 0 }
    }
}

impl Convergence {
    /// Notes the error of an iteration. Returns whether it is the last one.
    pub fn ends(&mut self, error: f64) -> bool {
        (self.best, self.idle) =
            if error < 0.5 * self.best { (error, 0) } else { (self.best, self.idle + 1) };
        let is_rounding = error <= f64::EPSILON || error <= ROUNDING && error > 0.5 * self.last;
        self.last = error;
        is_rounding || error.is_nan() || self.idle == MAX_IDLE_ITERATIONS
    }
}

/// Returns the part of a way on which the energy is least, given its slope along the way; `None`
/// where the energy does not rise too much at the end.
pub(super) fn least_on_way(slope: impl Fn(f64) -> f64) -> Option<f64> {
    let [begin, end] = [slope(0.0), slope(1.0)];
    if begin >= 0.0 || end <= 0.5 * -begin {
        return None;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (low + high);
        *(if slope(middle) < 0.0 { &mut low } else { &mut high }) = middle;
    }
    Some(high)
}
