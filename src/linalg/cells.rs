//! Symmetric forms kept cell by cell, applied to eight cells at once.
//!
//! The local matrices of a batch are stored lane by lane in a *panel*; congruent cells share one panel, so that a regular
//! mesh reads its stiffness from the cache. A dof that a support holds, and an unused lane, point to one slot past the end of
//! the vectors that always reads zero.

use super::{Average, Block};
use pulp::Simd;
use std::collections::BTreeMap;

const LANES: usize = 8;
type Lanes = [f64; LANES];

/// Eight cells with equally many local dofs.
#[derive(Debug, Clone)]
struct Batch {
    /// Global dof of each local one, lane by lane.
    dofs: Vec<[u32; LANES]>,
    /// Cell number of each lane; past the end where the lane is unused.
    cells: [u32; LANES],
    panel: usize,
}

/// Splits cells into batches: whole ones share the panel of their class, the rest are packed together.
/// Returns for each batch its cells and whether they all are of one class.
fn batches(sizes_and_classes: &[(usize, usize)]) -> Vec<(Vec<usize>, bool)> {
    let mut classes: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (cell, &key) in sizes_and_classes.iter().enumerate() {
        classes.entry(key).or_default().push(cell);
    }
    let mut batches = Vec::new();
    let mut loose: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for ((size, _), cells) in classes {
        let whole = cells.chunks_exact(LANES);
        loose.entry(size).or_default().extend_from_slice(whole.remainder());
        batches.extend(whole.map(|chunk| (chunk.to_vec(), true)));
    }
    for (_, mut cells) in loose {
        cells.sort_unstable();
        batches.extend(cells.chunks(LANES).map(|chunk| (chunk.to_vec(), false)));
    }
    batches.sort_unstable_by_key(|(cells, _)| cells[0]);
    batches
}

/// Groups items into batches whose panels are made by `panel` and shared by the cells of a class.
fn pack<T>(
    items: &[T],
    slots: usize,
    dofs: impl Fn(&T) -> &[Option<usize>],
    class: impl Fn(&T) -> usize,
    mut panel: impl FnMut(&[usize]) -> usize,
) -> Vec<Batch> {
    let keys: Vec<_> = items.iter().map(|item| (dofs(item).len(), class(item))).collect();
    let mut shared = BTreeMap::new();
    batches(&keys)
        .into_iter()
        .map(|(cells, uniform)| {
            let panel = if uniform {
                *shared.entry(keys[cells[0]]).or_insert_with(|| panel(&[cells[0]; LANES]))
            } else {
                panel(&cells)
            };
            let mut batch = Batch {
                dofs: vec![[slots as u32; LANES]; keys[cells[0]].0],
                cells: [items.len() as u32; LANES],
                panel,
            };
            for (lane, &cell) in cells.iter().enumerate() {
                batch.cells[lane] = cell as u32;
                for (local, dof) in dofs(&items[cell]).iter().enumerate() {
                    batch.dofs[local][lane] = dof.unwrap_or(slots) as u32;
                }
            }
            batch
        })
        .collect()
}

/// Values of eight cells: `count` numbers each, lane by lane; unused lanes are zero.
fn interleave<'a>(cells: &[usize], count: usize, values: impl Fn(usize) -> &'a [f64]) -> Vec<Lanes> {
    let mut panel = vec![[0.0; LANES]; count];
    for (lane, &cell) in cells.iter().enumerate() {
        for (slot, value) in panel.iter_mut().zip(values(cell)) {
            slot[lane] = *value;
        }
    }
    panel
}

#[inline(always)]
fn gather(x: &[f64], batch: &Batch, local: &mut [Lanes]) {
    for (value, dofs) in local.iter_mut().zip(&batch.dofs) {
        for lane in 0..LANES {
            value[lane] = x[dofs[lane] as usize];
        }
    }
}

#[inline(always)]
fn scatter(local: &[Lanes], batch: &Batch, y: &mut [f64]) {
    for (value, dofs) in local.iter().zip(&batch.dofs) {
        for lane in 0..LANES {
            y[dofs[lane] as usize] += value[lane];
        }
    }
}

