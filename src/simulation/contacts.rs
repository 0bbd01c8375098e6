//! When each node touches an obstacle, and how hard.

use super::Site;
use crate::archive::{Archive, Over};
use crate::error::Result;
use crate::scheme::{Event, Scheme};

/// A node's contact with an obstacle, from its first to its last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// The node.
    pub node: usize,
    /// Its position, in m.
    pub at: [f64; 2],
    /// First instant with a reaction in the history, in s; that of the event, from a scheme that follows events.
    pub begin: f64,
    /// Last instant with a reaction, or event, in s.
    pub end: f64,
    /// Impulse of the obstacle, upward, in N s: the sum of [`Scheme::impulses`].
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
    /// Takes note of a scheme's step, in which there were these events. A node that lets go for one step only stays in contact.
    pub fn note(&mut self, sites: &[Site], step: f64, scheme: &dyn Scheme, events: &[Event]) {
        let (time, reactions) = (scheme.time(), scheme.reaction());
        self.state.resize(reactions.len(), None);
        for event in events {
            self.extend(event.bound, event.time);
        }
        for (bound, (&r, &impulse)) in reactions.iter().zip(scheme.impulses()).enumerate() {
            if r != 0.0 || impulse != 0.0 && self.state[bound].is_none() {
                self.extend(bound, time);
            }
            if let Some([.., sum]) = &mut self.state[bound] {
                *sum += impulse;
            }
        }
        self.close(sites, time - 1.5 * step);
    }

    /// Extends the contact of a bound to an instant, where it begins if it is not open.
    fn extend(&mut self, bound: usize, time: f64) {
        if self.state[bound].is_none() {
            self.open.push(bound);
        }
        let [_, end, _] = self.state[bound].get_or_insert([time, time, 0.0]);
        *end = time;
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
