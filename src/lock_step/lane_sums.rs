//! Sums over the coordinates of systems in lock step, each in a lane of the processor's registers.

use super::lane_contacts::ZERO;
use crate::kernels::Lanes;

/// Number of rows whose sums the registers hold at once. Sums side by side do not wait for each
/// other.
pub(super) const ROWS: usize = 3;

/// Returns the sum of coordinates with weights, the first ones common to all systems.
#[inline(always)]
pub(super) fn along(shared: &[f64], varied: &[Lanes], z: &[Lanes]) -> Lanes {
    let [sum] = several_along([shared], [varied], z);
    sum
}

/// Returns the sum of forces times two increments of their coordinates.
#[inline(always)]
pub(super) fn work_along(force: &[Lanes], d: &[Lanes], d_next: &[Lanes]) -> Lanes {
    let mut moved = ZERO;
    for (force, (d, next)) in force.iter().zip(d.iter().zip(d_next)) {
        moved += *force * (*d + *next);
    }
    moved
}

/// Sets the sums of coordinates with several rows of weights.
#[inline(always)]
pub(super) fn all_along(shared: &[Vec<f64>], varied: &[Vec<Lanes>], z: &[Lanes], sums: &mut [Lanes]) {
    let rows = shared.chunks(ROWS).zip(varied.chunks(ROWS)).zip(sums.chunks_mut(ROWS));
    for ((shared, varied), sums) in rows {
        match (shared, varied) {
            ([a, b, c], [of_a, of_b, of_c]) => {
                sums.copy_from_slice(&several_along([a, b, c], [of_a, of_b, of_c], z));
            }
            ([a, b], [of_a, of_b]) => sums.copy_from_slice(&several_along([a, b], [of_a, of_b], z)),
            _ => sums[0] = along(&shared[0], &varied[0], z),
        }
    }
}

/// Returns the sums of coordinates with a few rows of weights.
#[inline(always)]
fn several_along<const N: usize>(shared: [&[f64]; N], varied: [&[Lanes]; N], z: &[Lanes]) -> [Lanes; N] {
    let mut sums = [ZERO; N];
    let (first, rest) = z.split_at(shared[0].len());
    let (shared, varied) = (shared.map(|row| &row[..first.len()]), varied.map(|row| &row[..rest.len()]));
    for (j, z) in first.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&shared) {
            *sum += row[j] * *z;
        }
    }
    for (j, z) in rest.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&varied) {
            *sum += row[j] * *z;
        }
    }
    sums
}
