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
use crate::scene::{Still, Tension};
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::refinement;
use nalgebra::Matrix2;

/// Adds the geometric stiffness. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let Some(tension) = ground.scene.tension() else { return Ok(()) };
    let mesh = ground.mesh;
    let rules = rules(ground, tension)?;
    let force = |point: Point| membrane_force(tension, point);
    let matrices = ground.comm().all_ok(assembly::prestress(mesh, &force, &rules))?;
    sum.add_stiffness(matrices, false, None);
    sum.prestress = sum.stiffness.len() - mesh.cells.len()..sum.stiffness.len();
    // A plate under tension all over keeps its slope.
    if !presses(ground)? {
        for (node, &point) in mesh.nodes.iter().enumerate() {
            if ground.partition.owns_node(node) {
                let [xx, yy, xy] = components(tension, point)?;
                let slopes = [xx, xy, yy].map(|part| part / (xx + yy).max(f64::MIN_POSITIVE));
                let hold = NodeConstraint { deflection: 0.0, slopes };
                sum.restraints.push(Restraint { node, point, hold });
            }
        }
    }
    Ok(())
}

/// Returns whether forces in the plane press the plate in some direction at some node. Collective.
///
/// # Errors
/// Returns the errors of the formulas.
pub(in crate::simulation::effects) fn presses<P: Partition>(ground: &BuildContext<P>) -> Result<bool> {
    let Some(tension) = ground.scene.tension() else { return Ok(false) };
    let presses = |&node: &Point| {
        let [xx, yy, xy] = components(tension, node)?;
        Ok(xx < 0.0 || yy < 0.0 || xx * yy < xy * xy)
    };
    let presses: Result<Vec<bool>> = ground.mesh.nodes.iter().map(presses).collect();
    let presses = ground.comm().all_ok(presses)?;
    Ok(ground.comm().all_reduce_any(presses.contains(&true)))
}

/// Returns the components xx, yy and xy of the membrane force at a point, in N/m.
fn components(tension: &Tension, point: Point) -> Result<[f64; 3]> {
    let [xx, yy, xy] = tension.components().map(|component| component.at(point, 0.0));
    Ok([xx?, yy?, xy?])
}

/// Returns the membrane force at a point, in N/m.
fn membrane_force(tension: &Tension, point: Point) -> Result<Matrix2<f64>> {
    let [xx, yy, xy] = components(tension, point)?;
    Ok(Matrix2::new(xx, xy, xy, yy))
}

/// Returns special quadrature rules for cells in which the force needs them. Collective.
fn rules<P: Partition>(ground: &BuildContext<P>, tension: &Tension) -> Result<Rules> {
    let components = tension.components();
    if components.into_iter().all(|component| component.is_low()) {
        return Ok(Rules::new());
    }
    let still: Vec<Still> = components.map(|component| component.still(0.0)).into();
    let field = |_| Some(&still as &dyn Integrand);
    refinement::rules("in_plane.tension", ground.mesh, &field, ground.comm())
}
