//! Damping, support motions, and loads and obstacles that depend on time.
//!
//! Each is absent unless the scene has it; an absent one costs a single test per step. The schemes
//! store loads and bounds at the instants of one step only: two for the midpoint rule, three for
//! Newmark.

use super::coulomb::ContactFriction;
use super::following_load::FollowingLoad;
use super::sliding::BoundSlider;
use crate::archive::{Archive, VectorKind};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy, dot};
use crate::linalg::{Engine, Form};
use crate::membrane::QuarticForm;
use crate::modes::Mode;
use crate::obstacle::Bounds;
use std::f64::consts::TAU;
use std::fmt;
use std::rc::Rc;

/// Rayleigh damping alpha M + beta K.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Damping {
    /// Mass coefficient alpha, in 1/s.
    pub mass: f64,
    /// Stiffness coefficient beta, in s.
    pub stiffness: f64,
}

impl Damping {
    /// Returns whether both coefficients are zero.
    pub fn is_none(&self) -> bool {
        *self == Damping::default()
    }
}

/// Function that adds the load at an instant (s) to a vector, in N, one entry per dof.
pub type LoadOfTime = dyn Fn(f64, &mut [f64]) -> Result<()>;

/// Load of fixed distribution that is scaled in time.
pub struct LoadTerm {
    /// Factor at an instant (s), dimensionless.
    pub factor: Box<dyn Fn(f64) -> Result<f64>>,
    /// Text that tells the factor: those of equal texts are equal. `None` where there is none.
    pub law: Option<String>,
    /// Load at the factor 1, in N, one entry per dof.
    pub load: Vec<f64>,
}

/// Function that sets the bounds (m) at an instant (s); their dofs stay the same.
pub type BoundsOfTime = dyn Fn(f64, &mut Bounds) -> Result<()>;

/// Modal damping with one damping ratio per mode: the force
/// `$-\sum_k 2 \zeta_k w_k\, M \phi_k\, (\phi_k^T M V)$`, whose rank is the number of damped modes.
///
/// The corresponding matrix is dense and cannot be added to the step matrix. The force therefore
/// acts on a velocity extrapolated from the last two steps. This is second order, and stable for
/// steps that are short compared with the decay time of each mode, which is checked.
#[derive(Debug, Clone, Default)]
pub struct ModalDamping {
    shapes: Vec<Vec<f64>>,
    /// Products M phi, one vector per mode.
    momenta: Vec<Vec<f64>>,
    /// Decay rates `$2 \zeta w$`, in 1/s.
    pub(crate) rates: Vec<f64>,
}

/// Largest `$\zeta w \Delta t$` accepted.
const LARGEST_DECAY: f64 = 0.1;

