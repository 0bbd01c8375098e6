//! Coulomb's law of friction at the nodes that touch: a dense problem with a disc for each node.
//!
//! A node that presses on its obstacle with the force N resists a slip s of its slopes by a moment
//! m, both vectors with components along x and y:
//!
//! ```math
//! |m| \le R, \qquad s = 0 \text{ where } |m| < R, \qquad m = -R\,\frac{s}{|s|} \text{ where } s \ne 0,
//!    \qquad R = \mu N a ,
//! ```
//!
//! with the coefficient of friction `$\mu$` and the arm a of the force about the middle plane. Seen
//! from the present moments, slip and radii are linear in the moments,
//!
//! ```math
//! s = s_0 + H\,(m - m_0), \qquad R = \max\bigl(0,\; R_0 + D\,(m - m_0)\bigr),
//! ```
//!
//! with H symmetric and positive semidefinite. For given R the problem is convex, with a unique
//! slip. Where R depends on m it has a unique solution as long as D is small against 1.
//!
//! The law is the equation `$m = P_R(m - \rho s)$` with the projection P on the discs, whatever the
//! positive numbers `$\rho$` (Alart and Curnier 1991). Newton's method solves it; where an iteration
//! does not reduce the error, sweeps over the nodes follow, which solve for each exactly (nonlinear
//! Gauss-Seidel; Jean 1999).

use crate::linalg::vectors::largest;
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Largest number of Newton iterations, each with sweeps over the nodes where it does not help.
const MOST_ITERATIONS: usize = 100;
/// Number of sweeps over the nodes in place of an iteration of Newton's method.
const SWEEPS: usize = 20;
/// Relative error that counts as rounding.
const ROUNDING: f64 = 4.0 * f64::EPSILON;
/// Relative error up to which moments that no longer improve count as solved.
const ACCEPTED: f64 = 1e-12;
/// Largest number of iterations for the radius of one node.
const MOST_ROOT_ITERATIONS: usize = 60;

/// Problem of the moments at the touching nodes; see the [module page](self).
pub(crate) struct CoulombProblem {
    /// Matrix H, two rows per node.
    pub compliance: Mat<f64>,
    /// Slips at the present moments, one per node.
    pub slip: Vec<[f64; 2]>,
    /// Radii at the present moments, in N m; negative for a node that would lift off.
    pub radius: Vec<f64>,
    /// Matrix D, a row per node, two columns per node.
    pub radius_rate: Mat<f64>,
}

/// Returns the nearest point of the disc of a radius.
fn projected([x, y]: [f64; 2], radius: f64) -> [f64; 2] {
    let length = x.hypot(y);
    if length <= radius { [x, y] } else { [x, y].map(|part| part * (radius.max(0.0) / length)) }
}

/// Returns the error of a moment (N m) by the law at a slip, in N m, with the stiffness `rho` that
/// makes a moment of the slip.
pub(crate) fn law_error(moment: [f64; 2], slip: [f64; 2], radius: f64, rho: f64) -> f64 {
    let trial = [0, 1].map(|k| moment[k] - rho * slip[k]);
    let [x, y] = projected(trial, radius);
    (moment[0] - x).hypot(moment[1] - y)
}

/// Moments with what they lead to.
struct MomentTrial {
    moments: Vec<[f64; 2]>,
    slips: Vec<[f64; 2]>,
    radii: Vec<f64>,
    /// Largest error of a node, relative to the largest radius or moment; NaN if any is.
    error: f64,
}

impl CoulombProblem {
    fn nodes(&self) -> usize {
        self.slip.len()
    }

    /// Returns the diagonal block of H of a node.
    fn block(&self, node: usize) -> [f64; 3] {
        let (i, h) = (2 * node, &self.compliance);
        [h[(i, i)], h[(i, i + 1)], h[(i + 1, i + 1)]]
    }

    /// Returns the stiffness by which the error of a node is measured, in N m.
    pub fn rho(&self, node: usize) -> f64 {
        let [xx, _, yy] = self.block(node);
        1.0 / xx.max(yy)
    }

