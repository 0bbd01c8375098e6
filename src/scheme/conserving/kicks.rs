//! Kicks by forces that depend on the deflection, before and after a step.

use crate::archive::{Archive, VectorKind};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{axpy, subtract};
use crate::linalg::{Engine, Form};
use crate::scheme::state::State;
use crate::scheme::{Potential, StepBalance, System};
use nalgebra::{DMatrix, DVector};

/// Largest change of the kinetic energy of vibration, relative to it, by which the rates of a step
/// are scaled.
pub(super) const SCALED: f64 = 0.01;

/// Mass of a rigid motion, relative to the others, that is rounding.
const LEAST_MASS: f64 = 1e-12;

/// Velocities of rigid motions, with which a scaling of the others keeps the momentum.
struct RigidPart<'s> {
    velocities: &'s [Vec<f64>],
    /// Inverse of their masses, in 1/kg.
    inverse_masses: DMatrix<f64>,
}

/// Forces at a state: `$-\nabla W$` on the means over cells.
#[derive(Clone)]
struct Pull {
    /// Instant, in s.
    time: f64,
    /// Displacement `$\bar U$` without obstacles, in m, one entry per dof.
    u: Vec<f64>,
    /// Deceleration `$C^{-1} \nabla W$`, in m/s^2, one entry per velocity dof.
    deceleration: Vec<f64>,
    /// Response of the massless part to the forces, in m, one entry per dof.
    response: Vec<f64>,
    /// Work of the load from the flat plate to `$\bar U$`, in J.
    work: f64,
}

/// Forces of stretching and of loads that depend on the deflection, with their potential
/// `$W(p) = V(\bar U(p)) - A(\bar U(p))$`.
pub(super) struct Kicks<'s, E: Engine> {
    system: &'s System<E>,
    /// All rigid motions, and those that nothing restrains.
    rigid: [RigidPart<'s>; 2],
    /// Work space: forces, in N, one entry per dof.
    force: Vec<f64>,
    push: Vec<f64>,
    /// Last multiplier of `$\bar U$`, from which the next one is sought, in m/s^2, one entry per
    /// velocity dof.
    multiplier: Vec<f64>,
    now: Pull,
    before: Pull,
}

