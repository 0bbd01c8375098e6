//! Elastic foundations of the plate.

use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::element::adaptive::{Integrand, Rules};
use crate::error::{Error, Result};
use crate::partition::Partition;
use crate::scene;
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::refinement;
use crate::simulation::regions::cells_in;
use std::collections::BTreeSet;

/// Adds all foundations. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let (mesh, foundations) = (ground.mesh, &ground.scene.attachments.foundations);
    if foundations.is_empty() {
        return Ok(());
    }
    let reach = |(number, foundation): (usize, &scene::Foundation)| {
        cells_in(&foundation.region, mesh, ground.comm(), &format!("foundation.{number}"))
    };
    let reaches: Vec<Vec<bool>> = foundations.iter().enumerate().map(reach).collect::<Result<_>>()?;
    let rules = foundation_rules(ground, &reaches)?;
    let stiffness = |cell: usize, point| {
        let mut total = 0.0;
        for (foundation, _) in foundations.iter().zip(&reaches).filter(|(_, reach)| reach[cell]) {
            let stiffness = foundation.stiffness.at(point, 0.0)?;
            if stiffness < 0.0 {
                let wrong = format!("{stiffness:?} N/m3 at ({}, {}); expected at least 0", point.x, point.y);
                return Err(Error::Scene(format!("{}: {wrong}", foundation.stiffness.key)));
            }
            total += stiffness;
        }
        Ok(total)
    };
    let matrices = ground.comm().all_ok(assembly::foundation(mesh, &stiffness, &rules))?;
    let borne = matrices.iter().flat_map(|(cell, _)| mesh.cells[*cell].nodes().iter().copied());
    let hold = NodeConstraint { deflection: 1.0, ..NodeConstraint::default() };
    let restraint = |node: usize| Restraint { node, point: mesh.nodes[node], hold };
    sum.restraints.extend(borne.collect::<BTreeSet<usize>>().into_iter().map(restraint));
    sum.add_stiffness(matrices, true, None);
    Ok(())
}

/// Returns special quadrature rules for cells in which foundations need them. Collective.
fn foundation_rules<P: Partition>(ground: &BuildContext<P>, reaches: &[Vec<bool>]) -> Result<Rules> {
    let foundations = &ground.scene.attachments.foundations;
    if foundations.iter().all(|foundation| foundation.stiffness.is_low()) {
        return Ok(Rules::new());
    }
    let cells = 0..ground.mesh.cells.len();
    let under = |cell: usize| foundations.iter().zip(reaches).filter(move |(_, reach)| reach[cell]);
    let sum = |cell: usize| under(cell).map(|(foundation, _)| foundation.stiffness.still(0.0)).collect();
    let sums: Vec<Vec<scene::Still>> = cells.map(sum).collect();
    let field = |cell: usize| (!sums[cell].is_empty()).then_some(&sums[cell] as &dyn Integrand);
    refinement::rules("foundation", ground.mesh, &field, ground.comm())
}
