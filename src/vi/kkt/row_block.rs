//! Rows of a matrix in blocks, with parts of their magnitudes that cost no product.

use crate::linalg::RowCoupling;
use crate::linalg::vectors::Largest;
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// Largest number of rows in a block without couplings within nodes, whose vectors fit into the
/// first cache together.
const BLOCK: usize = 510;

/// Number of rows of a node.
const NODE: usize = 3;

/// Largest number of lanes of a vector register.
const WIDEST: usize = 8;

/// Number of each row in its node, for as many nodes as the widest register has lanes.
const NUMBERS: [f64; NODE * WIDEST] = {
    let mut numbers = [0.0; NODE * WIDEST];
    let mut row = 0;
    while row < numbers.len() {
        numbers[row] = (row % NODE) as f64;
        row += 1;
    }
    numbers
};

/// Returns the magnitude against which a row is measured: its own, or `floor` times its scale. A
/// row without any magnitude has no residual either.
#[inline(always)]
pub(super) fn raised(magnitude: f64, floor: f64, scale: f64) -> f64 {
    magnitude.max(floor * scale).max(f64::MIN_POSITIVE)
}

/// Subtracts a term of the right-hand side from the residual, and adds its magnitude.
#[inline(always)]
pub(super) fn subtract_term(term: &[f64], residual: &mut [f64], magnitude: &mut [f64]) {
    for ((r, m), b) in residual.iter_mut().zip(magnitude.iter_mut()).zip(term) {
        *r -= b;
        *m += b.abs();
    }
}

/// Successive rows, with their couplings to other dofs.
#[derive(Debug)]
pub(super) struct RowBlock {
    pub rows: Range<usize>,
    couplings: Couplings,
}

#[derive(Debug)]
enum Couplings {
    /// Couplings of successive nodes with three dofs each to their first dofs: the magnitude of
    /// each row, 0 for the first one.
    OfNodes(Vec<f64>),
    /// Couplings of some rows.
    OfRows(Vec<CoupledRow>),
}

/// Row whose dof is coupled to another dof, and the magnitude of this coupling.
#[derive(Debug)]
struct CoupledRow {
    row: u32,
    to: u32,
    magnitude: f64,
}

/// Vectors over all rows of which the magnitudes consist.
#[derive(Clone, Copy)]
pub(super) struct RowTerms<'a> {
    pub x: &'a [f64],
    /// Square roots of the diagonal.
    pub scale: &'a [f64],
    /// Terms of the right-hand side. The second one is empty where there is none.
    pub terms: [&'a [f64]; 2],
}

/// Returns the number of successive nodes from a dof on whose other dofs are coupled to their first
/// ones, given the couplings of all dofs.
fn coupled_nodes(dof: usize, couplings: &[RowCoupling]) -> usize {
    let (nodes, _) = couplings[dof..].as_chunks::<NODE>();
    let couples = |(node, of): &(usize, &[RowCoupling; NODE])| {
        let first = (dof + NODE * node) as u32;
        of[0].magnitude == 0.0 && of[1..].iter().all(|of| of.to == first && of.magnitude > 0.0)
    };
    nodes.iter().enumerate().take_while(couples).count()
}

/// Divides all rows into blocks, given their couplings.
pub(super) fn row_blocks(couplings: &[RowCoupling]) -> Vec<RowBlock> {
    let mut blocks = Vec::<RowBlock>::new();
    let mut dof = 0;
    while dof < couplings.len() {
        let nodes = coupled_nodes(dof, couplings);
        if nodes > 0 {
            let rows = dof..dof + NODE * nodes;
            let magnitudes = couplings[rows.clone()].iter().map(|coupling| coupling.magnitude).collect();
            blocks.push(RowBlock { rows, couplings: Couplings::OfNodes(magnitudes) });
            dof += NODE * nodes;
            continue;
        }
        let RowCoupling { to, magnitude } = couplings[dof];
        let coupled = (magnitude > 0.0).then_some(CoupledRow { row: dof as u32, to, magnitude });
        dof += 1;
        match blocks.last_mut() {
            Some(RowBlock { rows, couplings: Couplings::OfRows(list) }) if rows.len() < BLOCK => {
                rows.end = dof;
                list.extend(coupled);
            }
            _ => {
                let couplings = Couplings::OfRows(coupled.into_iter().collect());
                blocks.push(RowBlock { rows: dof - 1..dof, couplings });
            }
        }
    }
    blocks
}

