//! Elastic foundations of the plate.

use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::NodeConstraint;
use crate::element::adaptive::{self, Integrand, Rules};
use crate::error::{Error, Result};
use crate::partition::Partition;
use crate::scene;
use crate::simulation::effects::contributions::{Contributions, Restraint};
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::refinement::seen;
use crate::simulation::regions::cells_in;
use std::collections::BTreeSet;

/// Adds all foundations. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let (mesh, foundations) = (ground.mesh, &ground.scene.attachments.foundations);
    if foundations.is_empty() {
        return Ok(());
    }
    let reach = |(number, of): (usize, &scene::Foundation)| {
        cells_in(&of.region, mesh, ground.comm(), &format!("foundation.{number}"))
    };
    let reaches: Vec<Vec<bool>> = foundations.iter().enumerate().map(reach).collect::<Result<_>>()?;
    let rules = foundation_rules(ground, &reaches)?;
    let stiffness = |cell: usize, at| {
        let mut total = 0.0;
        for (of, _) in foundations.iter().zip(&reaches).filter(|(_, reach)| reach[cell]) {
            let stiffness = of.stiffness.at(at, 0.0)?;
            if stiffness < 0.0 {
                let wrong = format!("{stiffness:?} N/m3 at ({}, {}); expected at least 0", at.x, at.y);
                return Err(Error::Scene(format!("{}: {wrong}", of.stiffness.key)));
            }
            total += stiffness;
        }
        Ok(total)
    };
    let matrices = ground.comm().all_ok(assembly::foundation(mesh, &stiffness, &rules))?;
    let borne = matrices.iter().flat_map(|(cell, _)| mesh.cells[*cell].nodes().iter().copied());
    let hold = NodeConstraint { deflection: 1.0, ..NodeConstraint::default() };
    let restraint = |node: usize| Restraint { node, at: mesh.nodes[node], hold };
    sum.restraints.extend(borne.collect::<BTreeSet<usize>>().into_iter().map(restraint));
    sum.add_stiffness(matrices, true, None);
    Ok(())
}

/// Returns special quadrature rules for cells in which foundations need them. Collective.
fn foundation_rules<P: Partition>(ground: &BuildContext<P>, reaches: &[Vec<bool>]) -> Result<Rules> {
    let foundations = &ground.scene.attachments.foundations;
    if foundations.iter().all(|of| of.stiffness.is_low()) {
        return Ok(Rules::new());
    }
    // One sum serves all cells that the same foundations cover.
    let mut sums = Vec::new();
    let mut known: Vec<Vec<bool>> = Vec::new();
    let mut sum_of = Vec::with_capacity(ground.mesh.cells.len());
    for cell in 0..ground.mesh.cells.len() {
        let reached: Vec<bool> = reaches.iter().map(|reach| reach[cell]).collect();
        let number = known.iter().position(|other| *other == reached).unwrap_or_else(|| {
            let under = foundations.iter().zip(&reached).filter(|(_, reached)| **reached);
            sums.push(under.map(|(of, _)| of.stiffness.still(0.0)).collect::<Vec<_>>());
            known.push(reached);
            sums.len() - 1
        });
        sum_of.push(number);
    }
    let function = |cell: usize| {
        let sum = &sums[sum_of[cell]];
        (!sum.is_empty()).then_some(sum as &dyn Integrand)
    };
    let pieces = ground.comm().all_ok(assembly::pieces(ground.mesh))?;
    let refined = adaptive::refine(&pieces, &function, adaptive::ONCE, ground.comm());
    seen("foundation", ground.comm().all_ok(refined)?)
}
