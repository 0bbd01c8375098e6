//! Forces in the plane that do not depend on the deflection.
//!
//! A plate that is flat, heated and loaded at its edges is in equilibrium in its plane where
//!
//! ```math
//! \int \mathrm{sym}\, \nabla v : A : (\mathrm{sym}\, \nabla u - \epsilon_0) = \int_\Gamma t \cdot v
//! ```
//!
//! for all v, with the strain of free expansion `$\epsilon_0 = \alpha T\, I$` and dead loads t on
//! edges. Its membrane force is `$N = A : (\mathrm{sym}\, \nabla u - \epsilon_0)$`.

use super::{Membrane, MembraneCell, Spaces, points};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::element::adaptive::Rules;
use crate::element::quadrature::{self, Node, Rule};
use crate::element::{Element, with_element};
use crate::error::{Error, Result};
use crate::linalg::vectors::largest;
use crate::mesh::{Mesh, Point};
use crate::partition::NodalField;
use crate::plate::{Section, Sections};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Dead load on sides of cells.
#[derive(Debug, Clone, PartialEq)]
pub struct DeadLoad {
    /// Key of its table in the scene, for messages.
    pub key: String,
    /// Sides of cells, each by its two nodes.
    pub sides: Vec<[usize; 2]>,
    /// Force per length along x and y, in N/m.
    pub force: [f64; 2],
}

/// Part of a load that no support carries, relative to the load, above which there is no
/// equilibrium.
const CARRIED: f64 = 1e-9;

/// Displacement in the plane, of both components three values per node: the component, in m, and
/// its slopes.
#[derive(Debug, Clone, PartialEq)]
pub struct InPlaneDisplacement([Vec<f64>; 2]);

impl InPlaneDisplacement {
    /// Returns the displacement in equilibrium, for a free strain of expansion at a point of a
    /// cell, with other quadrature rules in some cells, and dead loads on sides of this process.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] for loads that nothing carries, and the errors of the free strain.
    pub fn new(
        (mesh, comm): (&Mesh, &impl Communicator),
        spaces: &Spaces,
        membrane: &mut Membrane,
        sections: &impl Sections,
        (free_strain, rules): (&dyn Fn(usize, Point) -> Result<f64>, &Rules),
        loads: &[DeadLoad],
    ) -> Result<InPlaneDisplacement> {
        let mut force = vec![0.0; membrane.dofs];
        let mut expand = |(number, cell): (usize, &MembraneCell)| {
            // Elsewhere the rule of the stiffness, by which a linear temperature causes no stress.
            let rule = rules.get(&number).map_or((&quadrature::DEGREE_2).into(), |rule| Rule::Own(rule));
            let (places, points) = with_element!(&mesh.element(number)?, element => {
                (places(element, rule), points(element, number, rule, sections)?)
            });
            let strains = places.into_iter().zip(&points).map(|(place, point)| {
                let strain = free_strain(number, place)?;
                Ok(point.weighted([-strain, 0.0, -strain]))
            });
            cell.add_force(&points, &strains.collect::<Result<Vec<_>>>()?, &mut force);
            Ok(())
        };
        comm.all_ok(membrane.cells.iter().enumerate().try_for_each(&mut expand))?;
        require_carried((mesh, comm), spaces, loads)?;
        let shift = spaces.components[0].space.dofs();
        for DeadLoad { sides, force: traction, .. } in loads {
            for &[a, b] in sides {
                for (node, place, share) in side_shares(mesh.nodes[b] - mesh.nodes[a], [a, b]) {
                    for (component, NodalField { space, .. }) in spaces.components.iter().enumerate() {
                        if let Some((dof, factor)) = space.dof(PER_NODE * node + place) {
                            force[component * shift + dof] += factor * share * traction[component];
                        }
                    }
                }
            }
        }
        membrane.solver.solve(&mut force)?;
        Ok(InPlaneDisplacement::of(spaces, &force))
    }

    /// Returns the displacement of local dofs.
    pub(super) fn of(
        Spaces { components: [along, across], .. }: &Spaces,
        dofs: &[f64],
    ) -> InPlaneDisplacement {
        let (x, y) = dofs.split_at(along.space.dofs());
        InPlaneDisplacement([along.space.shape(x), across.space.shape(y)])
    }
}

/// Point of a plate at which membrane forces are evaluated.
#[derive(Debug, Clone, PartialEq)]
pub struct MembranePoint {
    /// Place of each local deflection and slope in the list for all nodes, three per node.
    places: Vec<usize>,
    /// Gradients of the local basis functions, in 1/m for deflections.
    gradients: Vec<Vector2<f64>>,
    /// Stiffness A for the strains xx, xy, yy, in N/m.
    stiffness: Matrix3<f64>,
}

