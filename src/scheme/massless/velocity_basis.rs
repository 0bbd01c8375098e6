//! Orthonormal coordinates of the velocities that displacements can attain.
//!
//! The coordinates are `$z = Q^T C^{1/2} p$` with orthonormal columns of Q. Q is the identity
//! unless B has no full row rank: on a uniform grid clamped all around, no displacement has the
//! cell means of a checkerboard. No motion has that component, and Q spans the rest.

use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::hadamard;
use crate::scheme::System;
use faer::linalg::solvers::Llt;
use faer::{Mat, Side as Triangle};

/// Relative compliance below which a velocity counts as unattainable.
const MIN_COMPLIANCE: f64 = 1e-10;

/// Basis of the attainable velocities; see the [module page](self).
#[derive(Debug)]
pub(in crate::scheme) struct VelocityBasis {
    /// Diagonal of C^1/2, N entries.
    root_mass: Vec<f64>,
    /// Basis Q, N x r; `None` for the identity.
    span: Option<Mat<f64>>,
}

impl VelocityBasis {
    /// Builds the basis of all velocities.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] for a consistent mass.
    pub fn new<E: Engine>(system: &System<E>) -> Result<VelocityBasis> {
        let System { engine, mass, .. } = system;
        let mut unit = vec![0.0; engine.velocities(mass)];
        // The entries of C are the kinetic energies of unit velocities.
        let mut entries = Vec::with_capacity(unit.len());
        for k in 0..unit.len() {
            unit[k] = 1.0;
            entries.push(engine.mass_norm_squared(mass, &unit)?);
            unit[k] = 0.0;
        }
        // Coupled velocities are those of a consistent mass.
        let ones = vec![1.0; entries.len()];
        let (whole, sum) = (engine.mass_norm_squared(mass, &ones)?, entries.iter().sum::<f64>());
        if (whole - sum).abs() > 1e-9 * sum {
            return Err(Error::Singular(
                "time.scheme = \"exact\" needs time.mass = \"singular\"; with the consistent mass set time.scheme = \"newmark\""
                    .into(),
            ));
        }
        Ok(VelocityBasis { root_mass: entries.into_iter().map(f64::sqrt).collect(), span: None })
    }

    /// Removes the velocities that B cannot attain, given the matrix `$\tilde B A^{-1} \tilde B^T$`
    /// of all velocities with A positive definite. Returns the Cholesky factor in the remaining
    /// coordinates, `None` if there are none.
    pub fn reduce(&mut self, compliance: &Mat<f64>) -> Option<Llt<f64>> {
        let largest = (0..compliance.nrows()).map(|k| compliance[(k, k)]).fold(0.0, f64::max);
        let pivot = |llt: &Llt<f64>, k: usize| llt.L()[(k, k)].powi(2);
        let whole = compliance.llt(Triangle::Lower).ok();
        if let Some(llt) =
            whole.filter(|llt| (0..self.size()).all(|k| pivot(llt, k) > MIN_COMPLIANCE * largest))
        {
            return Some(llt);
        }
        let (_, vectors) = symmetric_eigen(compliance.as_ref()).ok()?;
        let image = compliance * &vectors;
        let given: Vec<usize> = (0..vectors.ncols())
            .filter(|&k| vectors.col(k).transpose() * image.col(k) > MIN_COMPLIANCE * largest)
            .collect();
        let span = Mat::from_fn(vectors.nrows(), given.len(), |i, k| vectors[(i, given[k])]);
        let llt = (span.transpose() * compliance * &span).llt(Triangle::Lower).ok();
        self.span = Some(span);
        llt
    }

    /// Returns the number of coordinates.
    pub fn size(&self) -> usize {
        self.span.as_ref().map_or(self.root_mass.len(), Mat::ncols)
    }

    /// Returns the coordinates of the cell means of displacements (n x k).
    pub fn of<E: Engine>(&self, system: &System<E>, displacements: &Mat<f64>) -> Result<Mat<f64>> {
        let mut means = Mat::zeros(self.root_mass.len(), displacements.ncols());
        for j in 0..displacements.ncols() {
            let column = means.col_as_slice_mut(j);
            system.engine.project(&system.mass, displacements.col_as_slice(j), column)?;
            hadamard(&self.root_mass, column);
        }
        Ok(self.narrow(means))
    }

    /// Returns the product of Q^T with columns.
    pub fn narrow(&self, columns: Mat<f64>) -> Mat<f64> {
        match &self.span {
            Some(span) => span.transpose() * columns,
            None => columns,
        }
    }

    /// Returns the velocity with the coordinates z, one entry per cell.
    pub fn velocity(&self, z: &[f64]) -> Vec<f64> {
        let over_root =
            |velocities: &[f64]| velocities.iter().zip(&self.root_mass).map(|(v, c)| v / c).collect();
        match &self.span {
            Some(span) => over_root((span * Mat::from_fn(z.len(), 1, |k, _| z[k])).col_as_slice(0)),
            None => over_root(z),
        }
    }

    /// Sets `forces` to the product of `$\tilde B^T$` with z, n entries.
    pub fn momentum<E: Engine>(&self, system: &System<E>, z: &[f64], forces: &mut [f64]) -> Result<()> {
        system.engine.project_transpose(&system.mass, &self.velocity(z), forces)
    }
}