/// result = matrix local, or |matrix| |local|, lane by lane, with whole registers: the inner loop of every step.
#[inline(always)]
fn matrix_product<S: Simd, const MAGNITUDE: bool>(
    simd: S,
    matrix: &[Lanes],
    local: &[Lanes],
    result: &mut [Lanes],
) {
    let matrix = S::as_simd_f64s(matrix.as_flattened()).0;
    let local = S::as_simd_f64s(local.as_flattened()).0;
    let result = S::as_mut_simd_f64s(result.as_flattened_mut()).0;
    // Registers that make up the lanes; three rows at once hide the latency of the sums.
    let parts = LANES / S::F64_LANES;
    let width = local.len();
    let mut row = 0;
    while row < result.len() / parts {
        let rows = if row + 3 <= result.len() / parts { 3 } else { 1 };
        for part in 0..parts {
            let mut sums = [simd.splat_f64s(0.0); 3];
            let (a, b, c) = (row * width, (row + rows - 1).min(row + 1) * width, (row + rows - 1) * width);
            for column in (part..width).step_by(parts) {
                for (sum, start) in sums.iter_mut().zip([a, b, c]) {
                    let entry = matrix[start + column];
                    let value = local[column];
                    let (entry, value) =
                        if MAGNITUDE { (simd.abs_f64s(entry), simd.abs_f64s(value)) } else { (entry, value) };
                    *sum = simd.mul_add_f64s(entry, value, *sum);
                }
            }
            for (k, sum) in sums.into_iter().enumerate().take(rows) {
                result[(row + k) * parts + part] = sum;
            }
        }
        row += rows;
    }
}

/// Row times local, and the sum of the magnitudes of its terms, lane by lane.
#[inline(always)]
fn row_product<S: Simd>(simd: S, row: &[Lanes], local: &[Lanes]) -> (Lanes, Lanes) {
    let row = S::as_simd_f64s(row.as_flattened()).0;
    let local = S::as_simd_f64s(local.as_flattened()).0;
    let (mut sums, mut magnitudes) = ([0.0; LANES], [0.0; LANES]);
    let parts = LANES / S::F64_LANES;
    for part in 0..parts {
        let (mut sum, mut magnitude) = (simd.splat_f64s(0.0), simd.splat_f64s(0.0));
        for i in (part..row.len()).step_by(parts) {
            let term = simd.mul_f64s(row[i], local[i]);
            sum = simd.add_f64s(sum, term);
            magnitude = simd.add_f64s(magnitude, simd.abs_f64s(term));
        }
        S::as_mut_simd_f64s(&mut sums).0[part] = sum;
        S::as_mut_simd_f64s(&mut magnitudes).0[part] = magnitude;
    }
    (sums, magnitudes)
}

/// Local matrices of eight cells.
#[derive(Debug, Clone)]
struct Panel {
    matrix: Vec<Lanes>,
    /// Node positions relative to the first node: x and y of the second node, of the third, ...
    arms: Vec<[Lanes; 2]>,
}

/// A symmetric form given by dense local matrices, such as K or M_r.
#[derive(Debug, Clone)]
pub struct CellForm {
    batches: Vec<Batch>,
    panels: Vec<Panel>,
    blocks: Vec<Block>,
    /// Largest number of dofs in a cell.
    width: usize,
}

impl CellForm {
    /// Collects the cells' local matrices over `dofs` free dofs.
    pub fn new(dofs: usize, blocks: Vec<Block>) -> CellForm {
        let mut panels = Vec::new();
        let width = blocks.iter().map(|block| block.dofs.len()).max().unwrap_or(0);
        let batches = pack(
            &blocks,
            dofs,
            |block| &block.dofs,
            |block| block.class,
            |cells| {
                let size = blocks[cells[0]].dofs.len();
                let nodes = blocks[cells[0]].arms.as_ref().map_or(0, |arms| arms.len() - 1);
                let axis = |k: usize, axis: usize| {
                    let mut lanes = [0.0; LANES];
                    for (lane, &cell) in lanes.iter_mut().zip(cells) {
                        *lane = blocks[cell].arms.as_ref().map_or(0.0, |arms| arms[k][axis]);
                    }
                    lanes
                };
                panels.push(Panel {
                    matrix: interleave(cells, size * size, |cell| &blocks[cell].matrix),
                    arms: (1..=nodes).map(|k| [axis(k, 0), axis(k, 1)]).collect(),
                });
                panels.len() - 1
            },
        );
        CellForm { batches, panels, blocks, width }
    }

