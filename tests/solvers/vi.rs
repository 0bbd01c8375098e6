//! The bound-constrained solver, compared with brute force, and the check of answers, tested with
//! answers that are known to be right or wrong.
//!
//! 10,000 random problems A x = b + G^T r with up to 8 bounded dofs (and up to 3 without bounds)
//! are solved by [`rebond::vi::Condensed`], ten right-hand sides per matrix so that warm starts are
//! kept. Brute force tries every one of the 3^n active sets with an independent Cholesky solver and
//! takes the set that violates the conditions least. The data determine a solution to rounding
//! times the condition number of A, so this is the admissible difference. The conditions themselves
//! are checked at 1e-12 for any condition number. One problem in six consists of small integers
//! around a known solution with reactions that are exactly zero at the bound, so its data are free
//! of rounding.

use crate::common::{
    Random, block, dense_form, difference, largest, multiply, random_spd, solve_dense, submatrix,
};
use faer::Mat;
use rebond::contact_law::Laws;
use rebond::linalg::{Form, Native};
use rebond::obstacle::{Bounds, DofsInReach};
use rebond::vi::kkt::{KktCheck, Residual};
use rebond::vi::{Answer, BoundStatus, CheckedSolver, Condensed, DenseProblem, Problem, Solver};

const INF: f64 = f64::INFINITY;

/// Residual that every answer of the solver must meet, see [`rebond::vi::kkt`].
const ACCEPTED: f64 = 1e-12;

/// Problem A x = b + G^T r within bounds, with a dense A stored by rows.
#[derive(Clone)]
struct SmallProblem {
    matrix: Vec<f64>,
    b: Vec<f64>,
    bounds: Bounds,
}

impl SmallProblem {
    fn size(&self) -> usize {
        self.b.len()
    }

    /// Returns the scale of the deflection for the check.
    fn length(&self, x: &[f64]) -> f64 {
        self.bounds.dofs.iter().fold(self.bounds.magnitude(), |m, &dof| m.max(x[dof].abs()))
    }

    fn check(&self, x: &[f64], reaction: &[f64]) -> Residual {
        let engine = Native::new(self.size());
        let form = dense_form(&engine, self.size(), &self.matrix);
        let length = self.length(x);
        let sum = (&form).into();
        let mut check = KktCheck::new(&engine, &sum).unwrap();
        let problem = Problem { matrix: &sum, rhs: &self.b, bounds: &self.bounds, length };
        let answer = Answer { x: &mut x.to_vec(), reaction: &mut reaction.to_vec() };
        let parts = check.parts(&engine, &problem, &[], &answer).unwrap();
        let worst = check.residual(&engine, &problem, &[], &answer).unwrap();
        assert_eq!(worst.to_bits(), parts.worst().to_bits());
        parts
    }

    /// Tries every active set; returns x and r of the one that violates the conditions least, and
    /// its violation.
    fn brute_force(&self) -> (Vec<f64>, Vec<f64>, f64) {
        let (size, count) = (self.size(), self.bounds.len());
        let mut best = (vec![], vec![], INF);
        for code in 0..3usize.pow(count as u32) {
            let fixed = |i: usize| match code / 3usize.pow(i as u32) % 3 {
                0 => None,
                1 => Some(self.bounds.lower[i]),
                _ => Some(self.bounds.upper[i]),
            };
            let mut x = vec![0.0; size];
            let mut free = vec![true; size];
            if (0..count).any(|i| fixed(i).is_some_and(f64::is_infinite)) {
                continue;
            }
            for (i, &dof) in self.bounds.dofs.iter().enumerate() {
                if let Some(value) = fixed(i) {
                    (x[dof], free[dof]) = (value, false);
                }
            }
            let free: Vec<usize> = (0..size).filter(|&dof| free[dof]).collect();
            let known = multiply(&self.matrix, &x);
            let right: Vec<f64> = free.iter().map(|&dof| self.b[dof] - known[dof]).collect();
            let block = submatrix(&self.matrix, size, &free, &free);
            let values = solve_dense(&block, &right).expect("positive definite");
            for (&dof, value) in free.iter().zip(values) {
                x[dof] = value;
            }
            // The force that holds the dof pushes it towards the inside.
            let product = multiply(&self.matrix, &x);
            let length = self.length(&x);
            let mut reaction = vec![0.0; count];
            let mut broken: f64 = 0.0;
            for (i, &dof) in self.bounds.dofs.iter().enumerate() {
                let (lower, upper) = (self.bounds.lower[i], self.bounds.upper[i]);
                broken = broken.max((lower - x[dof]).max(x[dof] - upper) / length);
                if let Some(value) = fixed(i) {
                    let row = &self.matrix[dof * size..][..size];
                    let force: f64 =
                        self.b[dof].abs() + row.iter().zip(&x).map(|(a, x)| (a * x).abs()).sum::<f64>();
                    reaction[i] = product[dof] - self.b[dof];
                    let outward = if value == lower { -reaction[i] } else { reaction[i] };
                    if lower < upper && force > 0.0 {
                        broken = broken.max(outward / force);
                    }
                }
            }
            if broken < best.2 {
                best = (x, reaction, broken);
            }
        }
        best
    }
}