impl RowBlock {
    /// Returns the magnitude of a row of the block, which consists of its diagonal entry, its
    /// coupling and the terms of the right-hand side.
    pub fn magnitude(&self, of_rows: RowTerms, row: usize) -> f64 {
        let RowTerms { x, scale, terms } = of_rows;
        let (magnitude, to) = match &self.couplings {
            Couplings::OfNodes(magnitudes) => {
                let in_block = row - self.rows.start;
                (magnitudes[in_block], row - in_block % NODE)
            }
            Couplings::OfRows(rows) => {
                let found = rows.binary_search_by_key(&(row as u32), |coupled| coupled.row);
                found.map_or((0.0, row), |place| (rows[place].magnitude, rows[place].to as usize))
            }
        };
        let of_terms: f64 = terms.iter().filter_map(|term| term.get(row)).map(|term| term.abs()).sum();
        scale[row] * (scale[row] * x[row].abs()) + of_terms + magnitude * x[to].abs()
    }
}

/// Subtraction of the terms of the right-hand side from the residual of all blocks. Its result is
/// the largest residual relative to [`RowBlock::magnitude`], raised to a floor.
pub(super) struct RowComparison<'a> {
    pub blocks: &'a [RowBlock],
    pub of_rows: RowTerms<'a>,
    pub floor: f64,
    pub residual: &'a mut [f64],
    /// Work space for one block.
    pub magnitude: &'a mut [f64],
}

impl WithSimd for RowComparison<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let RowComparison { blocks, of_rows, floor, residual, magnitude } = self;
        let mut ratio = Largest::default();
        for RowBlock { rows, couplings } in blocks {
            let residual = &mut residual[rows.clone()];
            match couplings {
                Couplings::OfNodes(couplings) => {
                    let nodes = Nodes { rows, couplings, of_rows, floor };
                    if of_rows.terms[1].is_empty() {
                        nodes.compare::<S, false>(simd, residual, &mut ratio);
                    } else {
                        nodes.compare::<S, true>(simd, residual, &mut ratio);
                    }
                }
                Couplings::OfRows(couplings) => {
                    let magnitude = &mut magnitude[..rows.len()];
                    subtract(of_rows, (rows, couplings), residual, magnitude);
                    for ((r, m), scale) in residual.iter().zip(magnitude).zip(&of_rows.scale[rows.clone()]) {
                        ratio.note(r / raised(*m, floor, *scale));
                    }
                }
            }
        }
        ratio.value()
    }
}

/// Subtracts the terms of the right-hand side from the residual of some rows, and sets their
/// magnitudes.
#[inline(always)]
fn subtract(
    of_rows: RowTerms,
    (rows, couplings): (&Range<usize>, &[CoupledRow]),
    residual: &mut [f64],
    magnitude: &mut [f64],
) {
    let RowTerms { x, scale, terms: [rhs, term] } = of_rows;
    let scale = &scale[rows.clone()];
    for ((m, own), scale) in magnitude.iter_mut().zip(&x[rows.clone()]).zip(scale) {
        *m = scale * (scale * own.abs());
    }
    subtract_term(&rhs[rows.clone()], residual, magnitude);
    if !term.is_empty() {
        subtract_term(&term[rows.clone()], residual, magnitude);
    }
    for CoupledRow { row, to, magnitude: of } in couplings {
        magnitude[*row as usize - rows.start] += of * x[*to as usize].abs();
    }
}

/// Successive nodes whose rows are compared in one pass. There are no closures in its loops, which
/// the compiler would not inline where wider registers are enabled.
struct Nodes<'a> {
    rows: &'a Range<usize>,
    couplings: &'a [f64],
    of_rows: RowTerms<'a>,
    floor: f64,
}

