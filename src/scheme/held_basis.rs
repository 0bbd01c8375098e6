//! Coordinates in which the matrices of a small system are nearly diagonal.
//!
//! The coordinates are the deflections c of the bounded dofs and the amplitudes of all modes of the
//! system with these dofs held (the component modes of Craig and Bampton, AIAA Journal 6 (1968)
//! 1313-1319, none of them left out):
//!
//! ```math
//! U = T \begin{pmatrix} c \\ \eta \end{pmatrix}, \qquad
//! T^T K T = \begin{pmatrix} K_c & 0 \\ 0 & I \end{pmatrix}, \qquad
//! T^T M T = \begin{pmatrix} M_c & m^T \\ m & \mu \end{pmatrix},
//! ```
//!
//! with a diagonal matrix `$\mu$`. A scheme does in these coordinates what it does with the dofs of
//! the mesh, but for rounding, and a step takes products with a few dozen numbers instead of
//! products with all cells. Bounds and reactions are the same.
//!
//! With the paper's singular mass no more entries of `$\mu$` are not zero than there are cells.
//! All other modes have the same equation, without inertia and coupled to nothing. Where loads keep
//! their distribution, these modes move along few directions, and only as many coordinates are
//! kept.

use super::{Start, System};
use crate::error::Result;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{ElementMatrix, Engine, Form, Native};
use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Largest number of dofs and of bounds for which the coordinates pay.
const MOST_DOFS: usize = 256;
const MOST_BOUNDS: usize = 12;
/// Number of coordinates that a block of a matrix has, as a quadrilateral has dofs.
const BLOCK: usize = 12;
/// Largest product of two columns with K that counts as zero, relative to their norms.
const ORTHOGONAL: f64 = 1e-9;
/// Share of the largest mass of a mode that counts as none.
const MASSLESS: f64 = 1e-13;
/// Share of a vector beyond some directions that counts as rounding.
const SAME: f64 = 1e-11;

/// Coordinates of a small system; see the [module page](self).
pub struct HeldBasis {
    /// Stiffness and mass in these coordinates.
    pub(super) stiffness: Form,
    pub(super) mass: Form,
    /// Displacements T, one column per coordinate.
    columns: Mat<f64>,
    /// Forces K T, one column per coordinate.
    forces: Mat<f64>,
    /// Stiffness of each coordinate alone.
    stiffnesses: Vec<f64>,
    /// Bounded dofs.
    bounded: Vec<usize>,
    /// All modes without mass and the directions among them that are kept, one column each; `None`
    /// where all are kept.
    massless: Option<[Mat<f64>; 2]>,
}

impl HeldBasis {
    /// Computes the coordinates of a system, for starts along that of one run, or for any start.
    /// Returns `None` where they would not pay, where the held system has rigid motions, or where
    /// rounding spoils them.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the dense eigenvalues.
    pub fn new(system: &System<Native>, start: Option<&Start>) -> Result<Option<HeldBasis>> {
        let System { engine, bounds, stiffness: k, mass: m, .. } = system;
        let (dofs, bounded) = (engine.dofs(), &bounds.dofs);
        let is_small = dofs <= MOST_DOFS && bounded.len() <= MOST_BOUNDS && bounded.len() < dofs;
        if !is_small || matches!(m, Form::Modal { .. }) {
            return Ok(None);
        }
        let Some((mut columns, masses)) = columns(dofs, bounded, k, m)? else { return Ok(None) };
        let first = bounded.len();
        let massive = first + masses.iter().filter(|mass| **mass > MASSLESS * masses[0]).count();
        let mut massless = None;
        if let Some(start) = start.filter(|_| system.drive.load.is_none()) {
            let modes = columns.subcols(massive, dofs - massive).to_owned();
            let motions = motions(system, start, &columns.subcols(0, first).to_owned())?;
            let kept = directions(&modes, &motions);
            let along = &modes * &kept;
            columns = Mat::from_fn(dofs, massive + kept.ncols(), |i, j| match j.checked_sub(massive) {
                Some(j) => along[(i, j)],
                None => columns[(i, j)],
            });
            massless = Some([modes, kept]);
        }
        let size = columns.ncols();
        let (mut forces, mut momenta) = (Mat::zeros(dofs, size), Mat::zeros(dofs, size));
        for j in 0..size {
            engine.multiply(k, columns.col_as_slice(j), forces.col_as_slice_mut(j))?;
            engine.multiply(m, columns.col_as_slice(j), momenta.col_as_slice_mut(j))?;
        }
        let (stiffness, mass) = (columns.transpose() * &forces, columns.transpose() * &momenta);
        if !(is_diagonal_beyond(&stiffness, first, 0) && is_diagonal_beyond(&mass, first, first)) {
            return Ok(None);
        }
        let one = Native::new(size);
        Ok(Some(HeldBasis {
            stiffness: one.form(blocks(&stiffness, first, size, false)),
            mass: one.form(blocks(&mass, first, massive, true)),
            stiffnesses: (0..size).map(|k| stiffness[(k, k)]).collect(),
            columns,
            forces,
            bounded: bounded.clone(),
            massless,
        }))
    }