/// Displacement and reactions.
type Known = (Vec<f64>, Vec<f64>);

/// Kind of the bounds of a problem.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    TwoSided,
    LowerOnly,
    UpperOnly,
    /// Some dofs are held, with lower = upper.
    Held,
    /// Some bounds are infinite, some of them on both sides.
    Loose,
    /// Integers around a known solution; some reactions are exactly zero at the bound.
    Degenerate,
}

const KINDS: [Kind; 6] =
    [Kind::TwoSided, Kind::LowerOnly, Kind::UpperOnly, Kind::Held, Kind::Loose, Kind::Degenerate];

/// Returns `count` ascending dofs of `size`.
fn choose(random: &mut Random, size: usize, count: usize) -> Vec<usize> {
    let mut dofs: Vec<usize> = (0..size).collect();
    while dofs.len() > count {
        dofs.remove(random.below(dofs.len()));
    }
    dofs
}

/// Returns L L^T of a unit lower triangle of small integers.
fn integer_spd(random: &mut Random, size: usize) -> Vec<f64> {
    let mut l = vec![0.0; size * size];
    for i in 0..size {
        l[i * size + i] = 1.0 + random.below(2) as f64;
        for j in 0..i {
            l[i * size + j] = random.integer(1);
        }
    }
    let dot = |i: usize, j: usize| (0..size).map(|k| l[i * size + k] * l[j * size + k]).sum();
    (0..size * size).map(|k| dot(k / size, k % size)).collect()
}

/// Returns a problem of the given kind and, if it is degenerate, its solution.
fn draw(
    random: &mut Random,
    kind: Kind,
    matrix: &[f64],
    dofs: &[usize],
    loose: &[bool],
) -> (SmallProblem, Option<Known>) {
    let count = dofs.len();
    let size = (matrix.len() as f64).sqrt() as usize;
    let mut bounds = Bounds::uniform(dofs.to_vec(), -INF, INF);
    if kind == Kind::Degenerate {
        // The values are nonzero: the check measures a row relative to its own terms, and a row
        // without any would show only rounding.
        let x: Vec<f64> =
            (0..size).map(|_| random.integer(5)).map(|x| if x == 0.0 { 6.0 } else { x }).collect();
        let mut b = multiply(matrix, &x);
        let mut reaction = vec![0.0; count];
        for i in 0..count {
            let at = x[dofs[i]];
            (bounds.lower[i], bounds.upper[i]) = (at - 1.0 - random.below(3) as f64, at + 2.0);
            match random.below(5) {
                0 => (bounds.lower[i], reaction[i]) = (at, 1.0 + random.below(4) as f64),
                1 => (bounds.upper[i], reaction[i]) = (at, -1.0 - random.below(4) as f64),
                2 => bounds.lower[i] = at,
                3 => bounds.upper[i] = at,
                _ => {}
            }
            b[dofs[i]] -= reaction[i];
        }
        return (SmallProblem { matrix: matrix.to_vec(), b, bounds }, Some((x, reaction)));
    }
    // The target is of size 1, and the bounds exclude it.
    let target: Vec<f64> = (0..size).map(|_| random.signed()).collect();
    let b = multiply(matrix, &target);
    for i in 0..count {
        let middle = 0.5 * random.signed();
        let (below, above) = (middle - 0.3 * random.unit(), middle + 0.3 * random.unit());
        (bounds.lower[i], bounds.upper[i]) = match kind {
            Kind::LowerOnly => (below, INF),
            Kind::UpperOnly => (-INF, above),
            Kind::Held if loose[i] => (middle, middle),
            _ => (below, above),
        };
        if kind == Kind::Loose {
            // The choice of infinite bounds is the same for all problems of a matrix, as in a run.
            if loose[i] {
                bounds.lower[i] = -INF;
            }
            if loose[(i + 1) % count] {
                bounds.upper[i] = INF;
            }
        }
    }
    (SmallProblem { matrix: matrix.to_vec(), b, bounds }, None)
}