impl ModalDamping {
    /// Builds the damping of `modes` by `ratios` of critical damping, one per mode.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new<E: Engine>(engine: &E, mass: &Form, modes: &[Mode], ratios: &[f64]) -> Result<ModalDamping> {
        let mut damping = ModalDamping::default();
        for (Mode { frequency, shape }, ratio) in modes.iter().zip(ratios) {
            let mut momentum = vec![0.0; shape.len()];
            engine.multiply(mass, shape, &mut momentum)?;
            damping.shapes.push(shape.clone());
            damping.momenta.push(momentum);
            damping.rates.push(2.0 * ratio * TAU * frequency);
        }
        Ok(damping)
    }

    /// Builds the damping of modes that carry all inertia by themselves, in order, with decay rates
    /// `$2 \zeta w$` in 1/s.
    pub fn of_rates(rates: Vec<f64>) -> ModalDamping {
        ModalDamping { rates, ..ModalDamping::default() }
    }

    /// Returns an error where the step `dt` (s) is too long for the damped modes.
    pub(super) fn check(&self, dt: f64) -> Result<()> {
        let fastest = self.rates.iter().fold(0.0, |a: f64, b| a.max(0.5 * b));
        if fastest * dt <= LARGEST_DECAY {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "damping.modal: modes that decay at {fastest:.3e} 1/s need a time.step of at most {:.3e} s",
            LARGEST_DECAY / fastest
        )))
    }

    /// Returns the modal coordinates of a velocity, given its momentum. Collective.
    pub(super) fn of_momentum<E: Engine>(&self, engine: &E, momentum: &[f64]) -> Result<Vec<f64>> {
        project(engine, &self.shapes, momentum)
    }

    /// Returns the modal coordinates of a rate of displacement. Collective.
    pub(super) fn of_rate<E: Engine>(&self, engine: &E, rate: &[f64]) -> Result<Vec<f64>> {
        project(engine, &self.momenta, rate)
    }

    /// Adds the displacements whose inertia is the modal damping force of given modal velocities,
    /// in m/s^2, to `decay`.
    pub(super) fn add_decay(&self, velocities: &[f64], decay: &mut [f64]) {
        for ((rate, shape), v) in self.rates.iter().zip(&self.shapes).zip(velocities) {
            axpy(rate * v, shape, decay);
        }
    }

    /// Subtracts the modal damping force of given modal velocities from `force`.
    pub(super) fn subtract_damping(&self, velocities: impl Iterator<Item = f64>, force: &mut [f64]) {
        for ((rate, momentum), v) in self.rates.iter().zip(&self.momenta).zip(velocities) {
            axpy(-rate * v, momentum, force);
        }
    }
}

/// Returns the inner products of x with each vector of `onto`, summed over all processes.
/// Collective.
fn project<E: Engine>(engine: &E, onto: &[Vec<f64>], x: &[f64]) -> Result<Vec<f64>> {
    let products: Vec<f64> = onto.iter().map(|y| dot(x, y)).collect();
    Ok(engine.comm().all_reduce_sum_slice(&products))
}

/// Energy V of the stretching mid-plane as a function of the displacement.
pub trait StretchingEnergy {
    /// Sets `gradient` to V'(U), in N, for U in m, both with one entry per dof. Returns V, in J.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the solver in the plane.
    fn evaluate(&self, u: &[f64], gradient: &mut [f64]) -> Result<f64>;
}

/// Velocities of rigid motions of the plate with the singular mass, one entry per velocity dof.
#[derive(Debug, Clone, Default)]
pub struct RigidVelocities {
    /// All of them: translation and tilts.
    pub all: Vec<Vec<f64>>,
    /// Motions that nothing restrains.
    pub free: Vec<Vec<f64>>,
}

/// Time-dependent loads, obstacles and supports, and forces besides those of M, K and Rayleigh's
/// damping. All processes evaluate them at the same instants.
#[derive(Default)]
pub struct TimeDependence {
    /// Time-dependent loads of fixed distribution.
    pub terms: Vec<LoadTerm>,
    /// Time-dependent load of any distribution, besides the terms.
    pub load: Option<Box<LoadOfTime>>,
    /// Time-dependent obstacles, given for supports at their initial place.
    pub bounds: Option<Box<BoundsOfTime>>,
    /// Support motions; deflections are measured in their frame.
    pub supports: Vec<SupportMotion>,
    /// Damping of single modes.
    pub modal: Option<ModalDamping>,
    /// Damping of compliant stops, in N s/m: what it adds to Rayleigh's damping of their springs.
    pub dashpots: Option<Form>,
    /// Damped tips of compliant stops that this rank has; `None` where no rank has any.
    pub viscous_tips: Option<Vec<ViscousTip>>,
    /// Energy of stretching in the modes of a modal mass; `None` for a plate that only bends.
    pub stretching: Option<Rc<QuarticForm>>,
    /// Energy of stretching of the dofs; `None` with the modal mass or for a plate that only bends.
    pub membrane: Option<Box<dyn StretchingEnergy>>,
    /// Velocities of rigid motions, where a force depends on the deflection.
    pub rigid: RigidVelocities,
    /// Load that depends on the deflection.
    pub following: Option<Box<dyn FollowingLoad>>,
    /// Dry friction at bounded dofs of this rank; `None` where no rank has any.
    pub sliders: Option<Vec<BoundSlider>>,
    /// Friction of obstacles; `None` where none has any.
    pub friction: Option<ContactFriction>,
}

