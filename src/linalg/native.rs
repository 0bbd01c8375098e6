//! Engine of one process: plain arrays and a sparse Cholesky factor.

use super::cholesky;
use super::form::{self, Form};
use super::{
    Cholesky, ElementMatrix, Engine, Factor, FactorSize, Indefinite, LinearCombination, MOST_SPOILT,
    RowCoupling, SingularMassCell, vectors,
};
use crate::communicator::SelfComm;
use crate::error::{Error, Result};
use crate::kernels::batch::{Batches, Cell};
use crate::kernels::cells::CellForm;
use crate::kernels::double_double::DoubleDouble;
use crate::kernels::layout::Layout;
use crate::kernels::singular_mass::SingularMassCells;
use crate::kernels::workspace::{Space, Workspace};
use crate::memory;
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use pulp::{Arch, Simd, WithSimd};
use std::cell::RefCell;
use std::rc::Rc;

/// Engine of one process, which owns all dofs.
#[derive(Debug)]
pub struct Native {
    layout: Layout,
    arch: Arch,
    /// Batches of the last form made, because the next form is likely to have the same cells.
    batches: RefCell<Option<Rc<Batches>>>,
    workspace: RefCell<Workspace>,
}

impl Native {
    /// Creates an engine for vectors of `dofs` free dofs.
    pub fn new(dofs: usize) -> Native {
        Native::with_layout(Layout::new(0..dofs))
    }

    /// Creates an engine with a dof layout made for the cells, which makes products faster.
    pub fn with_layout(layout: Layout) -> Native {
        let workspace = Workspace::new(&layout).into();
        Native { layout, arch: Arch::new(), batches: RefCell::default(), workspace }
    }

    /// Creates a form from the cells' dense local matrices.
    pub fn form(&self, blocks: Vec<ElementMatrix>) -> Form {
        let cells = blocks.iter().map(|block| (block.dofs.clone(), block.class)).collect();
        Form::Cells(CellForm::new(self.batches(cells), blocks))
    }

    /// Creates the singular mass from the cells' rows of B and entries of C.
    pub fn averages(&self, rows: Vec<SingularMassCell>) -> Form {
        let cells = rows.iter().map(|row| (row.dofs.clone(), row.class)).collect();
        Form::SingularMassCells(SingularMassCells::new(self.batches(cells), rows))
    }

    /// Returns the size of the factor of a sum of forms with some dofs (ascending) last.
    ///
    /// # Errors
    /// Returns [`Error::Memory`] where there is too little memory to find out.
    pub fn factor_size(&self, sum: &LinearCombination, last: &[usize]) -> Result<FactorSize> {
        Cholesky::size(&assembled(self.dofs(), sum)?, last)
    }

    /// Makes a pass over the cells.
    fn pass(&self, product: CellProduct) -> f64 {
        let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
        self.arch.dispatch(Pass { product, layout, space: workspace.space() })
    }

    /// Returns the batches of some cells, which the last form gives where its cells are the same.
    fn batches(&self, cells: Vec<Cell>) -> Rc<Batches> {
        let mut last = self.batches.borrow_mut();
        match &*last {
            Some(batches) if batches.cells == cells => batches.clone(),
            _ => {
                let batches = Rc::new(Batches::new(&self.layout, cells));
                self.workspace.borrow_mut().reserve(&batches);
                last.insert(batches).clone()
            }
        }
    }
}

/// Assembles the lower triangle of a sum of forms over a number of dofs.
fn assembled(dofs: usize, sum: &LinearCombination) -> Result<SparseColMat<usize, f64>> {
    assemble(dofs, sum, Some)
}

/// Assembles the lower triangle of a sum of forms over a number of dofs, whose numbers `number`
/// gives in the order of the cells' dofs; dofs without one have no rows.
pub(crate) fn assemble(
    dofs: usize,
    sum: &LinearCombination,
    number: impl Fn(usize) -> Option<usize>,
) -> Result<SparseColMat<usize, f64>> {
    let for_each = |visit: &mut dyn FnMut(usize, usize, f64)| {
        for (scale, form) in sum.terms() {
            form.for_each_lower(|row, column, value| {
                if let Some((row, column)) = number(row).zip(number(column)) {
                    visit(row, column, scale * value);
                }
            });
        }
    };
    let (pattern, values) =
        lower_triangle(dofs, |visit| for_each(&mut |_, column, _| visit(column)), |visit| for_each(visit))?;
    Ok(SparseColMat::new(pattern, values))
}

