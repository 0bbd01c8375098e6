//! Singular mass, one row of B and one entry of C per cell, applied to eight cells at once.

use super::SingularMassCell;
use super::batch::{Batch, Batches};
use super::lane_values::{LANES, Lanes, interleave};
use super::layout::Layout;
use super::workspace::{Room, Space};
use pulp::Simd;
use std::rc::Rc;

/// Rows of B of eight cells, with one entry per local dof, and the inverses of their entries of C.
#[derive(Debug, Clone)]
pub(crate) struct MassPanel {
    row: Vec<Lanes>,
    inverse: Lanes,
}

impl MassPanel {
    fn new(cells: [&SingularMassCell; LANES]) -> MassPanel {
        MassPanel {
            row: interleave(&cells.map(|cell| &*cell.row)),
            inverse: Lanes(cells.map(|cell| 1.0 / cell.mass)),
        }
    }

    /// Returns the momenta of the cells, B local.
    #[inline(always)]
    fn momentum<S: Simd>(&self, simd: S, local: &[Lanes]) -> Lanes {
        let mut momentum = Lanes::default();
        let (rows, rest) = self.row[..local.len()].as_chunks::<3>();
        let (nodes, others) = local.as_chunks::<3>();
        for part in 0..LANES / S::F64_LANES {
            // Three sums do not wait for each other.
            let mut sums = [simd.splat_f64s(0.0); 3];
            for (b, value) in rows.iter().zip(nodes) {
                for k in 0..3 {
                    sums[k] =
                        simd.mul_add_f64s(b[k].register::<S>(part), value[k].register::<S>(part), sums[k]);
                }
            }
            for (b, value) in rest.iter().zip(others) {
                sums[0] = simd.mul_add_f64s(b.register::<S>(part), value.register::<S>(part), sums[0]);
            }
            let [first, second, third] = sums;
            *momentum.register_mut::<S>(part) = simd.add_f64s(first, simd.add_f64s(second, third));
        }
        momentum
    }

    /// Computes result = B^T v.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, v: Lanes, result: &mut [Lanes]) {
        for part in 0..LANES / S::F64_LANES {
            for (value, b) in result.iter_mut().zip(&self.row) {
                *value.register_mut::<S>(part) = simd.mul_f64s(b.register::<S>(part), v.register::<S>(part));
            }
        }
    }

    /// Computes result = M local and returns local^T M local.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, simd: S, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        let momentum = self.momentum(simd, local);
        let velocity = momentum * self.inverse;
        self.spread(simd, velocity, result);
        momentum * velocity
    }

    /// Adds scale M local to y and scale |M| |local| to m.
    #[inline(always)]
    pub fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
        let row = &self.row[..local.len()];
        let (mut v, mut magnitude) = (Lanes::default(), Lanes::default());
        for (b, value) in row.iter().zip(local) {
            let term = *b * *value;
            v += term;
            magnitude += term.abs();
        }
        let factor = scale * self.inverse;
        let (v, magnitude) = (v * factor, magnitude * factor);
        for ((y, m), b) in y.iter_mut().zip(m).zip(row) {
            *y += *b * v;
            *m += b.abs() * magnitude;
        }
    }
}

/// Singular mass `$M = B^T C^{-1} B$`, with one average velocity per cell.
#[derive(Debug, Clone)]
pub struct SingularMassCells {
    /// Batches of the cells.
    pub(crate) batches: Rc<Batches>,
    panels: Rc<[MassPanel]>,
    /// Diagonal of C, the masses of the cells, in kg.
    pub(crate) masses: Rc<[f64]>,
    rows: Rc<[SingularMassCell]>,
}

impl SingularMassCells {
    /// Collects the rows of B and the diagonal of C, given the batches of the cells.
    pub(crate) fn new(batches: Rc<Batches>, rows: impl Into<Rc<[SingularMassCell]>>) -> SingularMassCells {
        let rows = rows.into();
        let panels = batches.panels.iter().map(|cells| MassPanel::new(cells.map(|cell| &rows[cell])));
        let panels = panels.collect();
        let masses = rows.iter().map(|row| row.mass).collect();
        SingularMassCells { batches, panels, masses, rows }
    }

    /// Returns the rows of B of a batch.
    #[inline(always)]
    pub(crate) fn panel(&self, batch: &Batch) -> &MassPanel {
        &self.panels[batch.panel]
    }

    /// Returns the rows of B and entries of C, for assembly.
    pub fn rows(&self) -> &[SingularMassCell] {
        &self.rows
    }

    /// Returns the number of cells.
    pub fn cells(&self) -> usize {
        self.rows.len()
    }

    /// Computes V = C^-1 B x.
    #[inline(always)]
    pub(crate) fn project<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        x: &[f64],
        v: &mut [f64],
        mut space: Space,
    ) {
        layout.lay_out(simd, x, space.x);
        self.batches.for_each(
            #[inline(always)]
            |batch, size| {
                let (local, _) = space.scratch.split(size);
                batch.gather(space.x, local);
                let panel = self.panel(batch);
                let velocities = panel.momentum(simd, local) * panel.inverse;
                for (velocity, &cell) in velocities.0.iter().zip(&batch.cells) {
                    if let Some(v) = v.get_mut(cell as usize) {
                        *v = *velocity;
                    }
                }
            },
        );
    }

    /// Computes y = B^T V.
    #[inline(always)]
    pub(crate) fn project_transpose<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        v: &[f64],
        y: &mut [f64],
        mut space: Space,
    ) {
        self.batches.for_each(
            #[inline(always)]
            |batch, size| {
                let (_, Room { result, .. }) = space.scratch.split(size);
                let velocity = |cell: u32| v.get(cell as usize).copied().unwrap_or(0.0);
                self.panel(batch).spread(simd, Lanes(batch.cells.map(velocity)), result);
                batch.scatter(simd, [result], [space.y]);
            },
        );
        layout.take(simd, space.y, y);
    }
}