    /// Returns the number of coordinates.
    pub fn size(&self) -> usize {
        self.columns.ncols()
    }

    /// Returns whether all motions of a system from a start are along the coordinates.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn spans(&self, system: &System<Native>, start: &Start) -> Result<bool> {
        let Some([modes, kept]) = &self.massless else { return Ok(true) };
        if system.drive.load.is_some() {
            return Ok(false);
        }
        let followed = self.columns.subcols(0, self.bounded.len()).to_owned();
        let motions = motions(system, start, &followed)?;
        Ok(motions.iter().all(|motion| {
            let [whole, rest] = beyond(modes, kept, motion);
            rest <= SAME * whole
        }))
    }

    /// Returns the coordinates of a displacement.
    pub fn coordinates(&self, u: &[f64]) -> Vec<f64> {
        let mut coordinates: Vec<f64> = self.bounded.iter().map(|&dof| u[dof]).collect();
        let mut rest = u.to_vec();
        for (j, value) in coordinates.iter().enumerate() {
            axpy(-value, self.columns.col_as_slice(j), &mut rest);
        }
        let modes = coordinates.len()..self.size();
        coordinates.extend(modes.map(|k| dot(self.forces.col_as_slice(k), &rest) / self.stiffnesses[k]));
        coordinates
    }

    /// Returns the forces on the coordinates, given those on the dofs.
    pub fn force(&self, force: &[f64]) -> Vec<f64> {
        (0..self.size()).map(|j| dot(self.columns.col_as_slice(j), force)).collect()
    }

    /// Returns the displacement of given coordinates.
    pub fn displacement(&self, coordinates: &[f64]) -> Vec<f64> {
        let mut u = vec![0.0; self.columns.nrows()];
        for (j, value) in coordinates.iter().enumerate() {
            axpy(*value, self.columns.col_as_slice(j), &mut u);
        }
        u
    }

    /// Returns the displacement of one dof, given the values of the coordinates.
    pub fn displacement_of(&self, dof: usize, coordinate: impl Fn(usize) -> f64) -> f64 {
        match self.bounded.binary_search(&dof) {
            Ok(bound) => coordinate(bound),
            Err(_) => {
                (0..self.columns.ncols()).fold(0.0, |sum, j| sum + coordinate(j) * self.columns[(dof, j)])
            }
        }
    }
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

/// Returns the forces whose response makes the modes without mass move: those of loads, and those
/// that hold the start. `followed` are the displacements that follow each bounded one.
fn motions(system: &System<Native>, start: &Start, followed: &Mat<f64>) -> Result<Vec<Vec<f64>>> {
    let System { engine, stiffness, bounds, drive, load, .. } = system;
    let mut motions: Vec<Vec<f64>> = load.iter().cloned().collect();
    motions.extend(drive.terms.iter().map(|term| term.load.clone()));
    for of in [&start.displacement, &start.velocity] {
        let mut rest = of.clone();
        for (j, &dof) in bounds.dofs.iter().enumerate() {
            axpy(-of[dof], followed.col_as_slice(j), &mut rest);
        }
        let mut force = vec![0.0; rest.len()];
        engine.multiply(stiffness, &rest, &mut force)?;
        motions.push(force);
    }
    Ok(motions)
}

/// Returns the norms of the forces on some modes, and of their part beyond the kept directions.
fn beyond(modes: &Mat<f64>, kept: &Mat<f64>, force: &[f64]) -> [f64; 2] {
    let mut rest: Vec<f64> = (0..modes.ncols()).map(|k| dot(modes.col_as_slice(k), force)).collect();
    let whole = dot(&rest, &rest).sqrt();
    subtract_directions(kept, &mut rest);
    [whole, dot(&rest, &rest).sqrt()]
}

/// Subtracts the part of a vector along orthonormal directions.
fn subtract_directions(kept: &Mat<f64>, vector: &mut [f64]) {
    for j in 0..kept.ncols() {
        let along = dot(kept.col_as_slice(j), vector);
        axpy(-along, kept.col_as_slice(j), vector);
    }
}

