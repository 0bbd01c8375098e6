//! Time integration schemes. They work on matrices and bounds and know no mesh, so that a bouncing
//! ball runs through the same code as a plate.
//!
//! The symbols are those of the paper (Pozzolini, Renard, Salaün, CSMA 2013):
//!
//! | code | paper | meaning |
//! |---|---|---|
//! | `system.stiffness` | K | stiffness matrix |
//! | `system.mass` | M = B^T C^-1 B, or M_r | singular mass matrix (equation 5), or consistent mass matrix |
//! | `system.bounds` | K^h, G, alpha | admissible deflections at the nodes |
//! | `system.load` | F | constant load; `system.drive` has its time-dependent parts |
//! | `system.damping` | - | Rayleigh damping alpha M + beta K |
//! | `system.drive.dashpots` | - | damping C of compliant stops, whose tips are dofs without mass |
//! | `e`, `beta`, `dt` | e, beta, Delta t | coefficient of restitution, Newmark parameter, time step |
//! | `u`, `v` | U^n, V^n | displacement, velocity |
//! | `d` | U^n - U^{n-1} | displacement increment of a step |
//! | `x` | - | unknown of the step, an increment: small, and so are its rounding errors |
//!
//! The unknown of a step is an increment x that solves `$A x = b + G^T r$` under bounds; b contains
//! `$K U^n$`, applied cell by cell. At small steps the paper's right-hand sides, taken literally,
//! lose digits that this form keeps.
//!
//! Damping, time-dependent loads and moving obstacles extend the paper: see each scheme, and
//! [`TimeDependence`].

mod balance;
mod conjugate_gradients;
pub mod conserving;
mod coulomb;
mod drive;
pub mod equilibrium;
pub mod exact;
mod feedback;
mod following_load;
pub mod massless;
pub mod midpoint;
pub mod modal;
pub mod newmark;
mod quadratisation;
pub mod registry;
mod relaxation;
mod sliding;
mod solution;
mod state;
mod step_driver;
mod stop_dashpots;

pub use balance::{ForcesOfDeflection, StepBalance};
pub use conserving::{Conserving, RelaxationStatistics};
pub use coulomb::{ContactFriction, FrictionalNode, FrictionalSide, NodalFriction, PathOfObstacle};
pub use drive::{
    BoundsOfTime, Damping, LoadOfTime, LoadTerm, ModalDamping, RigidVelocities, StretchingEnergy,
    SupportMotion, TimeDependence, ViscousTip,
};
pub use equilibrium::{NonlinearPlate, TangentOf, TangentPart, equilibrium, equilibrium_on_bounds};
pub use exact::{Exact, ExactOptions};
pub use following_load::FollowingLoad;
pub use massless::contact_compliance::ContactCompliance;
pub use massless::potential::Potential;
pub use midpoint::{Massless, Midpoint};
pub use modal::ModalScheme;
pub use modal::return_map::{Passage, Passing, ReturnMap};
pub use newmark::{Newmark, NewmarkParameters};
pub use registry::{Capabilities, EnergyPromise, SchemeName, SchemeSpec};
pub use sliding::{BoundSlider, Friction};
pub use solution::{Approach, Solution, StepRecord};

use crate::archive::{Archive, Numbers};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, aypx, copy_scaled, scale, waxpy};
use crate::linalg::{Engine, Form, LinearCombination, MassModes};
use crate::obstacle::Bounds;
use drive::InstantData;

