//! Product of the stiffness of congruent parallelograms that a half turn maps onto themselves.
//!
//! A half turn of a uniform cell swaps nodes 0 and 2, and nodes 1 and 3, and keeps its energy. Even
//! deformations e, which it keeps, and odd ones o, which it reverses, have no energy in common: the
//! form of [`Bending`] is a sum of two squares, `$|R d|^2 = |R_e e|^2 + |R_o o|^2$`. With the
//! deflections w, the slopes s and the positions p of the nodes,
//!
//! ```math
//! e = \bigl(w_1 - w_0 + w_3 - w_2,\; s_2 - s_0,\; s_3 - s_1\bigr),
//! ```
//! ```math
//! o = \bigl(w_2 - w_0 - \bar s \cdot (p_2 - p_0),\; w_3 - w_1 - \bar s \cdot (p_3 - p_1),\;
//! s_1 - s_0 + s_3 - s_2\bigr), \qquad \bar s = \tfrac12 (s_0 + s_2),
//! ```
//!
//! all of which vanish for rigid motions. The two roots have 25 entries, where R has 45. They are
//! taken from R, and have its rounding errors.
//!
//! There are no closures in the loops, as in [`super::simd`].

use super::Bending;
use super::lane_values::{Lanes, clear_from, dofs, store};
use nalgebra::DMatrix;
use pulp::Simd;

/// Numbers of even and odd deformations.
const EVEN: usize = 5;
const ODD: usize = 4;

/// Largest amount that counts as rounding: of the energy that an even and an odd deformation have
/// in common, relative to the roots of their own energies, and of the distance of the fourth node
/// from the corner of a parallelogram, relative to its size.
const ROUNDING: f64 = 1e-14;

/// [`Bending`] of eight congruent parallelograms as the sum of two squares.
#[derive(Debug, Clone)]
pub(super) struct Parallelograms {
    /// Halves of `$p_0 - p_2$` and `$p_1 - p_3$`.
    half_diagonals: [[f64; 2]; 2],
    /// Upper triangles of the two roots, row by row.
    even: [f64; EVEN * (EVEN + 1) / 2],
    odd: [f64; ODD * (ODD + 1) / 2],
}

impl Parallelograms {
    /// Divides a form into those of even and odd deformations; `None` where the cell is no
    /// parallelogram or these have energy in common.
    pub fn new(cell: &Bending) -> Option<Parallelograms> {
        let [p1, p2, p3] = *cell.arms.as_slice() else { return None };
        let is_zero = |axis: usize| {
            let size = [p1, p2, p3].iter().fold(0.0, |size: f64, p| size.max(p[0].abs()).max(p[1].abs()));
            (p1[axis] - p2[axis] + p3[axis]).abs() <= ROUNDING * size
        };
        if !(is_zero(0) && is_zero(1)) {
            return None;
        }
        let half_diagonals = [[-0.5 * p2[0], -0.5 * p2[1]], [0.5 * (p1[0] - p3[0]), 0.5 * (p1[1] - p3[1])]];
        let size = EVEN + ODD;
        let root = DMatrix::from_row_slice(size, size, &cell.root);
        let deformations: [_; EVEN + ODD] = std::array::from_fn(|k| deformation(k, half_diagonals));
        let strains = root * DMatrix::from_row_slice(size, size, deformations.as_flattened()).transpose();
        let (even, odd) = (strains.columns(0, EVEN), strains.columns(EVEN, ODD));
        let common = even.transpose() * odd;
        let is_rounding = |(place, energy): (usize, &f64)| {
            let sizes = even.column(place % EVEN).norm() * odd.column(place / EVEN).norm();
            energy.abs() <= ROUNDING * sizes
        };
        common.iter().enumerate().all(is_rounding).then(|| Parallelograms {
            half_diagonals,
            even: root_of(even.into_owned()),
            odd: root_of(odd.into_owned()),
        })
    }

