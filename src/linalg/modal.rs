//! Singular mass of the lowest natural modes.
//!
//! With m modes `$\Phi$`, orthonormal in the consistent mass, `$\Phi^T M_r \Phi = 1$`,
//!
//! ```math
//! M = B^T C^{-1} B, \qquad B = \Phi^T M_r, \quad C = 1 .
//! ```
//!
//! Only the modes carry inertia; the rest of the displacement answers at once, as in statics. The
//! mass has rank m on any mesh, and its fastest motion is set by m and not by the cells. The modes
//! have the velocities `$V = B \dot U$`, in m/s times the root of kg.

use super::vectors::{axpy, dot};
use faer::Mat;

/// Modes that carry all inertia, see the [module page](self).
#[derive(Debug)]
pub struct MassModes {
    /// Squares of the angular frequencies, ascending, in (rad/s)^2; 0 for rigid motions.
    pub squares: Vec<f64>,
    /// Mode shapes, one column per mode with one entry per dof of this rank.
    pub shapes: Mat<f64>,
    /// Products of the consistent mass and the mode shapes, in columns.
    pub momenta: Mat<f64>,
    /// Hash of all that determines the modes, where they are kept between runs.
    pub key: Option<u128>,
}

impl MassModes {
    /// Returns the number of modes.
    pub fn count(&self) -> usize {
        self.squares.len()
    }

    /// Computes this rank's part of the velocities V = B x.
    pub(crate) fn project(&self, x: &[f64], v: &mut [f64]) {
        for (k, v) in v.iter_mut().enumerate() {
            *v = dot(self.momenta.col_as_slice(k), x);
        }
    }

    /// Adds the displacement of modal coordinates to `u`, one entry per dof of this rank.
    pub(crate) fn add_shapes(&self, coordinates: &[f64], u: &mut [f64]) {
        for (k, q) in coordinates.iter().enumerate() {
            axpy(*q, self.shapes.col_as_slice(k), u);
        }
    }

    /// Computes the momentum `$y = B^T V$`, in kg m/s, one entry per dof of this rank.
    pub(crate) fn project_transpose(&self, v: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for (k, v) in v.iter().enumerate() {
            axpy(*v, self.momenta.col_as_slice(k), y);
        }
    }
}
