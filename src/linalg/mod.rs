//! Linear algebra for the contact solvers and the time schemes, behind one trait.
//!
//! An [`Engine`] applies symmetric forms that are stored cell by cell and factors weighted sums of
//! them, each a [`LinearCombination`]. Vectors are plain slices of the dofs that this rank owns,
//! and the functions of [`vectors`] combine them. Other ranks are reached by the methods below and
//! by the engine's [communicator](Engine::comm).
//!
//! A [`Factor`] eliminates a chosen set of dofs, the *contact dofs*, last. With
//!
//! ```math
//! A = \begin{pmatrix} A_{ff} & A_{fc} \\ A_{cf} & A_{cc} \end{pmatrix},
//! ```
//!
//! [`SchurFactor::forward_to_schur`] reduces `$A x = b$` to `$H x_c = h$`, where
//! `$H = A_{cc} - A_{cf} A_{ff}^{-1} A_{fc}$` is the Schur complement on the contact dofs, and
//! [`SchurFactor::back_substitute`] completes `$x$` once `$x_c$` is known. A contact step then
//! costs one sparse solve and one small dense problem.

mod bending;
mod cholesky;
mod combination;
pub(crate) mod eigen;
mod form;
pub mod modal;
mod native;
pub mod vectors;

pub use crate::kernels::{
    Bending, CellClass, CellForm, ElementMatrix, Layout, SingularMassCell, SingularMassCells,
};
pub use cholesky::{Cholesky, Size as FactorSize};
pub use combination::LinearCombination;
pub use form::Form;
pub use modal::MassModes;
pub use native::{Native, PreciseEntry, factor_precise, precise_entries};
#[cfg(feature = "petsc")]
pub(crate) use native::{assemble, lower_triangle};

use crate::communicator::Communicator;
use crate::error::Result;
use crate::random;
use faer::Mat;
use std::borrow::Cow;
use vectors::{axpy, divide, dot, subtract};

/// Method by which linear systems are solved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LinearMethod {
    /// Factorisation.
    #[default]
    Direct,
    /// Conjugate gradients with geometric multigrid.
    Multigrid,
    /// Any other iteration, which PETSc's options choose.
    Iterative,
}

impl std::fmt::Display for LinearMethod {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            LinearMethod::Direct => "direct",
            LinearMethod::Multigrid => "multigrid",
            LinearMethod::Iterative => "iterative",
        })
    }
}

/// Systems that iterations have solved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LinearSolves {
    /// Method of the last matrix.
    pub method: LinearMethod,
    /// Number of systems.
    pub count: u64,
    /// Number of iterations of all of them.
    pub iterations: u64,
    /// Largest number of iterations of one of them.
    pub most: u64,
}

impl LinearSolves {
    /// Records a system that took some iterations.
    pub fn record(&mut self, iterations: usize) {
        self.count += 1;
        self.iterations += iterations as u64;
        self.most = self.most.max(iterations as u64);
    }
}

/// Coupling of a dof to another one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct RowCoupling {
    /// Other dof.
    pub to: u32,
    /// Sum of the magnitudes of the entries of the local matrices; 0 without a coupling.
    pub magnitude: f64,
}

/// Largest error estimate, relative and in the energy norm, up to which a factor in double
/// precision is kept: each correction by the residual then gains at least three digits.
pub const MOST_SPOILT: f64 = 1e-3;

/// Number of power iterations that [`estimate_factor_error`] measures.
const LOOKS: usize = 3;

/// Linear algebra behind the contact solvers and the schemes; see the [module page](self).
///
/// Every vector of displacement dofs has [`Engine::dofs`] entries. Methods that return a [`Result`]
/// are collective: all ranks call them together.
pub trait Engine: Sized {
    /// Communicator of the ranks that the vectors are distributed over.
    type Comm: Communicator;

    /// Whether equal matrices give equal bits in every run, so that results may be kept between
    /// runs. Options and the number of ranks change the bits of an engine on top of a library.
    const REPEATS: bool = false;

    /// Returns the communicator.
    fn comm(&self) -> &Self::Comm;

    /// Returns the number of dofs that this rank owns.
    fn dofs(&self) -> usize;

    /// Returns the scalar product of x and y over all ranks.
    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64>;