/// Returns orthonormal directions among some modes along which forces act (Gram and Schmidt).
fn directions(modes: &Mat<f64>, forces: &[Vec<f64>]) -> Mat<f64> {
    let mut kept: Mat<f64> = Mat::zeros(modes.ncols(), 0);
    for force in forces {
        let mut rest: Vec<f64> = (0..modes.ncols()).map(|k| dot(modes.col_as_slice(k), force)).collect();
        let whole = dot(&rest, &rest).sqrt();
        // Twice is enough.
        subtract_directions(&kept, &mut rest);
        subtract_directions(&kept, &mut rest);
        let norm = dot(&rest, &rest).sqrt();
        if norm > SAME * whole {
            let known = kept;
            kept = Mat::from_fn(modes.ncols(), known.ncols() + 1, |i, j| {
                if j < known.ncols() { known[(i, j)] } else { rest[i] / norm }
            });
        }
    }
    kept
}

/// Returns the displacements per unit of each coordinate, and the masses of the modes, descending;
/// `None` where the held system has rigid motions.
fn columns(dofs: usize, bounded: &[usize], k: &Form, m: &Form) -> Result<Option<(Mat<f64>, Vec<f64>)>> {
    let free: Vec<usize> = (0..dofs).filter(|dof| bounded.binary_search(dof).is_err()).collect();
    let (k, m) = (dense(dofs, k), dense(dofs, m));
    let block = |of: &Mat<f64>, columns: &[usize]| {
        Mat::from_fn(free.len(), columns.len(), |i, j| of[(free[i], columns[j])])
    };
    let Ok(root) = block(&k, &free).llt(Side::Lower) else { return Ok(None) };
    // The modes are L^-T times the eigenvectors of L^-1 M L^-T, those with the largest mass first.
    let mut reduced = block(&m, &free);
    root.L().solve_lower_triangular_in_place(reduced.as_mut());
    let mut reduced = reduced.transpose().to_owned();
    root.L().solve_lower_triangular_in_place(reduced.as_mut());
    let (mut masses, mut modes) = symmetric_eigen(reduced.as_ref())?;
    root.L().transpose().solve_upper_triangular_in_place(modes.as_mut());
    let mut followed = block(&k, bounded);
    root.solve_in_place(&mut followed);
    let mut columns = Mat::zeros(dofs, dofs);
    for (j, &dof) in bounded.iter().enumerate() {
        columns[(dof, j)] = 1.0;
        free.iter().enumerate().for_each(|(i, &dof)| columns[(dof, j)] = -followed[(i, j)]);
    }
    for j in 0..free.len() {
        let mode = free.len() - 1 - j;
        free.iter().enumerate().for_each(|(i, &dof)| columns[(dof, bounded.len() + j)] = modes[(i, mode)]);
    }
    masses.reverse();
    Ok(Some((columns, masses)))
}

/// Returns whether a matrix is diagonal but for rounding, apart from its first `whole` rows and
/// columns, of which those after the first `coupled` must vanish beyond the block.
fn is_diagonal_beyond(matrix: &Mat<f64>, whole: usize, coupled: usize) -> bool {
    let largest = (whole..matrix.nrows()).map(|k| matrix[(k, k)].abs()).fold(0.0, f64::max);
    let size = |k: usize| if k < whole { matrix[(k, k)].abs().sqrt() } else { largest.sqrt() };
    (whole..matrix.nrows())
        .all(|j| (coupled..j).all(|i| matrix[(i, j)].abs() <= ORTHOGONAL * size(i) * size(j)))
}

/// Returns a matrix that is diagonal apart from its first rows and columns in blocks: that of the
/// first coordinates, and those of the others up to an end, with their coupling to the first ones
/// or without.
fn blocks(matrix: &Mat<f64>, first: usize, end: usize, is_coupled: bool) -> Vec<ElementMatrix> {
    let others: Vec<usize> = (first..end).collect();
    let held: Vec<usize> = (0..first).collect();
    let led: &[usize] = if is_coupled { &held } else { &[] };
    let room = BLOCK.saturating_sub(led.len()).max(BLOCK / 3);
    let block = |rows: Vec<usize>, entry: &dyn Fn(usize, usize) -> f64| {
        let matrix: Vec<f64> =
            rows.iter().flat_map(|&i| rows.iter().map(move |&j| (i, j))).map(|(i, j)| entry(i, j)).collect();
        (rows, matrix)
    };
    let mut all = Vec::new();
    if first > 0 {
        all.push(block(held.clone(), &|i, j| 0.5 * (matrix[(i, j)] + matrix[(j, i)])));
    }
    for modes in others.chunks(room) {
        let rows = led.iter().chain(modes).copied().collect();
        all.push(block(rows, &|i, j| match (i < first, j < first) {
            (true, true) => 0.0,
            (false, false) if i != j => 0.0,
            _ => 0.5 * (matrix[(i, j)] + matrix[(j, i)]),
        }));
    }
    let cell = |(class, (rows, matrix)): (usize, (Vec<usize>, Vec<f64>))| ElementMatrix {
        dofs: rows.into_iter().map(Some).collect(),
        matrix: matrix.into(),
        bending: None,
        class,
    };
    all.into_iter().enumerate().map(cell).collect()
}
