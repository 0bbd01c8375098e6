//! Newton's method for bounds that yield by laws of contact.
//!
//! The problem is strictly convex: a quadratic energy, the energies of the laws, and rigid bounds.
//! Newton's method replaces each law by its tangent and solves the resulting problem with rigid
//! bounds exactly. It converges from any start: each answer lies in a direction of descent, and
//! where the energy rises at the end of the way, the least energy on the way is taken. From too
//! large a depth d a lone contact by the law of Hertz approaches its answer by thirds of d, then at
//! order 1.5 or higher. Where a law is so stiff that the rounding of x moves its reaction, the
//! reactions follow from the equilibrium of their rows, as at rigid bounds.

use super::{Answer, BoundStatus, DenseProblem};
use crate::communicator::Communicator;
use crate::contact_law::{ContactLaw, LawNumbers, SidedLaws, Tangent};
use crate::linalg::Engine;
use crate::linalg::vectors::{Largest, largest};
use crate::obstacle::Bounds;

/// Largest number of Newton iterations: a start 1e30 times too deep takes about 60.
const MAX_ITERATIONS: u32 = 200;

/// Number of iterations in succession that may fail to halve the error.
const MAX_IDLE_ITERATIONS: u32 = 30;

/// Error of a reaction relative to its row, or of a depth relative to its bound, that counts as
/// rounding.
pub(super) const ROUNDING: f64 = 64.0 * f64::EPSILON;

/// Number of bisections of the way to a tangent's answer.
const BISECTIONS: usize = 60;

/// Bounds on an entry of a problem, of which at least one yields.
#[derive(Debug, Clone)]
pub(super) struct YieldingBound {
    /// Index of the entry.
    pub entry: usize,
    /// Lower and upper bound, in m.
    pub limits: [f64; 2],
    /// Law of each; `None` where it is rigid.
    pub laws: SidedLaws,
}

impl YieldingBound {
    /// Returns the sides that yield: each with the sign of its reaction, its law, its place, and
    /// the depth of a value beyond it.
    fn sides(&self, value: f64) -> impl Iterator<Item = (f64, &impl ContactLaw, f64, f64)> {
        let depths = [self.limits[0] - value, value - self.limits[1]];
        let sides = [1.0, -1.0].into_iter().zip(&self.laws).zip(self.limits.into_iter().zip(depths));
        sides.filter_map(|((sign, law), (limit, depth))| Some((sign, law.as_ref()?, limit, depth)))
    }

    /// Returns the reaction at a value, in N.
    pub fn reaction(&self, value: f64) -> f64 {
        self.sides(value).map(|(sign, law, _, depth)| sign * law.force(depth)).sum()
    }

    /// Returns the energy stored at a value, in J.
    #[cfg(feature = "petsc")]
    pub fn energy(&self, value: f64) -> f64 {
        self.sides(value).map(|(_, law, _, depth)| law.energy(depth)).sum()
    }

    /// Returns the derivative of the reaction with respect to the depth at a value, in N/m.
    #[cfg(feature = "petsc")]
    pub fn stiffness(&self, value: f64) -> f64 {
        self.sides(value).map(|(_, law, _, depth)| law.linearised(depth, law.force(depth)).stiffness).sum()
    }

    /// Returns the tangent of the law of each side at a value and a reaction (N).
    pub fn tangents(&self, value: f64, reaction: f64) -> [Tangent; 2] {
        let mut tangents = [Tangent::default(); 2];
        for (sign, law, _, depth) in self.sides(value) {
            tangents[usize::from(sign < 0.0)] = law.linearised(depth, (sign * reaction).max(0.0));
        }
        tangents
    }

    /// Returns the error of a reaction at a value: relative to the magnitude of its row or, if that
    /// is smaller, as an error of the depth relative to value and bound.
    pub fn error(&self, value: f64, reaction: f64, magnitude: f64) -> f64 {
        let error = |(sign, law, limit, depth): (f64, &_, f64, f64)| {
            let force = (sign * reaction).max(0.0);
            let [force_error, depth_error] = errors(law, depth, force);
            (force_error / magnitude).min(depth_error / (value.abs() + limit.abs()))
        };
        largest(self.sides(value).map(error))
    }
}

/// Returns the errors of a force (N) at a depth (m) beyond a bound, in N, and of the depth under
/// it, in m.
pub(super) fn errors(law: &impl ContactLaw, depth: f64, force: f64) -> [f64; 2] {
    let depth_error = if force > 0.0 { (depth - law.depth(force)).abs() } else { depth.max(0.0) };
    [(force - law.force(depth)).abs(), depth_error]
}

