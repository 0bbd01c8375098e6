//! Stretching: the energy of the mid-plane, over the dofs or in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretched_equilibrium::least_energy;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::error::Result;
use crate::linalg::{ElementMatrix, Form};
use crate::membrane::QuarticForm;
use crate::partition::Partition;
use crate::scheme::{StretchingEnergy, System};
use crate::simulation::membrane_forces::PlateMembrane;
use crate::simulation::phase;
use faer::Mat;

/// Energy of stretching over the dofs. Every process computes the energy of the whole plate.
pub(super) struct NodalEnergy<P: Partition> {
    plate: PlateMembrane,
    partition: P,
    space: DofMap,
}

impl<P: Partition> NodalEnergy<P> {
    /// Creates it; `None` for a plate that only bends.
    pub fn new(ground: &BuildContext<P>) -> Option<NodalEnergy<P>> {
        let plate = ground.membrane.following()?.clone();
        Some(NodalEnergy { plate, partition: ground.partition.clone(), space: ground.space.clone() })
    }

    /// Returns the place of each deflection and slope of nodes of this process in the list for all
    /// nodes of the whole plate.
    fn places<'n>(&'n self, nodes: impl Iterator<Item = usize> + 'n) -> impl Iterator<Item = usize> + 'n {
        nodes.map(|node| self.plate.nodes[node]).flat_map(|node| PER_NODE * node..PER_NODE * (node + 1))
    }

    /// Returns deflections and slopes of the whole plate, three per node. Collective.
    fn whole(&self, u: &[f64]) -> Vec<f64> {
        let NodalEnergy { plate, partition, space } = self;
        let value = |dof| partition.own_dof(dof).map_or(0.0, |own_dof| u[own_dof]);
        plate.whole(partition, &space.shape(&(0..space.dofs()).map(value).collect::<Vec<_>>()))
    }

    /// Returns the geometric stiffness of the membrane force at a displacement (m), cell by cell of
    /// this process. Collective.
    ///
    /// # Errors
    /// Returns the errors of the membrane.
    pub fn geometric_stiffness(&self, ground: &BuildContext<P>, u: &[f64]) -> Result<Vec<ElementMatrix>> {
        let matrices = self.plate.membrane.geometric_stiffness(&self.whole(u));
        let matrices = self.partition.comm().all_ok(matrices)?;
        let block = |number: usize| {
            let (whole, matrix) = &matrices[self.plate.cells[number]];
            // The first node of a cell may be another one in the part than in the whole.
            let place = |place| whole.iter().position(|other| *other == place);
            let nodes = ground.mesh.cells[number].nodes();
            let order: Vec<usize> = self.places(nodes.iter().copied()).filter_map(place).collect();
            let row = |&i: &usize| order.iter().map(move |j| matrix[i * whole.len() + j]);
            ground.cells[number].form(&order.iter().flat_map(row).collect(), number)
        };
        Ok((0..ground.mesh.cells.len()).map(block).collect())
    }
}

impl<P: Partition> NodalEnergy<P> {
    /// Returns V, in J, and the forces V' at all nodes of this process, three per node.
    fn forces(&self, u: &[f64]) -> Result<(f64, Vec<f64>)> {
        let shape = self.whole(u);
        let mut force = vec![0.0; shape.len()];
        let energy = self.partition.comm().all_ok(self.plate.membrane.evaluate(&shape, &mut force))?;
        let nodes = 0..self.plate.nodes.len();
        Ok((energy, self.places(nodes).map(|place| force[place]).collect()))
    }

    /// Returns the forces V' at all nodes, three per node, on the process that owns the node.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the membrane.
    pub fn at_nodes(&self, u: &[f64]) -> Result<Vec<f64>> {
        let (_, mut forces) = self.forces(u)?;
        for (node, force) in forces.chunks_exact_mut(PER_NODE).enumerate() {
            if !self.partition.owns_node(node) {
                force.fill(0.0);
            }
        }
        Ok(forces)
    }
}

impl<P: Partition> StretchingEnergy for NodalEnergy<P> {
    fn evaluate(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64> {
        let (energy, part) = self.forces(u)?;
        gradient.fill(0.0);
        for (dof, value) in self.space.restrict(&part).into_iter().enumerate() {
            self.partition.own_dof(dof).into_iter().for_each(|own_dof| gradient[own_dof] = value);
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
    let (Some(plate), Form::Modal { modes, .. }) = (ground.membrane.following(), &system.mass) else {
        return Ok(None);
    };
    phase("stretching");
    let shape = |k: usize| space.shape(modes.shapes.col_as_slice(k));
    let shapes: Vec<Vec<f64>> = (0..modes.count()).map(shape).collect();
    let mut form = plate.membrane.form(&shapes, &modes.squares)?;
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