    /// Returns the values at all dofs of this rank's cells, including dofs that other ranks own, in
    /// the numbering of the cells.
    fn to_local<'x>(&self, x: &'x [f64]) -> Result<Cow<'x, [f64]>> {
        Ok(Cow::Borrowed(x))
    }

    /// Computes y = A x by the cells of a form, of the consistent mass for the mass of modes, and
    /// returns `$x^T A x$`, summed cell by cell and thus without cancellation.
    fn multiply_cells(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64>;

    /// Computes the velocities `$V = C^{-1} B x$` of cells.
    fn cell_velocities(&self, mass: &SingularMassCells, x: &[f64], v: &mut [f64]) -> Result<()>;

    /// Computes the momentum `$y = B^T V$` of cells.
    fn cell_momenta(&self, mass: &SingularMassCells, v: &[f64], y: &mut [f64]) -> Result<()>;

    /// Computes y = A x and returns `$x^T A x$`, see [`Engine::multiply_cells`].
    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        let Form::Modal { modes, .. } = form else { return self.multiply_cells(form, x, y) };
        let mut v = vec![0.0; modes.count()];
        self.project(form, x, &mut v)?;
        modes.project_transpose(&v, y);
        Ok(dot(&v, &v))
    }

    /// Computes the products A x and |A| |x| for a sum of forms with positive weights, where |A| is
    /// the sum of the entrywise magnitudes of the local matrices.
    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<()>;

    /// Computes the products A x for a sum of forms and `part` x for one of them, in one pass over
    /// the cells. Returns `false`, and changes nothing, where the engine has no such product, which
    /// is the default.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn multiply_with_part(
        &self,
        sum: &LinearCombination,
        part: &Form,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<bool> {
        let _ = (sum, part, x, products);
        Ok(false)
    }

    /// Returns for each dof at most one coupling to another dof in a sum of forms with positive
    /// weights: a slope's coupling to the deflection of its node. The default has no couplings.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn couplings(&self, sum: &LinearCombination) -> Result<Vec<RowCoupling>> {
        let _ = sum;
        Ok(vec![RowCoupling::default(); self.dofs()])
    }

    /// Returns the number of velocity dofs of a mass: the number of cells for the singular mass,
    /// the number of modes for the modal mass (on each rank), otherwise [`Engine::dofs`].
    fn velocities(&self, mass: &Form) -> usize {
        match mass {
            Form::Cells(_) => self.dofs(),
            Form::SingularMassCells(averages) => averages.cells(),
            Form::Modal { modes, .. } => modes.count(),
        }
    }

    /// Computes the velocity of a displacement rate x: `$V = C^{-1} B x$` for the singular mass,
    /// `$V = x$` for a consistent one.
    fn project(&self, mass: &Form, x: &[f64], v: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => v.copy_from_slice(x),
            Form::SingularMassCells(cells) => self.cell_velocities(cells, x, v)?,
            Form::Modal { modes, .. } => {
                modes.project(x, v);
                v.copy_from_slice(&self.comm().all_reduce_sum_slice(v));
            }
        }
        Ok(())
    }

    /// Computes the momentum of a velocity: `$y = B^T V$` for the singular mass, `$y = M_r V$` for
    /// a consistent one.
    fn project_transpose(&self, mass: &Form, v: &[f64], y: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, y).map(|_| ()),
            Form::SingularMassCells(cells) => self.cell_momenta(cells, v, y),
            Form::Modal { modes, .. } => {
                modes.project_transpose(v, y);
                Ok(())
            }
        }
    }

    /// Returns twice the kinetic energy, `$V^T C V$` or `$V^T M_r V$`, in J for velocities in m/s.
    fn mass_norm_squared(&self, mass: &Form, v: &[f64]) -> Result<f64> {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, &mut vec![0.0; v.len()]),
            Form::SingularMassCells(averages) => {
                let sum: f64 = averages.masses.iter().zip(v).map(|(c, v)| c * v * v).sum();
                Ok(self.comm().all_reduce_sum(sum))
            }
            Form::Modal { .. } => Ok(dot(v, v)),
        }
    }

    /// Returns the diagonal of a sum of forms, one entry per dof.
    fn diagonal(&self, sum: &LinearCombination) -> Result<Vec<f64>>;

    /// Checks, from the pattern and before anything is factored, that `factors` factors of a sum of
    /// forms fit into memory at once. The default, for an engine that cannot know, accepts.
    ///
    /// # Errors
    /// Returns [`crate::Error::Memory`] with the bytes needed and available.
    fn require_memory(&self, sum: &LinearCombination, factors: usize) -> Result<()> {
        let _ = (sum, factors);
        Ok(())
    }

    /// Factors a sum of forms with the contact dofs (dofs of this rank, ascending) eliminated last.
    /// A factor without [`Factor::schur_factor`] leaves them where they are.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the sum is not positive definite.
    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Box<dyn Factor>>;

    /// Factors a sum of forms in double precision, without contact dofs, whatever digits rounding
    /// takes: as the preconditioner of an iteration. Returns `None` where rounding leaves no
    /// positive definite matrix.
    ///
    /// # Errors
    /// Returns [`crate::Error::Memory`] where the factor does not fit, and the errors of the
    /// engine.
    fn rough_factor(&self, sum: &LinearCombination) -> Result<Option<Box<dyn Factor>>> {
        match self.factor(sum, &[]) {
            Ok(factor) => Ok(Some(factor)),
            Err(crate::Error::Singular(_)) => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Returns the systems that iterations have solved so far: none where factors solve them, which
    /// is the default.
    fn linear_solves(&self) -> LinearSolves {
        LinearSolves::default()
    }

    /// Factors `$K - \sigma M$` and counts its negative eigenvalues: as many eigenvalues of
    /// `$K x = \lambda M x$` lie below sigma, with their multiplicity (Sylvester's law of inertia).
    /// Returns `None` where the engine cannot count, which is the default.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    fn factor_beyond(&self, k: &Form, m: &Form, sigma: f64) -> Result<Option<Indefinite>> {
        let _ = (k, m, sigma);
        Ok(None)
    }
}

