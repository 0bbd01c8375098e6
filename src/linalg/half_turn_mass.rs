//! Product of the singular mass of quadrilaterals that a half turn maps onto themselves, and of
//! pairs of triangles that it exchanges, for eight of them at once.
//!
//! A half turn swaps nodes 0 and 2, and nodes 1 and 3, and changes the signs of the slopes. With
//! its even part e and its odd part o, the row of B of a triangle is e + o, and that of the other
//! one e - o. Both have the same mass c, so that
//!
//! ```math
//! M = \tfrac1c (e + o)(e + o)^T + \tfrac1c (e - o)(e - o)^T = \tfrac2c \bigl(e\,e^T + o\,o^T\bigr),
//! ```
//!
//! and the row of a quadrilateral is even, `$M = \tfrac1c\,e\,e^T$`. Each part has half as many
//! entries as the row.
//!
//! There are no closures in the loops, as in [`super::simd`].

use super::SingularMassCell;
use super::joined::Unit;
use super::lane_values::{LANES, Lanes, clear_from, dofs, store};
use pulp::Simd;

/// Number of dofs of a unit, and of the entries of a part.
const SIZE: usize = 12;
const HALF: usize = SIZE / 2;

/// Largest difference of two masses, relative to them, or of two entries of rows, relative to the
/// largest one of their kind, that counts as rounding.
const ROUNDING: f64 = 1e-14;

/// Parts of the rows of eight units: entries of the deflections and slopes of nodes 0 and 1.
#[derive(Debug, Clone)]
pub(super) struct HalfTurnMass {
    even: [Lanes; HALF],
    /// Odd parts; `None` for quadrilaterals.
    odd: Option<[Lanes; HALF]>,
    /// Factors of the products, 1 / c or 2 / c.
    factors: Lanes,
}

/// Returns the sign of a half-turned dof: slopes are reversed.
fn sign(dof: usize) -> f64 {
    if dof.is_multiple_of(3) { 1.0 } else { -1.0 }
}

/// Returns the entry of a half-turned row at a dof.
fn half_turned(row: &[f64], dof: usize) -> f64 {
    sign(dof) * row[(dof + HALF) % SIZE]
}

impl HalfTurnMass {
    /// Takes the rows of B apart; `None` where a half turn does not map the units onto themselves.
    pub fn new(units: [&Unit; LANES], rows: &[SingularMassCell]) -> Option<HalfTurnMass> {
        if units[0].dofs.len() != SIZE {
            return None;
        }
        let mut parts = [[Lanes::default(); HALF]; 2];
        let mut factors = Lanes::default();
        let is_pair = units[0].second.is_some();
        for (lane, unit) in units.into_iter().enumerate() {
            let second = unit.second.map_or(unit.cell, |(second, _)| second);
            let [row, other] = [unit.cell, second].map(|cell| unit.expanded(cell, &rows[cell].row));
            let [mass, of_other] = [unit.cell, second].map(|cell| rows[cell].mass);
            let size =
                |kind: usize| row.iter().skip(kind).step_by(3).fold(0.0, |size: f64, b| size.max(b.abs()));
            let sizes = [size(0), size(1).max(size(2))];
            let is_turned = |dof: usize| {
                let size = sizes[usize::from(!dof.is_multiple_of(3))];
                (row[dof] - half_turned(&other, dof)).abs() <= ROUNDING * size
            };
            if (mass - of_other).abs() > ROUNDING * mass || !(0..SIZE).all(is_turned) {
                return None;
            }
            for dof in 0..HALF {
                let mean = |dof: usize| 0.5 * (row[dof] + half_turned(&other, dof));
                let (own, turned) = (mean(dof), sign(dof) * mean(dof + HALF));
                parts[0][dof].0[lane] = 0.5 * (own + turned);
                parts[1][dof].0[lane] = 0.5 * (own - turned);
            }
            factors.0[lane] = if is_pair { 2.0 } else { 1.0 } / mass;
        }
        let [even, odd] = parts;
        Some(HalfTurnMass { even, odd: is_pair.then_some(odd), factors })
    }

