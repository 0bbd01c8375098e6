//! Equilibria of the plate under a load.

use super::buckling;
use super::following_pressure::FollowingPressure;
use super::ground::BuildContext;
use super::loads::Loads;
use super::of_cells::OfCells;
use super::stretching::NodalEnergy;
use crate::assembly::Probe;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::{ElementMatrix, Form};
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scheme::{self, FollowingLoad, NonlinearPlate, StretchingEnergy, System, TangentPart};
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
        let stiffness = self.stiffness_at_rest(system);
        let ended = self.with_nonlinear_plate(&system.engine, &stiffness, load, bounds, |plate| {
            let ended = plate.equilibrium(guess.clone());
            let Err(Error::Unfinished(_)) = ended else { return ended };
            Err(match plate.pull_in()? {
                Some(share) if share < 1.0 => Error::Scene(format!(
                    "{key}: load.pressure pulls the plate in: its equilibrium ends at {share:.4} times this pressure; expected \
                     less, or an obstacle on which it comes to rest"
                )),
                _ => Error::Unfinished(format!(
                    "{key}: no equilibrium of the plate was reached; expected a smaller load, or an initial.deflection nearer \
                     to it"
                )),
            })
        });
        let (u, _, verdict) = ended?;
        check_residual(0, 0.0, verdict.kkt, self.scene.solver.tolerance)?;
        Ok(u)
    }

    /// Returns the largest multiple of the pressure that depends on the deflection for which the
    /// plate under its constant loads has an equilibrium without obstacles; `None` without such a
    /// pressure, or where every multiple has one. Collective.
    ///
    /// # Errors
    /// Returns the errors of the loads and of the engine.
    pub(in crate::simulation) fn pull_in<E: OfCells>(&self, engine: &E) -> Result<Option<f64>> {
        if !self.scene.load.as_ref().is_some_and(|load| load.pressure.follows_deflection()) {
            return Ok(None);
        }
        let load = Loads::new(self, &self.terms.loads)?.constant(self)?;
        let load = load.unwrap_or_else(|| vec![0.0; engine.dofs()]);
        let stiffness = engine.native().form(self.stiffness_with_bodies());
        self.with_nonlinear_plate(engine, &stiffness, &load, &Bounds::default(), |plate| plate.pull_in())
    }

    /// Calls a function with the plate as a nonlinear static problem.
    fn with_nonlinear_plate<E: OfCells, T>(
        &self,
        engine: &E,
        stiffness: &Form,
        load: &[f64],
        bounds: &Bounds,
        call: impl FnOnce(&NonlinearPlate<E>) -> Result<T>,
    ) -> Result<T> {
        let (energy, pressure) = (NodalEnergy::new(self), FollowingPressure::new(self)?);
        let tangent = |u: &[f64], share: f64, part: TangentPart| {
            let geometric = energy.as_ref().filter(|_| part != TangentPart::Supporting);
            let geometric = geometric.map(|energy| energy.geometric_stiffness(self, u));
            let mut blocks = geometric.transpose()?.unwrap_or_default();
            if let Some(pressure) = &pressure {
                blocks.extend(pressure.stiffness(
                    self,
                    u,
                    (share, part == TangentPart::Whole),
                    blocks.len(),
                )?);
            }
            Ok(engine.native().form(blocks))
        };
        call(&NonlinearPlate {
            engine,
            stiffness,
            stretching: energy.as_ref().map(|energy| -> &dyn StretchingEnergy { energy }),
            following: pressure.as_ref().map(|pressure| -> &dyn FollowingLoad { pressure }),
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
        Cow::Owned(system.engine.native().form(self.stiffness_with_bodies()))
    }

    /// Returns the contributions to K, with a spring of 1 N/m in each body's gap.
    fn stiffness_with_bodies(&self) -> Vec<ElementMatrix> {
        let mut blocks = self.stiffness();
        for body in &self.terms.bodies {
            blocks.push(Probe::default().with(body.gap, 1.0).spring(1.0, blocks.len()));
        }
        blocks
    }
}
