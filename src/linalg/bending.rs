//! Products and strains of the factored stiffness of one cell, a row at a time.

use super::vectors::{axpy, dot};
use crate::kernels::Bending;
use crate::kernels::double_double::DoubleDouble;

impl Bending {
    /// Returns the columns of R extended to all dofs of the cell, in double-double arithmetic.
    pub(super) fn strains(&self) -> Vec<Vec<DoubleDouble>> {
        let size = 3 * self.arms.len();
        let entries = |column: usize| self.root.iter().skip(column).step_by(size);
        let mut strains: Vec<Vec<DoubleDouble>> = vec![vec![DoubleDouble::default(); size]; 3];
        strains.extend((0..size).map(|column| entries(column).map(|&r| r.into()).collect()));
        // Rigid motions make no strain, so the first node's columns balance the others.
        for (k, arm) in self.arms.iter().enumerate() {
            for row in 0..size {
                let [w, slope_x, slope_y] = [0, 1, 2].map(|dof| strains[3 * (k + 1) + dof][row]);
                let lever = [w * arm[0].into(), w * arm[1].into()];
                strains[0][row] = strains[0][row] - w;
                strains[1][row] = strains[1][row] - (slope_x + lever[0]);
                strains[2][row] = strains[2][row] - (slope_y + lever[1]);
            }
        }
        strains
    }

    /// Returns the form's product with the values of all dofs of the cell, one force per dof.
    pub fn product(&self, values: &[f64]) -> Vec<f64> {
        let [w, slope_x, slope_y] = [values[0], values[1], values[2]];
        let mut bent = values[3..].to_vec();
        for (node, [x, y]) in bent.chunks_exact_mut(3).zip(&self.arms) {
            node[0] = (node[0] - w) - (slope_x * x + slope_y * y);
            node[1] -= slope_x;
            node[2] -= slope_y;
        }
        let mut force = vec![0.0; values.len()];
        for row in self.root.chunks_exact(bent.len()) {
            axpy(dot(row, &bent), row, &mut force[3..]);
        }
        for (k, [x, y]) in self.arms.iter().enumerate() {
            let node = [force[3 * k + 3], force[3 * k + 4], force[3 * k + 5]];
            force[0] -= node[0];
            force[1] -= node[1] + node[0] * x;
            force[2] -= node[2] + node[0] * y;
        }
        force
    }
}
