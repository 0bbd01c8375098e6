//! Communicator of all ranks of MPI, or of a group of them.

use super::ending;
use crate::communicator::{Communicator, Plain, from_bytes, to_bytes};
use crate::error::{Error, Result};
use mpi::collective::SystemOperation;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::request::multiple_scope;
use mpi::topology::{Color, SimpleCommunicator};
use mpi::traits::{Communicator as _, CommunicatorCollectives, Destination, Root, Source};
use serde::{Serialize, de::DeserializeOwned};
use std::cell::Cell;
use std::ffi::c_int;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// Communicator of all ranks of MPI, or of a group of them. MPI ends when the last one is dropped.
#[derive(Clone)]
pub struct WorldComm(Rc<World>);

struct World {
    /// Communicator of the `mpi` crate.
    all: SimpleCommunicator,
    /// Environment of MPI, kept for its end.
    universe: Rc<Universe>,
    /// Number of collective operations so far.
    collectives: Cell<u64>,
}

impl World {
    fn new(ranks: SimpleCommunicator, universe: Rc<Universe>) -> World {
        World { all: ranks, universe, collectives: Cell::new(0) }
    }
}

impl WorldComm {
    /// Takes over MPI, which has been started.
    pub(super) fn new(universe: Universe) -> WorldComm {
        WorldComm(Rc::new(World::new(universe.world(), universe.into())))
    }

    /// Divides the ranks into groups of `ranks` neighbours. Returns the communicator of the own
    /// group. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the number does not divide that of all ranks.
    pub(super) fn group(&self, ranks: usize) -> Result<WorldComm> {
        let size = self.size();
        if ranks == 0 || !size.is_multiple_of(ranks) {
            return Err(Error::Usage(format!(
                "groups of {ranks} ranks do not divide the {size} ranks that mpirun started"
            )));
        }
        let color = Color::with_value((self.rank() / ranks) as i32);
        let none = || Error::Petsc("MPI made no communicator for a group of ranks".into());
        let ranks = self.world().split_by_color(color).ok_or_else(none)?;
        Ok(WorldComm(Rc::new(World::new(ranks, self.0.universe.clone()))))
    }

    /// Returns the communicator of the `mpi` crate.
    pub(super) fn world(&self) -> &SimpleCommunicator {
        &self.0.all
    }

    /// Returns the communicator of the `mpi` crate for a collective operation, which is counted.
    fn together(&self) -> &SimpleCommunicator {
        self.0.collectives.set(self.0.collectives.get() + 1);
        &self.0.all
    }

    /// Returns the number of collective operations so far, apart from those inside PETSc.
    pub fn collectives(&self) -> u64 {
        self.0.collectives.get()
    }

    /// Returns the sum over all ranks, in an order that the MPI library chooses. Collective.
    ///
    /// This single reduction costs less than [`Communicator::all_reduce_sum`]. Its last digit may
    /// depend on the library and on the number of ranks; all ranks get the same.
    pub fn all_reduce_sum_unordered(&self, value: f64) -> f64 {
        let mut sum = 0.0;
        self.together().all_reduce_into(&value, &mut sum, SystemOperation::sum());
        sum
    }

    /// Replaces a slice by its entrywise sum over all ranks, in an order that the MPI library
    /// chooses; all lengths are equal. Collective.
    pub fn all_reduce_sum_slice_unordered(&self, values: &mut [f64]) {
        let addends = values.to_vec();
        self.together().all_reduce_into(&addends[..], values, SystemOperation::sum());
    }

    /// Sends a message to each of some ranks, and receives one of a known length from each, which
    /// replaces the values in its place. Collective among them.
    pub fn exchange(
        &self,
        ranks: impl Iterator<Item = usize> + Clone,
        sent: &[Vec<f64>],
        received: &mut [Vec<f64>],
    ) {
        multiple_scope(2 * sent.len(), |scope, requests| {
            for (rank, message) in ranks.clone().zip(received) {
                let process = self.world().process_at_rank(rank as c_int);
                requests.add(process.immediate_receive_into(scope, &mut message[..]));
            }
            for (rank, message) in ranks.zip(sent) {
                let process = self.world().process_at_rank(rank as c_int);
                requests.add(process.immediate_send(scope, &message[..]));
            }
            requests.wait_all(&mut Vec::new());
        });
    }

    /// Broadcasts a value of rank 0 to every rank, as JSON. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where JSON cannot express the value.
    pub fn broadcast_value<T: Serialize + DeserializeOwned>(&self, value: &T) -> Result<T> {
        let unfit = |error| Error::Petsc(format!("a value cannot be sent to other ranks: {error}"));
        let bytes = if self.rank() == 0 { serde_json::to_vec(value).map_err(unfit) } else { Ok(Vec::new()) };
        serde_json::from_slice(&self.all_gather(&self.all_ok(bytes)?)).map_err(unfit)
    }

