//! Reduced Fraeijs de Veubeke-Sander quadrilateral.
//!
//! - **Cell**: a strictly convex quadrilateral, divided into four by its diagonals.
//! - **Space**: C1 functions that are cubic on each sub-triangle and whose normal derivative is
//!   linear along each edge of the cell. The dimension is 12, and every quadratic is contained.
//! - **Dofs**: `(w, w_x, w_y)` at each vertex.
//!
//! Sources: G. Sander, *Bornes supérieures et inférieures dans l'analyse matricielle des plaques en
//! flexion-torsion*, 1964; B. Fraeijs de Veubeke, *A conforming finite element for plate bending*,
//! 1968; P. G. Ciarlet, *The Finite Element Method for Elliptic Problems*, 1978, section 6.1 (the
//! reduced variant). Some libraries map the element from a square instead, which is the same on
//! parallelograms but loses the quadratics on other cells.

use super::{Element, fan};
use crate::error::Result;
use crate::geometry::{Point, require_convex};

/// Creates the element on a quadrilateral of counter-clockwise vertices, in m.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) if the quadrilateral is degenerate, clockwise, not
/// strictly convex, or not finite.
pub fn element(vertices: [Point; 4]) -> Result<Element<12>> {
    require_convex("the quadrilateral", &vertices)?;
    let ring = vertices.map(|v| Point::from(v - vertices[0]));
    // The diagonals cross at v0 + s (v2 - v0) = v1 + t (v3 - v1). On a flat cell rounding moves the
    // crossing along them; computing t from the centre, not from its own quotient, keeps the centre
    // on both diagonals.
    let diagonals = [ring[2] - ring[0], ring[3] - ring[1]];
    let s = ring[1].coords.perp(&diagonals[1]) / diagonals[0].perp(&diagonals[1]);
    let centre = ring[0] + diagonals[0] * s;
    let t = (centre - ring[1]).dot(&diagonals[1]) / diagonals[1].norm_squared();
    Ok(fan(
        vertices[0],
        ring,
        centre,
        [[t, 0.0, 1.0 - t], [1.0 - s, 0.0, s], [1.0 - t, 0.0, t], [s, 0.0, 1.0 - s]],
    ))
}