    /// Computes result = A local and returns local^T A local. Beyond the given number of registers,
    /// local is zero.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, simd: S, registers: usize, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        let (local, result) = (&local[..12], &mut result[..12]);
        let [[x_02, y_02], [x_13, y_13]] = self.half_diagonals;
        let half_02 = [simd.splat_f64s(x_02), simd.splat_f64s(y_02)];
        let half_13 = [simd.splat_f64s(x_13), simd.splat_f64s(y_13)];
        let mut form = Lanes::default();
        for k in 0..registers {
            let [first, second, third, fourth] = [
                dofs::<S>(local, 0, k),
                dofs::<S>(local, 1, k),
                dofs::<S>(local, 2, k),
                dofs::<S>(local, 3, k),
            ];
            let zero = simd.splat_f64s(0.0);
            let [mut across_02, mut across_13, mut around] = [[zero; 3]; 3];
            for dof in 0..3 {
                across_02[dof] = simd.sub_f64s(third[dof], first[dof]);
                across_13[dof] = simd.sub_f64s(fourth[dof], second[dof]);
                let (to_1, to_3) =
                    (simd.sub_f64s(second[dof], first[dof]), simd.sub_f64s(fourth[dof], third[dof]));
                around[dof] = simd.add_f64s(to_1, to_3);
            }
            for axis in 0..2 {
                let twice = simd.add_f64s(first[1 + axis], third[1 + axis]);
                across_02[0] = simd.mul_add_f64s(twice, half_02[axis], across_02[0]);
                across_13[0] = simd.mul_add_f64s(twice, half_13[axis], across_13[0]);
            }
            let even = [around[0], across_02[1], across_02[2], across_13[1], across_13[2]];
            let odd = [across_02[0], across_13[0], around[1], around[2]];
            let (even, of_even) = square_product::<S, EVEN>(simd, &self.even, even);
            let (odd, of_odd) = square_product::<S, ODD>(simd, &self.odd, odd);
            *form.register_mut::<S>(k) = simd.add_f64s(of_even, of_odd);
            let around = [even[0], odd[2], odd[3]];
            let across_02 = [odd[0], even[1], even[2]];
            let across_13 = [odd[1], even[3], even[4]];
            let mut forces = [[zero; 3]; 4];
            let mut moments = [zero; 3];
            for axis in 0..2 {
                let of_02 = simd.mul_f64s(half_02[axis], across_02[0]);
                moments[1 + axis] = simd.mul_add_f64s(half_13[axis], across_13[0], of_02);
            }
            for dof in 0..3 {
                let mean = simd.sub_f64s(moments[dof], around[dof]);
                forces[0][dof] = simd.sub_f64s(mean, across_02[dof]);
                forces[1][dof] = simd.sub_f64s(around[dof], across_13[dof]);
                forces[2][dof] = simd.add_f64s(mean, across_02[dof]);
                forces[3][dof] = simd.add_f64s(around[dof], across_13[dof]);
            }
            for node in 0..4 {
                store::<S>(forces[node], result, node, k);
            }
        }
        clear_from(simd, registers, result);
        form
    }
}

/// Returns the deformation of which the even and odd ones are 0 but for number k, as the dofs of
/// nodes 1, 2 and 3 less the rigid motion of node 0.
fn deformation(k: usize, [half_02, half_13]: [[f64; 2]; 2]) -> [f64; 9] {
    let of = |number: usize| f64::from(u8::from(number == k));
    let half_sum = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let (s_2, turn, around) = ([of(1), of(2)], [of(3), of(4)], [of(7), of(8)]);
    let opposite = [-turn[0], -turn[1]];
    let sum = [s_2[0] + around[0], s_2[1] + around[1]];
    let (s_1, s_3) = (half_sum(sum, opposite), half_sum(sum, turn));
    let by_slope = |half: [f64; 2]| s_2[0] * half[0] + s_2[1] * half[1];
    let w_2 = of(5) - by_slope(half_02);
    let difference = of(6) - by_slope(half_13);
    let (w_1, w_3) = (0.5 * (of(0) + w_2 - difference), 0.5 * (of(0) + w_2 + difference));
    [w_1, s_1[0], s_1[1], w_2, s_2[0], s_2[1], w_3, s_3[0], s_3[1]]
}

/// Returns the upper triangular root of the products of some columns, row by row.
fn root_of<const ENTRIES: usize>(columns: DMatrix<f64>) -> [f64; ENTRIES] {
    let size = columns.ncols();
    let root = columns.qr().r();
    let mut places = (0..size).flat_map(|row| (row..size).map(move |column| (row, column)));
    std::array::from_fn(|_| places.next().map_or(0.0, |place| root[place]))
}

