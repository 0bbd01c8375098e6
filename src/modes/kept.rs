//! Modes kept between runs.
//!
//! The modes of a fine mesh cost more than many runs with the modal mass. A [`BasisStore`], such as
//! a folder, keeps them: a basis that is read has the bits of the one that was computed. The store
//! also keeps the [compliance](super::kept_columns) of the rest of the displacement. Without
//! [`keep_in`] nothing is kept.
//!
//! The name of a basis is a hash of 128 bits of all data that it depends on: the contributions of
//! the cells, springs and masses to K and M, the dofs that they act on, and the wanted modes. The
//! hash also covers the bits of the products of both matrices with one vector, which depend on the
//! order of summation and on the registers of the processor. No basis is served for fewer modes
//! than it was computed for: the last bits of a mode depend on how many modes are sought.

use super::{ModalBasis, ModeRange, lowest_basis};
use crate::error::Result;
use crate::hash::{self, LongHash};
use crate::linalg::{ElementMatrix, Engine, Form};
use crate::random::random_vector;
use faer::Mat;
use std::collections::HashMap;
use std::sync::{Arc, PoisonError, RwLock};

/// Version of the format, increased whenever the file of a basis changes, or the modes that the
/// same matrices give.
const FORMAT: u32 = 2;

/// Kind of a kept file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum KeptKind {
    /// Basis of modes.
    Modes,
    /// Displacements per unit force at single dofs, without those of the modes.
    Compliance,
}

impl KeptKind {
    /// Returns the name of the kind, in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            KeptKind::Modes => "modes",
            KeptKind::Compliance => "compliance",
        }
    }
}

/// Numbers of modes or displacements, and of their dofs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeptSize {
    /// Number of modes or displacements.
    pub columns: usize,
    /// Number of dofs of each.
    pub dofs: usize,
}

/// Place where bases are kept, by kind and name. Its failures never stop a computation.
pub trait BasisStore: Send + Sync {
    /// Returns the kept bytes; `None` where there are none.
    fn read(&self, kind: KeptKind, name: &str) -> Option<Vec<u8>>;

    /// Keeps the bytes of a result.
    fn write(&self, kind: KeptKind, name: &str, size: KeptSize, bytes: &[u8]);

    /// Learns that bytes were those of a result, which is used.
    fn accept(&self, kind: KeptKind, name: &str, size: KeptSize, bytes: &[u8]);

    /// Learns that bytes are damaged; the result is computed and written again.
    fn reject(&self, kind: KeptKind, name: &str);
}

/// Store of the process: studies build their models in several threads.
static STORE: RwLock<Option<Arc<dyn BasisStore>>> = RwLock::new(None);

/// Sets where all models of this process that are built from now on keep their modes; `None`, as at
/// the start, keeps none.
pub fn keep_in(store: Option<Arc<dyn BasisStore>>) {
    *STORE.write().unwrap_or_else(PoisonError::into_inner) = store;
}

