//! Beams along lines of the plate: their pieces in the cells, their stiffness and their mass.
//!
//! A beam follows the deflection w of the plate. With s along the line and n across it, its elastic
//! and kinetic energies are
//!
//! ```math
//! \tfrac12 \int EI\, w_{ss}^2 + GJ\, w_{sn}^2\, ds, \qquad \tfrac12 \int \rho A\, \dot w^2\, ds .
//! ```
//!
//! On each sub-cell w is a cubic, and the Gauss rules are exact on the pieces of the line there.

use super::{CellMatrix, add_square};
use crate::dof_map::PER_NODE;
use crate::element::BasisFunction;
use crate::element::quadrature::{GAUSS_2, GAUSS_4, LineNode};
use crate::error::Result;
use crate::geometry;
use crate::mesh::{Mesh, Point};
use nalgebra::Vector2;
use std::collections::BTreeMap;

/// Straight piece of a beam within a sub-cell.
#[derive(Debug, Clone, Copy)]
pub struct BeamPiece {
    /// Index of the cell.
    pub cell: usize,
    /// Ends, in m.
    pub ends: [Point; 2],
    /// Share of the beam that the sub-cell carries: a side between sub-cells divides it equally.
    pub share: f64,
}

/// Stiffness of a beam against bending and against torsion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamStiffness {
    /// EI, in N m2.
    pub bending: f64,
    /// GJ, in N m2.
    pub torsion: f64,
}

/// Distance from a sub-cell, relative to its longest side, up to which a line counts as within it.
const WITHIN: f64 = 1e-10;

impl BeamPiece {
    /// Returns the points of a Gauss rule with their weights, in m, which add up to the share of
    /// the length.
    fn points(&self, rule: &'static [LineNode]) -> impl Iterator<Item = (Point, f64)> {
        let (half, middle) =
            (0.5 * (self.ends[1] - self.ends[0]), nalgebra::center(&self.ends[0], &self.ends[1]));
        let scale = self.share * half.norm();
        rule.iter().map(move |(place, weight)| (middle + half * *place, weight * scale))
    }

    /// Returns points of the piece with the masses, in kg, that represent a beam of so many kg/m.
    pub fn masses(&self, per_length: f64) -> impl Iterator<Item = (Point, f64)> {
        self.points(&GAUSS_4).map(move |(point, weight)| (point, per_length * weight))
    }

    /// Adds the stiffness of the piece to a matrix over the cell's dofs, stored by rows.
    fn add_stiffness(&self, mesh: &Mesh, beam: BeamStiffness, matrix: &mut [f64]) -> Result<()> {
        let element = mesh.element(self.cell)?;
        let along = (self.ends[1] - self.ends[0]).normalize();
        let bend = |basis: &BasisFunction| {
            let [xx, xy, yy] = basis.hessian;
            along.x * along.x * xx + 2.0 * along.x * along.y * xy + along.y * along.y * yy
        };
        let twist = |basis: &BasisFunction| {
            let [xx, xy, yy] = basis.hessian;
            along.x * along.y * (yy - xx) + (along.x * along.x - along.y * along.y) * xy
        };
        for (point, weight) in self.points(&GAUSS_2) {
            let basis = element.basis_at(point);
            let bent: Vec<f64> = basis.iter().map(bend).collect();
            let twisted: Vec<f64> = basis.iter().map(twist).collect();
            for (stiffness, values) in [(beam.bending, bent), (beam.torsion, twisted)] {
                add_square(weight * stiffness, &values, matrix);
            }
        }
        Ok(())
    }
}

/// Returns the stiffness of pieces of a beam, cell by cell.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element.
pub fn beams(mesh: &Mesh, pieces: &[(BeamPiece, BeamStiffness)]) -> Result<Vec<CellMatrix>> {
    let mut sums: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for (piece, stiffness) in pieces {
        let size = PER_NODE * mesh.cells[piece.cell].nodes().len();
        let sum = sums.entry(piece.cell).or_insert_with(|| vec![0.0; size * size]);
        piece.add_stiffness(mesh, *stiffness, sum)?;
    }
    Ok(sums.into_iter().map(|(cell, matrix)| (cell, matrix.into())).collect())
}

/// Returns the parts of a line within the sub-cells, each with its cell, as shares of the length.
///
/// # Errors
/// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element.
pub fn line_in_cells(mesh: &Mesh, [from, to]: [Point; 2]) -> Result<Vec<(usize, [f64; 2])>> {
    let mut parts = Vec::new();
    let along = to - from;
    for cell in 0..mesh.cells.len() {
        let vertices = mesh.vertices(cell);
        let slack = WITHIN * geometry::longest_edge(&vertices) * along.norm();
        let beside = |sign: f64| vertices.iter().all(|vertex| sign * along.perp(&(vertex - from)) > slack);
        if beside(1.0) || beside(-1.0) {
            continue;
        }
        let pieces = mesh.element(cell)?.pieces();
        parts.extend(pieces.iter().filter_map(|piece| Some((cell, clip(piece, from, along)?))));
    }
    Ok(parts)
}

/// Returns the part of a line within a triangle, as shares of its length.
fn clip(vertices: &[Point; 3], from: Point, along: Vector2<f64>) -> Option<[f64; 2]> {
    let size = geometry::longest_edge(vertices);
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for (corner, side) in geometry::sides(vertices) {
        // The distance from the side, positive within, is start + share * rate.
        let side = side.normalize();
        let (start, rate) = (side.perp(&(from - corner)) + WITHIN * size, side.perp(&along));
        // A line along the side is within or not, whatever rounding makes of its slope.
        if rate.abs() <= WITHIN * size {
            if start.max(start + rate) < 0.0 {
                return None;
            }
        } else if rate > 0.0 {
            first = first.max(-start / rate);
        } else {
            last = last.min(-start / rate);
        }
    }
    (first < last).then_some([first, last])
}