    /// Computes result = scale M local and returns local^T M local. Beyond the given number of
    /// registers, local is zero.
    #[inline(always)]
    pub fn apply<S: Simd>(
        &self,
        simd: S,
        registers: usize,
        scale: f64,
        local: &[Lanes],
        result: &mut [Lanes],
    ) -> Lanes {
        let (local, result) = (&local[..SIZE], &mut result[..SIZE]);
        let mut form = Lanes::default();
        let scale = simd.splat_f64s(scale);
        for k in 0..registers {
            let factor = self.factors.register::<S>(k);
            let (first, second) = (dofs::<S>(local, 0, k), dofs::<S>(local, 1, k));
            let (third, fourth) = (dofs::<S>(local, 2, k), dofs::<S>(local, 3, k));
            let [mut even_02, mut even_13, mut odd_02, mut odd_13] = [first; 4];
            even_02[0] = simd.add_f64s(first[0], third[0]);
            even_13[0] = simd.add_f64s(second[0], fourth[0]);
            for slope in 1..3 {
                even_02[slope] = simd.sub_f64s(first[slope], third[slope]);
                even_13[slope] = simd.sub_f64s(second[slope], fourth[slope]);
            }
            let momentum = product::<S>(simd, k, &self.even, even_02, even_13);
            let velocity = simd.mul_f64s(factor, momentum);
            *form.register_mut::<S>(k) = simd.mul_f64s(momentum, velocity);
            let (even_02, even_13) = spread::<S>(simd, k, &self.even, simd.mul_f64s(scale, velocity));
            let Some(odd) = &self.odd else {
                let zero = simd.splat_f64s(0.0);
                let (mut opposite_02, mut opposite_13) = (even_02, even_13);
                for slope in 1..3 {
                    opposite_02[slope] = simd.sub_f64s(zero, even_02[slope]);
                    opposite_13[slope] = simd.sub_f64s(zero, even_13[slope]);
                }
                store::<S>(even_02, result, 0, k);
                store::<S>(even_13, result, 1, k);
                store::<S>(opposite_02, result, 2, k);
                store::<S>(opposite_13, result, 3, k);
                continue;
            };
            odd_02[0] = simd.sub_f64s(first[0], third[0]);
            odd_13[0] = simd.sub_f64s(second[0], fourth[0]);
            for slope in 1..3 {
                odd_02[slope] = simd.add_f64s(first[slope], third[slope]);
                odd_13[slope] = simd.add_f64s(second[slope], fourth[slope]);
            }
            let momentum = product::<S>(simd, k, odd, odd_02, odd_13);
            let velocity = simd.mul_f64s(factor, momentum);
            let form = form.register_mut::<S>(k);
            *form = simd.mul_add_f64s(momentum, velocity, *form);
            let (odd_02, odd_13) = spread::<S>(simd, k, odd, simd.mul_f64s(scale, velocity));
            let (own, opposite) = sum_and_half_turn::<S>(simd, even_02, odd_02);
            store::<S>(own, result, 0, k);
            store::<S>(opposite, result, 2, k);
            let (own, opposite) = sum_and_half_turn::<S>(simd, even_13, odd_13);
            store::<S>(own, result, 1, k);
            store::<S>(opposite, result, 3, k);
        }
        clear_from(simd, registers, result);
        form
    }
}

/// Returns the product of a part with the values of nodes 0 and 1, for the units in a register.
#[inline(always)]
fn product<S: Simd>(
    simd: S,
    k: usize,
    part: &[Lanes; HALF],
    first: [S::f64s; 3],
    second: [S::f64s; 3],
) -> S::f64s {
    // Two sums do not wait for each other.
    let mut of_first = simd.mul_f64s(part[0].register::<S>(k), first[0]);
    let mut of_second = simd.mul_f64s(part[3].register::<S>(k), second[0]);
    for dof in 1..3 {
        of_first = simd.mul_add_f64s(part[dof].register::<S>(k), first[dof], of_first);
        of_second = simd.mul_add_f64s(part[3 + dof].register::<S>(k), second[dof], of_second);
    }
    simd.add_f64s(of_first, of_second)
}

/// Returns the products of a velocity with a part, for nodes 0 and 1 of the units in a register.
#[inline(always)]
fn spread<S: Simd>(
    simd: S,
    k: usize,
    part: &[Lanes; HALF],
    velocity: S::f64s,
) -> ([S::f64s; 3], [S::f64s; 3]) {
    let mut forces = ([velocity; 3], [velocity; 3]);
    for dof in 0..3 {
        forces.0[dof] = simd.mul_f64s(part[dof].register::<S>(k), velocity);
        forces.1[dof] = simd.mul_f64s(part[3 + dof].register::<S>(k), velocity);
    }
    forces
}

/// Returns the forces on a node and on the opposite node, to which a half turn moves it, given the
/// even and odd parts of the forces on the first.
#[inline(always)]
fn sum_and_half_turn<S: Simd>(
    simd: S,
    even: [S::f64s; 3],
    odd: [S::f64s; 3],
) -> ([S::f64s; 3], [S::f64s; 3]) {
    let (mut own, mut opposite) = (even, even);
    own[0] = simd.add_f64s(even[0], odd[0]);
    opposite[0] = simd.sub_f64s(even[0], odd[0]);
    for slope in 1..3 {
        own[slope] = simd.add_f64s(even[slope], odd[slope]);
        opposite[slope] = simd.sub_f64s(odd[slope], even[slope]);
    }
    (own, opposite)
}