/// Problem with rigid bounds, in which tangents take the place of laws.
pub(super) trait Linearised {
    /// Solves the problem for x (m) and the reactions (N) with tangents of the laws, two per bound
    /// that yields, at the present x. Returns the number of exchanges.
    fn solve(&mut self, tangents: &[[Tangent; 2]], x: &mut [f64], reaction: &mut [f64]) -> u32;

    /// Returns the largest error of the reactions of an answer as values of the laws.
    fn law_error(&mut self, x: &[f64], reaction: &mut [f64]) -> f64;

    /// Returns the slope of the quadratic energy along the way from one pair of x and reactions to
    /// another, at its begin, and its increase to the end.
    fn slopes(&self, from: [&[f64]; 2], to: [&[f64]; 2]) -> [f64; 2];
}

/// Solves a problem with bounds that yield by Newton's method from x and reactions. Returns the
/// number of iterations.
pub(super) fn solve(
    problem: &mut impl Linearised,
    yielding: &[YieldingBound],
    x: &mut [f64],
    reaction: &mut [f64],
) -> u32 {
    let (mut last, mut best, mut idle, mut iterations) = (f64::INFINITY, f64::INFINITY, 0, 0);
    for _ in 0..MAX_ITERATIONS {
        let tangents: Vec<[Tangent; 2]> =
            yielding.iter().map(|bound| bound.tangents(x[bound.entry], reaction[bound.entry])).collect();
        let from = (x.to_vec(), reaction.to_vec());
        iterations += 1 + problem.solve(&tangents, x, reaction);
        let error = problem.law_error(x, reaction);
        (best, idle) = if error < 0.5 * best { (error, 0) } else { (best, idle + 1) };
        let is_rounding = error <= f64::EPSILON || error <= ROUNDING && error > 0.5 * last;
        last = error;
        if is_rounding || error.is_nan() || idle == MAX_IDLE_ITERATIONS {
            break;
        }
        let holds = |tangents: &[Tangent; 2]| tangents.iter().any(|tangent| tangent.stiffness.is_infinite());
        if !tangents.iter().any(holds) {
            shorten(problem, yielding, [&from.0, &from.1], [x, reaction]);
        }
    }
    iterations
}

/// Moves x and reactions back towards the iteration before, to the least energy on the way, where
/// the energy rises too much at its end.
fn shorten(
    problem: &impl Linearised,
    yielding: &[YieldingBound],
    from: [&[f64]; 2],
    [x, reaction]: [&mut [f64]; 2],
) {
    let [first, second] = problem.slopes(from, [x, reaction]);
    let slope = |part: f64| {
        let reactions = yielding.iter().map(|bound| {
            let begin = from[0][bound.entry];
            let way = x[bound.entry] - begin;
            way * bound.reaction(begin + part * way)
        });
        first + part * second - reactions.sum::<f64>()
    };
    if let Some(part) = least_on_way(slope) {
        for (values, from) in [(&mut *x, from[0]), (&mut *reaction, from[1])] {
            values.iter_mut().zip(from).for_each(|(value, from)| *value = from + part * (*value - from));
        }
    }
}

/// Returns the part of a way on which the energy is least, given its slope along the way; `None`
/// where the energy does not rise too much at the end.
fn least_on_way(slope: impl Fn(f64) -> f64) -> Option<f64> {
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

/// Collects the bounds that yield among the candidates of all ranks, of which this rank's begin at
/// the entry `first`, and removes them from the rigid bounds of all entries. Collective.
pub(super) fn yielding<E: Engine>(
    engine: &E,
    bounds: &Bounds,
    (candidates, first): (&[usize], usize),
    [lower, upper]: [&mut [f64]; 2],
) -> Vec<YieldingBound> {
    let laws = &bounds.laws;
    if laws.are_rigid() {
        return Vec::new();
    }
    let yielding = candidates.iter().enumerate().filter(|(_, bound)| laws.has(**bound));
    let yielding = yielding.map(|(k, &bound)| (first + k, laws.numbers(bound)));
    let gathered = engine.comm().all_gather(&yielding.collect::<Vec<_>>());
    let bound = |(entry, numbers): (usize, LawNumbers)| {
        let bound =
            YieldingBound { entry, limits: [lower[entry], upper[entry]], laws: laws.numbered(numbers) };
        if bound.laws[0].is_some() {
            lower[entry] = f64::NEG_INFINITY;
        }
        if bound.laws[1].is_some() {
            upper[entry] = f64::INFINITY;
        }
        bound
    };
    gathered.into_iter().map(bound).collect()
}

/// Dense problem with rigid bounds and bounds that yield.
#[derive(Clone, Copy)]
pub(super) struct YieldingProblem<'a> {
    /// Problem without the bounds that yield.
    pub rigid: DenseProblem<'a>,
    pub yielding: &'a [YieldingBound],
}

