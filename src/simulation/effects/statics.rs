//! Equilibria of the plate under a load.

use super::buckling;
use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretching::NodalEnergy;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Form;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::{self, StretchedPlate, StretchingEnergy, System};
use crate::simulation::check_residual;
use std::borrow::Cow;

impl<P: Partition> BuildContext<'_, P> {
    /// Computes the equilibrium of the plate under a load, with the bodies at rest. Collective.
    pub(super) fn equilibrium<E: OfCells>(
        &self,
        system: &System<E>,
        load: &[f64],
        bounds: &Bounds,
    ) -> Result<Vec<f64>> {
        let stiffness = self.stiffness_at_rest(system);
        let (u, _, verdict) = scheme::equilibrium(&system.engine, &stiffness, load, bounds)?;
        check_residual(0, 0.0, verdict.kkt, self.scene.solver.tolerance)?;
        Ok(u)
    }

    /// Computes the equilibrium of the plate that stretches under a load, with the bodies at rest,
    /// from `initial.deflection` on. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] where forces in the plane buckle it.
    pub(super) fn stretched<E: OfCells>(
        &self,
        key: &str,
        system: &System<E>,
        stretching: &dyn StretchingEnergy,
        load: &[f64],
        bounds: &Bounds,
    ) -> Result<Vec<f64>> {
        let Some(energy) = NodalEnergy::new(self) else { return self.equilibrium(system, load, bounds) };
        if buckling::is_buckled(self, &system.engine, None)? {
            return Err(Error::Scene(format!(
                "{key}: the forces in the plane buckle the plate, whose equilibrium time.mass = \"modal\" finds; expected that \
                 mass, or a start from initial.deflection"
            )));
        }
        let blocks = |u: &[f64]| Ok(system.engine.native().form(energy.geometric_stiffness(self, u)?));
        let plate = StretchedPlate {
            engine: &system.engine,
            stiffness: &self.stiffness_at_rest(system),
            stretching,
            geometric: &blocks,
            load,
            bounds,
        };
        let shape = self.comm().all_ok(self.shape_of(&self.scene.initial.deflection))?;
        let guess = self.owned(&self.space.interpolate(&shape), system.engine.dofs());
        let (u, _, verdict) = plate.equilibrium(guess)?;
        check_residual(0, 0.0, verdict.kkt, self.scene.solver.tolerance)?;
        Ok(u)
    }

    /// Returns K with a spring of 1 N/m in each body's gap, which fixes a gap without load.
    pub(super) fn stiffness_at_rest<'k, E: OfCells>(&self, system: &'k System<E>) -> Cow<'k, Form> {
        if self.terms.bodies.is_empty() {
            return Cow::Borrowed(&system.stiffness);
        }
        if system.drive.stretching.as_ref().is_some_and(|form| form.is_buckled()) {
            let [unpressed, _] = self.without_prestress();
            return Cow::Owned(system.engine.native().form(unpressed));
        }
        let mut blocks = self.stiffness();
        for body in &self.terms.bodies {
            blocks.push(Probe::default().with(body.gap, 1.0).spring(1.0, blocks.len()));
        }
        Cow::Owned(system.engine.native().form(blocks))
    }
}
