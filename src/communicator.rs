//! Collective operations, with the verbs of MPI.
//!
//! A call is *collective* where its documentation says so: all ranks make it, in the same order.
//! [`SelfComm`] is the communicator of a single process. That of MPI's world is
//! `petsc::WorldComm` (feature `petsc`).
//!
//! ```
//! use rebond::communicator::{Communicator, SelfComm};
//!
//! let (dofs, offset) = SelfComm.all_gather_with_offset(&[0.5, 1.5]);
//! assert_eq!((dofs, offset), (vec![0.5, 1.5], 0));
//! assert_eq!(SelfComm.all_reduce_sum([1.0, 2.0]), [1.0, 2.0]);
//! assert!(!SelfComm.all_reduce_any(false));
//! ```

use crate::error::{Error, Result};

mod sealed {
    pub trait Sealed {}
}

/// Plain data, which ranks exchange as bytes: numbers, booleans, and arrays and tuples of them.
pub trait Plain: Copy + 'static + sealed::Sealed {
    /// Number of bytes of a value.
    const BYTES: usize;

    /// Appends the value to `bytes`.
    fn write(self, bytes: &mut Vec<u8>);

    /// Returns the value in the first [`Plain::BYTES`] bytes.
    fn read(bytes: &[u8]) -> Self;
}

/// Plain data with a sum.
pub trait Summand: Plain {
    /// Returns the sum of two values, entry by entry for arrays.
    fn plus(self, other: Self) -> Self;
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl sealed::Sealed for $number {}

        impl Plain for $number {
            const BYTES: usize = size_of::<$number>();

            fn write(self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }

            fn read(bytes: &[u8]) -> Self {
                Self::from_le_bytes(std::array::from_fn(|i| bytes[i]))
            }
        }

        impl Summand for $number {
            fn plus(self, other: Self) -> Self {
                self + other
            }
        }
    )*};
}

numbers!(f64, u64, u32, u8, usize);

impl sealed::Sealed for bool {}

impl Plain for bool {
    const BYTES: usize = 1;

    fn write(self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(self));
    }

    fn read(bytes: &[u8]) -> Self {
        bytes[0] != 0
    }
}

impl<T: Plain, const N: usize> sealed::Sealed for [T; N] {}

impl<T: Plain, const N: usize> Plain for [T; N] {
    const BYTES: usize = N * T::BYTES;

    fn write(self, bytes: &mut Vec<u8>) {
        self.into_iter().for_each(|entry| entry.write(bytes));
    }

    fn read(bytes: &[u8]) -> Self {
        std::array::from_fn(|i| T::read(&bytes[i * T::BYTES..]))
    }
}

impl<T: Summand, const N: usize> Summand for [T; N] {
    fn plus(self, other: Self) -> Self {
        std::array::from_fn(|i| self[i].plus(other[i]))
    }
}

/// Reads a value and advances to the bytes behind it.
fn take<T: Plain>(bytes: &mut &[u8]) -> T {
    let (head, rest) = bytes.split_at(T::BYTES);
    *bytes = rest;
    T::read(head)
}

macro_rules! tuples {
    ($($name:ident $index:tt),*) => {
        impl<$($name: Plain),*> sealed::Sealed for ($($name,)*) {}

        impl<$($name: Plain),*> Plain for ($($name,)*) {
            const BYTES: usize = 0 $(+ $name::BYTES)*;

            fn write(self, bytes: &mut Vec<u8>) {
                $(self.$index.write(bytes);)*
            }

            fn read(mut bytes: &[u8]) -> Self {
                ($(take::<$name>(&mut bytes),)*)
            }
        }
    };
}

tuples!(A 0, B 1);
tuples!(A 0, B 1, C 2);
tuples!(A 0, B 1, C 2, D 3);

/// Returns the bytes of some values.
pub fn to_bytes<T: Plain>(values: &[T]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(T::BYTES * values.len());
    values.iter().for_each(|value| value.write(&mut bytes));
    bytes
}

/// Returns the values that [`to_bytes`] has written.
pub fn from_bytes<T: Plain>(bytes: &[u8]) -> Vec<T> {
    bytes.chunks_exact(T::BYTES.max(1)).map(T::read).collect()
}

