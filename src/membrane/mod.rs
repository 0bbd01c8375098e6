//! The plate in its plane: membrane strain and force, and the displacement that minimises their
//! energy (von Karman).
//!
//! With the displacement u in the plane and the deflection w the strain of the mid-plane is
//!
//! ```math
//! \epsilon = \mathrm{sym}\, \nabla u + \tfrac12\, \nabla w \otimes \nabla w, \qquad
//!    V = \tfrac12 \int \epsilon : A : \epsilon, \qquad A = \frac{12}{h^2} D
//! ```
//!
//! with the stiffness D of bending. Inertia in the plane is left out, so that u is the minimiser of
//! V for a given w. Both components of u are functions of the same elements as w, which contain
//! all quadratics: no membrane locks. Three points per piece integrate the energy.

mod following;
mod forces;
mod quartic;
mod spaces;

pub use following::FollowingMembrane;
pub use forces::{DeadLoad, InPlaneDisplacement, MembranePoint};
pub use quartic::{QuarticForm, Stretch};
pub use spaces::{InPlaneHold, InPlaneSupport, Spaces, spaces};

use crate::dof_map::{DofMap, PER_NODE};
use crate::element::quadrature::{self, Rule};
use crate::element::{Element, with_element};
use crate::error::{Error, Result};
use crate::linalg::{CellClass, ElementMatrix, Engine, Factor, Native};
use crate::mesh::Mesh;
use crate::plate::Sections;
use nalgebra::{Matrix3, Vector3};

/// Membrane of a plate, over the free dofs of both components of the displacement in the plane.
pub struct Membrane {
    cells: Vec<MembraneCell>,
    dofs: usize,
    factor: Box<dyn Factor>,
}

/// Cell of a membrane.
struct MembraneCell {
    /// Place of each local deflection and slope in the list for all nodes, three per node.
    places: Vec<usize>,
    /// Free dof of each local dof of both components, one after the other, with its factor.
    dofs: Vec<Option<(usize, f64)>>,
    points: Vec<StrainPoint>,
}

/// Point of the quadrature of a cell.
struct StrainPoint {
    /// Root R of the weight times the stiffness, `$R^T R = \omega A$`, for the strains xx, xy, yy.
    root: Matrix3<f64>,
    /// Gradients of the local basis functions.
    gradients: Vec<[f64; 2]>,
}

impl StrainPoint {
    /// Returns the gradient of a function with these local values.
    fn gradient(&self, values: &[f64]) -> [f64; 2] {
        let pairs = values.iter().zip(&self.gradients);
        pairs.fold([0.0; 2], |[x, y], (value, g)| [x + value * g[0], y + value * g[1]])
    }

    /// Adds the forces of a flux through the gradients of the local basis functions.
    fn add_flux(&self, [x, y]: [f64; 2], forces: &mut [f64]) {
        forces.iter_mut().zip(&self.gradients).for_each(|(force, g)| *force += x * g[0] + y * g[1]);
    }

    /// Returns the strain of the local dof `i` of both components.
    fn strain(&self, i: usize) -> Vector3<f64> {
        let count = self.gradients.len();
        let [x, y] = self.gradients[i % count];
        if i < count { Vector3::new(x, 0.5 * y, 0.0) } else { Vector3::new(0.0, 0.5 * x, y) }
    }

    /// Returns the weighted strain R e of a local displacement of both components.
    fn weighted_strain(&self, displacement: &[f64]) -> Vector3<f64> {
        let (along, across) = displacement.split_at(self.gradients.len());
        let [xx, xy] = self.gradient(along);
        let [yx, yy] = self.gradient(across);
        self.root * Vector3::new(xx, 0.5 * (xy + yx), yy)
    }
}

impl MembraneCell {
    /// Returns the values of a displacement at the local dofs.
    fn local(&self, u: &[f64]) -> Vec<f64> {
        self.dofs.iter().map(|dof| dof.map_or(0.0, |(dof, factor)| factor * u[dof])).collect()
    }

    /// Returns the slopes at the points, for deflections and slopes at all nodes.
    fn slopes(&self, shape: &[f64]) -> Vec<[f64; 2]> {
        let local: Vec<f64> = self.places.iter().map(|&place| shape[place]).collect();
        self.points.iter().map(|point| point.gradient(&local)).collect()
    }

