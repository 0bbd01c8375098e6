//! Symmetric forms that are stored cell by cell and applied to eight cells at once.
//!
//! The local matrices of a batch are interleaved, one cell per lane, in a *panel*. Congruent cells
//! share one panel, so that a regular mesh reads its stiffness from the cache. Two triangles may be
//! one unit of a batch, see [`super::joined`]. All vectors over the dofs are in layout order, see
//! [`super::batch`].

use super::batch::{Batch, Batches};
use super::joined::{Cell, Unit};
use super::lane_values::{LANES, Lanes};
use super::strains::Strains;
use super::{ElementMatrix, MassModes, SingularMassCell};
use pulp::Simd;
use std::borrow::Cow;
use std::rc::Rc;

/// Interleaves the values of eight units, one unit per lane.
fn interleave(values: &[Cow<[f64]>; LANES]) -> Vec<Lanes> {
    let mut panel = vec![Lanes::default(); values[0].len()];
    for (lane, values) in values.iter().enumerate() {
        for (slot, value) in panel.iter_mut().zip(&**values) {
            slot.0[lane] = *value;
        }
    }
    panel
}

/// Local matrices of eight cells.
#[derive(Debug, Clone)]
struct Panel {
    matrix: Vec<Lanes>,
    /// Factored representation that is applied instead of the matrix, if there is one.
    strains: Option<Strains>,
    /// Whether all cells are springs between two dofs, k (a - b)^2 / 2. Their product is computed
    /// from the difference, which a stiff spring leaves much smaller than a and b.
    is_difference: bool,
    /// Whether all matrices of more than two dofs are diagonal.
    is_diagonal: bool,
}

impl Panel {
    fn new(units: [&Unit; LANES], blocks: &[ElementMatrix]) -> Panel {
        let size = units[0].dofs.len();
        let matrices = units.map(|unit| unit.matrix(blocks));
        let bending = units.map(|unit| unit.bending(blocks));
        let bending = bending.each_ref().map(Option::as_deref);
        Panel {
            matrix: interleave(&matrices),
            // Either all units of a panel have it or none has.
            strains: bending[0].and_then(|first| Strains::new(bending.map(|unit| unit.unwrap_or(first)))),
            is_difference: matrices.iter().all(|matrix| is_difference(matrix)),
            is_diagonal: size > 2 && matrices.iter().all(|matrix| is_diagonal(matrix, size)),
        }
    }

    /// Computes result = A local and returns local^T A local.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        if let Some(strains) = &self.strains {
            return strains.apply(simd, local, result);
        }
        if self.is_difference {
            let difference = local[0] - local[1];
            result[0] = self.matrix[0] * difference;
            result[1] = self.matrix[1] * difference;
            return result[0] * difference;
        }
        if self.is_diagonal {
            let diagonal = self.matrix.iter().step_by(local.len() + 1);
            let mut form = Lanes::default();
            for ((result, value), entry) in result.iter_mut().zip(local).zip(diagonal) {
                *result = *entry * *value;
                form += *result * *value;
            }
            return form;
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
    fn add_with_magnitude<S: Simd>(&self, simd: S, scale: f64, local: &[Lanes], room: Room) {
        let Room { work, result, y, m } = room;
        if self.is_diagonal {
            let diagonal = self.matrix.iter().step_by(local.len() + 1);
            for (((y, m), value), entry) in y.iter_mut().zip(m).zip(local).zip(diagonal) {
                let term = scale * (*entry * *value);
                *y += term;
                *m += term.abs();
            }
            return;
        }
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

/// Returns whether a local matrix is that of a spring between two dofs, (k, -k, -k, k).
fn is_difference(matrix: &[f64]) -> bool {
    matches!(*matrix, [a, b, c, d] if a == d && b == -a && c == b)
}

/// Returns whether a local matrix of `size` rows is diagonal.
fn is_diagonal(matrix: &[f64], size: usize) -> bool {
    matrix.iter().enumerate().all(|(place, entry)| place % (size + 1) == 0 || *entry == 0.0)
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
    batches: Rc<Batches>,
    panels: Rc<[Panel]>,
    blocks: Rc<[ElementMatrix]>,
}

impl CellForm {
    /// Collects the cells' local matrices, given the batches of the cells.
    pub(super) fn new(batches: Rc<Batches>, blocks: impl Into<Rc<[ElementMatrix]>>) -> CellForm {
        let blocks = blocks.into();
        let panels = batches.panels().map(|units| Panel::new(units, &blocks)).collect();
        CellForm { batches, panels, blocks }
    }

    /// Returns the cells' contributions, for assembly.
    pub fn blocks(&self) -> &[ElementMatrix] {
        &self.blocks
    }

    /// Calls `visit` with the free dofs and the local matrix of each cell, or of each pair of cells
    /// that is multiplied as one.
    pub(super) fn for_each_unit(&self, mut visit: impl FnMut(&[Option<usize>], &[f64])) {
        for unit in self.batches.units() {
            visit(&unit.dofs, &unit.matrix(&self.blocks));
        }
    }

    /// Adds A x to y and returns x^T A x.
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
            form += match batch.size() {
                9 => self.add_batch(simd, batch, x, y, scratch.split(9)),
                12 => self.add_batch(simd, batch, x, y, scratch.split(12)),
                size => self.add_batch(simd, batch, x, y, scratch.split(size)),
            };
        }
        form.sum()
    }

    /// Adds the product of one batch. The compiler unrolls its loops for the numbers of dofs that
    /// plate elements have.
    #[inline(always)]
    fn add_batch<S: Simd>(
        &self,
        simd: S,
        batch: &Batch,
        x: &[f64],
        y: &mut [f64],
        (local, Room { result, .. }): (&mut [Lanes], Room),
    ) -> Lanes {
        batch.gather(x, local);
        let form = self.panels[batch.panel].apply(simd, local, result);
        batch.scatter(simd, [result], [y]);
        form
    }
}

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
struct Rows {
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
    fn apply<S: Simd>(&self, simd: S, scale: f64, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
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
    fn add_with_magnitude(&self, scale: f64, local: &[Lanes], y: &mut [Lanes], m: &mut [Lanes]) {
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
            let rows = &self.panels[batch.panel];
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
            let velocities = self.panels[batch.panel].velocities(simd, local);
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
            self.panels[batch.panel].spread(simd, batch.cells.map(|cells| Lanes(cells.map(of))), result);
            batch.scatter(simd, [result], [y]);
        }
    }

