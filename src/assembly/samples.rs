//! Points at which the curvatures of cells enter the least squares of a recovery.

use crate::dof_map::PER_NODE;
use crate::element::{Element, quadrature};
use nalgebra::Vector2;

/// Points at which the curvatures of the cells of one class enter a fit.
pub(super) struct ClassSamples {
    /// Position of each corner relative to the first one, in m.
    pub corners: Vec<Vector2<f64>>,
    pub samples: Vec<Sample>,
}

/// Point at which a cell's curvatures enter a fit.
pub(super) struct Sample {
    /// Position relative to the first node of the cell, in m.
    pub offset: Vector2<f64>,
    /// Weight, an area in m^2.
    pub weight: f64,
    /// Curvatures of each basis function.
    pub curvatures: Vec<[f64; 3]>,
}

/// Returns the corners and sample points of an element.
pub(super) fn of_element<const N: usize>(element: &Element<N>) -> ClassSamples {
    let mut samples = Vec::new();
    for (number, piece) in element.pieces.iter().enumerate() {
        for (barycentric, weight) in quadrature::DEGREE_2 {
            let hessian = piece.basis(barycentric).hessian;
            samples.push(Sample {
                offset: element.point(number, barycentric) - element.origin,
                weight: weight * piece.area(),
                curvatures: (0..N).map(|i| [0, 1, 2].map(|row| hessian[(row, i)])).collect(),
            });
        }
    }
    // Piece k of an element lies at its side k, which begins at corner k.
    let corners = (0..N / PER_NODE).map(|corner| element.pieces[corner].vertices[0].coords).collect();
    ClassSamples { corners, samples }
}
