//! Membrane that follows the deflection of its plate.

use super::forces::{DeadLoad, InPlaneDisplacement};
use super::{Membrane, QuarticForm, Spaces, StrainPoint};
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
            let strain = |point: &StrainPoint| {
                let [x, y] = point.gradient(cell.places.iter().map(|&place| shape[place]));
                point.root * Vector3::new(0.5 * x * x, 0.5 * x * y, 0.5 * y * y)
            };
            cell.add_force(&cell.points, &cell.points.iter().map(strain).collect::<Vec<_>>(), &mut force);
        }
        membrane.factor.solve(&mut force)?;
        Ok(InPlaneDisplacement::of(&self.spaces, &force))
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
