//! Springs, masses and balls, each at a point of the plate.

use super::ground::PointEvaluation;
use crate::assembly::{self, CellArrays, Probe};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::scene::{self, Scene};

/// Spring (N/m) or mass (kg) at a point.
pub(super) struct LumpedMass {
    pub amount: f64,
    pub at: Point,
    pub spot: PointEvaluation,
}

/// Ball, with its dofs.
pub(super) struct AttachedBall<'s> {
    /// Index of the ball in the scene.
    pub number: usize,
    pub ball: &'s scene::Ball,
    /// Point of the plate under the ball.
    pub spot: PointEvaluation,
    /// Dof of the gap, i.e. of the height of the ball over the plate.
    pub gap: usize,
    /// Dof of the tip that touches the plate, for a ball on a spring.
    pub tip: Option<usize>,
}

/// Adds the masses at points that can move to those of the cells. Collective.
///
/// All cells that contain the point share its mass equally. A mass at a held point would only keep
/// their means from moving, and remains apart.
pub(super) fn add_masses(
    scene: &Scene,
    mesh: &Mesh,
    holds: &[NodeConstraint],
    comm: &impl Communicator,
    cells: &mut [CellArrays],
) -> Result<()> {
    for mass in &scene.attachments.masses {
        let at = Point::from(mass.at);
        let around: Vec<usize> = mesh.cells_at(at).collect();
        let moves =
            |cell: &usize| Ok(!is_held(&Probe::in_cell(mesh, *cell, at, |basis| basis.value)?, holds));
        let moves = comm.all_ok(around.first().map(moves).transpose())?;
        let ranks = comm.all_gather_one([around.len(), usize::from(moves == Some(true))]);
        // The first process at the point decides for all.
        if ranks.iter().find(|[count, _]| *count > 0).is_some_and(|[_, moves]| *moves == 1) {
            let share = mass.mass / ranks.iter().map(|[count, _]| *count).sum::<usize>() as f64;
            let mut add = |&cell: &usize| assembly::add_point_mass(mesh, cells, cell, at, share);
            comm.all_ok(around.iter().try_for_each(&mut add))?;
        }
    }
    Ok(())
}

/// Returns whether supports hold all dofs of a deflection, given over the dofs of all nodes.
pub(super) fn is_held(of_shape: &Probe, holds: &[NodeConstraint]) -> bool {
    of_shape.weights().iter().all(|(dof, _)| DofMap::held(&holds[dof / PER_NODE])[dof % PER_NODE])
}
