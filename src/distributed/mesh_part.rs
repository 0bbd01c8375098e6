//! Relation of a rank's part of the mesh to the parts of the other ranks.

use super::engine::Distributed;
use super::own_mesh::sum_at_nodes;
use super::part::Part;
use super::products::CellProducts;
use crate::error::Result;
use crate::linalg::Engine;
use crate::partition::Partition;
use crate::petsc::{Plex, WorldComm};
use std::rc::Rc;

/// Part of the mesh of one rank.
#[derive(Clone)]
pub struct MeshPart {
    comm: WorldComm,
    plex: Rc<Plex>,
    /// Engine's index of each local dof, if this rank owns it.
    own_dofs: Rc<[Option<usize>]>,
    /// Whether this rank owns each node.
    own_nodes: Rc<[bool]>,
    products: Rc<CellProducts>,
}

impl MeshPart {
    /// Relates a part of a plate to the dofs of its engine. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(part: &Part, engine: &Distributed) -> Result<MeshPart> {
        Ok(MeshPart {
            comm: engine.comm().clone(),
            plex: part.plex.clone(),
            own_dofs: (0..part.space.dofs()).map(|local| engine.own_dof(local)).collect(),
            own_nodes: part.owns.as_slice().into(),
            products: engine.products.clone(),
        })
    }
}

impl Partition for MeshPart {
    type Comm = WorldComm;

    fn comm(&self) -> &WorldComm {
        &self.comm
    }

    fn own_dof(&self, local: usize) -> Option<usize> {
        self.own_dofs[local]
    }

    fn owns_node(&self, node: usize) -> bool {
        self.own_nodes[node]
    }

    fn add_up(&self, local: &[f64]) -> Result<Vec<f64>> {
        let mut sums = vec![0.0; self.own_dofs.iter().flatten().count()];
        self.products.add_up(local, &mut sums);
        Ok(sums)
    }

    fn sum_at_nodes(&self, nodal: &[f64]) -> Result<Vec<f64>> {
        sum_at_nodes(&self.plex, nodal)
    }
}
