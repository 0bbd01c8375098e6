//! Cholesky factor of the compliance of the dofs in contact, which join and leave one by one.
//!
//! From step to step few dofs change their status. One that joins adds a row to the factor, by a
//! forward substitution. One that leaves takes a row and a column with it, and the columns behind
//! them are restored by rotations (Gill, Golub, Murray and Saunders 1974, method C1). Either takes
//! as many operations as the factor has entries, where a new factor takes as many as its entries
//! times a third of its size. Both are backward stable, and rounding errors add up: after many dofs
//! have left, the factor is computed anew.

use crate::kernels::lanes::dot;
use crate::kernels::wide::widest;
use faer::Mat;
use pulp::Arch;

/// Number of dofs that leave a factor before it is computed anew.
const MOST_REMOVALS: u32 = 500;

/// Cholesky factor of a block of the compliance; see the [module page](self).
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(super) struct ActiveFactor {
    /// Dofs of the block in the order in which they joined, each with the compliance of its bound
    /// (m/N), which is part of the diagonal.
    dofs: Vec<(usize, f64)>,
    /// Columns of the factor, each from its diagonal entry down.
    columns: Vec<Vec<f64>>,
    /// Number of dofs that have left since the factor was computed anew.
    removals: u32,
}

impl ActiveFactor {
    /// Returns the dofs of the block, in the order of the entries that [`Self::solve`] takes.
    pub fn dofs(&self) -> impl Iterator<Item = usize> {
        self.dofs.iter().map(|(dof, _)| *dof)
    }

    /// Returns whether the block belongs to given dofs, ascending, with the compliances of their
    /// bounds, in m/N.
    pub fn is_of(&self, wanted: &[(usize, f64)]) -> bool {
        self.dofs.len() == wanted.len() && self.dofs.iter().all(|dof| contains(wanted, dof))
    }

    /// Changes the factor to given dofs, ascending, with the compliances of their bounds, in m/N.
    /// Returns whether the block is positive definite to rounding; if not, the factor is empty.
    pub fn follow(&mut self, wanted: &[(usize, f64)], compliance: &Mat<f64>) -> bool {
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                let stay = self.dofs.iter().filter(|dof| contains(wanted, dof)).count();
                let leave = self.dofs.len() - stay;
                // Each dof that leaves costs about as much as two that join.
                if 2 * leave >= stay || self.removals > MOST_REMOVALS {
                    self.clear();
                }
                for place in (0..self.dofs.len()).rev() {
                    if !contains(wanted, &self.dofs[place]) {
                        self.remove(place);
                    }
                }
                let mut is_factored = vec![false; compliance.ncols()];
                self.dofs().for_each(|dof| is_factored[dof] = true);
                for bound in wanted {
                    if !is_factored[bound.0] && !self.append(*bound, compliance) {
                        self.clear();
                        return false;
                    }
                }
                true
            },
        )
    }

    fn clear(&mut self) {
        *self = ActiveFactor::default();
    }

    /// Adds a dof. Returns whether the larger block is positive definite.
    #[inline(always)]
    fn append(&mut self, (dof, softness): (usize, f64), compliance: &Mat<f64>) -> bool {
        let column = compliance.col_as_slice(dof);
        let mut row: Vec<f64> = self.dofs().map(|dof| column[dof]).collect();
        forward(&self.columns, &mut row);
        let pivot = column[dof] + softness - dot(&row, &row);
        if pivot.is_nan() || pivot <= 0.0 {
            return false;
        }
        for (column, entry) in self.columns.iter_mut().zip(row) {
            column.push(entry);
        }
        self.columns.push(vec![pivot.sqrt()]);
        self.dofs.push((dof, softness));
        true
    }

    /// Removes the dof at a position of the block.
    #[inline(always)]
    fn remove(&mut self, place: usize) {
        for (k, column) in self.columns[..place].iter_mut().enumerate() {
            column.remove(place - k);
        }
        let mut column = self.columns.remove(place);
        self.dofs.remove(place);
        self.removals += 1;
        let mut rest = &mut column[1..];
        for column in &mut self.columns[place..] {
            let size = column.len();
            let (entries, update) = (&mut column[..size], &mut rest[..size]);
            let root = (entries[0] * entries[0] + update[0] * update[0]).sqrt();
            let (cosine, sine) = (entries[0] / root, update[0] / root);
            for k in 0..size {
                let entry = entries[k];
                entries[k] = cosine * entry + sine * update[k];
                update[k] = cosine * update[k] - sine * entry;
            }
            rest = &mut rest[1..];
        }
    }

    /// Solves with the block in place, for one entry per dof in the order of [`Self::dofs`].
    pub fn solve(&self, values: &mut [f64]) {
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                forward(&self.columns, values);
                for (k, column) in self.columns.iter().enumerate().rev() {
                    let sum = dot(&column[1..], &values[k + 1..]);
                    values[k] = (values[k] - sum) / column[0];
                }
            },
        );
    }
}

