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

impl<'l> LaneCoordinates<'l> {
    /// Returns the first coordinates, of a number, and the others.
    #[inline(always)]
    pub fn split_at(self, count: usize) -> [LaneCoordinates<'l>; 2] {
        let (z, other_z) = self.z.split_at(count);
        let (d, other_d) = self.d.split_at(count);
        let (d_next, other_d_next) = self.d_next.split_at_mut(count);
        let (z_next, other_z_next) = self.z_next.split_at_mut(count);
        let others = LaneCoordinates { z: other_z, d: other_d, d_next: other_d_next, z_next: other_z_next };
        [LaneCoordinates { z, d, d_next, z_next }, others]
    }

    /// Moves on to the level n + 1 under a force times a factor, and under the forces that the
    /// increments from n hold if `ADDS`.
    ///
    /// Returns the sum of all unknowns of the step, and the work of the force at the factor 1 from
    /// n - 1 to n + 1.
    #[inline(always)]
    pub fn advance<const ADDS: bool>(
        self,
        equations: &[Coordinate],
        force: impl Fn(usize) -> Lanes,
        factor: Lanes,
    ) -> [Lanes; 2] {
        let count = equations.len();
        let (z, d) = (&self.z[..count], &self.d[..count]);
        let (d_next, z_next) = (&mut self.d_next[..count], &mut self.z_next[..count]);
        let (mut sum, mut work) = (ZERO, ZERO);
        for (j, of) in equations.iter().enumerate() {
            let force = force(j);
            let pushed = if ADDS { d_next[j] + force * factor } else { force * factor };
            let x = of.inverse * ((pushed - of.decay * d[j]) - of.stiffness * z[j]);
            let increment = d[j] + x;
            d_next[j] = increment;
            z_next[j] = z[j] + increment;
            sum += x;
            work += force * (d[j] + increment);
        }
        [sum, work]
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
        for (j, of) in modes.iter().enumerate() {
            let mut force = ZERO;
            for (row, r) in rows.iter().zip(&reactions) {
                force += row[j] * *r;
            }
            let increment = d_next[j] + (part * of.inverse) * force;
            d_next[j] = increment;
            z_next[j] = z[j] + increment;
        }
    }

    /// Adds a part of what each reaction does to the unknown of a coordinate of its own, the first
    /// ones of these.
    #[inline(always)]
    pub fn push_each(&mut self, equations: &[Coordinate], part: f64, reactions: &[Lanes]) {
        for (j, (of, r)) in equations.iter().zip(reactions).enumerate() {
            self.d_next[j] += (part * of.inverse) * *r;
            self.z_next[j] = self.z[j] + self.d_next[j];
        }
    }
}