/// Bounded tip without mass, behind a spring and a dashpot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViscousTip {
    /// Index of its bound.
    pub bound: usize,
    /// Dofs of the node, or of the gap of a ball, and of the tip.
    pub dofs: [usize; 2],
    /// Index of its obstacle; balls come after the obstacles.
    pub obstacle: usize,
    /// Stiffness, in N/m.
    pub stiffness: f64,
    /// Damping, in N s/m.
    pub damping: f64,
}

/// Motion of supports, and the quasi-static shape that it gives the plate per metre.
///
/// Deflections are measured relative to that shape. No second derivative of the motion is needed:
/// Newmark uses its second difference as inertial load, and the schemes with velocities move the
/// frame uniformly between instants, with an impulse where its velocity jumps. A kink of the motion
/// therefore has its full impulse wherever in a step it lies.
pub struct SupportMotion {
    /// Support place at an instant (s), in m.
    pub place: Box<dyn Fn(f64) -> Result<f64>>,
    /// Support velocity just after an instant (s), in m/s.
    pub rate: Box<dyn Fn(f64) -> Result<f64>>,
    /// Momentum of the shape moving at 1 m/s, in kg, one entry per dof.
    pub momentum: Vec<f64>,
    /// Restoring force of the shape at 1 m, in N, one entry per dof; `None` where the shape is in
    /// equilibrium.
    pub stiffness: Option<Vec<f64>>,
    /// Shape at 1 m, one entry per bound.
    pub at_bounds: Vec<f64>,
    /// Shape at 1 m, one entry per dof.
    pub shape: Vec<f64>,
}

impl TimeDependence {
    /// Returns whether loads, obstacles or supports depend on time.
    pub fn varies(&self) -> bool {
        self.loads() || self.bounds.is_some() || !self.supports.is_empty()
    }

    /// Returns whether the bounds depend on time, seen from the supports.
    pub(super) fn moves_bounds(&self) -> bool {
        self.bounds.is_some() || !self.supports.is_empty()
    }

    /// Returns whether any load depends on time.
    fn loads(&self) -> bool {
        !self.terms.is_empty() || self.load.is_some()
    }

    /// Returns the support places at an instant (s), in m, one entry per motion.
    pub(super) fn places(&self, time: f64) -> Result<Vec<f64>> {
        self.supports.iter().map(|motion| (motion.place)(time)).collect()
    }