    /// Adds the force `$-\int \mathrm{sym}\nabla v : A : e$` of weighted strains R e at points.
    fn add_force(&self, points: &[StrainPoint], strains: &[Vector3<f64>], force: &mut [f64]) {
        let mut sums = vec![0.0; self.dofs.len()];
        let (along, across) = sums.split_at_mut(self.places.len());
        for (point, weighted) in points.iter().zip(strains) {
            // The middle component works on both shear strains.
            let [xx, xy, yy] = point.root.tr_mul(weighted).into();
            point.add_flux([xx, 0.5 * xy], along);
            point.add_flux([0.5 * xy, yy], across);
        }
        for ((dof, factor), sum) in self.dofs.iter().zip(sums).filter_map(|(dof, sum)| Some(((*dof)?, sum))) {
            force[dof] -= factor * sum;
        }
    }

    /// Returns the stiffness in the plane over the local dofs with a free dof.
    fn stiffness(&self, number: usize) -> ElementMatrix {
        let free: Vec<usize> = (0..self.dofs.len()).filter(|&i| self.dofs[i].is_some()).collect();
        let factor = |i: usize| self.dofs[i].map_or(0.0, |(_, factor)| factor);
        let mut matrix = vec![0.0; free.len() * free.len()];
        for point in &self.points {
            let rows: Vec<Vector3<f64>> =
                free.iter().map(|&i| point.root * point.strain(i) * factor(i)).collect();
            for (a, row) in rows.iter().enumerate() {
                for (b, column) in rows.iter().enumerate() {
                    matrix[a * free.len() + b] += row.dot(column);
                }
            }
        }
        let dofs = free.iter().map(|&i| self.dofs[i].map(|(dof, _)| dof)).collect();
        ElementMatrix { dofs, matrix: matrix.into(), bending: None, class: CellClass::Bare(number) }
    }
}

impl Membrane {
    /// Creates the membrane of a mesh with the [spaces](spaces()) of both components.
    ///
    /// # Errors
    /// Returns the errors of cells and sections, and [`Error::Singular`] where the spaces leave
    /// the plate free to move in its plane.
    pub fn new(mesh: &Mesh, Spaces { maps, .. }: &Spaces, sections: &impl Sections) -> Result<Membrane> {
        let cell = |number| cell(mesh, number, maps, sections);
        let cells: Vec<MembraneCell> = (0..mesh.cells.len()).map(cell).collect::<Result<_>>()?;
        let dofs = maps[0].dofs() + maps[1].dofs();
        let engine = Native::new(dofs);
        let blocks = cells.iter().enumerate().map(|(number, cell)| cell.stiffness(number)).collect();
        let stiffness = engine.form(blocks);
        let factor = engine.factor(&(&stiffness).into(), &[])?;
        Ok(Membrane { cells, dofs, factor })
    }
}

/// Returns a cell of the membrane.
fn cell(mesh: &Mesh, number: usize, spaces: &[DofMap; 2], sections: &impl Sections) -> Result<MembraneCell> {
    let nodes = mesh.cells[number].nodes();
    let places: Vec<usize> = nodes.iter().flat_map(|node| PER_NODE * node..PER_NODE * (node + 1)).collect();
    let shift = spaces[0].dofs();
    let along = places.iter().map(|&place| spaces[0].dof(place));
    let across = places.iter().map(|&place| spaces[1].dof(place));
    let across = across.map(|dof| dof.map(|(dof, factor)| (shift + dof, factor)));
    let dofs = along.chain(across).collect();
    let points = with_element!(&mesh.element(number)?, element => points(element, number, (&quadrature::DEGREE_2).into(), sections))?;
    Ok(MembraneCell { places, dofs, points })
}

/// Returns the points of a rule in a cell.
fn points<const N: usize>(
    element: &Element<N>,
    cell: usize,
    rule: Rule,
    sections: &impl Sections,
) -> Result<Vec<StrainPoint>> {
    let mut points = Vec::new();
    for (number, piece) in element.pieces.iter().enumerate() {
        for &(barycentric, weight) in rule.of(number) {
            let section = sections.section(cell, element.point(number, barycentric))?;
            let stiffness = section.bending * (12.0 / section.thickness.powi(2) * weight * piece.area());
            let root = stiffness.cholesky().ok_or_else(|| {
                Error::Singular(format!("cell {cell}: the material has no stiffness in its plane"))
            })?;
            let gradients = piece.basis(barycentric).gradient.column_iter().map(|g| [g.x, g.y]).collect();
            points.push(StrainPoint { root: root.l().transpose(), gradients });
        }
    }
    Ok(points)
}
