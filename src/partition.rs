//! Partition of a mesh over the ranks that build a model together.

use crate::communicator::{Communicator, SelfComm};
use crate::error::Result;

/// Relation of this rank's part of the mesh to the parts of the other ranks and to the dofs of the
/// engine. A copy refers to the same part.
pub trait Partition: Clone + 'static {
    /// Communicator of the ranks that have the mesh.
    type Comm: Communicator;
    /// Whether the mesh is divided among any number of ranks, in a numbering of the engine's own.
    const DIVIDES: bool = true;

    /// Returns the communicator.
    fn comm(&self) -> &Self::Comm;

    /// Returns the engine's index of a local dof, if this rank owns it.
    fn own_dof(&self, local: usize) -> Option<usize>;

    /// Returns whether this rank owns a node of its part.
    fn owns_node(&self, node: usize) -> bool;

    /// Sums the contributions of all ranks over their local dofs, on the engine's dofs. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    fn add_up(&self, local: &[f64]) -> Result<Vec<f64>>;

    /// Returns, for each node of this rank, the sum of the values of all ranks that have the node.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    fn sum_at_nodes(&self, of_nodes: &[f64]) -> Result<Vec<f64>>;
}

/// Whole mesh on a single process, whose local dofs are those of the engine.
#[derive(Clone, Copy)]
pub struct WholeMesh;

impl Partition for WholeMesh {
    type Comm = SelfComm;
    const DIVIDES: bool = false;

    fn comm(&self) -> &SelfComm {
        &SelfComm
    }

    fn own_dof(&self, local: usize) -> Option<usize> {
        Some(local)
    }

    fn owns_node(&self, _: usize) -> bool {
        true
    }

    fn add_up(&self, local: &[f64]) -> Result<Vec<f64>> {
        Ok(local.to_vec())
    }

    fn sum_at_nodes(&self, of_nodes: &[f64]) -> Result<Vec<f64>> {
        Ok(of_nodes.to_vec())
    }
}
