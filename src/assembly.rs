//! From cells to matrices: the only loop over cells.
//!
//! Congruent cells (translates of one another) share one set of local arrays: a regular mesh computes its element matrices
//! a handful of times.

use crate::element::{Element, Piece, fvs, hct};
use crate::error::{Error, Result};
use crate::linalg::{Average, Block};
use crate::mesh::{Cell, Mesh, Point};
use crate::plate::Plate;
use crate::space::Space;
use nalgebra::SMatrix;
use std::collections::HashMap;
use std::rc::Rc;

/// Local arrays of a cell, shared by all cells congruent to it.
#[derive(Debug, Clone)]
pub struct Local {
    /// K, n x n, row by row, in N/m for deflections.
    pub stiffness: Rc<[f64]>,
    /// M_r, n x n, row by row, in kg for deflections.
    pub mass: Rc<[f64]>,
    /// Integrals of the basis functions, n entries, in m2 for deflections.
    pub moments: Rc<[f64]>,
    /// The row of B, n entries: surface density times the moments.
    pub coupling: Rc<[f64]>,
    /// The entry of C: the mass of the cell, in kg.
    pub weight: f64,
    /// Positions of the nodes relative to the first, in m.
    pub arms: Rc<[[f64; 2]]>,
}

/// A cell in the numbering of a space.
#[derive(Debug, Clone)]
pub struct CellArrays {
    /// Free dofs of the local ones.
    pub dofs: Rc<[Option<usize>]>,
    /// Number of the class of congruent cells.
    pub class: usize,
    /// Its arrays.
    pub local: Rc<Local>,
}

/// All cells of a mesh with their local arrays, in the order of the cells.
///
/// # Errors
/// [`Error::Mesh`] naming a cell that cannot carry its element.
pub fn cells(mesh: &Mesh, space: &Space, plate: &Plate) -> Result<Vec<CellArrays>> {
    let extent = mesh.nodes.iter().fold(0.0, |m: f64, p| m.max(p.x.abs()).max(p.y.abs()));
    // Positions that differ by a few roundings of the largest coordinate are one.
    let grain = 16.0 * f64::EPSILON * extent;
    let mut classes: HashMap<Vec<i64>, (usize, Rc<Local>)> = HashMap::new();
    let mut cells = Vec::with_capacity(mesh.cells.len());
    for (number, cell) in mesh.cells.iter().enumerate() {
        let nodes = cell.nodes();
        let origin = mesh.nodes[nodes[0]];
        let shape = nodes[1..]
            .iter()
            .flat_map(|&node| {
                let arm = mesh.nodes[node] - origin;
                [arm.x, arm.y].map(|a| (a / grain).round() as i64)
            })
            .collect();
        let count = classes.len();
        let (class, local) = match classes.entry(shape) {
            std::collections::hash_map::Entry::Occupied(known) => known.get().clone(),
            std::collections::hash_map::Entry::Vacant(new) => {
                let local = local_arrays(mesh, cell, plate)
                    .map_err(|error| Error::Mesh(format!("cell {number}: {error}")))?;
                new.insert((count, Rc::new(local))).clone()
            }
        };
        cells.push(CellArrays { dofs: space.dofs_of(nodes).collect(), class, local });
    }
    Ok(cells)
}

fn local_arrays(mesh: &Mesh, cell: &Cell, plate: &Plate) -> Result<Local> {
    match *cell {
        Cell::Triangle(nodes) => {
            let vertices = nodes.map(|node| mesh.nodes[node]);
            Ok(arrays(&hct::element(vertices)?, &vertices, plate))
        }
        Cell::Quadrilateral(nodes) => {
            let vertices = nodes.map(|node| mesh.nodes[node]);
            Ok(arrays(&fvs::element(vertices)?, &vertices, plate))
        }
    }
}

