//! Triangular solves for equal systems side by side: lane k of all vectors belongs to system k.

use super::Cholesky;
use super::supernodes::Supernode;
use crate::linalg::lane_values::{LANES, Lanes};
use pulp::{Simd, WithSimd};

impl Cholesky {
    /// Solves A x = b for all systems in place.
    pub(in crate::linalg) fn solve_lanes(&mut self, x: &mut [f64]) {
        let dofs = self.order.len();
        self.permute_lanes(x);
        self.sweep_lanes::<true>(dofs);
        self.sweep_lanes::<false>(dofs);
        self.unpermute_lanes(x);
    }

    /// Eliminates all dofs but the contact dofs, as [`Factor::forward_to_schur`] does.
    ///
    /// [`Factor::forward_to_schur`]: crate::linalg::Factor::forward_to_schur
    pub(in crate::linalg) fn forward_lanes(&mut self, b: &[f64], h: &mut [f64]) {
        self.permute_lanes(b);
        self.sweep_lanes::<true>(self.interior);
        for (h, x) in h.chunks_exact_mut(LANES).zip(&self.lanes[self.interior..]) {
            h.copy_from_slice(&x.0);
        }
    }

    /// Completes the solution of the last [`Cholesky::forward_lanes`].
    pub(in crate::linalg) fn backward_lanes(&mut self, values: &[f64], x: &mut [f64]) {
        for (x, values) in self.lanes[self.interior..].iter_mut().zip(values.chunks_exact(LANES)) {
            x.0.copy_from_slice(values);
        }
        self.sweep_lanes::<false>(self.interior);
        self.unpermute_lanes(x);
    }

    /// Solves with the Schur complement of the contact dofs for all systems, in place.
    pub(in crate::linalg) fn solve_schur_lanes(&self, h: &mut [f64]) {
        let size = h.len() / LANES;
        let less = |h: &mut [f64], i: usize, j: usize, entry: f64| {
            for lane in 0..LANES {
                h[LANES * i + lane] -= entry * h[LANES * j + lane];
            }
        };
        for j in 0..size {
            let column = self.tail.col(j);
            h[LANES * j..][..LANES].iter_mut().for_each(|h| *h /= column[j]);
            (j + 1..size).for_each(|i| less(h, i, j, column[i]));
        }
        for j in (0..size).rev() {
            let column = self.tail.col(j);
            (j + 1..size).for_each(|i| less(h, j, i, column[i]));
            h[LANES * j..][..LANES].iter_mut().for_each(|h| *h /= column[j]);
        }
    }

    fn permute_lanes(&mut self, b: &[f64]) {
        let tallest = self.work.len();
        self.lanes.resize(self.order.len(), Lanes::default());
        self.lanes_work.resize(tallest, Lanes::default());
        for (x, &dof) in self.lanes.iter_mut().zip(&self.order) {
            x.0.copy_from_slice(&b[LANES * dof as usize..][..LANES]);
        }
    }

    fn unpermute_lanes(&self, x: &mut [f64]) {
        for (value, &dof) in self.lanes.iter().zip(&self.order) {
            x[LANES * dof as usize..][..LANES].copy_from_slice(&value.0);
        }
    }

    fn sweep_lanes<const FORWARD: bool>(&mut self, limit: usize) {
        self.arch.dispatch(LaneSweep::<FORWARD> {
            supernodes: &self.supernodes,
            patterns: &self.patterns,
            values: &self.values,
            pivots: &self.pivots,
            limit,
            x: &mut self.lanes,
            work: &mut self.lanes_work,
        });
    }
}

/// Triangular solve with the columns before `limit`: forward with L, or backward with its
/// transpose.
struct LaneSweep<'a, const FORWARD: bool> {
    supernodes: &'a [Supernode],
    patterns: &'a [u32],
    values: &'a [f64],
    pivots: &'a [f64],
    limit: usize,
    x: &'a mut [Lanes],
    work: &'a mut [Lanes],
}

impl<const FORWARD: bool> WithSimd for LaneSweep<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (supernodes, limit) = (self.supernodes, self.limit);
        if FORWARD {
            for s in supernodes {
                if s.start < limit {
                    self.eliminate(simd, s);
                }
            }
        } else {
            for s in supernodes.iter().rev() {
                if s.start < limit {
                    self.substitute(simd, s);
                }
            }
        }
    }
}

