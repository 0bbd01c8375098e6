//! Products cell by cell over all ranks.

use super::exchange::DofExchange;
use crate::error::Result;
use crate::linalg::vectors::axpy;
use crate::linalg::{Engine, Form, LinearCombination, Native};
use std::cell::RefCell;
use std::rc::Rc;

/// Products cell by cell over all ranks.
///
/// The native engine multiplies over the dofs of the rank's cells (and thus avoids the loss of h^-4
/// relative accuracy), with an exchange of shared dofs before and after.
pub(super) struct CellProducts {
    pub exchange: DofExchange,
    /// Native engine of this rank's cells, on local vectors.
    pub cells: Native,
    /// Input of products: zero at constrained dofs.
    x: RefCell<Vec<f64>>,
    sums: RefCell<[Vec<f64>; 2]>,
}

impl CellProducts {
    /// Creates the products over a mesh, given the native engine of this rank's cells.
    pub fn new(exchange: DofExchange, cells: Native) -> CellProducts {
        let [x, y, m] = [(); 3].map(|()| vec![0.0; cells.dofs()]);
        CellProducts { exchange, cells, x: x.into(), sums: RefCell::new([y, m]) }
    }

    /// Adds up the contributions of all ranks over their local dofs. Collective.
    pub fn add_up(&self, local: &[f64], sums: &mut [f64]) {
        self.exchange.add_up([local], [sums]);
    }

    /// Passes the values of a vector at this rank's local dofs to products with local vectors, and
    /// adds these up over the ranks. Collective.
    pub fn through_cells<R, const N: usize>(
        &self,
        x: &[f64],
        results: [&mut [f64]; N],
        product: impl FnOnce(&[f64], &mut [Vec<f64>; 2]) -> Result<R>,
    ) -> Result<R> {
        let sums = &mut *self.sums.borrow_mut();
        let value = self.with_local(x, |x| product(x, sums))?;
        self.exchange.add_up(std::array::from_fn(|number| &sums[number][..]), results);
        Ok(value)
    }

    /// Calls a function with the values of a vector at this rank's local dofs. Collective.
    pub fn with_local<R>(&self, x: &[f64], read: impl FnOnce(&[f64]) -> R) -> R {
        let local = &mut *self.x.borrow_mut();
        self.exchange.spread(x, local);
        read(local)
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