impl Nodes<'_> {
    /// Subtracts the terms of the right-hand side from the residual and takes note of its ratios.
    #[inline(always)]
    fn compare<S: Simd, const HAS_TERM: bool>(&self, simd: S, residual: &mut [f64], ratio: &mut Largest) {
        // Registers begin at the second node, since they read the two dofs before their first row.
        let whole = (self.rows.len() - NODE) / (NODE * S::F64_LANES) * NODE * S::F64_LANES;
        let (first, others) = residual.split_at_mut(NODE);
        let (whole, last) = others.split_at_mut(whole);
        self.compare_rows::<HAS_TERM>(0, first, ratio);
        self.compare_rows::<HAS_TERM>(NODE + whole.len(), last, ratio);
        self.compare_registers::<S, HAS_TERM>(simd, whole, ratio);
    }

    /// Compares some rows of the block one by one.
    #[inline(always)]
    fn compare_rows<const HAS_TERM: bool>(&self, start: usize, residual: &mut [f64], ratio: &mut Largest) {
        let RowTerms { x, scale, terms: [rhs, term] } = self.of_rows;
        for (row, r) in residual.iter_mut().enumerate() {
            let (in_block, number) = (start + row, row % NODE);
            let place = self.rows.start + in_block;
            let (scale, b) = (scale[place], rhs[place]);
            let mut m = scale * (scale * x[place].abs()) + b.abs();
            *r -= b;
            if HAS_TERM {
                *r -= term[place];
                m += term[place].abs();
            }
            m += self.couplings[in_block] * x[place - number].abs();
            ratio.note(*r / raised(m, self.floor, scale));
        }
    }

    /// Compares the rows from the second node on, which fill whole registers.
    #[inline(always)]
    fn compare_registers<S: Simd, const HAS_TERM: bool>(
        &self,
        simd: S,
        residual: &mut [f64],
        ratio: &mut Largest,
    ) {
        let RowTerms { x, scale, terms: [rhs, term] } = self.of_rows;
        let start = self.rows.start + NODE;
        let rows = start..start + residual.len();
        let (residual, _) = S::as_mut_simd_f64s(residual);
        let registers = residual.len();
        let (x_0, _) = S::as_simd_f64s(&x[rows.clone()]);
        let (x_1, _) = S::as_simd_f64s(&x[start - 1..rows.end - 1]);
        let (x_2, _) = S::as_simd_f64s(&x[start - 2..rows.end - 2]);
        let (scale, _) = S::as_simd_f64s(&scale[rows.clone()]);
        let (term, _) = S::as_simd_f64s(if HAS_TERM { &term[rows.clone()] } else { &rhs[rows.clone()] });
        let (rhs, _) = S::as_simd_f64s(&rhs[rows]);
        let (couplings, _) = S::as_simd_f64s(&self.couplings[NODE..]);
        let [x_0, x_1, x_2, scale] =
            [&x_0[..registers], &x_1[..registers], &x_2[..registers], &scale[..registers]];
        let [rhs, term, couplings] = [&rhs[..registers], &term[..registers], &couplings[..registers]];
        let (numbers, _) = S::as_simd_f64s(&NUMBERS);
        let is_second = [
            simd.less_than_f64s(numbers[0], simd.splat_f64s(1.5)),
            simd.less_than_f64s(numbers[1], simd.splat_f64s(1.5)),
            simd.less_than_f64s(numbers[2], simd.splat_f64s(1.5)),
        ];
        let (floor, least) = (simd.splat_f64s(self.floor), simd.splat_f64s(f64::MIN_POSITIVE));
        // Magnitudes order like their bits, with NaN last.
        let mut largest = [simd.splat_i64s(0); NODE];
        for group in 0..registers / NODE {
            for part in 0..NODE {
                let k = NODE * group + part;
                let own = simd.mul_f64s(scale[k], simd.abs_f64s(x_0[k]));
                let mut m = simd.add_f64s(simd.mul_f64s(scale[k], own), simd.abs_f64s(rhs[k]));
                let mut r = simd.sub_f64s(residual[k], rhs[k]);
                if HAS_TERM {
                    m = simd.add_f64s(m, simd.abs_f64s(term[k]));
                    r = simd.sub_f64s(r, term[k]);
                }
                // The first row of a node has no coupling, whatever it is multiplied with.
                let first = simd.abs_f64s(simd.select_f64s(is_second[part], x_1[k], x_2[k]));
                m = simd.add_f64s(m, simd.mul_f64s(couplings[k], first));
                residual[k] = r;
                let raised = simd.max_f64s(simd.max_f64s(m, simd.mul_f64s(floor, scale[k])), least);
                let of_row = simd.abs_f64s(simd.div_f64s(r, raised));
                largest[part] = simd.max_i64s(largest[part], simd.transmute_i64s_f64s(of_row));
            }
        }
        let largest = simd.max_i64s(largest[0], simd.max_i64s(largest[1], largest[2]));
        let mut lanes = [0.0; WIDEST];
        let (registers, _) = S::as_mut_simd_f64s(&mut lanes);
        registers[0] = simd.transmute_f64s_i64s(largest);
        for lane in lanes {
            ratio.note(lane);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::random::number;
    use pulp::Arch;

    /// Nodes between rows of other kinds are compared as row by row, whatever the registers hold,
    /// and a NaN among the forces on them is found.
    #[test]
    fn rows_are_compared_with_their_magnitudes() {
        for nodes in [1, 2, 3, 9, 17, 34] {
            let rows = 4 + 3 * nodes + 2;
            let coupling = |row: usize| match row {
                1 => RowCoupling { to: rows as u32 - 1, magnitude: 3.0 },
                row if row < 4 || row >= 4 + 3 * nodes || (row - 4) % 3 == 0 => RowCoupling::default(),
                row => RowCoupling { to: (row - (row - 4) % 3) as u32, magnitude: 2.0 + number(row) },
            };
            let couplings: Vec<RowCoupling> = (0..rows).map(coupling).collect();
            let blocks = row_blocks(&couplings);
            assert_eq!(blocks.iter().map(|block| block.rows.len()).collect::<Vec<_>>(), [4, 3 * nodes, 2]);
            let vector = |seed: usize| (0..rows).map(|row| number(seed + row)).collect::<Vec<f64>>();
            let (x, rhs, more) = (vector(100), vector(300), vector(500));
            let scale: Vec<f64> = vector(700).iter().map(|entry| 1.5 + entry).collect();
            for (term, spoilt) in [(&[][..], false), (&more, false), (&more, true)] {
                let of_rows = RowTerms { x: &x, scale: &scale, terms: [&rhs, term] };
                let mut product = vector(900);
                if spoilt {
                    product[4 + 3 * nodes - 1] = f64::NAN;
                }
                let left = |row: usize| product[row] - rhs[row] - term.get(row).unwrap_or(&0.0);
                let magnitude = |row: usize| {
                    let RowCoupling { to, magnitude } = couplings[row];
                    let of_terms = rhs[row].abs() + term.get(row).map_or(0.0, |term| term.abs());
                    scale[row].powi(2) * x[row].abs() + of_terms + magnitude * x[to as usize].abs()
                };
                let ratios = (0..rows).map(|row| left(row).abs() / magnitude(row).max(2.0 * scale[row]));
                let largest = ratios.fold(0.0, f64::max);
                for arch in [Arch::Scalar, Arch::new()] {
                    let (mut residual, mut work) = (product.clone(), vec![0.0; rows]);
                    let ratio = arch.dispatch(RowComparison {
                        blocks: &blocks,
                        of_rows,
                        floor: 2.0,
                        residual: &mut residual,
                        magnitude: &mut work,
                    });
                    assert_eq!(ratio.is_nan(), spoilt);
                    assert!(spoilt || (ratio / largest - 1.0).abs() < 1e-14, "{nodes}: {ratio} {largest}");
                    for (row, residual) in residual.iter().enumerate() {
                        assert!(spoilt || (residual - left(row)).abs() < 1e-15);
                    }
                }
                for block in &blocks {
                    for row in block.rows.clone() {
                        assert!((block.magnitude(of_rows, row) / magnitude(row) - 1.0).abs() < 1e-14);
                    }
                }
            }
        }
    }
}
