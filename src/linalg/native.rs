//! The engine of one process: plain arrays and a sparse Cholesky factor.

use super::batch::Layout;
use super::cells::Scratch;
use super::{Average, Averages, Block, CellForm, Cholesky, Engine, Sum};
use crate::error::Result;
use faer::sparse::Triplet;
use pulp::{Arch, Simd, WithSimd};
use std::cell::RefCell;

/// A symmetric form of the native engine.
#[derive(Debug, Clone)]
pub enum Form {
    /// Dense local matrices: K, M_r.
    Cells(CellForm),
    /// Rank one a cell: the singular mass B^T C^-1 B.
    Averages(Averages),
}

impl Form {
    /// Calls `visit(row, column, entry)` for the lower triangle of each cell's contribution.
    pub fn for_each_lower(&self, mut visit: impl FnMut(usize, usize, f64)) {
        let mut cell = |dofs: &[Option<usize>], entry: &dyn Fn(usize, usize) -> f64| {
            for (i, row) in dofs.iter().enumerate() {
                for (j, column) in dofs.iter().enumerate() {
                    if let (Some(row), Some(column)) = (*row, *column)
                        && row >= column
                    {
                        visit(row, column, entry(i, j));
                    }
                }
            }
        };
        match self {
            Form::Cells(cells) => {
                for block in cells.blocks() {
                    let size = block.dofs.len();
                    cell(&block.dofs, &|i, j| block.matrix[i * size + j]);
                }
            }
            Form::Averages(averages) => {
                for row in averages.rows() {
                    cell(&row.dofs, &|i, j| row.row[i] * row.row[j] / row.mass);
                }
            }
        }
    }
}

/// The engine of one process.
#[derive(Debug)]
pub struct Native {
    layout: Layout,
    arch: Arch,
    workspace: RefCell<Workspace>,
}

/// Laid out vectors, and room for the cells' local ones.
#[derive(Debug)]
struct Workspace {
    x: Vec<f64>,
    y: Vec<f64>,
    m: Vec<f64>,
    scratch: Scratch,
}

impl Native {
    /// An engine for vectors of `dofs` free dofs.
    pub fn new(dofs: usize) -> Native {
        Native::with_layout(Layout::new(0..dofs))
    }

    /// An engine that keeps its own vectors in a layout made for the cells: faster.
    pub fn with_layout(layout: Layout) -> Native {
        let (x, y, m) = (layout.zeros(), layout.zeros(), layout.zeros());
        let workspace = Workspace { x, y, m, scratch: Scratch::default() };
        Native { layout, arch: Arch::new(), workspace: RefCell::new(workspace) }
    }

    /// A form from the cells' dense local matrices.
    pub fn form(&self, blocks: Vec<Block>) -> Form {
        let form = CellForm::new(&self.layout, blocks);
        self.workspace.borrow_mut().scratch.reserve(form.width());
        Form::Cells(form)
    }

    /// The singular mass from the cells' rows of B and entries of C.
    pub fn averages(&self, rows: Vec<Average>) -> Form {
        let averages = Averages::new(&self.layout, rows);
        self.workspace.borrow_mut().scratch.reserve(averages.width());
        Form::Averages(averages)
    }
}

/// What the widest registers of the processor are for: y += A x and more, on laid out vectors.
struct Product<'a> {
    form: &'a Form,
    x: &'a [f64],
    y: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for Product<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        match self.form {
            Form::Cells(cells) => cells.add_product(simd, self.x, self.y, self.scratch),
            Form::Averages(averages) => averages.add_product(self.x, self.y, self.scratch),
        }
    }
}

struct WithMagnitude<'a> {
    sum: &'a Sum<'a, Native>,
    x: &'a [f64],
    y: &'a mut [f64],
    m: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for WithMagnitude<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let WithMagnitude { sum, x, y, m, scratch } = self;
        for &(scale, form) in sum {
            match form {
                Form::Cells(cells) => cells.add_with_magnitude(simd, scale, x, y, m, scratch),
                Form::Averages(averages) => averages.add_with_magnitude(scale, x, y, m, scratch),
            }
        }
    }
}

