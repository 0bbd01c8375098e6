//! Check that each disconnected part of a mesh is held by itself.

use super::ground::BuildContext;
use super::lumps::LumpedMass;
use crate::communicator::Communicator;
use crate::dof_map::{NodeConstraint, PER_NODE, Rigid};
use crate::error::{Error, Result};
use crate::mesh::{Point, Unions};
use crate::partition::Partition;
use std::collections::BTreeSet;

/// Returns an error where the mesh has several parts and one of them is not held. Collective.
pub(super) fn require_held<P: Partition>(
    ground: &BuildContext<P>,
    springs: &[LumpedMass],
    on_edges: &[(usize, NodeConstraint)],
    on_foundation: impl Iterator<Item = usize>,
) -> Result<()> {
    if ground.scene.file.as_ref().is_none_or(|file| file.parts == 1) {
        return Ok(());
    }
    let mesh = ground.mesh;
    let (part_of, count) = parts(ground)?;
    // Number of nodes and sums of their positions per part, for the centres.
    let mut places = vec![0.0; 3 * count];
    for (node, &part) in mesh.nodes.iter().zip(&part_of) {
        [1.0, node.x, node.y].iter().enumerate().for_each(|(k, of)| places[3 * part + k] += of);
    }
    let places = ground.comm().all_reduce_sum_slice(&places);
    let centres: Vec<Point> = places.chunks_exact(3).map(|of| Point::new(of[1], of[2]) / of[0]).collect();
    let mut sizes = vec![0.0; 2 * count];
    for (node, &part) in mesh.nodes.iter().zip(&part_of) {
        sizes[2 * part] += (node - centres[part]).norm_squared();
        sizes[2 * part + 1] += 1.0;
    }
    let sizes = ground.comm().all_reduce_sum_slice(&sizes);
    let size = |part: usize| (sizes[2 * part] / sizes[2 * part + 1]).sqrt();
    let mut rigid: Vec<Rigid> = (0..count).map(|part| Rigid::new(centres[part], size(part))).collect();
    for (node, hold) in ground
        .holds
        .iter()
        .enumerate()
        .filter(|(node, hold)| hold.is_any() && ground.partition.owns_node(*node))
    {
        rigid[part_of[node]].hold(mesh.nodes[node], hold);
    }
    for (node, hold) in on_edges {
        rigid[part_of[*node]].hold(mesh.nodes[*node], hold);
    }
    for spring in springs {
        if let Some((dof, _)) = spring.spot.of_shape.weights().first() {
            rigid[part_of[dof / PER_NODE]].hold_deflection(spring.at);
        }
    }
    for cell in on_foundation {
        let part = part_of[mesh.cells[cell].nodes()[0]];
        mesh.vertices(cell).into_iter().for_each(|vertex| rigid[part].hold_deflection(vertex));
    }
    let seen: Vec<f64> = rigid.iter().flat_map(|rigid| rigid.seen().to_vec()).collect();
    let seen = ground.comm().all_reduce_sum_slice(&seen);
    for ((rigid, seen), centre) in rigid.iter_mut().zip(seen.chunks_exact(9)).zip(&centres) {
        rigid.see(seen);
        if let Some(motion) = rigid.mechanism() {
            return Err(Error::Singular(format!(
                "the part of the mesh around ({}, {}) is not held by itself: {motion}; where mesh.parts is more than 1, each part \
                 needs supports, springs or a foundation of its own",
                centre.x, centre.y
            )));
        }
    }
    Ok(())
}

/// Returns the part of each node of this process, and the number of parts over all. Collective.
fn parts<P: Partition>(ground: &BuildContext<P>) -> Result<(Vec<usize>, usize)> {
    let (of_node, own) = ground.mesh.part_of_nodes();
    let counts = ground.comm().all_gather_one(own);
    let first: usize = counts[..ground.comm().rank()].iter().sum();
    let number = |node: usize| first + of_node[node];
    // The part numbers that the owner of a node and this process give it belong to one part.
    let called = |node: usize| if ground.partition.owns_node(node) { (number(node) + 1) as f64 } else { 0.0 };
    let owners = ground.partition.sum_at_nodes(&(0..of_node.len()).map(called).collect::<Vec<_>>())?;
    let pairs: BTreeSet<[usize; 2]> =
        owners.iter().enumerate().map(|(node, owner)| [number(node), *owner as usize - 1]).collect();
    let pairs: Vec<[usize; 2]> = pairs.into_iter().collect();
    let mut unions = Unions::new(counts.iter().sum());
    for [one, other] in ground.comm().all_gather(&pairs) {
        unions.unite(one, other);
    }
    let (part_of, count) = unions.sets();
    Ok(((0..of_node.len()).map(|node| part_of[number(node)]).collect(), count))
}
