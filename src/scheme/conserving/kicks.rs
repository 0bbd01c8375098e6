//! Kicks by the force of stretching before and after a step.

use crate::archive::{Archive, VectorKind};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{axpy, copy_scaled};
use crate::scheme::drive::StretchingEnergy;
use crate::scheme::state::State;
use crate::scheme::{Potential, System};
use nalgebra::{DMatrix, DVector};

/// Largest change of the kinetic energy of vibration, relative to it, by which the rates of a step
/// are scaled.
const SCALED: f64 = 0.01;

/// Rigid motion that nothing restrains.
struct RigidMotion {
    /// Displacement, one entry per dof, and its velocity, one entry per velocity dof.
    shape: Vec<f64>,
    velocity: Vec<f64>,
}

/// Force of stretching `$-\nabla W$` on the means over cells, with `$W(p) = V(\bar U(p))$` and
/// `$\bar U(p)$` the displacement without obstacles.
pub(super) struct Kicks<'s, E: Engine> {
    system: &'s System<E>,
    energy: &'s dyn StretchingEnergy,
    rigid: Vec<RigidMotion>,
    /// Inverse of the masses of the rigid motions, in 1/kg.
    inverse_masses: DMatrix<f64>,
    /// Displacement `$\bar U$` (m) and `$V'(\bar U)$` (N), one entry per dof.
    u: Vec<f64>,
    gradient: Vec<f64>,
    /// Multiplier of `$\bar U$` in m/s^2, one entry per velocity dof.
    multiplier: Vec<f64>,
    /// Deceleration `$C^{-1} \nabla W$` in m/s^2, one entry per velocity dof, at the last two
    /// states, and the response of the massless part to `$-V'$` that goes with it, in m, one entry
    /// per dof.
    now: [Vec<f64>; 2],
    before: [Vec<f64>; 2],
}

impl<'s, E: Engine> Kicks<'s, E> {
    /// Starts at a state in equilibrium for given p; `None` for a plate that only bends.
    pub fn new(
        system: &'s System<E>,
        potential: &mut Potential<'s, E>,
        start: &mut State,
    ) -> Result<Option<Kicks<'s, E>>> {
        let Some(energy) = &system.drive.membrane else { return Ok(None) };
        let System { engine, mass, .. } = system;
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        let motion = |shape: &Vec<f64>| {
            let mut velocity = vec![0.0; velocities];
            engine.project(mass, shape, &mut velocity)?;
            Ok(RigidMotion { shape: shape.clone(), velocity })
        };
        let rigid: Vec<RigidMotion> = energy.rigid_motions().iter().map(motion).collect::<Result<_>>()?;
        let mut masses = DMatrix::zeros(rigid.len(), rigid.len());
        for (j, motion) in rigid.iter().enumerate() {
            masses.set_column(j, &momenta(system, &rigid, &motion.velocity)?);
        }
        let responses = [vec![0.0; velocities], vec![0.0; dofs]];
        let mut kicks = Kicks {
            system,
            energy: energy.as_ref(),
            rigid,
            inverse_masses: masses.try_inverse().unwrap_or_default(),
            u: start.u.clone(),
            gradient: vec![0.0; dofs],
            multiplier: vec![0.0; velocities],
            now: responses.clone(),
            before: responses,
        };
        kicks.evaluate(potential, start)?;
        start.update_energies(system)?;
        Ok(Some(kicks))
    }

    /// Begins the step from the present state.
    pub fn begin_step(&mut self) {
        std::mem::swap(&mut self.now, &mut self.before);
    }

    /// Returns the state after the kick before a step of `seconds`. Collective.
    pub fn kicked(&self, from: &State, seconds: f64) -> Result<State> {
        let mut state = from.clone();
        axpy(-0.5 * seconds, &self.before[0], &mut state.v);
        state.update_kinetic(self.system)?;
        Ok(state)
    }

    /// Kicks a state at the end of a step for `seconds`, with the energy of stretching there.
    /// Collective.
    pub fn kick(&mut self, potential: &mut Potential<'s, E>, to: &mut State, seconds: f64) -> Result<()> {
        self.now.clone_from(&self.before);
        self.evaluate(potential, to)?;
        axpy(-seconds, &self.now[0], &mut to.v);
        to.update_energies(self.system)
    }

    /// Computes energy and force of stretching at a state.
    fn evaluate(&mut self, potential: &mut Potential<'s, E>, state: &mut State) -> Result<()> {
        let System { engine, load, .. } = self.system;
        self.u.copy_from_slice(&state.u);
        let touches = state.reaction.iter().any(|reaction| *reaction != 0.0);
        if !engine.comm().all_reduce_all(!touches) {
            match load {
                Some(load) => self.gradient.copy_from_slice(load),
                None => self.gradient.fill(0.0),
            }
            potential.unobstructed(&self.gradient, &mut self.u, &mut self.multiplier)?;
        }
        state.stretching = self.energy.evaluate(&self.u, &mut self.gradient)?;
        self.gradient.iter_mut().for_each(|force| *force = -*force);
        let [pull, response] = &mut self.now;
        potential.unobstructed(&self.gradient, response, pull)
    }

    /// Removes the second of two energies (J), or as much of it as is a small part of their kinetic
    /// energy, from the rates of a state other than those of rigid motions, which keep the
    /// momentum. Returns whether the first one, the error of a step, is a small part too.
    /// Collective.
    pub fn remove_energy(&self, state: &mut State, [error, energy]: [f64; 2]) -> Result<bool> {
        let momenta = momenta(self.system, &self.rigid, &state.v)?;
        let rates = &self.inverse_masses * &momenta;
        let vibration = state.energies.kinetic - 0.5 * momenta.dot(&rates);
        if vibration <= 0.0 {
            return Ok(false);
        }
        let scale = (1.0 - (energy / vibration).clamp(-SCALED, SCALED)).sqrt();
        let v = state.v.clone();
        copy_scaled(scale, &v, &mut state.v);
        for (motion, rate) in self.rigid.iter().zip(&rates) {
            axpy((1.0 - scale) * rate, &motion.velocity, &mut state.v);
        }
        state.update_kinetic(self.system)?;
        Ok(error.abs() <= SCALED * vibration)
    }

    /// Saves or restores the forces at the last state.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        let [pull, response] = &mut self.now;
        archive.vector(VectorKind::Velocities, &mut self.multiplier)?;
        archive.vector(VectorKind::Velocities, pull)?;
        archive.vector(VectorKind::Dofs, response)
    }
}

/// Returns the momenta of a velocity along rigid motions.
fn momenta<E: Engine>(system: &System<E>, rigid: &[RigidMotion], v: &[f64]) -> Result<DVector<f64>> {
    let System { engine, mass, .. } = system;
    let mut momentum = vec![0.0; engine.dofs()];
    if !rigid.is_empty() {
        engine.project_transpose(mass, v, &mut momentum)?;
    }
    let along = |motion: &RigidMotion| engine.dot(&motion.shape, &momentum);
    Ok(DVector::from_vec(rigid.iter().map(along).collect::<Result<_>>()?))
}
