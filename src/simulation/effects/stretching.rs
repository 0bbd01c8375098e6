//! Stretching: the energy of the mid-plane, over the dofs or in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretched_equilibrium::least_energy;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::error::Result;
use crate::linalg::Form;
use crate::membrane::{FollowingMembrane, QuarticForm};
use crate::partition::Partition;
use crate::scheme::{StretchingEnergy, System};
use crate::simulation::phase;
use faer::Mat;
use std::rc::Rc;

/// Energy of stretching over the dofs. Every process computes the energy of the whole plate.
struct NodalEnergy<P: Partition> {
    membrane: Rc<FollowingMembrane>,
    partition: P,
    space: DofMap,
    /// Node of the whole mesh of each node of this process, and the number of nodes of the whole.
    nodes: (Vec<usize>, usize),
}

impl<P: Partition> StretchingEnergy for NodalEnergy<P> {
    fn evaluate(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let NodalEnergy { membrane, partition, space, nodes: (nodes, count) } = self;
        let free: Vec<f64> =
            (0..space.dofs()).map(|dof| partition.own_dof(dof).map_or(0.0, |own_dof| u[own_dof])).collect();
        let places = || nodes.iter().flat_map(|node| PER_NODE * node..PER_NODE * (node + 1));
        let mut shape = vec![0.0; PER_NODE * count];
        // The one process that owns a node gives its values.
        places().zip(space.shape(&free)).for_each(|(place, value)| shape[place] += value);
        let shape = if P::DIVIDES { partition.comm().all_reduce_sum_slice(&shape) } else { shape };
        let mut force = vec![0.0; shape.len()];
        let energy = partition.comm().all_ok(membrane.evaluate(&shape, &mut force))?;
        let part: Vec<f64> = places().map(|place| force[place]).collect();
        gradient.fill(0.0);
        for (dof, value) in space.restrict(&part).into_iter().enumerate() {
            partition.own_dof(dof).into_iter().for_each(|own_dof| gradient[own_dof] = value);
        }
        Ok(energy)
    }
}

/// Returns the energy of stretching over the dofs; `None` with the modal mass, or where the plate
/// only bends.
pub(super) fn over_dofs<P: Partition>(
    ground: &BuildContext<P>,
    mass: &Form,
) -> Option<Box<dyn StretchingEnergy>> {
    let membrane = ground.membrane.following().filter(|_| !matches!(mass, Form::Modal { .. }))?;
    let whole = || ((0..ground.mesh.nodes.len()).collect(), ground.mesh.nodes.len());
    Some(Box::new(NodalEnergy {
        membrane: membrane.clone(),
        partition: ground.partition.clone(),
        space: ground.space.clone(),
        nodes: ground.membrane.nodes().cloned().unwrap_or_else(whole),
    }))
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
    let (Some(membrane), Form::Modal { modes, .. }) = (ground.membrane.following(), &system.mass) else {
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