/// Group of processes, its *ranks*, that compute together; see the [module page](self).
///
/// Errors of MPI end the program, so that only [`Communicator::all_ok`] returns a [`Result`].
pub trait Communicator: Clone + 'static {
    /// Returns the number of this rank, from 0.
    fn rank(&self) -> usize;

    /// Returns the number of ranks.
    fn size(&self) -> usize;

    /// Waits until all ranks arrive. Collective.
    fn barrier(&self);

    /// Returns one value per rank, in rank order, the same on every rank. Collective.
    fn all_gather_one<T: Plain>(&self, value: T) -> Vec<T>;

    /// Returns the values of all ranks in rank order, the same on every rank, and the index of this
    /// rank's first value. Ranks may have different numbers of values. Collective.
    fn all_gather_with_offset<T: Plain>(&self, values: &[T]) -> (Vec<T>, usize);

    /// Returns the values of each rank, in rank order, on rank 0, and nothing on the other ranks.
    /// Collective.
    fn gather<T: Plain>(&self, values: &[T]) -> Vec<Vec<T>>;

    /// Overwrites the values on all ranks with those of rank 0, because processors may round
    /// differently. All slices have the same length. Collective.
    fn broadcast<T: Plain>(&self, values: &mut [T]);

    /// Returns the values of all ranks in rank order, the same on every rank. Ranks may have
    /// different numbers of values. Collective.
    fn all_gather<T: Plain>(&self, values: &[T]) -> Vec<T> {
        self.all_gather_with_offset(values).0
    }

    /// Combines one value per rank by a function, in rank order. Collective.
    fn all_reduce<T: Plain>(&self, value: T, combine: impl FnMut(T, T) -> T) -> T {
        self.all_gather_one(value).into_iter().reduce(combine).unwrap_or(value)
    }

    /// Returns the sum over all ranks, entry by entry for an array. Collective.
    ///
    /// The values are gathered and added in rank order. The sum is therefore reproducible, and the
    /// same on every rank, whichever order the reductions of the MPI library have.
    fn all_reduce_sum<T: Summand>(&self, value: T) -> T {
        self.all_reduce(value, T::plus)
    }

    /// Returns the entrywise sums over all ranks of slices of equal length, each in rank order as
    /// in [`Communicator::all_reduce_sum`]. Collective.
    fn all_reduce_sum_slice<T: Summand>(&self, values: &[T]) -> Vec<T> {
        let gathered = self.all_gather(values);
        let mut ranks = gathered.chunks_exact(values.len().max(1));
        let mut sums = ranks.next().map_or(Vec::new(), <[T]>::to_vec);
        for rank in ranks {
            sums.iter_mut().zip(rank).for_each(|(sum, value)| *sum = sum.plus(*value));
        }
        sums
    }

    /// Returns the largest value of all ranks. Collective.
    ///
    /// A NaN is not lost: [`SelfComm`] returns it, the communicator of MPI returns infinity.
    fn all_reduce_max(&self, value: f64) -> f64 {
        self.all_reduce_max_each([value])[0]
    }

    /// Returns the largest value of all ranks at each place; see [`Communicator::all_reduce_max`].
    /// Collective.
    fn all_reduce_max_each<const N: usize>(&self, values: [f64; N]) -> [f64; N];

    /// Returns whether the condition holds on some rank. Collective.
    fn all_reduce_any(&self, holds: bool) -> bool {
        self.all_gather_one(holds).contains(&true)
    }

    /// Returns whether the condition holds on every rank, so that all ranks take one decision.
    /// Collective.
    fn all_reduce_all(&self, holds: bool) -> bool {
        !self.all_reduce_any(!holds)
    }

    /// Turns an error on one rank into an error on all ranks, so that none goes on alone and
    /// deadlocks. Without an error, each rank gets its own result. Collective.
    ///
    /// # Errors
    /// Returns the error of the lowest rank that has one: as it is on that rank, as
    /// [`Error::Elsewhere`] on the others.
    fn all_ok<T>(&self, result: Result<T>) -> Result<T> {
        if self.all_reduce_all(result.is_ok()) {
            return result;
        }
        let codes = self.all_gather_one(result.as_ref().err().map_or(0, Error::exit_code));
        let first = codes.iter().position(|&code| code != 0).unwrap_or(0);
        let error = result.err().filter(|_| self.rank() == first);
        let words = self.all_gather(error.as_ref().map(Error::to_string).unwrap_or_default().as_bytes());
        let words = String::from_utf8_lossy(&words).into_owned();
        Err(error.unwrap_or(Error::Elsewhere { words, code: codes[first] }))
    }
}

/// Communicator of a single process.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelfComm;

impl Communicator for SelfComm {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn barrier(&self) {}

    fn all_gather_one<T: Plain>(&self, value: T) -> Vec<T> {
        vec![value]
    }

    fn all_gather_with_offset<T: Plain>(&self, values: &[T]) -> (Vec<T>, usize) {
        (values.to_vec(), 0)
    }

    fn gather<T: Plain>(&self, values: &[T]) -> Vec<Vec<T>> {
        vec![values.to_vec()]
    }

    fn broadcast<T: Plain>(&self, _: &mut [T]) {}

    fn all_reduce<T: Plain>(&self, value: T, _: impl FnMut(T, T) -> T) -> T {
        value
    }

    fn all_reduce_max_each<const N: usize>(&self, values: [f64; N]) -> [f64; N] {
        values
    }

    fn all_reduce_any(&self, holds: bool) -> bool {
        holds
    }

    fn all_ok<T>(&self, result: Result<T>) -> Result<T> {
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_data_survives_as_bytes() {
        let rows = [([-0.0, f64::MAX], true, 7_usize), ([f64::MIN_POSITIVE, 0.1], false, usize::MAX)];
        let bytes = to_bytes(&rows);
        assert_eq!(bytes.len(), 2 * (2 * 8 + 1 + 8));
        let back: Vec<([f64; 2], bool, usize)> = from_bytes(&bytes);
        assert_eq!(back, rows);
        assert!(back[0].0[0].is_sign_negative());
        assert!(from_bytes::<[f64; 0]>(&[]).is_empty());
    }
}
