//! Matrices, and the direct solver.

use super::{close, share};
use crate::common::ranks::{Case, case};
use rebond::petsc::{Context, Index, Ksp, Matrix, Smoother};
use rebond::{Error, Result};
use std::collections::BTreeMap;

pub const CASES: &[Case] = &[
    case("matrices", &[1, 2, 4], matrices),
    case("cholesky", &[1, 2, 4], cholesky),
    case("multigrid_holds_dofs", &[1, 2, 4], multigrid_holds_dofs),
    case("cholesky_refuses_an_indefinite_matrix", &[1, 2], cholesky_refuses_an_indefinite_matrix),
];

/// Returns triplets of this rank's share of the matrix (-1, 2 + shift, -1) of order n, cell by cell
/// as in an assembly. They contain rows of other ranks and repeated positions.
pub fn string(context: &Context, n: usize, shift: f64) -> (usize, Vec<Index>, Vec<Index>, Vec<f64>) {
    let range = share(context, n);
    let (mut rows, mut columns, mut values) = (vec![], vec![], vec![]);
    let mut add = |i: usize, j: usize, value: f64| {
        let index = |i: usize| if i < n { i as Index } else { -1 };
        rows.push(index(i));
        columns.push(index(j));
        values.push(value);
    };
    for i in range.clone() {
        // The cell lies between i and i + 1; the last cell ends at a support.
        for (a, b, value) in [(i, i, 1.0), (i, i + 1, -1.0), (i + 1, i, -1.0), (i + 1, i + 1, 1.0)] {
            add(a, b, value);
        }
        add(i, i, shift);
    }
    if range.contains(&0) {
        add(0, 0, 1.0);
    }
    (range.len(), rows, columns, values)
}

fn matrices(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let n = 40;
    let (local, rows, columns, values) = string(&context, n, 0.5);
    let mut a = Matrix::from_triplets(&context, local, &rows, &columns, &values)?;
    assert_eq!(a.local_size(), [local, local]);
    assert_eq!(a.norm_infinity()?, 4.5);
    let range = a.range();
    for row in range.clone() {
        let (columns, values) = a.row(row)?;
        let dense: BTreeMap<_, _> = columns.into_iter().zip(values).collect();
        assert_eq!(dense[&row], 2.5);
        assert!(row == 0 || dense[&(row - 1)] == -1.0);
        assert_eq!(dense.len(), if row == 0 || row == n as Index - 1 { 2 } else { 3 });
    }

    let mut x = a.vector()?;
    x.set_local(&range.clone().map(|i| f64::from(i * i)).collect::<Vec<_>>())?;
    let mut y = a.vector()?;
    a.multiply(&x, &mut y)?;
    let end = n as Index - 1;
    for (row, y) in range.clone().zip(y.to_vec()?) {
        let next = if row == end { f64::from((row + 1) * (row + 1)) } else { 0.0 };
        close(y, -2.0 + 0.5 * f64::from(row * row) + next + if row == 0 { 1.0 } else { 0.0 }, 1e-14);
    }

    let copy = a.duplicate()?;
    a.add_scaled(2.0, &copy)?;
    a.diagonal(&mut y)?;
    assert!(y.to_vec()?.iter().all(|&d| d == 7.5));
    a.set_values(&values.iter().map(|v| 10.0 * v).collect::<Vec<_>>())?;
    assert_eq!(a.norm_infinity()?, 45.0);
    assert!(a.set_values(&values[..values.len() - 1]).is_err());
    a.copy_from(&copy)?;
    assert_eq!(a.norm_infinity()?, 4.5);

    // The first rank names a row for all ranks.
    let named: &[Index] = if context.rank() == 0 { &[7] } else { &[] };
    a.zero_rows_columns(named, 3.0)?;
    for row in range.clone().filter(|row| (6..=8).contains(row)) {
        let (columns, values) = a.row(row)?;
        let coupled = columns.iter().zip(&values).filter(|&(&j, &v)| (j == 7 || row == 7) && v != 0.0);
        assert_eq!(coupled.count(), usize::from(row == 7));
    }

    assert!(Matrix::from_triplets(&context, local, &[n as Index], &[0], &[1.0]).is_err());
    Ok(())
}