/// Computes y = A x for a sum of forms, with work space for a product, and returns `$x^T A x$`.
/// Collective.
///
/// # Errors
/// Returns the errors of the engine.
pub(crate) fn multiply_sum(
    engine: &impl Engine,
    sum: &LinearCombination,
    x: &[f64],
    product: &mut [f64],
    y: &mut [f64],
) -> Result<f64> {
    y.fill(0.0);
    let mut square = 0.0;
    for (scale, form) in sum.terms() {
        square += scale * engine.multiply(form, x, product)?;
        axpy(*scale, product, y);
    }
    Ok(square)
}

/// Estimates the relative energy-norm error of a solve with a factor of the sum, caused by rounding
/// the entries of the assembled matrix. Collective.
///
/// The power iteration starts from the answer to forces on all dofs, in which slow motions prevail,
/// and continues with the error of each solve.
///
/// # Errors
/// Returns the errors of the engine and of the factor.
pub fn estimate_factor_error(
    engine: &impl Engine,
    sum: &LinearCombination,
    factor: &mut dyn Factor,
) -> Result<f64> {
    if let Some(error) = factor.known_error() {
        return Ok(error);
    }
    let mut x = random::golden_vector(engine.dofs());
    let (mut force, mut product) = (vec![0.0; x.len()], vec![0.0; x.len()]);
    factor.solve(&mut x)?;
    let mut worst = 0.0_f64;
    for look in 0..=LOOKS {
        let energy = multiply_sum(engine, sum, &x, &mut product, &mut force)?;
        if energy.is_nan() {
            return Ok(energy);
        }
        // The energy is zero without dofs, and rounding may make it slightly negative.
        let norm = energy.abs().sqrt().max(f64::MIN_POSITIVE);
        if look > 0 {
            worst = worst.max(norm);
        }
        factor.solve(&mut force)?;
        subtract(&force, &mut x);
        divide(norm, &mut x);
    }
    Ok(worst)
}

/// Factor of an indefinite matrix.
pub struct Indefinite {
    /// Number of negative eigenvalues.
    pub negative: usize,
    /// Solves one system per column in place. Collective.
    pub solve: ColumnSolver,
}

/// Function that solves one system per column in place.
pub type ColumnSolver = Box<dyn FnMut(&mut Mat<f64>) -> Result<()>>;

/// Bounded dofs, ascending, with their lower and their upper bounds.
#[derive(Debug, Clone, Copy)]
pub struct BoundedDofs<'b> {
    /// Dofs.
    pub dofs: &'b [usize],
    /// Lower and upper bounds, infinite where there is none.
    pub limits: [&'b [f64]; 2],
}