impl MembranePoint {
    /// Creates a point of a cell with a section.
    ///
    /// # Errors
    /// Returns the errors of the cell.
    pub fn new(mesh: &Mesh, cell: usize, point: Point, section: &Section) -> Result<MembranePoint> {
        let nodes = mesh.cells[cell].nodes();
        let places = nodes.iter().flat_map(|node| PER_NODE * node..PER_NODE * (node + 1)).collect();
        let gradients = with_element!(&mesh.element(cell)?, element => {
            element.basis_at(point).gradient.column_iter().map(Into::into).collect()
        });
        Ok(MembranePoint {
            places,
            gradients,
            stiffness: section.bending * (12.0 / section.thickness.powi(2)),
        })
    }

    /// Returns the gradient of a function given by its values at all nodes, three per node.
    fn gradient(&self, values: &[f64]) -> Vector2<f64> {
        self.gradients.iter().zip(&self.places).map(|(g, &place)| g * values[place]).sum()
    }

    /// Returns the membrane force xx, yy and xy of a displacement and a free strain of expansion,
    /// in N/m.
    pub fn force(&self, displacement: &InPlaneDisplacement, free_strain: f64) -> [f64; 3] {
        self.force_of(displacement, Vector3::new(-free_strain, 0.0, -free_strain))
    }

    /// Returns the membrane force xx, yy and xy of a plate with a deflection, given by its values
    /// and slopes at all nodes, and the displacement in the plane that follows it, in N/m.
    pub fn stretching_force(&self, displacement: &InPlaneDisplacement, shape: &[f64]) -> [f64; 3] {
        let slope = self.gradient(shape);
        let strain = Vector3::new(slope.x * slope.x, slope.x * slope.y, slope.y * slope.y);
        self.force_of(displacement, 0.5 * strain)
    }

    /// Returns the membrane force of a displacement and further strains xx, xy, yy.
    fn force_of(&self, displacement: &InPlaneDisplacement, more: Vector3<f64>) -> [f64; 3] {
        let [along, across] = displacement.0.each_ref().map(|values| self.gradient(values));
        let strain = Vector3::new(along.x, 0.5 * (along.y + across.x), across.y) + more;
        let [xx, xy, yy] = (self.stiffness * strain).into();
        // The middle row works on both shear strains.
        [xx, yy, 0.5 * xy]
    }
}

/// Returns the places of the points of a rule in a cell.
fn places<const N: usize>(element: &Element<N>, rule: Rule) -> Vec<Point> {
    let place = |piece, nodes: &[Node]| -> Vec<Point> {
        nodes.iter().map(|&(barycentric, _)| element.point(piece, barycentric)).collect()
    };
    (0..element.pieces.len()).flat_map(|piece| place(piece, rule.of(piece))).collect()
}

/// Returns the integrals over a side of the basis functions along it: node, place among its
/// deflection and slopes, and value, in m or m2. They are cubic.
fn side_shares(side: Vector2<f64>, [a, b]: [usize; 2]) -> [(usize, usize, f64); 6] {
    let (half, turned) = (0.5 * side.norm(), side * (side.norm() / 12.0));
    [(a, 0, half), (a, 1, turned.x), (a, 2, turned.y), (b, 0, half), (b, 1, -turned.x), (b, 2, -turned.y)]
}

/// Refuses loads with a resultant along a rigid motion that nothing holds. Collective.
fn require_carried(
    (mesh, comm): (&Mesh, &impl Communicator),
    spaces: &Spaces,
    loads: &[DeadLoad],
) -> Result<()> {
    let (mut resultant, mut sum) = (Vector3::zeros(), 0.0);
    for DeadLoad { sides, force: [x, y], .. } in loads {
        for &[a, b] in sides {
            let length = (mesh.nodes[b] - mesh.nodes[a]).norm();
            let arm = (nalgebra::center(&mesh.nodes[a], &mesh.nodes[b]) - spaces.centre) / spaces.size;
            resultant += Vector3::new(*x, *y, arm.x * y - arm.y * x) * length;
            sum += x.hypot(*y) * length;
        }
    }
    let [x, y, turn, sum] = comm.all_reduce_sum([resultant.x, resultant.y, resultant.z, sum]);
    let resultant = Vector3::new(x, y, turn);
    let free: Vector3<f64> = spaces.free.iter().map(|motion| motion * motion.dot(&resultant)).sum();
    if free.norm() <= CARRIED * sum {
        return Ok(());
    }
    let most = largest(free.iter().copied());
    let motion = match free.iter().position(|part| part.abs() == most) {
        Some(0) => "along x",
        Some(1) => "along y",
        _ => "about the z axis",
    };
    let key = loads.first().map_or("in_plane.traction", |load| load.key.as_str());
    Err(Error::Scene(format!(
        "{key}: the loads move the plate {motion}, which no support prevents; expected loads in equilibrium, or \
         supports that hold the plate in its plane"
    )))
}
