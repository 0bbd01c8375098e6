//! Singular mass, one row of B and one entry of C per cell, applied to eight cells at once.

use super::SingularMassCell;
use super::batch::{Batch, Batches};
use super::joined::{Cell, Unit};
use super::lane_values::{LANES, Lanes, interleave};
use super::scratch::{Room, Scratch};
use pulp::Simd;
use std::rc::Rc;

/// Rows of B of eight cells, one entry per dof of their units, and the inverses of their entries of
/// C.
#[derive(Debug, Clone)]
struct MassRow {
    row: Vec<Lanes>,
    inverses: Lanes,
}

impl MassRow {
    /// Collects the rows of one cell of each unit.
    fn new(cells: [(&Unit, usize); LANES], rows: &[SingularMassCell]) -> MassRow {
        MassRow {
            row: interleave(&cells.map(|(unit, cell)| unit.expanded(cell, &rows[cell].row))),
            inverses: Lanes(cells.map(|(_, cell)| 1.0 / rows[cell].mass)),
        }
    }

    /// Returns the momentum of each cell, B local.
    #[inline(always)]
    fn momenta<S: Simd>(&self, simd: S, local: &[Lanes]) -> Lanes {
        let mut momenta = Lanes::default();
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
            *momenta.register_mut::<S>(part) = simd.add_f64s(sums[0], simd.add_f64s(sums[1], sums[2]));
        }
        momenta
    }

    /// Computes result = B^T v.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, v: Lanes, result: &mut [Lanes]) {
        for (value, b) in result.iter_mut().zip(&self.row) {
            for part in 0..LANES / S::F64_LANES {
                *value.register_mut::<S>(part) = simd.mul_f64s(b.register::<S>(part), v.register::<S>(part));
            }
        }
    }

    /// Adds B^T v to the result.
    #[inline(always)]
    fn add_spread<S: Simd>(&self, simd: S, v: Lanes, result: &mut [Lanes]) {
        for (value, b) in result.iter_mut().zip(&self.row) {
            for part in 0..LANES / S::F64_LANES {
                let value = value.register_mut::<S>(part);
                *value = simd.mul_add_f64s(b.register::<S>(part), v.register::<S>(part), *value);
            }
        }
    }

    /// Adds scale M local to y and scale |M| |local| to m.
    #[inline(always)]
    fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
        let row = &self.row[..local.len()];
        let (mut v, mut magnitude) = (Lanes::default(), Lanes::default());
        for (b, value) in row.iter().zip(local) {
            let term = *b * *value;
            v += term;
            magnitude += term.abs();
        }
        let factor = scale * self.inverses;
        let (v, magnitude) = (v * factor, magnitude * factor);
        for ((y, m), b) in y.iter_mut().zip(m).zip(row) {
            *y += *b * v;
            *m += b.abs() * magnitude;
        }
    }
}

/// Rows of eight units: those of their cells, or of the first and the second cell of each pair.
#[derive(Debug, Clone)]
pub(super) struct Rows {
    first: MassRow,
    second: Option<MassRow>,
}

impl Rows {
    fn new(units: [&Unit; LANES], rows: &[SingularMassCell]) -> Rows {
        let second = |unit: &Unit| unit.second.map_or(unit.cell, |(cell, _)| cell);
        Rows {
            first: MassRow::new(units.map(|unit| (unit, unit.cell)), rows),
            // Either all units of a panel are pairs or none is.
            second: units[0].second.map(|_| MassRow::new(units.map(|unit| (unit, second(unit))), rows)),
        }
    }

    /// Computes result = scale M local and returns local^T M local.
    #[inline(always)]
    pub fn apply<S: Simd>(&self, simd: S, scale: f64, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        let momenta = self.first.momenta(simd, local);
        let v = momenta * self.first.inverses;
        let Some(row) = &self.second else {
            self.first.spread(simd, scale * v, result);
            return momenta * v;
        };
        let others = row.momenta(simd, local);
        let w = others * row.inverses;
        self.first.spread(simd, scale * v, result);
        row.add_spread(simd, scale * w, result);
        momenta * v + others * w
    }

    /// Returns the velocities of the first and the second cells, C^-1 B local.
    #[inline(always)]
    fn velocities<S: Simd>(&self, simd: S, local: &[Lanes]) -> [Lanes; 2] {
        let first = self.first.momenta(simd, local) * self.first.inverses;
        match &self.second {
            None => [first, Lanes::default()],
            Some(row) => [first, row.momenta(simd, local) * row.inverses],
        }
    }

