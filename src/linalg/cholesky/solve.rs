//! Triangular solves for one right-hand side or two, which stop at the contact dofs.

use super::size::{Size, require};
use super::supernodes::Supernode;
use super::{Cholesky, no_memory};
use crate::error::{Error, Result};
use crate::kernels::simd::{dot4, subtract4};
use crate::linalg::native::assembled_twice;
use crate::linalg::{Factor, LinearCombination, SchurFactor};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::LltRef;
use faer::{Conj, Mat, Par};
use pulp::{Simd, WithSimd};

impl Factor for Cholesky {
    fn schur_factor(&mut self) -> Option<&mut dyn SchurFactor> {
        Some(self)
    }

    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        let dofs = x.len();
        self.permute(x);
        self.sweep::<true>(dofs);
        self.sweep::<false>(dofs);
        self.unpermute(x);
        Ok(())
    }

    /// Solves two systems like each alone, in one pass over the factor, and more of them together.
    fn solve_columns(&mut self, x: &mut Mat<f64>) -> Result<()> {
        let dofs = x.nrows();
        if x.ncols() == 2 && dofs > 0 {
            self.x.resize(2 * dofs, 0.0);
            for (j, sorted) in self.x.chunks_exact_mut(dofs).enumerate() {
                sorted.iter_mut().zip(&self.order).for_each(|(value, &dof)| *value = x[(dof as usize, j)]);
            }
            self.sweep::<true>(dofs);
            self.sweep::<false>(dofs);
            for (j, sorted) in self.x.chunks_exact(dofs).enumerate() {
                sorted.iter().zip(&self.order).for_each(|(value, &dof)| x[(dof as usize, j)] = *value);
            }
            self.x.truncate(dofs);
            return Ok(());
        }
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq);
        let mut memory = MemBuffer::try_new(scratch).map_err(|_| no_memory(self.order.len()))?;
        let factor = LltRef::new(&self.symbolic, &self.values);
        factor.solve_in_place_with_conj(Conj::No, x.as_mut(), Par::Seq, MemStack::new(&mut memory));
        Ok(())
    }

    fn has_twice_the_digits(&self) -> bool {
        self.twice.is_some()
    }

    fn cost_of_digits(&self) -> Option<u32> {
        self.twice.is_none().then_some(self.cost_of_digits)
    }

    fn add_digits(&mut self, sum: &LinearCombination) -> Result<bool> {
        let (dofs, contact_dofs) = (self.order.len(), self.order.len() - self.interior);
        let (_, values) = match assembled_twice(dofs, sum) {
            Err(Error::Memory(_)) => return Ok(false),
            assembled => assembled?,
        };
        if require(&Size::of(&self.symbolic, contact_dofs, true), 1, dofs).is_err() {
            return Ok(false);
        }
        self.twice = Some(values);
        self.factor(None)?;
        Ok(true)
    }

    fn release(&mut self) {
        (self.values, self.twice) = (Vec::new(), None);
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        if dofs.is_empty() {
            return self.factor(None);
        }
        let mut pinned = vec![false; self.matrix.nrows()];
        for &dof in dofs {
            pinned[dof] = true;
        }
        self.factor(Some(&pinned))
    }
}

impl SchurFactor for Cholesky {
    fn schur(&mut self) -> &Mat<f64> {
        &self.schur
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], _: &mut [f64]) -> Result<()> {
        self.permute(b);
        self.sweep::<true>(self.interior);
        h.copy_from_slice(&self.x[self.interior..]);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        self.x[self.interior..].copy_from_slice(values);
        self.sweep::<false>(self.interior);
        self.unpermute(x);
        Ok(())
    }

    fn solve_schur(&mut self, h: &mut [f64]) {
        let size = h.len();
        for j in 0..size {
            let column = self.tail.col(j);
            h[j] /= column[j];
            for i in j + 1..size {
                h[i] -= column[i] * h[j];
            }
        }
        for j in (0..size).rev() {
            let column = self.tail.col(j);
            let sum: f64 = (j + 1..size).map(|i| column[i] * h[i]).sum();
            h[j] = (h[j] - sum) / column[j];
        }
    }
}

impl Cholesky {
    fn permute(&mut self, b: &[f64]) {
        for (x, &dof) in self.x.iter_mut().zip(&self.order) {
            *x = b[dof as usize];
        }
    }

    fn unpermute(&self, x: &mut [f64]) {
        for (value, &dof) in self.x.iter().zip(&self.order) {
            x[dof as usize] = *value;
        }
    }

    /// Solves with L, or with its transpose, for the positions before a limit.
    fn sweep<const FORWARD: bool>(&mut self, limit: usize) {
        self.arch.dispatch(Sweep::<FORWARD> {
            supernodes: &self.supernodes,
            patterns: &self.patterns,
            values: &self.values,
            pivots: &self.pivots,
            limit,
            columns: (&mut self.x, self.order.len()),
            work: &mut self.work,
        });
    }
}

