//! A membrane over a hemisphere, compared with numbers of an independent program and the exact
//! solution.
//!
//! The deflection u minimises the Dirichlet energy on (-2, 2)^2 above psi(r) = sqrt(1 - r^2),
//! continued from r = 0.9 on by its tangent, with the exact solution on the boundary: u = psi for r
//! <= a, and u = B - A ln r beyond, where a solves a^2 (ln 2 - ln a) = 1 - a^2, A = a^2 / sqrt(1 -
//! a^2) and B = A ln 2. The 5-point Laplacian of a grid is the stiffness of unit springs along its
//! edges.
//!
//! This is the tutorial `ex9` of PETSc's SNES (E. Bueler, *PETSc for Partial Differential
//! Equations*, 2021, chapter 12). The errors expected below are those that this program prints: the
//! discrete problem has one solution, whatever solves it.

use crate::common::block;
use rebond::linalg::{Engine, Native};
use rebond::obstacle::Bounds;
use rebond::vi::{Answer, CheckedSolver, Condensed, Problem};

const RADIUS: f64 = 0.697965148223374;
const A: f64 = 0.680259411891719;
const B: f64 = 0.471519893402112;

/// Number of grid points per side, and mean and maximum error over all of them, to the digits that
/// the tutorial prints.
const EXPECTED: [(usize, f64, f64); 5] = [
    (9, 3.076e-3, 1.334e-2),
    (17, 2.707e-3, 1.428e-2),
    (33, 8.182e-4, 5.747e-3),
    (65, 9.818e-5, 5.991e-4),
    (129, 3.334e-5, 2.154e-4),
];

fn obstacle(r: f64) -> f64 {
    let (edge, height) = (0.9f64, 0.19f64.sqrt());
    if r <= edge { (1.0 - r * r).sqrt() } else { height - edge / height * (r - edge) }
}

fn exact(r: f64) -> f64 {
    if r <= RADIUS { obstacle(r) } else { -A * r.ln() + B }
}

#[test]
fn the_constants_solve_the_free_boundary_problem() {
    let square = RADIUS * RADIUS;
    assert!((square * (2f64.ln() - RADIUS.ln()) - (1.0 - square)).abs() <= 1e-14);
    assert!((A - square / (1.0 - square).sqrt()).abs() <= 1e-14);
    assert!((B - A * 2f64.ln()).abs() <= 1e-14);
}

#[test]
fn the_errors_on_five_grids_are_those_of_the_petsc_tutorial() {
    for (points, mean, maximum) in EXPECTED {
        let interior = points - 2;
        let size = interior * interior;
        let radius = |i: usize, j: usize| {
            let at = |i: usize| -2.0 + 4.0 * i as f64 / (points - 1) as f64;
            at(i).hypot(at(j))
        };
        let dof = |i: usize, j: usize| {
            let inside = |i: usize| (1..=interior).contains(&i);
            (inside(i) && inside(j)).then(|| (i - 1) + interior * (j - 1))
        };

        // There is a spring along every edge. A spring that ends on the boundary pulls its inner
        // end towards the value there.
        let mut blocks = Vec::new();
        let mut b = vec![0.0; size];
        let mut spring = |one: (usize, usize), other: (usize, usize)| {
            let (first, second) = (dof(one.0, one.1), dof(other.0, other.1));
            blocks.push(block(&[first, second], &[1.0, -1.0, -1.0, 1.0], 0));
            match (first, second) {
                (Some(inner), None) => b[inner] += exact(radius(other.0, other.1)),
                (None, Some(inner)) => b[inner] += exact(radius(one.0, one.1)),
                _ => {}
            }
        };
        for i in 0..points {
            for j in 1..points {
                spring((i, j - 1), (i, j));
                spring((j - 1, i), (j, i));
            }
        }
        let engine = Native::new(size);
        let form = engine.form(blocks);
        let sum = (&form).into();
        let mut bounds = Bounds::uniform((0..size).collect(), 0.0, f64::INFINITY);
        for (k, lower) in bounds.lower.iter_mut().enumerate() {
            *lower = obstacle(radius(1 + k % interior, 1 + k / interior));
        }
        let mut step: CheckedSolver<Native> =
            CheckedSolver::new(Box::new(Condensed::new(&engine, &sum, size).unwrap()), &engine, &sum)
                .unwrap();
        let (mut u, mut reaction) = (vec![0.0; size], vec![0.0; size]);
        let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.0 };
        let mut answer = Answer { x: &mut u, reaction: &mut reaction };
        let verdict = step.solve(&engine, &problem, &mut answer).unwrap();
        assert!(verdict.kkt <= 1e-12, "{points}: {:e}", verdict.kkt);
        assert!(bounds.violation(&u) <= 1e-14);

        // The error on the boundary is zero, but counts in the mean.
        let errors: Vec<f64> =
            (0..size).map(|k| (u[k] - exact(radius(1 + k % interior, 1 + k / interior))).abs()).collect();
        let computed_mean = errors.iter().sum::<f64>() / (points * points) as f64;
        let computed_maximum = errors.iter().fold(0.0, |m: f64, e| m.max(*e));
        println!(
            "{points}^2: mean {computed_mean:.3e}, maximum {computed_maximum:.3e}, {} iterations",
            verdict.iterations
        );
        assert_eq!(format!("{computed_mean:.3e}"), format!("{mean:.3e}"), "mean error, {points}^2");
        assert_eq!(format!("{computed_maximum:.3e}"), format!("{maximum:.3e}"), "maximum error, {points}^2");

        // The reactions balance the total downward force of the membrane.
        let mut product = vec![0.0; size];
        engine.multiply(&form, &u, &mut product).unwrap();
        let balance: f64 =
            product.iter().zip(&b).map(|(p, b)| p - b).sum::<f64>() - reaction.iter().sum::<f64>();
        assert!(balance.abs() <= 1e-11 * reaction.iter().sum::<f64>(), "{points}: {balance:e}");
        assert!(reaction.iter().all(|&r| r >= -1e-12));
    }
}
