//! Deflection at a point.

use crate::dof_map::{DofMap, PER_NODE};
use crate::element::BasisFunction;
use crate::error::{Error, Result};
use crate::geometry;
use crate::linalg::{CellClass, ElementMatrix, SingularMassCell};
use crate::mesh::{Mesh, Point};
use std::rc::Rc;

/// Deflection at a point, as a weighted sum of dofs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Probe {
    weights: Vec<(usize, f64)>,
}

/// Share of the cell's largest basis function at a point below which another counts as zero there:
/// the point is a node.
const ROUNDING: f64 = 1e-14;

impl Probe {
    /// Creates the deflection at a point of the mesh, over the free dofs of a space.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a point outside the mesh.
    pub fn new(mesh: &Mesh, space: &DofMap, point: Point) -> Result<Probe> {
        Ok(Probe::of_shape(mesh, point)?.within(space))
    }

    /// Creates the deflection at a point of the mesh over all deflections and slopes, three per
    /// node, held or not.
    ///
    /// # Errors
    /// Returns the errors of [`Probe::new`].
    pub fn of_shape(mesh: &Mesh, point: Point) -> Result<Probe> {
        Probe::of_derivative(mesh, point, |basis| basis.value)
    }

    /// Creates a linear function of the deflection and its derivatives at a point of the mesh over
    /// all deflections and slopes, given by its values for the basis functions.
    ///
    /// # Errors
    /// Returns the errors of [`Probe::new`].
    pub fn of_derivative(mesh: &Mesh, point: Point, value: impl Fn(&BasisFunction) -> f64) -> Result<Probe> {
        let outside = || Error::Mesh(format!("the point {} lies outside the plate", geometry::place(point)));
        Probe::in_cell(mesh, mesh.locate(point).ok_or_else(outside)?, point, value)
    }

    /// Creates a linear function like [`Probe::of_derivative`] at a point of a cell.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a cell that cannot carry its element.
    pub fn in_cell(
        mesh: &Mesh,
        cell: usize,
        point: Point,
        value: impl Fn(&BasisFunction) -> f64,
    ) -> Result<Probe> {
        let values: Vec<f64> = mesh.element(cell)?.basis_at(point).iter().map(value).collect();
        let zero = ROUNDING * values.iter().fold(0.0, |m: f64, value| m.max(value.abs()));
        let nodes = mesh.cells[cell].nodes();
        let dofs = nodes.iter().flat_map(|node| (0..PER_NODE).map(move |k| PER_NODE * node + k));
        Ok(Probe { weights: dofs.zip(values).filter(|(_, value)| value.abs() > zero).collect() })
    }

    /// Creates a sum over dofs with weights, each dof at most once.
    pub fn from_terms(weights: Vec<(usize, f64)>) -> Probe {
        Probe { weights }
    }

    /// Restricts a probe over all dofs of the mesh to the free dofs of a space.
    pub fn within(&self, space: &DofMap) -> Probe {
        let free = |&(shape_dof, weight): &(usize, f64)| {
            let (dof, factor) = space.dof(shape_dof)?;
            Some((dof, factor * weight))
        };
        Probe { weights: self.weights.iter().filter_map(free).collect() }
    }

    /// Creates the probe that multiplies each dof by a weight.
    pub fn from_weights(weights: &[f64]) -> Probe {
        let nonzero = weights.iter().copied().enumerate().filter(|(_, weight)| *weight != 0.0);
        Probe { weights: nonzero.collect() }
    }

    /// Adds a force at the point, in N, to a load.
    pub fn push(&self, force: f64, load: &mut [f64]) {
        for &(dof, weight) in &self.weights {
            load[dof] += force * weight;
        }
    }

    /// Returns the deflection, in m.
    pub fn deflection(&self, u: &[f64]) -> f64 {
        self.weights.iter().map(|&(dof, weight)| weight * u[dof]).sum()
    }

    /// Returns the dofs and their weights.
    pub fn weights(&self) -> &[(usize, f64)] {
        &self.weights
    }

    /// Adds one more dof with its weight to the probe.
    pub fn with(mut self, dof: usize, weight: f64) -> Probe {
        self.weights.push((dof, weight));
        self
    }

    /// Returns the form k w w^T of a spring of stiffness k at the point, in N/m, or of a consistent
    /// mass k, in kg.
    ///
    /// The number of its class must belong to this form alone, and be no less than the number of
    /// cells.
    pub fn spring(&self, k: f64, number: usize) -> ElementMatrix {
        let entries = self.weights.iter().flat_map(|(_, a)| self.weights.iter().map(move |(_, b)| k * a * b));
        let (dofs, class) = (self.dofs(), CellClass::Bare(number));
        ElementMatrix { dofs, matrix: entries.collect(), bending: None, class }
    }

    /// Returns one more row of B and entry of C, for the velocity of a mass of m kg at the point.
    pub fn rider(&self, m: f64, number: usize) -> SingularMassCell {
        SingularMassCell {
            dofs: self.dofs(),
            row: self.weights.iter().map(|(_, weight)| m * weight).collect(),
            mass: m,
            class: CellClass::Bare(number),
        }
    }

    fn dofs(&self) -> Rc<[Option<usize>]> {
        self.weights.iter().map(|(dof, _)| Some(*dof)).collect()
    }
}
