//! Load of a pressure that varies over the plate.

use super::CellArrays;
use crate::element::adaptive::Rules;
use crate::element::quadrature::{self, Node};
use crate::element::{Element, with_element};
use crate::error::Result;
use crate::linalg::CellClass;
use crate::linalg::vectors::axpy;
use crate::mesh::{Mesh, Point};
use std::collections::HashMap;
use std::rc::Rc;

/// Quadrature of a pressure that varies over the plate: its points in every cell, and the load that
/// their values make.
#[derive(Debug, Clone)]
pub struct Pressure {
    /// Mesh without names.
    mesh: Mesh,
    points: Vec<Point>,
    /// Arrays of each cell, the index of its first point, and the weights of its points, one per
    /// point and local dof.
    cells: Vec<(CellArrays, usize, Rc<[f64]>)>,
}

impl Pressure {
    /// Chooses the points of a rule of degree 6 on each piece of the cells, which is exact up to
    /// rounding for a pressure of degree 3.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`](crate::Error::Mesh) for a cell that cannot carry its element.
    pub fn new(mesh: &Mesh, cells: &[CellArrays]) -> Result<Pressure> {
        fn points_of<const N: usize>(element: &Element<N>, points: &mut Vec<Point>) -> Vec<f64> {
            let mut weights = Vec::new();
            for (number, piece) in element.pieces.iter().enumerate() {
                for (barycentric, weight) in quadrature::DEGREE_6 {
                    points.push(element.point(number, barycentric));
                    weights.extend((piece.values(barycentric) * (weight * piece.area())).iter());
                }
            }
            weights
        }
        let bare = Mesh { elements: mesh.elements, ..Mesh::default() };
        let bare = Mesh { nodes: mesh.nodes.clone(), cells: mesh.cells.clone(), ..bare };
        let mut pressure =
            Pressure { mesh: bare, points: Vec::new(), cells: Vec::with_capacity(cells.len()) };
        let mut class_weights: HashMap<CellClass, Rc<[f64]>> = HashMap::new();
        for (number, arrays) in cells.iter().enumerate() {
            let first = pressure.points.len();
            let element = mesh.element(number)?;
            let weights = with_element!(&element, element => points_of(element, &mut pressure.points));
            let weights = class_weights.entry(arrays.class).or_insert_with(|| weights.into()).clone();
            pressure.cells.push((arrays.clone(), first, weights));
        }
        Ok(pressure)
    }

    /// Adds the load, in N, of a function that computes an upward pressure, in Pa, at points, with
    /// other quadrature rules on some cells.
    ///
    /// # Errors
    /// Returns the errors of the pressure.
    pub fn load(
        &self,
        rules: &Rules,
        pressure: impl Fn(&[Point], &mut [f64]) -> Result<()>,
        load: &mut [f64],
    ) -> Result<()> {
        let mut values = vec![0.0; self.points.len()];
        pressure(&self.points, &mut values)?;
        let mut local = Vec::new();
        for (number, (cell, first, weights)) in self.cells.iter().enumerate() {
            if let Some(rules) = rules.get(&number) {
                cell.add(&self.by_own_rules(number, rules, &pressure)?, load);
                continue;
            }
            local.clear();
            local.resize(cell.dofs.len(), 0.0);
            for (weights, value) in weights.chunks_exact(local.len()).zip(&values[*first..]) {
                axpy(*value, weights, &mut local);
            }
            cell.add(&local, load);
        }
        Ok(())
    }

    /// Returns the load on a cell by its own rules.
    fn by_own_rules(
        &self,
        number: usize,
        rules: &[Vec<Node>],
        pressure: &impl Fn(&[Point], &mut [f64]) -> Result<()>,
    ) -> Result<Vec<f64>> {
        fn load_of<const N: usize>(
            element: &Element<N>,
            rules: &[Vec<Node>],
            pressure: &impl Fn(&[Point], &mut [f64]) -> Result<()>,
        ) -> Result<Vec<f64>> {
            let mut local = nalgebra::SVector::<f64, N>::zeros();
            for (number, (piece, rule)) in element.pieces.iter().zip(rules).enumerate() {
                let points: Vec<Point> =
                    rule.iter().map(|(barycentric, _)| element.point(number, *barycentric)).collect();
                let mut values = vec![0.0; points.len()];
                pressure(&points, &mut values)?;
                for ((barycentric, weight), value) in rule.iter().zip(values) {
                    local += piece.values(*barycentric) * (weight * piece.area() * value);
                }
            }
            Ok(local.as_slice().to_vec())
        }
        with_element!(&self.mesh.element(number)?, element => load_of(element, rules, pressure))
    }
}
