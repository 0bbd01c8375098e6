//! Pseudo-random numbers, the same in every run and on every machine: vectors, distributions, and
//! the points of random sweeps.

mod correlation;
mod distribution;
mod normal;
mod points;

pub use correlation::Correlation;
pub use distribution::Distribution;
pub use points::{DrawnPoints, PointSet};

/// Generator of 64 random bits at a time (SplitMix64).
#[derive(Debug, Clone)]
pub struct SplitMix64(u64);

/// Increment of the state of [`SplitMix64`].
const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

impl SplitMix64 {
    /// Starts the generator from a state.
    pub fn new(state: u64) -> SplitMix64 {
        SplitMix64(state)
    }

    /// Returns the next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(INCREMENT);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns the next number, uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns the next number, uniform in [-1, 1).
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }
}

/// Returns a vector of pseudo-random numbers in [-1, 1). Vectors of different seeds are
/// independent, as the columns of a block must be.
pub(crate) fn random_vector(size: usize, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed.wrapping_mul(INCREMENT));
    (0..size).map(|_| random.signed()).collect()
}

/// Returns the multiples of the golden ratio modulo 1, in [-1/2, 1/2): a vector without any
/// symmetry, for a single start of an iteration.
pub(crate) fn golden_vector(size: usize) -> Vec<f64> {
    (1..=size).map(|i| (i as f64 * 0.618_033_988_749_895).fract() - 0.5).collect()
}

/// Returns a number between -1 and 1 that depends on its place.
#[cfg(test)]
pub(crate) fn number(place: usize) -> f64 {
    (1.0 + 12.9898 * place as f64).sin()
}