    /// Returns slips, radii and error of moments, given the present ones.
    fn trial(&self, present: &[[f64; 2]], moments: Vec<[f64; 2]>) -> MomentTrial {
        let mut slips = self.slip.clone();
        let mut radii = self.radius.clone();
        for (j, (moment, from)) in moments.iter().zip(present).enumerate() {
            for k in 0..2 {
                let change = moment[k] - from[k];
                let (column, rates) =
                    (self.compliance.col_as_slice(2 * j + k), self.radius_rate.col_as_slice(2 * j + k));
                for (i, slip) in slips.iter_mut().enumerate() {
                    slip[0] += change * column[2 * i];
                    slip[1] += change * column[2 * i + 1];
                    radii[i] += change * rates[i];
                }
            }
        }
        let lengths = moments.iter().map(|m| m[0].hypot(m[1]));
        let size = radii.iter().map(|radius| radius.max(0.0)).chain(lengths).fold(0.0, f64::max);
        let error = |i: usize| law_error(moments[i], slips[i], radii[i], self.rho(i));
        let error = largest((0..self.nodes()).map(error)) / size.max(f64::MIN_POSITIVE);
        MomentTrial { moments, slips, radii, error }
    }

    /// Solves for the moments, in N m, starting from the present ones. Returns the number of
    /// iterations.
    pub fn solve(&self, moments: &mut [[f64; 2]]) -> u32 {
        let present = moments.to_vec();
        let mut best = self.trial(&present, present.clone());
        let mut iterations = 0;
        for _ in 0..MOST_ITERATIONS {
            if best.error <= ROUNDING {
                break;
            }
            iterations += 1;
            let next = self.trial(&present, self.newton(&best));
            if next.error < 0.5 * best.error {
                best = next;
                continue;
            }
            let begin = if next.error < best.error { next.moments } else { best.moments.clone() };
            let swept = self.trial(&present, self.sweep(&present, begin));
            // The sweeps lead on even where the error rises on the way.
            let improves = swept.error < best.error;
            let is_idle = !improves && best.error < ACCEPTED;
            if is_idle || swept.error.is_nan() {
                break;
            }
            best = swept;
        }
        moments.copy_from_slice(&best.moments);
        iterations
    }

    /// Returns the moments after an iteration of Newton's method for `$m = P_R(m - \rho s)$`.
    fn newton(&self, from: &MomentTrial) -> Vec<[f64; 2]> {
        let count = 2 * self.nodes();
        let mut matrix = Mat::<f64>::zeros(count, count);
        let mut rhs = Mat::<f64>::zeros(count, 1);
        for i in 0..self.nodes() {
            let (m, rho, radius) = (from.moments[i], self.rho(i), from.radii[i]);
            let z = [0, 1].map(|k| m[k] - rho * from.slips[i][k]);
            let length = z[0].hypot(z[1]);
            let target = projected(z, radius);
            // Derivative of the projection by z, as xx, xy, yy, and by the radius.
            let (by_z, by_radius) = if length <= radius {
                ([1.0, 0.0, 1.0], [0.0; 2])
            } else if radius <= 0.0 {
                ([0.0; 3], [0.0; 2])
            } else {
                let [x, y] = [z[0] / length, z[1] / length];
                let share = radius / length;
                ([share * (1.0 - x * x), -share * x * y, share * (1.0 - y * y)], [x, y])
            };
            for k in 0..2 {
                let row = 2 * i + k;
                rhs[(row, 0)] = target[k] - m[k];
                let [px, py] = if k == 0 { [by_z[0], by_z[1]] } else { [by_z[1], by_z[2]] };
                for column in 0..count {
                    let of_slip =
                        px * self.compliance[(2 * i, column)] + py * self.compliance[(2 * i + 1, column)];
                    matrix[(row, column)] = rho * of_slip - by_radius[k] * self.radius_rate[(i, column)];
                }
                matrix[(row, 2 * i)] -= px;
                matrix[(row, 2 * i + 1)] -= py;
                matrix[(row, row)] += 1.0;
            }
        }
        matrix.partial_piv_lu().solve_in_place(&mut rhs);
        let moved = |(i, m): (usize, &[f64; 2])| [m[0] + rhs[(2 * i, 0)], m[1] + rhs[(2 * i + 1, 0)]];
        from.moments.iter().enumerate().map(moved).collect()
    }