    /// Returns V^T C V, twice the kinetic energy.
    pub(super) fn mass_norm_squared(&self, v: &[f64]) -> f64 {
        self.masses.iter().zip(v).map(|(c, v)| c * v * v).sum()
    }
}

/// Symmetric form of the native engine. Clones share its cells.
#[derive(Debug, Clone)]
pub enum Form {
    /// Form of dense local matrices, such as K or M_r.
    Cells(CellForm),
    /// Singular mass `$B^T C^{-1} B$`, of rank one per cell.
    SingularMassCells(SingularMassCells),
    /// Singular mass of the lowest modes, of rank one per mode.
    Modal {
        /// Consistent mass of the modes, which takes the place of the singular one wherever entries
        /// of a sparse matrix are needed.
        consistent: CellForm,
        /// Modes that carry the inertia.
        modes: Rc<MassModes>,
    },
}

impl Form {
    /// Returns the same form with other batches of its cells; `None` for a modal mass.
    pub(super) fn with_batches(&self, batches: impl FnOnce(Vec<Cell>) -> Rc<Batches>) -> Option<Form> {
        match self {
            Form::Cells(form) => {
                let cells = form.blocks.iter().map(|block| (block.dofs.clone(), block.class)).collect();
                Some(Form::Cells(CellForm::new(batches(cells), form.blocks.clone())))
            }
            Form::SingularMassCells(form) => {
                let cells = form.rows.iter().map(|row| (row.dofs.clone(), row.class)).collect();
                Some(Form::SingularMassCells(SingularMassCells::new(batches(cells), form.rows.clone())))
            }
            Form::Modal { .. } => None,
        }
    }

    /// Returns whether both forms have the same contributions of cells, bit for bit. Modal masses
    /// are not compared, and are never equal.
    pub fn equals(&self, other: &Form) -> bool {
        match (self, other) {
            (Form::Cells(own), Form::Cells(other)) => own.blocks == other.blocks,
            (Form::SingularMassCells(own), Form::SingularMassCells(other)) => own.rows == other.rows,
            (Form::Modal { consistent: own, modes }, Form::Modal { consistent: other, modes: of_other }) => {
                own.blocks == other.blocks
                    && modes.squares == of_other.squares
                    && modes.shapes == of_other.shapes
            }
            _ => false,
        }
    }

    fn batches(&self) -> &Rc<Batches> {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => &cells.batches,
            Form::SingularMassCells(averages) => &averages.batches,
        }
    }
}

/// Adds A x to y and |A| |x| to m for a sum of forms. Successive forms over the same cells are
/// applied in one pass over their batches.
#[inline(always)]
pub(super) fn add_with_magnitude<S: Simd>(
    simd: S,
    sum: &[(f64, &Form)],
    x: &[f64],
    y: &mut [f64],
    m: &mut [f64],
    scratch: &mut Scratch,
) {
    let mut sums = ProductSums { y, m };
    let mut rest = sum;
    while let [(_, first), ..] = rest {
        let mut count = 1;
        while count < rest.len() && Rc::ptr_eq(rest[count].1.batches(), first.batches()) {
            count += 1;
        }
        for batch in &first.batches().list {
            let forms = &rest[..count];
            match batch.size() {
                9 => add_batch_with_magnitude(simd, batch, forms, x, &mut sums, scratch.split(9)),
                12 => add_batch_with_magnitude(simd, batch, forms, x, &mut sums, scratch.split(12)),
                size => add_batch_with_magnitude(simd, batch, forms, x, &mut sums, scratch.split(size)),
            }
        }
        rest = &rest[count..];
    }
}

