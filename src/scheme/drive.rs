//! What a structure meets besides its own stiffness and mass: damping, loads and obstacles that change with time.
//!
//! Each is absent unless a scene has it, and then costs a step one test. The schemes hold loads and bounds of the instants of a step
//! only: two of the midpoint rule, three of Newmark.

use crate::archive::{Archive, Over};
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::modes::Mode;
use crate::obstacle::Bounds;
use std::f64::consts::TAU;
use std::fmt;

/// Rayleigh damping alpha M + beta K.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Damping {
    /// alpha, in 1/s.
    pub mass: f64,
    /// beta, in s.
    pub stiffness: f64,
}

impl Damping {
    /// Whether nothing is damped.
    pub fn is_none(&self) -> bool {
        *self == Damping::default()
    }
}

/// Adds the load of an instant (s), in N, to a vector over the dofs.
pub type LoadOfTime = dyn Fn(f64, &mut [f64]) -> Result<()>;

/// Sets the bounds of an instant (s); their dofs stay.
pub type BoundsOfTime = dyn Fn(f64, &mut Bounds) -> Result<()>;

/// Damping of single modes, each by a ratio of its own: the force
/// `$-\sum_k 2 \zeta_k w_k\, M \phi_k\, (\phi_k^T M V)$`, of as low a rank as there are modes.
///
/// A matrix of a step has no room for it, dense as it is. So it acts on a velocity extrapolated from the last two steps: second order,
/// and stable at steps that are short against the time in which a mode dies out, which are asked for.
#[derive(Debug, Clone, Default)]
pub struct ModalDamping {
    shapes: Vec<Vec<f64>>,
    /// M phi.
    momenta: Vec<Vec<f64>>,
    /// 2 zeta w, in 1/s.
    rates: Vec<f64>,
}

/// Most of zeta w dt.
const LARGEST_DECAY: f64 = 0.1;

impl ModalDamping {
    /// Damps modes by ratios of critical damping.
    ///
    /// # Errors
    /// What the engine says.
    pub fn new<E: Engine>(
        engine: &E,
        mass: &E::Form,
        modes: &[Mode],
        ratios: &[f64],
    ) -> Result<ModalDamping> {
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

    /// Whether a step is short enough.
    pub(super) fn check(&self, dt: f64) -> Result<()> {
        let fastest = self.rates.iter().fold(0.0, |a: f64, b| a.max(0.5 * b));
        if fastest * dt <= LARGEST_DECAY {
            return Ok(());
        }
        Err(Error::Usage(format!(
            "damping.modal: modes that die out at {fastest:.3e} 1/s ask for a time.step of at most {:.3e} s",
            LARGEST_DECAY / fastest
        )))
    }

    /// The modes' shares of a velocity with this momentum.
    pub(super) fn of_momentum<E: Engine>(&self, engine: &E, momentum: &[f64]) -> Result<Vec<f64>> {
        project(engine, &self.shapes, momentum)
    }

    /// The modes' shares of a rate of displacement.
    pub(super) fn of_rate<E: Engine>(&self, engine: &E, rate: &[f64]) -> Result<Vec<f64>> {
        project(engine, &self.momenta, rate)
    }

    /// Takes the damping of these shares from a force.
    pub(super) fn resist(&self, shares: impl Iterator<Item = f64>, force: &mut [f64]) {
        for ((rate, momentum), share) in self.rates.iter().zip(&self.momenta).zip(shares) {
            force.iter_mut().zip(momentum).for_each(|(force, m)| *force -= rate * share * m);
        }
    }
}

/// Products with each of some vectors over all processes.
fn project<E: Engine>(engine: &E, onto: &[Vec<f64>], x: &[f64]) -> Result<Vec<f64>> {
    let own: Vec<f64> = onto.iter().map(|y| x.iter().zip(y).map(|(x, y)| x * y).sum()).collect();
    let (all, _) = engine.concatenate(&own)?;
    Ok((0..own.len()).map(|k| all.iter().skip(k).step_by(own.len()).sum()).collect())
}

/// What changes with time, and what acts on single modes. With several processes each calls both at the same instants.
#[derive(Default)]
pub struct Drive {
    /// The load beyond the constant one.
    pub load: Option<Box<LoadOfTime>>,
    /// Where the obstacles are; in the frame of the supports once these have moved by 0.
    pub bounds: Option<Box<BoundsOfTime>>,
    /// Motions of the supports, in whose frame the deflections are counted.
    pub supports: Vec<SupportMotion>,
    /// Damping of single modes.
    pub modal: Option<ModalDamping>,
}

/// A motion of supports, and the shape that it gives the plate, per metre of motion.
///
/// Deflections are counted from that shape. No second derivative of the motion is ever asked for: Newmark's load of inertia is
/// its second difference, and the schemes with velocities let the frame go evenly from instant to instant, with an impulse where its
/// velocity changes. So a kink of the motion has its whole impulse, wherever in a step it lies.
pub struct SupportMotion {
    /// Place of the supports at an instant (s), in m.
    pub place: Box<dyn Fn(f64) -> Result<f64>>,
    /// Velocity just after an instant (s), in m/s.
    pub rate: Box<dyn Fn(f64) -> Result<f64>>,
    /// Momentum of the shape that moves at 1 m/s, in kg, one entry per dof.
    pub momentum: Vec<f64>,
    /// Force with which the shape of 1 m resists, in N, one entry per dof; `None` where it is in equilibrium.
    pub stiffness: Option<Vec<f64>>,
    /// The shape of 1 m at each bounded dof.
    pub at_bounds: Vec<f64>,
    /// The shape of 1 m, one entry per dof.
    pub shape: Vec<f64>,
}

impl Drive {
    /// Whether loads or obstacles change.
    pub fn varies(&self) -> bool {
        self.load.is_some() || self.bounds.is_some() || !self.supports.is_empty()
    }

