//! Symmetric forms kept cell by cell, applied to eight cells at once.
//!
//! The local matrices of a batch are stored lane by lane in a *panel*; congruent cells share one panel, so that a regular
//! mesh reads its stiffness from the cache. All vectors over the dofs are laid out, see [`super::batch`].

use super::batch::{Batch, Cells, LANES, Lanes, Layout, batches};
use super::{Average, Block};
use pulp::Simd;

impl Cells for Vec<Block> {
    fn count(&self) -> usize {
        self.len()
    }

    fn dofs(&self, cell: usize) -> &[Option<usize>] {
        &self[cell].dofs
    }

    fn class(&self, cell: usize) -> usize {
        self[cell].class
    }
}

impl Cells for Vec<Average> {
    fn count(&self) -> usize {
        self.len()
    }

    fn dofs(&self, cell: usize) -> &[Option<usize>] {
        &self[cell].dofs
    }

    fn class(&self, cell: usize) -> usize {
        self[cell].class
    }
}

/// `count` values of eight cells, lane by lane.
fn interleave<'a>(cells: &[usize; LANES], count: usize, values: impl Fn(usize) -> &'a [f64]) -> Vec<Lanes> {
    let mut panel = vec![[0.0; LANES]; count];
    for (lane, &cell) in cells.iter().enumerate() {
        for (slot, value) in panel.iter_mut().zip(values(cell)) {
            slot[lane] = *value;
        }
    }
    panel
}

/// Local matrices of eight cells.
#[derive(Debug, Clone)]
struct Panel {
    matrix: Vec<Lanes>,
    /// Node positions relative to the first node: x and y of the second node, of the third, ...
    arms: Vec<[Lanes; 2]>,
}

impl Panel {
    /// result = A local, lane by lane.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, local: &mut [Lanes], result: &mut [Lanes]) -> Lanes {
        let mut form = [0.0; LANES];
        // Of the deformation only the dofs after the first node's are left.
        let first = if self.arms.is_empty() { 0 } else { 3 };
        remove_rigid_motion(local, &self.arms);
        matrix_product::<S, false>(simd, &self.matrix, first, local, result);
        for (value, sum) in local[first..].iter().zip(&result[first..]) {
            for lane in 0..LANES {
                form[lane] += value[lane] * sum[lane];
            }
        }
        return_rigid_forces(result, &self.arms);
        form
    }

    /// result = |A| |local|, lane by lane.
    #[inline(always)]
    fn apply_magnitude<S: Simd>(&self, simd: S, local: &mut [Lanes], result: &mut [Lanes]) {
        for value in local.as_flattened_mut() {
            *value = value.abs();
        }
        matrix_product::<S, true>(simd, &self.matrix, 0, local, result);
    }
}

/// result = matrix local, or |matrix| local, lane by lane, with the rows and columns from `first` on: the inner loop of
/// every step.
#[inline(always)]
fn matrix_product<S: Simd, const MAGNITUDE: bool>(
    simd: S,
    matrix: &[Lanes],
    first: usize,
    local: &[Lanes],
    result: &mut [Lanes],
) {
    let width = local.len();
    let (local, result) = (&local[first..], &mut result[first..]);
    // Several rows at once hide the latency of the sums.
    let (triples, singles) = result.as_chunks_mut::<3>();
    let mut rows = &matrix[first * width..];
    for result in triples {
        let (a, rest) = rows.split_at(width);
        let (b, rest) = rest.split_at(width);
        let (c, rest) = rest.split_at(width);
        rows_product::<S, 3, MAGNITUDE>(simd, [&a[first..], &b[first..], &c[first..]], local, result);
        rows = rest;
    }
    for result in singles {
        let (a, rest) = rows.split_at(width);
        rows_product::<S, 1, MAGNITUDE>(simd, [&a[first..]], local, std::array::from_mut(result));
        rows = rest;
    }
}

/// Rows times local: a loop for each of the lengths that plate elements have, which the compiler unrolls, and one for any.
#[inline(always)]
fn rows_product<S: Simd, const ROWS: usize, const MAGNITUDE: bool>(
    simd: S,
    rows: [&[Lanes]; ROWS],
    local: &[Lanes],
    result: &mut [Lanes; ROWS],
) {
    match local.len() {
        6 => row_sums::<S, ROWS, MAGNITUDE>(simd, rows, &local[..6], result),
        9 => row_sums::<S, ROWS, MAGNITUDE>(simd, rows, &local[..9], result),
        12 => row_sums::<S, ROWS, MAGNITUDE>(simd, rows, &local[..12], result),
        _ => row_sums::<S, ROWS, MAGNITUDE>(simd, rows, local, result),
    }
}

