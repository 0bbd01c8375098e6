//! The linear algebra that the contact solvers and the schemes ask for, behind one trait.
//!
//! An [`Engine`] knows how to apply symmetric forms that are kept cell by cell, and how to factor their sums.
//! Vectors are plain slices: the dofs that this process owns, so that the schemes' own arithmetic is ordinary Rust
//! and only the verbs below need to know whether there are other processes.
//!
//! A [`Factor`] can leave a chosen set of dofs, the *candidates* for contact, to the end of the elimination:
//! with \( A = \begin{pmatrix} A_{ff} & A_{fc} \\ A_{cf} & A_{cc} \end{pmatrix} \), `condense` reduces \(A x = b\) to
//! \(H x_c = h\), where \(H = A_{cc} - A_{cf} A_{ff}^{-1} A_{fc}\) is their Schur complement, and `expand` completes \(x\) once
//! \(x_c\) is known. A contact step then costs one solve and a small dense problem.

mod batch;
mod cells;
mod cholesky;
mod native;
mod simd;

pub use batch::Layout;
pub use cells::{Averages, CellForm, Form};
pub use cholesky::Cholesky;
pub use native::Native;

use crate::archive::Archive;
use crate::error::Result;
use faer::Mat;

/// Classes from here on have no [`Block::arms`] in any form: springs, foundations, cells beside supports askew.
pub const BARE: usize = 1 << 40;

/// What one cell contributes to a symmetric form.
#[derive(Debug, Clone)]
pub struct Block {
    /// Free dof of each local one; `None` where a support holds it at zero.
    pub dofs: std::rc::Rc<[Option<usize>]>,
    /// Local matrix, n x n, row by row, symmetric.
    pub matrix: std::rc::Rc<[f64]>,
    /// Of a cell with dofs (w, w_x, w_y) a node: position of each node relative to the first, in m. The form then
    /// vanishes on rigid motions and is applied after removing the cell's own by differences, which keeps the
    /// digits that an assembled stiffness loses as h^-4. `None`: applied as it is. In one form either all classes below [`BARE`]
    /// have arms, or none.
    pub arms: Option<std::rc::Rc<[[f64; 2]]>>,
    /// Cells of one class share `matrix` and `arms`.
    pub class: usize,
}

/// What one cell contributes to the singular mass B^T C^-1 B: one row of B and its entry of C.
#[derive(Debug, Clone)]
pub struct Average {
    /// Free dof of each local one; `None` where a support holds it at zero.
    pub dofs: std::rc::Rc<[Option<usize>]>,
    /// Row of B: integral of rho h phi_i over the cell, in kg (times m for a slope).
    pub row: std::rc::Rc<[f64]>,
    /// Entry of C: mass of the cell, in kg.
    pub mass: f64,
    /// Cells of one class share `row` and `mass`.
    pub class: usize,
}

/// A weighted sum of forms: the matrix of a step, \(A = \sum_i c_i A_i\).
pub type Sum<'a, E> = [(f64, &'a <E as Engine>::Form)];

/// The linear algebra behind contact solvers and schemes; see the [module page](self).
///
/// Every vector of displacement dofs has [`Engine::dofs`] entries.
pub trait Engine: Sized {
    /// A symmetric positive semi-definite form, kept cell by cell.
    type Form;
    /// A factored sum of forms.
    type Factor: Factor;

    /// Number of dofs that this process owns.
    fn dofs(&self) -> usize;

    /// Scalar product over all processes.
    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64>;

    /// Largest value over all processes.
    fn maximum(&self, value: f64) -> Result<f64>;

    /// The processes' own values one after the other, the same for all, and where this process's begin.
    fn concatenate(&self, own: &[f64]) -> Result<(Vec<f64>, usize)>;

    /// The values at all dofs of this process's cells, those that other processes own included, in the cells' numbering.
    fn on_cells(&self, x: &[f64]) -> Result<Vec<f64>> {
        Ok(x.to_vec())
    }