#[test]
fn ten_thousand_small_problems_agree_with_brute_force() {
    let mut random = Random::new(2013);
    let mut solved = 0;
    let mut touched = 0;
    let mut worst_kkt: f64 = 0.0;
    let mut worst_ratio: f64 = 0.0;
    // There are matrices for each number of bounds.
    for (count, matrices) in [(1, 100), (2, 160), (3, 160), (4, 160), (5, 160), (6, 140), (7, 80), (8, 40)] {
        for number in 0..matrices {
            let kind = KINDS[number % KINDS.len()];
            let size = count + random.below(4);
            let dofs = choose(&mut random, size, count);
            let decades = 10.0 * random.unit();
            let mut matrix = if kind == Kind::Degenerate {
                integer_spd(&mut random, size)
            } else {
                random_spd(&mut random, size, decades)
            };
            if kind != Kind::Degenerate && random.below(4) == 0 {
                // Slopes have other units than deflections: dofs without bounds are scaled over six
                // decades.
                let scales: Vec<f64> = (0..size)
                    .map(|i| if dofs.contains(&i) { 1.0 } else { 10f64.powf(3.0 * random.signed()) })
                    .collect();
                for (k, a) in matrix.iter_mut().enumerate() {
                    *a *= scales[k / size] * scales[k % size];
                }
            }
            let loose: Vec<bool> = (0..count).map(|_| random.below(3) == 0).collect();
            let engine = Native::new(size);
            let form = dense_form(&engine, size, &matrix);
            let sum = (&form).into();
            let mut solver = Condensed::new(&engine, &sum, count).unwrap();
            for _ in 0..10 {
                let (problem, known) = draw(&mut random, kind, &matrix, &dofs, &loose);
                let (mut x, mut reaction) = (vec![0.0; size], vec![0.0; count]);
                let SmallProblem { b, bounds, .. } = &problem;
                let step = Problem { matrix: &sum, rhs: b, bounds, length: 0.0 };
                let mut answer = Answer { x: &mut x, reaction: &mut reaction };
                let iterations = solver.solve(&engine, &step, &mut answer).unwrap();
                let context = format!("{kind:?}, {count} of {size} dofs, matrix {number}, 1e{decades:.1}");
                touched += usize::from(iterations > 0);
                solved += 1;

                let kkt = problem.check(&x, &reaction);
                worst_kkt = worst_kkt.max(kkt.worst());
                assert!(kkt.worst() <= ACCEPTED, "{context}: {kkt:?}");
                assert!(problem.bounds.violation(&x) <= 1e-13, "{context}");

                let (expected, forces, broken) = problem.brute_force();
                assert!(broken <= 1e-9, "{context}: brute force found nothing better than {broken:e}");
                let condition = if kind == Kind::Degenerate { 1e4 } else { 10f64.powf(decades) };
                // Answers are compared on the bounded dofs, whose units are those of the bounds,
                // and in energy on all dofs.
                let scale = problem.length(&expected);
                let at = |x: &[f64]| dofs.iter().map(|&dof| x[dof]).collect::<Vec<f64>>();
                let error = difference(&at(&x), &at(&expected)) / scale;
                worst_ratio = worst_ratio.max(error / (f64::EPSILON * condition));
                assert!(error <= 512.0 * f64::EPSILON * condition, "{context}: {error:e}");
                let force = largest(&problem.b).max(largest(&forces));
                assert!(difference(&reaction, &forces) <= 1e-9 * condition * force, "{context}");
                if let Some((x_known, r_known)) = known {
                    assert!(difference(&x, &x_known) <= 1e-11, "{context}: {x:?} {x_known:?}");
                    assert!(difference(&reaction, &r_known) <= 1e-11, "{context}: {reaction:?} {r_known:?}");
                }
            }
        }
    }
    assert_eq!(solved, 10_000);
    assert!(touched > 7_000, "{touched} problems with contact are too few to prove anything");
    println!("contact in {touched}, worst residual {worst_kkt:.1e}, error {worst_ratio:.1} eps cond(A)");
}