    /// Returns the moments after sweeps over the nodes, each of which is solved for exactly.
    fn sweep(&self, present: &[[f64; 2]], moments: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
        let MomentTrial { mut moments, mut slips, mut radii, .. } = self.trial(present, moments);
        for _ in 0..SWEEPS {
            for i in 0..self.nodes() {
                let ([xx, xy, yy], m) = (self.block(i), moments[i]);
                let others = [slips[i][0] - xx * m[0] - xy * m[1], slips[i][1] - xy * m[0] - yy * m[1]];
                let next = alone([xx, xy, yy], others, radii[i].max(0.0));
                for k in 0..2 {
                    let change = next[k] - m[k];
                    let column = self.compliance.col_as_slice(2 * i + k);
                    let rates = self.radius_rate.col_as_slice(2 * i + k);
                    for j in 0..self.nodes() {
                        slips[j][0] += change * column[2 * j];
                        slips[j][1] += change * column[2 * j + 1];
                        radii[j] += change * rates[j];
                    }
                }
                moments[i] = next;
            }
        }
        moments
    }
}

/// Returns the moment of a node alone, whose slip is `others + H m` with H as xx, xy, yy: the least
/// of `$\tfrac12 m \cdot H m + m \cdot s$` on the disc.
fn alone([xx, xy, yy]: [f64; 3], others: [f64; 2], radius: f64) -> [f64; 2] {
    let solve = |shift: f64| {
        let (a, c) = (xx + shift, yy + shift);
        let determinant = a * c - xy * xy;
        [-(c * others[0] - xy * others[1]) / determinant, -(a * others[1] - xy * others[0]) / determinant]
    };
    let free = solve(0.0);
    if free[0].hypot(free[1]) <= radius {
        return free;
    }
    if radius == 0.0 {
        return [0.0; 2];
    }
    // The slip is -shift m. 1/|m| is concave in the shift, so that Newton's method for 1/|m| = 1/R
    // rises to the root from below (Moré and Sorensen 1983).
    let mut shift = 0.0;
    let mut moment = free;
    for _ in 0..MOST_ROOT_ITERATIONS {
        let length = moment[0].hypot(moment[1]);
        let excess = length / radius - 1.0;
        if !excess.is_finite() || excess <= f64::EPSILON {
            break;
        }
        let (a, c) = (xx + shift, yy + shift);
        let determinant = a * c - xy * xy;
        let [x, y] = moment;
        let curvature = (c * x * x - 2.0 * xy * x * y + a * y * y) / determinant;
        let next = shift + excess * length * length / curvature;
        if next <= shift {
            break;
        }
        shift = next;
        moment = solve(shift);
    }
    projected(moment, radius)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    /// Random compliances, loads and radii, some nodes on a common diagonal, some lifting off.
    fn random_problem(random: &mut SplitMix64, nodes: usize, rate: f64) -> CoulombProblem {
        let root = Mat::from_fn(2 * nodes, 2 * nodes, |_, _| random.signed());
        CoulombProblem {
            compliance: &root * root.transpose(),
            slip: (0..nodes).map(|_| [random.signed(), random.signed()].map(|s| 10.0 * s)).collect(),
            radius: (0..nodes).map(|_| random.signed() + 0.5).collect(),
            radius_rate: Mat::from_fn(nodes, 2 * nodes, |_, _| rate * random.signed() / nodes as f64),
        }
    }

    #[test]
    fn moments_obey_the_law_at_every_node() {
        let mut random = SplitMix64::new(5);
        for nodes in [1, 2, 7, 30] {
            for rate in [0.0, 0.2, 0.6] {
                for _ in 0..20 {
                    let problem = random_problem(&mut random, nodes, rate);
                    let mut moments = vec![[0.0; 2]; nodes];
                    problem.solve(&mut moments);
                    let end = problem.trial(&vec![[0.0; 2]; nodes], moments);
                    assert!(end.error < 1e-12, "{nodes} nodes, rate {rate}: {:e}", end.error);
                    for i in 0..nodes {
                        let ([x, y], [sx, sy], radius) =
                            (end.moments[i], end.slips[i], end.radii[i].max(0.0));
                        assert!(x.hypot(y) <= radius + 1e-12);
                        // Sliding takes all of the radius, and is opposed.
                        let slides = sx.hypot(sy) > 1e-9;
                        assert!(!slides || (x * sx + y * sy + radius * sx.hypot(sy)).abs() < 1e-8);
                    }
                }
            }
        }
    }

    #[test]
    fn a_node_alone_is_solved_for_exactly() {
        let mut random = SplitMix64::new(8);
        for _ in 0..100 {
            let problem = random_problem(&mut random, 1, 0.0);
            let radius = problem.radius[0].max(0.0);
            let moment = alone(problem.block(0), problem.slip[0], radius);
            let end = problem.trial(&[[0.0; 2]], vec![moment]);
            assert!(end.error < 1e-13, "{:e}", end.error);
        }
    }
}
