//! Engine of one process: plain arrays and a sparse Cholesky factor.

use super::cholesky;
use super::form::{self, Form};
use super::{
    Cholesky, ElementMatrix, Engine, Indefinite, LinearCombination, MOST_SPOILT, RowCoupling,
    SingularMassCell, vectors,
};
use crate::communicator::SelfComm;
use crate::error::{Error, Result};
use crate::kernels::batch::{Batches, Cell};
use crate::kernels::cells::CellForm;
use crate::kernels::double_double::DoubleDouble;
use crate::kernels::layout::Layout;
use crate::kernels::singular_mass::SingularMassCells;
use crate::kernels::workspace::{Strips, Workspace};
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
        Native { layout, arch: Arch::new(), batches: RefCell::default(), workspace: RefCell::default() }
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

    /// Sets y, if it is wanted, to A x and returns x^T A x.
    fn product(&self, form: &Form, x: &[f64], y: Option<&mut [f64]>) -> f64 {
        let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
        self.arch.dispatch(Product { form, layout, x, y, strips: workspace.strips() })
    }

    /// Returns the batches of some cells, those of the last form where the cells are the same.
    fn batches(&self, cells: Vec<Cell>) -> Rc<Batches> {
        let mut last = self.batches.borrow_mut();
        match &*last {
            Some(batches) if batches.are_of(&cells) => batches.clone(),
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
    let (pattern, values) = lower_triangle(
        dofs,
        |visit| visit_columns(sum, visit),
        |visit| {
            for (scale, form) in sum.terms() {
                form.for_each_lower(|row, column, value| visit(row, column, scale * value));
            }
        },
    )?;
    Ok(SparseColMat::new(pattern, values))
}

/// Factors a sum of forms over a number of dofs in double precision; `None` where it is not
/// positive definite.
pub(super) fn in_doubles(
    dofs: usize,
    sum: &LinearCombination,
    contact_dofs: &[usize],
) -> Result<Option<Cholesky>> {
    match Cholesky::new(assembled(dofs, sum)?, contact_dofs) {
        Ok(factor) => Ok(Some(factor)),
        Err(error @ Error::Memory(_)) => Err(error),
        Err(_) => Ok(None),
    }
}

/// Factors a sum of forms over a number of dofs in double-double arithmetic.
pub(super) fn in_double_doubles(
    dofs: usize,
    sum: &LinearCombination,
    contact_dofs: &[usize],
) -> Result<Cholesky> {
    let (pattern, values) = assembled_twice(dofs, sum)?;
    Cholesky::twice(pattern, values, contact_dofs)
}

/// Assembles the lower triangle of a sum of forms over a number of dofs in double-double
/// arithmetic.
fn assembled_twice(
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
/// with the numbers that `number` gives to those of the cells; dofs without one have no rows.
pub fn precise_entries(
    sum: &LinearCombination,
    number: impl Fn(usize) -> Option<usize>,
) -> Vec<PreciseEntry> {
    let mut entries = Vec::new();
    visit_twice(sum, |row, column, value| {
        if let (Some(row), Some(column)) = (number(row), number(column)) {
            entries.push((row.max(column), row.min(column), value.round(), value.rest()));
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

/// Product y = A x, compiled for the widest vector registers.
struct Product<'a> {
    form: &'a Form,
    layout: &'a Layout,
    x: &'a [f64],
    y: Option<&'a mut [f64]>,
    strips: Strips<'a>,
}

impl WithSimd for Product<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        match self.form {
            Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                cells.multiply(simd, self.layout, self.x, self.y, self.strips)
            }
            Form::SingularMassCells(averages) => {
                averages.multiply(simd, self.layout, self.x, self.y, self.strips)
            }
        }
    }
}

/// Products y = A x and m = |A| |x|.
struct WithMagnitude<'a> {
    sum: &'a LinearCombination<'a>,
    layout: &'a Layout,
    x: &'a [f64],
    products: (&'a mut [f64], &'a mut [f64]),
    strips: Strips<'a>,
}

impl WithSimd for WithMagnitude<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let WithMagnitude { sum, layout, x, products, strips } = self;
        form::multiply_with_magnitude(simd, layout, sum.terms(), x, products, strips);
    }
}

/// Products y = A x with a sum, and z = `part` x with one of its forms.
struct WithPart<'a> {
    sum: &'a LinearCombination<'a>,
    part: &'a Form,
    layout: &'a Layout,
    x: &'a [f64],
    products: (&'a mut [f64], &'a mut [f64]),
    strips: Strips<'a>,
}

impl WithSimd for WithPart<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let WithPart { sum, part, layout, x, products, strips } = self;
        form::multiply_with_part(simd, layout, (sum.terms(), part), x, products, strips);
    }
}

/// Velocities V = C^-1 B x.
struct Velocity<'a> {
    averages: &'a SingularMassCells,
    layout: &'a Layout,
    x: &'a [f64],
    v: &'a mut [f64],
    strips: Strips<'a>,
}