fn cholesky(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let n = 60;
    let (local, rows, columns, values) = string(&context, n, 0.0);
    let mut a = Matrix::from_triplets(&context, local, &rows, &columns, &values)?;
    a.set_positive_definite()?;
    let mut solver = Ksp::new(&context, "test_")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    solver.set_up()?;

    // With indices from one, the inverse of (-1, 2, -1) is min(i, j) (n + 1 - max(i, j)) / (n + 1).
    let inverse = |i: usize, j: usize| (i.min(j) + 1) as f64 * (n - i.max(j)) as f64 / (n + 1) as f64;
    let range = a.range();
    let (mut b, mut x) = (a.vector()?, a.vector()?);
    b.set_local(&range.clone().map(f64::from).collect::<Vec<_>>())?;
    solver.solve(&b, &mut x)?;
    for (i, x) in range.clone().zip(x.to_vec()?) {
        close(x, (0..n).map(|j| inverse(i as usize, j) * j as f64).sum(), 1e-12);
    }
    assert!(solver.reason()?.converged());
    assert_eq!(solver.iterations()?, 1);

    // A new matrix renews the factor.
    a.set_values(&values.iter().map(|v| 2.0 * v).collect::<Vec<_>>())?;
    let before = x.dot(&x)?;
    solver.solve(&b, &mut x)?;
    close(x.dot(&x)?, before / 4.0, 1e-13);
    Ok(())
}

fn cholesky_refuses_an_indefinite_matrix(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let (local, rows, columns, values) = string(&context, 30, -1.0);
    let mut a = Matrix::from_triplets(&context, local, &rows, &columns, &values)?;
    a.set_positive_definite()?;
    let mut solver = Ksp::new(&context, "")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    let refusal = solver.set_up();
    assert!(matches!(refusal, Err(Error::Singular(_))), "{refusal:?}");

    // The eigenvalues are 1 - 2 cos(k pi / 31), k = 1 to 30; ten are negative.
    let a = Matrix::from_triplets(&context, local, &rows, &columns, &values)?;
    context.default_option("count_mat_mumps_icntl_13", "1")?;
    context.default_option("count_mat_mumps_icntl_24", "1")?;
    let mut solver = Ksp::new(&context, "count_")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    solver.set_up()?;
    assert_eq!(solver.inertia()?, [10, 0, 20]);
    Ok(())
}

/// Held dofs stay, all others meet their equations, and equal held dofs give the same answer to the
/// bit whatever was held before.
fn multigrid_holds_dofs(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let (local, rows, columns, values) = string(&context, 40, 0.5);
    let whole = Matrix::from_triplets(&context, local, &rows, &columns, &values)?;
    let mut a = whole.duplicate()?;
    a.set_positive_definite()?;
    let range = a.range();
    // The coarse node J lies at the fine node 2 J + 1.
    let mine = (range.start + 1) / 2..(range.end + 1) / 2;
    let (mut rows, mut columns, mut values) = (vec![], vec![], vec![]);
    for j in mine.clone() {
        for (row, value) in [(2 * j, 0.5), (2 * j + 1, 1.0), (2 * j + 2, 0.5)] {
            rows.push(if row < 40 { row } else { -1 });
            columns.push(j);
            values.push(value);
        }
    }
    let mut p = Matrix::from_pattern(&context, [local, mine.len()], [rows, columns], None)?;
    p.set_values(&values)?;
    let p = p.without_triplets()?;
    let mut solver = Ksp::new(&context, "")?;
    let mut levels = solver.default_to_multigrid(&a, &[&p], Smoother::OfQuadrilaterals)?;
    solver.set_operator(&a)?;
    solver.set_from_options()?;
    solver.set_up()?;

    let mut answers = Vec::new();
    let sets: [&[Index]; 5] = [&[], &[7, 8, 30], &[8], &[7, 8, 30], &[]];
    for held in sets {
        let is_held = |row: &Index| held.contains(row);
        let own: Vec<usize> = range.clone().filter(is_held).map(|row| (row - range.start) as usize).collect();
        solver.hold(&mut a, &mut levels, &own)?;
        let (mut b, mut x, mut product) = (a.vector()?, a.vector()?, a.vector()?);
        let load = |row: Index| if is_held(&row) { 0.0 } else { f64::from(row + 1) };
        b.set_local(&range.clone().map(load).collect::<Vec<_>>())?;
        solver.solve(&b, &mut x)?;
        assert!(solver.iterations()? <= 20);
        whole.multiply(&x, &mut product)?;
        let x = x.to_vec()?;
        for ((row, x), product) in range.clone().zip(&x).zip(product.to_vec()?) {
            if is_held(&row) {
                close(*x, 0.0, 1e-15);
            } else {
                close(product, load(row), 1e-11);
            }
        }
        answers.push(x);
    }
    assert_eq!(answers[1], answers[3]);
    assert_eq!(answers[0], answers[4]);
    Ok(())
}
