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
mod twice;

pub use batch::Layout;
pub use cells::{Averages, CellForm, Form};
pub use cholesky::Cholesky;
pub use native::Native;

use crate::archive::Archive;
use crate::error::Result;
use faer::Mat;
use twice::Twice;

/// Classes from here on have no [`Block::bending`] in any form: springs, foundations, cells beside supports askew.
pub const BARE: usize = 1 << 40;

/// What one cell contributes to a symmetric form.
#[derive(Debug, Clone)]
pub struct Block {
    /// Free dof of each local one; `None` where a support holds it at zero.
    pub dofs: std::rc::Rc<[Option<usize>]>,
    /// Local matrix, n x n, row by row, symmetric.
    pub matrix: std::rc::Rc<[f64]>,
    /// Of a form that vanishes on rigid motions: how it is applied. `None`: by its matrix. In one form either all classes below
    /// [`BARE`] have it, or none.
    pub bending: Option<std::rc::Rc<Bending>>,
    /// Cells of one class share `matrix` and `bending`.
    pub class: usize,
}

/// A form that vanishes on the rigid motions of a cell with dofs (w, w_x, w_y) a node, as the square of what is left without them.
///
/// The motion of the cell's first node is removed by differences, which keeps the digits that an assembled stiffness loses as h^-4; the
/// root keeps half of those that the cell's own matrix loses as the fourth power of its aspect ratio.
#[derive(Debug, Clone, PartialEq)]
pub struct Bending {
    /// Position of each node after the first, relative to it, in m.
    pub arms: Vec<[f64; 2]>,
    /// R, upper triangular, row by row, over the dofs d of the nodes after the first, less the first one's motion: the form is |R d|^2.
    pub root: Vec<f64>,
}

impl Bending {
    /// The strains that each dof of the cell makes, with twice the digits: the columns of R over all dofs.
    fn strains(&self) -> Vec<Vec<Twice>> {
        let size = 3 * self.arms.len();
        let own = |column: usize| self.root.iter().skip(column).step_by(size);
        let mut strains: Vec<Vec<Twice>> = vec![vec![Twice::default(); size]; 3];
        strains.extend((0..size).map(|column| own(column).map(|&r| r.into()).collect()));
        // A rigid motion makes none: the first node's balance the others'.
        for (k, arm) in self.arms.iter().enumerate() {
            for row in 0..size {
                let [w, slope_x, slope_y] = [0, 1, 2].map(|dof| strains[3 * (k + 1) + dof][row]);
                let lever = [w * arm[0].into(), w * arm[1].into()];
                strains[0][row] = strains[0][row] - w;
                strains[1][row] = strains[1][row] - (slope_x + lever[0]);
                strains[2][row] = strains[2][row] - (slope_y + lever[1]);
            }
        }
        strains
    }

    /// The form's product with the values of all dofs of the cell, a force on each.
    pub fn product(&self, values: &[f64]) -> Vec<f64> {
        let [w, slope_x, slope_y] = [values[0], values[1], values[2]];
        let mut bent = values[3..].to_vec();
        for (node, [x, y]) in bent.chunks_exact_mut(3).zip(&self.arms) {
            node[0] = (node[0] - w) - (slope_x * x + slope_y * y);
            node[1] -= slope_x;
            node[2] -= slope_y;
        }
        let mut force = vec![0.0; values.len()];
        for row in self.root.chunks_exact(bent.len()) {
            let strain: f64 = row.iter().zip(&bent).map(|(r, d)| r * d).sum();
            force[3..].iter_mut().zip(row).for_each(|(f, r)| *f += r * strain);
        }
        for (k, [x, y]) in self.arms.iter().enumerate() {
            let node = [force[3 * k + 3], force[3 * k + 4], force[3 * k + 5]];
            force[0] -= node[0];
            force[1] -= node[1] + node[0] * x;
            force[2] -= node[2] + node[0] * y;
        }
        force
    }
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

/// How often [`Engine::spoilt`] looks.
const LOOKS: usize = 3;

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

    /// What each process found, or the error of the first that has one, on every process: so that none goes on alone.
    ///
    /// # Errors
    /// This process's own, or [`crate::Error::Elsewhere`].
    fn together(&self, mine: Result<()>) -> Result<()> {
        mine
    }

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

    /// Share of a motion, in the norm of its energy, that a solve with a factor of the sum misses at worst: what rounding the entries of an
    /// assembled matrix has spoilt. First of the motion that follows where all dofs are pushed, in which slow ones prevail; then of
    /// what was missed.
    ///
    /// # Errors
    /// What the engine says.
    fn spoilt(&self, sum: &Sum<Self>, factor: &mut Self::Factor) -> Result<f64> {
        let rough = |i: usize| (i as f64 * 0.618_033_988_749_895).fract() - 0.5;
        let mut x: Vec<f64> = (1..=self.dofs()).map(rough).collect();
        let (mut force, mut product) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        factor.solve(&mut x)?;
        let mut worst = 0.0_f64;
        for look in 0..=LOOKS {
            force.fill(0.0);
            let mut energy = 0.0;
            for (scale, form) in sum {
                energy += scale * self.multiply(form, &x, &mut product)?;
                force.iter_mut().zip(&product).for_each(|(force, p)| *force += scale * p);
            }
            if energy.is_nan() {
                return Ok(energy);
            }
            // Of no dofs nothing is spoilt; rounding may make a little less than none.
            let norm = energy.abs().sqrt().max(f64::MIN_POSITIVE);
            if look > 0 {
                worst = worst.max(norm);
            }
            factor.solve(&mut force)?;
            x.iter_mut().zip(&force).for_each(|(x, f)| *x = (*x - f) / norm);
        }
        Ok(worst)
    }

    /// Refuses factors of a sum of forms, so many at once, that do not fit into memory: from the pattern, before anything is factored.
    /// An engine that cannot know says nothing.
    ///
    /// # Errors
    /// [`crate::Error::Memory`] with the figures.
    fn require_memory(&self, sum: &Sum<Self>, factors: usize) -> Result<()> {
        let _ = (sum, factors);
        Ok(())
    }

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
