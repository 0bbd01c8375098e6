//! L2 and energy norms of deflections: by matrices on one mesh, by quadrature between meshes.
//!
//! Deflections on two meshes are compared as the C1 functions they are. The elements give the value
//! and the second derivatives of both at the quadrature points of a third, fine mesh.

use nalgebra::{Matrix3, Vector3};

use crate::assembly;
use crate::dof_map::DofMap;
use crate::element::{AnyElement, BasisFunction, quadrature};
use crate::error::{Error, Result};
use crate::linalg::vectors::difference;
use crate::linalg::{Engine, Form, Native};
use crate::mesh::{Mesh, Point};
use crate::plate::{Section, Sections};

/// Norms of a deflection w.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Norms {
    /// L2 norm, the root of the integral of w^2, in m2.
    pub l2: f64,
    /// Energy norm, the root of a(w, w), which is twice the bending energy, in J^(1/2).
    pub energy: f64,
}

/// Norms of displacements on one mesh.
pub struct Metric {
    engine: Native,
    stiffness: Form,
    square: Form,
}

impl Metric {
    /// Creates the norms over the free dofs of a space.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] naming a cell that cannot carry its element, and the errors of
    /// `sections`.
    pub fn new(mesh: &Mesh, space: &DofMap, sections: &impl Sections) -> Result<Metric> {
        let cells = assembly::cells(mesh, space, &OfUnitDensity(sections))?;
        let engine = Native::with_layout(space.layout(mesh));
        let stiffness = engine.form(assembly::stiffness(&cells));
        let square = engine.form(assembly::consistent_mass(&cells));
        Ok(Metric { engine, stiffness, square })
    }

    /// Returns the norms of the difference of two displacements.
    ///
    /// # Errors
    /// Returns the errors of the engine's product.
    pub fn distance(&self, a: &[f64], b: &[f64]) -> Result<Norms> {
        let difference = difference(a, b);
        let mut product = vec![0.0; difference.len()];
        let elastic = self.engine.multiply(&self.stiffness, &difference, &mut product)?;
        let square = self.engine.multiply(&self.square, &difference, &mut product)?;
        Ok(Norms { l2: square.max(0.0).sqrt(), energy: elastic.max(0.0).sqrt() })
    }
}

/// Sections with a mass of 1 kg/m2, whose consistent mass is the matrix of the L2 norm.
struct OfUnitDensity<'s, S>(&'s S);

impl<S: Sections> Sections for OfUnitDensity<'_, S> {
    fn kind(&self, cell: usize) -> Option<usize> {
        self.0.kind(cell)
    }

    fn section(&self, cell: usize, point: Point) -> Result<Section> {
        Ok(Section { density: 1.0, ..self.0.section(cell, point)? })
    }
}

/// Value and second derivatives (xx, xy, yy) of a deflection at a point.
pub type Jet = [f64; 4];

/// Quadrature points of a mesh, exact for the bending energy of its own deflections.
///
/// Squares of the deflections are integrated with a small error.
pub struct Points {
    /// Coordinates of the points, in m.
    pub at: Vec<Point>,
    /// Weights as areas, in m2.
    weights: Vec<f64>,
    /// Bending stiffness at each point, in N m.
    bending: Vec<Matrix3<f64>>,
}

impl Points {
    /// Places six points on each piece of each cell.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a cell that cannot carry its element, and the errors of
    /// `sections`.
    pub fn new(mesh: &Mesh, sections: &impl Sections) -> Result<Points> {
        let mut points = Points { at: Vec::new(), weights: Vec::new(), bending: Vec::new() };
        for cell in 0..mesh.cells.len() {
            for (point, area) in mesh.element(cell)?.quadrature((&quadrature::DEGREE_3).into()) {
                points.at.push(point);
                points.weights.push(area);
                points.bending.push(sections.section(cell, point)?.bending);
            }
        }
        Ok(points)
    }

    /// Returns the norms of the difference of two deflections at these points.
    pub fn distance(&self, a: &[Jet], b: &[Jet]) -> Norms {
        let (mut square, mut energy) = (0.0, 0.0);
        for (((weight, bending), a), b) in self.weights.iter().zip(&self.bending).zip(a).zip(b) {
            let [w, curvatures @ ..]: Jet = std::array::from_fn(|i| a[i] - b[i]);
            let curvatures = Vector3::from(curvatures);
            square += weight * w * w;
            energy += weight * curvatures.dot(&(bending * curvatures));
        }
        Norms { l2: square.sqrt(), energy: energy.max(0.0).sqrt() }
    }
}

/// Returns the jet of a basis function.
fn jet(function: BasisFunction) -> Jet {
    let [xx, xy, yy] = function.hessian;
    [function.value, xx, xy, yy]
}

/// Evaluation of the displacements of a space at fixed points.
pub struct Sampler {
    /// Free dofs of the cell of each point, with the jets of their basis functions.
    points: Vec<Vec<(usize, Jet)>>,
}

impl Sampler {
    /// Locates points in a mesh.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a point outside the mesh.
    pub fn new(mesh: &Mesh, space: &DofMap, points: &[Point]) -> Result<Sampler> {
        let mut cells: Vec<Option<AnyElement>> = vec![None; mesh.cells.len()];
        let locate = |point: &Point| {
            let outside =
                || Error::Mesh(format!("the point ({}, {}) lies outside the plate", point.x, point.y));
            let cell = mesh.locate(*point).ok_or_else(outside)?;
            let element = match &mut cells[cell] {
                Some(element) => element,
                new => new.insert(mesh.element(cell)?),
            };
            let jets = element.basis_at(*point).into_iter().map(jet);
            let dofs = space.dofs_of(mesh.cells[cell].nodes());
            Ok(dofs.zip(jets).filter_map(|(dof, jet)| Some((dof?, jet))).collect())
        };
        Ok(Sampler { points: points.iter().map(locate).collect::<Result<_>>()? })
    }

    /// Returns the jets of a displacement, one per point.
    pub fn jets(&self, u: &[f64]) -> Vec<Jet> {
        let jet = |basis: &Vec<(usize, Jet)>| {
            basis.iter().fold([0.0; 4], |sum, (dof, jet)| std::array::from_fn(|i| sum[i] + u[*dof] * jet[i]))
        };
        self.points.iter().map(jet).collect()
    }
}
