//! Modes kept between runs.
//!
//! The modes of a fine mesh cost more than many runs with the modal mass. A [`Store`] keeps them,
//! and the [compliance](super::kept_columns) of the rest of the displacement.
//!
//! The key is a hash of all data that the modes depend on: the contributions of the cells, springs
//! and masses to K and M, the dofs that they act on, and the wanted modes. The hash also covers the
//! bits of the products of both matrices with one vector, which depend on the order of summation
//! and on the registers of the processor. A smaller number of modes is never served from a larger
//! one: the last bits of a mode depend on how many modes are sought.

use super::store::{MODES, Store};
use super::{ModalBasis, ModeRange, lowest_basis};
use crate::error::Result;
use crate::hash::LongHash;
use crate::linalg::{ElementMatrix, Engine, Form, MassModes};
use crate::random::random_vector;
use faer::Mat;
use std::collections::HashSet;
use std::sync::Arc;

/// Version of the kept files, increased whenever their content changes, or the numbers that the
/// same matrices give.
const FORMAT: u32 = 3;

/// Squared angular frequency of the first mode that is left out, and those of all others with shape
/// and momentum.
type Kept = (f64, Vec<(f64, Vec<f64>, Vec<f64>)>);

/// Returns the modes of [`lowest_basis`] and the squared frequency of the next one, from a store if
/// it has them and the engine [repeats](Engine::REPEATS) its results.
///
/// # Errors
/// Returns the errors of [`lowest_basis`].
pub(crate) fn kept_basis<E: Engine>(
    store: Option<Arc<Store>>,
    engine: &E,
    forms: [&Form; 2],
    range: ModeRange,
    mechanism: bool,
) -> Result<(MassModes, f64)> {
    let store = store.filter(|_| E::REPEATS);
    let key = store.as_ref().map(|_| key(engine, forms, range, mechanism)).transpose()?;
    let place = store.zip(key);
    let holds = |kept: &Kept| agrees(engine, forms, kept).unwrap_or(false);
    if let Some((next, modes)) = place.as_ref().and_then(|(store, key)| store.get(MODES, *key, holds)) {
        let (rows, count) = (engine.dofs(), modes.len());
        return Ok((
            MassModes {
                squares: modes.iter().map(|(square, ..)| *square).collect(),
                shapes: Mat::from_fn(rows, count, |i, j| modes[j].1[i]),
                momenta: Mat::from_fn(rows, count, |i, j| modes[j].2[i]),
                key,
            },
            next,
        ));
    }
    let ModalBasis { squares, shapes, momenta, next, .. } = lowest_basis(engine, forms, range, mechanism)?;
    if let Some((store, key)) = place {
        let mode = |j| (squares[j], shapes.col_as_slice(j), momenta.col_as_slice(j));
        let modes: Vec<_> = (0..squares.len()).map(mode).collect();
        store.put(MODES, key, [modes.len(), shapes.nrows()], &(next, modes));
    }
    Ok((MassModes { squares, shapes, momenta, key }, next))
}

/// Largest relative difference of a kept square frequency and the Rayleigh quotient of its shape,
/// and of a kept momentum and the product of mass and shape. Either is rounding.
const AGREES: f64 = 1e-6;

