//! Linear algebra and the mesh over all ranks, on the handles of [`petsc`](crate::petsc).
//!
//! A mesh is partitioned into one [`Part`] per rank. [`Distributed`] is the engine over the dofs of
//! all parts: products cell by cell, factors by substructures or by PETSc.
//! [`MeshPart`] relates the dofs and nodes of a part to the engine and to the other ranks.

mod assembled;
mod cascade;
mod engine;
mod exchange;
mod factor;
mod fields;
mod hierarchy;
mod mesh_part;
mod own_mesh;
mod part;
mod products;
mod replicated;
mod substructure;

pub use engine::Distributed;
pub use factor::PetscFactor;
pub use fields::IN_PLANE;
pub use hierarchy::Hierarchy;
pub use mesh_part::MeshPart;
pub use own_mesh::sum_at_nodes;
pub use part::{Part, Refinements, Supports, Tips};
pub use replicated::ReplicatedFactor;
