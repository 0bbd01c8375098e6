//! Compliance kept between runs: displacements per unit force at single dofs, without those of the
//! modes.
//!
//! Contact with the modal mass needs such a displacement for each node that comes near an obstacle.
//! Matrices and modes determine it to the bit, so that it is kept under the hash of the modes. A
//! run that has computed more of them than were kept extends the file at its end.

use super::store::{COMPLIANCE, Store};
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

/// Displacements per unit force at single dofs; see the [module page](self). Dropping them writes
/// the store.
pub(crate) struct KeptColumns {
    /// Store with the hash of the modes; `None` to keep nothing.
    place: Option<(Arc<Store>, u128)>,
    /// Number of dofs of a displacement.
    rows: usize,
    /// Largest number of displacements that are kept.
    most: usize,
    /// Displacements by dof.
    columns: BTreeMap<usize, Rc<[f64]>>,
    is_read: bool,
    /// Whether there are displacements that the store lacks.
    has_more: bool,
}

impl KeptColumns {
    /// Prepares to read displacements of a number of dofs from a store, given the hash of the
    /// modes. No more than `most` of them are kept.
    pub fn new(place: Option<(Arc<Store>, u128)>, rows: usize, most: usize) -> KeptColumns {
        KeptColumns { place, rows, most, columns: BTreeMap::new(), is_read: false, has_more: false }
    }

    /// Returns the displacement per unit force at a dof, if it is kept.
    pub fn get(&mut self, dof: usize) -> Option<Rc<[f64]>> {
        if !self.is_read {
            self.is_read = true;
            self.read();
        }
        self.columns.get(&dof).cloned()
    }

    /// Adds the displacement per unit force at a dof, if anything is kept.
    pub fn add(&mut self, dof: usize, column: &Rc<[f64]>) {
        if self.place.is_some() && self.columns.len() < self.most {
            self.columns.insert(dof, column.clone());
            self.has_more = true;
        }
    }

    /// Adds the displacements of the store.
    fn read(&mut self) {
        let Some((store, key)) = &self.place else { return };
        let fits = |(dof, column): &(usize, Vec<f64>)| *dof < self.rows && column.len() == self.rows;
        let kept = store.get(COMPLIANCE, *key, |kept: &Vec<_>| kept.iter().all(fits));
        for (dof, column) in kept.unwrap_or_default() {
            if self.columns.len() < self.most {
                self.columns.entry(dof).or_insert_with(|| column.into());
            }
        }
    }
}

impl Drop for KeptColumns {
    fn drop(&mut self) {
        if self.has_more {
            // Another run may have extended the file meanwhile.
            self.read();
            let columns: Vec<_> = self.columns.iter().map(|(dof, column)| (dof, &column[..])).collect();
            let size = [columns.len(), self.rows];
            self.place.iter().for_each(|(store, key)| store.put(COMPLIANCE, *key, size, &columns));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::store::tests::Shelf;
    use super::*;
    use std::fs;

    #[test]
    fn later_runs_extend_the_file_and_a_damaged_one_is_written_again() {
        let shelf = Shelf::new("columns");
        let run = || KeptColumns::new(Some((shelf.0.clone(), 7)), 3, 4);
        let column = |value: f64| -> Rc<[f64]> { [value, -0.0, f64::MIN_POSITIVE].into() };
        {
            let [mut first, mut other] = [run(), run()];
            assert!(first.get(2).is_none() && other.get(1).is_none());
            first.add(2, &column(2.0));
            drop(first);
            other.add(1, &column(1.0));
        }
        assert!(shelf.said(&["1 of 3 dofs, kept in", "1 of 3 dofs, read from", "2 of 3 dofs, kept in"]));
        let mut third = run();
        assert_eq!(third.get(2).unwrap()[..], column(2.0)[..]);
        assert!(third.get(1).unwrap()[1].is_sign_negative() && third.get(0).is_none());
        drop(third);
        assert!(shelf.said(&["2 of 3 dofs, read from"]), "nothing new is not written");

        let (whole, path) = shelf.file();
        let mut larger = KeptColumns::new(Some((shelf.0.clone(), 7)), 4, 4);
        assert!(larger.get(2).is_none());
        fs::write(&path, &whole[1..]).unwrap();
        let mut fourth = run();
        assert!(fourth.get(1).is_none());
        [2, 1].iter().for_each(|&dof| fourth.add(dof, &column(dof as f64)));
        drop(fourth);
        assert!(shelf.said(&["damaged; the compliance is computed and written again", "kept in"]));
        assert_eq!(shelf.file(), (whole, path));
    }

    #[test]
    fn no_more_than_the_limit_is_kept_and_nothing_without_a_store() {
        let shelf = Shelf::new("most");
        let column: Rc<[f64]> = [1.0, 2.0, 3.0].into();
        let mut run = KeptColumns::new(Some((shelf.0.clone(), 7)), 3, 2);
        (0..3).for_each(|dof| run.add(dof, &column));
        drop(run);
        assert!(shelf.said(&["2 of 3 dofs, kept in"]));
        let mut none = KeptColumns::new(None, 3, 2);
        none.add(0, &column);
        assert!(none.get(0).is_none());
    }
}
