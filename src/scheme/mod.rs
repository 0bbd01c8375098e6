//! The time schemes. They know matrices and bounds, never a mesh: a bouncing ball runs through the same code as a plate.
//!
//! Symbols are the paper's (Pozzolini, Renard, Salaün, CSMA 2013):
//!
//! | code | paper | is |
//! |---|---|---|
//! | `system.stiffness` | K | stiffness |
//! | `system.mass` | M = B^T C^-1 B, or M_r | singular, or consistent mass |
//! | `system.bounds` | K^h, G, alpha | admissible deflections at the nodes |
//! | `system.load` | F | load, and `system.drive.load` what changes of it |
//! | `system.damping` | - | alpha M + beta K |
//! | `e`, `beta`, `dt` | e, beta, Delta t | restitution, Newmark parameter, step |
//! | `u`, `v` | U^n, V^n | displacement, velocity |
//! | `d` | U^n - U^{n-1} | displacement increment of a step |
//! | `x` | - | unknown of the step, an increment: small, and so are its roundings |
//!
//! The unknown of a step is an increment that solves A x = b + G^T r under bounds, with b made of K U^n applied cell by cell:
//! at small steps the paper's literal right-hand sides lose the digits that this form keeps.
//!
//! Damping, loads and obstacles that change with time come on top: see each scheme, and [`drive`](Drive).

pub mod conserving;
mod drive;
pub mod equilibrium;
pub mod exact;
mod half_step;
pub mod midpoint;
pub mod newmark;
pub mod potential;

pub use conserving::{Conserving, Relaxation};
pub use drive::{BoundsOfTime, Damping, Drive, LoadOfTime, ModalDamping, SupportMotion};
pub use equilibrium::{equilibrium, equilibrium_on_bounds};
pub use exact::{Exact, ExactOptions};
pub use midpoint::{Massless, Midpoint};
pub use newmark::{Newmark, NewmarkParameters};
pub use potential::Potential;

use crate::archive::{Archive, Over};
use crate::energy::Energies;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::Verdict;
use drive::Moment;

/// A semi-discrete impact problem: M U'' + (alpha M + beta K) U' + K U = F + G^T r within bounds.
#[derive(Debug)]
pub struct System<E: Engine> {
    /// The linear algebra.
    pub engine: E,
    /// K, in N/m (and the units of slopes).
    pub stiffness: E::Form,
    /// M or M_r, in kg.
    pub mass: E::Form,
    /// alpha and beta.
    pub damping: Damping,
    /// What of F does not change with time, in N; `None` where that is nothing.
    pub load: Option<Vec<f64>>,
    /// Bounds on the deflections, at rest where they move.
    pub bounds: Bounds,
    /// What changes with time.
    pub drive: Drive,
}

impl<E: Engine> System<E> {
    /// F - K U with the constant load. Returns the elastic energy, in J.
    fn force(&self, u: &[f64], force: &mut [f64]) -> Result<f64> {
        let elastic = 0.5 * self.engine.multiply(&self.stiffness, u, force)?;
        match &self.load {
            Some(load) => force.iter_mut().zip(load).for_each(|(b, f)| *b = f - *b),
            None => force.iter_mut().for_each(|b| *b = -*b),
        }
        Ok(elastic)
    }

    /// Takes the damping of `weight` times a rate from a force; `product` is room for it.
    fn damp(&self, rate: &[f64], weight: f64, force: &mut [f64], product: &mut [f64]) -> Result<()> {
        let Damping { mass, stiffness } = self.damping;
        for (factor, form) in [(mass, &self.mass), (stiffness, &self.stiffness)] {
            if factor != 0.0 {
                self.engine.multiply(form, rate, product)?;
                force.iter_mut().zip(&*product).for_each(|(force, p)| *force -= weight * factor * p);
            }
        }
        Ok(())
    }

    /// F . U with the constant load, in J.
    fn work(&self, u: &[f64]) -> Result<f64> {
        self.load.as_ref().map_or(Ok(0.0), |load| self.engine.dot(load, u))
    }

    /// Scale of the deflections at the nodes with these bounds, in m.
    fn length(&self, bounds: &Bounds, u: &[f64]) -> Result<f64> {
        let deflections = bounds.dofs.iter().map(|&dof| u[dof].abs());
        let largest = deflections.fold(bounds.magnitude(), |m, w| if w > m { w } else { m });
        self.engine.maximum(largest)
    }

    /// What changes with time, at an instant.
    fn moment(&self, time: f64) -> Result<Moment> {
        let mut moment = Moment::new(&self.drive, self.engine.dofs(), &self.bounds);
        moment.set(&self.drive, time)?;
        Ok(moment)
    }

    /// Rates of change of load (N/s) and bounds (m/s) at the end of a step of `dt` seconds, as seen from a frame of supports that moves
    /// at `rates` (m/s, one per motion): second order in dt, from instants of the step alone, for a formula may end with the run.
    fn change(&self, time: f64, dt: f64, rates: &[f64]) -> Result<Moment> {
        let still = vec![0.0; rates.len()];
        let moment = |steps: f64| {
            let mut moment = self.moment((time - steps * dt).max(0.0))?;
            moment.carry(&self.drive, &still);
            Ok::<_, Error>(moment)
        };
        let [first, middle, last] = [moment(1.0)?, moment(0.5)?, moment(0.0)?];
        let (mut change, mut whole) = (last.clone(), last.clone());
        whole.combine(&last, &first, |last, first| last - first);
        change.combine(&last, &middle, |last, middle| 4.0 * (last - middle));
        let both = change.clone();
        // Where there is no obstacle there is no rate.
        let finite = |rate: f64| if rate.is_finite() { rate } else { 0.0 };
        change.combine(&both, &whole, |both, whole| finite((both - whole) / dt));
        change.carry(&self.drive, rates);
        Ok(change)
    }