/// Factor of a symmetric positive definite matrix A; see the [module page](self).
///
/// Vectors over the contact dofs are the same on every rank: the contact dofs of the first rank,
/// ascending, then the second rank's, and so on.
pub trait Factor {
    /// Solves A x = b in place: x holds b on entry.
    fn solve(&mut self, x: &mut [f64]) -> Result<()>;

    /// Returns the factor with its contact dofs eliminated last; `None` where it has no Schur
    /// complement, which is the default. Active dofs are then pinned, however few they are.
    fn schur_factor(&mut self) -> Option<&mut dyn SchurFactor> {
        None
    }

    /// Returns the iteration by which A is solved where one factor serves all pinned dofs; `None`
    /// elsewhere, which is the default.
    fn cascade(&mut self) -> Option<&mut dyn CascadeFactor> {
        None
    }

    /// Returns the relative energy-norm error of a solve where an iteration on the product of the
    /// cells ends at it, so that it need not be estimated.
    fn known_error(&self) -> Option<f64> {
        None
    }

    /// Solves A X = B in place, one system per column.
    fn solve_columns(&mut self, x: &mut Mat<f64>) -> Result<()> {
        (0..x.ncols()).try_for_each(|j| self.solve(x.col_as_slice_mut(j)))
    }

    /// Returns whether A is factored with twice the digits, since doubles lose too many.
    fn has_twice_the_digits(&self) -> bool {
        false
    }

    /// Returns the number of solves that take as long as [`Factor::add_digits`]; `None` where that
    /// is not possible, which is the default.
    fn cost_of_digits(&self) -> Option<u32> {
        None
    }

    /// Factors the sum of which this is the factor again with twice the digits and the same contact
    /// dofs, none of them pinned. Returns whether this was possible, which it is not by default.
    ///
    /// # Errors
    /// Returns the errors of [`Engine::factor`], but for want of memory.
    fn add_digits(&mut self, sum: &LinearCombination) -> Result<bool> {
        let _ = sum;
        Ok(false)
    }

    /// Frees the memory of a factor that another one replaces; nothing else may be called after it.
    /// The default frees nothing.
    fn release(&mut self) {}

    /// Factors the matrix again with some dofs (in any order) held fixed: their rows and columns
    /// become rows and columns of the identity.
    ///
    /// The contact dofs keep their positions. Until a call without dofs restores the factor of A,
    /// only [`Factor::solve`] may be called.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where the matrix is not positive definite.
    fn pin(&mut self, dofs: &[usize]) -> Result<()>;
}

/// Factor that eliminates the contact dofs last.
pub trait SchurFactor {
    /// Returns the Schur complement H of A on the contact dofs.
    fn schur(&mut self) -> &Mat<f64>;

    /// Eliminates all other dofs and writes the right-hand side h of H x_c = h. The factor keeps
    /// the intermediate state for [`SchurFactor::back_substitute`]. The entries of `more` become
    /// their sums over all ranks, in the same message where possible.
    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], more: &mut [f64]) -> Result<()>;

    /// Completes the solution of the last [`SchurFactor::forward_to_schur`] from the values at the
    /// contact dofs.
    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()>;

    /// Solves H x_c = h in place: `h` becomes x_c.
    fn solve_schur(&mut self, h: &mut [f64]);
}

/// Factor that iterates over coarser meshes.
pub trait CascadeFactor {
    /// Solves A x = b in place to a few digits.
    fn solve_roughly(&mut self, x: &mut [f64]) -> Result<()>;

    /// Solves A x = b in place for the correction of an answer whose energy norm is `norm`. The
    /// iteration ends where the corrected answer has all digits, which the correction alone need
    /// not have.
    fn solve_correction(&mut self, norm: f64, x: &mut [f64]) -> Result<()>;

    /// Finds the bounds that the unknown x with A x = b + G^T r is likely to touch, by problems
    /// that are coarser than A, and an unknown x to start from. `sides` becomes -1 at a lower
    /// bound, 1 at an upper one, and 0 elsewhere. Returns whether these problems have answers.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of [`Factor::pin`].
    fn find_contact(
        &mut self,
        b: &[f64],
        bounded: &BoundedDofs,
        x: &mut [f64],
        sides: &mut [i8],
    ) -> Result<bool>;
}