/// Returns the store of the process.
pub(super) fn store() -> Option<Arc<dyn BasisStore>> {
    STORE.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Returns the modes of [`lowest_basis`] from the store of the process, if it has them and the
/// engine [repeats](Engine::REPEATS) its results; and the hash of all that determines them, where
/// there is such a store.
///
/// # Errors
/// Returns the errors of [`lowest_basis`].
pub(crate) fn kept_basis<E: Engine>(
    engine: &E,
    stiffness: &Form,
    mass: &Form,
    range: ModeRange,
    mechanism: bool,
) -> Result<(ModalBasis, Option<u128>)> {
    let compute = || lowest_basis(engine, stiffness, mass, range, mechanism);
    match store().filter(|_| E::REPEATS) {
        None => Ok((compute()?, None)),
        Some(store) => {
            let key = key(engine, [stiffness, mass], range, mechanism)?;
            let holds = |basis: &ModalBasis| agrees(engine, [stiffness, mass], basis);
            Ok((basis_of(&*store, key, holds, compute)?, Some(key)))
        }
    }
}

/// Largest relative difference of a kept square frequency and the Rayleigh quotient of its shape,
/// and of a kept momentum and the product of mass and shape. Either is rounding.
const AGREES: f64 = 1e-6;

/// Returns whether modes agree with the matrices: `$\phi^T K \phi = \omega^2 \phi^T M \phi$` and unit
/// modal mass for each mode, which costs one product with either matrix.
///
/// The checksum of a file tells only that it is what somebody wrote.
fn agrees<E: Engine>(engine: &E, [stiffness, mass]: [&Form; 2], basis: &ModalBasis) -> Result<bool> {
    if basis.shapes.nrows() != engine.dofs() {
        return Ok(false);
    }
    let mut product = vec![0.0; engine.dofs()];
    for (j, &square) in basis.squares.iter().enumerate() {
        let shape = basis.shapes.col_as_slice(j);
        let energy = engine.multiply(stiffness, shape, &mut product)?;
        let modal_mass = engine.multiply(mass, shape, &mut product)?;
        let size = product.iter().fold(0.0, |most: f64, entry| most.max(entry.abs()));
        let momentum = basis.momenta.col_as_slice(j).iter().zip(&product);
        // An eigenvalue of a rigid motion is exactly 0, and its energy is rounding.
        let scale = if square == 0.0 { basis.next } else { square };
        let close = (energy - square * modal_mass).abs() <= AGREES * scale
            && (modal_mass - 1.0).abs() <= AGREES
            && momentum.into_iter().all(|(kept, entry)| (kept - entry).abs() <= AGREES * size);
        if !close {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Returns the basis of a key from a store where it is there and holds, or computes it and writes
/// it to the store.
fn basis_of(
    store: &dyn BasisStore,
    key: u128,
    holds: impl FnOnce(&ModalBasis) -> Result<bool>,
    compute: impl FnOnce() -> Result<ModalBasis>,
) -> Result<ModalBasis> {
    let name = file_name(key);
    let size = |basis: &ModalBasis| KeptSize { columns: basis.squares.len(), dofs: basis.shapes.nrows() };
    if let Some(bytes) = store.read(KeptKind::Modes, &name) {
        match from_bytes(&bytes, key) {
            Some(basis) if holds(&basis)? => {
                store.accept(KeptKind::Modes, &name, size(&basis), &bytes);
                return Ok(basis);
            }
            _ => store.reject(KeptKind::Modes, &name),
        }
    }
    let basis = compute()?;
    store.write(KeptKind::Modes, &name, size(&basis), &to_bytes(&basis, key));
    Ok(basis)
}

/// Returns the name of what a hash determines.
pub(super) fn file_name(key: u128) -> String {
    format!("{key:032x}")
}

/// Returns the hash of everything that determines the bits of a basis.
fn key<E: Engine>(engine: &E, forms: [&Form; 2], range: ModeRange, mechanism: bool) -> Result<u128> {
    let mut hash = LongHash::new();
    hash.add(head().as_bytes());
    let (kind, wanted) = match range {
        ModeRange::Count(count) => (0, count as f64),
        ModeRange::UpTo(frequency) => (1, frequency),
    };
    hash.add_count(kind);
    hash.add_numbers(&[wanted, f64::from(u8::from(mechanism))]);
    let x = random_vector(engine.dofs(), 0);
    let mut product = vec![0.0; engine.dofs()];
    for form in forms {
        if let Form::Cells(cells) = form {
            add_cells(&mut hash, cells.blocks());
        }
        let value = engine.multiply(form, &x, &mut product)?;
        hash.add_numbers(&product);
        hash.add_numbers(&[value]);
    }
    Ok(hash.0)
}

/// Adds the contributions of cells, with matrices that several cells share once.
fn add_cells(hash: &mut LongHash, blocks: &[ElementMatrix]) {
    let mut known = HashMap::new();
    hash.add_count(blocks.len());
    for ElementMatrix { dofs, matrix, bending, class } in blocks {
        hash.add_count(dofs.len());
        dofs.iter().for_each(|dof| hash.add_count(dof.map_or(0, |dof| dof + 1)));
        hash.add_count(*class);
        let address = (matrix.as_ptr(), bending.as_ref().map(std::rc::Rc::as_ptr));
        let next = known.len();
        let number = *known.entry(address).or_insert(next);
        hash.add_count(number);
        if number < next {
            continue;
        }
        hash.add_numbers(matrix);
        if let Some(bending) = bending {
            hash.add_numbers(bending.arms.as_flattened());
            hash.add_numbers(&bending.root);
        }
    }
}

/// Returns the first line of a file.
fn head() -> String {
    format!("rebond modes, format {FORMAT}, version {}\n", env!("CARGO_PKG_VERSION"))
}

/// Serialises a basis: a line of text, the key, counts and numbers in order, little-endian, and a
/// checksum.
fn to_bytes(basis: &ModalBasis, key: u128) -> Vec<u8> {
    let ModalBasis { squares, shapes, momenta, residuals, next, solves, is_complete } = basis;
    let numbers = squares.len() * (2 + 2 * shapes.nrows()) + 1;
    let mut bytes = Vec::with_capacity(8 * numbers + 128);
    bytes.extend(head().as_bytes());
    bytes.extend(key.to_le_bytes());
    for count in [shapes.nrows(), squares.len(), *solves, usize::from(*is_complete)] {
        bytes.extend((count as u64).to_le_bytes());
    }
    let columns = [shapes, momenta].into_iter().flat_map(|of| (0..of.ncols()).map(|j| of.col_as_slice(j)));
    for numbers in [&squares[..], residuals, &[*next]].into_iter().chain(columns) {
        numbers.iter().for_each(|number| bytes.extend(number.to_le_bytes()));
    }
    hash::seal(bytes)
}

/// Parses the bytes of a basis; `None` where they are damaged or those of another key.
fn from_bytes(bytes: &[u8], key: u128) -> Option<ModalBasis> {
    let content = hash::unseal(bytes)?.strip_prefix(head().as_bytes())?;
    let (found, content) = content.split_first_chunk()?;
    if u128::from_le_bytes(*found) != key {
        return None;
    }
    let (counts, content) = content.split_first_chunk::<32>()?;
    let counts = counts.as_chunks().0.iter().map(|count| usize::try_from(u64::from_le_bytes(*count)).ok());
    let [rows, count, solves, complete] = counts.collect::<Option<Vec<_>>>()?.try_into().ok()?;
    let (numbers, []) = content.as_chunks::<8>() else { return None };
    if rows.checked_mul(2)?.checked_add(2)?.checked_mul(count)?.checked_add(1)? != numbers.len() {
        return None;
    }
    let mut numbers = numbers.iter().map(|number| f64::from_le_bytes(*number));
    let squares = numbers.by_ref().take(count).collect();
    let residuals = numbers.by_ref().take(count).collect();
    let next = numbers.next()?;
    let mut matrix = || {
        let mut matrix = Mat::zeros(rows, count);
        for j in 0..count {
            matrix
                .col_as_slice_mut(j)
                .iter_mut()
                .zip(&mut numbers)
                .for_each(|(entry, number)| *entry = number);
        }
        matrix
    };
    let (shapes, momenta) = (matrix(), matrix());
    Some(ModalBasis { squares, shapes, momenta, residuals, next, solves, is_complete: complete == 1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::Native;
    use std::sync::Mutex;

    /// Store in memory that counts what happens.
    #[derive(Default)]
    struct Shelf {
        files: Mutex<HashMap<String, Vec<u8>>>,
        /// Numbers of writes, uses and rejections.
        counts: Mutex<[usize; 3]>,
    }

    impl BasisStore for Shelf {
        fn read(&self, _: KeptKind, name: &str) -> Option<Vec<u8>> {
            self.files.lock().unwrap().get(name).cloned()
        }

        fn write(&self, _: KeptKind, name: &str, _: KeptSize, bytes: &[u8]) {
            self.files.lock().unwrap().insert(name.into(), bytes.into());
            self.counts.lock().unwrap()[0] += 1;
        }

        fn accept(&self, _: KeptKind, _: &str, _: KeptSize, _: &[u8]) {
            self.counts.lock().unwrap()[1] += 1;
        }

        fn reject(&self, _: KeptKind, _: &str) {
            self.counts.lock().unwrap()[2] += 1;
        }
    }

    /// Springs from dof to ground, and masses.
    fn springs(engine: &Native, stiffness: &[f64]) -> [Form; 2] {
        let form = |entry: &dyn Fn(usize) -> f64| {
            let cell = |dof: usize| ElementMatrix {
                dofs: [Some(dof)].into(),
                matrix: [entry(dof)].into(),
                bending: None,
                class: dof,
            };
            engine.form((0..stiffness.len()).map(cell).collect())
        };
        [form(&|dof| stiffness[dof]), form(&|_| 1.0)]
    }

    fn bits(basis: &ModalBasis) -> Vec<u8> {
        to_bytes(basis, 0)
    }

    #[test]
    fn a_basis_comes_back_to_the_bit_and_only_for_its_own_data() {
        let engine = Native::new(40);
        let stiffness: Vec<f64> = (1..=40).map(|k| (k * k) as f64).collect();
        let shelf = Shelf::default();
        let ask = |stiffness: &[f64], range, mechanism| {
            let [k, m] = &springs(&engine, stiffness);
            let key = key(&engine, [k, m], range, mechanism).unwrap();
            let holds = |basis: &ModalBasis| agrees(&engine, [k, m], basis);
            basis_of(&shelf, key, holds, || lowest_basis(&engine, k, m, range, mechanism)).unwrap()
        };
        let counts = || *shelf.counts.lock().unwrap();
        let first = ask(&stiffness, ModeRange::Count(5), false);
        assert_eq!(counts(), [1, 0, 0]);
        assert_eq!(bits(&ask(&stiffness, ModeRange::Count(5), false)), bits(&first));
        assert_eq!(counts(), [1, 1, 0]);

        // One bit of one entry, the last one.
        let mut others = stiffness.clone();
        others[39] = f64::from_bits(others[39].to_bits() + 1);
        ask(&others, ModeRange::Count(5), false);
        ask(&stiffness, ModeRange::Count(4), false);
        ask(&stiffness, ModeRange::UpTo(5.0 / std::f64::consts::TAU), false);
        ask(&stiffness, ModeRange::Count(5), true);
        assert_eq!(counts(), [5, 1, 0]);
    }

    #[test]
    fn any_flipped_bit_and_any_missing_end_is_noticed() {
        let engine = Native::new(6);
        let [k, m] = &springs(&engine, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let compute = || lowest_basis(&engine, k, m, ModeRange::Count(2), false);
        let basis = compute().unwrap();
        let bytes = to_bytes(&basis, 7);
        assert_eq!(bits(&from_bytes(&bytes, 7).unwrap()), bits(&basis));
        assert!(from_bytes(&bytes, 8).is_none(), "of another key");
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(from_bytes(&damaged, 7).is_none(), "bit {bit}");
        }
        assert!((0..bytes.len()).all(|end| from_bytes(&bytes[..end], 7).is_none()));

        let shelf = Shelf::default();
        shelf.files.lock().unwrap().insert(format!("{:032x}", 7), bytes[..100].to_vec());
        let holds = |basis: &ModalBasis| agrees(&engine, [k, m], basis);
        assert_eq!(bits(&basis_of(&shelf, 7, holds, compute).unwrap()), bits(&basis));
        assert_eq!(*shelf.counts.lock().unwrap(), [1, 0, 1]);
        assert_eq!(shelf.files.lock().unwrap()[&format!("{:032x}", 7)], bytes);

        // Wrong numbers with a right checksum are noticed too, in each mode.
        type Change = fn(&mut ModalBasis, usize);
        let changes: [Change; 3] = [
            |basis, j| basis.squares[j] *= 1.3,
            |basis, j| basis.shapes[(j, j)] += 1e-3,
            |basis, j| basis.momenta[(j, j)] += 1e-3,
        ];
        for (change, j) in changes.into_iter().flat_map(|change| [(change, 0), (change, 1)]) {
            let mut wrong = basis.clone();
            change(&mut wrong, j);
            let wrong = from_bytes(&to_bytes(&wrong, 7), 7).unwrap();
            assert!(!agrees(&engine, [k, m], &wrong).unwrap());
        }
    }
}
