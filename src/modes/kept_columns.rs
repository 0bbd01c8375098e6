//! Compliance kept between runs: displacements per unit force at single dofs, without those of the
//! modes.
//!
//! Contact with the modal mass needs such a displacement for each node that comes near an obstacle.
//! Matrices and modes determine it to the bit, so that it is kept under the hash of the modes. A
//! run that has computed more of them than were kept extends the file at its end.

use super::kept::{BasisStore, KeptKind, KeptSize, file_name, store};
use crate::hash;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::Arc;

/// Version of the format, increased whenever the file changes, or the numbers that the same modes
/// give.
const FORMAT: u32 = 1;

/// Displacements by dof, ascending.
type Columns = BTreeMap<usize, Rc<[f64]>>;

/// Displacements per unit force at single dofs; see the [module page](self). Dropping them writes
/// the store.
pub(crate) struct KeptColumns {
    /// Store with the hash of the modes; `None` to keep nothing.
    place: Option<(Arc<dyn BasisStore>, u128)>,
    /// Number of dofs of a displacement.
    rows: usize,
    /// Largest number of displacements that are kept.
    most: usize,
    columns: Columns,
    is_read: bool,
    /// Whether there are displacements that the store lacks.
    has_more: bool,
}

impl KeptColumns {
    /// Prepares to read displacements of a number of dofs from the store of the process, given the
    /// hash of the modes. No more than `most` of them are kept.
    pub fn new(key: Option<u128>, rows: usize, most: usize) -> KeptColumns {
        KeptColumns::in_store(store().zip(key), rows, most)
    }

    fn in_store(place: Option<(Arc<dyn BasisStore>, u128)>, rows: usize, most: usize) -> KeptColumns {
        KeptColumns { place, rows, most, columns: Columns::new(), is_read: false, has_more: false }
    }