    /// Returns the support velocities just after an instant (s), in m/s, one entry per motion.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    pub fn rates(&self, time: f64) -> Result<Vec<f64>> {
        self.supports.iter().map(|motion| (motion.rate)(time)).collect()
    }

    /// Returns the bounds at an instant (s) relative to the supports, in m.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    pub fn relative_bounds(&self, time: f64, bounds: Bounds) -> Result<Bounds> {
        let places = vec![0.0; self.supports.len()];
        let mut moment = InstantData { load: None, bounds: Some(bounds), places };
        moment.carry(self, &self.places(time)?);
        Ok(moment.bounds.unwrap_or_default())
    }

    /// Adds the restoring force of the support shapes at an instant (s) to `load`, in N.
    ///
    /// # Errors
    /// Returns the errors of the motions.
    pub fn add_support_force(&self, time: f64, load: &mut [f64]) -> Result<()> {
        for (motion, place) in self.supports.iter().zip(self.places(time)?) {
            if let Some(stiffness) = &motion.stiffness {
                axpy(-place, stiffness, load);
            }
        }
        Ok(())
    }

    /// Subtracts the inertia of the support accelerations (m/s^2, one entry per motion) from
    /// `force`.
    pub(super) fn subtract_inertia(&self, accelerations: &[f64], force: &mut [f64]) {
        for (motion, a) in self.supports.iter().zip(accelerations) {
            axpy(-a, &motion.momentum, force);
        }
    }

    /// Adds the support shapes, scaled by `sizes` (m or m/s, one entry per motion), to values per
    /// dof.
    pub(super) fn add_shapes(&self, sizes: impl Iterator<Item = f64>, values: &mut [f64]) {
        for (motion, size) in self.supports.iter().zip(sizes) {
            axpy(size, &motion.shape, values);
        }
    }

    /// Returns whether the load depends on time; springs to the ground count where supports move.
    pub(super) fn pushes(&self) -> bool {
        self.loads() || self.supports.iter().any(|motion| motion.stiffness.is_some())
    }

    /// Returns an error where dashpots are combined with a scheme that takes the massless part of
    /// the displacement from an equilibrium.
    pub(super) fn refuse_dashpots(&self) -> Result<()> {
        if self.dashpots.is_none() {
            return Ok(());
        }
        let what = match self.viscous_tips {
            Some(_) => "obstacle.damping: the tip of a damped stop is",
            None => "dashpot: what it holds is",
        };
        Err(Error::Usage(format!(
            "{what} in no equilibrium; set time.massless = \"reflected\" with time.scheme = \"midpoint\", or \
             time.scheme = \"newmark\""
        )))
    }

    /// Returns an error where damping of stops is combined with a scheme that does not follow their
    /// tips on the modal mass.
    pub(super) fn refuse_viscous_tips(&self) -> Result<()> {
        match self.viscous_tips {
            None => Ok(()),
            Some(_) => Err(Error::Usage(
                "obstacle.damping: with time.mass = \"modal\" expected time.scheme = \"conserving\"".into(),
            )),
        }
    }

    /// Returns an error where modal damping is combined with the named scheme.
    pub(super) fn refuse_modal(&self, scheme: &str) -> Result<()> {
        match self.modal {
            None => Ok(()),
            Some(_) => Err(Error::Usage(format!(
                "time.scheme = \"{scheme}\" takes no damping.modal; set time.scheme = \"newmark\" or \"midpoint\""
            ))),
        }
    }
}

impl fmt::Debug for TimeDependence {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (load, bounds) = (self.loads(), self.bounds.is_some());
        let mut fields = f.debug_struct("TimeDependence");
        fields.field("load", &load).field("bounds", &bounds).field("supports", &self.supports.len());
        fields.field("modal", &self.modal).field("dashpots", &self.dashpots.is_some()).finish()
    }
}

/// Time-dependent data at one instant; `None` for constant data.
#[derive(Debug, Clone, Default)]
pub(super) struct InstantData {
    /// Time-dependent part of the load, in N, one entry per dof.
    pub load: Option<Vec<f64>>,
    /// Bounds, in m.
    pub bounds: Option<Bounds>,
    /// Places of the support frame, in m, one entry per motion.
    pub places: Vec<f64>,
}

impl InstantData {
    /// Allocates the data with zero load and the bounds at rest.
    pub fn new(drive: &TimeDependence, dofs: usize, at_rest: &Bounds) -> InstantData {
        InstantData {
            load: drive.pushes().then(|| vec![0.0; dofs]),
            bounds: drive.bounds.as_ref().map(|_| at_rest.clone()),
            places: vec![0.0; drive.supports.len()],
        }
    }

