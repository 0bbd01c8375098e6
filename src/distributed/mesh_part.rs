//! Relation of a rank's part of the mesh to the parts of the other ranks.

use super::engine::Distributed;
use super::fields::FieldsSolver;
use super::own_mesh::sum_at_nodes;
use super::part::Part;
use super::products::CellProducts;
use crate::error::Result;
use crate::linalg::{ElementMatrix, Engine};
use crate::mesh::Mesh;
use crate::partition::{LocalSolver, NodalField, Partition};
use crate::petsc::{Plex, Refinement, WorldComm};
use std::rc::{Rc, Weak};

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
    /// Coarser meshes, as long as the part keeps them.
    passed: Weak<Vec<(Plex, Refinement)>>,
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
            passed: Rc::downgrade(&part.passed),
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

    fn to_local(&self, x: &[f64]) -> Vec<f64> {
        self.products.with_local(x, <[f64]>::to_vec)
    }

    fn add_up(&self, local: &[f64]) -> Result<Vec<f64>> {
        let mut sums = vec![0.0; self.own_dofs.iter().flatten().count()];
        self.products.add_up(local, &mut sums);
        Ok(sums)
    }

    fn sum_at_nodes(&self, nodal: &[f64]) -> Result<Vec<f64>> {
        sum_at_nodes(&self.plex, nodal)
    }

    fn factor_fields(
        &self,
        mesh: &Mesh,
        fields: &[NodalField; 2],
        blocks: Vec<ElementMatrix>,
    ) -> Result<Box<dyn LocalSolver>> {
        let passed = self.passed.upgrade().unwrap_or_default();
        let part = (&*self.plex, mesh, &*self.own_nodes);
        Ok(Box::new(FieldsSolver::new(part, &passed, fields, blocks)?))
    }
}
