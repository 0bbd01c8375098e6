//! Singular mass, one row of B and one entry of C per cell, applied to eight cells at once.

use super::SingularMassCell;
use super::batch::{Batch, Batches};
use super::half_turn_mass::HalfTurnMass;
use super::joined::Unit;
use super::lane_values::{LANES, Lanes, interleave};
use super::layout::Layout;
use super::scratch::Room;
use super::turns::Turn;
use super::workspace::Strips;
use pulp::Simd;
use std::rc::Rc;

/// Rows of B of one or two cells of each of eight units, with one entry per dof of the unit, and
/// the inverses of the cells' entries of C.
#[derive(Debug, Clone)]
pub(super) struct MassRows<const CELLS: usize> {
    /// Entries of the cells, dof by dof.
    entries: Vec<[Lanes; CELLS]>,
    inverses: [Lanes; CELLS],
}

impl<const CELLS: usize> MassRows<CELLS> {
    /// Collects the rows of some cells of each unit.
    fn new(units: [&Unit; LANES], cells: [[usize; LANES]; CELLS], rows: &[SingularMassCell]) -> Self {
        let entries = cells.map(|cells| {
            let of_unit = |lane: usize| units[lane].expanded(cells[lane], &rows[cells[lane]].row);
            interleave(&std::array::from_fn(of_unit))
        });
        MassRows {
            entries: (0..units[0].dofs.len()).map(|dof| entries.each_ref().map(|of| of[dof])).collect(),
            inverses: cells.map(|cells| Lanes(cells.map(|cell| 1.0 / rows[cell].mass))),
        }
    }

    /// Returns the momentum of each cell, B local.
    #[inline(always)]
    fn momenta<S: Simd>(&self, simd: S, local: &[Lanes]) -> [Lanes; CELLS] {
        let mut momenta = [Lanes::default(); CELLS];
        let (rows, rest) = self.entries[..local.len()].as_chunks::<3>();
        let (nodes, others) = local.as_chunks::<3>();
        for part in 0..LANES / S::F64_LANES {
            // Three sums do not wait for each other.
            let mut sums = [[simd.splat_f64s(0.0); 3]; CELLS];
            for (b, value) in rows.iter().zip(nodes) {
                for k in 0..3 {
                    let value = value[k].register::<S>(part);
                    for cell in 0..CELLS {
                        let b = b[k][cell].register::<S>(part);
                        sums[cell][k] = simd.mul_add_f64s(b, value, sums[cell][k]);
                    }
                }
            }
            for (b, value) in rest.iter().zip(others) {
                let value = value.register::<S>(part);
                for cell in 0..CELLS {
                    let b = b[cell].register::<S>(part);
                    sums[cell][0] = simd.mul_add_f64s(b, value, sums[cell][0]);
                }
            }
            for cell in 0..CELLS {
                let [first, second, third] = sums[cell];
                *momenta[cell].register_mut::<S>(part) = simd.add_f64s(first, simd.add_f64s(second, third));
            }
        }
        momenta
    }

