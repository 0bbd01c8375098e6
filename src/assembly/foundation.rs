//! Elastic foundation under the plate.

use super::CellMatrix;
use crate::element::adaptive::Rules;
use crate::element::quadrature::{self, Rule};
use crate::element::with_element;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::plate;
use std::cell::RefCell;

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
    let fault = RefCell::new(None);
    let matrix = |number: usize| -> Result<Vec<f64>> {
        let value = |point: Point| {
            stiffness(number, point).unwrap_or_else(|error| {
                fault.replace(Some(error));
                0.0
            })
        };
        let rule = rules.get(&number).map_or((&quadrature::DEGREE_6).into(), |rule| Rule::Own(rule));
        let element = mesh.element(number)?;
        Ok(with_element!(&element, element => plate::mass_by(element, rule, value).as_slice().to_vec()))
    };
    let matrices: Vec<_> = (0..mesh.cells.len()).map(matrix).collect::<Result<_>>()?;
    fault.into_inner().map_or(Ok(()), Err)?;
    let under =
        matrices.into_iter().enumerate().filter(|(_, matrix)| matrix.iter().any(|entry| *entry != 0.0));
    Ok(under.map(|(number, matrix)| (number, matrix.into())).collect())
}
