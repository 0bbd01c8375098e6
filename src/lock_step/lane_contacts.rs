//! Contact problems of several systems at once, each in a lane of the processor's registers.
//!
//! The problem of each system is that of [`crate::vi::compliance`], with the same compliance R for
//! all. As there, each system starts from the bounds that it touched last, and exchanges all that
//! violate a condition. Where few dofs are bounded, a factor of the whole compliance, with rows of
//! the identity for the dofs that are free, costs less than the choice of the rows to keep. A
//! system whose exchanges do not end soon is left to [`crate::vi::ComplianceSolver`], which always
//! ends.

use crate::kernels::{LaneMask, Lanes};
use crate::vi::SIGN_ROUNDINGS;
use faer::Mat;

const LANES: usize = Lanes::COUNT;
pub(super) const ZERO: Lanes = Lanes([0.0; LANES]);
const ONE: Lanes = Lanes([1.0; LANES]);

/// Number of exchanges after which a system is left to the other solver.
const MOST_EXCHANGES: usize = 6;

/// Contact problems of all lanes with N bounded dofs.
pub(super) struct LaneContacts<const N: usize> {
    /// Compliance R, in m/N.
    pub compliance: [[f64; N]; N],
    /// Bounds on the unknowns, less the unknowns without reactions, in m.
    pub lower: [Lanes; N],
    pub upper: [Lanes; N],
    /// Lanes to solve. The others get no reactions.
    pub chosen: LaneMask,
}

/// Solution of [`LaneContacts`].
#[derive(Clone, Copy)]
pub(super) struct LaneReactions<const N: usize> {
    /// Changes of the unknowns by the reactions, in m.
    pub x: [Lanes; N],
    /// Reactions, in N.
    pub reaction: [Lanes; N],
    /// Largest distance of a dof in contact from its bound before it is put there, in m.
    pub residual: Lanes,
    /// Number of exchanges.
    pub iterations: Lanes,
    /// Chosen lanes that are not solved.
    pub unsolved: LaneMask,
}

impl<const N: usize> LaneContacts<N> {
    /// Returns the leading entries of a compliance.
    #[inline(always)]
    pub fn rows(compliance: &Mat<f64>) -> [[f64; N]; N] {
        std::array::from_fn(|i| std::array::from_fn(|j| compliance[(i, j)]))
    }

    /// Solves for unknowns and reactions. `sides` holds the bound that each dof touched last, and
    /// becomes that which it touches: -1 for the lower, 1 for the upper one, 0 for none.
    #[inline(always)]
    pub fn solve(&self, sides: &mut [Lanes]) -> LaneReactions<N> {
        let mut now: [Lanes; N] = std::array::from_fn(|i| self.chosen.pick(sides[i], ZERO));
        let mut iterations = ZERO;
        let mut last = self.hold(&now);
        for exchanges in 0.. {
            let (next, exchanged) = self.exchange(now, &last);
            if !exchanged.any() || exchanges == MOST_EXCHANGES {
                last.unsolved = self.chosen & (last.unsolved | exchanged);
                break;
            }
            now = next;
            iterations += exchanged.pick(ONE, ZERO);
            last = self.hold(&now);
        }
        sides.copy_from_slice(&now);
        LaneReactions { iterations, ..last }
    }

    /// Computes the reactions that hold the dofs in contact at their bounds, and the changes of the
    /// unknowns by them. Lanes are unsolved whose compliance is not positive definite to rounding.
    #[inline(always)]
    fn hold(&self, sides: &[Lanes; N]) -> LaneReactions<N> {
        let LaneContacts { compliance, lower, upper, .. } = self;
        let touches = sides.map(|side| side * side);
        let held: [Lanes; N] = std::array::from_fn(|i| {
            let at_lower = sides[i].is_below(ZERO).pick(lower[i], ZERO);
            ZERO.is_below(sides[i]).pick(upper[i], at_lower)
        });
        let mut reaction = held;
        // The compliance is factored as L D L^T, with D diagonal and ones on the diagonal of L. The
        // rows of the factor after row j still contain L D in place of L.
        let mut factor = [[ZERO; N]; N];
        let mut inverse = [ZERO; N];
        let mut least = ONE;
        for j in 0..N {
            let mut pivot = (ONE - touches[j]) + compliance[j][j] * touches[j];
            for k in 0..j {
                let entry = factor[j][k] * inverse[k];
                pivot = pivot - entry * factor[j][k];
                factor[j][k] = entry;
                reaction[j] = reaction[j] - entry * reaction[k];
            }
            least = least.min(pivot);
            inverse[j] = ONE / pivot;
            for i in j + 1..N {
                let mut entry = compliance[i][j] * (touches[j] * touches[i]);
                for k in 0..j {
                    entry = entry - factor[i][k] * factor[j][k];
                }
                factor[i][j] = entry;
            }
        }
        for j in (0..N).rev() {
            reaction[j] = reaction[j] * inverse[j];
            for i in j + 1..N {
                reaction[j] = reaction[j] - factor[i][j] * reaction[i];
            }
        }
        let mut x = [ZERO; N];
        let mut residual = ZERO;
        for i in 0..N {
            for k in 0..N {
                x[i] += compliance[i][k] * reaction[k];
            }
            residual = residual.max(touches[i] * (x[i] - held[i]).abs());
            x[i] = ZERO.is_below(touches[i]).pick(held[i], x[i]);
        }
        LaneReactions { x, reaction, residual, iterations: ZERO, unsolved: !ZERO.is_below(least) }
    }

