//! Geometric stiffness of membrane forces.

use super::{CellMatrix, by_values};
use crate::element::adaptive::Rules;
use crate::element::with_element;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::plate;
use nalgebra::Matrix2;

/// Returns the geometric stiffness of a membrane force (N/m) at a point of a cell, cell by cell.
/// `rules` gives other quadrature rules for some cells.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element, and the
/// errors of the force.
pub fn prestress(
    mesh: &Mesh,
    force: &dyn Fn(usize, Point) -> Result<Matrix2<f64>>,
    rules: &Rules,
) -> Result<Vec<CellMatrix>> {
    by_values(mesh, force, rules, |element, rule, force| {
        with_element!(element, element => {
            plate::geometric_stiffness(element, rule, force).as_slice().into()
        })
    })
}