    /// Waits for all ranks, at most for `within` if given, and returns whether they arrived.
    /// Collective.
    ///
    /// A rank that does not arrive waits inside a call that the others have left, so that only
    /// [`Context::fail`](super::Context::fail) can follow.
    pub fn arrive(&self, within: Option<Duration>) -> bool {
        let start = Instant::now();
        let mut request = self.world().immediate_barrier();
        loop {
            match request.test() {
                Ok(_) => return true,
                Err(waiting) if within.is_none_or(|within| start.elapsed() < within) => request = waiting,
                Err(waiting) => {
                    std::mem::forget(waiting);
                    return false;
                }
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Returns the number of bytes of each rank. More bytes of all ranks than MPI can count end the
    /// program. Collective.
    fn counts(&self, bytes: &[u8]) -> Vec<c_int> {
        let counts = self.all_gather_one(bytes.len());
        in_c_integers(&counts).unwrap_or_else(|error| ending::fail(self.world(), &error))
    }
}

impl std::fmt::Debug for WorldComm {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("WorldComm")
            .field("rank", &self.rank())
            .field("size", &self.size())
            .finish_non_exhaustive()
    }
}

impl Communicator for WorldComm {
    fn rank(&self) -> usize {
        self.world().rank() as usize
    }

    fn size(&self) -> usize {
        self.world().size() as usize
    }

    fn barrier(&self) {
        self.together().barrier();
    }

    fn all_gather_one<T: Plain>(&self, value: T) -> Vec<T> {
        let mut bytes = vec![0_u8; T::BYTES * self.size()];
        self.together().all_gather_into(&to_bytes(&[value])[..], &mut bytes[..]);
        from_bytes(&bytes)
    }

    fn all_gather_with_offset<T: Plain>(&self, values: &[T]) -> (Vec<T>, usize) {
        if self.size() == 1 {
            return (values.to_vec(), 0);
        }
        let values = sent(values);
        let counts = self.counts(&values);
        let starts = starts(&counts);
        let offset = starts[self.rank()] as usize / T::BYTES.max(1);
        let mut bytes = room(&counts);
        self.together()
            .all_gather_varcount_into(&values[..], &mut PartitionMut::new(&mut bytes[..], counts, starts));
        (from_bytes(&bytes), offset)
    }

    fn gather<T: Plain>(&self, values: &[T]) -> Vec<Vec<T>> {
        let values = sent(values);
        let counts = self.counts(&values);
        let first = self.together().process_at_rank(0);
        if self.rank() > 0 {
            first.gather_varcount_into(&values[..]);
            return Vec::new();
        }
        let starts = starts(&counts);
        let mut bytes = room(&counts);
        first.gather_varcount_into_root(
            &values[..],
            &mut PartitionMut::new(&mut bytes[..], &counts[..], &starts[..]),
        );
        let part = |(count, start): (c_int, c_int)| from_bytes(&bytes[start as usize..][..count as usize]);
        counts.into_iter().zip(starts).map(part).collect()
    }

    fn broadcast<T: Plain>(&self, values: &mut [T]) {
        let mut bytes = sent(values);
        self.together().process_at_rank(0).broadcast_into(&mut bytes[..]);
        values.iter_mut().zip(from_bytes(&bytes)).for_each(|(value, first)| *value = first);
    }

    fn all_reduce_max_each<const N: usize>(&self, values: [f64; N]) -> [f64; N] {
        // MPI's maximum may lose a NaN.
        let values = values.map(|value| if value.is_nan() { f64::INFINITY } else { value });
        let mut largest = values;
        self.together().all_reduce_into(&values[..], &mut largest[..], SystemOperation::max());
        largest
    }

    fn all_reduce_any(&self, holds: bool) -> bool {
        let mut any = 0_u8;
        self.together().all_reduce_into(&u8::from(holds), &mut any, SystemOperation::max());
        any != 0
    }
}

/// Converts the numbers of bytes of all ranks to the integers in which MPI counts.
///
/// # Errors
/// Returns [`Error::Memory`] where their sum is larger than such an integer.
fn in_c_integers(counts: &[usize]) -> Result<Vec<c_int>> {
    let total = counts.iter().map(|&count| count as u64).sum::<u64>();
    if total > c_int::MAX as u64 {
        return Err(Error::Memory(format!(
            "the ranks exchange {total} bytes at once, and MPI takes at most {}; take a coarser mesh",
            c_int::MAX
        )));
    }
    Ok(counts.iter().map(|&count| count as c_int).collect())
}

/// Returns the bytes of values for other ranks, with room, as [`room`] tells.
fn sent<T: Plain>(values: &[T]) -> Vec<u8> {
    let mut bytes = to_bytes(values);
    bytes.reserve(1);
    bytes
}

/// Returns room for the bytes of all ranks. The pointer of an empty vector without room is that by
/// which MPI knows operations in place.
fn room(counts: &[c_int]) -> Vec<u8> {
    let size = counts.iter().sum::<c_int>() as usize;
    let mut room = Vec::with_capacity(size.max(1));
    room.resize(size, 0);
    room
}

/// Returns the offsets of contiguous parts with these lengths.
fn starts(counts: &[c_int]) -> Vec<c_int> {
    counts
        .iter()
        .scan(0, |sum, &count| {
            let start = *sum;
            *sum += count;
            Some(start)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_bytes_than_mpi_can_count_are_refused() {
        let half = 1_usize << 30;
        assert_eq!(in_c_integers(&[half, half - 1]).unwrap(), [1 << 30, (1 << 30) - 1]);
        for counts in [&[half, half][..], &[3 * half, 2], &[usize::MAX >> 1, 1]] {
            assert_eq!(
                in_c_integers(counts).unwrap_err().exit_code(),
                Error::Memory(String::new()).exit_code()
            );
        }
    }
}