/// Factors a sum of forms over a number of dofs in double precision; `None` where it is not
/// positive definite.
fn in_doubles(dofs: usize, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Option<Cholesky>> {
    match Cholesky::new(assembled(dofs, sum)?, contact_dofs) {
        Ok(factor) => Ok(Some(factor)),
        Err(error @ Error::Memory(_)) => Err(error),
        Err(_) => Ok(None),
    }
}

/// Assembles the lower triangle of a sum of forms over a number of dofs in double-double
/// arithmetic.
pub(super) fn assembled_twice(
    dofs: usize,
    sum: &LinearCombination,
) -> Result<(SymbolicSparseColMat<usize>, Vec<DoubleDouble>)> {
    lower_triangle(dofs, |visit| visit_columns(sum, visit), |visit| visit_twice(sum, visit))
}

/// Visits the entries of the cells in the lower triangle of a sum of forms, in double-double
/// arithmetic.
fn visit_twice(sum: &LinearCombination, mut visit: impl FnMut(usize, usize, DoubleDouble)) {
    for (scale, form) in sum.terms() {
        form.for_each_lower_twice(|row, column, value| visit(row, column, value * (*scale).into()));
    }
}

/// Visits the columns of the entries of the cells in the lower triangle of a sum of forms.
fn visit_columns(sum: &LinearCombination, visit: &mut dyn FnMut(usize)) {
    for (_, form) in sum.terms() {
        form.for_each_lower(|_, column, _| visit(column));
    }
}

/// Contribution to an entry of a matrix with twice the digits of a double: row, column, and the two
/// doubles whose sum the value is.
pub type PreciseEntry = (usize, usize, f64, f64);

/// Returns the contributions of the cells to the lower triangle of a sum of forms, between dofs
/// with the numbers that `number` gives to the cells' dofs; dofs without one have no rows.
pub fn precise_entries(
    sum: &LinearCombination,
    number: impl Fn(usize) -> Option<usize>,
) -> Vec<PreciseEntry> {
    let mut entries = Vec::new();
    visit_twice(sum, |row, column, value| {
        if let (Some(row), Some(column)) = (number(row), number(column)) {
            entries.push((row.max(column), row.min(column), value.high, value.low));
        }
    });
    entries
}

/// Factors the symmetric matrix over a number of dofs with these contributions to its lower
/// triangle, the contact dofs last.
///
/// # Errors
/// Returns the errors of [`Cholesky::new`].
pub fn factor_precise(dofs: usize, entries: &[PreciseEntry], contact_dofs: &[usize]) -> Result<Cholesky> {
    let (pattern, values) = lower_triangle(
        dofs,
        |visit| entries.iter().for_each(|entry| visit(entry.1)),
        |visit| {
            for &(row, column, high, low) in entries {
                visit(row, column, DoubleDouble::new(high, low));
            }
        },
    )?;
    Cholesky::twice(pattern, values, contact_dofs)
}

/// Pass over the cells, compiled for the widest vector registers.
struct Pass<'a> {
    product: CellProduct<'a>,
    layout: &'a Layout,
    space: Space<'a>,
}

