//! Springs along edges of the plate, against deflection and against rotation.

use super::CellMatrix;
use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use nalgebra::{SMatrix, SVector};
use std::collections::{BTreeMap, HashMap};

/// Springs along an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeSprings {
    /// Stiffness against deflection, in N/m^2: force per length and deflection.
    pub stiffness: f64,
    /// Stiffness against the slope across the edge, in N m/rad/m: moment per length and angle.
    pub rotation: f64,
}

/// Returns the stiffness of springs along cell sides, cell by cell.
///
/// Each side is a pair of nodes with its springs. The integrals are exact: along a side of any cell
/// the deflection is the cubic, and the slope across it the linear function, of the dofs at its two
/// nodes.
///
/// # Errors
/// Returns [`Error::Mesh`] for a pair of nodes that is no side of a cell.
pub fn edge_springs(
    mesh: &Mesh,
    sides: impl IntoIterator<Item = ([usize; 2], EdgeSprings)>,
) -> Result<Vec<CellMatrix>> {
    let cell_at = cells_at_sides(mesh);
    let mut sums: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for ([a, b], springs) in sides {
        let missing = || Error::Mesh(format!("nodes {a} and {b} are not the ends of a cell's side"));
        let &cell = cell_at.get(&[a.min(b), a.max(b)]).ok_or_else(missing)?;
        let nodes = mesh.cells[cell].nodes();
        let size = PER_NODE * nodes.len();
        let place = |end: usize| PER_NODE * nodes.iter().position(|&node| node == end).unwrap_or_default();
        let local = [a, b].map(place).into_iter().flat_map(|first| first..first + PER_NODE);
        let local: Vec<usize> = local.collect();
        let sum = sums.entry(cell).or_insert_with(|| vec![0.0; size * size]);
        let side = on_side([mesh.nodes[a], mesh.nodes[b]], springs);
        for (i, &row) in local.iter().enumerate() {
            for (j, &column) in local.iter().enumerate() {
                sum[row * size + column] += side[(i, j)];
            }
        }
    }
    Ok(sums.into_iter().map(|(cell, matrix)| (cell, matrix.into())).collect())
}

/// Returns the first cell at each side, which is given by its nodes in ascending order.
pub fn cells_at_sides(mesh: &Mesh) -> HashMap<[usize; 2], usize> {
    let mut cell_at = HashMap::new();
    for (number, cell) in mesh.cells.iter().enumerate() {
        for [a, b] in cell.edges() {
            cell_at.entry([a.min(b), a.max(b)]).or_insert(number);
        }
    }
    cell_at
}

/// Returns the stiffness of springs along a side between two points, over w, w_x and w_y at both.
fn on_side([a, b]: [Point; 2], springs: EdgeSprings) -> SMatrix<f64, 6, 6> {
    let side = b - a;
    let length = side.norm();
    let along = side / length;
    // Deflections and slopes along the side at both ends, then slopes across it.
    let row = |end: usize, dofs: [f64; 3]| {
        let mut row = SVector::<f64, 6>::zeros();
        row.fixed_rows_mut::<3>(PER_NODE * end).copy_from_slice(&dofs);
        row
    };
    let deflection = [0, 1].map(|end| row(end, [1.0, 0.0, 0.0]));
    let slope_along = [0, 1].map(|end| row(end, [0.0, along.x, along.y]) * length);
    let slope_across = [0, 1].map(|end| row(end, [0.0, -along.y, along.x]));
    let cubic = [deflection[0], slope_along[0], deflection[1], slope_along[1]];
    let mut sum = SMatrix::zeros();
    for (i, row) in HERMITE.iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            sum += cubic[i] * cubic[j].transpose() * (springs.stiffness * length * entry / 420.0);
        }
    }
    for (i, row) in [[2.0, 1.0], [1.0, 2.0]].iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            sum += slope_across[i] * slope_across[j].transpose() * (springs.rotation * length * entry / 6.0);
        }
    }
    sum
}

/// Integrals of products of the cubic Hermite functions on a side of length 1, times 420, with the
/// functions in the order value, slope, value, slope.
const HERMITE: [[f64; 4]; 4] = [
    [156.0, 22.0, 54.0, -13.0],
    [22.0, 4.0, 13.0, -3.0],
    [54.0, 13.0, 156.0, -22.0],
    [-13.0, -3.0, -22.0, 4.0],
];
