//! Reduced Hsieh-Clough-Tocher triangle.
//!
//! - **Cell**: a triangle, divided into three by the segments from its barycentre to its vertices.
//! - **Space**: C1 functions that are cubic on each sub-triangle and whose normal derivative is
//!   linear along each edge of the cell. The dimension is 9, and every quadratic is contained.
//! - **Dofs**: `(w, w_x, w_y)` at each vertex.
//!
//! Sources: R. W. Clough and J. L. Tocher, *Finite element stiffness matrices for analysis of plate
//! bending*, 1965; P. G. Ciarlet, *The Finite Element Method for Elliptic Problems*, 1978, section
//! 6.1 (the reduced triangle there, with its convergence).

use super::{Element, fan};
use crate::error::Result;
use crate::geometry::{Point, require_convex};

/// Creates the element on a triangle of counter-clockwise vertices, in m.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) if the triangle is degenerate, clockwise, or not
/// finite.
pub fn element(vertices: [Point; 3]) -> Result<Element<9>> {
    require_convex("the triangle", &vertices)?;
    let ring = vertices.map(|v| Point::from(v - vertices[0]));
    let barycentre = Point::from((ring[1].coords + ring[2].coords) / 3.0);
    Ok(fan(vertices[0], ring, barycentre, [[1.0 / 3.0; 3]; 3]))
}