/// Returns whether modes agree with the matrices: `$\phi^T K \phi = \omega^2 \phi^T M \phi$` and unit
/// modal mass for each mode, which costs one product with either matrix.
///
/// The checksum of a file tells only that it is what somebody wrote.
fn agrees<E: Engine>(engine: &E, [stiffness, mass]: [&Form; 2], (next, modes): &Kept) -> Result<bool> {
    let dofs = engine.dofs();
    let mut product = vec![0.0; dofs];
    for (square, shape, momentum) in modes {
        if [shape, momentum].iter().any(|column| column.len() != dofs) {
            return Ok(false);
        }
        let energy = engine.multiply(stiffness, shape, &mut product)?;
        let modal_mass = engine.multiply(mass, shape, &mut product)?;
        let size = product.iter().fold(0.0, |most: f64, entry| most.max(entry.abs()));
        // An eigenvalue of a rigid motion is exactly 0, and its energy is rounding.
        let scale = if *square == 0.0 { next } else { square };
        let close = (energy - square * modal_mass).abs() <= AGREES * scale
            && (modal_mass - 1.0).abs() <= AGREES
            && momentum.iter().zip(&product).all(|(kept, entry)| (kept - entry).abs() <= AGREES * size);
        if !close {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Returns the hash of everything that determines the bits of a basis.
fn key<E: Engine>(engine: &E, forms: [&Form; 2], range: ModeRange, mechanism: bool) -> Result<u128> {
    let mut hash = LongHash::new();
    hash.add(format!("{FORMAT} {} {range:?} {mechanism}", env!("CARGO_PKG_VERSION")).as_bytes());
    let x = random_vector(engine.dofs(), 0);
    let mut product = vec![0.0; engine.dofs()];
    for form in forms {
        if let Form::Cells(cells) = form {
            add_cells(&mut hash, &cells.blocks);
        }
        let value = engine.multiply(form, &x, &mut product)?;
        hash.add_numbers(&product);
        hash.add_numbers(&[value]);
    }
    Ok(hash.0)
}

/// Adds the contributions of cells, with the matrices of each class once.
fn add_cells(hash: &mut LongHash, blocks: &[ElementMatrix]) {
    let mut classes = HashSet::new();
    for ElementMatrix { dofs, matrix, bending, class } in blocks {
        hash.add(format!("{dofs:?} {class:?};").as_bytes());
        if !classes.insert((dofs.len(), *class)) {
            continue;
        }
        hash.add_numbers(matrix);
        if let Some(bending) = bending {
            hash.add_numbers(bending.arms.as_flattened());
            hash.add_numbers(&bending.root);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::store::tests::Shelf;
    use super::*;
    use crate::linalg::Native;

    /// Springs from dof to ground, and masses.
    fn springs(engine: &Native, stiffness: &[f64]) -> [Form; 2] {
        let form = |entry: &dyn Fn(usize) -> f64| {
            let cell = |dof: usize| ElementMatrix {
                dofs: [Some(dof)].into(),
                matrix: [entry(dof)].into(),
                bending: None,
                class: crate::linalg::CellClass::Plate(dof),
            };
            engine.form((0..stiffness.len()).map(cell).collect())
        };
        [form(&|dof| stiffness[dof]), form(&|_| 1.0)]
    }

    /// Returns the bits of all numbers.
    fn bits((MassModes { squares, shapes, momenta, .. }, next): &(MassModes, f64)) -> Vec<u64> {
        let columns = [shapes, momenta].map(|matrix| (0..squares.len()).flat_map(|j| matrix.col_as_slice(j)));
        let numbers = squares.iter().chain(columns.into_iter().flatten()).chain([next]);
        numbers.map(|number| number.to_bits()).collect()
    }

    #[test]
    fn a_basis_comes_back_to_the_bit_and_only_for_its_own_data() {
        let engine = Native::new(40);
        let stiffness: Vec<f64> = (1..=40).map(|k| (k * k) as f64).collect();
        let shelf = Shelf::new("basis");
        let ask = |store, stiffness: &[f64], range, mechanism| {
            let [k, m] = &springs(&engine, stiffness);
            kept_basis(store, &engine, [k, m], range, mechanism).unwrap()
        };
        let kept = |stiffness: &[f64], range, mechanism| {
            bits(&ask(Some(shelf.0.clone()), stiffness, range, mechanism))
        };
        let first = bits(&ask(None, &stiffness, ModeRange::Count(5), false));
        assert_eq!(kept(&stiffness, ModeRange::Count(5), false), first);
        assert!(shelf.said(&["5 of 40 dofs, kept in"]));
        assert_eq!(kept(&stiffness, ModeRange::Count(5), false), first);
        assert!(shelf.said(&["5 of 40 dofs, read from"]));

        // One bit of one entry, the last one.
        let mut others = stiffness.clone();
        others[39] = f64::from_bits(others[39].to_bits() + 1);
        kept(&others, ModeRange::Count(5), false);
        kept(&stiffness, ModeRange::Count(4), false);
        kept(&stiffness, ModeRange::UpTo(5.0 / std::f64::consts::TAU), false);
        kept(&stiffness, ModeRange::Count(5), true);
        assert!(shelf.said(&["kept in"; 4]));
    }

    #[test]
    fn wrong_modes_with_a_right_checksum_are_computed_again() {
        let engine = Native::new(6);
        let [k, m] = &springs(&engine, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let shelf = Shelf::new("wrong");
        let ask = || kept_basis(Some(shelf.0.clone()), &engine, [k, m], ModeRange::Count(2), false).unwrap();
        let first = ask();
        let (key, (bytes, _)) = (first.0.key.unwrap(), shelf.file());
        assert!(shelf.said(&["kept in"]));
        type Change = fn(&mut Kept, usize);
        let changes: [Change; 5] = [
            |(_, modes), j| modes[j].0 *= 1.3,
            |(_, modes), j| modes[j].1[j] += 1e-3,
            |(_, modes), j| modes[j].2[j] += 1e-3,
            |(_, modes), j| modes[j].1.push(0.0),
            |(_, modes), j| modes[j].2.truncate(5),
        ];
        for (change, j) in changes.into_iter().flat_map(|change| [(change, 0), (change, 1)]) {
            let mut wrong = shelf.0.get(MODES, key, |_: &Kept| true).unwrap();
            change(&mut wrong, j);
            shelf.0.put(MODES, key, [2, 6], &wrong);
            shelf.0.take_lines();
            assert_eq!(bits(&ask()), bits(&first));
            assert!(shelf.said(&["damaged; the modes are computed and written again", "kept in"]));
            assert_eq!(shelf.file().0, bytes);
        }
    }
}
