//! Exchange of values at the dofs that several ranks share, between neighbours only.

use crate::communicator::Communicator;
use crate::petsc::{Index, WorldComm};
use std::cell::RefCell;

/// Dofs of this rank's cells, their owners, and the neighbours with which they are shared.
///
/// A *local* vector has an entry for each dof of a rank's cells, and zeros at constrained dofs.
/// Each free dof has one rank as its owner, and each rank owns a range of the free dofs.
pub(super) struct DofExchange {
    comm: WorldComm,
    /// Local dof of each dof that this rank owns.
    pub owned: Vec<usize>,
    neighbours: Vec<Neighbour>,
    messages: RefCell<Messages>,
}

/// Rank that shares dofs with this one. Both list them in the same order.
struct Neighbour {
    rank: usize,
    /// Places among the dofs that this rank owns.
    lent: Vec<usize>,
    /// Local dofs that the neighbour owns.
    borrowed: Vec<usize>,
}

/// Values to and from each neighbour.
#[derive(Default)]
struct Messages {
    sent: Vec<Vec<f64>>,
    received: Vec<Vec<f64>>,
}

impl DofExchange {
    /// Creates the exchange, given the position of each local dof among the dofs of all ranks
    /// (negative for a constrained one) and this rank's range of them. Collective.
    pub fn new(comm: &WorldComm, global: &[Index], first: usize, count: usize) -> DofExchange {
        let owned_place = |dof: usize| dof.checked_sub(first).filter(|place| *place < count);
        let firsts = comm.all_gather_one(first);
        let (mut owned, mut borrowed) = (vec![0; count], Vec::new());
        for (local, &dof) in global.iter().enumerate() {
            let Ok(dof) = usize::try_from(dof) else { continue };
            match owned_place(dof) {
                Some(place) => owned[place] = local,
                None => borrowed.push((local, dof)),
            }
        }
        let wanted: Vec<(usize, usize)> = borrowed.iter().map(|(_, dof)| (comm.rank(), *dof)).collect();
        let mut by_rank: Vec<Neighbour> =
            (0..comm.size()).map(|rank| Neighbour { rank, lent: Vec::new(), borrowed: Vec::new() }).collect();
        for (rank, dof) in comm.all_gather(&wanted) {
            by_rank[rank].lent.extend(owned_place(dof));
        }
        for (local, dof) in borrowed {
            // Ranks without dofs begin where the next one does.
            let owner = firsts.partition_point(|start| *start <= dof) - 1;
            by_rank[owner].borrowed.push(local);
        }
        by_rank.retain(|neighbour| !neighbour.lent.is_empty() || !neighbour.borrowed.is_empty());
        let empty = vec![Vec::new(); by_rank.len()];
        let messages = Messages { sent: empty.clone(), received: empty }.into();
        DofExchange { comm: comm.clone(), owned, neighbours: by_rank, messages }
    }

    /// Returns the local dofs that other ranks have too, ascending.
    pub fn shared(&self) -> Vec<usize> {
        let lent = self.neighbours.iter().flat_map(|neighbour| &neighbour.lent);
        let borrowed = self.neighbours.iter().flat_map(|neighbour| &neighbour.borrowed);
        let mut dofs: Vec<usize> = lent.map(|&place| self.owned[place]).chain(borrowed.copied()).collect();
        dofs.sort_unstable();
        dofs.dedup();
        dofs
    }

    /// Sets the free dofs of a local vector to the values of their owners. Collective among
    /// neighbours.
    pub fn spread(&self, values: &[f64], local: &mut [f64]) {
        self.owned.iter().zip(values).for_each(|(&dof, value)| local[dof] = *value);
        let messages = &mut *self.messages.borrow_mut();
        for (neighbour, sent) in self.neighbours.iter().zip(&mut messages.sent) {
            sent.clear();
            sent.extend(neighbour.lent.iter().map(|&place| values[place]));
        }
        self.send(messages, |neighbour| neighbour.borrowed.len());
        for (neighbour, received) in self.neighbours.iter().zip(&messages.received) {
            neighbour.borrowed.iter().zip(received).for_each(|(&dof, value)| local[dof] = *value);
        }
    }

    /// Adds up local vectors of all ranks at the dofs that this rank owns: its own values first,
    /// then its neighbours' values in the order of their ranks. Collective among neighbours.
    pub fn add_up<const N: usize>(&self, local: [&[f64]; N], sums: [&mut [f64]; N]) {
        let messages = &mut *self.messages.borrow_mut();
        for (neighbour, sent) in self.neighbours.iter().zip(&mut messages.sent) {
            sent.clear();
            local.iter().for_each(|local| sent.extend(neighbour.borrowed.iter().map(|&dof| local[dof])));
        }
        self.send(messages, |neighbour| N * neighbour.lent.len());
        for (number, (local, sums)) in local.into_iter().zip(sums).enumerate() {
            self.owned.iter().zip(&mut *sums).for_each(|(&dof, sum)| *sum = local[dof]);
            for (neighbour, received) in self.neighbours.iter().zip(&messages.received) {
                let received = &received[number * neighbour.lent.len()..];
                neighbour.lent.iter().zip(received).for_each(|(&place, value)| sums[place] += *value);
            }
        }
    }

    /// Sends the messages to all neighbours, and receives theirs, of the given lengths.
    fn send(&self, messages: &mut Messages, length: impl Fn(&Neighbour) -> usize) {
        for (neighbour, received) in self.neighbours.iter().zip(&mut messages.received) {
            received.resize(length(neighbour), 0.0);
        }
        let ranks = self.neighbours.iter().map(|neighbour| neighbour.rank);
        self.comm.exchange(ranks, &messages.sent, &mut messages.received);
    }
}
