//! Cholesky factorisation in double-double arithmetic, for matrices too ill-conditioned for
//! doubles.
//!
//! The condition number of the factor L is the square root of that of A, so that rounding L at the
//! end costs half as many digits as rounding A. Rounding A itself, or anything on the way, may take
//! all stiffness from a slow motion.

use super::supernodes::Supernode;
use crate::linalg::double_double::DoubleDouble;
use pulp::{Simd, WithSimd};

/// Factors the panels of a matrix in place and returns whether it is positive definite.
pub(super) struct PanelFactorisation<'a> {
    pub supernodes: &'a [Supernode],
    pub patterns: &'a [u32],
    /// Supernode of each position.
    pub owner: &'a [u32],
    pub values: &'a mut [DoubleDouble],
}

impl WithSimd for PanelFactorisation<'_> {
    type Output = bool;

    /// Dispatches the loops below without intrinsics: the widest registers come with the fused
    /// multiply-add that exact products need.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> bool {
        let PanelFactorisation { supernodes, patterns, owner, values } = self;
        let mut row_of = vec![0; owner.len()];
        let mut update = Vec::new();
        for s in supernodes {
            let (width, height) = (s.end - s.start, s.end - s.start + s.rows);
            if !factor_panel(&mut values[s.values..][..width * height], width, height) {
                return false;
            }
            // The update that each row below takes from the panel goes into that row's own column.
            let pattern = &patterns[s.pattern..][..s.rows];
            let mut last = None;
            for (k, &column) in pattern.iter().enumerate() {
                let target = supernodes[owner[column as usize] as usize];
                if last.replace(target.start) != Some(target.start) {
                    let below = patterns[target.pattern..][..target.rows].iter().map(|&row| row as usize);
                    for (row, place) in (target.start..target.end).chain(below).enumerate() {
                        row_of[place] = row;
                    }
                }
                update.clear();
                update.resize(s.rows, DoubleDouble::default());
                for panel in values[s.values..][..width * height].chunks_exact(height) {
                    let factor = -panel[width + k];
                    for (sum, entry) in update.iter_mut().zip(&panel[width..]) {
                        *sum = *sum + *entry * factor;
                    }
                }
                let tall = target.end - target.start + target.rows;
                let values = &mut values[target.values + (column as usize - target.start) * tall..][..tall];
                for (&row, sum) in pattern.iter().zip(&update).filter(|(row, _)| **row >= column) {
                    let entry = &mut values[row_of[row as usize]];
                    *entry = *entry + *sum;
                }
            }
        }
        true
    }
}

/// Factors the columns of one panel among themselves and returns whether all pivots are positive.
#[inline(always)]
fn factor_panel(panel: &mut [DoubleDouble], width: usize, height: usize) -> bool {
    for j in 0..width {
        let (done, rest) = panel.split_at_mut((j + 1) * height);
        let column = &mut done[j * height..];
        let pivot = column[j];
        if !(pivot.round() > 0.0 && pivot.round().is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        column[j] = root;
        for entry in &mut column[j + 1..] {
            *entry = *entry / root;
        }
        for (k, other) in rest.chunks_exact_mut(height).take(width - 1 - j).enumerate() {
            let first = j + 1 + k;
            let factor = -column[first];
            for (sum, entry) in other[first..].iter_mut().zip(&column[first..]) {
                *sum = *sum + *entry * factor;
            }
        }
    }
    true
}