/// Semi-discrete impact problem `$M \ddot U + (\alpha M + \beta K) \dot U + K U = F + G^T r$` under
/// bounds on G U (paper, equation 5, with damping).
#[derive(Debug)]
pub struct System<E: Engine> {
    /// Linear algebra backend.
    pub engine: E,
    /// Stiffness matrix K, in N/m (rotational dofs accordingly).
    pub stiffness: Form,
    /// Mass matrix, M or `$M_r$`, in kg.
    pub mass: Form,
    /// Rayleigh damping coefficients alpha and beta.
    pub damping: Damping,
    /// Constant part of the load F, in N, one entry per dof; `None` where it is zero.
    pub load: Option<Vec<f64>>,
    /// Bounds on the deflections, in m; at their rest position where obstacles move.
    pub bounds: Bounds,
    /// Numbers of the bounds among those of all ranks, independent of the partition; `None` in a
    /// single process without a partition.
    pub bound_numbers: Option<Numbers>,
    /// Time-dependent loads and obstacles, support motions and modal damping.
    pub drive: TimeDependence,
}

impl<E: Engine> System<E> {
    /// Returns the matrices M, K and D = alpha M + beta K + C, with C that of the stops' dashpots.
    fn matrices(&self) -> (&Form, &Form, LinearCombination<'_>) {
        let System { mass: m, stiffness: k, damping, drive, .. } = self;
        let rayleigh = m * damping.mass + k * damping.stiffness;
        (m, k, drive.dashpots.iter().fold(rayleigh, |d, dashpots| d + dashpots))
    }

    /// Returns whether there is any damping by a matrix.
    fn is_damped(&self) -> bool {
        !self.damping.is_none() || self.drive.dashpots.is_some()
    }

    /// Returns the decay rates of the modes of a modal mass, in 1/s: those of Rayleigh damping, and
    /// of single modes that are no rigid motions.
    pub(crate) fn decay_rates(&self, modes: &MassModes) -> Vec<f64> {
        let Damping { mass, stiffness } = self.damping;
        let mut rates: Vec<f64> = modes.squares.iter().map(|square| mass + stiffness * square).collect();
        if let Some(modal) = &self.drive.modal {
            let elastic = rates.iter_mut().zip(&modes.squares).filter(|(_, square)| **square > 0.0);
            elastic.zip(&modal.rates).for_each(|((rate, _), more)| *rate += more);
        }
        rates
    }

    /// Sets `force` to F - K U with the constant load, in N. Returns the elastic energy, in J.
    fn force(&self, u: &[f64], force: &mut [f64]) -> Result<f64> {
        let elastic = 0.5 * self.engine.multiply(&self.stiffness, u, force)?;
        match &self.load {
            Some(load) => aypx(-1.0, load, force),
            None => scale(-1.0, force),
        }
        Ok(elastic)
    }

    /// Sets `force` to F - `of_stiffness` with the constant load, in N.
    fn subtract_from_load(&self, of_stiffness: &[f64], force: &mut [f64]) {
        match &self.load {
            Some(load) => waxpy(-1.0, of_stiffness, load, force),
            None => copy_scaled(-1.0, of_stiffness, force),
        }
    }

    /// Subtracts `weight` times the damping force D `rate` from `force`; `stiffness_of_rate` is the
    /// product of the stiffness with `rate`, if it is known, and `product` is work space.
    fn damp(
        &self,
        rate: &[f64],
        stiffness_of_rate: Option<&[f64]>,
        weight: f64,
        force: &mut [f64],
        product: &mut [f64],
    ) -> Result<()> {
        let Damping { mass, stiffness } = self.damping;
        if mass != 0.0 {
            self.engine.multiply(&self.mass, rate, product)?;
            axpy(-weight * mass, product, force);
        }
        if stiffness != 0.0 {
            let of_rate = match stiffness_of_rate {
                Some(stiffness_of_rate) => stiffness_of_rate,
                None => {
                    self.engine.multiply(&self.stiffness, rate, product)?;
                    &*product
                }
            };
            axpy(-weight * stiffness, of_rate, force);
        }
        if let Some(dashpots) = &self.drive.dashpots {
            self.engine.multiply(dashpots, rate, product)?;
            axpy(-weight, product, force);
        }
        Ok(())
    }

    /// Returns the work F . U of the constant load, in J.
    pub(crate) fn work(&self, u: &[f64]) -> Result<f64> {
        self.load.as_ref().map_or(Ok(0.0), |load| self.engine.dot(load, u))
    }

