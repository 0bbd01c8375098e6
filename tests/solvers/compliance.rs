//! Contact in compliance form with bounds that are rigid or yield by the law of Hertz: the answer
//! satisfies its conditions, and is that of the dense problem.

use crate::common::Random;
use faer::Mat;
use rebond::contact_law::{ContactLaw, Hertz, Laws, RIGID};
use rebond::vi::{ComplianceProblem, ComplianceSolver};
use std::sync::Arc;

const SIZE: usize = 12;

/// Returns a number between two others.
fn between(random: &mut Random, low: f64, high: f64) -> f64 {
    low + (high - low) * random.unit()
}

/// Returns a positive definite matrix with a condition of about 1e4.
fn compliance(random: &mut Random) -> Mat<f64> {
    let root = Mat::from_fn(SIZE, SIZE, |_, _| random.signed());
    let mut product = &root * root.transpose();
    (0..SIZE).for_each(|i| product[(i, i)] += 1e-3);
    product
}

/// Returns laws of Hertz with these stiffnesses, infinite for rigid bounds.
fn hertz(stiffness: &[[f64; 2]]) -> Laws {
    let table = stiffness.as_flattened().iter().map(|k| Arc::new(Hertz(*k)) as Arc<dyn ContactLaw>);
    let number = |bound: usize, side: usize| {
        if stiffness[bound][side].is_finite() { (2 * bound + side) as u32 } else { RIGID }
    };
    let numbers = (0..stiffness.len()).map(|bound| [number(bound, 0), number(bound, 1)]);
    Laws::new(table.collect(), numbers.collect())
}

/// Asserts x = y + R r, and for each dof the conditions of its bounds.
fn assert_solved(problem: ComplianceProblem, x: &[f64], r: &[f64], what: &str) -> usize {
    let ComplianceProblem { compliance, free, lower, upper, laws, .. } = problem;
    let most = r.iter().fold(0.0, |most: f64, r| most.max(r.abs()));
    let mut pressed = 0;
    for i in 0..SIZE {
        let moved: f64 = (0..SIZE).map(|j| compliance[(i, j)] * r[j]).sum();
        let size = x.iter().fold(1.0, |most: f64, x| most.max(x.abs())) + 10.0 * most;
        assert!((x[i] - free[i] - moved).abs() <= 1e-13 * size, "{what}: {} is not y + R r at {i}", x[i]);
        for (side, sign, depth) in [(0, 1.0, lower[i] - x[i]), (1, -1.0, x[i] - upper[i])] {
            let push = (sign * r[i]).max(0.0);
            let Some(law) = laws.and_then(|laws| laws.get(i, side)) else {
                assert!(
                    depth <= 1e-12 && (push == 0.0 || depth.abs() <= 1e-12),
                    "{what}: {depth:e} at {i}, {} in [{}, {}], {} of {most}, free {}",
                    x[i],
                    lower[i],
                    upper[i],
                    r[i],
                    free[i]
                );
                continue;
            };
            // Of a stiff bound the depth is as exact as x.
            let of_depth = (depth.max(0.0) - (push / law.force(1.0)).powf(2.0 / 3.0)).abs();
            let is_law =
                (push - law.force(depth)).abs() <= 1e-12 * most || of_depth <= 1e-13 * (1.0 + x[i].abs());
            assert!(is_law, "{what}: {push:e} for {:e} at {i}", law.force(depth));
            pressed += usize::from(push > 0.0);
        }
    }
    pressed
}

#[test]
fn answers_satisfy_the_law_at_any_stiffness() {
    let mut random = Random::new(7);
    for stiffness in [1e-9, 1e-3, 1.0, 1e3, 1e6, 1e12, 1e20] {
        let mut pressed = 0;
        let matrix = compliance(&mut random);
        let mut solver = ComplianceSolver::new(SIZE);
        for case in 0..40 {
            let mut draw =
                |low, high| (0..SIZE).map(|_| between(&mut random, low, high)).collect::<Vec<f64>>();
            let (free, lower, upper, kinds) =
                (draw(-5.0, 5.0), draw(-2.0, 0.0), draw(0.5, 2.0), draw(0.0, 4.0));
            let of = |kind: f64| match kind as usize {
                0 => [stiffness, f64::INFINITY],
                1 => [f64::INFINITY, stiffness],
                2 => [stiffness, 3.0 * stiffness],
                _ => [f64::INFINITY; 2],
            };
            let laws = hertz(&kinds.iter().map(|kind| of(*kind)).collect::<Vec<_>>());
            let problem = ComplianceProblem {
                compliance: &matrix,
                free: &free,
                lower: &lower,
                upper: &upper,
                laws: Some(&laws),
                softness: &[],
            };
            let (mut x, mut r) = (vec![0.0; SIZE], vec![0.0; SIZE]);
            solver.solve(problem, &mut x, &mut r);
            let what = format!("{stiffness:e}, case {case}, {} iterations", solver.iterations);
            pressed += assert_solved(problem, &x, &r, &what);
            assert!(solver.iterations <= 60, "{what}");
        }
        assert!(pressed > 40, "{pressed}");
    }
}

/// With stops stiffer and stiffer the answer becomes that with rigid bounds.
#[test]
fn stiff_bounds_become_rigid() {
    let mut random = Random::new(11);
    let matrix = compliance(&mut random);
    let free: Vec<f64> = (0..SIZE).map(|_| 5.0 * random.signed()).collect();
    let limits = [vec![-1.0; SIZE], vec![f64::INFINITY; SIZE]];
    let answer = |stiffness: &[[f64; 2]]| {
        let laws = hertz(stiffness);
        let (mut x, mut r) = (vec![0.0; SIZE], vec![0.0; SIZE]);
        let [lower, upper] = limits.each_ref().map(|of| &**of);
        let problem = ComplianceProblem {
            compliance: &matrix,
            free: &free,
            lower,
            upper,
            laws: Some(&laws),
            softness: &[],
        };
        ComplianceSolver::new(SIZE).solve(problem, &mut x, &mut r);
        x
    };
    let rigid = answer(&[]);
    let error = |power: i32| {
        let soft = answer(&[[10f64.powi(power), f64::INFINITY]; SIZE]);
        soft.iter().zip(&rigid).fold(0.0, |most: f64, (a, b)| most.max((a - b).abs()))
    };
    let errors: Vec<f64> = [8, 10, 12, 14].map(error).to_vec();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log10() / 2.0;
        assert!((order - 2.0 / 3.0).abs() <= 0.02, "order {order}: {errors:?}");
    }
}
