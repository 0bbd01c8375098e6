//! What a structure meets besides its own stiffness and mass: damping, loads and obstacles that change with time.
//!
//! Each is absent unless a scene has it, and then costs a step one test. The schemes hold loads and bounds of the instants of a step
//! only: two of the midpoint rule, three of Newmark.

use crate::error::Result;
use crate::obstacle::Bounds;
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

/// What changes with time. With several processes each calls both at the same instants.
#[derive(Default)]
pub struct Drive {
    /// The load beyond the constant one.
    pub load: Option<Box<LoadOfTime>>,
    /// Where the obstacles are.
    pub bounds: Option<Box<BoundsOfTime>>,
}

impl Drive {
    /// Whether nothing changes.
    pub fn is_none(&self) -> bool {
        self.load.is_none() && self.bounds.is_none()
    }
}

impl fmt::Debug for Drive {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let (load, bounds) = (self.load.is_some(), self.bounds.is_some());
        f.debug_struct("Drive").field("load", &load).field("bounds", &bounds).finish()
    }
}

/// What changes with time, at an instant: `None` what does not.
#[derive(Debug, Clone, Default)]
pub(super) struct Moment {
    /// The load beyond the constant one, in N.
    pub load: Option<Vec<f64>>,
    /// The bounds.
    pub bounds: Option<Bounds>,
}

impl Moment {
    /// Room for a drive's moments: no load, and the bounds at rest.
    pub fn new(drive: &Drive, dofs: usize, at_rest: &Bounds) -> Moment {
        Moment {
            load: drive.load.as_ref().map(|_| vec![0.0; dofs]),
            bounds: drive.bounds.as_ref().map(|_| at_rest.clone()),
        }
    }

    /// Sets load and bounds to those of an instant.
    pub fn set(&mut self, drive: &Drive, time: f64) -> Result<()> {
        if let (Some(of), Some(load)) = (&drive.load, &mut self.load) {
            load.fill(0.0);
            of(time, load)?;
        }
        if let (Some(of), Some(bounds)) = (&drive.bounds, &mut self.bounds) {
            of(time, bounds)?;
        }
        Ok(())
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
