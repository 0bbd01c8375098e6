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
pub use spaces::{InPlaneHold, InPlaneSupport, Spaces};

use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::element::quadrature::{self, Rule};
use crate::element::{Element, with_element};
use crate::error::{Error, Result};
use crate::linalg::{CellClass, ElementMatrix};
use crate::mesh::Mesh;
use crate::partition::{LocalSolver, NodalField, Partition};
use crate::plate::Sections;
use nalgebra::{Matrix3, Vector3};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::rc::Rc;

/// Membrane of a plate, over the local dofs of both components of the displacement in the plane.
pub struct Membrane {
    /// Cells of this process.
    cells: Vec<MembraneCell>,
    dofs: usize,
    solver: Box<dyn LocalSolver>,
}

/// Cell of a membrane.
struct MembraneCell {
    /// Place of each local deflection and slope in the list for all nodes, three per node.
    places: Vec<usize>,
    /// Local dof of each value and slope of both components, one after the other, with its factor.
    dofs: Vec<Option<(usize, f64)>>,
    /// Points of the quadrature, which congruent cells of the same section share.
    points: Rc<[StrainPoint]>,
}

/// Largest number of local deflections and slopes of a cell.
const MOST: usize = 12;

/// Values at local deflections and slopes, followed by zeros.
type Local = [f64; MOST];

/// Point of the quadrature of a cell.
struct StrainPoint {
    /// Root R of the weight times the stiffness, `$R^T R = \omega A$`, for the strains xx, xy, yy:
    /// an upper triangle.
    root: Matrix3<f64>,
    /// Components of the gradients of the local basis functions.
    gradients: [Local; 2],
}

// The loops below have a fixed length, so that registers hold several of their terms.
impl StrainPoint {
    /// Returns the gradient of a function with these local values.
    #[inline(always)]
    fn gradient(&self, values: &Local) -> [f64; 2] {
        [scalar_product(&self.gradients[0], values), scalar_product(&self.gradients[1], values)]
    }

    /// Adds the forces of a flux through the gradients of the local basis functions.
    #[inline(always)]
    fn add_flux(&self, [x, y]: [f64; 2], forces: &mut Local) {
        for i in 0..MOST {
            forces[i] += x * self.gradients[0][i] + y * self.gradients[1][i];
        }
    }

    /// Adds the forces of a weighted strain R e on both components.
    #[inline(always)]
    fn add_force(&self, strain: Vector3<f64>, [along, across]: &mut [Local; 2]) {
        // The middle component works on both shear strains.
        let [xx, xy, yy] = self.force(strain);
        self.add_flux([xx, 0.5 * xy], along);
        self.add_flux([0.5 * xy, yy], across);
    }

    /// Returns the strain of a local dof of a component.
    fn strain(&self, component: usize, i: usize) -> Vector3<f64> {
        let [x, y] = self.gradients.map(|gradient| gradient[i]);
        if component == 0 { Vector3::new(x, 0.5 * y, 0.0) } else { Vector3::new(0.0, 0.5 * x, y) }
    }

    /// Returns the weighted strain R e of a strain xx, xy, yy.
    #[inline(always)]
    fn weighted(&self, [xx, xy, yy]: [f64; 3]) -> Vector3<f64> {
        let root = &self.root;
        Vector3::new(
            root.m11 * xx + root.m12 * xy + root.m13 * yy,
            root.m22 * xy + root.m23 * yy,
            root.m33 * yy,
        )
    }

    /// Returns the weighted membrane force `$R^T R\, e$` of a weighted strain.
    #[inline(always)]
    fn force(&self, strain: Vector3<f64>) -> [f64; 3] {
        let (root, a, b, c) = (&self.root, strain.x, strain.y, strain.z);
        [root.m11 * a, root.m12 * a + root.m22 * b, root.m13 * a + root.m23 * b + root.m33 * c]
    }

    /// Returns the weighted strain of a local displacement.
    #[inline(always)]
    fn weighted_strain(&self, [along, across]: &[Local; 2]) -> Vector3<f64> {
        let [xx, xy] = self.gradient(along);
        let [yx, yy] = self.gradient(across);
        self.weighted([xx, 0.5 * (xy + yx), yy])
    }
}

/// Returns a scalar product in four sums that do not wait for each other.
#[inline(always)]
fn scalar_product(x: &Local, y: &Local) -> f64 {
    let mut sums = [0.0; 4];
    for start in (0..MOST).step_by(4) {
        for lane in 0..4 {
            sums[lane] += x[start + lane] * y[start + lane];
        }
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3])
}

impl MembraneCell {
    /// Returns the values of a displacement at the local dofs.
    #[inline(always)]
    fn local(&self, u: &[f64]) -> [Local; 2] {
        let mut values = [[0.0; MOST]; 2];
        let count = self.places.len();
        for i in 0..count {
            for component in 0..2 {
                if let Some((dof, factor)) = self.dofs[component * count + i] {
                    values[component][i] = factor * u[dof];
                }
            }
        }
        values
    }

    /// Returns the local deflections and slopes, given them at all nodes.
    #[inline(always)]
    fn local_shape(&self, shape: &[f64]) -> Local {
        let mut values = [0.0; MOST];
        for i in 0..self.places.len() {
            values[i] = shape[self.places[i]];
        }
        values
    }