    /// The bounds of an instant (s), as seen from the supports. Collective.
    ///
    /// # Errors
    /// Those of the motions.
    pub fn bounds_at(&self, time: f64) -> Result<Bounds> {
        let mut bounds = self.bounds.clone();
        match &self.drive.bounds {
            Some(of) => {
                of(time, &mut bounds)?;
                self.drive.carried(time, bounds)
            }
            None => Ok(bounds),
        }
    }

    /// The processes' own parts of a number, added.
    fn total(&self, own: f64) -> Result<f64> {
        Ok(self.engine.concatenate(&[own])?.0.iter().sum())
    }
}

/// Where the motion starts; both vectors over the displacement's dofs.
#[derive(Debug, Clone)]
pub struct Start {
    /// U_0, in m.
    pub displacement: Vec<f64>,
    /// Rate of U at the start, in m/s; its velocity is V_0 = C^-1 B of it.
    pub velocity: Vec<f64>,
}

/// A dof just before the contact of the present step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Instant, in s.
    pub time: f64,
    /// Its value, in m.
    pub deflection: f64,
    /// Its velocity, in m/s.
    pub velocity: f64,
}

impl Approach {
    /// Shows an archive approaches, one a bound.
    fn archive(approaches: &mut [Approach], archive: &mut Archive) -> Result<()> {
        archive.items(
            Over::Bounds,
            approaches,
            |of| [of.time, of.deflection, of.velocity],
            |[time, deflection, velocity]| Approach { time, deflection, velocity },
        )
    }
}

/// A node that touches an obstacle, or leaves it, at an instant of its own.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Event {
    /// Instant, in s.
    pub time: f64,
    /// Which bound (an index into the bounds).
    pub bound: usize,
    /// Whether the gap closes; else it opens.
    pub closes: bool,
    /// Velocity of the node, in m/s: before it touches, or after it leaves.
    pub velocity: f64,
    /// Sum of all reactions at that instant, in N; the node's own is 0, for reactions are continuous.
    pub force: f64,
}

/// What a scheme that follows events has done so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Tally {
    /// Touches and leaves of single nodes.
    pub events: u64,
    /// Active sets whose modes were computed.
    pub active_sets: u64,
    /// Most memory that modes kept for later took, in bytes.
    pub cached_bytes: usize,
    /// Instants at which the search looked at all gaps and reactions.
    pub evaluations: u64,
}

/// A time scheme at an instant of its grid.
pub trait Scheme {
    /// Moves one step ahead.
    ///
    /// # Errors
    /// Where a matrix cannot be factored. What the solver reached is in [`Scheme::verdict`].
    fn advance(&mut self) -> Result<()>;

    /// Number of the present instant; 0 at the start.
    fn step(&self) -> u64;

    /// The present instant, in s.
    fn time(&self) -> f64;

    /// U^n, in m.
    fn displacement(&self) -> &[f64];

    /// Rate of U at the present instant, in m/s, over the displacement's dofs. M times it is the momentum of the scheme, whose change
    /// is the impulse of loads, damping and [`Scheme::impulses`]. The next steps do not notice. Collective.
    ///
    /// # Errors
    /// What the engine says.
    fn velocity(&mut self) -> Result<Vec<f64>>;

    /// Velocities of the supports that [`Scheme::velocity`] is counted from, in m/s, one per motion.
    ///
    /// # Errors
    /// Those of the motions.
    fn support_rates(&self) -> Result<Vec<f64>> {
        Ok(Vec::new())
    }

    /// The configuration of the present step that the obstacles bound (the paper's U^{n+1,e} or U^{n+1/2}), at each bound.
    fn admissible(&self) -> &[f64];

    /// The bounds that [`Scheme::admissible`] keeps.
    fn limits(&self) -> &Bounds;

    /// Reactions of the obstacles, in N, one per bound; positive upwards. See each scheme for the instant that they belong to.
    fn reaction(&self) -> &[f64];

    /// Impulses that the obstacles have given over the step to the present instant, by the scheme's own balance of momentum, in N s, one
    /// per bound; positive upwards. Zero at the start.
    fn impulses(&self) -> &[f64];

    /// The energies natural to the scheme, in J.
    ///
    /// # Errors
    /// What the engine says.
    fn energies(&self) -> Result<Energies>;

    /// The energy of the scheme's own theory, in J: what is constant in free flight, whatever the step. Unless the scheme has
    /// another, the total of [`Scheme::energies`].
    ///
    /// # Errors
    /// What the engine says.
    fn invariant(&self) -> Result<f64> {
        Ok(self.energies()?.total())
    }

    /// What the last solve reached.
    fn verdict(&self) -> Verdict;

    /// A bounded dof (an index into the bounds) just before the present step.
    fn approach(&self, bound: usize) -> Approach;

    /// Shows an archive all that the next steps depend on, down to the last digit. Restores a scheme at its start.
    ///
    /// # Errors
    /// [`crate::Error::Checkpoint`], and what the solver says.
    fn state(&mut self, archive: &mut Archive) -> Result<()>;

    /// Numeric factorisations so far; diagonalisations for a modal scheme.
    fn factorisations(&self) -> u64;

    /// What it took so far to keep the energy; `None` for a scheme that does not.
    fn relaxation(&self) -> Option<Relaxation> {
        None
    }

    /// The events since the last call, in their order; none from a scheme that does not follow them.
    fn take_events(&mut self) -> Vec<Event> {
        Vec::new()
    }

    /// Work of a scheme that follows events.
    fn tally(&self) -> Option<Tally> {
        None
    }
}
