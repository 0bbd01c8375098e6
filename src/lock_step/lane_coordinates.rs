//! Coordinates of systems in lock step, each system in a lane of registers, and their equations.

use super::lane_contacts::ZERO;
use super::lane_sums::ROWS;
use crate::kernels::Lanes;

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

/// Some of the coordinates: their values at the instants n and n + 1, and the increments to n and
/// from it.
pub(super) struct LaneCoordinates<'l> {
    pub z: &'l [Lanes],
    pub d: &'l [Lanes],
    pub d_next: &'l mut [Lanes],
    pub z_next: &'l mut [Lanes],
}

impl LaneCoordinates<'_> {
    /// Moves on to the level n + 1 under the forces that the increments from n hold. Returns the
    /// sum of all unknowns of the step.
    #[inline(always)]
    pub fn advance(self, equations: &[Coordinate]) -> Lanes {
        let count = equations.len();
        let (z, d) = (&self.z[..count], &self.d[..count]);
        let (d_next, z_next) = (&mut self.d_next[..count], &mut self.z_next[..count]);
        let mut sum = ZERO;
        for (j, equation) in equations.iter().enumerate() {
            let x = equation.inverse * ((d_next[j] - equation.decay * d[j]) - equation.stiffness * z[j]);
            let increment = d[j] + x;
            d_next[j] = increment;
            z_next[j] = z[j] + increment;
            sum += x;
        }
        sum
    }

    /// Adds a part of what reactions do to the unknowns of modes, with the deflections per unit of
    /// the modes where they act.
    #[inline(always)]
    pub fn push_all(&mut self, modes: &[Coordinate], part: f64, rows: &[Vec<f64>], reactions: &[Lanes]) {
        for (rows, reactions) in rows.chunks(ROWS).zip(reactions.chunks(ROWS)) {
            match rows {
                [a, b, c] => self.push(modes, part, [a, b, c], reactions),
                [a, b] => self.push(modes, part, [a, b], reactions),
                _ => self.push(modes, part, [&rows[0]], reactions),
            }
        }
    }

    /// Adds a part of what a few reactions do to the unknowns of modes.
    #[inline(always)]
    fn push<const N: usize>(
        &mut self,
        modes: &[Coordinate],
        part: f64,
        rows: [&[f64]; N],
        reactions: &[Lanes],
    ) {
        let count = modes.len();
        let rows = rows.map(|row| &row[..count]);
        let reactions: [Lanes; N] = std::array::from_fn(|i| reactions[i]);
        let z = &self.z[..count];
        let (d_next, z_next) = (&mut self.d_next[..count], &mut self.z_next[..count]);
        for (j, equation) in modes.iter().enumerate() {
            let mut force = ZERO;
            for (row, r) in rows.iter().zip(&reactions) {
                force += row[j] * *r;
            }
            let increment = d_next[j] + (part * equation.inverse) * force;
            d_next[j] = increment;
            z_next[j] = z[j] + increment;
        }
    }

    /// Adds a part of what each reaction does to the unknown of a coordinate of its own, from the
    /// `first` one on.
    #[inline(always)]
    pub fn push_each(&mut self, first: usize, equations: &[Coordinate], part: f64, reactions: &[Lanes]) {
        for (i, (equation, r)) in equations.iter().zip(reactions).enumerate() {
            let j = first + i;
            self.d_next[j] += (part * equation.inverse) * *r;
            self.z_next[j] = self.z[j] + self.d_next[j];
        }
    }
}