#[inline(always)]
fn row_sums<S: Simd, const ROWS: usize, const MAGNITUDE: bool>(
    simd: S,
    rows: [&[Lanes]; ROWS],
    local: &[Lanes],
    result: &mut [Lanes; ROWS],
) {
    let mut entries: [&[S::f64s]; ROWS] = [&[]; ROWS];
    for (entries, row) in entries.iter_mut().zip(rows) {
        *entries = S::as_simd_f64s(row[..local.len()].as_flattened()).0;
    }
    let values = S::as_simd_f64s(local.as_flattened()).0;
    // Registers that make up the lanes.
    let parts = LANES / S::F64_LANES;
    for part in 0..parts {
        let mut sums = [simd.splat_f64s(0.0); ROWS];
        for column in 0..local.len() {
            let at = column * parts + part;
            for (sum, entries) in sums.iter_mut().zip(entries) {
                let entry = if MAGNITUDE { simd.abs_f64s(entries[at]) } else { entries[at] };
                *sum = simd.mul_add_f64s(entry, values[at], *sum);
            }
        }
        for (result, sum) in result.iter_mut().zip(sums) {
            S::as_mut_simd_f64s(result).0[part] = sum;
        }
    }
}

/// Replaces the dofs of a cell by those of its deformation, R w: the rigid motion of its first node is subtracted,
/// by differences of nearby values. The first node's own are then zero, and are not written.
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
}

/// Completes the forces on the deformation to those on the dofs, R^T f: the first node balances the others.
#[inline(always)]
fn return_rigid_forces(result: &mut [Lanes], arms: &[[Lanes; 2]]) {
    if arms.is_empty() {
        return;
    }
    let (first, others) = result.split_at_mut(3);
    let mut sums = [[0.0; LANES]; 3];
    for (node, arm) in others.chunks_exact(3).zip(arms) {
        for lane in 0..LANES {
            sums[0][lane] -= node[0][lane];
            sums[1][lane] -= node[1][lane] + node[0][lane] * arm[0][lane];
            sums[2][lane] -= node[2][lane] + node[0][lane] * arm[1][lane];
        }
    }
    first.copy_from_slice(&sums);
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
    /// Collects the cells' local matrices.
    pub fn new(layout: &Layout, blocks: Vec<Block>) -> CellForm {
        let mut panels = Vec::new();
        let width = blocks.iter().map(|block| block.dofs.len()).max().unwrap_or(0);
        let batches = batches(layout, &blocks, |cells| {
            let size = blocks[cells[0]].dofs.len();
            let nodes = blocks[cells[0]].arms.as_ref().map_or(0, |arms| arms.len() - 1);
            let axis = |k: usize, axis: usize| {
                cells.map(|cell| blocks[cell].arms.as_ref().map_or(0.0, |arms| arms[k][axis]))
            };
            panels.push(Panel {
                matrix: interleave(cells, size * size, |cell| &blocks[cell].matrix),
                arms: (1..=nodes).map(|k| [axis(k, 0), axis(k, 1)]).collect(),
            });
            panels.len() - 1
        });
        CellForm { batches, panels, blocks, width }
    }

    /// Largest number of dofs in a cell.
    pub(super) fn width(&self) -> usize {
        self.width
    }

    /// The cells' contributions, for assembly.
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// y += A x; returns x^T A x.
    #[inline(always)]
    pub(super) fn add_product<S: Simd>(
        &self,
        simd: S,
        x: &[f64],
        y: &mut [f64],
        scratch: &mut Scratch,
    ) -> f64 {
        let mut form = [0.0; LANES];
        for batch in &self.batches {
            let (local, result) = scratch.split(batch.size());
            batch.gather(1.0, x, local);
            let forms = self.panels[batch.panel].apply(simd, local, result);
            for lane in 0..LANES {
                form[lane] += forms[lane];
            }
            batch.scatter(result, y);
        }
        form.iter().sum()
    }

    /// y += scale A x and m += scale |A| |x|.
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
        for batch in &self.batches {
            let (local, result) = scratch.split(batch.size());
            let panel = &self.panels[batch.panel];
            batch.gather(scale, x, local);
            panel.apply(simd, local, result);
            batch.scatter(result, y);
            batch.gather(scale, x, local);
            panel.apply_magnitude(simd, local, result);
            batch.scatter(result, m);
        }
    }
}

/// Rows of B of eight cells, and their entries of C.
#[derive(Debug, Clone)]
struct Rows {
    row: Vec<Lanes>,
    masses: Lanes,
}

impl Rows {
    /// B local, and the sum of the magnitudes of its terms, lane by lane.
    #[inline(always)]
    fn momenta(&self, local: &[Lanes]) -> (Lanes, Lanes) {
        let (mut momenta, mut magnitudes) = ([0.0; LANES], [0.0; LANES]);
        for (b, value) in self.row.iter().zip(local) {
            for lane in 0..LANES {
                let term = b[lane] * value[lane];
                momenta[lane] += term;
                magnitudes[lane] += term.abs();
            }
        }
        (momenta, magnitudes)
    }

    /// Momenta over masses.
    #[inline(always)]
    fn velocities(&self, mut momenta: Lanes) -> Lanes {
        for lane in 0..LANES {
            momenta[lane] /= self.masses[lane];
        }
        momenta
    }