    /// Computes result = B^T v.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, v: [Lanes; CELLS], result: &mut [Lanes]) {
        for part in 0..LANES / S::F64_LANES {
            for (value, b) in result.iter_mut().zip(&self.entries) {
                let mut sum = simd.mul_f64s(b[0].register::<S>(part), v[0].register::<S>(part));
                for cell in 1..CELLS {
                    sum = simd.mul_add_f64s(b[cell].register::<S>(part), v[cell].register::<S>(part), sum);
                }
                *value.register_mut::<S>(part) = sum;
            }
        }
    }

    /// Computes result = scale M local and returns local^T M local.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, scale: f64, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        let momenta = self.momenta(simd, local);
        let (mut velocities, mut form) = (momenta, Lanes::default());
        for cell in 0..CELLS {
            velocities[cell] = momenta[cell] * self.inverses[cell];
            form += momenta[cell] * velocities[cell];
            velocities[cell] = scale * velocities[cell];
        }
        self.spread(simd, velocities, result);
        form
    }

    /// Returns the velocities of the cells, C^-1 B local.
    #[inline(always)]
    fn velocities<S: Simd>(&self, simd: S, local: &[Lanes]) -> [Lanes; CELLS] {
        let mut velocities = self.momenta(simd, local);
        for cell in 0..CELLS {
            velocities[cell] = velocities[cell] * self.inverses[cell];
        }
        velocities
    }

    /// Adds scale M local to y and scale |M| |local| to m.
    #[inline(always)]
    fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
        let rows = &self.entries[..local.len()];
        for cell in 0..CELLS {
            let (mut v, mut magnitude) = (Lanes::default(), Lanes::default());
            for (b, value) in rows.iter().zip(local) {
                let term = b[cell] * *value;
                v += term;
                magnitude += term.abs();
            }
            let factor = scale * self.inverses[cell];
            let (v, magnitude) = (v * factor, magnitude * factor);
            for ((y, m), b) in y.iter_mut().zip(&mut *m).zip(rows) {
                *y += b[cell] * v;
                *m += b[cell].abs() * magnitude;
            }
        }
    }
}

/// Rows of eight units.
#[derive(Debug, Clone)]
pub(super) struct MassPanel {
    rows: Rows,
    /// Parts of the rows that products take instead of them, if a half turn maps all units onto
    /// themselves.
    half_turn: Option<HalfTurnMass>,
}

/// Rows of the cells of eight units, or of the first and the second cell of eight pairs.
#[derive(Debug, Clone)]
enum Rows {
    Cells(MassRows<1>),
    Pairs(MassRows<2>),
}

impl MassPanel {
    fn new(units: [&Unit; LANES], rows: &[SingularMassCell]) -> MassPanel {
        let half_turn = HalfTurnMass::new(units, rows);
        let first = units.map(|unit| unit.cell);
        // Either all units of a panel are pairs or none is.
        let rows = if units[0].second.is_none() {
            Rows::Cells(MassRows::new(units, [first], rows))
        } else {
            let second = units.map(|unit| unit.second.map_or(unit.cell, |(cell, _)| cell));
            Rows::Pairs(MassRows::new(units, [first, second], rows))
        };
        MassPanel { rows, half_turn }
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
        if let Some(half_turn) = &self.half_turn {
            return half_turn.apply(simd, registers, scale, local, result);
        }
        match &self.rows {
            Rows::Cells(rows) => rows.apply(simd, scale, local, result),
            Rows::Pairs(rows) => rows.apply(simd, scale, local, result),
        }
    }

    /// Returns the velocities of the first and the second cells, C^-1 B local.
    #[inline(always)]
    fn velocities<S: Simd>(&self, simd: S, local: &[Lanes]) -> [Lanes; 2] {
        match &self.rows {
            Rows::Cells(rows) => {
                let [first] = rows.velocities(simd, local);
                [first, Lanes::default()]
            }
            Rows::Pairs(rows) => rows.velocities(simd, local),
        }
    }

    /// Computes result = B^T v.
    #[inline(always)]
    fn spread<S: Simd>(&self, simd: S, [first, second]: [Lanes; 2], result: &mut [Lanes]) {
        match &self.rows {
            Rows::Cells(rows) => rows.spread(simd, [first], result),
            Rows::Pairs(rows) => rows.spread(simd, [first, second], result),
        }
    }

    /// Adds scale M local to y and scale |M| |local| to m.
    #[inline(always)]
    pub fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
        match &self.rows {
            Rows::Cells(rows) => rows.add_with_magnitude(scale, local, y, m),
            Rows::Pairs(rows) => rows.add_with_magnitude(scale, local, y, m),
        }
    }
}