    /// Computes result = B^T v.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, [first, second]: [Lanes; 2], result: &mut [Lanes]) {
        self.first.spread(simd, first, result);
        if let Some(row) = &self.second {
            row.add_spread(simd, second, result);
        }
    }

    /// Adds scale M local to y and scale |M| |local| to m.
    #[inline(always)]
    pub fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
        self.first.add_with_magnitude(scale, local, y, m);
        if let Some(row) = &self.second {
            row.add_with_magnitude(scale, local, y, m);
        }
    }
}

/// Singular mass `$M = B^T C^{-1} B$`, with one average velocity per cell.
#[derive(Debug, Clone)]
pub struct SingularMassCells {
    batches: Rc<Batches>,
    panels: Rc<[Rows]>,
    masses: Rc<[f64]>,
    rows: Rc<[SingularMassCell]>,
}

impl SingularMassCells {
    /// Collects the rows of B and the diagonal of C, given the batches of the cells.
    pub(super) fn new(batches: Rc<Batches>, rows: impl Into<Rc<[SingularMassCell]>>) -> SingularMassCells {
        let rows = rows.into();
        let panels = batches.panels().map(|units| Rows::new(units, &rows)).collect();
        let masses = rows.iter().map(|row| row.mass).collect();
        SingularMassCells { batches, panels, masses, rows }
    }

    /// Returns the same mass with other batches of its cells.
    pub(super) fn with_batches(&self, batches: impl FnOnce(Vec<Cell>) -> Rc<Batches>) -> SingularMassCells {
        let cells = self.rows.iter().map(|row| (row.dofs.clone(), row.class)).collect();
        SingularMassCells::new(batches(cells), self.rows.clone())
    }

    /// Returns the batches of the cells.
    pub(super) fn batches(&self) -> &Rc<Batches> {
        &self.batches
    }

    /// Returns the rows of B of a batch.
    #[inline(always)]
    pub(super) fn panel(&self, batch: &Batch) -> &Rows {
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

    /// Returns the diagonal of C, the masses of the cells, in kg.
    pub fn masses(&self) -> &[f64] {
        &self.masses
    }

    /// Adds M x to y and returns x^T M x.
    #[inline(always)]
    pub(super) fn add_product<S: Simd>(
        &self,
        simd: S,
        x: &[f64],
        y: &mut [f64],
        scratch: &mut Scratch,
    ) -> f64 {
        let mut form = Lanes::default();
        for batch in &self.batches.list {
            let (local, Room { result, .. }) = scratch.split(batch.size());
            let rows = self.panel(batch);
            batch.gather(x, local);
            form += rows.apply(simd, 1.0, local, result);
            batch.scatter(simd, [result], [y]);
        }
        form.sum()
    }

    /// Computes V = C^-1 B x.
    #[inline(always)]
    pub(super) fn project<S: Simd>(&self, simd: S, x: &[f64], v: &mut [f64], scratch: &mut Scratch) {
        for batch in &self.batches.list {
            let (local, _) = scratch.split(batch.size());
            batch.gather(x, local);
            let velocities = self.panel(batch).velocities(simd, local);
            for (velocities, cells) in velocities.iter().zip(&batch.cells) {
                for (velocity, &cell) in velocities.0.iter().zip(cells) {
                    if let Some(v) = v.get_mut(cell as usize) {
                        *v = *velocity;
                    }
                }
            }
        }
    }

    /// Adds B^T V to y.
    #[inline(always)]
    pub(super) fn add_momentum<S: Simd>(&self, simd: S, v: &[f64], y: &mut [f64], scratch: &mut Scratch) {
        for batch in &self.batches.list {
            let (_, Room { result, .. }) = scratch.split(batch.size());
            let of = |cell: u32| v.get(cell as usize).copied().unwrap_or(0.0);
            self.panel(batch).spread(simd, batch.cells.map(|cells| Lanes(cells.map(of))), result);
            batch.scatter(simd, [result], [y]);
        }
    }

    /// Returns V^T C V, twice the kinetic energy.
    pub(super) fn mass_norm_squared(&self, v: &[f64]) -> f64 {
        self.masses.iter().zip(v).map(|(c, v)| c * v * v).sum()
    }
}
