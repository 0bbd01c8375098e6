//! Membrane that follows the deflection of its plate.

use super::forces::{DeadLoad, InPlaneDisplacement};
use super::{Membrane, MembraneCell, QuarticForm, Spaces, StrainPoint};
use crate::element::adaptive::Rules;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::plate::Sections;
use nalgebra::Vector3;
use std::cell::RefCell;

/// Membrane whose displacement in the plane minimises the energy for a given deflection.
pub struct FollowingMembrane {
    membrane: RefCell<Membrane>,
    spaces: Spaces,
}

impl FollowingMembrane {
    /// Creates it from a membrane with its spaces.
    pub fn new(membrane: Membrane, spaces: Spaces) -> FollowingMembrane {
        FollowingMembrane { membrane: membrane.into(), spaces }
    }

    /// Returns the displacement in the plane for deflections and slopes at all nodes, three per
    /// node.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn follow(&self, shape: &[f64]) -> Result<InPlaneDisplacement> {
        Ok(InPlaneDisplacement::of(&self.spaces, &self.dofs(shape)?))
    }

    /// Returns the free dofs of the displacement in the plane.
    fn dofs(&self, shape: &[f64]) -> Result<Vec<f64>> {
        let mut membrane = self.membrane.borrow_mut();
        let mut dofs = vec![0.0; membrane.dofs];
        for cell in &membrane.cells {
            let slopes = cell.slopes(shape);
            let strains: Vec<_> = cell.points.iter().zip(&slopes).map(bent).collect();
            cell.add_force(&cell.points, &strains, &mut dofs);
        }
        membrane.factor.solve(&mut dofs)?;
        Ok(dofs)
    }

    /// Adds the gradient of the energy V of stretching, for deflections and slopes at all nodes, to
    /// `gradient`, three entries per node: in N for deflections. Returns V, in J.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn evaluate(&self, shape: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let dofs = self.dofs(shape)?;
        let mut energy = 0.0;
        for cell in &self.membrane.borrow().cells {
            let mut pull = vec![0.0; cell.places.len()];
            for (point, (slope, force, of_point)) in cell.points.iter().zip(cell.forces(shape, &dofs)) {
                energy += of_point;
                point.add_flux(flux(force, slope), &mut pull);
            }
            cell.places.iter().zip(pull).for_each(|(&place, sum)| gradient[place] += sum);
        }
        Ok(energy)
    }

    /// Returns for each cell the places of deflections and slopes in the list for all nodes, and
    /// the geometric stiffness of the force of stretching over them.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn geometric_stiffness(&self, shape: &[f64]) -> Result<Vec<(Vec<usize>, Vec<f64>)>> {
        let dofs = self.dofs(shape)?;
        let cell = |cell: &MembraneCell| {
            let count = cell.places.len();
            let mut matrix = vec![0.0; count * count];
            for (point, (_, force, _)) in cell.points.iter().zip(cell.forces(shape, &dofs)) {
                for (column, basis) in matrix.chunks_exact_mut(count).zip(&point.gradients) {
                    point.add_flux(flux(force, *basis), column);
                }
            }
            (cell.places.clone(), matrix)
        };
        Ok(self.membrane.borrow().cells.iter().map(cell).collect())
    }

    /// Returns the energy of modes; see [`QuarticForm::new`].
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn form(&self, shapes: &[Vec<f64>], squares: &[f64]) -> Result<QuarticForm> {
        QuarticForm::new(&mut self.membrane.borrow_mut(), shapes, squares)
    }

    /// Returns the displacement in equilibrium; see [`InPlaneDisplacement::new`].
    ///
    /// # Errors
    /// Returns the errors of [`InPlaneDisplacement::new`].
    pub fn equilibrium(
        &self,
        mesh: &Mesh,
        sections: &impl Sections,
        expansion: (&dyn Fn(usize, Point) -> Result<f64>, &Rules),
        loads: &[DeadLoad],
    ) -> Result<InPlaneDisplacement> {
        let mut membrane = self.membrane.borrow_mut();
        InPlaneDisplacement::new(mesh, &self.spaces, &mut membrane, sections, expansion, loads)
    }
}

/// Returns the weighted strain R e of a point that its slopes alone cause.
fn bent((point, [x, y]): (&StrainPoint, &[f64; 2])) -> Vector3<f64> {
    point.root * Vector3::new(0.5 * x * x, 0.5 * x * y, 0.5 * y * y)
}

/// Returns the flux of a membrane force, as its work on the strains xx, xy, yy, along a slope.
fn flux([xx, xy, yy]: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    // The middle component works on both shear strains.
    [xx * x + 0.5 * xy * y, 0.5 * xy * x + yy * y]
}

impl MembraneCell {
    /// Returns the slope, the weighted membrane force and the energy (J) at each point, for
    /// deflections and slopes at all nodes and the dofs of the displacement in the plane.
    fn forces(&self, shape: &[f64], dofs: &[f64]) -> impl Iterator<Item = ([f64; 2], [f64; 3], f64)> {
        let local = self.local(dofs);
        self.points.iter().zip(self.slopes(shape)).map(move |(point, slope)| {
            let weighted = bent((point, &slope)) + point.weighted_strain(&local);
            (slope, point.root.tr_mul(&weighted).into(), 0.5 * weighted.norm_squared())
        })
    }
}