/// Returns whether ascending dofs contain one with the same compliance of its bound.
fn contains(wanted: &[(usize, f64)], (dof, softness): &(usize, f64)) -> bool {
    wanted.binary_search_by_key(dof, |(dof, _)| *dof).is_ok_and(|place| wanted[place].1 == *softness)
}

/// Solves with a lower triangle in place, given its columns from their diagonal entries down.
#[inline(always)]
fn forward(columns: &[Vec<f64>], values: &mut [f64]) {
    for (k, column) in columns.iter().enumerate() {
        let (value, rest) = values[k..].split_at_mut(1);
        value[0] /= column[0];
        let (value, below) = (value[0], &column[1..]);
        let size = rest.len();
        let below = &below[..size];
        for i in 0..size {
            rest[i] -= value * below[i];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix64;

    #[test]
    fn the_factor_solves_with_the_block_after_many_changes() {
        let mut random = SplitMix64::new(3);
        let size = 40;
        let root = Mat::from_fn(size, size, |_, _| random.signed());
        let mut matrix = &root * root.transpose();
        (0..size).for_each(|i| matrix[(i, i)] += 0.1);
        let mut factor = ActiveFactor::default();
        let mut is_in = vec![false; size];
        let mut worst: f64 = 0.0;
        for change in 0..3000 {
            let flips = if change % 100 == 0 { size } else { 1 + change % 4 };
            for _ in 0..flips {
                let dof = (random.unit() * size as f64) as usize;
                is_in[dof] = !is_in[dof];
            }
            let softness = |i: usize| if i.is_multiple_of(7) { 0.05 * (1 + change % 2) as f64 } else { 0.0 };
            let wanted: Vec<(usize, f64)> =
                (0..size).filter(|&i| is_in[i]).map(|i| (i, softness(i))).collect();
            assert!(factor.follow(&wanted, &matrix) && factor.is_of(&wanted));
            let solution: Vec<f64> = factor.dofs().map(|_| random.signed()).collect();
            let product = |(i, softness): (usize, f64)| {
                let force = factor.dofs().zip(&solution).map(|(j, x)| matrix[(i, j)] * x).sum::<f64>();
                let place = factor.dofs().position(|j| j == i).unwrap();
                force + softness * solution[place]
            };
            let mut values: Vec<f64> = factor.dofs.iter().map(|dof| product(*dof)).collect();
            factor.solve(&mut values);
            worst = values.iter().zip(&solution).fold(worst, |worst, (x, y)| worst.max((x - y).abs()));
        }
        assert!(worst <= 1e-10, "{worst:e}");
        matrix[(3, 3)] = -1.0;
        assert!(!factor.follow(&[(2, 0.0), (3, 0.0)], &matrix));
        assert!(factor.follow(&[(2, 0.0), (5, 0.0)], &matrix));
    }
}