/// A plate that a load presses flat onto an obstacle at 0 has no deflection but rounding errors of
/// its slopes, which are no penetration.
#[test]
fn rounding_of_a_flat_plate_is_no_penetration() {
    let engine = Native::new(2);
    let form = dense_form(&engine, 2, &[4e8, 1e6, 1e6, 1e4]);
    let sum = (&form).into();
    let mut check = KktCheck::new(&engine, &sum).unwrap();
    let bounds = Bounds::uniform(vec![0], 0.0, f64::INFINITY);
    let problem = Problem { matrix: &sum, rhs: &[-400.0, 0.0], bounds: &bounds, length: 0.0 };
    let mut residual = |deflection: f64| {
        let (mut x, mut reaction) = ([deflection, 1e-21], [1e6 * 1e-21]);
        let answer = Answer { x: &mut x, reaction: &mut reaction };
        check.residual(&engine, &problem, &[&[400.0, 0.0]], &answer).unwrap()
    };
    assert!(residual(-1e-38) <= 1e-12);
    // A penetration as deep as the deflections that belong to these slopes is found.
    assert!(residual(-1e-24) > 0.1);
}

/// At the instant at which a ball of 1 kg meets a plate at rest, all forces are rounding, which is
/// no adhesion. Later a wrong millionth of the reaction is found, and so is a pull of a thousandth
/// of a newton.
#[test]
fn a_ball_that_meets_a_plate_at_rest_does_not_stick() {
    let engine = Native::new(2);
    // The unknowns are the deflection of the plate and the gap.
    let stiffness = engine.form(vec![block(&[Some(0)], &[1e9], 0)]);
    let mass = dense_form(&engine, 2, &[1.0; 4]);
    let sum = (&stiffness).into();
    let bounds = Bounds { size: 0.05, ..Bounds::uniform(vec![1], 0.0, INF) };
    let with_mass = &stiffness + &mass * 1e9;
    let mut check = KktCheck::with_inertia(&engine, &sum, &with_mass, bounds.magnitude()).unwrap();
    let mut residual = |force: f64, wrong: f64| {
        let problem = Problem { matrix: &sum, rhs: &[], bounds: &bounds, length: bounds.magnitude() };
        let (mut x, mut reaction) = ([-force / 1e9, 0.0], [force + wrong]);
        let answer = Answer { x: &mut x, reaction: &mut reaction };
        check.residual(&engine, &problem, &[&[-force, -force]], &answer).unwrap()
    };
    assert!(residual(-1e-25, 0.0) <= 1e-12);
    assert!(residual(0.0, -1e-25) <= 1e-12);
    assert!(residual(1e4, 0.0) <= 1e-12);
    assert!(residual(1e4, 0.01) > 1e-7);
    assert!(residual(-1e-3, 0.0) > 1e-8);
}

/// Returns the answer of a problem with every kind of row: at the lower bound, at the upper one,
/// between them, without bounds.
fn problem_with_answer() -> (SmallProblem, Vec<f64>, Vec<f64>) {
    let matrix = random_spd(&mut Random::new(5), 6, 1.0);
    let x = vec![0.5, -1.0, 0.75, 2.0, -0.25, 1.5];
    let bounds = Bounds {
        dofs: DofsInReach::from_iter([0, 1, 2, 4]),
        lower: vec![0.5, -INF, -1.0, -2.0],
        upper: vec![INF, -1.0, 1.0, INF],
        size: 0.0,
        laws: Laws::default(),
    };
    let reaction = vec![3.0, -2.0, 0.0, 0.0];
    let mut b = multiply(&matrix, &x);
    for (&dof, r) in bounds.dofs.iter().zip(&reaction) {
        b[dof] -= r;
    }
    (SmallProblem { matrix, b, bounds }, x, reaction)
}

