//! Partition of a mesh over the ranks that build a model together.

use crate::communicator::{Communicator, SelfComm};
use crate::dof_map::{DofMap, NodeConstraint};
use crate::error::Result;
use crate::linalg::{ElementMatrix, Engine, Factor, Native};
use crate::mesh::Mesh;
use faer::Mat;

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

    /// Returns the values of a vector of the engine at the local dofs. Collective.
    fn to_local(&self, x: &[f64]) -> Vec<f64>;

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

    /// Factors a positive definite matrix of two fields, each with three dofs per node of the mesh,
    /// given cell by cell. The local dofs of the second field come after those of the first.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the matrix is not positive definite, and the errors
    /// of PETSc.
    fn factor_fields(
        &self,
        mesh: &Mesh,
        fields: &[NodalField; 2],
        blocks: Vec<ElementMatrix>,
    ) -> Result<Box<dyn LocalSolver>>;
}

/// Field with three dofs per node.
pub struct NodalField {
    /// Constraints at the nodes.
    pub holds: Vec<NodeConstraint>,
    /// Local dofs: of a divided mesh all of them, of a whole mesh the free ones.
    pub space: DofMap,
}

impl NodalField {
    /// Numbers the dofs of a field, given its constraints at the nodes of a part.
    pub fn new<P: Partition>(holds: Vec<NodeConstraint>) -> NodalField {
        let space = if P::DIVIDES { DofMap::of_all(&holds, 0, &[]) } else { DofMap::of(&holds) };
        NodalField { holds, space }
    }
}

/// Solver of a linear system over the local dofs of all ranks.
pub trait LocalSolver {
    /// Replaces the right-hand side, to which every rank contributes, by the solution. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    fn solve(&mut self, x: &mut [f64]) -> Result<()>;

    /// Works as [`LocalSolver::solve`] for one system per column. Collective.
    ///
    /// # Errors
    /// Returns the errors of the factor.
    fn solve_columns(&mut self, x: &mut Mat<f64>) -> Result<()> {
        (0..x.ncols()).try_for_each(|j| self.solve(x.col_as_slice_mut(j)))
    }
}

impl LocalSolver for Box<dyn Factor> {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.as_mut().solve(x)
    }

    fn solve_columns(&mut self, x: &mut Mat<f64>) -> Result<()> {
        self.as_mut().solve_columns(x)
    }
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

    fn to_local(&self, x: &[f64]) -> Vec<f64> {
        x.to_vec()
    }

    fn add_up(&self, local: &[f64]) -> Result<Vec<f64>> {
        Ok(local.to_vec())
    }

    fn sum_at_nodes(&self, of_nodes: &[f64]) -> Result<Vec<f64>> {
        Ok(of_nodes.to_vec())
    }
    fn factor_fields(
        &self,
        _: &Mesh,
        fields: &[NodalField; 2],
        blocks: Vec<ElementMatrix>,
    ) -> Result<Box<dyn LocalSolver>> {
        let engine = Native::new(fields.iter().map(|field| field.space.dofs()).sum());
        Ok(Box::new(engine.factor(&(&engine.form(blocks)).into(), &[])?))
    }
}
