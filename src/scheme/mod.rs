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
mod drive;
pub mod equilibrium;
pub mod exact;
mod feedback;
pub mod massless;
pub mod midpoint;
pub mod modal;
pub mod newmark;
pub mod registry;
mod relaxation;
mod sliding;
mod state;
mod step_driver;

pub use balance::StepBalance;
pub use conserving::{Conserving, RelaxationStatistics};
pub use drive::{BoundsOfTime, Damping, LoadOfTime, LoadTerm, ModalDamping, SupportMotion, TimeDependence};
pub use equilibrium::{equilibrium, equilibrium_on_bounds};
pub use exact::{Exact, ExactOptions};
pub use massless::contact_compliance::ContactCompliance;
pub use massless::potential::Potential;
pub use midpoint::{Massless, Midpoint};
pub use modal::ModalScheme;
pub use newmark::{Newmark, NewmarkParameters};
pub use registry::{Capabilities, EnergyPromise, SchemeName, SchemeSpec};
pub use sliding::{BoundSlider, Friction};

use crate::archive::{Archive, Numbers, VectorKind};
use crate::communicator::Communicator;
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::vectors::{axpy, aypx, clear, copy_scaled, is_zero, scale, waxpy};
use crate::linalg::{Engine, Form, LinearCombination, MassModes};
use crate::obstacle::Bounds;
use crate::vi::StepReport;
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
            elastic.zip(modal.rates()).for_each(|((rate, _), more)| *rate += more);
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

    /// Subtracts `weight` times the damping force D `rate` from `force`; `known` is the product of
    /// the stiffness with `rate`, if it is known, and `product` is work space.
    fn damp(
        &self,
        rate: &[f64],
        known: Option<&[f64]>,
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
            let of_rate = match known {
                Some(known) => known,
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
    fn work(&self, u: &[f64]) -> Result<f64> {
        self.load.as_ref().map_or(Ok(0.0), |load| self.engine.dot(load, u))
    }

    /// Returns the momentum M `rate` of a rate of displacement (m/s), one entry per dof.
    fn momentum(&self, rate: &[f64]) -> Result<Vec<f64>> {
        let mut v = vec![0.0; self.engine.velocities(&self.mass)];
        self.engine.project(&self.mass, rate, &mut v)?;
        let mut momentum = vec![0.0; rate.len()];
        self.engine.project_transpose(&self.mass, &v, &mut momentum)?;
        Ok(momentum)
    }

    /// Returns the kinetic energy of a rate of displacement (m/s), in J; `v` is work space with one
    /// entry per velocity dof.
    pub(crate) fn kinetic_energy(&self, rate: &[f64], v: &mut [f64]) -> Result<f64> {
        self.engine.project(&self.mass, rate, v)?;
        Ok(0.5 * self.engine.mass_norm_squared(&self.mass, v)?)
    }

    /// Returns the length scale of the deflections and of bounds with a magnitude, in m.
    /// Collective.
    fn length(&self, bounds: &Bounds, magnitude: f64, u: &[f64]) -> Result<f64> {
        Ok(self.engine.comm().all_reduce_max(magnitude.max(bounds.largest(u))))
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
            Some(of) => {
                of(time, &mut bounds)?;
                self.drive.relative_bounds(time, bounds)
            }
            None => Ok(bounds),
        }
    }

    /// Returns the sum of `own` over all processes. Collective.
    fn total(&self, own: f64) -> Result<f64> {
        Ok(self.engine.comm().all_reduce_sum(own))
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

/// State of a bounded dof just before the contact of the present step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Time, in s.
    pub time: f64,
    /// Deflection, in m.
    pub deflection: f64,
    /// Velocity, in m/s.
    pub velocity: f64,
}

impl Approach {
    /// Returns the initial states of all bounds, given displacement (m) and velocity (m/s), one
    /// entry per dof.
    fn at_start(bounds: &Bounds, displacement: &[f64], velocity: &[f64]) -> Vec<Approach> {
        let state =
            |&dof: &usize| Approach { time: 0.0, deflection: displacement[dof], velocity: velocity[dof] };
        bounds.dofs.iter().map(state).collect()
    }

    /// Saves or restores approaches, one per bound.
    fn archive(approaches: &mut [Approach], archive: &mut Archive) -> Result<()> {
        archive.items(
            VectorKind::Bounds,
            approaches,
            |of| [of.time, of.deflection, of.velocity],
            |[time, deflection, velocity]| Approach { time, deflection, velocity },
        )
    }
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

/// Quantities that every scheme reports about the step to the present instant.
#[derive(Debug, Clone)]
pub struct StepRecord {
    /// Index n of the present instant; 0 at the start.
    pub step: u64,
    /// Length of a step, in s.
    pub dt: f64,
    /// Bounded configuration of the step (the paper's `$U^{n+1,e}$` or `$U^{n+1/2}$`), in m, one
    /// entry per bound.
    pub admissible: Vec<f64>,
    /// Reactions of the obstacles, in N, one entry per bound, positive upwards.
    pub reaction: Vec<f64>,
    /// Impulses of the obstacles over the step, from the scheme's own balance of momentum, in N s,
    /// one entry per bound, positive upwards. They are zero at the start.
    pub impulses: Vec<f64>,
    /// Bounds that may be in contact, ascending; `None` for all of them. The other bounds have no
    /// reaction, and their entries of the configuration may be those of an earlier instant.
    pub candidates: Option<Vec<usize>>,
    /// Iterations and accuracy of the last solve.
    pub report: StepReport,
}

impl StepRecord {
    pub(crate) fn new(dt: f64, bounds: usize) -> StepRecord {
        let zeros = vec![0.0; bounds];
        StepRecord {
            step: 0,
            dt,
            admissible: zeros.clone(),
            reaction: zeros.clone(),
            impulses: zeros,
            candidates: None,
            report: StepReport::default(),
        }
    }

    /// Returns the bounds that may be in contact, ascending.
    pub fn candidates(&self) -> impl Iterator<Item = usize> + '_ {
        let all = if self.candidates.is_none() { 0..self.reaction.len() } else { 0..0 };
        self.candidates.iter().flatten().copied().chain(all)
    }

    /// Returns whether nothing touches: no bound has a reaction or an impulse, and the bounded
    /// configuration lies within `limits`. Where there are candidates, the answer may be no.
    pub fn is_free(&self, limits: &Bounds) -> bool {
        // Without an early end the loops have no branches.
        let all_zero = |of: &[f64]| of.iter().fold(true, |zero, value| zero & (*value == 0.0));
        let within = || {
            let sides = limits.lower.iter().zip(&limits.upper);
            self.admissible
                .iter()
                .zip(sides)
                .fold(true, |within, (z, (lower, upper))| within & (*lower <= *z) & (*z <= *upper))
        };
        self.candidates.is_none() && all_zero(&self.reaction) && all_zero(&self.impulses) && within()
    }

    /// Returns the time of the present instant, in s.
    pub fn time(&self) -> f64 {
        self.step as f64 * self.dt
    }

    fn begin_step(&mut self) {
        self.step += 1;
        clear(&mut self.impulses);
    }

    /// Takes the reactions (N) at the end of a step, whose impulses are the trapezoidal sum of
    /// them and those before.
    fn end_step(&mut self, reaction: &[f64]) {
        let half = 0.5 * self.dt;
        for ((r, before), impulse) in reaction.iter().zip(&mut self.reaction).zip(&mut self.impulses) {
            *impulse = half * *before + half * r;
            *before = *r;
        }
    }

    /// Adds the impulses of the recorded reactions over a duration, in s.
    fn add_impulses(&mut self, seconds: f64) {
        if !is_zero(&self.reaction) {
            axpy(seconds, &self.reaction, &mut self.impulses);
        }
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.step)?;
        archive.value(&mut self.report)?;
        for vector in [&mut self.admissible, &mut self.reaction, &mut self.impulses] {
            archive.vector(VectorKind::Bounds, vector)?;
        }
        Ok(())
    }
}