/// Returns the size of a row's terms, relative to which stationarity and reactions are measured.
fn terms(problem: &SmallProblem, x: &[f64], reaction: &[f64], dof: usize) -> f64 {
    let row = &problem.matrix[dof * problem.size()..][..problem.size()];
    let product: f64 = row.iter().zip(x).map(|(a, x)| (a * x).abs()).sum();
    let bound = problem.bounds.dofs.iter().position(|&d| d == dof);
    product + problem.b[dof].abs() + bound.map_or(0.0, |i| reaction[i].abs())
}

#[test]
fn the_check_accepts_the_answer_and_measures_what_is_wrong() {
    let (problem, x, reaction) = problem_with_answer();
    assert!(problem.check(&x, &reaction).worst() <= 1e-15, "{:?}", problem.check(&x, &reaction));
    let close = |value: f64, expected: f64| (value - expected).abs() <= 1e-9 * expected;

    // The answer violates a bound by 1e-5 of the deflection's scale, with forces in balance.
    for (dof, shift) in [(0, -1e-5), (1, 1e-5), (2, 0.25 + 1e-5)] {
        let mut moved = (problem.clone(), x.clone());
        moved.1[dof] += shift;
        moved.0.b = multiply(&problem.matrix, &moved.1);
        for (&dof, r) in problem.bounds.dofs.iter().zip(&reaction) {
            moved.0.b[dof] -= r;
        }
        let parts = moved.0.check(&moved.1, &reaction);
        assert!(close(parts.penetration, 1e-5 / moved.0.length(&moved.1)), "dof {dof}: {parts:?}");
        assert!(parts.stationarity <= 1e-15 && parts.worst() < 1.1e-5, "dof {dof}: {parts:?}");
    }

    // The reaction pulls at a bound, or acts where there is no bound or far from one.
    for (i, force) in [(0, -3.0), (1, 2.0), (2, 1.0), (2, -1.0), (3, 0.5), (3, -0.5)] {
        let mut pulled = problem.clone();
        let mut forces = reaction.clone();
        let dof = problem.bounds.dofs[i];
        pulled.b[dof] += forces[i] - force;
        forces[i] = force;
        let parts = pulled.check(&x, &forces);
        let share = force.abs() / terms(&pulled, &x, &forces, dof);
        let (lower, upper) = (problem.bounds.lower[i], problem.bounds.upper[i]);
        let gap = if force > 0.0 { x[dof] - lower } else { upper - x[dof] };
        let expected = share.min(gap / problem.length(&x));
        let expected = if gap.is_infinite() { parts.adhesion / share * expected } else { expected };
        assert!(close(parts.worst(), expected), "bound {i}, {force}: {parts:?}, not {expected}");
        assert!(expected > 0.01 && parts.stationarity <= 1e-15, "bound {i}, {force}: {parts:?}");
        // The slightest pull is measured as well.
        let mut forces = reaction.clone();
        if i < 2 {
            let mut pulled = problem.clone();
            forces[i] = 1e-7 * force.signum();
            pulled.b[dof] += reaction[i] - forces[i];
            let parts = pulled.check(&x, &forces);
            let share = 1e-7 / terms(&pulled, &x, &forces, dof);
            assert!(close(parts.adhesion, share) && close(parts.worst(), share), "{parts:?}");
        }
    }

    // Forces are out of balance in a row, bounded or not.
    for dof in 0..problem.size() {
        let mut unbalanced = problem.clone();
        unbalanced.b[dof] += 1e-6;
        let parts = unbalanced.check(&x, &reaction);
        let expected = 1e-6 / terms(&unbalanced, &x, &reaction, dof);
        assert!(
            close(parts.stationarity, expected) && parts.worst() == parts.stationarity,
            "{dof}: {parts:?}"
        );
    }

    // Infinities and NaN are never right, in any place.
    for value in [f64::NAN, INF, -INF] {
        for dof in 0..problem.size() {
            let mut x = x.clone();
            x[dof] = value;
            assert!(problem.check(&x, &reaction).worst().is_nan(), "x[{dof}] = {value}");
            let mut problem = problem.clone();
            problem.b[dof] = value;
            assert!(
                problem.check(&problem_with_answer().1, &reaction).worst().is_nan(),
                "b[{dof}] = {value}"
            );
        }
        for i in 0..reaction.len() {
            let mut reaction = reaction.clone();
            reaction[i] = value;
            assert!(problem.check(&x, &reaction).worst().is_nan(), "r[{i}] = {value}");
        }
    }
    for i in 0..reaction.len() {
        for upper in [false, true] {
            let mut problem = problem.clone();
            let side = if upper { &mut problem.bounds.upper } else { &mut problem.bounds.lower };
            side[i] = f64::NAN;
            let worst = problem.check(&x, &reaction).worst();
            assert!(worst.is_nan(), "bound {i} is NaN: {worst}");
        }
    }
}