/// Vectors to which A x and |A| |x| are added, one entry per dof.
struct ProductSums<'a> {
    y: &'a mut [f64],
    m: &'a mut [f64],
}

/// Adds the products of one batch. The compiler unrolls its loops for the numbers of dofs that
/// plate elements have.
#[inline(always)]
fn add_batch_with_magnitude<S: Simd>(
    simd: S,
    batch: &Batch,
    forms: &[(f64, &Form)],
    x: &[f64],
    sums: &mut ProductSums,
    (local, mut room): (&mut [Lanes], Room),
) {
    batch.gather(x, local);
    room.y.fill(Lanes::default());
    room.m.fill(Lanes::default());
    for &(scale, form) in forms {
        match form {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                cells.panels[batch.panel].add_with_magnitude(simd, scale, local, room.reborrow());
            }
            Form::SingularMassCells(averages) => {
                averages.panels[batch.panel].add_with_magnitude(scale, local, room.y, room.m);
            }
        }
    }
    batch.scatter(simd, [room.y, room.m], [sums.y, sums.m]);
}

/// Adds `part` x to z, with `part` one form of a sum, and the weighted products of x with all other
/// forms to y. Successive forms over the same cells are applied in one pass over their batches.
#[inline(always)]
pub(super) fn add_with_part<S: Simd>(
    simd: S,
    sum: &[(f64, &Form)],
    part: &Form,
    x: &[f64],
    (y, z): (&mut [f64], &mut [f64]),
    scratch: &mut Scratch,
) {
    let mut products = PartProducts { part, y, z };
    for forms in sum.chunk_by(|(_, a), (_, b)| Rc::ptr_eq(a.batches(), b.batches())) {
        for batch in &forms[0].1.batches().list {
            match batch.size() {
                9 => add_batch_with_part(simd, batch, forms, x, &mut products, scratch.split(9)),
                12 => add_batch_with_part(simd, batch, forms, x, &mut products, scratch.split(12)),
                size => add_batch_with_part(simd, batch, forms, x, &mut products, scratch.split(size)),
            }
        }
    }
}

/// Vectors to which the product of one form, z, and those of all others, y, are added, one entry
/// per dof.
struct PartProducts<'a> {
    part: &'a Form,
    y: &'a mut [f64],
    z: &'a mut [f64],
}

/// Adds the products of one batch. The compiler unrolls its loops for the numbers of dofs that
/// plate elements have.
#[inline(always)]
fn add_batch_with_part<S: Simd>(
    simd: S,
    batch: &Batch,
    forms: &[(f64, &Form)],
    x: &[f64],
    products: &mut PartProducts,
    (local, Room { work, result, y, .. }): (&mut [Lanes], Room),
) {
    batch.gather(x, local);
    let (mut has_part, mut has_others) = (false, false);
    for &(scale, form) in forms {
        let is_part = std::ptr::eq(form, products.part);
        let scale = if is_part { 1.0 } else { scale };
        let term = match (is_part, has_others) {
            (true, _) => &mut *result,
            (false, false) => &mut *y,
            (false, true) => &mut *work,
        };
        match form {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                cells.panels[batch.panel].apply(simd, local, term);
                if !is_part {
                    term.iter_mut().for_each(|term| *term = scale * *term);
                }
            }
            Form::SingularMassCells(averages) => {
                let rows = &averages.panels[batch.panel];
                rows.apply(simd, scale, local, term);
            }
        }
        if !is_part && has_others {
            y.iter_mut().zip(&*work).for_each(|(sum, term)| *sum += *term);
        }
        has_part |= is_part;
        has_others |= !is_part;
    }
    match (has_part, has_others) {
        (true, true) => batch.scatter(simd, [result, y], [&mut *products.z, &mut *products.y]),
        (true, false) => batch.scatter(simd, [result], [&mut *products.z]),
        (false, _) => batch.scatter(simd, [y], [&mut *products.y]),
    }
}

/// Scratch space for the local vectors of one batch.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    lanes: Vec<Lanes>,
}

/// Scratch vectors beside the cells' own dofs.
struct Room<'a> {
    work: &'a mut [Lanes],
    result: &'a mut [Lanes],
    y: &'a mut [Lanes],
    m: &'a mut [Lanes],
}

impl Room<'_> {
    #[inline(always)]
    fn reborrow(&mut self) -> Room<'_> {
        Room { work: self.work, result: self.result, y: self.y, m: self.m }
    }
}

impl Scratch {
    /// Makes room for cells of up to `size` dofs.
    pub fn reserve(&mut self, size: usize) {
        self.lanes.resize((5 * size).max(self.lanes.len()), Lanes::default());
    }

    #[inline(always)]
    fn split(&mut self, size: usize) -> (&mut [Lanes], Room<'_>) {
        let (local, rest) = self.lanes[..5 * size].split_at_mut(size);
        let (work, rest) = rest.split_at_mut(size);
        let (result, rest) = rest.split_at_mut(size);
        let (y, m) = rest.split_at_mut(size);
        (local, Room { work, result, y, m })
    }
}