impl<const FORWARD: bool> LaneSweep<'_, FORWARD> {
    /// Eliminates forward with the columns of one supernode. `work` holds the supernode's part of x
    /// and below it the updates to other rows of x.
    #[inline(always)]
    fn eliminate<S: Simd>(&mut self, simd: S, s: &Supernode) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&self.x[s.start..s.end]);
        work[width..].fill(Lanes::default());
        let mut j = 0;
        while j + 4 <= columns {
            let (head, rest) = work[j..].split_at_mut(4);
            for k in 0..4 {
                head[k] = pivots[j + k] * head[k];
                let known = head[k];
                let column = &values[(j + k) * height + j..];
                for i in k + 1..4 {
                    head[i] = head[i] - column[i] * known;
                }
            }
            subtract4(simd, four_below(values, j, height), head, rest);
            j += 4;
        }
        for j in j..columns {
            let (head, rest) = work[j..].split_at_mut(1);
            head[0] = pivots[j] * head[0];
            subtract1(simd, &values[j * height + j + 1..], head[0], rest);
        }
        self.x[s.start..s.end].copy_from_slice(&work[..width]);
        for (loss, &row) in work[width..].iter().zip(&self.patterns[s.pattern..]) {
            self.x[row as usize] += *loss;
        }
    }

    /// Substitutes backward with the columns of one supernode.
    #[inline(always)]
    fn substitute<S: Simd>(&mut self, simd: S, s: &Supernode) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&self.x[s.start..s.end]);
        for (value, &row) in work[width..].iter_mut().zip(&self.patterns[s.pattern..]) {
            *value = self.x[row as usize];
        }
        let whole = columns / 4 * 4;
        for j in (whole..columns).rev() {
            let (head, rest) = work[j..].split_at_mut(1);
            let known = dot1(simd, &values[j * height + j + 1..], rest);
            head[0] = pivots[j] * (head[0] - known);
        }
        for j in (0..whole).step_by(4).rev() {
            let (head, rest) = work[j..].split_at_mut(4);
            let known = dot4(simd, four_below(values, j, height), rest);
            for k in (0..4).rev() {
                let column = &values[(j + k) * height + j..];
                let mut value = head[k] - known[k];
                for i in k + 1..4 {
                    value = value - column[i] * head[i];
                }
                head[k] = pivots[j + k] * value;
            }
        }
        self.x[s.start..s.end].copy_from_slice(&work[..width]);
    }
}

/// Returns columns j to j + 3 of a panel below their triangle.
#[inline(always)]
fn four_below(values: &[f64], j: usize, height: usize) -> [&[f64]; 4] {
    let (from, to) = (j * height + j + 4, (j + 1) * height);
    [
        &values[from..to],
        &values[from + height..to + height],
        &values[from + 2 * height..to + 2 * height],
        &values[from + 3 * height..to + 3 * height],
    ]
}

/// Computes y -= a_0 x_0 + a_1 x_1 + a_2 x_2 + a_3 x_3, with one number of each column per row.
#[inline(always)]
fn subtract4<S: Simd>(simd: S, a: [&[f64]; 4], x: &[Lanes], y: &mut [Lanes]) {
    let count = y.len();
    let [a0, a1, a2, a3] = [&a[0][..count], &a[1][..count], &a[2][..count], &a[3][..count]];
    for part in 0..LANES / S::F64_LANES {
        let x0 = simd.neg_f64s(S::as_simd_f64s(&x[0].0).0[part]);
        let x1 = simd.neg_f64s(S::as_simd_f64s(&x[1].0).0[part]);
        let x2 = simd.neg_f64s(S::as_simd_f64s(&x[2].0).0[part]);
        let x3 = simd.neg_f64s(S::as_simd_f64s(&x[3].0).0[part]);
        for i in 0..count {
            let y = &mut S::as_mut_simd_f64s(&mut y[i].0).0[part];
            let first =
                simd.mul_add_f64s(simd.splat_f64s(a1[i]), x1, simd.mul_f64s(simd.splat_f64s(a0[i]), x0));
            let second = simd.mul_add_f64s(simd.splat_f64s(a2[i]), x2, *y);
            *y = simd.add_f64s(first, simd.mul_add_f64s(simd.splat_f64s(a3[i]), x3, second));
        }
    }
}

/// Computes y -= a x, with one number of the column a per row.
#[inline(always)]
fn subtract1<S: Simd>(simd: S, a: &[f64], x: Lanes, y: &mut [Lanes]) {
    for part in 0..LANES / S::F64_LANES {
        let x = simd.neg_f64s(S::as_simd_f64s(&x.0).0[part]);
        for (y, a) in y.iter_mut().zip(a) {
            let y = &mut S::as_mut_simd_f64s(&mut y.0).0[part];
            *y = simd.mul_add_f64s(simd.splat_f64s(*a), x, *y);
        }
    }
}

/// Returns the scalar products of four columns with y.
#[inline(always)]
fn dot4<S: Simd>(simd: S, a: [&[f64]; 4], y: &[Lanes]) -> [Lanes; 4] {
    let count = y.len();
    let [a0, a1, a2, a3] = [&a[0][..count], &a[1][..count], &a[2][..count], &a[3][..count]];
    let mut known = [Lanes::default(); 4];
    for part in 0..LANES / S::F64_LANES {
        let mut sums = [simd.splat_f64s(0.0); 4];
        for i in 0..count {
            let y = S::as_simd_f64s(&y[i].0).0[part];
            sums[0] = simd.mul_add_f64s(simd.splat_f64s(a0[i]), y, sums[0]);
            sums[1] = simd.mul_add_f64s(simd.splat_f64s(a1[i]), y, sums[1]);
            sums[2] = simd.mul_add_f64s(simd.splat_f64s(a2[i]), y, sums[2]);
            sums[3] = simd.mul_add_f64s(simd.splat_f64s(a3[i]), y, sums[3]);
        }
        for (known, sum) in known.iter_mut().zip(sums) {
            S::as_mut_simd_f64s(&mut known.0).0[part] = sum;
        }
    }
    known
}

/// Returns the scalar product of a column with y.
#[inline(always)]
fn dot1<S: Simd>(simd: S, a: &[f64], y: &[Lanes]) -> Lanes {
    let mut known = Lanes::default();
    for part in 0..LANES / S::F64_LANES {
        let mut sum = simd.splat_f64s(0.0);
        for (y, a) in y.iter().zip(a) {
            sum = simd.mul_add_f64s(simd.splat_f64s(*a), S::as_simd_f64s(&y.0).0[part], sum);
        }
        S::as_mut_simd_f64s(&mut known.0).0[part] = sum;
    }
    known
}