/// Time scheme at an instant of its grid.
pub trait Scheme {
    /// Advances one step.
    ///
    /// # Errors
    /// Returns an error where a matrix cannot be factored. The accuracy that the solver reached is
    /// in [`StepRecord::report`].
    fn advance(&mut self) -> Result<()>;

    /// Returns the record of the step to the present instant. Each scheme states the instant that
    /// its reactions belong to.
    fn record(&self) -> &StepRecord;

    /// Returns forces and dissipated energies of this rank's sliders.
    fn friction(&self) -> Vec<Friction> {
        Vec::new()
    }

    /// Returns [`StepRecord::step`].
    fn step(&self) -> u64 {
        self.record().step
    }

    /// Returns [`StepRecord::time`].
    fn time(&self) -> f64 {
        self.record().time()
    }

    /// Returns [`StepRecord::admissible`].
    fn admissible(&self) -> &[f64] {
        &self.record().admissible
    }

    /// Returns [`StepRecord::reaction`].
    fn reaction(&self) -> &[f64] {
        &self.record().reaction
    }

    /// Returns [`StepRecord::impulses`].
    fn impulses(&self) -> &[f64] {
        &self.record().impulses
    }

    /// Returns [`StepRecord::report`].
    fn step_report(&self) -> StepReport {
        self.record().report
    }

