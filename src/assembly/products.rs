//! Products of the cells' matrices with displacements over all dofs of a mesh, held ones included.

use super::{CellArrays, Local};
use crate::dof_map::PER_NODE;
use crate::linalg::vectors::dot;
use crate::mesh::{Cell, Mesh, Point};

/// Adds the forces K U over the free dofs, in N for deflections. U holds the values at all dofs of
/// the mesh, three per node, held ones included.
pub fn forces(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], force: &mut [f64]) {
    for (arrays, cell) in cells.iter().zip(&mesh.cells) {
        arrays.add(&arrays.local.bending.product(&on_nodes(cell, shape)), force);
    }
}

/// Returns U^T K U in N m and U^T M_r U in kg m^2 for a displacement U given as in [`forces`].
pub fn squares(mesh: &Mesh, cells: &[CellArrays], shape: &[f64]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (arrays, cell) in cells.iter().zip(&mesh.cells) {
        let values = on_nodes(cell, shape);
        let rows = arrays.local.mass.chunks_exact(values.len());
        sums[0] += dot(&arrays.local.bending.product(&values), &values);
        sums[1] += rows.zip(&values).map(|(row, value)| value * dot(row, &values)).sum::<f64>();
    }
    sums
}

/// Adds the momenta M_r V over the free dofs for velocities V given as in [`forces`].
pub fn consistent_momenta(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], momentum: &mut [f64]) {
    for (arrays, cell) in cells.iter().zip(&mesh.cells) {
        arrays.add_product(&arrays.local.mass, &on_nodes(cell, shape), momentum);
    }
}

/// Adds the momenta of the singular mass over the free dofs for velocities given as in [`forces`].
pub fn singular_momenta(mesh: &Mesh, cells: &[CellArrays], shape: &[f64], momentum: &mut [f64]) {
    for (arrays, cell) in cells.iter().zip(&mesh.cells) {
        let Local { row, weight, .. } = &*arrays.local;
        let velocity = dot(row, &on_nodes(cell, shape)) / weight;
        let local: Vec<f64> = row.iter().map(|b| b * velocity).collect();
        arrays.add(&local, momentum);
    }
}

/// Returns the centre of mass of each cell, in m: the means of x and y.
pub fn centres_of_mass(mesh: &Mesh, cells: &[CellArrays]) -> impl Iterator<Item = Point> {
    cells.iter().zip(&mesh.cells).map(|(arrays, cell)| {
        let mean = |axis: usize| {
            let mut shape = [0.0; PER_NODE];
            shape[1 + axis] = 1.0;
            let values = cell.nodes().iter().flat_map(|&node| {
                shape[0] = mesh.nodes[node][axis];
                shape
            });
            dot(&arrays.local.row, &values.collect::<Vec<_>>()) / arrays.local.weight
        };
        Point::new(mean(0), mean(1))
    })
}

/// Returns the entries at the dofs of a cell of a vector over all dofs of the mesh.
pub fn on_nodes(cell: &Cell, shape: &[f64]) -> Vec<f64> {
    cell.nodes().iter().flat_map(|&node| &shape[PER_NODE * node..][..PER_NODE]).copied().collect()
}
