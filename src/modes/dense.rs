//! All modes with inertia of a small system, by dense matrices.

use super::blocks::multiply;
use crate::error::Result;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::{Engine, Form, MassModes, Native};
use faer::{Mat, Side};

/// Share of the largest modal mass per stiffness that counts as none.
const MASSLESS: f64 = 1e-13;
/// Difference of two modal masses per stiffness, relative to the largest one, from which on the
/// modes are told apart.
const APART: f64 = 1e-12;
/// Largest amount by which the modes may miss their equations, relative to the stiffness.
const MAX_DEFECT: f64 = 1e-9;

/// Computes all modes of `$K \Phi = M \Phi\, \Omega^2$` that have inertia. With the paper's
/// singular mass there are no more of them than cells. Returns `None` where K is singular to
/// rounding, or rounding spoils the modes.
///
/// # Errors
/// Returns the errors of the dense eigenvalues.
pub(crate) fn modes_with_mass(engine: &Native, stiffness: &Form, mass: &Form) -> Result<Option<MassModes>> {
    let dofs = engine.dofs();
    let Ok(root) = dense(dofs, stiffness).llt(Side::Lower) else { return Ok(None) };
    // The modes are L^-T times the eigenvectors of L^-1 M L^-T, with K of unit size.
    let mut reduced = dense(dofs, mass);
    root.L().solve_lower_triangular_in_place(reduced.as_mut());
    let mut reduced = reduced.transpose().to_owned();
    root.L().solve_lower_triangular_in_place(reduced.as_mut());
    let (_, mut shapes) = symmetric_eigen(reduced.as_ref())?;
    root.L().transpose().solve_upper_triangular_in_place(shapes.as_mut());
    let masses = refine(engine, stiffness, mass, &mut shapes)?;
    let largest = masses.last().copied().unwrap_or(0.0);
    let massive: Vec<usize> = (0..dofs).rev().filter(|&k| masses[k] > MASSLESS * largest).collect();
    let shapes =
        Mat::from_fn(dofs, massive.len(), |i, k| shapes[(i, massive[k])] / masses[massive[k]].sqrt());
    let momenta = multiply(engine, mass, &shapes)?.0;
    let squares: Vec<f64> = massive.iter().map(|&k| 1.0 / masses[k]).collect();
    let forces = multiply(engine, stiffness, &shapes)?.0;
    let size = |k: usize| squares[k].sqrt();
    let energies = shapes.transpose() * forces;
    let fits = |i: usize, j: usize| {
        let wanted = if i == j { squares[j] } else { 0.0 };
        (energies[(i, j)] - wanted).abs() <= MAX_DEFECT * size(i) * size(j)
    };
    let all_fit = (0..squares.len()).all(|j| (0..=j).all(|i| fits(i, j)));
    Ok(all_fit.then_some(MassModes { squares, shapes, momenta, key: None }))
}

/// Corrects the rounding of eigenvectors once, from their products with both matrices (Ogita and
/// Aishima, Japan Journal of Industrial and Applied Mathematics 35, 2018, 1007-1035). Returns the
/// modal masses per stiffness.
fn refine(engine: &Native, stiffness: &Form, mass: &Form, shapes: &mut Mat<f64>) -> Result<Vec<f64>> {
    let size = shapes.ncols();
    let of_stiffness = shapes.transpose() * multiply(engine, stiffness, shapes)?.0;
    let of_mass = shapes.transpose() * multiply(engine, mass, shapes)?.0;
    let masses: Vec<f64> = (0..size).map(|k| of_mass[(k, k)] / of_stiffness[(k, k)]).collect();
    let largest = masses.iter().copied().fold(0.0, f64::max);
    let correction = Mat::from_fn(size, size, |i, j| {
        let missing = f64::from(i == j) - 0.5 * (of_stiffness[(i, j)] + of_stiffness[(j, i)]);
        let apart = masses[j] - masses[i];
        match apart.abs() > APART * largest {
            true => (0.5 * (of_mass[(i, j)] + of_mass[(j, i)]) + masses[j] * missing) / apart,
            false => 0.5 * missing,
        }
    });
    let corrected = &*shapes + &*shapes * correction;
    *shapes = corrected;
    Ok(masses)
}

/// Returns the dense matrix of a form.
fn dense(dofs: usize, form: &Form) -> Mat<f64> {
    let mut matrix = Mat::zeros(dofs, dofs);
    form.for_each_lower(|row, column, entry| matrix[(row, column)] += entry);
    for column in 0..dofs {
        for row in 0..column {
            matrix[(row, column)] = matrix[(column, row)];
        }
    }
    matrix
}
