//! Equilibria of the plate under a load.

use super::buckling;
use super::following_pressure::FollowingPressure;
use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretching::NodalEnergy;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::Form;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::{self, NonlinearPlate, System};
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

    /// Computes the equilibrium of a plate that stretches on its mesh, or whose load depends on the
    /// deflection, with the bodies at rest, from `initial.deflection` on. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] where forces in the plane buckle the plate, or a load pulls it in.
    pub(super) fn nonlinear<E: OfCells>(
        &self,
        key: &str,
        system: &System<E>,
        load: &[f64],
        bounds: &Bounds,
    ) -> Result<Vec<f64>> {
        if self.scene.stretches() && buckling::is_buckled(self, &system.engine, None)? {
            return Err(Error::Scene(format!(
                "{key}: the forces in the plane buckle the plate, whose equilibrium time.mass = \"modal\" finds; expected that \
                 mass, or a start from initial.deflection"
            )));
        }
        let shape = self.comm().all_ok(self.shape_of(&self.scene.initial.deflection))?;
        let guess = self.owned(&self.space.interpolate(&shape), system.engine.dofs());
        let verdict = self.with_nonlinear_plate(system, load, bounds, |plate| {
            let ended = plate.equilibrium(guess.clone());
            let Err(Error::Unfinished(_)) = ended else { return ended };
            Err(match plate.pull_in()? {
                Some(share) if share < 1.0 => Error::Scene(format!(
                    "{key}: load.pressure pulls the plate in: its equilibrium ends at {share:.4} times this pressure; expected \
                     less, or an obstacle on which it comes to rest"
                )),
                _ => Error::Unfinished(format!("{key}: no equilibrium of the plate was reached")),
            })
        });
        let (u, _, verdict) = verdict?;
        check_residual(0, 0.0, verdict.kkt, self.scene.solver.tolerance)?;
        Ok(u)
    }

    /// Calls a function with the plate as a nonlinear static problem.
    pub(super) fn with_nonlinear_plate<E: OfCells, T>(
        &self,
        system: &System<E>,
        load: &[f64],
        bounds: &Bounds,
        call: impl FnOnce(&NonlinearPlate<E>) -> Result<T>,
    ) -> Result<T> {
        let (energy, pressure) = (NodalEnergy::new(self), FollowingPressure::new(self)?);
        let tangent = |u: &[f64], share: f64, softens: bool| {
            let geometric = energy.as_ref().map(|energy| energy.geometric_stiffness(self, u));
            let mut blocks = geometric.transpose()?.unwrap_or_default();
            if let Some(pressure) = &pressure {
                blocks.extend(pressure.stiffness(self, u, (share, softens), blocks.len())?);
            }
            Ok(system.engine.native().form(blocks))
        };
        call(&NonlinearPlate {
            engine: &system.engine,
            stiffness: &self.stiffness_at_rest(system),
            stretching: system.drive.membrane.as_deref(),
            following: system.drive.following.as_deref(),
            share: 1.0,
            tangent: &tangent,
            load,
            bounds,
        })
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
