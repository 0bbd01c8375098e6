//! Compliance of the massless rest in contact.

use crate::error::{Error, Result};
use crate::linalg::eigen::symmetric_eigen;
use crate::scheme::exact::reduction::remains;
use faer::{Mat, Side};
use std::f64::consts::TAU;

/// Compliance of the massless rest at some deflections, and the fastest motion that follows.
///
/// While all of these deflections are held by obstacles, the modes move with the stiffness
///
/// ```math
/// K_a = \Omega^2 + A^T R^{-1} A, \qquad A = G \Phi ,
/// ```
///
/// with the compliance R of the rest of the displacement. The reactions are unique if R is positive
/// definite; this takes the place of the inf-sup condition of velocities in cells. Each mode j that
/// is not kept adds `$A_j A_j^T / w_j^2$` to R, so that R shrinks with the number of modes.
#[derive(Debug, Clone)]
pub struct ContactCompliance {
    /// Compliance R, in m/N, one row and column per deflection.
    pub compliance: Mat<f64>,
    /// Deflections A of the modes, one row per deflection and one column per mode.
    pub shapes: Mat<f64>,
    /// Squares of the angular frequencies of the modes, in (rad/s)^2; 0 for rigid motions.
    pub squares: Vec<f64>,
}

impl ContactCompliance {
    /// Returns the smallest and the largest eigenvalue of R, in m/N.
    ///
    /// # Errors
    /// Returns the errors of the dense eigenvalues.
    pub fn extremes(&self) -> Result<[f64; 2]> {
        let (values, _) = symmetric_eigen(self.compliance.as_ref())?;
        Ok([values.first().copied().unwrap_or(0.0), values.last().copied().unwrap_or(0.0)])
    }

    /// Returns whether R is positive definite, but for rounding.
    pub fn is_definite(&self) -> bool {
        self.is_definite_with(self.squares.len())
    }

    /// Returns the largest number of modes, rigid motions included and no more than those given,
    /// with which R is positive definite.
    pub fn most_modes(&self) -> usize {
        let counts: Vec<usize> = (0..=self.squares.len()).collect();
        counts.partition_point(|&count| self.is_definite_with(count)).saturating_sub(1)
    }

    /// Returns the error of so many modes that R is not positive definite.
    pub fn refusal(&self) -> Error {
        let (modes, nodes) = (self.squares.len(), self.compliance.nrows());
        let rigid = self.squares.iter().filter(|square| **square == 0.0).count();
        let most = self.most_modes().min(modes.saturating_sub(1));
        Error::Usage(format!(
            "time.modes = {modes}: so many modes leave the {nodes} nodes in contact no compliance of their own; {}",
            match most > rigid {
                true => format!("expected at most {most} modes"),
                false => "fewer contain no vibration; expected a finer mesh or another time.mass".into(),
            }
        ))
    }

    /// Returns whether R of the first modes alone is positive definite: its pivots are those of the
    /// compliance of all elastic modes, but for a part.
    fn is_definite_with(&self, count: usize) -> bool {
        remains(&self.compliance_beyond(count), &self.compliance_beyond(0))
    }

    /// Returns the compliance of the rest and of all elastic modes but the first ones.
    fn compliance_beyond(&self, count: usize) -> Mat<f64> {
        let mut sum = self.compliance.clone();
        let elastic = (count..self.squares.len()).filter(|&k| self.squares[k] > 0.0);
        for k in elastic {
            let column = self.shapes.col(k);
            sum += (column * column.transpose()) * faer::Scale(1.0 / self.squares[k]);
        }
        sum
    }

    /// Returns the highest frequency while all these deflections are in contact, in Hz.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where R is not positive definite, and the errors of the dense
    /// eigenvalues.
    pub fn fastest(&self) -> Result<f64> {
        let rigid = |_| Error::Singular("the rest of the plate has no compliance at the contact".into());
        let root = self.compliance.llt(Side::Lower).map_err(rigid)?;
        let mut half = self.shapes.clone();
        root.L().solve_lower_triangular_in_place(half.as_mut());
        let mut stiffness = half.transpose() * &half;
        for (k, square) in self.squares.iter().enumerate() {
            stiffness[(k, k)] += square;
        }
        let (values, _) = symmetric_eigen(stiffness.as_ref())?;
        Ok(values.last().map_or(0.0, |largest| largest.max(0.0).sqrt()) / TAU)
    }
}