impl YieldingProblem<'_> {
    /// Solves the problem, starting from the active sets in `sides`. Returns the number of
    /// exchanges and of Newton iterations.
    pub fn solve(&self, sides: &mut [BoundStatus], answer: &mut Answer) -> u32 {
        let YieldingProblem { rigid, yielding } = *self;
        for bound in yielding {
            let entry = bound.entry;
            sides[entry] = sides[entry].within(rigid.lower[entry], rigid.upper[entry]);
        }
        let exchanges = rigid.solve(sides, answer);
        if yielding.is_empty() {
            return exchanges;
        }
        let (matrix, rhs) = (rigid.matrix.clone(), rigid.rhs.to_vec());
        let limits = [rigid.lower.to_vec(), rigid.upper.to_vec()];
        let mut problem = LinearisedDense { original: *self, matrix, rhs, limits, sides };
        let iterations = solve(&mut problem, yielding, answer.x, answer.reaction);
        let LinearisedDense { limits, .. } = problem;
        for bound in yielding {
            let (i, reaction) = (bound.entry, &mut answer.reaction[bound.entry]);
            if limits[0][i] == limits[1][i] {
                // A law holds x, and no rigid bound does.
                sides[i] = BoundStatus::Free;
            } else if sides[i] == BoundStatus::Free && bound.reaction(answer.x[i]) * *reaction <= 0.0 {
                // A reaction pushes, and only where the law does.
                *reaction = 0.0;
            }
        }
        exchanges + iterations
    }
}

/// Dense problem whose matrix, right-hand side and bounds contain the tangents.
struct LinearisedDense<'a> {
    original: YieldingProblem<'a>,
    matrix: faer::Mat<f64>,
    rhs: Vec<f64>,
    limits: [Vec<f64>; 2],
    sides: &'a mut [BoundStatus],
}

impl Linearised for LinearisedDense<'_> {
    fn solve(&mut self, tangents: &[[Tangent; 2]], x: &mut [f64], reaction: &mut [f64]) -> u32 {
        let YieldingProblem { rigid, yielding } = self.original;
        for (bound, tangents) in yielding.iter().zip(tangents) {
            let (i, value) = (bound.entry, x[bound.entry]);
            (self.matrix[(i, i)], self.rhs[i]) = (rigid.matrix[(i, i)], rigid.rhs[i]);
            (self.limits[0][i], self.limits[1][i]) = (rigid.lower[i], rigid.upper[i]);
            let held = (0..2).find(|&side| tangents[side].stiffness.is_infinite());
            if let Some(side) = held {
                (self.limits[0][i], self.limits[1][i]) = (bound.limits[side], bound.limits[side]);
                continue;
            }
            for (sign, Tangent { force, stiffness }) in [1.0, -1.0].into_iter().zip(*tangents) {
                self.matrix[(i, i)] += stiffness;
                self.rhs[i] += sign * force + stiffness * value;
            }
            self.sides[i] = self.sides[i].within(rigid.lower[i], rigid.upper[i]);
        }
        let [lower, upper] = &self.limits;
        let problem = DenseProblem { matrix: &self.matrix, rhs: &self.rhs, lower, upper };
        problem.solve(self.sides, &mut Answer { x, reaction })
    }

    /// Sets the reactions of the bounds that yield by the equilibrium of their rows, too.
    fn law_error(&mut self, x: &[f64], reaction: &mut [f64]) -> f64 {
        let DenseProblem { matrix, rhs, .. } = self.original.rigid;
        let mut worst = Largest::default();
        for bound in self.original.yielding {
            let i = bound.entry;
            let is_held = self.limits[0][i] == self.limits[1][i];
            if self.sides[i] != BoundStatus::Free && !is_held {
                continue;
            }
            let (mut force, mut magnitude) = (-rhs[i], rhs[i].abs());
            // The matrix is symmetric.
            for (entry, x) in matrix.col(i).iter().zip(x) {
                force += entry * x;
                magnitude += (entry * x).abs();
            }
            reaction[i] = force;
            worst.raise(bound.error(x[i], force, magnitude));
        }
        worst.value()
    }

    fn slopes(&self, [from, _]: [&[f64]; 2], [to, _]: [&[f64]; 2]) -> [f64; 2] {
        let DenseProblem { matrix, rhs, .. } = self.original.rigid;
        let way: Vec<f64> = to.iter().zip(from).map(|(to, from)| to - from).collect();
        let (mut first, mut second) = (0.0, 0.0);
        for (j, step) in way.iter().enumerate() {
            let column = matrix.col_as_slice(j);
            let dot = |values: &[f64]| column.iter().zip(values).map(|(a, b)| a * b).sum::<f64>();
            first += step * (dot(from) - rhs[j]);
            second += step * dot(&way);
        }
        [first, second]
    }
}
