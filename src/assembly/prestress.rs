//! Geometric stiffness of membrane forces.

use super::CellMatrix;
use crate::element::adaptive::Rules;
use crate::element::quadrature::{self, Rule};
use crate::element::with_element;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::plate;
use nalgebra::Matrix2;
use std::cell::RefCell;

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
    let fault = RefCell::new(None);
    let value = |cell: usize, point: Point| {
        force(cell, point).unwrap_or_else(|error| {
            fault.replace(Some(error));
            Matrix2::zeros()
        })
    };
    let matrix = |number: usize| -> Result<CellMatrix> {
        let rule = rules.get(&number).map_or((&quadrature::DEGREE_6).into(), |rule| Rule::Own(rule));
        let element = mesh.element(number)?;
        let matrix = with_element!(&element, element => {
            plate::geometric_stiffness(element, rule, |point| value(number, point)).as_slice().into()
        });
        Ok((number, matrix))
    };
    let matrices = (0..mesh.cells.len()).map(matrix).collect::<Result<_>>()?;
    fault.take().map_or(Ok(matrices), Err)
}
