//! Elastic foundation under the plate.

use super::{CellMatrix, by_values};
use crate::element::adaptive::Rules;
use crate::element::with_element;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::plate;

/// Returns the stiffness of an elastic foundation, cell by cell.
///
/// `stiffness` is the foundation's stiffness, in N/m^3; cells where it is 0 have no contribution.
/// `rules` gives other quadrature rules for some cells.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element, and the
/// errors of the stiffness.
pub fn foundation(
    mesh: &Mesh,
    stiffness: &dyn Fn(usize, Point) -> Result<f64>,
    rules: &Rules,
) -> Result<Vec<CellMatrix>> {
    let mut matrices = by_values(mesh, stiffness, rules, |element, rule, stiffness| {
        with_element!(element, element => {
            plate::mass_by(element, rule, stiffness).as_slice().into()
        })
    })?;
    matrices.retain(|(_, matrix)| matrix.iter().any(|entry| *entry != 0.0));
    Ok(matrices)
}
