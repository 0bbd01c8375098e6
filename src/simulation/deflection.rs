//! Largest deflection of a run, with its place and time.

use super::dof_coordinates::{DeflectionDof, DofCoordinates};
use super::nodal_motion::NodalMotion;
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::{Engine, Form};
use crate::scheme::{Solution, System};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::rc::Rc;

/// Number of instants per period of the lowest mode at which a run with the modal mass looks at
/// all nodes: its steps compute no displacement. The peak of that mode is missed by 0.05 % at most.
const PER_PERIOD: f64 = 100.0;

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

    /// Returns the largest deflection at the present instant of a scheme.
    fn largest(&self, scheme: &dyn Solution) -> Result<LargestDeflection> {
        let (u, time) = (scheme.displacement(), scheme.time());
        let mut largest = LargestDeflection { value: 0.0, time, at: [0.0; 2] };
        let lifts = self.motion.lifts(time)?;
        for &(dof, node, place) in &self.sites {
            let value =
                lifts.iter().fold(u[dof], |sum, (height, shape)| sum + height * shape[PER_NODE * node]);
            if value.abs() > (1.0 + EQUAL) * largest.value.abs() {
                largest = LargestDeflection { value, at: place, ..largest };
            }
        }
        Ok(largest)
    }
}

/// Search for the largest deflection over the steps of a run.
pub(super) struct DeflectionWatch {
    /// Number of steps from one look to the next.
    every: u64,
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
        DeflectionWatch { every: lowest.map_or(1, |square| steps(square).max(1.0) as u64), largest: None }
    }

    /// Takes the deflections of a step where they are due.
    ///
    /// # Errors
    /// Returns the errors of the support motions.
    pub fn note(&mut self, sites: &DeflectionSites, scheme: &dyn Solution) -> Result<()> {
        if !scheme.step().is_multiple_of(self.every) {
            return Ok(());
        }
        let present = sites.largest(scheme)?;
        if self.largest.is_none_or(|largest| present.value.abs() > (1.0 + EQUAL) * largest.value.abs()) {
            self.largest = Some(present);
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
        if !archive.saves() {
            self.largest = largest;
        }
        Ok(())
    }
}