impl WithSimd for Velocity<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.averages.project(simd, self.layout, self.x, self.v, self.strips);
    }
}

/// Momentum y = B^T V.
struct Momentum<'a> {
    averages: &'a SingularMassCells,
    layout: &'a Layout,
    v: &'a [f64],
    y: &'a mut [f64],
    strips: Strips<'a>,
}

impl WithSimd for Momentum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        self.averages.project_transpose(simd, self.layout, self.v, self.y, self.strips);
    }
}

impl Engine for Native {
    type Factor = Cholesky;
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

    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        if let Form::Modal { modes, .. } = form {
            let mut v = vec![0.0; modes.count()];
            modes.project(x, &mut v);
            modes.project_transpose(&v, y);
            return Ok(vectors::dot(&v, &v));
        }
        Ok(self.product(form, x, Some(y)))
    }

    fn quadratic_form(&self, form: &Form, x: &[f64]) -> Result<f64> {
        if let Form::Modal { .. } = form {
            return self.multiply(form, x, &mut vec![0.0; x.len()]);
        }
        Ok(self.product(form, x, None))
    }

    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
    ) -> Result<()> {
        let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
        let (products, strips) = ((y, m), workspace.strips());
        self.arch.dispatch(WithMagnitude { sum, layout, x, products, strips });
        Ok(())
    }

    fn multiply_with_part(
        &self,
        sum: &LinearCombination,
        part: &Form,
        x: &[f64],
        products: (&mut [f64], &mut [f64]),
    ) -> Result<bool> {
        if sum.terms().iter().any(|(_, form)| matches!(form, Form::Modal { .. })) {
            return Ok(false);
        }
        let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
        self.arch.dispatch(WithPart { sum, part, layout, x, products, strips: workspace.strips() });
        Ok(true)
    }

    fn project(&self, mass: &Form, x: &[f64], v: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => v.copy_from_slice(x),
            Form::SingularMassCells(averages) => {
                let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
                self.arch.dispatch(Velocity { averages, layout, x, v, strips: workspace.strips() });
            }
            Form::Modal { modes, .. } => modes.project(x, v),
        }
        Ok(())
    }

    fn project_transpose(&self, mass: &Form, v: &[f64], y: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => {
                self.multiply(mass, v, y)?;
            }
            Form::SingularMassCells(averages) => {
                let (layout, workspace) = (&self.layout, &mut *self.workspace.borrow_mut());
                self.arch.dispatch(Momentum { averages, layout, v, y, strips: workspace.strips() });
            }
            Form::Modal { modes, .. } => modes.project_transpose(v, y),
        }
        Ok(())
    }

    fn mass_norm_squared(&self, mass: &Form, v: &[f64]) -> Result<f64> {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, &mut vec![0.0; self.dofs()]),
            Form::SingularMassCells(averages) => Ok(averages.mass_norm_squared(v)),
            Form::Modal { .. } => Ok(vectors::dot(v, v)),
        }
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
            match form {
                Form::Cells(cells) | Form::Modal { consistent: cells, .. } => {
                    for ElementMatrix { dofs, matrix, .. } in cells.blocks() {
                        let entry = |i: usize, j: usize| scale * matrix[i * dofs.len() + j];
                        add_couplings(&mut couplings, dofs, entry);
                    }
                }
                Form::SingularMassCells(averages) => {
                    for SingularMassCell { dofs, row, mass, .. } in averages.rows() {
                        add_couplings(&mut couplings, dofs, |i, j| scale * row[i] * row[j] / mass);
                    }
                }
            }
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
        let size = Cholesky::size(&assembled(self.dofs(), sum)?)?;
        cholesky::require(&size, factors as u64, self.dofs())
    }

    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Cholesky> {
        if let Some(mut factor) = in_doubles(self.dofs(), sum, contact_dofs)?
            && self.estimate_factor_error(sum, &mut factor)? <= MOST_SPOILT
        {
            return Ok(factor);
        }
        in_double_doubles(self.dofs(), sum, contact_dofs)
    }

    fn add_digits(&self, factor: &mut Cholesky, sum: &LinearCombination) -> Result<bool> {
        let (_, values) = match assembled_twice(self.dofs(), sum) {
            Err(Error::Memory(_)) => return Ok(false),
            assembled => assembled?,
        };
        factor.add_digits(values)
    }

    fn rough_factor(&self, sum: &LinearCombination) -> Result<Option<Cholesky>> {
        in_doubles(self.dofs(), sum, &[])
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
fn lower_triangle<V: Copy + Default + std::iter::Sum>(
    dofs: usize,
    visit_columns: impl Fn(&mut dyn FnMut(usize)),
    visit_entries: impl Fn(&mut dyn FnMut(usize, usize, V)),
) -> Result<(SymbolicSparseColMat<usize>, Vec<V>)> {
    // All entries of the cells are first sorted into their columns; those of one row are then added
    // up.
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
