//! Elastic edges of this process's part of the plate.

use super::ground::BuildContext;
use crate::assembly::{self, EdgeSprings};
use crate::communicator::Communicator;
use crate::dof_map::{NodeConstraint, Place, Support};
use crate::error::Result;
use crate::linalg::ElementMatrix;
use crate::mesh::Mesh;
use crate::partition::Partition;
use crate::scene;
use crate::simulation::regions::supports;

/// Springs along edges.
#[derive(Default)]
pub(super) struct ElasticEdges {
    /// Contributions to K, each with its cell.
    pub blocks: Vec<(usize, ElementMatrix)>,
    /// Rigid motions that the springs restrain, as constraints at the nodes of the edges.
    pub holds: Vec<(usize, NodeConstraint)>,
}

impl ElasticEdges {
    /// Finds the springs of all elastic supports. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<P>) -> Result<ElasticEdges> {
        let BuildContext { scene, mesh, cells, .. } = *ground;
        if scene.supports.iter().all(|support| support.elastic.is_none()) {
            return Ok(ElasticEdges::default());
        }
        let mut sides = Vec::new();
        for (support, (place, _)) in scene.supports.iter().zip(supports(scene, mesh, ground.comm())?) {
            sides.extend(springs_of(ground, support, &place));
        }
        let holds = sides.iter().flat_map(|(side, springs)| constraints(mesh, *side, *springs)).collect();
        let blocks = ground.comm().all_ok(assembly::edge_springs(mesh, cells, sides))?;
        Ok(ElasticEdges { blocks, holds })
    }
}

/// Returns the sides of this process with the springs of a support, none unless it is elastic.
/// Collective.
pub(super) fn springs_of<P: Partition>(
    ground: &BuildContext<P>,
    support: &scene::Support,
    place: &Place,
) -> Vec<([usize; 2], EdgeSprings)> {
    let (Some(of), Place::Edges(edge)) = (support.elastic, place) else { return Vec::new() };
    let springs = EdgeSprings { stiffness: of.stiffness.unwrap_or(0.0), rotation: of.rotation };
    let sides = own_sides(ground.mesh, edge.clone(), ground.comm());
    sides.into_iter().map(|side| (side, springs)).collect()
}

/// Returns the sides of this process that no process before it has: a side inside the plate may lie
/// between the parts of two. Collective.
fn own_sides(mesh: &Mesh, mut sides: Vec<[usize; 2]>, comm: &impl Communicator) -> Vec<[usize; 2]> {
    let middle =
        |[a, b]: &[usize; 2]| -> [f64; 2] { nalgebra::center(&mesh.nodes[*a], &mesh.nodes[*b]).into() };
    let middles: Vec<[f64; 2]> = sides.iter().map(middle).collect();
    let (all, first) = comm.all_gather_with_offset(&middles);
    sides.retain(|side| !all[..first].contains(&middle(side)));
    sides
}

/// Returns the constraints on rigid motions by springs along a side.
fn constraints(mesh: &Mesh, [a, b]: [usize; 2], springs: EdgeSprings) -> [(usize, NodeConstraint); 2] {
    let side = (mesh.nodes[b] - mesh.nodes[a]).normalize();
    let mut hold = NodeConstraint::default();
    if springs.stiffness > 0.0 {
        hold.deflection = 1.0;
    }
    if springs.rotation > 0.0 {
        hold.add(Support::Guided, Some(side.into()));
    }
    [(a, hold), (b, hold)]
}
