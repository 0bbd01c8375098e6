//! Membrane that follows the deflection of its plate.

use super::forces::{DeadLoad, InPlaneDisplacement};
use super::{MOST, Membrane, MembraneCell, QuarticForm, Spaces, StrainPoint};
use crate::communicator::Communicator;
use crate::element::adaptive::Rules;
use crate::error::Result;
use crate::kernels::wide::widest;
use crate::mesh::{Mesh, Point};
use crate::plate::Sections;
use nalgebra::Vector3;
use pulp::Arch;
use std::cell::RefCell;
use std::rc::Rc;

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

    /// Returns the displacement in the plane for deflections and slopes at the nodes of this
    /// process, three per node. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn follow(&self, shape: &[f64]) -> Result<InPlaneDisplacement> {
        Ok(InPlaneDisplacement::of(&self.spaces, &self.dofs(shape)?))
    }

    /// Returns the local dofs of the displacement in the plane.
    fn dofs(&self, shape: &[f64]) -> Result<Vec<f64>> {
        let mut membrane = self.membrane.borrow_mut();
        let mut dofs = vec![0.0; membrane.dofs];
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for cell in &membrane.cells {
                    let (local, mut sums) = (cell.local_shape(shape), [[0.0; MOST]; 2]);
                    for point in cell.points.iter() {
                        point.add_force(point.bent(point.gradient(&local)), &mut sums);
                    }
                    cell.subtract_forces(&sums, &mut dofs);
                }
            },
        );
        membrane.solver.solve(&mut dofs)?;
        Ok(dofs)
    }

    /// Adds the gradient of the energy V of stretching, for deflections and slopes at the nodes of
    /// this process, to `gradient`, three entries per node: in N for deflections. Returns V, in J.
    /// Both are sums over the cells of this process. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn evaluate(&self, shape: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let dofs = self.dofs(shape)?;
        let membrane = self.membrane.borrow();
        let mut energy = 0.0;
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for cell in &membrane.cells {
                    let (bent, local) = (cell.local_shape(shape), cell.local(&dofs));
                    let mut pull = [0.0; MOST];
                    for point in cell.points.iter() {
                        let slope = point.gradient(&bent);
                        let strain = point.bent(slope) + point.weighted_strain(&local);
                        energy += 0.5 * strain.norm_squared();
                        point.add_flux(flux(point.force(strain), slope), &mut pull);
                    }
                    for i in 0..cell.places.len() {
                        gradient[cell.places[i]] += pull[i];
                    }
                }
            },
        );
        Ok(energy)
    }

    /// Returns for each cell the geometric stiffness of the force of stretching over its
    /// deflections and slopes. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    pub fn geometric_stiffness(&self, shape: &[f64]) -> Result<Vec<Rc<[f64]>>> {
        let dofs = self.dofs(shape)?;
        let cell = |cell: &MembraneCell| {
            let (bent, local) = (cell.local_shape(shape), cell.local(&dofs));
            let count = cell.places.len();
            let mut columns = vec![[0.0; MOST]; count];
            for point in cell.points.iter() {
                let strain = point.bent(point.gradient(&bent)) + point.weighted_strain(&local);
                let force = point.force(strain);
                for (i, column) in columns.iter_mut().enumerate() {
                    point.add_flux(flux(force, point.gradients.map(|gradient| gradient[i])), column);
                }
            }
            columns.iter().flat_map(|column| &column[..count]).copied().collect()
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
        part: (&Mesh, &impl Communicator),
        sections: &impl Sections,
        expansion: (&dyn Fn(usize, Point) -> Result<f64>, &Rules),
        loads: &[DeadLoad],
    ) -> Result<InPlaneDisplacement> {
        let mut membrane = self.membrane.borrow_mut();
        InPlaneDisplacement::new(part, &self.spaces, &mut membrane, sections, expansion, loads)
    }
}

/// Returns the flux of a membrane force, as its work on the strains xx, xy, yy, along a slope.
#[inline(always)]
fn flux([xx, xy, yy]: [f64; 3], [x, y]: [f64; 2]) -> [f64; 2] {
    // The middle component works on both shear strains.
    [xx * x + 0.5 * xy * y, 0.5 * xy * x + yy * y]
}

impl StrainPoint {
    /// Returns the weighted strain R e that a slope alone causes.
    #[inline(always)]
    fn bent(&self, [x, y]: [f64; 2]) -> Vector3<f64> {
        self.weighted([0.5 * x * x, 0.5 * x * y, 0.5 * y * y])
    }
}