    /// Sets load, bounds and support places to those at `time` (s).
    pub fn set(&mut self, drive: &TimeDependence, time: f64) -> Result<()> {
        if let Some(load) = &mut self.load {
            load.fill(0.0);
            for term in &drive.terms {
                axpy((term.factor)(time)?, &term.load, load);
            }
            if let Some(load_of_time) = &drive.load {
                load_of_time(time, load)?;
            }
        }
        if let (Some(load_of_time), Some(bounds)) = (&drive.bounds, &mut self.bounds) {
            load_of_time(time, bounds)?;
        }
        self.places.fill(0.0);
        self.carry(drive, &drive.places(time)?);
        Ok(())
    }

    /// Moves the support frame to `places` (m, one entry per motion) and transforms load and
    /// bounds.
    pub fn carry(&mut self, drive: &TimeDependence, places: &[f64]) {
        for (motion, (place, to)) in drive.supports.iter().zip(self.places.iter_mut().zip(places)) {
            let increment = to - *place;
            *place = *to;
            if let (Some(load), Some(stiffness)) = (&mut self.load, &motion.stiffness) {
                axpy(-increment, stiffness, load);
            }
            if let Some(Bounds { lower, upper, .. }) = &mut self.bounds {
                axpy(-increment, &motion.at_bounds, lower);
                axpy(-increment, &motion.at_bounds, upper);
            }
        }
    }

    /// Sets each number to `map` of the corresponding numbers of two other instants.
    pub fn combine(&mut self, a: &InstantData, b: &InstantData, map: impl Fn(f64, f64) -> f64) {
        let each = |to: &mut [f64], a: &[f64], b: &[f64]| {
            to.iter_mut().zip(a.iter().zip(b)).for_each(|(to, (a, b))| *to = map(*a, *b));
        };
        if let (Some(to), Some(a), Some(b)) = (&mut self.load, &a.load, &b.load) {
            each(to, a, b);
        }
        if let (Some(to), Some(a), Some(b)) = (&mut self.bounds, &a.bounds, &b.bounds) {
            each(&mut to.lower, &a.lower, &b.lower);
            each(&mut to.upper, &a.upper, &b.upper);
        }
        each(&mut self.places, &a.places, &b.places);
    }

    /// Saves all data to an archive or restores them from it.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        if let Some(load) = &mut self.load {
            archive.vector(VectorKind::Dofs, load)?;
        }
        if let Some(Bounds { lower, upper, .. }) = &mut self.bounds {
            archive.vector(VectorKind::Bounds, lower)?;
            archive.vector(VectorKind::Bounds, upper)?;
        }
        archive.value(&mut self.places)
    }

    /// Copies the data of another instant.
    pub fn copy(&mut self, other: &InstantData) {
        self.combine(other, other, |value, _| value);
    }

    /// Sets each number by linear extrapolation from `now` to `next`, `steps` steps after `now`. An
    /// obstacle absent at `now` stays absent.
    pub fn extrapolate(&mut self, now: &InstantData, next: &InstantData, steps: f64) {
        self.combine(now, next, |now, next| if now.is_finite() { now + steps * (next - now) } else { now });
    }

    /// Returns the bounds of this instant; `at_rest` where they are constant.
    pub fn bounds<'m>(&'m self, at_rest: &'m Bounds) -> &'m Bounds {
        self.bounds.as_ref().unwrap_or(at_rest)
    }

    /// Adds the time-dependent load to `force`, in N.
    pub fn add_load(&self, force: &mut [f64]) {
        if let Some(load) = &self.load {
            add(load, force);
        }
    }

    /// Returns this process's part of the work of the reactions as the bounds move to those of
    /// `to`, in J.
    pub fn boundary_work(&self, to: &InstantData, reaction: &[f64]) -> f64 {
        let (Some(from), Some(to)) = (&self.bounds, &to.bounds) else { return 0.0 };
        let increment = |i: usize| {
            if reaction[i] > 0.0 { to.lower[i] - from.lower[i] } else { to.upper[i] - from.upper[i] }
        };
        reaction.iter().enumerate().filter(|(_, r)| **r != 0.0).map(|(i, r)| r * increment(i)).sum()
    }
}
