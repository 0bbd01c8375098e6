//! Prestress: the stiffness of a plate by forces in its plane.
//!
//! A membrane force N that does not depend on the deflection does the work
//! `$\tfrac12 \int N_{ab}\, w_{,a} w_{,b}$` against it: K becomes K + K_G.

use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::element::adaptive::{Integrand, Rules};
use crate::error::Result;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::{FieldInput, InPlane, Still};
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::refinement;
use nalgebra::Matrix2;

/// Adds the geometric stiffness. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let Some(in_plane) = ground.scene.prestress() else { return Ok(()) };
    let (mesh, membrane) = (ground.mesh, &ground.membrane);
    let rules = rules(ground, in_plane)?;
    let force = |cell: usize, point: Point| {
        let [xx, yy, xy] = membrane.at(cell, point)?;
        Ok(Matrix2::new(xx, xy, xy, yy))
    };
    let matrices = ground.comm().all_ok(assembly::prestress(mesh, &force, &rules))?;
    sum.add_stiffness(matrices, false, None);
    sum.prestress = sum.stiffness.len() - mesh.cells.len()..sum.stiffness.len();
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

/// Returns special quadrature rules for cells in which the force needs them. Collective.
fn rules<P: Partition>(ground: &BuildContext<P>, in_plane: &InPlane) -> Result<Rules> {
    let fields: Vec<&FieldInput> =
        in_plane.tension.components().into_iter().chain(&in_plane.temperature).collect();
    if fields.iter().all(|field| field.is_low()) {
        return Ok(Rules::new());
    }
    let still: Vec<Still> = fields.iter().map(|field| field.still(0.0)).collect();
    let field = |_| Some(&still as &dyn Integrand);
    refinement::rules(in_plane.key(), ground.mesh, &field, ground.comm())
}
