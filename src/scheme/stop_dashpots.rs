//! Energy that the dashpots of stops and balls take, in the schemes with a step matrix.
//!
//! A dashpot c between a node w and the tip y of its stop takes, over a displacement U' that lasts
//! a time s,
//!
//! ```math
//! \frac{c}{s}\, (w' - y')^2 .
//! ```
//!
//! With the midpoint rule U' is the displacement of a step. In Newmark's scheme the instant n has
//! `$U' = \tfrac12 (U^{n+1} - U^{n-1})$`. The energy of a step is then the mean over its two
//! instants.

use super::{System, ViscousTip};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::Engine;

/// Energy that dashpots have taken, by obstacle, on all ranks.
pub(super) struct StopDashpots<'s> {
    tips: &'s [ViscousTip],
    /// Energy up to the instant, and over the present U', in J, one entry per obstacle and ball.
    ledger: Vec<[f64; 2]>,
}

impl<'s> StopDashpots<'s> {
    /// Creates the ledger; `None` where no rank has a damped stop. Collective.
    pub fn new<E: Engine>(system: &'s System<E>) -> Option<StopDashpots<'s>> {
        let tips = system.drive.viscous_tips.as_ref()?;
        let obstacles = tips.iter().map(|tip| tip.obstacle + 1).max();
        let obstacles = system.engine.comm().all_reduce(obstacles.unwrap_or(0), usize::max);
        Some(StopDashpots { tips, ledger: vec![[0.0; 2]; obstacles] })
    }

    /// Takes the energy over a displacement by dof (m) in a time (s); the shares are the parts of
    /// the last such energy and of this one that count. Collective.
    pub fn add<E: Engine>(
        &mut self,
        engine: &E,
        displacement: impl Fn(usize) -> f64,
        seconds: f64,
        [of_last, of_this]: [f64; 2],
    ) {
        let mut taken = vec![0.0; self.ledger.len()];
        for &ViscousTip { dofs: [node, tip], damping, obstacle, .. } in self.tips {
            taken[obstacle] += damping / seconds * (displacement(node) - displacement(tip)).powi(2);
        }
        let taken = engine.comm().all_reduce_sum_slice(&taken);
        for ([total, last], taken) in self.ledger.iter_mut().zip(taken) {
            *total += of_last * *last + of_this * taken;
            *last = taken;
        }
    }

    /// Returns the energy that the dashpots of each obstacle and ball have taken, in J.
    pub fn taken(&self) -> impl Iterator<Item = f64> {
        self.ledger.iter().map(|[total, _]| *total)
    }

    /// Saves or restores the ledger.
    ///
    /// # Errors
    /// Returns [`crate::Error::Checkpoint`] where the archive does not fit.
    pub fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        archive.value(&mut self.ledger)
    }
}