    /// Returns the displacement `$U^n$`, in m, one entry per dof.
    fn displacement(&self) -> &[f64];

    /// Returns the displacement `$U^n$` of one dof, in m, with the bits of
    /// [`Scheme::displacement`]. It is cheap also for a scheme whose steps compute no displacement.
    fn displacement_of(&self, dof: usize) -> f64 {
        self.displacement()[dof]
    }

    /// Returns the rate of U at the present instant, in m/s, one entry per displacement dof. The
    /// product of M with it is the momentum of the scheme, whose change is the impulse of loads,
    /// damping and [`StepRecord::impulses`]. The call does not change later steps. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn velocity(&mut self) -> Result<Vec<f64>>;

    /// Returns the support velocities that [`Scheme::velocity`] is relative to, in m/s, one entry
    /// per motion.
    ///
    /// # Errors
    /// Returns the errors of the support motions.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(Vec::new())
    }

    /// Returns the bounds that [`StepRecord::admissible`] satisfies, in m.
    fn limits(&self) -> &Bounds;

    /// Returns the kinetic energy, elastic energy and work of the scheme at the present instant, in
    /// J.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn energies(&self) -> Result<Energies>;

    /// Returns the discrete energy that the scheme conserves in free flight at any step size, in J.
    /// By default this is the total of [`Scheme::energies`].
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn invariant(&self) -> Result<f64> {
        Ok(self.energies()?.total())
    }

    /// Returns the state of a bounded dof (an index into the bounds) just before the present step.
    fn approach(&self, bound: usize) -> Approach;

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

    /// Returns the number of numeric factorisations so far; of diagonalisations for a modal scheme.
    fn factorisations(&self) -> u64;

    /// Returns the wall time that steps since the last call took for what is computed once per run,
    /// in s: the compliance of nodes that come near their obstacles, for the modal mass.
    fn take_compliance_seconds(&mut self) -> f64 {
        0.0
    }

    /// Returns the relaxation statistics; `None` for a scheme that does not relax its steps.
    fn relaxation(&self) -> Option<RelaxationStatistics> {
        None
    }

    /// Returns the events since the last call in order of time; none for a scheme without event
    /// detection.
    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }

    /// Returns the work counters of an event-driven scheme.
    fn event_statistics(&self) -> Option<EventStatistics> {
        None
    }
}
