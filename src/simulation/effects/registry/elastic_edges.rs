//! Elastic edges: springs along edges of the plate, against deflection and against rotation.

use crate::assembly::{self, EdgeSprings};
use crate::communicator::Communicator;
use crate::dof_map::{NodeConstraint, Place, Support};
use crate::error::Result;
use crate::mesh::Mesh;
use crate::partition::Partition;
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::regions::supports;

/// Adds the springs of all elastic supports. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let BuildContext { scene, mesh, .. } = *ground;
    let comm = ground.comm();
    if scene.supports.iter().all(|support| support.elastic.is_none()) {
        return Ok(());
    }
    let places = supports(scene, mesh, comm)?;
    for (number, (support, (place, _))) in scene.supports.iter().zip(places).enumerate() {
        let (Some(elastic), Place::Edges(edge)) = (support.elastic, place) else { continue };
        let springs = EdgeSprings { stiffness: elastic.stiffness.unwrap_or(0.0), rotation: elastic.rotation };
        let sides = own_sides(mesh, edge, comm);
        sum.restraints.extend(sides.iter().flat_map(|side| restraints(mesh, *side, springs)));
        let sides = sides.into_iter().map(|side| (side, springs));
        sum.add_stiffness(comm.all_ok(assembly::edge_springs(mesh, sides))?, true, Some(number));
    }
    Ok(())
}

/// Returns the sides of this process that no process before it has: a side inside the plate may lie
/// between the parts of two. Collective.
fn own_sides(mesh: &Mesh, mut sides: Vec<[usize; 2]>, comm: &impl Communicator) -> Vec<[usize; 2]> {
    let middle =
        |[a, b]: &[usize; 2]| -> [f64; 2] { nalgebra::center(&mesh.nodes[*a], &mesh.nodes[*b]).into() };
    let middles: Vec<[f64; 2]> = sides.iter().map(middle).collect();
    let (middles, first) = comm.all_gather_with_offset(&middles);
    sides.retain(|side| !middles[..first].contains(&middle(side)));
    sides
}

/// Returns the restraints of rigid motions by springs along a side.
fn restraints(mesh: &Mesh, [a, b]: [usize; 2], springs: EdgeSprings) -> [Restraint; 2] {
    let side = (mesh.nodes[b] - mesh.nodes[a]).normalize();
    let mut hold = NodeConstraint::default();
    if springs.stiffness > 0.0 {
        hold.deflection = 1.0;
    }
    if springs.rotation > 0.0 {
        hold.add(Support::Guided, Some(side.into()));
    }
    [a, b].map(|node| Restraint { node, point: mesh.nodes[node], hold })
}