    /// The cells' contributions, for assembly.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// y += A x for padded vectors; returns x^T A x.
    #[inline(always)]
    pub(super) fn add_product<S: Simd>(
        &self,
        simd: S,
        x: &[f64],
        y: &mut [f64],
        scratch: &mut Scratch,
    ) -> f64 {
        let (local, result) = scratch.split(self.width);
        let mut form = [0.0; LANES];
        for batch in &self.batches {
            let size = batch.dofs.len();
            let (local, result) = (&mut local[..size], &mut result[..size]);
            let panel = &self.panels[batch.panel];
            gather(x, batch, local);
            remove_rigid_motion(local, &panel.arms);
            matrix_product::<S, false>(simd, &panel.matrix, local, result);
            for (value, sum) in local.iter().zip(result.iter()) {
                for lane in 0..LANES {
                    form[lane] += value[lane] * sum[lane];
                }
            }
            return_rigid_forces(result, &panel.arms);
            scatter(result, batch, y);
        }
        form.iter().sum()
    }

    /// y += scale A x and m += scale |A| |x| for padded vectors.
    #[inline(always)]
    pub(super) fn add_with_magnitude<S: Simd>(
        &self,
        simd: S,
        scale: f64,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let (local, result) = scratch.split(self.width);
        for batch in &self.batches {
            let size = batch.dofs.len();
            let (local, result) = (&mut local[..size], &mut result[..size]);
            let panel = &self.panels[batch.panel];
            gather(x, batch, local);
            for value in local.as_flattened_mut() {
                *value *= scale;
            }
            matrix_product::<S, true>(simd, &panel.matrix, local, result);
            scatter(result, batch, m);
            remove_rigid_motion(local, &panel.arms);
            matrix_product::<S, false>(simd, &panel.matrix, local, result);
            return_rigid_forces(result, &panel.arms);
            scatter(result, batch, y);
        }
    }
}

/// Replaces the dofs of a cell by those of its deformation, R w: the rigid motion of its first node is subtracted,
/// by differences of nearby values.
#[inline(always)]
fn remove_rigid_motion(local: &mut [Lanes], arms: &[[Lanes; 2]]) {
    if arms.is_empty() {
        return;
    }
    let (first, others) = local.split_at_mut(3);
    for (node, arm) in others.chunks_exact_mut(3).zip(arms) {
        for lane in 0..LANES {
            let turned = first[1][lane] * arm[0][lane] + first[2][lane] * arm[1][lane];
            node[0][lane] = (node[0][lane] - first[0][lane]) - turned;
            node[1][lane] -= first[1][lane];
            node[2][lane] -= first[2][lane];
        }
    }
    first.fill([0.0; LANES]);
}

/// Completes the forces on the deformation to those on the dofs, R^T f: the first node balances the others.
#[inline(always)]
fn return_rigid_forces(result: &mut [Lanes], arms: &[[Lanes; 2]]) {
    if arms.is_empty() {
        return;
    }
    let (first, others) = result.split_at_mut(3);
    first.fill([0.0; LANES]);
    for (node, arm) in others.chunks_exact(3).zip(arms) {
        for lane in 0..LANES {
            first[0][lane] -= node[0][lane];
            first[1][lane] -= node[1][lane] + node[0][lane] * arm[0][lane];
            first[2][lane] -= node[2][lane] + node[0][lane] * arm[1][lane];
        }
    }
}

/// The singular mass M = B^T C^-1 B: one average velocity a cell.
#[derive(Debug, Clone)]
pub struct Averages {
    batches: Vec<Batch>,
    panels: Vec<Vec<Lanes>>,
    masses: Vec<f64>,
    rows: Vec<Average>,
    /// Largest number of dofs in a cell.
    width: usize,
}

impl Averages {
    /// Collects the rows of B and the diagonal of C over `dofs` free dofs.
    pub fn new(dofs: usize, rows: Vec<Average>) -> Averages {
        let mut panels = Vec::new();
        let batches = pack(
            &rows,
            dofs,
            |row| &row.dofs,
            |row| row.class,
            |cells| {
                panels.push(interleave(cells, rows[cells[0]].dofs.len(), |cell| &rows[cell].row));
                panels.len() - 1
            },
        );
        // One slot more for the unused lanes; infinite, so that they move at no velocity.
        let masses = rows.iter().map(|row| row.mass).chain([f64::INFINITY]).collect();
        let width = rows.iter().map(|row| row.dofs.len()).max().unwrap_or(0);
        Averages { batches, panels, masses, rows, width }
    }