#[test]
fn the_check_does_not_depend_on_units() {
    let mut random = Random::new(6);
    let (mut problem, mut x, mut reaction) = problem_with_answer();
    // The answer is wrong in every way.
    problem.b.iter_mut().for_each(|b| *b += 1e-3 * random.signed());
    x[0] -= 1e-3;
    reaction[0] = -2e-3;
    reaction[2] = 0.1;
    let parts = problem.check(&x, &reaction);
    let numbers = |p: Residual| [p.stationarity, p.penetration, p.adhesion, p.complementarity];
    assert!(numbers(parts).iter().all(|&part| part > 1e-6), "{parts:?}");
    for (force, length, slope) in [(1e6, 1.0, 1.0), (1.0, 1e-6, 1.0), (1.0, 1.0, 1e-3), (1e-9, 1e4, 1e3)] {
        // Lengths have new units everywhere, and the dofs without bounds have different ones: x = s
        // x'.
        let size = problem.size();
        let scales: Vec<f64> = (0..size)
            .map(|i| if problem.bounds.dofs.contains(&i) { length } else { length * slope })
            .collect();
        let mut scaled = problem.clone();
        for (k, a) in scaled.matrix.iter_mut().enumerate() {
            *a *= force / (scales[k / size] * scales[k % size]);
        }
        scaled.b.iter_mut().zip(&scales).for_each(|(b, s)| *b *= force / s);
        scaled.bounds.lower.iter_mut().for_each(|l| *l *= length);
        scaled.bounds.upper.iter_mut().for_each(|u| *u *= length);
        let x: Vec<f64> = x.iter().zip(&scales).map(|(x, s)| x * s).collect();
        let reaction: Vec<f64> = reaction.iter().map(|r| r * force / length).collect();
        for (a, b) in numbers(parts).into_iter().zip(numbers(scaled.check(&x, &reaction))) {
            assert!((a - b).abs() <= 1e-11 * a, "{force:e} {length:e} {slope:e}: {a:e} {b:e}");
        }
    }
}

#[test]
fn the_check_accepts_rounding_in_a_row_that_vanishes() {
    let chain =
        [[4.0, -1.0, 0.0, 0.0], [-1.0, 4.0, -1.0, 0.0], [0.0, -1.0, 4.0, -1.0], [0.0, 0.0, -1.0, 4.0]];
    let problem = SmallProblem {
        matrix: chain.concat(),
        b: vec![4.0, -1.0, 0.0, 0.0],
        bounds: Bounds::uniform(vec![], 0.0, 0.0),
    };
    let off = |small: f64| problem.check(&[1.0, 0.0, small, small], &[]).stationarity;
    assert!(off(1e-17) <= 1e-12, "{:e}", off(1e-17));
    assert!(off(1e-9) >= 1e-6, "what is no rounding is seen: {:e}", off(1e-9));
}

