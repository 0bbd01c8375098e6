//! Prestress: the stiffness of a plate by forces in its plane.
//!
//! A membrane force N that does not depend on the deflection does the work
//! `$\tfrac12 \int N_{ab}\, w_{,a} w_{,b}$` against it: K becomes K + K_G.

use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::error::Result;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::FieldInput;
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::refinement;
use nalgebra::Matrix2;

/// Adds the geometric stiffness. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let Some(in_plane) = ground.scene.prestress() else { return Ok(()) };
    let (mesh, membrane, before) = (ground.mesh, &ground.membrane, sum.stiffness.len());
    let matrix = |force: Result<[f64; 3]>| force.map(|[xx, yy, xy]| Matrix2::new(xx, xy, xy, yy));
    let given: Vec<&FieldInput> = in_plane.tension.components().into();
    if given.iter().any(|component| !component.is_zero()) {
        let force = |_: usize, point: Point| matrix(membrane.given(point));
        let rules = refinement::rules_of("in_plane.tension", mesh, &given, ground.comm())?;
        sum.add_stiffness(ground.comm().all_ok(assembly::prestress(mesh, &force, &rules))?, false, None);
    }
    if !membrane.are_given() {
        let force = |cell: usize, point: Point| matrix(membrane.solved(cell, point));
        let fields = Vec::from_iter(&in_plane.temperature);
        let rules = refinement::rules_of("in_plane.temperature", mesh, &fields, ground.comm())?;
        sum.add_stiffness(ground.comm().all_ok(assembly::prestress(mesh, &force, &rules))?, false, None);
    }
    sum.prestress = before..sum.stiffness.len();
    // A plate under tension all over keeps its slope.
    if membrane.are_given() && !presses(ground)? {
        for (node, &point) in mesh.nodes.iter().enumerate() {
            if ground.partition.owns_node(node) {
                let [xx, yy, xy] = membrane.at(0, point)?;
                let slopes = [xx, xy, yy].map(|part| part / (xx + yy).max(f64::MIN_POSITIVE));
                let hold = NodeConstraint { deflection: 0.0, slopes };
                sum.restraints.push(Restraint { node, point, hold });
            }
        }
    }
    Ok(())
}

/// Returns whether forces in the plane press the plate in some direction at some corner of a cell.
/// Collective.
///
/// # Errors
/// Returns the errors of the formulas.
pub(in crate::simulation::effects) fn presses<P: Partition>(ground: &BuildContext<P>) -> Result<bool> {
    let BuildContext { mesh, membrane, .. } = ground;
    if !membrane.is_any() {
        return Ok(false);
    }
    let presses = |cell: usize, node: usize| {
        let [xx, yy, xy] = membrane.at(cell, mesh.nodes[node])?;
        Ok(xx < 0.0 || yy < 0.0 || xx * yy < xy * xy)
    };
    let corners = mesh.cells.iter().enumerate();
    let corners = corners.flat_map(|(number, cell)| cell.nodes().iter().map(move |&node| (number, node)));
    let presses: Result<Vec<bool>> = corners.map(|(cell, node)| presses(cell, node)).collect();
    let presses = ground.comm().all_ok(presses)?;
    Ok(ground.comm().all_reduce_any(presses.contains(&true)))
}
