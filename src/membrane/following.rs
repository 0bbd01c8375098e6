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
        let mut membrane = self.membrane.borrow_mut();
        let mut force = vec![0.0; membrane.dofs];
        for cell in &membrane.cells {
            let slopes = cell.slopes(shape);
            let strains: Vec<_> = cell.points.iter().zip(&slopes).map(bent).collect();
            cell.add_force(&cell.points, &strains, &mut force);
        }
        membrane.factor.solve(&mut force)?;
        Ok(InPlaneDisplacement::of(&self.spaces, &force))
    }

    /// Adds the gradient of the energy V of stretching, for deflections and slopes at all nodes, to
    /// `gradient`, three entries per node: in N for deflections. Returns V, in J.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn evaluate(&self, shape: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let mut membrane = self.membrane.borrow_mut();
        let mut slopes = Vec::new();
        let mut displacement = vec![0.0; membrane.dofs];
        for cell in &membrane.cells {
            let first = slopes.len();
            slopes.extend(cell.slopes(shape));
            let strains: Vec<_> = cell.points.iter().zip(&slopes[first..]).map(bent).collect();
            cell.add_force(&cell.points, &strains, &mut displacement);
        }
        membrane.factor.solve(&mut displacement)?;
        let (mut energy, mut slopes) = (0.0, slopes.as_slice());
        for cell in &membrane.cells {
            let (of_cell, others) = slopes.split_at(cell.points.len());
            slopes = others;
            energy += cell.add_pull(of_cell, &cell.local(&displacement), gradient);
        }
        Ok(energy)
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

impl MembraneCell {
    /// Adds the force of the membrane on deflections and slopes at all nodes, for slopes at the
    /// points and a local displacement in the plane. Returns the energy, in J.
    fn add_pull(&self, slopes: &[[f64; 2]], displacement: &[f64], gradient: &mut [f64]) -> f64 {
        let (mut energy, mut sums) = (0.0, vec![0.0; self.places.len()]);
        for (point, [x, y]) in self.points.iter().zip(slopes) {
            let weighted = bent((point, &[*x, *y])) + point.weighted_strain(displacement);
            energy += 0.5 * weighted.norm_squared();
            let [xx, xy, yy] = point.root.tr_mul(&weighted).into();
            point.add_flux([xx * x + 0.5 * xy * y, 0.5 * xy * x + yy * y], &mut sums);
        }
        self.places.iter().zip(sums).for_each(|(&place, sum)| gradient[place] += sum);
        energy
    }
}
