//! Symmetric forms of the native engine, their entries, and products with sums of them.

use super::batch::{Batch, Batches};
use super::cells::CellForm;
use super::double_double::DoubleDouble;
use super::joined::Cell;
use super::lane_values::Lanes;
use super::scratch::{Room, Scratch};
use super::singular_mass::SingularMassCells;
use super::{ElementMatrix, MassModes, SingularMassCell};
use pulp::Simd;
use std::rc::Rc;

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
            Form::Cells(cells) => Some(Form::Cells(cells.with_batches(batches))),
            Form::SingularMassCells(averages) => {
                Some(Form::SingularMassCells(averages.with_batches(batches)))
            }
            Form::Modal { .. } => None,
        }
    }

    /// Returns whether both forms have the same contributions of cells, bit for bit. Modal masses
    /// are not compared, and are never equal.
    pub fn equals(&self, other: &Form) -> bool {
        match (self, other) {
            (Form::Cells(own), Form::Cells(other)) => own.blocks() == other.blocks(),
            (Form::SingularMassCells(own), Form::SingularMassCells(other)) => own.rows() == other.rows(),
            (Form::Modal { consistent: own, modes }, Form::Modal { consistent: other, modes: of_other }) => {
                own.blocks() == other.blocks()
                    && modes.squares == of_other.squares
                    && modes.shapes == of_other.shapes
            }
            _ => false,
        }
    }

    /// Calls `visit(row, column, entry)` for the lower triangle of each cell's contribution.
    pub fn for_each_lower(&self, mut visit: impl FnMut(usize, usize, f64)) {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                for ElementMatrix { dofs, matrix, .. } in cells.blocks() {
                    visit_lower(dofs, |i, j| matrix[i * dofs.len() + j], &mut visit);
                }
            }
            Form::SingularMassCells(averages) => {
                for SingularMassCell { dofs, row, mass, .. } in averages.rows() {
                    visit_lower(dofs, |i, j| row[i] * row[j] / mass, &mut visit);
                }
            }
        }
    }

    /// Calls `visit` as [`Form::for_each_lower`] does, in double-double arithmetic: these are the
    /// entries of the operator that products apply, which may differ from the rounded local
    /// matrices.
    pub(super) fn for_each_lower_twice(&self, mut visit: impl FnMut(usize, usize, DoubleDouble)) {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                for ElementMatrix { dofs, matrix, bending, .. } in cells.blocks() {
                    match bending {
                        None => visit_lower(dofs, |i, j| matrix[i * dofs.len() + j].into(), &mut visit),
                        Some(bending) => {
                            let strains = bending.strains();
                            let dot = |a: &[DoubleDouble], b: &[DoubleDouble]| {
                                a.iter().zip(b).map(|(a, b)| *a * *b).sum()
                            };
                            visit_lower(dofs, |i, j| dot(&strains[i], &strains[j]), &mut visit);
                        }
                    }
                }
            }
            Form::SingularMassCells(averages) => {
                for SingularMassCell { dofs, row, mass, .. } in averages.rows() {
                    let entry = |i: usize, j: usize| DoubleDouble::product(row[i], row[j]) / (*mass).into();
                    visit_lower(dofs, entry, &mut visit);
                }
            }
        }
    }

    fn batches(&self) -> &Rc<Batches> {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => cells.batches(),
            Form::SingularMassCells(averages) => averages.batches(),
        }
    }
}

/// Calls `visit` for the entries of a cell's matrix that lie in the global lower triangle.
fn visit_lower<V>(
    dofs: &[Option<usize>],
    entry: impl Fn(usize, usize) -> V,
    visit: &mut impl FnMut(usize, usize, V),
) {
    for (i, row) in dofs.iter().enumerate() {
        let Some(row) = *row else { continue };
        for (j, column) in dofs.iter().enumerate() {
            if let Some(column) = column.filter(|&column| row >= column) {
                visit(row, column, entry(i, j));
            }
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
                cells.panel(batch).add_with_magnitude(simd, scale, local, room.reborrow());
            }
            Form::SingularMassCells(averages) => {
                averages.panel(batch).add_with_magnitude(scale, local, room.y, room.m);
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
                cells.panel(batch).apply(simd, local, term);
                if !is_part {
                    term.iter_mut().for_each(|term| *term = scale * *term);
                }
            }
            Form::SingularMassCells(averages) => {
                averages.panel(batch).apply(simd, scale, local, term);
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
