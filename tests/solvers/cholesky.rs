//! The sparse Cholesky factor, compared with dense linear algebra: solution, Schur complement of
//! the contact dofs, forward elimination to it and back substitution, pinned dofs; each with
//! doubles and with twice the digits.
//!
//! The matrices are sums of random positive definite blocks on random dofs, from a few coupled dofs
//! (supernodes of one column) to nearly full ones (one supernode, so that columns are taken four at
//! a time), plus a share of the identity. The contact dofs are none, some or all of the dofs. Their
//! order is the caller's: ascending.

use crate::common::{Random, block, difference, largest, multiply, random_spd, solve_dense, submatrix};
use rebond::Error;
use rebond::linalg::{CellClass, Engine, Factor, Form, Native, SchurFactor, SingularMassCell};

/// Tolerance of all comparisons. Condition numbers stay below 1e4, so 1e-11 allows for three digits
/// of rounding and detects a wrong entry.
const TOLERANCE: f64 = 1e-11;

/// Returns a random sparse form, and the same matrix dense.
fn sparse(random: &mut Random, size: usize, blocks: usize, width: usize) -> (Native, Form, Vec<f64>) {
    let engine = Native::new(size);
    let mut dense = vec![0.0; size * size];
    let mut all = Vec::new();
    for i in 0..size {
        all.push(block(&[Some(i)], &[0.1], 0));
        dense[i * size + i] += 0.1;
    }
    for number in 0..blocks {
        let dofs: Vec<usize> = distinct(random, size, width);
        let matrix = random_spd(random, width, 2.0);
        for (i, &row) in dofs.iter().enumerate() {
            for (j, &column) in dofs.iter().enumerate() {
                dense[row * size + column] += matrix[i * width + j];
            }
        }
        let dofs: Vec<Option<usize>> = dofs.into_iter().map(Some).collect();
        all.push(block(&dofs, &matrix, 1 + number));
    }
    let form = engine.form(all);
    (engine, form, dense)
}

/// Returns `count` distinct numbers in 0..size, in random order.
fn distinct(random: &mut Random, size: usize, count: usize) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..size).collect();
    for i in 0..count {
        numbers.swap(i, i + random.below(size - i));
    }
    numbers.truncate(count);
    numbers
}

fn random_vector(random: &mut Random, size: usize) -> Vec<f64> {
    (0..size).map(|_| random.signed()).collect()
}

fn schur_of(factor: &mut Box<dyn Factor>) -> &mut dyn SchurFactor {
    factor.schur_factor().expect("a Schur complement")
}

#[test]
fn solve_condense_expand_and_pin_agree_with_dense_algebra() {
    let mut random = Random::new(1);
    let shapes =
        [(1, 0, 1), (2, 1, 2), (7, 3, 3), (24, 20, 3), (40, 12, 9), (60, 80, 3), (37, 4, 30), (64, 1, 64)];
    for (size, blocks, width) in shapes {
        for number in 0..10 {
            let (share, twice) = ([0.0, 0.1, 0.3, 0.6, 1.0][number / 2], number % 2 == 1);
            let (engine, form, dense) = sparse(&mut random, size, blocks, width);
            let count = (share * size as f64).round() as usize;
            let mut candidates = distinct(&mut random, size, count);
            candidates.sort_unstable();
            let rest: Vec<usize> = (0..size).filter(|i| !candidates.contains(i)).collect();
            let mut factor = engine.factor(&(&form).into(), &candidates).unwrap();
            assert!(!twice || factor.add_digits(&(&form).into()).unwrap());
            let digits = if twice { ", twice the digits" } else { "" };
            let context = format!("{size} dofs, {blocks} blocks of {width}, {count} candidates{digits}");

            // The solution agrees with the dense one.
            let b = random_vector(&mut random, size);
            let expected = solve_dense(&dense, &b).unwrap();
            let mut x = b.clone();
            factor.solve(&mut x).unwrap();
            assert!(difference(&x, &expected) <= TOLERANCE * largest(&expected), "solve, {context}");

            // The reduced system is H = A_cc - A_cf A_ff^-1 A_fc and h = b_c - A_cf A_ff^-1 b_f.
            let inner = submatrix(&dense, size, &rest, &rest);
            let across = submatrix(&dense, size, &candidates, &rest);
            let reduced = |right: &[f64]| -> Vec<f64> {
                if rest.is_empty() {
                    return vec![0.0; count];
                }
                multiply(&across, &solve_dense(&inner, right).unwrap())
            };
            let mut schur = submatrix(&dense, size, &candidates, &candidates);
            for (j, &column) in candidates.iter().enumerate() {
                for (i, value) in reduced(&submatrix(&dense, size, &rest, &[column])).iter().enumerate() {
                    schur[i * count + j] -= value;
                }
            }
            assert_eq!(
                (schur_of(&mut factor).schur().nrows(), schur_of(&mut factor).schur().ncols()),
                (count, count),
                "{context}"
            );
            let computed: Vec<f64> =
                (0..count * count).map(|k| schur_of(&mut factor).schur()[(k / count, k % count)]).collect();
            assert!(difference(&computed, &schur) <= TOLERANCE * largest(&dense), "schur, {context}");
            let b_rest: Vec<f64> = rest.iter().map(|&i| b[i]).collect();
            let expected_h: Vec<f64> =
                candidates.iter().zip(reduced(&b_rest)).map(|(&i, known)| b[i] - known).collect();
            let mut h = vec![0.0; count];
            schur_of(&mut factor).forward_to_schur(&b, &mut h, &mut []).unwrap();
            assert!(difference(&h, &expected_h) <= 1e3 * TOLERANCE, "condense, {context}");

            // With their own values at the contact dofs, back substitution gives the whole
            // solution.
            let mut values = h.clone();
            schur_of(&mut factor).solve_schur(&mut values);
            let at: Vec<f64> = candidates.iter().map(|&i| expected[i]).collect();
            assert!(difference(&values, &at) <= TOLERANCE * largest(&expected), "candidates, {context}");
            schur_of(&mut factor).back_substitute(&values, &mut x).unwrap();
            assert!(difference(&x, &expected) <= TOLERANCE * largest(&expected), "expand, {context}");
            // With any other values, the rows of the remaining dofs are still balanced.
            let values = random_vector(&mut random, count);
            schur_of(&mut factor).forward_to_schur(&b, &mut h, &mut []).unwrap();
            schur_of(&mut factor).back_substitute(&values, &mut x).unwrap();
            assert_eq!(candidates.iter().map(|&i| x[i]).collect::<Vec<f64>>(), values, "{context}");
            let product = multiply(&dense, &x);
            let residual: Vec<f64> = rest.iter().map(|&i| product[i] - b[i]).collect();
            assert!(largest(&residual) <= TOLERANCE * largest(&dense) * largest(&x), "balance, {context}");

            // Pinned dofs keep their values, and the rows of the others are balanced. With nothing
            // pinned, the result is the solution as before.
            for pinned in [size / 3, size, 1, 0] {
                let pinned = distinct(&mut random, size, pinned);
                factor.pin(&pinned).unwrap();
                let mut matrix = dense.clone();
                for i in 0..size {
                    for j in 0..size {
                        if pinned.contains(&i) || pinned.contains(&j) {
                            matrix[i * size + j] = f64::from(i == j);
                        }
                    }
                }
                let expected = solve_dense(&matrix, &b).unwrap();
                let mut x = b.clone();
                factor.solve(&mut x).unwrap();
                assert!(difference(&x, &expected) <= TOLERANCE * largest(&expected), "pin, {context}");
            }
            schur_of(&mut factor).forward_to_schur(&b, &mut h, &mut []).unwrap();
            assert!(difference(&h, &expected_h) <= 1e3 * TOLERANCE, "condense after pin, {context}");
        }
    }
}