/// Returns a membrane on springs with `side` by `side` dofs, as blocks of two dofs and diagonal
/// ones, and as a dense matrix.
fn membrane(side: usize, spring: f64) -> (Native, Form, Mat<f64>) {
    let size = side * side;
    let engine = Native::new(size);
    let mut blocks = Vec::new();
    let mut dense = Mat::zeros(size, size);
    let mut add = |dofs: &[Option<usize>], matrix: &[f64], class: usize| {
        for (i, row) in dofs.iter().enumerate() {
            for (j, column) in dofs.iter().enumerate() {
                if let (Some(row), Some(column)) = (row, column) {
                    dense[(*row, *column)] += matrix[i * dofs.len() + j];
                }
            }
        }
        blocks.push(block(dofs, matrix, class));
    };
    for i in 0..side {
        for j in 0..side {
            let dof = i * side + j;
            add(&[Some(dof)], &[spring], 0);
            add(&[Some(dof), (i + 1 < side).then_some(dof + side)], &[1.0, -1.0, -1.0, 1.0], 1);
            add(&[Some(dof), (j + 1 < side).then_some(dof + 1)], &[1.0, -1.0, -1.0, 1.0], 1);
        }
    }
    let form = engine.form(blocks);
    (engine, form, dense)
}

/// A solve with infinities and NaN ends, with any answer; the check rejects it.
#[test]
fn infinities_and_nans_come_to_an_end() {
    let size = 3;
    let engine = Native::new(size);
    let form = dense_form(&engine, size, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    let sum = (&form).into();
    let bounds = Bounds::uniform((0..size).collect(), -1.0, 1.0);
    for b in
        [[f64::NEG_INFINITY, f64::NAN, 0.0], [f64::NAN; 3], [f64::INFINITY, -f64::NAN, f64::NEG_INFINITY]]
    {
        let mut step: CheckedSolver<Native> =
            CheckedSolver::new(Box::new(Condensed::new(&engine, &sum, size).unwrap()), &engine, &sum)
                .unwrap();
        let (mut x, mut reaction) = ([0.0; 3], [0.0; 3]);
        let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.0 };
        let verdict = step.solve(&engine, &problem, &mut Answer { x: &mut x, reaction: &mut reaction });
        assert!(verdict.is_err() || verdict.is_ok_and(|verdict| verdict.kkt.is_nan()), "{b:?}");
    }
}

/// Returns the solution of a dense problem by projected over-relaxation, which is slow and
/// independent of active sets.
fn relax(matrix: &Mat<f64>, b: &[f64], bounds: &Bounds, sweeps: usize) -> Vec<f64> {
    let size = b.len();
    let (mut lower, mut upper) = (vec![-INF; size], vec![INF; size]);
    for (i, &dof) in bounds.dofs.iter().enumerate() {
        (lower[dof], upper[dof]) = (bounds.lower[i], bounds.upper[i]);
    }
    let rows: Vec<Vec<(usize, f64)>> = (0..size)
        .map(|i| (0..size).filter(|&j| matrix[(i, j)] != 0.0).map(|j| (j, matrix[(i, j)])).collect())
        .collect();
    let mut x = vec![0.0; size];
    for _ in 0..sweeps {
        for i in 0..size {
            let known: f64 = rows[i].iter().map(|&(j, a)| a * x[j]).sum();
            x[i] = (x[i] + 1.7 * (b[i] - known) / matrix[(i, i)]).clamp(lower[i], upper[i]);
        }
    }
    x
}

