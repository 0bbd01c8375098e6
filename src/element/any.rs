//! Element of a cell of either shape.

use super::quadrature::Rule;
use super::{Basis, Element};
use crate::geometry::Point;

/// Element of a cell of a mesh, whatever its shape.
///
/// [`ElementKind::on`](super::ElementKind::on) creates it. Code that needs the number of dofs as a
/// constant gets at the element inside by `with_element!`.
///
/// ```
/// use rebond::element::ElementKind;
/// use rebond::geometry::Point;
///
/// let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Point::from);
/// let element = ElementKind::Fvs.on(&square)?;
/// let functions = element.basis_at(Point::new(0.5, 0.5));
/// assert_eq!(functions.len(), 12);
/// // A deflection of 1 m at all vertices is one everywhere.
/// let sum: f64 = functions.iter().step_by(3).map(|of| of.value).sum();
/// assert!((sum - 1.0).abs() < 1e-15);
/// # Ok::<(), rebond::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub enum AnyElement {
    /// Element of a triangle.
    Triangle(Element<9>),
    /// Element of a quadrilateral.
    Quadrilateral(Element<12>),
}

/// Evaluates an expression with the [`Element`](crate::element::Element) inside an
/// [`AnyElement`](crate::element::AnyElement); it is compiled once per number of dofs.
macro_rules! with_element {
    ($any:expr, $element:pat => $body:expr) => {
        match $any {
            $crate::element::AnyElement::Triangle($element) => $body,
            $crate::element::AnyElement::Quadrilateral($element) => $body,
        }
    };
}
pub(crate) use with_element;

/// Value and derivatives of one basis function at a point.
///
/// A derivative of order k has the unit m^-k, times m for the function of a slope.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasisFunction {
    /// Value.
    pub value: f64,
    /// First derivatives along x and y.
    pub gradient: [f64; 2],
    /// Second derivatives xx, xy and yy.
    pub hessian: [f64; 3],
}

impl AnyElement {
    /// Returns the vertices of each piece, counter-clockwise, in m.
    pub fn pieces(&self) -> Vec<[Point; 3]> {
        with_element!(self, element => {
            let place = |vertex: Point| element.origin + vertex.coords;
            element.pieces.iter().map(|piece| piece.vertices.map(place)).collect()
        })
    }

    /// Returns the basis functions at a point of the cell, in the order of the dofs; see
    /// [`Element::basis_at`].
    pub fn basis_at(&self, point: Point) -> Vec<BasisFunction> {
        fn functions<const N: usize>(basis: Basis<N>) -> Vec<BasisFunction> {
            let function = |i| BasisFunction {
                value: basis.value[i],
                gradient: [0, 1].map(|row| basis.gradient[(row, i)]),
                hessian: [0, 1, 2].map(|row| basis.hessian[(row, i)]),
            };
            (0..N).map(function).collect()
        }
        with_element!(self, element => functions(element.basis_at(point)))
    }

    /// Returns the points of a quadrature rule on all pieces, with their weights as areas in m^2.
    pub fn quadrature(&self, rule: Rule) -> Vec<(Point, f64)> {
        with_element!(self, element => {
            element.nodes(rule).map(|(piece, place, _, weight)| (place, weight * piece.area())).collect()
        })
    }
}
