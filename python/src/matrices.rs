//! Matrices of a scene, as triplets from which sparse matrices are made.

use crate::host::Host;
use numpy::PyArray1;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rebond::linalg::{Form, Native};
use rebond::simulation;

/// Sparse matrix: entries that may repeat, which then add up.
pub struct Triplets {
    shape: (usize, usize),
    rows: Vec<i64>,
    columns: Vec<i64>,
    values: Vec<f64>,
}

impl Triplets {
    /// Creates an empty matrix.
    pub fn new(rows: usize, columns: usize) -> Triplets {
        Triplets { shape: (rows, columns), rows: Vec::new(), columns: Vec::new(), values: Vec::new() }
    }

    /// Adds an entry.
    pub fn push(&mut self, row: usize, column: usize, value: f64) {
        self.rows.push(row as i64);
        self.columns.push(column as i64);
        self.values.push(value);
    }

    /// Collects a symmetric form over `dofs` dofs, both triangles.
    fn of_form(form: &Form, dofs: usize) -> Triplets {
        let mut matrix = Triplets::new(dofs, dofs);
        form.for_each_lower(|row, column, entry| {
            matrix.push(row, column, entry);
            if row != column {
                matrix.push(column, row, entry);
            }
        });
        matrix
    }

    /// Returns values, rows, columns and shape.
    pub fn into_tuple<'py>(self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let arrays = (
            PyArray1::from_vec(py, self.values),
            PyArray1::from_vec(py, self.rows),
            PyArray1::from_vec(py, self.columns),
            self.shape,
        );
        Ok(arrays.into_pyobject(py)?.into_any())
    }
}

/// Matrices by name, with the load and the bounds.
pub struct Matrices {
    matrices: Vec<(&'static str, Triplets)>,
    vectors: Vec<(&'static str, Vec<f64>)>,
}

impl Matrices {
    /// Assembles the matrices over the dofs that supports leave free, or over all dofs.
    pub fn of(host: &Host, is_supported: bool) -> rebond::Result<Matrices> {
        let found = simulation::matrices(host.scene, host.mesh, is_supported)?;
        let dofs = found.load.len();
        let engine = Native::new(dofs);
        let mut b = Triplets::new(found.singular.len(), dofs);
        let mut c = Vec::new();
        for (number, cell) in found.singular.iter().enumerate() {
            for (dof, value) in cell.dofs.iter().zip(cell.row.iter()) {
                dof.iter().for_each(|dof| b.push(number, *dof, *value));
            }
            c.push(cell.mass);
        }
        let mut g = Triplets::new(found.bounded.len(), dofs);
        found.bounded.iter().enumerate().for_each(|(row, &dof)| g.push(row, dof, 1.0));
        let mut matrices = vec![
            ("K", Triplets::of_form(&engine.form(found.stiffness), dofs)),
            ("M", Triplets::of_form(&engine.form(found.consistent), dofs)),
            ("M_singular", Triplets::of_form(&engine.averages(found.singular), dofs)),
            ("B", b),
            ("G", g),
        ];
        let mut vectors = vec![("C", c), ("load", found.load)];
        if is_supported {
            let bounds = &host.model.system.bounds;
            // The rows of G in the order of the bounds and reactions of the model.
            let mut g = Triplets::new(bounds.len(), dofs);
            bounds.dofs.iter().enumerate().for_each(|(row, &dof)| g.push(row, dof, 1.0));
            matrices[4].1 = g;
            vectors.extend([("lower", bounds.lower.clone()), ("upper", bounds.upper.clone())]);
        }
        Ok(Matrices { matrices, vectors })
    }

    /// Returns the matrices as triplets, and the vectors, by name.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let dict = PyDict::new(py);
        for (name, matrix) in self.matrices {
            dict.set_item(name, matrix.into_tuple(py)?)?;
        }
        for (name, vector) in self.vectors {
            dict.set_item(name, PyArray1::from_vec(py, vector))?;
        }
        Ok(dict)
    }
}