/// Singular mass `$M = B^T C^{-1} B$`, with one average velocity per cell.
#[derive(Debug, Clone)]
pub struct SingularMassCells {
    batches: Rc<Batches>,
    panels: Rc<[MassPanel]>,
    masses: Rc<[f64]>,
    rows: Rc<[SingularMassCell]>,
}

impl SingularMassCells {
    /// Collects the rows of B and the diagonal of C, given the batches of the cells.
    pub(super) fn new(batches: Rc<Batches>, rows: impl Into<Rc<[SingularMassCell]>>) -> SingularMassCells {
        let rows = rows.into();
        let panels = batches.panels().map(|units| MassPanel::new(units, &rows)).collect();
        let masses = rows.iter().map(|row| row.mass).collect();
        SingularMassCells { batches, panels, masses, rows }
    }

    /// Returns the batches of the cells.
    pub(super) fn batches(&self) -> &Rc<Batches> {
        &self.batches
    }

    /// Returns the rows of B of a batch.
    #[inline(always)]
    pub(super) fn panel(&self, batch: &Batch) -> &MassPanel {
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

    /// Sets y, if it is wanted, to M x and returns x^T M x.
    #[inline(always)]
    pub(super) fn multiply<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        x: &[f64],
        mut y: Option<&mut [f64]>,
        strips: Strips,
    ) -> f64 {
        let mut form = Lanes::default();
        let is_wanted = y.is_some();
        for turn in &self.batches.turns.list {
            match turn {
                Turn::Enter(slot) => layout.lay_out(simd, slot, x, strips.x),
                Turn::Multiply(batches) => {
                    for batch in &self.batches.list[batches.clone()] {
                        let (local, Room { result, .. }) = strips.scratch.split(batch.size());
                        batch.gather(strips.x, local);
                        form += self.panel(batch).apply(simd, batch.registers::<S>(), 1.0, local, result);
                        if is_wanted {
                            batch.scatter(simd, [result], [strips.y]);
                        }
                    }
                }
                Turn::Leave(slot) => {
                    if let Some(y) = &mut y {
                        layout.take::<_, false>(simd, slot, strips.y, y);
                    }
                }
            }
        }
        form.sum()
    }

    /// Computes V = C^-1 B x.
    #[inline(always)]
    pub(super) fn project<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        x: &[f64],
        v: &mut [f64],
        strips: Strips,
    ) {
        for turn in &self.batches.turns.list {
            match turn {
                Turn::Enter(slot) => layout.lay_out(simd, slot, x, strips.x),
                Turn::Multiply(batches) => {
                    for batch in &self.batches.list[batches.clone()] {
                        let (local, _) = strips.scratch.split(batch.size());
                        batch.gather(strips.x, local);
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
                Turn::Leave(_) => {}
            }
        }
    }

    /// Computes y = B^T V.
    #[inline(always)]
    pub(super) fn project_transpose<S: Simd>(
        &self,
        simd: S,
        layout: &Layout,
        v: &[f64],
        y: &mut [f64],
        strips: Strips,
    ) {
        for turn in &self.batches.turns.list {
            match turn {
                Turn::Enter(_) => {}
                Turn::Multiply(batches) => {
                    for batch in &self.batches.list[batches.clone()] {
                        let (_, Room { result, .. }) = strips.scratch.split(batch.size());
                        let of = |cell: u32| v.get(cell as usize).copied().unwrap_or(0.0);
                        let velocities = batch.cells.map(|cells| Lanes(cells.map(of)));
                        self.panel(batch).spread(simd, velocities, result);
                        batch.scatter(simd, [result], [strips.y]);
                    }
                }
                Turn::Leave(slot) => layout.take::<_, false>(simd, slot, strips.y, y),
            }
        }
    }

    /// Returns V^T C V, twice the kinetic energy.
    pub(super) fn mass_norm_squared(&self, v: &[f64]) -> f64 {
        self.masses.iter().zip(v).map(|(c, v)| c * v * v).sum()
    }
}
