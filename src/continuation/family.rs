//! Family of periodic motions with one parameter: equations for their unknowns.

use super::orbit::Orbit;
use crate::error::{Error, Result};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Family of periodic motions. Its unknowns are the modal coordinates and their rates at the start
/// of the period, and what varies along the branch; there is one equation less.
pub trait Family {
    /// Returns the unknowns of a first motion, or of one near it.
    ///
    /// # Errors
    /// Returns the errors of the return map.
    fn begin(&mut self) -> Result<Vec<f64>>;

    /// Evaluates the equations, which hold for periodic motions.
    ///
    /// # Errors
    /// Returns the errors of the return map.
    fn equations(&mut self, unknowns: &[f64]) -> Result<ShootingEquations>;

    /// Returns the magnitudes of the unknowns, by which changes of them are compared.
    fn magnitudes(&self, unknowns: &[f64]) -> Vec<f64>;

    /// Receives the motion that the next ones are compared with.
    ///
    /// # Errors
    /// Returns the errors of the return map.
    fn accept(&mut self, unknowns: &[f64]) -> Result<()>;

    /// Returns the parameter over which the branch is told, of a motion.
    fn parameter(&self, unknowns: &[f64], orbit: &Orbit) -> f64;

    /// Returns the index of the unknown that is held in the search for the first motion.
    fn held(&self) -> usize;

    /// Returns whether the branch may turn back at a fold of the held unknown.
    fn folds(&self) -> bool;
}

/// Equations at some unknowns, and the motion there.
pub struct ShootingEquations {
    /// Residuals, in one unit.
    pub residuals: Vec<f64>,
    /// Derivatives of the residuals, one column per unknown.
    pub jacobian: Mat<f64>,
    /// Size of a residual that counts as one.
    pub scale: f64,
    pub orbit: Orbit,
}

impl ShootingEquations {
    /// Returns the size of the residuals.
    pub fn error(&self) -> f64 {
        self.residuals.iter().map(|residual| residual * residual).sum::<f64>().sqrt() / self.scale
    }

    /// Solves the linearised equations with one more row: for minus the residuals and 0 there, and
    /// for no residuals and 1 there. The unknowns are counted in their magnitudes.
    pub fn solve(&self, magnitudes: &[f64], row: &[f64]) -> Result<[Vec<f64>; 2]> {
        let size = row.len();
        let matrix = Mat::from_fn(size, size, |i, j| match i + 1 == size {
            true => row[j],
            false => self.jacobian[(i, j)] * magnitudes[j] / self.scale,
        });
        let mut columns = Mat::from_fn(size, 2, |i, k| match (k, i + 1 == size) {
            (0, false) => -self.residuals[i] / self.scale,
            (1, true) => 1.0,
            _ => 0.0,
        });
        matrix.partial_piv_lu().solve_in_place(&mut columns);
        let [change, along] = [0, 1].map(|k| columns.col_as_slice(k).to_vec());
        match change.iter().chain(&along).all(|value| value.is_finite()) {
            true => Ok([change, along]),
            false => Err(Error::Singular("the equations of a periodic motion have no solution".into())),
        }
    }
}
