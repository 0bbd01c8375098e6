//! Largest deflection of a run, with its place and time.

use super::dof_coordinates::{DeflectionDof, DofCoordinates};
use super::nodal_motion::NodalMotion;
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::{Engine, Form};
use crate::scheme::{Scheme, Solution, System};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::rc::Rc;

/// Least number of instants per period of the lowest mode at which a run with the modal mass looks
/// at all nodes: its steps compute no displacement. It looks earlier where a node, at its present
/// velocity, would come to the largest deflection so far.
const PER_PERIOD: f64 = 100.0;

/// Part of the time in which a node comes to the largest deflection until the next look.
const SOONER: f64 = 0.5;

/// Square of a rigid motion's frequency relative to the highest mode's, at most.
const RIGID: f64 = 1e-9;

/// Relative difference up to which deflections are equal but for rounding.
const EQUAL: f64 = 1e-9;

/// Deflection of largest magnitude over a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LargestDeflection {
    /// Deflection relative to the ground, in m, positive upwards.
    pub value: f64,
    /// Time, in s.
    pub time: f64,
    /// Position of the node, in m.
    pub at: [f64; 2],
}

impl LargestDeflection {
    /// Returns whether this deflection comes before another one: the larger; of equal ones the
    /// earlier, then the first in x and y.
    fn precedes(&self, other: &LargestDeflection) -> bool {
        let [mine, theirs] = [self.value.abs(), other.value.abs()];
        if (mine - theirs).abs() > EQUAL * mine.max(theirs) {
            return mine > theirs;
        }
        let keys = |largest: &LargestDeflection| [largest.time, largest.at[0], largest.at[1]];
        keys(self) < keys(other)
    }
}

/// Free deflections of this process's nodes, by which the largest one is found.
pub(super) struct DeflectionSites {
    /// Dof, node and position (m) of each, by x and y.
    sites: Vec<(usize, usize, [f64; 2])>,
    motion: Rc<NodalMotion>,
}

impl DeflectionSites {
    /// Prepares the search over some dofs.
    pub fn new(
        places: &DofCoordinates,
        sites: &[DeflectionDof],
        motion: &Rc<NodalMotion>,
    ) -> DeflectionSites {
        let is_plate = |site: &&DeflectionDof| places.is_deflection(site.dof);
        let mut sites: Vec<_> =
            sites.iter().filter(is_plate).map(|site| (site.dof, site.node, site.at)).collect();
        sites.sort_by(|(.., a), (.., b)| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        DeflectionSites { sites, motion: motion.clone() }
    }

    /// Returns the time in which the first node comes to a deflection of this size (m) at its
    /// present velocity, in s.
    fn time_to(&self, size: f64, scheme: &mut dyn Scheme) -> Result<f64> {
        let (rates, of_supports) = (scheme.velocity()?, scheme.support_rates()?);
        let moves: Vec<(f64, &[f64])> = of_supports.into_iter().zip(self.motion.shapes()).collect();
        let (u, lifts) = (scheme.displacement(), self.motion.lifts(scheme.time())?);
        let time = |&(dof, node, _): &(usize, usize, _)| {
            let (value, rate) = (lifted(u[dof], &lifts, node), lifted(rates[dof], &moves, node));
            (size - value.abs()).max(0.0) / (rate * value.signum()).max(0.0)
        };
        Ok(self.sites.iter().map(time).fold(f64::INFINITY, f64::min))
    }

    /// Returns the largest deflection at the present instant of a scheme.
    fn largest(&self, scheme: &dyn Solution) -> Result<LargestDeflection> {
        let (u, time) = (scheme.displacement(), scheme.time());
        let mut largest = LargestDeflection { value: 0.0, time, at: [0.0; 2] };
        let lifts = self.motion.lifts(time)?;
        for &(dof, node, place) in &self.sites {
            let value = lifted(u[dof], &lifts, node);
            if value.abs() > (1.0 + EQUAL) * largest.value.abs() {
                largest = LargestDeflection { value, at: place, ..largest };
            }
        }
        Ok(largest)
    }
}

/// Returns a deflection (m) with the share of supports at heights (m), or its rate with theirs.
fn lifted(value: f64, lifts: &[(f64, &[f64])], node: usize) -> f64 {
    lifts.iter().fold(value, |sum, (height, shape)| sum + height * shape[PER_NODE * node])
}

/// Search for the largest deflection over the steps of a run.
pub(super) struct DeflectionWatch {
    /// Largest number of steps from one look to the next, and the step of the next look.
    every: u64,
    next: u64,
    /// Largest deflection of this process's nodes so far.
    largest: Option<LargestDeflection>,
}

impl DeflectionWatch {
    /// Starts a search over steps of a length (s).
    pub fn new<E: Engine>(system: &System<E>, step: f64) -> DeflectionWatch {
        let lowest = match &system.mass {
            Form::Modal { modes, .. } => {
                let highest = modes.squares.iter().copied().fold(0.0, f64::max);
                modes.squares.iter().copied().find(|square| *square > RIGID * highest)
            }
            _ => None,
        };
        let steps = |square: f64| TAU / square.sqrt() / PER_PERIOD / step;
        let every = lowest.map_or(1, |square| steps(square).max(1.0) as u64);
        DeflectionWatch { every, next: 0, largest: None }
    }

    /// Takes the deflections of a step where they are due, and of the last step. Collective.
    ///
    /// # Errors
    /// Returns the errors of the support motions and of the scheme.
    pub fn note(
        &mut self,
        sites: &DeflectionSites,
        scheme: &mut dyn Scheme,
        is_last: bool,
        comm: &impl Communicator,
    ) -> Result<()> {
        let step = scheme.step();
        if step < self.next && !is_last {
            return Ok(());
        }
        let present = sites.largest(scheme)?;
        if self.largest.is_none_or(|largest| present.value.abs() > (1.0 + EQUAL) * largest.value.abs()) {
            self.largest = Some(present);
        }
        self.next = step + self.every;
        if self.every > 1 && !is_last {
            let size = self.largest.map_or(0.0, |largest| largest.value.abs());
            let size = comm.all_reduce_max(size);
            let time = -comm.all_reduce_max(-sites.time_to(size, scheme)?);
            let steps = SOONER * time / scheme.record().dt;
            self.next = step + (steps as u64).clamp(1, self.every);
        }
        Ok(())
    }

    /// Returns the largest deflection of all processes so far. Collective.
    pub fn largest(&self, comm: &impl Communicator) -> Option<LargestDeflection> {
        let numbers = |largest: &LargestDeflection| (largest.value, largest.time, largest.at);
        let gathered = comm.all_gather(&self.largest.iter().map(numbers).collect::<Vec<_>>());
        let largest = |(value, time, place)| LargestDeflection { value, time, at: place };
        let each = gathered.into_iter().map(largest);
        each.reduce(|best, other| if other.precedes(&best) { other } else { best })
    }

    /// Saves or restores the largest deflection. Collective.
    pub fn archive(&mut self, comm: &impl Communicator, archive: &mut Archive) -> Result<()> {
        let mut largest = self.largest(comm);
        archive.value(&mut largest)?;
        archive.value(&mut self.next)?;
        if !archive.saves() {
            self.largest = largest;
        }
        Ok(())
    }
}
