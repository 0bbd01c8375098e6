//! Symmetric forms that are stored cell by cell and applied to eight cells at once.
//!
//! The local matrices of a batch are interleaved, one cell per lane, in a *panel*. Congruent cells
//! share one panel, so that a regular mesh reads its stiffness from the cache.

use super::ElementMatrix;
use super::batch::{Batch, Batches};
use super::lane_values::{LANES, Lanes, interleave};
use super::strains::Strains;
use super::workspace::Room;
use pulp::Simd;
use std::rc::Rc;

/// Local matrices of eight cells.
#[derive(Debug, Clone)]
pub(crate) struct Panel {
    matrix: Vec<Lanes>,
    /// Factored representation that is applied instead of the matrix, if there is one.
    strains: Option<Strains>,
    /// Whether all cells are springs between two dofs, k (a - b)^2 / 2. Their product is computed
    /// from the difference, which a stiff spring leaves much smaller than a and b.
    is_difference: bool,
}

impl Panel {
    fn new(cells: [&ElementMatrix; LANES]) -> Panel {
        let matrices = cells.map(|cell| &*cell.matrix);
        let bending = cells.map(|cell| cell.bending.as_deref());
        Panel {
            matrix: interleave(&matrices),
            // Either all cells of a panel have it or none has.
            strains: bending[0].and_then(|first| Strains::new(bending.map(|cell| cell.unwrap_or(first)))),
            is_difference: matrices.iter().all(|matrix| is_difference(matrix)),
        }
    }

    /// Computes result = A local and returns local^T A local.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, simd: S, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        if let Some(strains) = &self.strains {
            return strains.apply(simd, local, result);
        }
        if self.is_difference {
            let difference = local[0] - local[1];
            result[0] = self.matrix[0] * difference;
            result[1] = self.matrix[1] * difference;
            return result[0] * difference;
        }
        matrix_product::<S, false>(simd, &self.matrix, local, result);
        let mut form = Lanes::default();
        for (value, force) in local.iter().zip(result) {
            form += *value * *force;
        }
        form
    }

    /// Adds scale A local to y and scale |A| |local| to m.
    #[inline(always)]
    pub fn add_with_magnitude<S: Simd>(&self, simd: S, scale: f64, local: &[Lanes], room: Room) {
        let Room { work, result, y, m } = room;
        for (work, value) in work.iter_mut().zip(local) {
            work.set_to_scaled_abs(simd, scale, value);
        }
        matrix_product::<S, true>(simd, &self.matrix, work, result);
        for (m, term) in m.iter_mut().zip(&*result) {
            m.add_scaled(simd, 1.0, term);
        }
        self.apply(simd, local, result);
        for (y, term) in y.iter_mut().zip(result) {
            y.add_scaled(simd, scale, term);
        }
    }
}

/// Returns whether a local matrix belongs to a spring between two dofs, (k, -k, -k, k).
fn is_difference(matrix: &[f64]) -> bool {
    matches!(*matrix, [a, b, c, d] if a == d && b == -a && c == b)
}

/// Computes result = matrix local, or |matrix| local, lane by lane.
#[inline(always)]
fn matrix_product<S: Simd, const MAGNITUDE: bool>(
    simd: S,
    matrix: &[Lanes],
    local: &[Lanes],
    result: &mut [Lanes],
) {
    let width = local.len();
    // Several rows at once hide the latency of the sums.
    let (sixes, others) = result.as_chunks_mut::<6>();
    let (triples, singles) = others.as_chunks_mut::<3>();
    let mut rest = matrix;
    for result in sixes {
        let (rows, below) = rest.split_at(6 * width);
        rows_product::<S, 6, MAGNITUDE>(simd, rows, local, result);
        rest = below;
    }
    for result in triples {
        let (rows, below) = rest.split_at(3 * width);
        rows_product::<S, 3, MAGNITUDE>(simd, rows, local, result);
        rest = below;
    }
    for result in singles {
        let (row, below) = rest.split_at(width);
        rows_product::<S, 1, MAGNITUDE>(simd, row, local, std::array::from_mut(result));
        rest = below;
    }
}

/// Multiplies a few rows with local, in whole registers.
#[inline(always)]
fn rows_product<S: Simd, const ROWS: usize, const MAGNITUDE: bool>(
    simd: S,
    rows: &[Lanes],
    local: &[Lanes],
    result: &mut [Lanes; ROWS],
) {
    let rows = &rows[..ROWS * local.len()];
    // One pass for each register that the lanes fill.
    for part in 0..LANES / S::F64_LANES {
        let mut sums = [simd.splat_f64s(0.0); ROWS];
        for column in 0..local.len() {
            let value = S::as_simd_f64s(&local[column].0).0[part];
            for row in 0..ROWS {
                let entry = S::as_simd_f64s(&rows[row * local.len() + column].0).0[part];
                let entry = if MAGNITUDE { simd.abs_f64s(entry) } else { entry };
                sums[row] = simd.mul_add_f64s(entry, value, sums[row]);
            }
        }
        for row in 0..ROWS {
            S::as_mut_simd_f64s(&mut result[row].0).0[part] = sums[row];
        }
    }
}

/// Symmetric form given by dense local matrices, such as K or M_r.
#[derive(Debug, Clone)]
pub struct CellForm {
    /// Batches of the cells.
    pub(crate) batches: Rc<Batches>,
    panels: Rc<[Panel]>,
    /// Contributions of the cells, for assembly.
    pub(crate) blocks: Rc<[ElementMatrix]>,
}

impl CellForm {
    /// Collects the cells' local matrices, given the batches of the cells.
    pub(crate) fn new(batches: Rc<Batches>, blocks: impl Into<Rc<[ElementMatrix]>>) -> CellForm {
        let blocks = blocks.into();
        let panels = batches.panels.iter().map(|cells| Panel::new(cells.map(|cell| &blocks[cell])));
        let panels = panels.collect();
        CellForm { batches, panels, blocks }
    }

    /// Returns the local matrices of a batch.
    #[inline(always)]
    pub(crate) fn panel(&self, batch: &Batch) -> &Panel {
        &self.panels[batch.panel]
    }
}
