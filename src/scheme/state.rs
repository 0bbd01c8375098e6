//! State (U, V) of the schemes that carry displacement and velocity from instant to instant.

use super::System;
use super::drive::InstantData;
use crate::archive::{Archive, VectorKind};
use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{axpy, scale};

/// State (U, V) with its forces, reactions and energies.
#[derive(Debug, Clone)]
pub(super) struct State {
    /// Displacement U, in m, one entry per dof.
    pub u: Vec<f64>,
    /// Velocity V, in m/s, one entry per velocity dof.
    pub v: Vec<f64>,
    /// Reactions of the obstacles where U is in equilibrium for given p, in N, one entry per bound.
    pub reaction: Vec<f64>,
    /// Moments of friction where the massless rest is in equilibrium, in N m, one entry per bound;
    /// `None` where no rank has friction.
    pub moments: Option<Vec<[f64; 2]>>,
    /// Force F - K U with the constant load, in N, one entry per dof.
    pub force: Vec<f64>,
    /// Time-dependent data at the instant of the state.
    pub instant: InstantData,
    /// Velocities of the support frame that V is measured relative to, in m/s, one entry per
    /// motion.
    pub frame_rates: Vec<f64>,
    /// Energy of stretching, a part of the elastic energy, in J.
    pub stretching: f64,
    /// Work since the start of a load that depends on the deflection, where the scheme counts it
    /// here, in J.
    pub followed: f64,
    /// Energies of the state, in J; the constant load and the one above do the work.
    pub energies: Energies,
}

impl State {
    /// Builds the initial state from a displacement (m) and its rate (m/s), without the energy of
    /// stretching.
    pub fn new<E: Engine>(system: &System<E>, u: Vec<f64>, rate: &[f64]) -> Result<State> {
        let bounds = &system.bounds;
        let mut state = State {
            v: system.projected(rate)?,
            reaction: vec![0.0; bounds.len()],
            moments: system.drive.friction.as_ref().map(|_| vec![[0.0; 2]; bounds.len()]),
            force: vec![0.0; u.len()],
            u,
            instant: system.instant(0.0)?,
            frame_rates: system.drive.rates(0.0)?,
            stretching: 0.0,
            followed: 0.0,
            energies: Energies::default(),
        };
        state.update_energies(system)?;
        Ok(state)
    }

    /// Saves the state to an archive or restores it from there.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.energies)?;
        archive.value(&mut self.stretching)?;
        archive.value(&mut self.followed)?;
        self.instant.archive(archive)?;
        archive.value(&mut self.frame_rates)?;
        archive.vector(VectorKind::Dofs, &mut self.u)?;
        archive.vector(VectorKind::Dofs, &mut self.force)?;
        archive.vector(VectorKind::Velocities, &mut self.v)?;
        if let Some(moments) = &mut self.moments {
            archive.items(VectorKind::Bounds, moments, |moment| *moment, |moment| moment)?;
        }
        archive.vector(VectorKind::Bounds, &mut self.reaction)
    }

    /// Updates force and energies from U, V, the energy of stretching and the work above.
    pub fn update_energies<E: Engine>(&mut self, system: &System<E>) -> Result<()> {
        let mut elastic = system.force(&self.u, &mut self.force)?;
        if !system.bounds.laws.are_rigid() {
            let bounds = self.instant.bounds(&system.bounds);
            elastic += system.total(bounds.stored_energy(|bound| self.u[bounds.dofs[bound]]))?;
        }
        elastic += self.stretching;
        self.energies = Energies { kinetic: 0.0, elastic, work: system.work(&self.u)? + self.followed };
        self.update_kinetic(system)
    }

    /// Updates the kinetic energy from V.
    pub fn update_kinetic<E: Engine>(&mut self, system: &System<E>) -> Result<()> {
        self.energies.kinetic = 0.5 * system.engine.mass_norm_squared(&system.mass, &self.v)?;
        Ok(())
    }

    /// Measures V relative to the support velocities just after `time` (s). Returns the change of
    /// kinetic energy, which counts as work, in J.
    pub fn follow_supports<E: Engine>(
        &mut self,
        system: &System<E>,
        velocities: &SupportVelocities,
        time: f64,
    ) -> Result<f64> {
        if velocities.is_empty() {
            return Ok(0.0);
        }
        let rates = system.drive.rates(time)?;
        change_frame(velocities, &self.frame_rates, &rates, &mut self.v);
        self.frame_rates = rates;
        let before = self.energies.kinetic;
        self.update_kinetic(system)?;
        Ok(self.energies.kinetic - before)
    }

    /// Scales V so that the kinetic energy decreases by `energy` (J).
    pub fn remove_energy(&mut self, energy: f64) {
        let kept = 1.0 - energy / self.energies.kinetic;
        scale(kept.sqrt(), &mut self.v);
        self.energies.kinetic -= energy;
    }
}

/// Velocities V with the momentum of the support shape at 1 m/s, one vector per motion.
pub(super) type SupportVelocities = [Vec<f64>];

/// Changes the frame of the velocity v from frame velocities `from` to `to` (m/s, one entry per
/// motion).
pub(super) fn change_frame(velocities: &SupportVelocities, from: &[f64], to: &[f64], v: &mut [f64]) {
    for (velocity, (from, to)) in velocities.iter().zip(from.iter().zip(to)) {
        axpy(-(to - from), velocity, v);
    }
}