#[test]
fn candidates_grow_as_contact_spreads_and_then_stay() {
    let side = 16;
    let (engine, form, dense) = membrane(side, 0.05);
    let sum = (&form).into();
    let dofs: Vec<usize> = (0..side * side).filter(|dof| dof % 2 == 0).collect();
    let bounds = Bounds::uniform(dofs, -1.0, 1.5);
    let mut step: CheckedSolver<Native> =
        CheckedSolver::new(Box::new(Condensed::new(&engine, &sum, bounds.len()).unwrap()), &engine, &sum)
            .unwrap();
    let mut random = Random::new(7);
    let mut factorisations = vec![];
    let (mut x, mut reaction) = (vec![0.0; side * side], vec![0.0; bounds.len()]);
    // The load grows: nothing touches, then a few nodes, then most of them.
    let loads = [0.01, 0.1, 0.12, 0.3, 1.0, 0.1, 0.01, 1.0];
    for load in loads {
        let b: Vec<f64> = (0..side * side)
            .map(|dof| if dof < side * side / 2 { -load } else { load } * (1.0 + 0.1 * random.signed()))
            .collect();
        let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.5 };
        let mut answer = Answer { x: &mut x, reaction: &mut reaction };
        let verdict = step.solve(&engine, &problem, &mut answer).unwrap();
        assert!(verdict.kkt <= ACCEPTED, "load {load}: {:e}", verdict.kkt);
        assert!(difference(&x, &relax(&dense, &b, &bounds, 2000)) <= 1e-9, "load {load}");
        let touching = reaction.iter().filter(|&&r| r != 0.0).count();
        assert_eq!(verdict.iterations > 0, touching > 0, "load {load}");
        factorisations.push((step.factorisations(), touching));
    }
    println!("load, (factorisations, contacts): {:?}", loads.iter().zip(&factorisations).collect::<Vec<_>>());
    assert_eq!(factorisations[0], (1, 0), "nothing touches: the first factor serves");
    assert!(factorisations.windows(2).take(4).all(|w| w[0].0 <= w[1].0) && factorisations[4].0 > 3);
    assert!(
        factorisations[4..].iter().all(|f| f.0 == factorisations[4].0),
        "nodes that come back cost nothing"
    );
    assert!(factorisations[4].1 > 64);
}

#[test]
fn wide_contact_pins_dofs_and_agrees_with_the_dense_problem() {
    let side = 40;
    let size = side * side;
    let (engine, form, dense) = membrane(side, 1e-3);
    let sum = (&form).into();
    let mut random = Random::new(8);
    let mut bounds = Bounds::uniform((0..size).collect(), -1.0, 1.0);
    for i in (0..size).step_by(7) {
        bounds.upper[i] = INF;
    }
    for i in (3..size).step_by(11) {
        bounds.lower[i] = -INF;
    }
    for i in (5..size).step_by(97) {
        (bounds.lower[i], bounds.upper[i]) = (0.25, 0.25);
    }
    let mut step: CheckedSolver<Native> =
        CheckedSolver::new(Box::new(Condensed::new(&engine, &sum, size).unwrap()), &engine, &sum).unwrap();
    let (mut x, mut reaction) = (vec![0.0; size], vec![0.0; size]);
    let mut sides = vec![BoundStatus::Free; size];
    for load in [0.2, 0.21, 0.05, 0.02, 0.2] {
        let b: Vec<f64> = (0..size)
            .map(|dof| if dof % side < side / 2 { -load } else { load } * (1.0 + 0.5 * random.signed()))
            .collect();
        let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.0 };
        let mut answer = Answer { x: &mut x, reaction: &mut reaction };
        let verdict = step.solve(&engine, &problem, &mut answer).unwrap();
        assert!(verdict.kkt <= ACCEPTED, "load {load}: {:e}", verdict.kkt);
        let (mut expected, mut forces) = (vec![0.0; size], vec![0.0; size]);
        let Bounds { lower, upper, .. } = &bounds;
        let mut reference = Answer { x: &mut expected, reaction: &mut forces };
        DenseProblem { matrix: &dense, rhs: &b, lower, upper }.solve(&mut sides, &mut reference);
        assert!(difference(&x, &expected) <= 1e-12, "load {load}: {:e}", difference(&x, &expected));
        assert!(difference(&reaction, &forces) <= 1e-12, "load {load}: {:e}", difference(&reaction, &forces));
        let touching = reaction.iter().filter(|&&r| r != 0.0).count();
        println!(
            "load {load}: {touching} contacts, {} iterations, {} factorisations",
            verdict.iterations,
            step.factorisations()
        );
        if load > 0.1 {
            assert!(touching > 512);
        }
    }
    let b = vec![0.1; size];
    let expected = relax(&dense, &b, &bounds, 3000);
    let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.0 };
    let verdict = step.solve(&engine, &problem, &mut Answer { x: &mut x, reaction: &mut reaction }).unwrap();
    assert!(verdict.kkt <= ACCEPTED && difference(&x, &expected) <= 1e-9, "{:e}", difference(&x, &expected));
}