    /// Returns the slopes at the points, for deflections and slopes at all nodes.
    fn slopes(&self, shape: &[f64]) -> Vec<[f64; 2]> {
        let local = self.local_shape(shape);
        self.points.iter().map(|point| point.gradient(&local)).collect()
    }

    /// Subtracts forces on both components at the local dofs.
    #[inline(always)]
    fn subtract_forces(&self, local: &[Local; 2], force: &mut [f64]) {
        let count = self.places.len();
        for component in 0..2 {
            for i in 0..count {
                if let Some((dof, factor)) = self.dofs[component * count + i] {
                    force[dof] -= factor * local[component][i];
                }
            }
        }
    }

    /// Adds the force `$-\int \mathrm{sym}\nabla v : A : e$` of weighted strains R e at points.
    fn add_force(&self, points: &[StrainPoint], strains: &[Vector3<f64>], force: &mut [f64]) {
        let mut sums = [[0.0; MOST]; 2];
        points.iter().zip(strains).for_each(|(point, strain)| point.add_force(*strain, &mut sums));
        self.subtract_forces(&sums, force);
    }

    /// Returns the stiffness in the plane over the local dofs with a free dof.
    fn stiffness(&self, number: usize) -> ElementMatrix {
        let free: Vec<usize> = (0..self.dofs.len()).filter(|&i| self.dofs[i].is_some()).collect();
        let factor = |i: usize| self.dofs[i].map_or(0.0, |(_, factor)| factor);
        let count = self.places.len();
        let mut matrix = vec![0.0; free.len() * free.len()];
        for point in self.points.iter() {
            let rows: Vec<Vector3<f64>> =
                free.iter().map(|&i| point.root * point.strain(i / count, i % count) * factor(i)).collect();
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
    /// Creates the membrane of a part of a mesh with the spaces of both components. Collective.
    ///
    /// # Errors
    /// Returns the errors of cells and sections, and [`Error::Singular`] where the spaces leave
    /// the plate free to move in its plane.
    pub fn new<P: Partition>(
        mesh: &Mesh,
        Spaces { components, .. }: &Spaces,
        sections: &impl Sections,
        partition: &P,
    ) -> Result<Membrane> {
        let (grain, mut congruent) = (mesh.grain(), HashMap::new());
        let cell = |number| {
            let class = (mesh.shape(number, grain), sections.kind(number).ok_or(number));
            let points: Rc<[StrainPoint]> = match congruent.entry(class) {
                Entry::Occupied(class) => Rc::clone(class.get()),
                Entry::Vacant(new) => new.insert(stiffness_points(mesh, number, sections)?.into()).clone(),
            };
            Ok(cell(mesh, number, components, points))
        };
        let cells: Result<Vec<MembraneCell>> = (0..mesh.cells.len()).map(cell).collect();
        let cells = partition.comm().all_ok(cells)?;
        let dofs = components.iter().map(|component| component.space.dofs()).sum();
        let blocks = cells.iter().enumerate().map(|(number, cell)| cell.stiffness(number)).collect();
        let solver = partition.factor_fields(mesh, components, blocks)?;
        Ok(Membrane { cells, dofs, solver })
    }
}

/// Returns a cell of the membrane with its points.
fn cell(
    mesh: &Mesh,
    number: usize,
    [along, across]: &[NodalField; 2],
    points: Rc<[StrainPoint]>,
) -> MembraneCell {
    let nodes = mesh.cells[number].nodes();
    let places: Vec<usize> = nodes.iter().flat_map(|node| PER_NODE * node..PER_NODE * (node + 1)).collect();
    let shift = along.space.dofs();
    let along = places.iter().map(|&place| along.space.dof(place));
    let across = places.iter().map(|&place| across.space.dof(place));
    let across = across.map(|dof| dof.map(|(dof, factor)| (shift + dof, factor)));
    let dofs = along.chain(across).collect();
    MembraneCell { places, dofs, points }
}

/// Returns the points of the stiffness in the plane of a cell.
fn stiffness_points(mesh: &Mesh, number: usize, sections: &impl Sections) -> Result<Vec<StrainPoint>> {
    with_element!(&mesh.element(number)?, element => points(element, number, (&quadrature::DEGREE_2).into(), sections))
}

/// Returns the points of a rule in a cell.
fn points<const N: usize>(
    element: &Element<N>,
    cell: usize,
    rule: Rule,
    sections: &impl Sections,
) -> Result<Vec<StrainPoint>> {
    let mut points = Vec::new();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let section = sections.section(cell, place)?;
        let stiffness = section.bending * (12.0 / section.thickness.powi(2) * weight * piece.area());
        let root = stiffness.cholesky().ok_or_else(|| {
            Error::Singular(format!("cell {cell}: the material has no stiffness in its plane"))
        })?;
        let basis = piece.basis(barycentric).gradient;
        let mut gradients = [[0.0; MOST]; 2];
        for (i, gradient) in basis.column_iter().enumerate() {
            (gradients[0][i], gradients[1][i]) = (gradient.x, gradient.y);
        }
        points.push(StrainPoint { root: root.l().transpose(), gradients });
    }
    Ok(points)
}
