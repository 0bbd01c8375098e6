//! Contacts of single nodes with obstacles: their intervals and impulses.

use super::DeflectionDof;
use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::scheme::{Event, Solution};

/// Contact of a node with an obstacle, from its first to its last step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Index of the node.
    pub node: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// First instant with a reaction in the history, in s; for an event-driven scheme the time of
    /// the event.
    pub begin: f64,
    /// Last instant with a reaction, or time of the event, in s.
    pub end: f64,
    /// Impulse of the obstacle, the sum of [`Solution::impulses`], in N s, positive upwards.
    pub impulse: f64,
}

/// Contact of all nodes at a step.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ContactTotal {
    /// Number of nodes in contact.
    pub nodes: usize,
    /// Sum of the reactions, in N.
    pub force: f64,
    /// Largest violation of a bound of this process, in m.
    pub penetration: f64,
}

/// Number of values per contact in checkpoints and in the exchange between ranks.
const NUMBERS: usize = 6;

impl Contact {
    pub(super) fn from_numbers([node, x, y, begin, end, impulse]: [f64; NUMBERS]) -> Contact {
        Contact { node: node as usize, at: [x, y], begin, end, impulse }
    }
}

/// Recorder of the contacts of this process's nodes.
#[derive(Default)]
pub(super) struct ContactRecorder {
    /// Bounds in contact.
    open: Vec<usize>,
    /// Begin (s), end (s) and impulse (N s) of the contact that is open, one entry per bound.
    state: Vec<Option<[f64; 3]>>,
    /// Contacts that ended since the last call of `take`.
    ended: Vec<[f64; NUMBERS]>,
}

impl ContactRecorder {
    /// Records a step of a scheme and its events, given whether nothing touches. A node without
    /// reaction for a single step remains in contact.
    pub fn record(
        &mut self,
        sites: &[DeflectionDof],
        step: f64,
        scheme: &dyn Solution,
        events: &[Event],
        is_free: bool,
    ) {
        let (time, reactions) = (scheme.time(), scheme.reaction());
        self.state.resize(reactions.len(), None);
        for event in events {
            self.extend(event.bound, event.time);
        }
        if !is_free {
            let impulses = scheme.impulses();
            scheme.record().candidates().for_each(|bound| {
                let (r, impulse) = (reactions[bound], impulses[bound]);
                if r != 0.0 || impulse != 0.0 && self.state[bound].is_none() {
                    self.extend(bound, time);
                }
                if let Some([.., sum]) = &mut self.state[bound] {
                    *sum += impulse;
                }
            });
        }
        self.close(sites, time - 1.5 * step);
    }

    /// Extends the contact of a bound to an instant (s), or begins one there.
    fn extend(&mut self, bound: usize, time: f64) {
        if self.state[bound].is_none() {
            self.open.push(bound);
        }
        let [_, end, _] = self.state[bound].get_or_insert([time, time, 0.0]);
        *end = time;
    }

    /// Ends the contacts whose last reaction was before an instant (s).
    pub fn close(&mut self, sites: &[DeflectionDof], before: f64) {
        let ContactRecorder { open, state, ended } = self;
        open.retain(|&bound| match state[bound] {
            Some([begin, end, impulse]) if end < before => {
                let DeflectionDof { node, at: [x, y], .. } = sites[bound];
                ended.push([node as f64, x, y, begin, end, impulse]);
                state[bound] = None;
                false
            }
            _ => true,
        });
    }

    /// Saves or restores the contacts of all bounds.
    pub fn archive(&mut self, bounds: usize, archive: &mut Archive) -> Result<()> {
        // Each entry is the position among the open contacts, or -1, followed by the state.
        let mut rows = vec![[-1.0; 4]; bounds];
        for (place, &bound) in self.open.iter().enumerate() {
            if let Some([begin, end, impulse]) = self.state[bound] {
                rows[bound] = [place as f64, begin, end, impulse];
            }
        }
        archive.items(VectorKind::Bounds, &mut rows, |&row| row, |row| row)?;
        let mut ended = self.ended.as_flattened().to_vec();
        archive.list(&mut ended)?;
        if !archive.saves() {
            self.ended = ended.as_chunks().0.to_vec();
            let is_open = |&bound: &usize| rows[bound][0] >= 0.0;
            self.open = (0..bounds).filter(is_open).collect();
            self.open.sort_by(|&a, &b| rows[a][0].total_cmp(&rows[b][0]));
            let contact =
                |[place, begin, end, impulse]: [f64; 4]| (place >= 0.0).then_some([begin, end, impulse]);
            self.state = rows.into_iter().map(contact).collect();
        }
        Ok(())
    }

    /// Returns the numbers of the contacts that ended since the last call.
    pub fn take(&mut self) -> Vec<[f64; NUMBERS]> {
        std::mem::take(&mut self.ended)
    }
}