    /// Returns the displacement per unit force at a dof, if it is kept.
    pub fn get(&mut self, dof: usize) -> Option<Rc<[f64]>> {
        if !self.is_read {
            self.is_read = true;
            self.columns = self.read(true).unwrap_or_default();
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

    /// Reads the displacements of the store, and tells it whether they are used or damaged.
    fn read(&self, is_used: bool) -> Option<Columns> {
        let (store, key) = self.place.as_ref()?;
        let name = file_name(*key);
        let bytes = store.read(KeptKind::Compliance, &name)?;
        let columns = from_bytes(&bytes, *key, self.rows);
        match &columns {
            Some(columns) if is_used => {
                store.accept(KeptKind::Compliance, &name, self.size(columns), &bytes);
            }
            None if is_used => store.reject(KeptKind::Compliance, &name),
            _ => (),
        }
        columns
    }

    fn size(&self, columns: &Columns) -> KeptSize {
        KeptSize { columns: columns.len(), dofs: self.rows }
    }
}

impl Drop for KeptColumns {
    fn drop(&mut self) {
        if !self.has_more {
            return;
        }
        // Another run may have extended the file meanwhile.
        for (dof, column) in self.read(false).unwrap_or_default() {
            if self.columns.len() < self.most {
                self.columns.entry(dof).or_insert(column);
            }
        }
        if let Some((store, key)) = &self.place {
            let bytes = to_bytes(&self.columns, *key, self.rows);
            store.write(KeptKind::Compliance, &file_name(*key), self.size(&self.columns), &bytes);
        }
    }
}

/// Returns the first line of a file.
fn head() -> String {
    format!("rebond compliance, format {FORMAT}, version {}\n", env!("CARGO_PKG_VERSION"))
}

/// Serialises displacements: a line of text, the hash of the modes, counts, and each dof with its
/// displacement, little-endian, and a checksum.
fn to_bytes(columns: &Columns, key: u128, rows: usize) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(8 * columns.len() * (rows + 1) + 128);
    bytes.extend(head().as_bytes());
    bytes.extend(key.to_le_bytes());
    bytes.extend((rows as u64).to_le_bytes());
    bytes.extend((columns.len() as u64).to_le_bytes());
    for (dof, column) in columns {
        bytes.extend((*dof as u64).to_le_bytes());
        column.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    hash::seal(bytes)
}

/// Parses the bytes of displacements; `None` where they are damaged or those of another hash.
fn from_bytes(bytes: &[u8], key: u128, rows: usize) -> Option<Columns> {
    let content = hash::unseal(bytes)?.strip_prefix(head().as_bytes())?;
    let (found, content) = content.split_first_chunk()?;
    let (words, []) = content.as_chunks::<8>() else { return None };
    let ([dofs, count], words) = words.split_first_chunk()?;
    let whole = |word: &[u8; 8]| usize::try_from(u64::from_le_bytes(*word)).ok();
    let length = whole(count)?.checked_mul(rows.checked_add(1)?)?;
    if u128::from_le_bytes(*found) != key || whole(dofs)? != rows || words.len() != length {
        return None;
    }
    let column = |words: &[[u8; 8]]| {
        let (dof, numbers) = words.split_first()?;
        let dof = whole(dof).filter(|dof| *dof < rows)?;
        Some((dof, numbers.iter().map(|number| f64::from_le_bytes(*number)).collect()))
    };
    words.chunks(rows + 1).map(column).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    /// Store in memory of one file, with the numbers of writes, uses and rejections.
    #[derive(Default)]
    struct Drawer {
        file: Mutex<Option<Vec<u8>>>,
        counts: Mutex<[usize; 3]>,
    }

    impl BasisStore for Drawer {
        fn read(&self, _: KeptKind, _: &str) -> Option<Vec<u8>> {
            self.file.lock().unwrap().clone()
        }

        fn write(&self, kind: KeptKind, _: &str, _: KeptSize, bytes: &[u8]) {
            assert_eq!(kind, KeptKind::Compliance);
            *self.file.lock().unwrap() = Some(bytes.into());
            self.counts.lock().unwrap()[0] += 1;
        }

        fn accept(&self, _: KeptKind, _: &str, _: KeptSize, _: &[u8]) {
            self.counts.lock().unwrap()[1] += 1;
        }

        fn reject(&self, _: KeptKind, _: &str) {
            self.counts.lock().unwrap()[2] += 1;
        }
    }

    #[test]
    fn later_runs_extend_the_file_and_a_damaged_one_is_written_again() {
        let drawer = Arc::new(Drawer::default());
        let run = || KeptColumns::in_store(Some((drawer.clone() as Arc<dyn BasisStore>, 7)), 3, 4);
        let column = |value: f64| -> Rc<[f64]> { [value, -0.0, f64::MIN_POSITIVE].into() };
        let counts = || *drawer.counts.lock().unwrap();
        {
            let [mut first, mut other] = [run(), run()];
            assert!(first.get(2).is_none() && other.get(1).is_none());
            first.add(2, &column(2.0));
            drop(first);
            other.add(1, &column(1.0));
        }
        assert_eq!(counts(), [2, 0, 0]);
        let mut third = run();
        assert_eq!(third.get(2).unwrap()[..], column(2.0)[..]);
        assert!(third.get(1).unwrap()[1].is_sign_negative() && third.get(0).is_none());
        drop(third);
        assert_eq!(counts(), [2, 1, 0], "nothing new is not written");

        let whole = drawer.file.lock().unwrap().clone().unwrap();
        assert!(from_bytes(&whole, 8, 3).is_none() && from_bytes(&whole, 7, 4).is_none());
        assert!((0..whole.len()).all(|end| from_bytes(&whole[..end], 7, 3).is_none()));
        for bit in 0..8 * whole.len() {
            let mut damaged = whole.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(from_bytes(&damaged, 7, 3).is_none(), "bit {bit}");
        }
        *drawer.file.lock().unwrap() = Some(whole[1..].into());
        let mut fourth = run();
        assert!(fourth.get(1).is_none());
        [2, 1].iter().for_each(|&dof| fourth.add(dof, &column(dof as f64)));
        drop(fourth);
        assert_eq!(counts(), [3, 1, 1]);
        assert_eq!(drawer.file.lock().unwrap().as_ref(), Some(&whole));
    }

    #[test]
    fn no_more_than_the_limit_is_kept_and_nothing_without_a_store() {
        let drawer = Arc::new(Drawer::default());
        let column: Rc<[f64]> = [1.0, 2.0, 3.0].into();
        let mut run = KeptColumns::in_store(Some((drawer.clone() as Arc<dyn BasisStore>, 7)), 3, 2);
        (0..3).for_each(|dof| run.add(dof, &column));
        drop(run);
        let kept = from_bytes(drawer.file.lock().unwrap().as_ref().unwrap(), 7, 3).unwrap();
        assert_eq!(kept.len(), 2);
        let mut none = KeptColumns::in_store(None, 3, 2);
        none.add(0, &column);
        assert!(none.get(0).is_none());
    }
}