    /// Places of the supports at an instant (s), in m, one per motion.
    pub(super) fn places(&self, time: f64) -> Result<Vec<f64>> {
        self.supports.iter().map(|motion| (motion.place)(time)).collect()
    }

    /// Velocities of the supports just after an instant (s), in m/s, one per motion.
    ///
    /// # Errors
    /// Those of the motions.
    pub fn rates(&self, time: f64) -> Result<Vec<f64>> {
        self.supports.iter().map(|motion| (motion.rate)(time)).collect()
    }

    /// Bounds of an instant (s) as seen from the supports.
    ///
    /// # Errors
    /// Those of the motions.
    pub fn carried(&self, time: f64, bounds: Bounds) -> Result<Bounds> {
        let places = vec![0.0; self.supports.len()];
        let mut moment = Moment { load: None, bounds: Some(bounds), places };
        moment.carry(self, &self.places(time)?);
        Ok(moment.bounds.unwrap_or_default())
    }

    /// Adds the load of an instant (s) with which the supports' shape resists.
    ///
    /// # Errors
    /// Those of the motions.
    pub fn pull(&self, time: f64, load: &mut [f64]) -> Result<()> {
        for (motion, place) in self.supports.iter().zip(self.places(time)?) {
            let stiffness = motion.stiffness.iter().flatten();
            load.iter_mut().zip(stiffness).for_each(|(load, k)| *load -= place * k);
        }
        Ok(())
    }

    /// Takes the inertia of the supports' accelerations (m/s^2, one per motion) from a force.
    pub(super) fn subtract_inertia(&self, accelerations: &[f64], force: &mut [f64]) {
        for (motion, a) in self.supports.iter().zip(accelerations) {
            force.iter_mut().zip(&motion.momentum).for_each(|(force, m)| *force -= a * m);
        }
    }

    /// Adds the shapes of some motions (m or m/s, one per motion) to values over the dofs.
    pub(super) fn add_shapes(&self, sizes: impl Iterator<Item = f64>, values: &mut [f64]) {
        for (motion, size) in self.supports.iter().zip(sizes) {
            values.iter_mut().zip(&motion.shape).for_each(|(value, r)| *value += size * r);
        }
    }

    /// Whether a load changes with time; so does that of springs to the ground where supports move.
    pub(super) fn pushes(&self) -> bool {
        self.load.is_some() || self.supports.iter().any(|motion| motion.stiffness.is_some())
    }

    /// Refuses the damping of single modes for a scheme.
    pub(super) fn refuse_modal(&self, scheme: &str) -> Result<()> {
        match self.modal {
            None => Ok(()),
            Some(_) => Err(Error::Usage(format!(
                "time.scheme = \"{scheme}\" takes no damping.modal; set time.scheme = \"newmark\" or \"midpoint\""
            ))),
        }
    }
}

impl fmt::Debug for Drive {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (load, bounds) = (self.load.is_some(), self.bounds.is_some());
        let mut drive = f.debug_struct("Drive");
        drive.field("load", &load).field("bounds", &bounds).field("supports", &self.supports.len());
        drive.field("modal", &self.modal).finish()
    }
}