fn arrays<const N: usize>(element: &Element<N>, vertices: &[Point], plate: &Plate) -> Local {
    let flat = |matrix: SMatrix<f64, N, N>| matrix.as_slice().into();
    let moments = plate.moments(element);
    let density = plate.surface_density();
    Local {
        // Symmetric, so that column by column is row by row.
        stiffness: flat(plate.stiffness(element)),
        mass: flat(plate.consistent_mass(element)),
        moments: moments.as_slice().into(),
        coupling: (moments * density).as_slice().into(),
        weight: density * element.pieces.iter().map(Piece::area).sum::<f64>(),
        arms: vertices.iter().map(|v| [v.x - vertices[0].x, v.y - vertices[0].y]).collect(),
    }
}

/// The contributions to the stiffness K.
pub fn stiffness(cells: &[CellArrays]) -> Vec<Block> {
    let block = |cell: &CellArrays| Block {
        dofs: cell.dofs.clone(),
        matrix: cell.local.stiffness.clone(),
        arms: Some(cell.local.arms.clone()),
        class: cell.class,
    };
    cells.iter().map(block).collect()
}

/// The contributions to the consistent mass M_r.
pub fn consistent_mass(cells: &[CellArrays]) -> Vec<Block> {
    let block = |cell: &CellArrays| Block {
        dofs: cell.dofs.clone(),
        matrix: cell.local.mass.clone(),
        arms: None,
        class: cell.class,
    };
    cells.iter().map(block).collect()
}

/// The rows of B and the entries of C of the singular mass.
pub fn singular_mass(cells: &[CellArrays]) -> Vec<Average> {
    let average = |cell: &CellArrays| Average {
        dofs: cell.dofs.clone(),
        row: cell.local.coupling.clone(),
        mass: cell.local.weight,
        class: cell.class,
    };
    cells.iter().map(average).collect()
}

/// The load F of a uniform pressure (Pa, upward) over `dofs` free dofs, in N.
pub fn uniform_load(cells: &[CellArrays], dofs: usize, pressure: f64) -> Vec<f64> {
    let mut load = vec![0.0; dofs];
    for cell in cells {
        for (dof, moment) in cell.dofs.iter().zip(cell.local.moments.iter()) {
            if let Some(dof) = dof {
                load[*dof] += pressure * moment;
            }
        }
    }
    load
}

/// The deflection at a point, as a sum over free dofs.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    weights: Vec<(usize, f64)>,
}

impl Probe {
    /// The deflection at a point of the mesh.
    ///
    /// # Errors
    /// [`Error::Mesh`] for a point outside.
    pub fn new(mesh: &Mesh, space: &Space, point: Point) -> Result<Probe> {
        let outside = || Error::Mesh(format!("the point ({}, {}) lies outside the plate", point.x, point.y));
        let cell = mesh.cells[mesh.locate(point).ok_or_else(outside)?];
        let values: Vec<f64> = match cell {
            Cell::Triangle(nodes) => {
                let element = hct::element(nodes.map(|node| mesh.nodes[node]))?;
                element.basis_at(point).value.iter().copied().collect()
            }
            Cell::Quadrilateral(nodes) => {
                let element = fvs::element(nodes.map(|node| mesh.nodes[node]))?;
                element.basis_at(point).value.iter().copied().collect()
            }
        };
        let weights = space
            .dofs_of(cell.nodes())
            .zip(values)
            .filter_map(|(dof, value)| Some((dof?, value)))
            .filter(|(_, value)| *value != 0.0)
            .collect();
        Ok(Probe { weights })
    }

    /// The probe that multiplies each dof by a weight.
    pub fn from_weights(weights: &[f64]) -> Probe {
        let nonzero = weights.iter().copied().enumerate().filter(|(_, weight)| *weight != 0.0);
        Probe { weights: nonzero.collect() }
    }

    /// Adds the weight of each dof.
    pub fn add_weights(&self, weights: &mut [f64]) {
        for &(dof, weight) in &self.weights {
            weights[dof] += weight;
        }
    }

    /// The deflection, in m.
    pub fn deflection(&self, u: &[f64]) -> f64 {
        self.weights.iter().map(|&(dof, weight)| weight * u[dof]).sum()
    }
}
