//! Equilibria of the plate under a load, and the forces of a given shape.

use super::attached::Attached;
use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::assembly;
use crate::error::Result;
use crate::linalg::Form;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::{self, System};
use crate::simulation::check_residual;

/// Context for the computation of equilibria.
pub(super) struct Statics<'g, P: Partition> {
    pub ground: &'g BuildContext<'g, P>,
    pub attached: &'g Attached<'g>,
    /// Rigid motions that nothing restrains, in words.
    pub mechanism: Option<&'static str>,
}

impl<P: Partition> Statics<'_, P> {
    /// Computes the equilibrium of the plate under a load, with the balls at rest. Collective.
    pub fn equilibrium<E: OfCells>(
        &self,
        system: &System<E>,
        load: &[f64],
        bounds: &Bounds,
    ) -> Result<Vec<f64>> {
        let held = self.held(system);
        let stiffness = held.as_ref().unwrap_or(&system.stiffness);
        let (u, _, verdict) = scheme::equilibrium(&system.engine, stiffness, load, bounds)?;
        check_residual(0, 0.0, verdict.kkt, self.ground.scene.solver.tolerance)?;
        Ok(u)
    }

    /// Returns the stiffness of the plate with the balls held at rest; `None` where there are none.
    pub fn held<E: OfCells>(&self, system: &System<E>) -> Option<Form> {
        let BuildContext { scene, cells, .. } = *self.ground;
        (!scene.attachments.balls.is_empty())
            .then(|| system.engine.native().form(self.attached.stiffness_that_holds_balls(cells)))
    }

    /// Returns K u for a shape u (three values per node), in N, on the engine's dofs. Collective.
    pub fn forces(&self, shape: &[f64]) -> Result<Vec<f64>> {
        let BuildContext { mesh, cells, space, partition, .. } = self.ground;
        let mut force = vec![0.0; space.dofs()];
        assembly::forces(mesh, cells, shape, &mut force);
        self.attached.add_forces(self.ground, shape, &mut force);
        self.attached.add_rib_forces(self.ground, shape, &mut force);
        partition.add_up(&force)
    }
}