impl<'s, E: Engine> Kicks<'s, E> {
    /// Starts at a state in equilibrium for given p; `None` where no force depends on the
    /// deflection.
    pub fn new(
        system: &'s System<E>,
        potential: &mut Potential<'s, E>,
        start: &mut State,
    ) -> Result<Option<Kicks<'s, E>>> {
        let System { engine, mass, drive, .. } = system;
        if drive.membrane.is_none() && drive.following.is_none() {
            return Ok(None);
        }
        let (dofs, velocities) = (engine.dofs(), engine.velocities(mass));
        let part = |velocities: &'s Vec<Vec<f64>>| {
            let mut masses = DMatrix::zeros(velocities.len(), velocities.len());
            for (j, velocity) in velocities.iter().enumerate() {
                masses.set_column(j, &momenta(system, velocities, velocity));
            }
            // A single row of cells has no inertia about its own line.
            let least = LEAST_MASS * masses.norm();
            let inverse_masses =
                if velocities.is_empty() { Ok(masses) } else { masses.pseudo_inverse(least) };
            RigidPart { velocities, inverse_masses: inverse_masses.unwrap_or_default() }
        };
        let rigid = [part(&drive.rigid.all), part(&drive.rigid.free)];
        let (of_dofs, of_cells) = (vec![0.0; dofs], vec![0.0; velocities]);
        let pull = Pull {
            time: 0.0,
            u: start.u.clone(),
            deceleration: of_cells.clone(),
            response: of_dofs.clone(),
            work: 0.0,
        };
        let mut kicks = Kicks {
            system,
            rigid,
            force: of_dofs.clone(),
            push: of_dofs,
            multiplier: of_cells,
            now: pull.clone(),
            before: pull,
        };
        kicks.evaluate(potential, start, 0.0)?;
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
        axpy(-0.5 * seconds, &self.before.deceleration, &mut state.v);
        state.update_kinetic(self.system)?;
        Ok(state)
    }

    /// Kicks a state at an instant (s), the end of a step, for `seconds`, with the energies there.
    /// Collective.
    pub fn kick(
        &mut self,
        potential: &mut Potential<'s, E>,
        to: &mut State,
        time: f64,
        seconds: f64,
    ) -> Result<()> {
        self.now.clone_from(&self.before);
        self.evaluate(potential, to, time)?;
        if let Some(load) = &self.system.drive.following {
            let Kicks { before, now, .. } = self;
            let mut work = now.work - before.work;
            // With a load that changes in time this is the mean of the work by the load at both
            // instants.
            if load.changes() {
                work = 0.5 * (work + load.work(before.time, &now.u)? - load.work(time, &before.u)?);
            }
            to.followed += work;
        }
        axpy(-seconds, &self.now.deceleration, &mut to.v);
        to.update_energies(self.system)
    }

    /// Computes energies and forces at a state at an instant (s).
    fn evaluate(&mut self, potential: &mut Potential<'s, E>, state: &mut State, time: f64) -> Result<()> {
        let System { engine, load, drive, .. } = self.system;
        let Kicks { force, push, multiplier, now, .. } = self;
        now.time = time;
        now.u.copy_from_slice(&state.u);
        let touches = state.reaction.iter().any(|reaction| *reaction != 0.0);
        if !engine.comm().all_reduce_all(!touches) {
            match load {
                Some(load) => force.copy_from_slice(load),
                None => force.fill(0.0),
            }
            potential.unobstructed(force, &mut now.u, multiplier)?;
        }
        force.fill(0.0);
        if let Some(load) = &drive.following {
            load.force(time, &now.u, force)?;
            now.work = load.work(time, &now.u)?;
        }
        if let Some(membrane) = &drive.membrane {
            state.stretching = membrane.evaluate(&now.u, push)?;
            subtract(push, force);
        }
        potential.unobstructed(force, &mut now.response, &mut now.deceleration)
    }

    /// Removes an energy (J) from the rates of a state. All momentum stays where the rates beside
    /// rigid motions have much more energy; if not, only the momentum of unrestrained motions
    /// stays, and what is more than a small part is left. Returns the kinetic energy beside
    /// unrestrained motions, in J. Collective.
    pub fn remove_energy(&self, state: &mut State, energy: f64) -> Result<f64> {
        let mut vibration = 0.0;
        for part @ RigidPart { velocities, inverse_masses } in &self.rigid {
            let momenta = momenta(self.system, velocities, &state.v);
            let rates = inverse_masses * &momenta;
            vibration = state.energies.kinetic - 0.5 * momenta.dot(&rates);
            let is_last = std::ptr::eq(part, &self.rigid[1]);
            if vibration <= 0.0 || energy.abs() > SCALED * vibration && !is_last {
                continue;
            }
            let scale = (1.0 - (energy / vibration).clamp(-SCALED, SCALED)).sqrt();
            state.v.iter_mut().for_each(|v| *v *= scale);
            for (velocity, rate) in velocities.iter().zip(&rates) {
                axpy((1.0 - scale) * rate, velocity, &mut state.v);
            }
            break;
        }
        state.update_kinetic(self.system)?;
        Ok(vibration)
    }

    /// Adds the forces at the state before and the present one, times weights, to a balance.
    pub fn add_to(&self, balance: &mut StepBalance, weights: [f64; 2]) {
        for (pull, weight) in [&self.before, &self.now].into_iter().zip(weights) {
            balance.follow(self.system, [weight; 2], pull.time, &pull.u);
            axpy(weight, &pull.response, &mut balance.displacement);
            axpy(-weight, &pull.deceleration, &mut balance.acceleration);
        }
    }

    /// Saves or restores the forces at the last state.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.vector(VectorKind::Velocities, &mut self.multiplier)?;
        let Pull { time, u, deceleration, response, work } = &mut self.now;
        archive.value(time)?;
        archive.value(work)?;
        archive.vector(VectorKind::Dofs, u)?;
        archive.vector(VectorKind::Velocities, deceleration)?;
        archive.vector(VectorKind::Dofs, response)
    }
}

/// Returns the momenta of a velocity along others. Collective.
fn momenta<E: Engine>(system: &System<E>, along: &[Vec<f64>], v: &[f64]) -> DVector<f64> {
    let Form::SingularMassCells(averages) = &system.mass else { return DVector::zeros(along.len()) };
    let weighted = |other: &Vec<f64>| {
        other.iter().zip(&*averages.masses).zip(v).map(|((other, mass), v)| other * mass * v).sum()
    };
    let parts: Vec<f64> = along.iter().map(weighted).collect();
    DVector::from_vec(system.engine.comm().all_reduce_sum_slice(&parts))
}
