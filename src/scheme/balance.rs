//! Balance of forces of a step, from which the forces at held dofs follow.
//!
//! The equation that a scheme solves over the free dofs,
//!
//! ```math
//! M a + K u - F = G^T r ,
//! ```
//!
//! holds for a configuration u, an acceleration a and a load F of its own: means over the step, or
//! those of an instant. The same products in the rows of the held dofs are the reactions of the
//! supports. With the fields that the scheme really used, the forces on the whole plate therefore
//! add up to the change of its momentum, to rounding, at any step.

use super::System;
use super::drive::ModalDamping;
use super::state::{State, SupportVelocities};
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, axpy};

/// Forces that depend on the deflection, as a step takes them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ForcesOfDeflection {
    /// Instant, in s.
    pub time: f64,
    /// Displacement, in m, one entry per dof.
    pub displacement: Vec<f64>,
    /// Factor of the force of stretching, dimensionless.
    pub stretching: f64,
    /// Factor of the load, dimensionless.
    pub load: f64,
}

/// Fields of the balance of forces of a step, `$M a + K u - F = G^T r$` over the free dofs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StepBalance {
    /// Displacement u that K acts on, relative to the supports, in m, one entry per dof. Damping by
    /// the stiffness adds beta times its rate.
    pub displacement: Vec<f64>,
    /// Acceleration a that M acts on, relative to the supports, in m/s^2, one entry per velocity
    /// dof. Damping by the mass adds alpha times the velocity; damping of modes its decay.
    pub acceleration: Vec<f64>,
    /// Rate of u that dashpots act on, in m/s, one entry per dof; empty without dashpots.
    pub rates: Vec<f64>,
    /// Moments of friction, in N m, one entry per bound; `None` where no rank has friction.
    pub friction: Option<Vec<[f64; 2]>>,
    /// Stretching of the mesh and loads that depend on the deflection; empty without either.
    pub followed: Vec<ForcesOfDeflection>,
    /// Instants (s) of the time-dependent loads, and their weights.
    pub loads: Vec<(f64, f64)>,
    /// Places of the supports, in m, one entry per motion.
    pub places: Vec<f64>,
    /// Velocities of the supports during the step, in m/s, one entry per motion.
    pub support_rates: Vec<f64>,
    /// Accelerations of the supports, in m/s^2, one entry per motion.
    pub support_accelerations: Vec<f64>,
}

impl StepBalance {
    /// Creates a balance whose fields are zero.
    pub(super) fn zero<E: Engine>(system: &System<E>) -> StepBalance {
        let motions = vec![0.0; system.drive.supports.len()];
        StepBalance {
            displacement: vec![0.0; system.engine.dofs()],
            acceleration: vec![0.0; system.engine.velocities(&system.mass)],
            rates: if system.drive.dashpots.is_some() { vec![0.0; system.engine.dofs()] } else { Vec::new() },
            friction: system.drive.friction.as_ref().map(|_| vec![[0.0; 2]; system.bounds.len()]),
            followed: Vec::new(),
            loads: Vec::new(),
            places: motions.clone(),
            support_rates: motions.clone(),
            support_accelerations: motions,
        }
    }

    /// Creates the balance of a displacement u (m, one entry per dof) at rest under the loads of
    /// the first instant, on supports at rest.
    ///
    /// # Errors
    /// Returns the errors of the support motions.
    pub fn at_rest<E: Engine>(system: &System<E>, u: &[f64]) -> Result<StepBalance> {
        let mut balance = StepBalance::zero(system);
        balance.displacement.copy_from_slice(u);
        balance.follow(system, [1.0; 2], 0.0, u);
        balance.loads.push((0.0, 1.0));
        balance.places = system.drive.places(0.0)?;
        Ok(balance)
    }

    /// Creates the balance of a state at rest at the start.
    pub(super) fn at_start<E: Engine>(system: &System<E>, start: &State) -> Result<StepBalance> {
        let mut balance = StepBalance::at_rest(system, &start.u)?;
        balance.support_rates = system.drive.rates(0.0)?;
        Ok(balance)
    }