#[test]
fn sums_of_forms_and_averages_are_factored_as_they_are_applied() {
    let mut random = Random::new(2);
    let size = 30;
    let (engine, stiffness, dense) = sparse(&mut random, size, 30, 4);
    // The mass consists of rank-one cells with a held dof each.
    let mut rows = Vec::new();
    let mut matrix: Vec<f64> = dense.iter().map(|a| 0.3 * a).collect();
    for class in 0..25 {
        let dofs = distinct(&mut random, size, 3);
        let row = random_vector(&mut random, 4);
        let mass = 0.5 + random.unit();
        for (i, &a) in dofs.iter().enumerate() {
            for (j, &b) in dofs.iter().enumerate() {
                matrix[a * size + b] += 7.0 * row[i] * row[j] / mass;
            }
        }
        let dofs = dofs.into_iter().map(Some).chain([None]).collect();
        rows.push(SingularMassCell { dofs, row: row.into(), mass, class: CellClass::Plate(class) });
    }
    let mass = engine.averages(rows);
    let sum = &stiffness * 0.3 + &mass * 7.0;
    let x = random_vector(&mut random, size);
    let mut product = vec![0.0; size];
    let mut b = vec![0.0; size];
    let mut form = 0.0;
    for (scale, part) in sum.terms() {
        form += scale * engine.multiply(part, &x, &mut product).unwrap();
        b.iter_mut().zip(&product).for_each(|(b, p)| *b += scale * p);
    }
    let expected = multiply(&matrix, &x);
    assert!(difference(&b, &expected) <= 1e-14 * largest(&matrix) * size as f64);
    let expected: f64 = x.iter().zip(&expected).map(|(x, y)| x * y).sum();
    assert!((form - expected).abs() <= 1e-13 * expected, "{form} {expected}");
    let mut factor = engine.factor(&sum, &[3, 11, 29]).unwrap();
    factor.solve(&mut b).unwrap();
    assert!(difference(&b, &x) <= TOLERANCE, "{}", difference(&b, &x));
    // The coupling satisfies B^T C^-1 B x = B^T v, and x^T M x = v^T C v.
    let mut v = vec![0.0; engine.velocities(&mass)];
    engine.project(&mass, &x, &mut v).unwrap();
    let mut momentum = vec![0.0; size];
    engine.project_transpose(&mass, &v, &mut momentum).unwrap();
    let form = engine.multiply(&mass, &x, &mut product).unwrap();
    assert!(difference(&momentum, &product) <= 1e-14 * largest(&product));
    assert!((engine.mass_norm_squared(&mass, &v).unwrap() - form).abs() <= 1e-14 * form);
}

#[test]
fn a_matrix_that_is_not_positive_definite_is_refused() {
    let engine = Native::new(2);
    for matrix in [[1.0, 2.0, 2.0, 1.0], [0.0; 4], [1.0, 0.0, 0.0, f64::NAN]] {
        let form = crate::common::dense_form(&engine, 2, &matrix);
        let refused = engine.factor(&(&form).into(), &[]).err();
        assert!(matches!(refused, Some(Error::Singular(_))), "{matrix:?}: {refused:?}");
    }
}
