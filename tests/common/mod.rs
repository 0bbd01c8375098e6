//! Tools that several tests share: seeded random numbers, forms from dense matrices, an independent
//! dense Cholesky solver, plates, scenes, the command, and ranks.
#![allow(dead_code, unused_imports)] // Each test program uses only a part.

pub mod branches;
pub mod clock;
pub mod command;
pub mod models;
pub mod momentum;
pub mod plates;
#[cfg(feature = "petsc")]
pub mod ranks;
pub mod scenes;

use rebond::linalg::{CellClass, ElementMatrix, Engine, Form, Native};
use rebond::random::SplitMix64;
use rebond::scheme::System;

/// Random numbers, the same sequence on every machine.
pub struct Random(SplitMix64);

impl Random {
    pub fn new(seed: u64) -> Random {
        Random(SplitMix64::new(seed))
    }

    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Returns a number that is uniform in (-1, 1).
    pub fn signed(&mut self) -> f64 {
        self.0.signed()
    }

    /// Returns a number that is uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0.unit()
    }

    /// Returns an integer in 0..n.
    pub fn below(&mut self, n: usize) -> usize {
        (self.bits() % n as u64) as usize
    }

    /// Returns an integer in -n..=n as a float.
    pub fn integer(&mut self, n: usize) -> f64 {
        self.below(2 * n + 1) as f64 - n as f64
    }
}

/// Returns an element matrix that is applied unchanged; `None` in `dofs` holds a dof at zero.
pub fn block(dofs: &[Option<usize>], matrix: &[f64], class: usize) -> ElementMatrix {
    assert_eq!(matrix.len(), dofs.len() * dofs.len());
    ElementMatrix { dofs: dofs.into(), matrix: matrix.into(), bending: None, class: CellClass::Plate(class) }
}

/// Returns a dense matrix, stored by rows, as a form of one element matrix.
pub fn dense_form(engine: &Native, size: usize, matrix: &[f64]) -> Form {
    let dofs: Vec<Option<usize>> = (0..size).map(Some).collect();
    engine.form(vec![block(&dofs, matrix, 0)])
}

/// Solves A x = b by a plain Cholesky factorisation, with A stored by rows. Returns `None` where A
/// is not positive definite.
pub fn solve_dense(matrix: &[f64], b: &[f64]) -> Option<Vec<f64>> {
    let n = b.len();
    let mut l = matrix.to_vec();
    for j in 0..n {
        for i in j..n {
            let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let rest = l[i * n + j] - dot;
            if i == j && (rest <= 0.0 || rest.is_nan()) {
                return None;
            }
            l[i * n + j] = if i == j { rest.sqrt() } else { rest / l[j * n + j] };
        }
    }
    let mut x = b.to_vec();
    for i in 0..n {
        let dot: f64 = (0..i).map(|k| l[i * n + k] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k * n + i] * x[k]).sum();
        x[i] = (x[i] - dot) / l[i * n + i];
    }
    Some(x)
}

/// Returns A x for a dense A stored by rows.
pub fn multiply(matrix: &[f64], x: &[f64]) -> Vec<f64> {
    matrix.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
}

/// Returns a submatrix of a dense matrix of `size` rows.
pub fn submatrix(matrix: &[f64], size: usize, rows: &[usize], columns: &[usize]) -> Vec<f64> {
    rows.iter().flat_map(|&i| columns.iter().map(move |&j| matrix[i * size + j])).collect()
}

/// Returns a random symmetric positive definite matrix, stored by rows, of condition number about
/// `10^decades`. Its eigenvalues are spread evenly over the decades and rotated by random
/// reflections.
pub fn random_spd(random: &mut Random, size: usize, decades: f64) -> Vec<f64> {
    let mut a = vec![0.0; size * size];
    for i in 0..size {
        let share = if size > 1 { i as f64 / (size - 1) as f64 } else { 0.5 };
        a[i * size + i] = 10f64.powf(decades * (share - 0.5));
    }
    for _ in 0..3 {
        let v: Vec<f64> = (0..size).map(|_| random.signed()).collect();
        let norm: f64 = v.iter().map(|v| v * v).sum();
        // A <- H A H with H = I - 2 v v^T / |v|^2.
        let av = multiply(&a, &v);
        let vav: f64 = v.iter().zip(&av).map(|(v, w)| v * w).sum();
        for i in 0..size {
            for j in 0..size {
                a[i * size + j] +=
                    -2.0 / norm * (v[i] * av[j] + av[i] * v[j]) + 4.0 * vav / (norm * norm) * v[i] * v[j];
            }
        }
    }
    for i in 0..size {
        for j in 0..i {
            a[i * size + j] = a[j * size + i];
        }
    }
    a
}

/// Returns the largest magnitude of an entry.
pub fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m: f64, v| if v.is_nan() || v.abs() > m { v.abs() } else { m })
}

/// Returns the largest difference between corresponding entries.
pub fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    largest(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>())
}

/// Returns the shortest W with C^-1 B W = v, up to rounding.
pub fn lift(system: &System<Native>, v: &[f64]) -> Vec<f64> {
    let System { engine, mass, .. } = system;
    let mut unit = vec![0.0; engine.dofs()];
    let mut matrix = faer::Mat::zeros(v.len(), unit.len());
    for dof in 0..unit.len() {
        unit[dof] = 1.0;
        engine.project(mass, &unit, matrix.col_as_slice_mut(dof)).unwrap();
        unit[dof] = 0.0;
    }
    let lifted = matrix.thin_svd().unwrap().pseudoinverse() * faer::ColRef::from_slice(v);
    lifted.iter().copied().collect()
}