    /// Exchanges the bounds that violate a condition. Returns the chosen lanes that have some.
    #[inline(always)]
    fn exchange(&self, mut sides: [Lanes; N], answer: &LaneReactions<N>) -> ([Lanes; N], LaneMask) {
        let largest = answer.reaction.iter().fold(ZERO, |largest, r| largest.max(r.abs()));
        let rounding = (SIGN_ROUNDINGS * f64::EPSILON) * largest;
        let mut exchanged = LaneMask::default();
        for i in 0..N {
            let (side, x, r) = (sides[i], answer.x[i], answer.reaction[i]);
            let (lower, upper) = (self.lower[i], self.upper[i]);
            let is_free = !ZERO.is_below(side * side) & self.chosen;
            let (below, above) = (is_free & x.is_below(lower), is_free & upper.is_below(x));
            // The reaction of the upper bound points downwards.
            let pulls = rounding.is_below(side * r) & lower.is_below(upper);
            sides[i] = above.pick(ONE, below.pick(ZERO - ONE, pulls.pick(ZERO, side)));
            exchanged = exchanged | below | above | pulls;
        }
        (sides, exchanged)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;
    use crate::vi::{BoundStatus, ComplianceProblem, ComplianceSolver};

    #[test]
    fn every_lane_has_the_solution_of_the_other_solver() {
        const N: usize = 4;
        let mut random = SplitMix64::new(7);
        let root = Mat::from_fn(N, N, |_, _| random.signed());
        let mut compliance = &root * root.transpose();
        (0..N).for_each(|i| compliance[(i, i)] += 0.1);
        let mut sides = [ZERO; N];
        let mut solvers = vec![ComplianceSolver::new(N); LANES];
        let (mut touching, mut exchanges) = (0, 0.0);
        for _ in 0..500 {
            let mut vector = |scale: f64, shift: f64| -> [Lanes; N] {
                std::array::from_fn(|_| Lanes(std::array::from_fn(|_| shift + scale * random.unit())))
            };
            let free = vector(4.0, -2.0);
            let mut bound = |shift: f64| {
                let bound = vector(1.0, shift);
                std::array::from_fn(|i| bound[i] - free[i])
            };
            let problem = LaneContacts {
                compliance: LaneContacts::rows(&compliance),
                lower: bound(-1.5),
                upper: bound(0.5),
                chosen: ZERO.is_below(Lanes(std::array::from_fn(|lane| f64::from(lane != 3)))),
            };
            let solved = problem.solve(&mut sides);
            exchanges += solved.iterations.sum();
            for (lane, solver) in solvers.iter_mut().enumerate() {
                let lane_of = |vector: &[Lanes; N]| vector.map(|lanes| lanes.0[lane]);
                let (mut x, mut reaction) = ([0.0; N], [0.0; N]);
                let (lower, upper) = (lane_of(&problem.lower), lane_of(&problem.upper));
                let (free, lower, upper) = (&[0.0; N], &lower, &upper);
                let alone = ComplianceProblem {
                    compliance: &compliance,
                    free,
                    lower,
                    upper,
                    laws: None,
                    softness: &[],
                };
                solver.solve(alone, &mut x, &mut reaction);
                if lane == 3 {
                    assert_eq!(lane_of(&solved.reaction), [0.0; N]);
                    continue;
                }
                assert!(!solved.unsolved.holds(lane) && solved.residual.0[lane] < 1e-12);
                for i in 0..N {
                    let side = [BoundStatus::Lower, BoundStatus::Free, BoundStatus::Upper];
                    assert_eq!(side[(sides[i].0[lane] + 1.0) as usize], solver.sides[i]);
                    touching += usize::from(sides[i].0[lane] != 0.0);
                    assert!((solved.x[i].0[lane] - x[i]).abs() <= 1e-12, "{}", x[i]);
                    assert!((solved.reaction[i].0[lane] - reaction[i]).abs() <= 1e-10, "{}", reaction[i]);
                }
            }
        }
        assert!(touching > 1000 && exchanges > 1000.0, "{touching} {exchanges}");
    }
}
