//! When each node touches an obstacle, and how hard.

use super::Site;
use crate::archive::{Archive, Over};
use crate::error::Result;

/// A node's contact with an obstacle, from its first to its last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The node.
    pub node: usize,
    /// Its position, in m.
    pub at: [f64; 2],
    /// First instant with a reaction, in s.
    pub begin: f64,
    /// Last instant with a reaction, in s.
    pub end: f64,
    /// Sum of reaction times step, upward, in N s.
    pub impulse: f64,
}

/// Numbers in a contact: what ranks exchange.
pub(super) const NUMBERS: usize = 6;

impl Contact {
    pub(super) fn from_numbers(of: &[f64]) -> Contact {
        Contact { node: of[0] as usize, at: [of[1], of[2]], begin: of[3], end: of[4], impulse: of[5] }
    }
}

/// The contacts of this process's nodes, as they come and go.
#[derive(Default)]
pub(super) struct Contacts {
    /// Bounds in contact.
    open: Vec<usize>,
    /// By bound: begin, end, impulse of its contact, if it is open.
    state: Vec<Option<[f64; 3]>>,
    /// Contacts that ended and were not taken yet.
    ended: Vec<f64>,
}

impl Contacts {
    /// Takes note of a step's reactions. A node that lets go for one step only stays in contact.
    pub fn note(&mut self, sites: &[Site], time: f64, step: f64, reaction: &[f64]) {
        self.state.resize(reaction.len(), None);
        for (bound, &r) in reaction.iter().enumerate().filter(|(_, r)| **r != 0.0) {
            if self.state[bound].is_none() {
                self.open.push(bound);
            }
            let [_, end, impulse] = self.state[bound].get_or_insert([time, time, 0.0]);
            *end = time;
            *impulse += r * step;
        }
        self.close(sites, time - 1.5 * step);
    }

    /// Ends the contacts that were last seen before an instant.
    pub fn close(&mut self, sites: &[Site], before: f64) {
        let Contacts { open, state, ended } = self;
        open.retain(|&bound| match state[bound] {
            Some([begin, end, impulse]) if end < before => {
                let Site { node, at: [x, y], .. } = sites[bound];
                ended.extend([node as f64, x, y, begin, end, impulse]);
                state[bound] = None;
                false
            }
            _ => true,
        });
    }

    /// Shows an archive the contacts of all bounds.
    pub fn archive(&mut self, bounds: usize, archive: &mut Archive) -> Result<()> {
        // The place of each among those open, or -1, then its state.
        let mut all = vec![[-1.0; 4]; bounds];
        for (place, &bound) in self.open.iter().enumerate() {
            if let Some([begin, end, impulse]) = self.state[bound] {
                all[bound] = [place as f64, begin, end, impulse];
            }
        }
        archive.items(Over::Bounds, &mut all, |&of| of, |of| of)?;
        archive.list(&mut self.ended)?;
        if !archive.saves() {
            let is_open = |&bound: &usize| all[bound][0] >= 0.0;
            self.open = (0..bounds).filter(is_open).collect();
            self.open.sort_by(|&a, &b| all[a][0].total_cmp(&all[b][0]));
            let contact =
                |[place, begin, end, impulse]: [f64; 4]| (place >= 0.0).then_some([begin, end, impulse]);
            self.state = all.into_iter().map(contact).collect();
        }
        Ok(())
    }

    /// What ended since the last call, in groups of [`NUMBERS`].
    pub fn take(&mut self) -> Vec<f64> {
        std::mem::take(&mut self.ended)
    }
}
