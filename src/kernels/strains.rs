//! Product of the stiffness of plate elements, for eight cells at once.
//!
//! The local matrix of a quadrilateral has 144 entries per cell, its root 45. All strains of the
//! cells are computed first, and then their forces node by node: neither takes more than 16 vector
//! registers, so that only dofs, root and forces pass through memory.
//!
//! There are no closures in the loops, as in [`super::simd`].

use super::Bending;
use super::lane_values::{LANES, Lanes, dofs, store};
use pulp::Simd;

/// [`Bending`] of eight cells.
#[derive(Debug, Clone)]
pub(crate) enum Strains {
    Triangles(Cells<2>),
    Quadrilaterals(Cells<3>),
}

/// [`Bending`] of eight cells with so many nodes after the first.
#[derive(Debug, Clone)]
pub(crate) struct Cells<const NODES: usize> {
    arms: [[Lanes; 2]; NODES],
    /// Blocks of the roots R on the diagonal and above, row by row, each for the dofs of two nodes.
    root: Vec<Block>,
}

/// Block of three rows and columns, column by column.
type Block = [[Lanes; 3]; 3];

impl Strains {
    /// Interleaves the representations of some cells with equally many nodes; `None` if these are
    /// neither three nor four.
    pub fn new(cells: [&Bending; LANES]) -> Option<Strains> {
        match cells[0].arms.len() {
            2 => Some(Strains::Triangles(Cells::new(cells))),
            3 => Some(Strains::Quadrilaterals(Cells::new(cells))),
            _ => None,
        }
    }

    /// Computes result = A local and returns local^T A local.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, simd: S, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        match self {
            Strains::Triangles(cells) => cells.apply(simd, local, result),
            Strains::Quadrilaterals(cells) => cells.apply(simd, local, result),
        }
    }
}

impl<const NODES: usize> Cells<NODES> {
    fn new(cells: [&Bending; LANES]) -> Self {
        let arm = |node: usize| [0, 1].map(|axis| Lanes(cells.map(|cell| cell.arms[node][axis])));
        let entry = |place: usize| Lanes(cells.map(|cell| cell.root[place]));
        let block = |row: usize, column: usize| {
            [0, 1, 2].map(|j| [0, 1, 2].map(|i| entry((3 * row + i) * 3 * NODES + 3 * column + j)))
        };
        let pairs = (0..NODES).flat_map(|row| (row..NODES).map(move |column| (row, column)));
        let root = pairs.map(|(row, column)| block(row, column)).collect();
        Cells { arms: std::array::from_fn(arm), root }
    }

    /// Computes result = A local and returns local^T A local.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        square_product(simd, &self.root, &self.arms, local, result)
    }
}

/// Computes result = A local and returns local^T A local, for cells with some nodes after the
/// first. This is the inner loop of every step, and the compiler unrolls all of it.
#[inline(always)]
fn square_product<S: Simd, const NODES: usize>(
    simd: S,
    root: &[Block],
    arms: &[[Lanes; 2]; NODES],
    local: &[Lanes],
    result: &mut [Lanes],
) -> Lanes {
    // Known lengths spare a check of each index.
    let root = &root[..NODES * (NODES + 1) / 2];
    let (local, result) = (&local[..3 * NODES + 3], &mut result[..3 * NODES + 3]);
    let mut form = Lanes::default();
    for k in 0..LANES / S::F64_LANES {
        let first = dofs::<S>(local, 0, k);
        let mut deformation = [first; NODES];
        for node in 0..NODES {
            let arm = [arms[node][0].register::<S>(k), arms[node][1].register::<S>(k)];
            deformation[node] = without_rigid_motion(simd, dofs::<S>(local, node + 1, k), first, arm);
        }
        let zero = [simd.splat_f64s(0.0); 3];
        let mut strains = [zero; NODES];
        let mut square = zero[0];
        for row in 0..NODES {
            for column in row..NODES {
                let block = &root[place::<NODES>(row, column)];
                add_product(simd, k, block, &deformation[column], &mut strains[row]);
            }
            for strain in strains[row] {
                square = simd.mul_add_f64s(strain, strain, square);
            }
        }
        let mut balance = zero;
        for column in 0..NODES {
            let mut force = zero;
            for row in 0..=column {
                let block = &root[place::<NODES>(row, column)];
                add_transposed_product(simd, k, block, &strains[row], &mut force);
            }
            let arm = [arms[column][0].register::<S>(k), arms[column][1].register::<S>(k)];
            add_reaction(simd, force, arm, &mut balance);
            store::<S>(force, result, column + 1, k);
        }
        store::<S>(balance, result, 0, k);
        S::as_mut_simd_f64s(&mut form.0).0[k] = square;
    }
    form
}