struct Velocity<'a> {
    averages: &'a Averages,
    x: &'a [f64],
    v: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for Velocity<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.averages.velocity(self.x, self.v, self.scratch);
    }
}

struct Momentum<'a> {
    averages: &'a Averages,
    v: &'a [f64],
    y: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for Momentum<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.averages.add_momentum(self.v, self.y, self.scratch);
    }
}

impl Engine for Native {
    type Form = Form;
    type Factor = Cholesky;

    fn dofs(&self) -> usize {
        self.layout.dofs()
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> f64 {
        x.iter().zip(y).map(|(x, y)| x * y).sum()
    }

    fn maximum(&self, value: f64) -> f64 {
        value
    }

    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> f64 {
        let Workspace { x: laid, y: product, scratch, .. } = &mut *self.workspace.borrow_mut();
        self.layout.lay_out(x, laid);
        product.fill(0.0);
        let value = self.arch.dispatch(Product { form, x: laid, y: product, scratch });
        self.layout.collect(product, y);
        value
    }

    fn add_with_magnitude(&self, sum: &Sum<Self>, x: &[f64], y: &mut [f64], m: &mut [f64]) {
        let Workspace { x: laid, y: product, m: magnitude, scratch } = &mut *self.workspace.borrow_mut();
        self.layout.lay_out(x, laid);
        product.fill(0.0);
        magnitude.fill(0.0);
        self.arch.dispatch(WithMagnitude { sum, x: laid, y: product, m: magnitude, scratch });
        self.layout.add(product, y);
        self.layout.add(magnitude, m);
    }

    fn velocities(&self, mass: &Form) -> usize {
        match mass {
            Form::Cells(_) => self.dofs(),
            Form::Averages(averages) => averages.cells(),
        }
    }

    fn velocity(&self, mass: &Form, x: &[f64], v: &mut [f64]) {
        match mass {
            Form::Cells(_) => v.copy_from_slice(x),
            Form::Averages(averages) => {
                let Workspace { x: laid, scratch, .. } = &mut *self.workspace.borrow_mut();
                self.layout.lay_out(x, laid);
                self.arch.dispatch(Velocity { averages, x: laid, v, scratch });
            }
        }
    }

    fn momentum(&self, mass: &Form, v: &[f64], y: &mut [f64]) {
        match mass {
            Form::Cells(_) => {
                self.multiply(mass, v, y);
            }
            Form::Averages(averages) => {
                let Workspace { y: product, scratch, .. } = &mut *self.workspace.borrow_mut();
                product.fill(0.0);
                self.arch.dispatch(Momentum { averages, v, y: product, scratch });
                self.layout.collect(product, y);
            }
        }
    }

    fn vis_viva(&self, mass: &Form, v: &[f64]) -> f64 {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, &mut vec![0.0; self.dofs()]),
            Form::Averages(averages) => averages.vis_viva(v),
        }
    }

    fn diagonal(&self, sum: &Sum<Self>) -> Vec<f64> {
        let mut diagonal = vec![0.0; self.dofs()];
        for (scale, form) in sum {
            form.for_each_lower(|row, column, entry| {
                if row == column {
                    diagonal[row] += scale * entry;
                }
            });
        }
        diagonal
    }

    fn factor(&self, sum: &Sum<Self>, candidates: &[usize]) -> Result<Cholesky> {
        Cholesky::new(self.dofs(), &lower_triplets(sum), candidates)
    }
}

/// Entries of the lower triangle of a sum, cell by cell.
fn lower_triplets(sum: &Sum<Native>) -> Vec<Triplet<usize, usize, f64>> {
    let mut triplets = Vec::new();
    for (scale, form) in sum {
        form.for_each_lower(|row, column, entry| triplets.push(Triplet::new(row, column, scale * entry)));
    }
    triplets
}
