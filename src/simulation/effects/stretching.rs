//! Stretching: the energy of the mid-plane, over the dofs or in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretched_equilibrium::least_energy;
use crate::communicator::Communicator;
use crate::dof_map::DofMap;
use crate::error::Result;
use crate::linalg::{ElementMatrix, Form};
use crate::membrane::{FollowingMembrane, QuarticForm};
use crate::partition::Partition;
use crate::scheme::{StretchingEnergy, System};
use crate::simulation::phase;
use faer::Mat;
use std::rc::Rc;

/// Energy of stretching over the dofs.
pub(super) struct NodalEnergy<P: Partition> {
    membrane: Rc<FollowingMembrane>,
    partition: P,
    space: DofMap,
}

impl<P: Partition> NodalEnergy<P> {
    /// Creates it; `None` for a plate that only bends.
    pub fn new(ground: &BuildContext<P>) -> Option<NodalEnergy<P>> {
        let membrane = ground.membrane.following.clone()?;
        Some(NodalEnergy { membrane, partition: ground.partition.clone(), space: ground.space.clone() })
    }

    /// Returns deflections and slopes at the nodes of this process, three per node. Collective.
    fn shape(&self, u: &[f64]) -> Vec<f64> {
        self.space.shape(&self.partition.to_local(u))
    }

    /// Returns the geometric stiffness of the membrane force at a displacement (m), cell by cell of
    /// this process. Collective.
    ///
    /// # Errors
    /// Returns the errors of the membrane.
    pub fn geometric_stiffness(&self, ground: &BuildContext<P>, u: &[f64]) -> Result<Vec<ElementMatrix>> {
        let matrices = self.partition.comm().all_ok(self.membrane.geometric_stiffness(&self.shape(u)))?;
        let cells = ground.cells.iter().zip(&matrices).enumerate();
        Ok(cells.map(|(number, (cell, matrix))| cell.form(matrix, number)).collect())
    }

    /// Returns V, in J, and the forces V' at the nodes, three per node: the part of the cells of
    /// this process.
    fn part(&self, u: &[f64]) -> Result<(f64, Vec<f64>)> {
        let shape = self.shape(u);
        let mut force = vec![0.0; shape.len()];
        let energy = self.membrane.evaluate(&shape, &mut force);
        Ok((self.partition.comm().all_ok(energy)?, force))
    }

    /// Returns the forces V' at the nodes of this process, three per node: this process's part.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the membrane.
    pub fn at_nodes(&self, u: &[f64]) -> Result<Vec<f64>> {
        Ok(self.part(u)?.1)
    }
}

impl<P: Partition> StretchingEnergy for NodalEnergy<P> {
    fn evaluate(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let (energy, force) = self.part(u)?;
        gradient.copy_from_slice(&self.partition.add_up(&self.space.restrict(&force))?);
        Ok(self.partition.comm().all_reduce_sum(energy))
    }
}

/// Returns the energy of stretching over the dofs; `None` with the modal mass, or where the plate
/// only bends.
pub(super) fn over_dofs<P: Partition>(
    ground: &BuildContext<P>,
    mass: &Form,
) -> Option<Box<dyn StretchingEnergy>> {
    let energy = NodalEnergy::new(ground).filter(|_| !matches!(mass, Form::Modal { .. }))?;
    Some(Box::new(energy))
}

/// Returns the energy of stretching in the modes of the mass, with the geometric stiffness of
/// forces that buckle the plate; `None` where the scene has none.
///
/// # Errors
/// Returns the errors of the supports and of the membrane.
pub(super) fn form<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    geometric: Option<&Form>,
) -> Result<Option<QuarticForm>> {
    let space = ground.space;
    let (Some(membrane), Form::Modal { modes, .. }) = (&ground.membrane.following, &system.mass) else {
        return Ok(None);
    };
    phase("stretching");
    let shape = |k: usize| space.shape(modes.shapes.col_as_slice(k));
    let shapes: Vec<Vec<f64>> = (0..modes.count()).map(shape).collect();
    let mut form = membrane.form(&shapes, &modes.squares)?;
    if let Some(geometric) = geometric {
        let mut products = Mat::zeros(modes.shapes.nrows(), modes.count());
        for k in 0..modes.count() {
            let (shape, product) = (modes.shapes.col_as_slice(k), products.col_as_slice_mut(k));
            system.engine.multiply(geometric, shape, product)?;
        }
        form.add_geometric(&(modes.shapes.transpose() * products));
        form.count_from(least_energy(&form, modes, space)?);
    }
    Ok(Some(form))
}