/// What changes with time, at an instant: `None` what does not.
#[derive(Debug, Clone, Default)]
pub(super) struct Moment {
    /// The load beyond the constant one, in N.
    pub load: Option<Vec<f64>>,
    /// The bounds.
    pub bounds: Option<Bounds>,
    /// Where the frame of the supports is, in m, one per motion.
    pub places: Vec<f64>,
}

impl Moment {
    /// Room for a drive's moments: no load, and the bounds at rest.
    pub fn new(drive: &Drive, dofs: usize, at_rest: &Bounds) -> Moment {
        Moment {
            load: drive.pushes().then(|| vec![0.0; dofs]),
            bounds: drive.bounds.as_ref().map(|_| at_rest.clone()),
            places: vec![0.0; drive.supports.len()],
        }
    }

    /// Sets load and bounds to those of an instant.
    pub fn set(&mut self, drive: &Drive, time: f64) -> Result<()> {
        if let Some(load) = &mut self.load {
            load.fill(0.0);
            if let Some(of) = &drive.load {
                of(time, load)?;
            }
        }
        if let (Some(of), Some(bounds)) = (&drive.bounds, &mut self.bounds) {
            of(time, bounds)?;
        }
        self.places.fill(0.0);
        self.carry(drive, &drive.places(time)?);
        Ok(())
    }

    /// Moves the frame of the supports, and with it what is seen from there.
    pub fn carry(&mut self, drive: &Drive, places: &[f64]) {
        for (motion, (place, to)) in drive.supports.iter().zip(self.places.iter_mut().zip(places)) {
            let way = to - *place;
            *place = *to;
            if let (Some(load), Some(stiffness)) = (&mut self.load, &motion.stiffness) {
                load.iter_mut().zip(stiffness).for_each(|(load, k)| *load -= way * k);
            }
            if let Some(Bounds { lower, upper, .. }) = &mut self.bounds {
                for ((lower, upper), r) in lower.iter_mut().zip(upper).zip(&motion.at_bounds) {
                    *lower -= way * r;
                    *upper -= way * r;
                }
            }
        }
    }

    /// Sets each number to what `map` makes of those of two other moments.
    pub fn combine(&mut self, a: &Moment, b: &Moment, map: impl Fn(f64, f64) -> f64) {
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

    /// Shows an archive all of it.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        if let Some(load) = &mut self.load {
            archive.vector(Over::Dofs, load)?;
        }
        if let Some(Bounds { lower, upper, .. }) = &mut self.bounds {
            archive.vector(Over::Bounds, lower)?;
            archive.vector(Over::Bounds, upper)?;
        }
        archive.value(&mut self.places)
    }

    /// Takes what another moment has.
    pub fn copy(&mut self, of: &Moment) {
        self.combine(of, of, |value, _| value);
    }

    /// Sets each number to where an even change from `now` to `next` has it, `steps` such changes after `now`. An obstacle that is not
    /// there now is not there.
    pub fn extrapolate(&mut self, now: &Moment, next: &Moment, steps: f64) {
        self.combine(now, next, |now, next| if now.is_finite() { now + steps * (next - now) } else { now });
    }

    /// The bounds of this instant, given those at rest.
    pub fn bounds<'m>(&'m self, at_rest: &'m Bounds) -> &'m Bounds {
        self.bounds.as_ref().unwrap_or(at_rest)
    }

    /// Adds the load to a force.
    pub fn push(&self, force: &mut [f64]) {
        if let Some(load) = &self.load {
            force.iter_mut().zip(load).for_each(|(force, load)| *force += load);
        }
    }

    /// This process's part of the work, in J, that reactions do where the bounds go from here to there.
    pub fn carried(&self, to: &Moment, reaction: &[f64]) -> f64 {
        let (Some(from), Some(to)) = (&self.bounds, &to.bounds) else { return 0.0 };
        let way = |i: usize| {
            if reaction[i] > 0.0 { to.lower[i] - from.lower[i] } else { to.upper[i] - from.upper[i] }
        };
        reaction.iter().enumerate().filter(|(_, r)| **r != 0.0).map(|(i, r)| r * way(i)).sum()
    }
}