/// Triangular solve with the columns before `limit`: forward with L, or backward with its
/// transpose.
struct Sweep<'a, const FORWARD: bool> {
    supernodes: &'a [Supernode],
    patterns: &'a [u32],
    values: &'a [f64],
    pivots: &'a [f64],
    limit: usize,
    /// Vectors to solve for, one after the other, and the length of each.
    columns: (&'a mut [f64], usize),
    work: &'a mut [f64],
}

impl<const FORWARD: bool> WithSimd for Sweep<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (columns, dofs) = std::mem::take(&mut self.columns);
        let (supernodes, limit) = (self.supernodes, self.limit);
        if FORWARD {
            for s in supernodes {
                if s.start < limit {
                    for x in columns.chunks_exact_mut(dofs) {
                        self.eliminate(simd, s, x);
                    }
                }
            }
        } else {
            for s in supernodes.iter().rev() {
                if s.start < limit {
                    for x in columns.chunks_exact_mut(dofs) {
                        self.substitute(simd, s, x);
                    }
                }
            }
        }
    }
}

impl<const FORWARD: bool> Sweep<'_, FORWARD> {
    /// Eliminates forward with the columns of one supernode. `work` holds the supernode's part of x
    /// and below it the updates to other rows of x.
    #[inline(always)]
    fn eliminate<S: Simd>(&mut self, simd: S, s: &Supernode, x: &mut [f64]) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&x[s.start..s.end]);
        work[width..].fill(0.0);
        let mut j = 0;
        while j + 4 <= columns {
            let a = four(values, j, height);
            let (head, rest) = work[j..].split_at_mut(4);
            head[0] *= pivots[j];
            head[1] = (head[1] - a[0][1] * head[0]) * pivots[j + 1];
            head[2] = (head[2] - a[0][2] * head[0] - a[1][2] * head[1]) * pivots[j + 2];
            head[3] = (head[3] - a[0][3] * head[0] - a[1][3] * head[1] - a[2][3] * head[2]) * pivots[j + 3];
            subtract4(simd, below(a), head, rest);
            j += 4;
        }
        for j in j..columns {
            let (head, rest) = work[j..].split_at_mut(1);
            head[0] *= pivots[j];
            for (y, a) in rest.iter_mut().zip(&values[j * height + j + 1..]) {
                *y -= a * head[0];
            }
        }
        x[s.start..s.end].copy_from_slice(&work[..width]);
        for (loss, &row) in work[width..].iter().zip(&self.patterns[s.pattern..]) {
            x[row as usize] += loss;
        }
    }

    /// Substitutes backward with the columns of one supernode.
    #[inline(always)]
    fn substitute<S: Simd>(&mut self, simd: S, s: &Supernode, x: &mut [f64]) {
        let (width, height, columns) = s.shape(self.limit);
        let values = &self.values[s.values..][..width * height];
        let pivots = &self.pivots[s.start..][..columns];
        let work = &mut self.work[..height];
        work[..width].copy_from_slice(&x[s.start..s.end]);
        for (value, &row) in work[width..].iter_mut().zip(&self.patterns[s.pattern..]) {
            *value = x[row as usize];
        }
        let whole = columns / 4 * 4;
        for j in (whole..columns).rev() {
            let (head, rest) = work[j..].split_at_mut(1);
            let mut sum = 0.0;
            for (y, a) in rest.iter().zip(&values[j * height + j + 1..]) {
                sum += a * y;
            }
            head[0] = (head[0] - sum) * pivots[j];
        }
        for j in (0..whole).step_by(4).rev() {
            let a = four(values, j, height);
            let (head, rest) = work[j..].split_at_mut(4);
            let sums = dot4(simd, below(a), rest);
            head[3] = (head[3] - sums[3]) * pivots[j + 3];
            head[2] = (head[2] - sums[2] - a[2][3] * head[3]) * pivots[j + 2];
            head[1] = (head[1] - sums[1] - a[1][2] * head[2] - a[1][3] * head[3]) * pivots[j + 1];
            head[0] =
                (head[0] - sums[0] - a[0][1] * head[1] - a[0][2] * head[2] - a[0][3] * head[3]) * pivots[j];
        }
        x[s.start..s.end].copy_from_slice(&work[..width]);
    }
}

/// Returns columns j to j + 3 of a panel, from row j on.
#[inline(always)]
fn four(values: &[f64], j: usize, height: usize) -> [&[f64]; 4] {
    let (from, to) = (j * height + j, (j + 1) * height);
    [
        &values[from..to],
        &values[from + height..to + height],
        &values[from + 2 * height..to + 2 * height],
        &values[from + 3 * height..to + 3 * height],
    ]
}

/// Returns the columns of [`four`] below their triangle.
#[inline(always)]
fn below(a: [&[f64]; 4]) -> [&[f64]; 4] {
    [&a[0][4..], &a[1][4..], &a[2][4..], &a[3][4..]]
}