    /// Returns the momentum M `rate` of a rate of displacement (m/s), one entry per dof.
    fn momentum(&self, rate: &[f64]) -> Result<Vec<f64>> {
        let v = self.projected(rate)?;
        let mut momentum = vec![0.0; rate.len()];
        self.engine.project_transpose(&self.mass, &v, &mut momentum)?;
        Ok(momentum)
    }

    /// Returns a vector of one entry per dof in the velocity dofs.
    pub(crate) fn projected(&self, u: &[f64]) -> Result<Vec<f64>> {
        let mut v = vec![0.0; self.engine.velocities(&self.mass)];
        self.engine.project(&self.mass, u, &mut v)?;
        Ok(v)
    }

    /// Returns the elastic energy of a displacement (m) and the kinetic one of a rate (m/s), in J.
    pub(crate) fn energies(&self, u: &[f64], rate: &[f64]) -> Result<[f64; 2]> {
        let elastic = 0.5 * self.engine.multiply(&self.stiffness, u, &mut vec![0.0; u.len()])?;
        Ok([elastic, 0.5 * self.engine.mass_norm_squared(&self.mass, &self.projected(rate)?)?])
    }

    /// Returns the kinetic energy of a rate of displacement (m/s), in J; `v` is work space with one
    /// entry per velocity dof.
    pub(crate) fn kinetic_energy(&self, rate: &[f64], v: &mut [f64]) -> Result<f64> {
        self.engine.project(&self.mass, rate, v)?;
        Ok(0.5 * self.engine.mass_norm_squared(&self.mass, v)?)
    }

    /// Returns the length scale of the deflections on all ranks and of bounds with a magnitude, in
    /// m. Collective.
    fn length(&self, bounds: &Bounds, magnitude: f64, u: &[f64]) -> f64 {
        self.engine.comm().all_reduce_max(magnitude.max(bounds.largest(u)))
    }

    /// Returns the time-dependent data at `time` (s).
    fn instant(&self, time: f64) -> Result<InstantData> {
        let mut instant = InstantData::new(&self.drive, self.engine.dofs(), &self.bounds);
        instant.set(&self.drive, time)?;
        Ok(instant)
    }

    /// Returns the rates of change of load (N/s) and bounds (m/s) at the end of a step of `dt`
    /// seconds, relative to a support frame moving at `rates` (m/s, one entry per motion). The
    /// rates are second order in dt and use instants within the step only, since a formula may be
    /// undefined beyond the end of the run.
    fn data_rates(&self, time: f64, dt: f64, rates: &[f64]) -> Result<InstantData> {
        let still = vec![0.0; rates.len()];
        let instant = |steps: f64| {
            let mut instant = self.instant((time - steps * dt).max(0.0))?;
            instant.carry(&self.drive, &still);
            Ok::<_, Error>(instant)
        };
        let [first, middle, last] = [instant(1.0)?, instant(0.5)?, instant(0.0)?];
        let (mut change, mut whole) = (last.clone(), last.clone());
        whole.combine(&last, &first, |last, first| last - first);
        change.combine(&last, &middle, |last, middle| 4.0 * (last - middle));
        let both = change.clone();
        // Absent obstacles have infinite bounds and get the rate zero.
        let finite = |rate: f64| if rate.is_finite() { rate } else { 0.0 };
        change.combine(&both, &whole, |both, whole| finite((both - whole) / dt));
        change.carry(&self.drive, rates);
        Ok(change)
    }

    /// Returns the bounds at `time` (s) relative to the supports, in m. Collective.
    ///
    /// # Errors
    /// Returns the errors of the support motions and of the obstacles.
    pub fn bounds_at(&self, time: f64) -> Result<Bounds> {
        let mut bounds = self.bounds.clone();
        match &self.drive.bounds {
            Some(bounds_of_time) => {
                bounds_of_time(time, &mut bounds)?;
                self.drive.relative_bounds(time, bounds)
            }
            None => Ok(bounds),
        }
    }

