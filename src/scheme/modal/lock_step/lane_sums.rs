//! Sums over the coordinates of systems in lock step, each in a lane of the processor's registers.

use super::lane_contacts::ZERO;
use crate::linalg::Lanes;

/// Number of rows whose sums the registers hold at once. Sums side by side do not wait for each
/// other.
const ROWS: usize = 3;

/// Equation of one coordinate.
#[derive(Clone, Copy)]
pub(super) struct Coordinate {
    /// Stiffness: the squared frequency of a mode, 1 without mass.
    pub stiffness: f64,
    /// Decay rate over the step.
    pub decay: f64,
    /// Inverse of the step matrix.
    pub inverse: f64,
}

/// Returns the sum of coordinates with weights, the first ones common to all systems.
#[inline(always)]
pub(super) fn along(shared: &[f64], own: &[Lanes], z: &[Lanes]) -> Lanes {
    let [sum] = several_along([shared], [own], z);
    sum
}

/// Adds to the unknowns of modes what reactions do to them, with the deflections per unit of the
/// modes where they act.
#[inline(always)]
pub(super) fn push_all(rows: &[Vec<f64>], reactions: &[Lanes], modes: &[Coordinate], x: &mut [Lanes]) {
    for (rows, reactions) in rows.chunks(ROWS).zip(reactions.chunks(ROWS)) {
        match rows {
            [a, b, c] => push([a, b, c], reactions, modes, x),
            [a, b] => push([a, b], reactions, modes, x),
            _ => push([&rows[0]], reactions, modes, x),
        }
    }
}

/// Adds to the unknowns of modes what a few reactions do to them.
#[inline(always)]
fn push<const N: usize>(rows: [&[f64]; N], reactions: &[Lanes], modes: &[Coordinate], x: &mut [Lanes]) {
    let rows = rows.map(|row| &row[..modes.len()]);
    let reactions: [Lanes; N] = std::array::from_fn(|i| reactions[i]);
    for (j, (x, of)) in x.iter_mut().zip(modes).enumerate() {
        let mut force = ZERO;
        for (row, r) in rows.iter().zip(&reactions) {
            force += row[j] * *r;
        }
        *x += of.inverse * force;
    }
}

/// Sets the sums of coordinates with several rows of weights.
#[inline(always)]
pub(super) fn all_along(shared: &[Vec<f64>], own: &[Vec<Lanes>], z: &[Lanes], sums: &mut [Lanes]) {
    let rows = shared.chunks_exact(ROWS).zip(own.chunks_exact(ROWS)).zip(sums.chunks_exact_mut(ROWS));
    for ((shared, own), sums) in rows {
        let shared: [&[f64]; ROWS] = std::array::from_fn(|i| &*shared[i]);
        let own: [&[Lanes]; ROWS] = std::array::from_fn(|i| &*own[i]);
        sums.copy_from_slice(&several_along(shared, own, z));
    }
    let whole = sums.len() - sums.len() % ROWS;
    for (sum, (shared, own)) in sums[whole..].iter_mut().zip(shared[whole..].iter().zip(&own[whole..])) {
        *sum = along(shared, own, z);
    }
}

/// Returns the sums of coordinates with a few rows of weights.
#[inline(always)]
fn several_along<const N: usize>(shared: [&[f64]; N], own: [&[Lanes]; N], z: &[Lanes]) -> [Lanes; N] {
    let mut sums = [ZERO; N];
    let (first, rest) = z.split_at(shared[0].len());
    let (shared, own) = (shared.map(|row| &row[..first.len()]), own.map(|row| &row[..rest.len()]));
    for (j, z) in first.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&shared) {
            *sum += row[j] * *z;
        }
    }
    for (j, z) in rest.iter().enumerate() {
        for (sum, row) in sums.iter_mut().zip(&own) {
            *sum += row[j] * *z;
        }
    }
    sums
}
