//! Symmetric forms of the native engine, their entries, and products with sums of them.

use super::{ElementMatrix, MassModes, SingularMassCell};
use crate::kernels::batch::{Batch, Batches};
use crate::kernels::cells::CellForm;
use crate::kernels::double_double::DoubleDouble;
use crate::kernels::lane_values::Lanes;
use crate::kernels::layout::Layout;
use crate::kernels::singular_mass::SingularMassCells;
use crate::kernels::workspace::{Room, Space};
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
    /// Returns whether the form is a singular mass, `$M = B^T C^{-1} B$`, which leaves part of the
    /// displacement without inertia.
    pub fn is_singular(&self) -> bool {
        !matches!(self, Form::Cells(_))
    }

    /// Returns whether both forms have the same contributions of cells and the same modes, bit for
    /// bit.
    pub fn equals(&self, other: &Form) -> bool {
        match (self, other) {
            (Form::Cells(cells), Form::Cells(other)) => cells.blocks == other.blocks,
            (Form::SingularMassCells(cells), Form::SingularMassCells(other)) => cells.rows() == other.rows(),
            (Form::Modal { consistent, modes }, Form::Modal { consistent: cells, modes: others }) => {
                consistent.blocks == cells.blocks
                    && modes.squares == others.squares
                    && modes.shapes == others.shapes
            }
            _ => false,
        }
    }

    /// Calls `visit` with the dofs of each cell and the entries of its local matrix.
    pub(super) fn for_each_cell(
        &self,
        mut visit: impl FnMut(&[Option<usize>], &dyn Fn(usize, usize) -> f64),
    ) {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                for ElementMatrix { dofs, matrix, .. } in &*cells.blocks {
                    visit(dofs, &|i, j| matrix[i * dofs.len() + j]);
                }
            }
            Form::SingularMassCells(averages) => {
                for SingularMassCell { dofs, row, mass, .. } in averages.rows() {
                    visit(dofs, &|i, j| row[i] * row[j] / mass);
                }
            }
        }
    }

    /// Calls `visit(row, column, entry)` for the lower triangle of each cell's contribution.
    pub fn for_each_lower(&self, mut visit: impl FnMut(usize, usize, f64)) {
        self.for_each_cell(|dofs, entry| visit_lower(dofs, entry, &mut visit));
    }

    /// Calls `visit` as [`Form::for_each_lower`] does, in double-double arithmetic: these are the
    /// entries of the operator that products apply, which may differ from the rounded local
    /// matrices.
    pub(super) fn for_each_lower_twice(&self, mut visit: impl FnMut(usize, usize, DoubleDouble)) {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                for ElementMatrix { dofs, matrix, bending, .. } in &*cells.blocks {
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
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => &cells.batches,
            Form::SingularMassCells(averages) => &averages.batches,
        }
    }

    /// Computes the products of a batch with its local vectors and returns their forms x^T A x.
    #[inline(always)]
    fn apply<S: Simd>(&self, simd: S, batch: &Batch, local: &[Lanes], result: &mut [Lanes]) -> Lanes {
        match self {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                cells.panel(batch).apply(simd, local, result)
            }
            Form::SingularMassCells(averages) => averages.panel(batch).apply(simd, local, result),
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

/// Returns the successive forms of a sum that have the same cells.
fn by_cells<'a, 'f>(sum: &'a [(f64, &'f Form)]) -> impl Iterator<Item = &'a [(f64, &'f Form)]> {
    sum.chunk_by(|(_, a), (_, b)| Rc::ptr_eq(a.batches(), b.batches()))
}

/// Sets y to A x and returns x^T A x.
#[inline(always)]
pub(super) fn multiply<S: Simd>(
    simd: S,
    layout: &Layout,
    form: &Form,
    x: &[f64],
    y: &mut [f64],
    mut space: Space,
) -> f64 {
    layout.lay_out(simd, x, space.x);
    let mut square = Lanes::default();
    form.batches().for_each(
        #[inline(always)]
        |batch, size| {
            let (local, Room { result, .. }) = space.scratch.split(size);
            batch.gather(space.x, local);
            square += form.apply(simd, batch, local, result);
            batch.scatter(simd, [result], [space.y]);
        },
    );
    layout.take(simd, space.y, y);
    square.sum()
}

/// Sets y to A x and m to |A| |x| for a sum of forms. Successive forms over the same cells are
/// applied in one pass over their batches.
#[inline(always)]
pub(super) fn multiply_with_magnitude<S: Simd>(
    simd: S,
    layout: &Layout,
    sum: &[(f64, &Form)],
    x: &[f64],
    [y, m]: [&mut [f64]; 2],
    mut space: Space,
) {
    layout.lay_out(simd, x, space.x);
    for forms in by_cells(sum) {
        forms[0].1.batches().for_each(
            #[inline(always)]
            |batch, size| {
                let (local, mut room) = space.scratch.split(size);
                batch.gather(space.x, local);
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
                batch.scatter(simd, [room.y, room.m], [space.y, space.z]);
            },
        );
    }
    layout.take(simd, space.y, y);
    layout.take(simd, space.z, m);
}

/// Sets z to `part` x, with `part` one form of a sum, and y to A x with the sum. Successive forms
/// over the same cells are applied in one pass over their batches.
#[inline(always)]
pub(super) fn multiply_with_part<S: Simd>(
    simd: S,
    layout: &Layout,
    (sum, part): (&[(f64, &Form)], &Form),
    x: &[f64],
    [y, z]: [&mut [f64]; 2],
    mut space: Space,
) {
    let is_part = |form: &Form| std::ptr::eq(form, part);
    layout.lay_out(simd, x, space.x);
    for forms in by_cells(sum) {
        forms[0].1.batches().for_each(
            #[inline(always)]
            |batch, size| add_batch_with_part(simd, batch, (forms, part), &mut space, size),
        );
    }
    let weights = sum.iter().filter(|(_, form)| is_part(form));
    let weight: f64 = weights.map(|(weight, _)| weight).sum();
    space.y.iter_mut().zip(&*space.z).for_each(|(sum, part)| *sum += weight * part);
    layout.take(simd, space.y, y);
    layout.take(simd, space.z, z);
}

/// Adds `part` x of one batch to z, with `part` one of some forms, and the weighted products with
/// the others to y.
#[inline(always)]
fn add_batch_with_part<S: Simd>(
    simd: S,
    batch: &Batch,
    (forms, part): (&[(f64, &Form)], &Form),
    space: &mut Space,
    size: usize,
) {
    let (local, Room { work, result, y, .. }) = space.scratch.split(size);
    batch.gather(space.x, local);
    let (mut has_part, mut has_others) = (false, false);
    for &(scale, form) in forms {
        let is_part = std::ptr::eq(form, part);
        let term = match (is_part, has_others) {
            (true, _) => &mut *result,
            (false, false) => &mut *y,
            (false, true) => &mut *work,
        };
        form.apply(simd, batch, local, term);
        if !is_part {
            term.iter_mut().for_each(|term| *term = scale * *term);
        }
        if !is_part && has_others {
            y.iter_mut().zip(&*work).for_each(|(sum, term)| *sum += *term);
        }
        has_part |= is_part;
        has_others |= !is_part;
    }
    match (has_part, has_others) {
        (true, true) => batch.scatter(simd, [result, y], [space.z, space.y]),
        (true, false) => batch.scatter(simd, [result], [space.z]),
        (false, _) => batch.scatter(simd, [y], [space.y]),
    }
}
