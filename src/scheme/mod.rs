//! The time schemes. They know matrices and bounds, never a mesh: a bouncing ball runs through the same code as a plate.
//!
//! Symbols are the paper's (Pozzolini, Renard, Salaün, CSMA 2013):
//!
//! | code | paper | is |
//! |---|---|---|
//! | `system.stiffness` | K | stiffness |
//! | `system.mass` | M = B^T C^-1 B, or M_r | singular, or consistent mass |
//! | `system.bounds` | K^h, G, alpha | admissible deflections at the nodes |
//! | `system.load` | F | load |
//! | `e`, `beta`, `dt` | e, beta, Delta t | restitution, Newmark parameter, step |
//! | `u`, `v` | U^n, V^n | displacement, velocity |
//! | `d` | U^n - U^{n-1} | displacement increment of a step |
//! | `x` | - | unknown of the step, an increment: small, and so are its roundings |
//!
//! The unknown of a step is an increment that solves A x = b + G^T r under bounds, with b made of K U^n applied cell by cell:
//! at small steps the paper's literal right-hand sides lose the digits that this form keeps.

pub mod conserving;
pub mod equilibrium;
pub mod exact;
mod half_step;
pub mod midpoint;
pub mod newmark;
pub mod potential;

pub use conserving::{Conserving, Relaxation};
pub use equilibrium::equilibrium;
pub use exact::{Exact, ExactOptions};
pub use midpoint::{Massless, Midpoint};
pub use newmark::{Newmark, NewmarkParameters};
pub use potential::Potential;

use crate::energy::Energies;
use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::Verdict;

/// A semi-discrete impact problem: M U'' + K U = F + G^T r within bounds.
#[derive(Debug)]
pub struct System<E: Engine> {
    /// The linear algebra.
    pub engine: E,
    /// K, in N/m (and the units of slopes).
    pub stiffness: E::Form,
    /// M or M_r, in kg.
    pub mass: E::Form,
    /// F, in N; `None` where nothing loads the structure.
    pub load: Option<Vec<f64>>,
    /// Bounds on the deflections.
    pub bounds: Bounds,
}

impl<E: Engine> System<E> {
    /// F - K U. Returns the elastic energy, in J.
    fn force(&self, u: &[f64], force: &mut [f64]) -> Result<f64> {
        let elastic = 0.5 * self.engine.multiply(&self.stiffness, u, force)?;
        match &self.load {
            Some(load) => force.iter_mut().zip(load).for_each(|(b, f)| *b = f - *b),
            None => force.iter_mut().for_each(|b| *b = -*b),
        }
        Ok(elastic)
    }

    /// F . U, in J.
    fn work(&self, u: &[f64]) -> Result<f64> {
        self.load.as_ref().map_or(Ok(0.0), |load| self.engine.dot(load, u))
    }

    /// Scale of the deflections at the bounded nodes, in m.
    fn length(&self, u: &[f64]) -> Result<f64> {
        let deflections = self.bounds.dofs.iter().map(|&dof| u[dof].abs());
        let largest = deflections.fold(self.bounds.magnitude(), |m, w| if w > m { w } else { m });
        self.engine.maximum(largest)
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

/// A node that touches an obstacle, or leaves it, at an instant of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
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
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize)]
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

    /// Rate of U at the present instant, in m/s, over the displacement's dofs: for pictures.
    fn velocity(&self) -> Vec<f64>;

    /// The configuration of the present step that the obstacles bound (the paper's U^{n+1,e} or U^{n+1/2}), at each bound.
    fn admissible(&self) -> &[f64];

    /// Reactions of the obstacles, one a bound, in N; positive upwards.
    fn reaction(&self) -> &[f64];

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