/// Returns R^T R v and its scalar product with v, given the upper triangle of R, row by row.
#[inline(always)]
fn square_product<S: Simd, const N: usize>(
    simd: S,
    root: &[f64],
    v: [S::f64s; N],
) -> ([S::f64s; N], S::f64s) {
    let mut rest = &root[..N * (N + 1) / 2];
    let mut forces = [simd.splat_f64s(0.0); N];
    let mut square = forces[0];
    for row in 0..N {
        let (entries, below) = rest.split_at(N - row);
        let mut strain = simd.mul_f64s(simd.splat_f64s(entries[0]), v[row]);
        for column in row + 1..N {
            strain = simd.mul_add_f64s(simd.splat_f64s(entries[column - row]), v[column], strain);
        }
        for column in row..N {
            forces[column] =
                simd.mul_add_f64s(simd.splat_f64s(entries[column - row]), strain, forces[column]);
        }
        square = simd.mul_add_f64s(strain, strain, square);
        rest = below;
    }
    (forces, square)
}

#[cfg(test)]
mod tests {
    use super::super::lane_values::LANES;
    use super::*;
    use crate::linalg::random::number;
    use pulp::{Arch, WithSimd};

    /// Product with cells in so many lanes.
    struct Product<'a>(&'a Parallelograms, &'a [Lanes], &'a mut [Lanes], usize);

    impl WithSimd for Product<'_> {
        type Output = Lanes;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Lanes {
            self.0.apply(simd, self.3.div_ceil(S::F64_LANES), self.1, self.2)
        }
    }

    /// Returns a cell, given the position of its fourth node and the size of the energy that even
    /// and odd deformations have in common. Where that is 0, its form is the sum of two squares.
    fn cell(fourth: [f64; 2], common: f64) -> Bending {
        let arms = vec![[1.1, 0.2], [1.3, 1.1], fourth];
        let entry = |row: usize, column: usize| match (row < EVEN, column < EVEN) {
            _ if row > column => 0.0,
            _ if row == column => 2.0 + number(row),
            (true, false) => common * number(10 * row + column),
            _ => number(10 * row + column),
        };
        let roots = DMatrix::from_fn(9, 9, entry);
        let half = |a: [f64; 2], b: [f64; 2]| [0.5 * (a[0] - b[0]), 0.5 * (a[1] - b[1])];
        let halves = [half([0.0; 2], arms[1]), half(arms[0], arms[2])];
        let columns: [_; 9] = std::array::from_fn(|k| deformation(k, halves));
        let deformations = DMatrix::from_row_slice(9, 9, columns.as_flattened()).transpose();
        let root = (roots * deformations.try_inverse().unwrap()).qr().r();
        Bending { arms, root: root.transpose().as_slice().into() }
    }

    #[test]
    fn products_are_those_of_the_undivided_form() {
        let cell = cell([0.2, 0.9], 0.0);
        let parallelograms = Parallelograms::new(&cell).unwrap();
        for (arch, lanes) in
            [(Arch::Scalar, LANES), (Arch::new(), LANES), (Arch::Scalar, 3), (Arch::new(), 3)]
        {
            let value = |dof: usize, lane: usize| if lane < lanes { number(7 * dof + lane) } else { 0.0 };
            let local: Vec<Lanes> =
                (0..12).map(|dof| Lanes(std::array::from_fn(|lane| value(dof, lane)))).collect();
            let mut result = vec![Lanes([f64::NAN; LANES]); 12];
            let form = arch.dispatch(Product(&parallelograms, &local, &mut result, lanes));
            for lane in 0..LANES {
                let values: Vec<f64> = local.iter().map(|lanes| lanes.0[lane]).collect();
                let forces = cell.product(&values);
                let energy: f64 = forces.iter().zip(&values).map(|(force, value)| force * value).sum();
                let close = |a: f64, b: f64| (a - b).abs() <= 1e-12 * energy;
                assert!(result.iter().zip(&forces).all(|(of, force)| close(of.0[lane], *force)), "{arch:?}");
                assert!(close(form.0[lane], energy), "{arch:?}: {} and {energy}", form.0[lane]);
            }
        }
    }

    #[test]
    fn cells_that_a_half_turn_changes_are_not_divided() {
        assert!(Parallelograms::new(&cell([0.2, 0.9 + 1e-12], 0.0)).is_none(), "no parallelogram");
        assert!(Parallelograms::new(&cell([0.2, 0.9], 1e-12)).is_none(), "energy in common");
        let triangle = Bending { arms: vec![[1.0, 0.0], [0.0, 1.0]], root: vec![1.0; 36] };
        assert!(Parallelograms::new(&triangle).is_none());
    }
}