/// Returns the place of a block of a root for some nodes.
#[inline(always)]
fn place<const NODES: usize>(row: usize, column: usize) -> usize {
    row * NODES - row * row.saturating_sub(1) / 2 + column - row
}

/// Returns the dofs of a node less the rigid motion of the first node, by differences of nearby
/// values.
#[inline(always)]
fn without_rigid_motion<S: Simd>(
    simd: S,
    [w, w_x, w_y]: [S::f64s; 3],
    [first, first_x, first_y]: [S::f64s; 3],
    [x, y]: [S::f64s; 2],
) -> [S::f64s; 3] {
    let tilt = simd.add_f64s(simd.mul_f64s(first_x, x), simd.mul_f64s(first_y, y));
    let w = simd.sub_f64s(simd.sub_f64s(w, first), tilt);
    [w, simd.sub_f64s(w_x, first_x), simd.sub_f64s(w_y, first_y)]
}

/// Adds the force on the first node that balances that on another one, as the transpose of
/// [`without_rigid_motion`].
#[inline(always)]
fn add_reaction<S: Simd>(simd: S, force: [S::f64s; 3], [x, y]: [S::f64s; 2], balance: &mut [S::f64s; 3]) {
    let moment_x = simd.add_f64s(force[1], simd.mul_f64s(force[0], x));
    let moment_y = simd.add_f64s(force[2], simd.mul_f64s(force[0], y));
    balance[0] = simd.sub_f64s(balance[0], force[0]);
    balance[1] = simd.sub_f64s(balance[1], moment_x);
    balance[2] = simd.sub_f64s(balance[2], moment_y);
}

/// Adds the product of a block to some sums, for the cells in a register.
#[inline(always)]
fn add_product<S: Simd>(
    simd: S,
    register: usize,
    block: &Block,
    values: &[S::f64s; 3],
    sums: &mut [S::f64s; 3],
) {
    for column in 0..3 {
        for row in 0..3 {
            let entry = block[column][row].register::<S>(register);
            sums[row] = simd.mul_add_f64s(entry, values[column], sums[row]);
        }
    }
}

/// Adds the product of the transpose of a block to some sums, for the cells in a register.
#[inline(always)]
fn add_transposed_product<S: Simd>(
    simd: S,
    register: usize,
    block: &Block,
    values: &[S::f64s; 3],
    sums: &mut [S::f64s; 3],
) {
    for row in 0..3 {
        for column in 0..3 {
            let entry = block[column][row].register::<S>(register);
            sums[column] = simd.mul_add_f64s(entry, values[row], sums[column]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::number;
    use pulp::{Arch, WithSimd};

    struct Product<'a>(&'a Strains, &'a [Lanes], &'a mut [Lanes]);

    impl WithSimd for Product<'_> {
        type Output = Lanes;

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> Lanes {
            self.0.apply(simd, self.1, self.2)
        }
    }

    fn bending(nodes: usize, seed: usize) -> Bending {
        let size = 3 * nodes;
        let arm = |node: usize| [number(seed + node), number(seed + node + 50)];
        let entry = |place: usize| if place / size > place % size { 0.0 } else { number(seed + place + 100) };
        Bending { arms: (0..nodes).map(arm).collect(), root: (0..size * size).map(entry).collect() }
    }

    /// Cells side by side have the products that each has alone, with any vector registers, whether
    /// they share a root or not.
    #[test]
    fn products_are_those_of_single_cells() {
        for (nodes, of_each) in [(2, 0), (3, 0), (2, 1000), (3, 1000)] {
            let cells: [Bending; LANES] = std::array::from_fn(|lane| bending(nodes, lane * of_each));
            let strains = Strains::new(cells.each_ref()).unwrap();
            let local: Vec<Lanes> = (0..3 * nodes + 3)
                .map(|dof| Lanes(std::array::from_fn(|lane| number(7 * dof + lane))))
                .collect();
            for arch in [Arch::Scalar, Arch::new()] {
                let mut result = vec![Lanes::default(); local.len()];
                let form = arch.dispatch(Product(&strains, &local, &mut result));
                for (lane, cell) in cells.iter().enumerate() {
                    let values: Vec<f64> = local.iter().map(|lanes| lanes.0[lane]).collect();
                    let forces = cell.product(&values);
                    let energy: f64 = forces.iter().zip(&values).map(|(force, value)| force * value).sum();
                    let close = |a: f64, b: f64| (a - b).abs() <= 1e-12;
                    assert!(
                        result.iter().zip(&forces).all(|(lanes, force)| close(lanes.0[lane], *force)),
                        "{arch:?}"
                    );
                    assert!(close(form.0[lane], energy), "{arch:?}: {} and {energy}", form.0[lane]);
                }
            }
        }
    }
}
