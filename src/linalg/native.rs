//! The engine of one process: plain arrays and a sparse Cholesky factor.

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
    dofs: usize,
    arch: Arch,
    workspace: RefCell<Workspace>,
}

/// Vectors with one slot more than dofs, for what a support holds.
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
        let padded = || vec![0.0; dofs + 1];
        let workspace = Workspace { x: padded(), y: padded(), m: padded(), scratch: Scratch::default() };
        Native { dofs, arch: Arch::new(), workspace: RefCell::new(workspace) }
    }

    /// A form from the cells' dense local matrices.
    pub fn form(&self, blocks: Vec<Block>) -> Form {
        Form::Cells(CellForm::new(self.dofs, blocks))
    }

    /// The singular mass from the cells' rows of B and entries of C.
    pub fn averages(&self, rows: Vec<Average>) -> Form {
        Form::Averages(Averages::new(self.dofs, rows))
    }
}

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
            Form::Averages(averages) => averages.add_product(self.x, self.y),
        }
    }
}

struct WithMagnitude<'a> {
    form: &'a Form,
    scale: f64,
    x: &'a [f64],
    y: &'a mut [f64],
    m: &'a mut [f64],
    scratch: &'a mut Scratch,
}

impl WithSimd for WithMagnitude<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let WithMagnitude { form, scale, x, y, m, scratch } = self;
        match form {
            Form::Cells(cells) => cells.add_with_magnitude(simd, scale, x, y, m, scratch),
            Form::Averages(averages) => averages.add_with_magnitude(simd, scale, x, y, m, scratch),
        }
    }
}

impl Engine for Native {
    type Form = Form;
    type Factor = Cholesky;

    fn dofs(&self) -> usize {
        self.dofs
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> f64 {
        x.iter().zip(y).map(|(x, y)| x * y).sum()
    }

    fn maximum(&self, value: f64) -> f64 {
        value
    }

    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> f64 {
        let Workspace { x: padded, y: product, scratch, .. } = &mut *self.workspace.borrow_mut();
        padded[..self.dofs].copy_from_slice(x);
        product.fill(0.0);
        let value = self.arch.dispatch(Product { form, x: padded, y: product, scratch });
        y.copy_from_slice(&product[..self.dofs]);
        value
    }

    fn add_with_magnitude(&self, form: &Form, scale: f64, x: &[f64], y: &mut [f64], m: &mut [f64]) {
        let Workspace { x: padded, y: product, m: magnitude, scratch } = &mut *self.workspace.borrow_mut();
        padded[..self.dofs].copy_from_slice(x);
        product[..self.dofs].copy_from_slice(y);
        magnitude[..self.dofs].copy_from_slice(m);
        self.arch.dispatch(WithMagnitude { form, scale, x: padded, y: product, m: magnitude, scratch });
        y.copy_from_slice(&product[..self.dofs]);
        m.copy_from_slice(&magnitude[..self.dofs]);
    }

    fn velocities(&self, mass: &Form) -> usize {
        match mass {
            Form::Cells(_) => self.dofs,
            Form::Averages(averages) => averages.cells(),
        }
    }

    fn velocity(&self, mass: &Form, x: &[f64], v: &mut [f64]) {
        match mass {
            Form::Cells(_) => v.copy_from_slice(x),
            Form::Averages(averages) => {
                let padded = &mut self.workspace.borrow_mut().x;
                padded[..self.dofs].copy_from_slice(x);
                averages.velocity(padded, v);
            }
        }
    }

    fn momentum(&self, mass: &Form, v: &[f64], y: &mut [f64]) {
        match mass {
            Form::Cells(_) => {
                self.multiply(mass, v, y);
            }
            Form::Averages(averages) => {
                let product = &mut self.workspace.borrow_mut().y;
                product.fill(0.0);
                averages.add_momentum(v, product);
                y.copy_from_slice(&product[..self.dofs]);
            }
        }
    }

    fn vis_viva(&self, mass: &Form, v: &[f64]) -> f64 {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, &mut vec![0.0; self.dofs]),
            Form::Averages(averages) => averages.vis_viva(v),
        }
    }

    fn factor(&self, sum: &Sum<Self>, candidates: &[usize]) -> Result<Cholesky> {
        Cholesky::new(self.dofs, &lower_triplets(sum), candidates)
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