#[cfg(test)]
mod tests {
    use super::super::joined::{Cell, units};
    use super::*;
    use crate::linalg::random::number;
    use pulp::{Arch, WithSimd};

    /// Product with units in so many lanes.
    struct Product<'a>(&'a HalfTurnMass, &'a [Lanes], &'a mut [Lanes], usize);

    impl WithSimd for Product<'_> {
        type Output = Lanes;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Lanes {
            self.0.apply(simd, self.3.div_ceil(S::F64_LANES), 3.0, self.1, self.2)
        }
    }

    /// Returns the row with the entries of these nodes of a half-turned one.
    fn turned(row: &[f64], nodes: &[usize]) -> Vec<f64> {
        nodes.iter().flat_map(|node| (0..3).map(move |k| half_turned(row, 3 * node + k))).collect()
    }

    /// Returns eight quadrilaterals, or pairs of triangles, with their rows, of which the first one
    /// of the last unit is changed a little.
    fn cells(pairs: bool, change: f64) -> (Vec<Cell>, Vec<SingularMassCell>) {
        let (mut cells, mut rows) = (Vec::<Cell>::new(), Vec::new());
        for unit in 0..LANES {
            let any: Vec<f64> = (0..SIZE).map(|dof| number(20 * unit + dof)).collect();
            let of_nodes: Vec<(Vec<usize>, Vec<f64>)> = if pairs {
                let padded: Vec<f64> = any[..9].iter().copied().chain([0.0; 3]).collect();
                vec![(vec![0, 1, 2], any[..9].to_vec()), (vec![0, 2, 3], turned(&padded, &[0, 2, 3]))]
            } else {
                let even = any.iter().zip(turned(&any, &[0, 1, 2, 3])).map(|(own, turned)| own + turned);
                vec![(vec![0, 1, 2, 3], even.collect())]
            };
            for (class, (nodes, mut row)) in of_nodes.into_iter().enumerate() {
                row[4] += if unit == LANES - 1 && class == 0 { change } else { 0.0 };
                let dofs =
                    nodes.iter().flat_map(|node| (0..3).map(move |k| Some(SIZE * unit + 3 * node + k)));
                cells.push((dofs.collect(), class));
                let mass = 2.0 + number(unit);
                rows.push(SingularMassCell {
                    dofs: cells[cells.len() - 1].0.clone(),
                    row: row.into(),
                    mass,
                    class,
                });
            }
        }
        (cells, rows)
    }

    /// Returns the mass of the units.
    fn mass(cells: &[Cell], rows: &[SingularMassCell]) -> Option<HalfTurnMass> {
        let units = units(cells, usize::MAX);
        HalfTurnMass::new(std::array::from_fn(|lane| &units[lane]), rows)
    }

    #[test]
    fn products_are_those_of_the_rows() {
        for (pairs, lanes) in [(false, LANES), (true, LANES), (false, 3), (true, 3)] {
            let (cells, rows) = cells(pairs, 0.0);
            let mass = mass(&cells, &rows).unwrap();
            assert_eq!(mass.odd.is_some(), pairs);
            let value = |dof: usize, lane: usize| if lane < lanes { number(7 * dof + lane) } else { 0.0 };
            let local: Vec<Lanes> =
                (0..SIZE).map(|dof| Lanes(std::array::from_fn(|lane| value(dof, lane)))).collect();
            let (mut expected, mut energies) = ([[0.0; LANES]; SIZE], [0.0; LANES]);
            for SingularMassCell { dofs, row, mass, .. } in &rows {
                let lane = dofs[0].unwrap() / SIZE;
                let values = || dofs.iter().map(|dof| dof.unwrap() % SIZE);
                let momentum: f64 = values().zip(&**row).map(|(dof, b)| b * local[dof].0[lane]).sum();
                energies[lane] += momentum * momentum / mass;
                values().zip(&**row).for_each(|(dof, b)| expected[dof][lane] += 3.0 * b * momentum / mass);
            }
            for arch in [Arch::Scalar, Arch::new()] {
                let mut result = vec![Lanes([f64::NAN; LANES]); SIZE];
                let form = arch.dispatch(Product(&mass, &local, &mut result, lanes));
                for lane in 0..LANES {
                    assert!((form.0[lane] - energies[lane]).abs() <= 1e-14 * (1.0 + energies[lane]));
                    let close = |(of, expected): (&Lanes, &[f64; LANES])| {
                        (of.0[lane] - expected[lane]).abs() <= 1e-13
                    };
                    assert!(result.iter().zip(&expected).all(close), "{arch:?}, {pairs}");
                }
            }
        }
    }

    #[test]
    fn units_that_a_half_turn_changes_keep_their_rows() {
        for pairs in [false, true] {
            let (cells, rows) = cells(pairs, 1e-12);
            assert!(mass(&cells, &rows).is_none(), "{pairs}");
        }
    }
}