    /// Returns the sum of the shares over all processes. Collective.
    fn total(&self, share: f64) -> Result<f64> {
        Ok(self.engine.comm().all_reduce_sum(share))
    }
}

/// Initial conditions, both vectors with one entry per displacement dof.
#[derive(Debug, Clone)]
pub struct Start {
    /// Initial displacement `$U_0$`, in m.
    pub displacement: Vec<f64>,
    /// Initial rate of U, in m/s; the scheme starts from its projection
    /// `$V_0 = C^{-1} B \dot U_0$`.
    pub velocity: Vec<f64>,
}

/// Closing or opening of the gap at one node, at its own instant.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Event {
    /// Time, in s.
    pub time: f64,
    /// Index of the bound.
    pub bound: usize,
    /// `true` where the gap closes, `false` where it opens.
    pub closes: bool,
    /// Velocity of the node, in m/s: before the gap closes, or after it opens.
    pub velocity: f64,
    /// Sum of all reactions at that instant, in N. The reaction of the node itself is 0, since
    /// reactions are continuous in time.
    pub force: f64,
}

/// Work counters of an event-driven scheme.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct EventStatistics {
    /// Number of closings and openings of single nodes.
    pub events: u64,
    /// Number of active sets whose modes were computed.
    pub active_sets: u64,
    /// Peak memory of the cache of modes, in bytes.
    pub cached_bytes: usize,
    /// Number of instants at which all gaps and reactions were evaluated by the event detection.
    pub evaluations: u64,
}

/// Counts of the work of a scheme since its start.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Statistics {
    /// Number of numeric factorisations; of diagonalisations for a modal scheme.
    pub factorisations: u64,
    /// Relaxation of steps; `None` for a scheme that does not relax its steps.
    pub relaxation: Option<RelaxationStatistics>,
    /// Events; `None` for a scheme without event detection.
    pub events: Option<EventStatistics>,
    /// Gap of the root of the energy of stretching, dimensionless; `None` for a scheme without it.
    pub stretching_gap: Option<f64>,
}

/// Time scheme, which computes one [`Solution`] from the last.
pub trait Scheme: Solution {
    /// Advances one step.
    ///
    /// # Errors
    /// Returns an error where a matrix cannot be factored. The accuracy that the solver reached is
    /// in [`StepRecord::report`].
    fn advance(&mut self) -> Result<()>;

    /// Returns forces and dissipated energies of this rank's sliders.
    fn friction(&self) -> Vec<Friction> {
        Vec::new()
    }

    /// Returns the energy that friction and dashpots of each obstacle, then of each ball, have
    /// dissipated, in J, of all ranks; shorter where the last ones, or all, have neither.
    fn dissipated_by_obstacles(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Makes the scheme keep what [`Scheme::balance`] returns. It is called before the first step
    /// and before a state is restored, and changes no step.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn keep_balance(&mut self) -> Result<()> {
        Ok(())
    }

    /// Returns the balance of forces that [`StepRecord::reaction`] belongs to, after a call of
    /// [`Scheme::keep_balance`]. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn balance(&mut self) -> Result<StepBalance>;

    /// Returns whether reactions are means over the step that led to the present instant, rather
    /// than those of the instant.
    fn has_mean_reactions(&self) -> bool {
        false
    }

    /// Saves everything that later steps depend on to an archive, exactly, or restores it into a
    /// scheme at its start.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit, and the errors of the
    /// solver.
    fn archive(&mut self, archive: &mut Archive) -> Result<()>;

    /// Returns the counts of the work done so far.
    fn statistics(&self) -> Statistics;

    /// Returns the wall time that steps since the last call took for what is computed once per run,
    /// in s: the compliance of nodes that come near their obstacles, for the modal mass.
    fn take_compliance_seconds(&mut self) -> f64 {
        0.0
    }

    /// Returns the events since the last call in order of time; none for a scheme without event
    /// detection.
    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }
}
