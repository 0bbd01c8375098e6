//! Products cell by cell over all ranks.

use crate::error::Result;
use crate::linalg::vectors::axpy;
use crate::linalg::{Engine, Form, LinearCombination, Native};
use crate::petsc::{Plex, Vector};
use std::cell::RefCell;
use std::rc::Rc;

/// Products cell by cell over all ranks.
///
/// The native engine multiplies over the dofs of the rank's cells (and thus avoids the loss of h^-4
/// relative accuracy), with an exchange of shared dofs before and after.
pub(super) struct CellProducts {
    plex: Rc<Plex>,
    /// Native engine of this rank's cells, on local vectors.
    pub cells: Native,
    work: RefCell<Work>,
    sums: RefCell<[Vec<f64>; 2]>,
}

struct Work {
    global: Vector,
    /// Input of products in local vectors: zero at constrained dofs.
    read: Vector,
    /// Output of products in local vectors.
    given: Vector,
    x: Vec<f64>,
}

impl Work {
    /// Gathers the values of a vector at this rank's local dofs into `x`.
    fn read(&mut self, plex: &Plex, x: &[f64]) -> Result<()> {
        self.global.set_local(x)?;
        plex.to_local(&self.global, &mut self.read)?;
        self.read.copy_to(&mut self.x)
    }

    /// Adds up the values of all ranks at their local dofs.
    fn add_up(&mut self, plex: &Plex, values: &[f64], sums: &mut [f64]) -> Result<()> {
        self.given.set_local(values)?;
        self.global.fill(0.0)?;
        plex.add_to_global(&self.given, &mut self.global)?;
        self.global.copy_to(sums)
    }
}

impl CellProducts {
    /// Creates the products over a mesh, given the native engine of this rank's cells and the
    /// number of its local dofs. Collective.
    pub fn new(plex: Rc<Plex>, cells: Native, local: usize) -> Result<CellProducts> {
        let (global, read, given) = (plex.global_vector()?, plex.local_vector()?, plex.local_vector()?);
        let [x, y, m] = [(); 3].map(|()| vec![0.0; local]);
        let work = RefCell::new(Work { global, read, given, x });
        Ok(CellProducts { plex, cells, work, sums: RefCell::new([y, m]) })
    }

    /// Adds up the contributions of all ranks over their local dofs. Collective.
    pub fn add_up(&self, local: &[f64], sums: &mut [f64]) -> Result<()> {
        self.work.borrow_mut().add_up(&self.plex, local, sums)
    }

    /// Passes the values of a vector at this rank's local dofs to products with local vectors, and
    /// adds these up over the ranks. Collective.
    pub fn through_cells<R, const N: usize>(
        &self,
        x: &[f64],
        results: [&mut [f64]; N],
        product: impl FnOnce(&[f64], &mut [Vec<f64>; 2]) -> Result<R>,
    ) -> Result<R> {
        let (work, sums) = (&mut *self.work.borrow_mut(), &mut *self.sums.borrow_mut());
        work.read(&self.plex, x)?;
        let value = product(&work.x, sums)?;
        for (sum, result) in sums.iter().zip(results) {
            work.add_up(&self.plex, sum, result)?;
        }
        Ok(value)
    }

    /// Calls a function with the values of a vector at this rank's local dofs. Collective.
    pub fn with_local<R>(&self, x: &[f64], read: impl FnOnce(&[f64]) -> R) -> Result<R> {
        let work = &mut *self.work.borrow_mut();
        work.read(&self.plex, x)?;
        Ok(read(&work.x))
    }
}

/// Weighted sum of forms that owns them, applied cell by cell.
pub(super) struct CellOperator {
    products: Rc<CellProducts>,
    terms: Vec<(f64, Form)>,
    product: Vec<f64>,
    free: Vec<f64>,
}

impl CellOperator {
    /// Creates the operator of a sum of forms, for a rank that owns `owned` dofs. The operator owns
    /// copies of the forms, which share the arrays of their cells. Returns `None` where a form is
    /// the mass of modes, which has no cells.
    pub fn new(products: &Rc<CellProducts>, owned: usize, sum: &LinearCombination) -> Option<CellOperator> {
        if sum.has_modes() {
            return None;
        }
        let terms = sum.terms().iter().map(|(weight, form)| (*weight, (*form).clone())).collect();
        let product = vec![0.0; products.cells.dofs()];
        Some(CellOperator { products: products.clone(), terms, product, free: vec![0.0; owned] })
    }

    /// Works as [`CellOperator::apply`] with the rows and columns of some dofs replaced by rows of
    /// the identity. Collective.
    pub fn apply_with_held(&mut self, held: &[usize], x: &[f64], y: &mut [f64]) -> Result<()> {
        let mut free = std::mem::take(&mut self.free);
        free.copy_from_slice(x);
        held.iter().for_each(|&dof| free[dof] = 0.0);
        let applied = self.apply(&free, y);
        self.free = free;
        held.iter().for_each(|&dof| y[dof] = x[dof]);
        applied
    }

    /// Computes y = A x over the dofs that this rank owns. Collective.
    pub fn apply(&mut self, x: &[f64], y: &mut [f64]) -> Result<()> {
        let CellOperator { products, terms, product, .. } = self;
        products.through_cells(x, [y], |x, [y, _]| {
            y.fill(0.0);
            for (weight, form) in terms {
                products.cells.multiply(form, x, product)?;
                axpy(*weight, product, y);
            }
            Ok(())
        })
    }
}