    /// result = B^T v, or |B^T| v, lane by lane.
    #[inline(always)]
    fn spread<const MAGNITUDE: bool>(&self, v: &Lanes, result: &mut [Lanes]) {
        for (value, b) in result.iter_mut().zip(&self.row) {
            for lane in 0..LANES {
                value[lane] = v[lane] * if MAGNITUDE { b[lane].abs() } else { b[lane] };
            }
        }
    }
}

/// The singular mass M = B^T C^-1 B: one average velocity a cell.
#[derive(Debug, Clone)]
pub struct Averages {
    batches: Vec<Batch>,
    panels: Vec<Rows>,
    masses: Vec<f64>,
    rows: Vec<Average>,
    /// Largest number of dofs in a cell.
    width: usize,
}

impl Averages {
    /// Collects the rows of B and the diagonal of C.
    pub fn new(layout: &Layout, rows: Vec<Average>) -> Averages {
        let mut panels = Vec::new();
        let batches = batches(layout, &rows, |cells| {
            let size = rows[cells[0]].dofs.len();
            panels.push(Rows {
                row: interleave(cells, size, |cell| &rows[cell].row),
                masses: cells.map(|cell| rows[cell].mass),
            });
            panels.len() - 1
        });
        let masses = rows.iter().map(|row| row.mass).collect();
        let width = rows.iter().map(|row| row.dofs.len()).max().unwrap_or(0);
        Averages { batches, panels, masses, rows, width }
    }

    /// Largest number of dofs in a cell.
    pub(super) fn width(&self) -> usize {
        self.width
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
        &self.masses
    }

    /// y += M x; returns x^T M x.
    #[inline(always)]
    pub(super) fn add_product(&self, x: &[f64], y: &mut [f64], scratch: &mut Scratch) -> f64 {
        let mut form = [0.0; LANES];
        for batch in &self.batches {
            let (local, result) = scratch.split(batch.size());
            let rows = &self.panels[batch.panel];
            batch.gather(1.0, x, local);
            let (momenta, _) = rows.momenta(local);
            let v = rows.velocities(momenta);
            for lane in 0..LANES {
                form[lane] += momenta[lane] * v[lane];
            }
            rows.spread::<false>(&v, result);
            batch.scatter(result, y);
        }
        form.iter().sum()
    }

    /// y += scale M x and m += scale |M| |x|.
    #[inline(always)]
    pub(super) fn add_with_magnitude(
        &self,
        scale: f64,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
        scratch: &mut Scratch,
    ) {
        for batch in &self.batches {
            let (local, result) = scratch.split(batch.size());
            let rows = &self.panels[batch.panel];
            batch.gather(scale, x, local);
            let (momenta, magnitudes) = rows.momenta(local);
            rows.spread::<false>(&rows.velocities(momenta), result);
            batch.scatter(result, y);
            rows.spread::<true>(&rows.velocities(magnitudes), result);
            batch.scatter(result, m);
        }
    }

    /// V = C^-1 B x.
    #[inline(always)]
    pub(super) fn velocity(&self, x: &[f64], v: &mut [f64], scratch: &mut Scratch) {
        for batch in &self.batches {
            let (local, _) = scratch.split(batch.size());
            let rows = &self.panels[batch.panel];
            batch.gather(1.0, x, local);
            let velocities = rows.velocities(rows.momenta(local).0);
            for (velocity, &cell) in velocities.iter().zip(&batch.cells) {
                if let Some(v) = v.get_mut(cell as usize) {
                    *v = *velocity;
                }
            }
        }
    }

    /// y += B^T V.
    #[inline(always)]
    pub(super) fn add_momentum(&self, v: &[f64], y: &mut [f64], scratch: &mut Scratch) {
        for batch in &self.batches {
            let (_, result) = scratch.split(batch.size());
            let mut lanes = [0.0; LANES];
            for (value, &cell) in lanes.iter_mut().zip(&batch.cells) {
                *value = v.get(cell as usize).copied().unwrap_or(0.0);
            }
            self.panels[batch.panel].spread::<false>(&lanes, result);
            batch.scatter(result, y);
        }
    }

    /// V^T C V.
    pub(super) fn vis_viva(&self, v: &[f64]) -> f64 {
        self.masses.iter().zip(v).map(|(c, v)| c * v * v).sum()
    }
}

/// Room for the local vectors of one batch.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    lanes: Vec<Lanes>,
}

impl Scratch {
    /// Makes room for cells of up to `size` dofs.
    pub fn reserve(&mut self, size: usize) {
        self.lanes.resize((2 * size).max(self.lanes.len()), [0.0; LANES]);
    }

    #[inline(always)]
    fn split(&mut self, size: usize) -> (&mut [Lanes], &mut [Lanes]) {
        self.lanes[..2 * size].split_at_mut(size)
    }
}