    /// Adds the forces of stretching on the mesh and the load that depends on the deflection, times
    /// factors, at an instant (s) and a displacement (m).
    pub(super) fn follow<E: Engine>(
        &mut self,
        system: &System<E>,
        [stretching, load]: [f64; 2],
        time: f64,
        u: &[f64],
    ) {
        let stretches = system.drive.membrane.is_some() && stretching != 0.0;
        if stretches || system.drive.following.is_some() && load != 0.0 {
            self.followed.push(ForcesOfDeflection { time, displacement: u.to_vec(), stretching, load });
        }
    }

    /// Adds the change of the support frame from one velocity to another (m/s, one entry per
    /// motion) over a duration, in s.
    pub(super) fn change_frame(
        &mut self,
        seconds: f64,
        [from, to]: [&[f64]; 2],
        velocities: &SupportVelocities,
    ) {
        let motions = velocities.iter().zip(&mut self.support_accelerations);
        for ((velocity, acceleration), (from, to)) in motions.zip(from.iter().zip(to)) {
            let change = (to - from) / seconds;
            *acceleration += change;
            axpy(-change, velocity, &mut self.acceleration);
        }
    }

    /// Adds another balance times a weight.
    pub(super) fn add(&mut self, weight: f64, other: &StepBalance) {
        axpy(weight, &other.displacement, &mut self.displacement);
        axpy(weight, &other.acceleration, &mut self.acceleration);
        axpy(weight, &other.rates, &mut self.rates);
        let moments = self.friction.iter_mut().flatten().zip(other.friction.iter().flatten());
        moments.for_each(|(sum, moment)| axpy(weight, moment, sum));
        self.loads.extend(other.loads.iter().map(|(time, share)| (*time, weight * share)));
        for forces in &other.followed {
            let [stretching, load] = [weight * forces.stretching, weight * forces.load];
            // A step begins where the one before ended.
            match self.followed.last_mut().filter(|last| last.displacement == forces.displacement) {
                Some(last) => (last.stretching, last.load) = (last.stretching + stretching, last.load + load),
                None => self.followed.push(ForcesOfDeflection { stretching, load, ..forces.clone() }),
            }
        }
        axpy(weight, &other.places, &mut self.places);
        axpy(weight, &other.support_rates, &mut self.support_rates);
        axpy(weight, &other.support_accelerations, &mut self.support_accelerations);
    }

    /// Adds the damping of single modes with these modal velocities, in the coordinates of
    /// [`ModalDamping`].
    pub(super) fn add_modal_damping<E: Engine>(
        &mut self,
        system: &System<E>,
        modal: &ModalDamping,
        velocities: &[f64],
    ) -> Result<()> {
        let mut decay = vec![0.0; self.displacement.len()];
        modal.add_decay(velocities, &mut decay);
        add(&system.projected(&decay)?, &mut self.acceleration);
        Ok(())
    }

    /// Saves or restores the balance.
    pub(super) fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.vector(VectorKind::Dofs, &mut self.displacement)?;
        archive.vector(VectorKind::Velocities, &mut self.acceleration)?;
        if !self.rates.is_empty() {
            archive.vector(VectorKind::Dofs, &mut self.rates)?;
        }
        if let Some(moments) = &mut self.friction {
            archive.items(VectorKind::Bounds, moments, |moment| *moment, |moment| moment)?;
        }
        let mut followed = self.followed.len();
        archive.value(&mut followed)?;
        let zero = vec![0.0; self.displacement.len()];
        self.followed.resize_with(followed, || ForcesOfDeflection {
            displacement: zero.clone(),
            ..Default::default()
        });
        for ForcesOfDeflection { time, displacement, stretching, load } in &mut self.followed {
            archive.vector(VectorKind::Dofs, displacement)?;
            [time, stretching, load].into_iter().try_for_each(|number| archive.value(number))?;
        }
        archive.value(&mut self.loads)?;
        for vector in [&mut self.places, &mut self.support_rates, &mut self.support_accelerations] {
            archive.value(vector)?;
        }
        Ok(())
    }
}