/// Result of a pass over the cells.
enum CellProduct<'a> {
    /// Product y = A x, with the value x^T A x.
    Whole(&'a Form, &'a [f64], &'a mut [f64]),
    /// Products y = A x and m = |A| |x|.
    WithMagnitude(&'a LinearCombination<'a>, &'a [f64], [&'a mut [f64]; 2]),
    /// Products y = A x with a sum, and z = A x with one of its forms.
    WithPart(&'a LinearCombination<'a>, &'a Form, &'a [f64], [&'a mut [f64]; 2]),
    /// Velocities V = C^-1 B x.
    Velocities(&'a SingularMassCells, &'a [f64], &'a mut [f64]),
    /// Momentum y = B^T V.
    Momenta(&'a SingularMassCells, &'a [f64], &'a mut [f64]),
}

impl WithSimd for Pass<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Pass { product, layout, space } = self;
        match product {
            CellProduct::Whole(form, x, y) => return form::multiply(simd, layout, form, x, y, space),
            CellProduct::WithMagnitude(sum, x, products) => {
                form::multiply_with_magnitude(simd, layout, sum.terms(), x, products, space);
            }
            CellProduct::WithPart(sum, part, x, products) => {
                form::multiply_with_part(simd, layout, (sum.terms(), part), x, products, space);
            }
            CellProduct::Velocities(mass, x, v) => mass.project(simd, layout, x, v, space),
            CellProduct::Momenta(mass, v, y) => mass.project_transpose(simd, layout, v, y, space),
        }
        0.0
    }
}

impl Engine for Native {
    type Comm = SelfComm;
    const REPEATS: bool = true;

    fn comm(&self) -> &SelfComm {
        &SelfComm
    }

    fn dofs(&self) -> usize {
        self.layout.dofs()
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64> {
        Ok(vectors::dot(x, y))
    }

    fn multiply_cells(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        Ok(self.pass(CellProduct::Whole(form, x, y)))
    }

    fn cell_velocities(&self, mass: &SingularMassCells, x: &[f64], v: &mut [f64]) -> Result<()> {
        self.pass(CellProduct::Velocities(mass, x, v));
        Ok(())
    }

    fn cell_momenta(&self, mass: &SingularMassCells, v: &[f64], y: &mut [f64]) -> Result<()> {
        self.pass(CellProduct::Momenta(mass, v, y));
        Ok(())
    }

    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<()> {
        self.pass(CellProduct::WithMagnitude(sum, x, products));
        Ok(())
    }

    fn multiply_with_part(
        &self,
        sum: &LinearCombination,
        part: &Form,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<bool> {
        let has_cells = !sum.has_modes();
        if has_cells {
            self.pass(CellProduct::WithPart(sum, part, x, products));
        }
        Ok(has_cells)
    }

    fn diagonal(&self, sum: &LinearCombination) -> Result<Vec<f64>> {
        let mut diagonal = vec![0.0; self.dofs()];
        for (scale, form) in sum.terms() {
            form.for_each_lower(|row, column, entry| {
                if row == column {
                    diagonal[row] += scale * entry;
                }
            });
        }
        Ok(diagonal)
    }

    fn couplings(&self, sum: &LinearCombination) -> Result<Vec<RowCoupling>> {
        let mut couplings = vec![RowCoupling::default(); self.dofs()];
        for (scale, form) in sum.terms() {
            form.for_each_cell(|dofs, entry| add_couplings(&mut couplings, dofs, |i, j| scale * entry(i, j)));
        }
        Ok(couplings)
    }

    fn require_memory(&self, sum: &LinearCombination, factors: usize) -> Result<()> {
        // A bound on the entries per column of L that no plate reaches: where it fits, the analysis
        // is not needed.
        let dofs = self.dofs() as u64;
        let fullest = 40 * u64::from(dofs.max(2).ilog2() + 1);
        let bytes = size_of::<f64>() as u64 * dofs * fullest * factors as u64;
        if memory::is_plenty_for(bytes) {
            return Ok(());
        }
        let size = self.factor_size(sum, &[])?;
        cholesky::require(&size, factors as u64, self.dofs())
    }

    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Box<dyn Factor>> {
        if let Some(mut factor) = in_doubles(self.dofs(), sum, contact_dofs)?
            && super::estimate_factor_error(self, sum, &mut factor)? <= MOST_SPOILT
        {
            return Ok(Box::new(factor));
        }
        let (pattern, values) = assembled_twice(self.dofs(), sum)?;
        Ok(Box::new(Cholesky::twice(pattern, values, contact_dofs)?))
    }

    fn rough_factor(&self, sum: &LinearCombination) -> Result<Option<Box<dyn Factor>>> {
        Ok(in_doubles(self.dofs(), sum, &[])?.map(|factor| Box::new(factor) as _))
    }

    fn factor_beyond(&self, k: &Form, m: &Form, sigma: f64) -> Result<Option<Indefinite>> {
        cholesky::factor_indefinite(&assembled(self.dofs(), &(k + m * -sigma))?).map(Some)
    }
}

/// Adds the magnitude of the coupling of each slope to the deflection of its node, for a cell with
/// three dofs per node.
fn add_couplings(couplings: &mut [RowCoupling], dofs: &[Option<usize>], entry: impl Fn(usize, usize) -> f64) {
    if !dofs.len().is_multiple_of(3) {
        return;
    }
    for (row, dof) in dofs.iter().enumerate().filter(|(row, _)| row % 3 > 0) {
        let first = row - row % 3;
        let Some((dof, to)) = dof.zip(dofs[first]) else { continue };
        let coupling = &mut couplings[dof];
        // Couplings of one dof to several others would not add up to a part of its row.
        if coupling.magnitude == 0.0 || coupling.to == to as u32 {
            coupling.to = to as u32;
            coupling.magnitude += entry(row, first).abs();
        }
    }
}

/// Assembles a lower triangle, column by column, from contributions to its entries, which both
/// functions visit in the same order: the first one their columns, the second one also their rows
/// and values.
pub(crate) fn lower_triangle<V: Copy + Default + std::iter::Sum>(
    dofs: usize,
    visit_columns: impl Fn(&mut dyn FnMut(usize)),
    visit_entries: impl Fn(&mut dyn FnMut(usize, usize, V)),
) -> Result<(SymbolicSparseColMat<usize>, Vec<V>)> {
    // All entries of the cells are first sorted into their columns; equal rows are then added up.
    let mut starts = vec![0; dofs + 1];
    visit_columns(&mut |column| starts[column + 1] += 1);
    for column in 0..dofs {
        starts[column + 1] += starts[column];
    }
    // About half of the entries share their position with others.
    let bytes = (starts[dofs] * (3 * size_of::<(usize, V)>() / 2)) as u64;
    memory::require(bytes, &format!("assembling the matrix of {dofs} dofs"), |part| {
        cholesky::would_fit(part, dofs)
    })?;
    let mut next = starts.clone();
    let mut entries = vec![(0, V::default()); starts[dofs]];
    visit_entries(&mut |row, column, value| {
        entries[next[column]] = (row, value);
        next[column] += 1;
    });
    let (mut columns, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for range in starts.windows(2) {
        let column = &mut entries[range[0]..range[1]];
        // A stable sort gives a sum the same roundings in every run.
        column.sort_by_key(|(row, _)| *row);
        for same in column.chunk_by(|a, b| a.0 == b.0) {
            rows.push(same[0].0);
            values.push(same.iter().map(|(_, value)| *value).sum());
        }
        columns.push(rows.len());
    }
    Ok((SymbolicSparseColMat::new_checked(dofs, dofs, columns, None, rows), values))
}