    /// The bytes of all processes, in their order, on the first; nothing on the others.
    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>> {
        Ok(vec![own.to_vec()])
    }

    /// Gives all processes the values of the first, in arrays of the same length: their processors may round differently.
    fn agree(&self, values: &mut [f64]) -> Result<()>;

    /// Applies a form: y = A x. Returns x^T A x, summed cell by cell (no cancellation).
    fn multiply(&self, form: &Self::Form, x: &[f64], y: &mut [f64]) -> Result<f64>;

    /// Applies a sum of forms and its componentwise magnitude, cell by cell: y = A x, m = |A| |x|, where |A| is the sum of
    /// the magnitudes of the cells' matrices (of positive weights).
    fn multiply_with_magnitude(&self, sum: &Sum<Self>, x: &[f64], y: &mut [f64], m: &mut [f64])
    -> Result<()>;

    /// Number of velocity dofs that go with a mass: its cells for the singular one, else [`Engine::dofs`].
    fn velocities(&self, mass: &Self::Form) -> usize;

    /// Velocity of a displacement rate: V = C^-1 B x for the singular mass, V = x for a consistent one.
    fn velocity(&self, mass: &Self::Form, x: &[f64], v: &mut [f64]) -> Result<()>;

    /// Momentum of a velocity: y = B^T V for the singular mass, y = M_r V for a consistent one.
    fn momentum(&self, mass: &Self::Form, v: &[f64], y: &mut [f64]) -> Result<()>;

    /// Twice the kinetic energy: V^T C V, or V^T M_r V.
    fn vis_viva(&self, mass: &Self::Form, v: &[f64]) -> Result<f64>;

    /// Diagonal of a sum of forms.
    fn diagonal(&self, sum: &Sum<Self>) -> Result<Vec<f64>>;

    /// Factors a sum of forms with the candidates (dofs of this process, ascending) left to the end.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where the sum is not positive definite.
    fn factor(&self, sum: &Sum<Self>, candidates: &[usize]) -> Result<Self::Factor>;

    /// Changes the candidates of a factor of the same sum with nothing pinned. Returns whether it took a factorisation.
    ///
    /// # Errors
    /// As [`Engine::factor`].
    fn change_candidates(
        &self,
        factor: &mut Self::Factor,
        sum: &Sum<Self>,
        candidates: &[usize],
    ) -> Result<bool> {
        *factor = self.factor(sum, candidates)?;
        Ok(true)
    }
}

/// A factored symmetric positive definite matrix A; see the [module page](self).
///
/// Vectors over the candidates are the same on every process: those of the first, ascending, then of the second, ...
pub trait Factor {
    /// Solves A x = b in place.
    fn solve(&mut self, x: &mut [f64]) -> Result<()>;

    /// Schur complement H of A on the candidates.
    fn schur(&self) -> &Mat<f64>;

    /// Eliminates all but the candidates: the right-hand side h of H x_c = h. The state stays in the factor for `expand`.
    fn condense(&mut self, b: &[f64], h: &mut [f64]) -> Result<()>;

    /// Completes the solution of the last `condense` from the candidates' values.
    fn expand(&mut self, candidates: &[f64], x: &mut [f64]) -> Result<()>;

    /// Solves H x_c = h in place.
    fn solve_candidates(&self, h: &mut [f64]);

    /// Factors again with some dofs (any order) held fixed: their rows and columns become the identity's.
    /// The candidates keep their place; only [`Factor::solve`] may be called until the next call with no dofs.
    ///
    /// # Errors
    /// [`crate::Error::Singular`] where the matrix is not positive definite.
    fn pin(&mut self, dofs: &[usize]) -> Result<()>;

    /// Shows an archive what the way to its present candidates has left in the digits of the factor, which has these already.
    ///
    /// # Errors
    /// [`crate::Error::Checkpoint`].
    fn state(&mut self, archive: &mut Archive) -> Result<()> {
        let _ = archive;
        Ok(())
    }
}