    /// The rows of B and entries of C, for assembly.
    pub fn rows(&self) -> &[Average] {
        &self.rows
    }

    /// Number of cells.
    pub fn cells(&self) -> usize {
        self.rows.len()
    }

    /// Masses of the cells: the diagonal of C, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses[..self.rows.len()]
    }

    /// Momentum of each cell in each lane, B x.
    #[inline(always)]
    fn lanes(&self, batch: &Batch, x: &[f64]) -> Lanes {
        let mut sum = [0.0; LANES];
        for (b, dofs) in self.panels[batch.panel].iter().zip(&batch.dofs) {
            for lane in 0..LANES {
                sum[lane] += b[lane] * x[dofs[lane] as usize];
            }
        }
        sum
    }

    #[inline(always)]
    fn spread(&self, batch: &Batch, v: &Lanes, y: &mut [f64]) {
        for (b, dofs) in self.panels[batch.panel].iter().zip(&batch.dofs) {
            for lane in 0..LANES {
                y[dofs[lane] as usize] += b[lane] * v[lane];
            }
        }
    }

    /// y += M x for padded vectors; returns x^T M x.
    #[inline(always)]
    pub(super) fn add_product(&self, x: &[f64], y: &mut [f64]) -> f64 {
        let mut form = 0.0;
        for batch in &self.batches {
            let mut v = self.lanes(batch, x);
            for lane in 0..LANES {
                let momentum = v[lane];
                v[lane] /= self.masses[batch.cells[lane] as usize];
                form += momentum * v[lane];
            }
            self.spread(batch, &v, y);
        }
        form
    }

    /// y += scale M x and m += scale |M| |x| for padded vectors.
    #[inline(always)]
    pub(super) fn add_with_magnitude<S: Simd>(
        &self,
        simd: S,
        scale: f64,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
        scratch: &mut Scratch,
    ) {
        let (local, result) = scratch.split(self.width);
        for batch in &self.batches {
            let size = batch.dofs.len();
            let (local, result) = (&mut local[..size], &mut result[..size]);
            let row = &self.panels[batch.panel];
            gather(x, batch, local);
            let (mut v, mut magnitude) = row_product(simd, row, local);
            for lane in 0..LANES {
                let factor = scale / self.masses[batch.cells[lane] as usize];
                v[lane] *= factor;
                magnitude[lane] *= factor;
            }
            for (value, b) in result.iter_mut().zip(row) {
                for lane in 0..LANES {
                    value[lane] = b[lane] * v[lane];
                }
            }
            scatter(result, batch, y);
            for (value, b) in result.iter_mut().zip(row) {
                for lane in 0..LANES {
                    value[lane] = b[lane].abs() * magnitude[lane];
                }
            }
            scatter(result, batch, m);
        }
    }

    /// V = C^-1 B x for a padded x.
    #[inline(always)]
    pub(super) fn velocity(&self, x: &[f64], v: &mut [f64]) {
        for batch in &self.batches {
            let momenta = self.lanes(batch, x);
            for (momentum, &cell) in momenta.iter().zip(&batch.cells) {
                if let Some(v) = v.get_mut(cell as usize) {
                    *v = momentum / self.masses[cell as usize];
                }
            }
        }
    }

    /// y += B^T V for a padded y.
    #[inline(always)]
    pub(super) fn add_momentum(&self, v: &[f64], y: &mut [f64]) {
        for batch in &self.batches {
            let lanes = batch.cells.map(|cell| v.get(cell as usize).copied().unwrap_or(0.0));
            self.spread(batch, &lanes, y);
        }
    }

    /// V^T C V.
    pub(super) fn vis_viva(&self, v: &[f64]) -> f64 {
        self.masses().iter().zip(v).map(|(c, v)| c * v * v).sum()
    }
}

/// Room for the local vectors of one batch.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    lanes: Vec<Lanes>,
}

impl Scratch {
    fn split(&mut self, width: usize) -> (&mut [Lanes], &mut [Lanes]) {
        self.lanes.resize((2 * width).max(self.lanes.len()), [0.0; LANES]);
        let (first, second) = self.lanes.split_at_mut(width);
        (first, &mut second[..width])
    }
}
