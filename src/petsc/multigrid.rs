//! Geometric multigrid as a preconditioner: the matrices of its levels, and dofs that are held.

#![allow(unsafe_code)]

use super::error::{call, get, int};
use super::{Index, Ksp, Matrix, Vector, sys};
use crate::error::Result;

/// Relative tolerance of multigrid, whose last digit costs one iteration.
const MULTIGRID_TOLERANCE: f64 = 1e-14;

/// Default options of geometric multigrid.
///
/// The rows of a node share their pattern, so that PETSc sweeps node by node, whatever the number
/// of its free dofs.
const MULTIGRID: [(&str, &str); 4] = [
    ("mg_levels_ksp_norm_type", "none"),
    ("mg_levels_pc_type", "sor"),
    ("mg_levels_pc_sor_local_symmetric", "true"),
    ("mg_coarse_ksp_type", "preonly"),
];

/// Smoother of the levels of multigrid: symmetric Gauss-Seidel sweeps S, node by node.
///
/// Each rank sweeps over its own rows alone. On one rank the eigenvalues of S A lie between 0 and
/// 1, for two ranks they are below 2, as for any pair of blocks, but where more ranks meet they
/// reach about 2.2 with triangles. A cycle is positive definite as long as a smoother lets no
/// error grow.
///
/// On one rank a sweep is over-relaxed. Meshes on which the mass outweighs the stiffness, so that
/// sweeps alone nearly solve, then take as many iterations as finer ones, and triangles take fewer
/// on all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Smoother {
    /// One sweep, damped from three ranks on.
    OfQuadrilaterals,
    /// One sweep on one rank, and two on more, combined as the Chebyshev polynomial that damps the
    /// upper nine tenths of the eigenvalues: damped sweeps take more than half as many iterations
    /// again, in the same time.
    OfTriangles,
}

impl Smoother {
    /// Returns the default options for a number of ranks.
    fn options(self, ranks: usize) -> [(&'static str, &'static str); 3] {
        let sweep = |scale| {
            [
                ("mg_levels_ksp_type", "richardson"),
                ("mg_levels_ksp_max_it", "1"),
                ("mg_levels_ksp_richardson_scale", scale),
            ]
        };
        match (self, ranks) {
            (Smoother::OfQuadrilaterals, 1) => sweep("1.4"),
            (Smoother::OfQuadrilaterals, 2) => sweep("1"),
            (Smoother::OfQuadrilaterals, _) => sweep("0.8"),
            (Smoother::OfTriangles, 1) => sweep("1.65"),
            (Smoother::OfTriangles, _) => [
                ("mg_levels_ksp_type", "chebyshev"),
                ("mg_levels_ksp_max_it", "2"),
                ("mg_levels_ksp_chebyshev_eigenvalues", "0.22,2.3"),
            ],
        }
    }
}

/// Default options of the coarsest level on one rank.
const COARSEST_ALONE: [(&str, &str); 2] =
    [("mg_coarse_pc_type", "cholesky"), ("mg_coarse_pc_factor_mat_solver_type", "mumps")];

/// Default options of the coarsest level on several ranks. Each rank factors all of it: a factor
/// divided among them takes some hundred messages per iteration.
const COARSEST_OF_RANKS: [(&str, &str); 3] = [
    ("mg_coarse_pc_type", "redundant"),
    ("mg_coarse_redundant_pc_type", "cholesky"),
    ("mg_coarse_redundant_pc_factor_mat_solver_type", "mumps"),
];

/// Factor by which the diagonal of the finest matrix grows where a dof is held: sweeps then change
/// the dof by a relative 1e-20 only.
const HELD: f64 = 1e20;

/// Interpolations and matrices of the levels that a multigrid preconditioner works on.
#[derive(Debug)]
pub struct MultigridLevels {
    /// Interpolation to each level from the next coarser one, coarsest first.
    interpolations: Vec<Matrix>,
    /// Matrix of each level but the finest, coarsest first.
    coarse: Vec<Matrix>,
    /// Levels without held dofs, once some have been held.
    free: Option<FreeLevels>,
    /// Diagonal of the finest matrix while no dof is held.
    diagonal: Vector,
    /// Held dofs that this rank owns.
    held: Vec<usize>,
}

/// Interpolation and matrices of the levels while no dof is held.
#[derive(Debug)]
struct FreeLevels {
    /// Interpolation to the finest level. The levels have a copy of it in which the rows of held
    /// dofs are zeroed.
    finest: Matrix,
    /// Matrix of each level but the finest, coarsest first.
    coarse: Vec<Matrix>,
}

impl MultigridLevels {
    /// Creates the levels of a matrix, given the interpolation to each level from the next coarser
    /// one, coarsest first. Collective.
    ///
    /// The coarse matrices are products of the finest one with the interpolations (Galerkin).
    fn new(matrix: &Matrix, interpolations: &[&Matrix]) -> Result<MultigridLevels> {
        let interpolations: Vec<Matrix> =
            interpolations.iter().map(|matrix| matrix.share()).collect::<Result<_>>()?;
        let mut diagonal = matrix.vector()?;
        matrix.diagonal(&mut diagonal)?;
        let mut coarse: Vec<Matrix> = Vec::new();
        for interpolation in interpolations.iter().rev() {
            coarse.push(coarse.last().unwrap_or(matrix).galerkin(interpolation)?);
        }
        coarse.reverse();
        Ok(MultigridLevels { interpolations, coarse, free: None, diagonal, held: Vec::new() })
    }

    /// Returns the matrix of each level but the finest, coarsest first, as it is while no dof is
    /// held.
    pub fn free_coarse(&self) -> &[Matrix] {
        self.free.as_ref().map_or(&self.coarse, |free| &free.coarse)
    }

    /// Sets entries of the diagonal of the finest matrix, in the rows of some dofs of this rank, to
    /// multiples of those without held dofs. Collective.
    fn scale_diagonal(&self, matrix: &mut Matrix, dofs: &[usize], factor: f64) -> Result<()> {
        let first = matrix.range().start as usize;
        let entries = self.diagonal.with_local(|diagonal| {
            let entry = |&dof: &usize| ((first + dof) as Index, factor * diagonal[dof]);
            dofs.iter().map(entry).collect::<Vec<_>>()
        })?;
        matrix.set_diagonal_entries(&entries)
    }

    /// Truncates the interpolation to the finest level at the held dofs, of which this rank owns
    /// `dofs`, and changes the coarse matrices with it. Returns whether the levels have new
    /// matrices in place of new numbers. Collective.
    ///
    /// With the diagonal matrix E of the held dofs, the truncated interpolation is `$(I - E) P$`,
    /// and
    ///
    /// ```math
    /// P^T (I - E) A (I - E) P = P^T A P - T - T^T, \qquad T = P^T E A \bigl(I - \tfrac12 E\bigr) P .
    /// ```
    ///
    /// E A has the rows of held dofs only. From the change of one coarse matrix follows that of the
    /// next coarser one.
    fn truncate(&mut self, matrix: &Matrix, dofs: &[usize]) -> Result<bool> {
        let Some(finest) = self.interpolations.last_mut() else { return Ok(false) };
        let is_first = self.free.is_none();
        let free = match self.free.take() {
            Some(free) => free,
            None => {
                let mut copies: Vec<Matrix> =
                    self.coarse.iter().map(Matrix::duplicate).collect::<Result<_>>()?;
                copies.iter_mut().try_for_each(Matrix::set_positive_definite)?;
                let coarse = std::mem::replace(&mut self.coarse, copies);
                let copy = finest.duplicate()?;
                FreeLevels { finest: std::mem::replace(finest, copy), coarse }
            }
        };
        let weights = |of_held: f64| {
            let mut weights = matrix.vector()?;
            weights.with_local_mut(|weights| {
                weights.fill(1.0);
                dofs.iter().for_each(|&dof| weights[dof] = of_held);
            })?;
            Ok::<_, crate::Error>(weights)
        };
        finest.copy_from(&free.finest)?;
        finest.scale_rows(&weights(0.5)?)?;
        let mut change = free.finest.transposed_times(&matrix.only_rows(dofs)?.times(finest)?)?;
        finest.copy_from(&free.finest)?;
        finest.scale_rows(&weights(0.0)?)?;
        for (level, (coarse, free)) in self.coarse.iter_mut().zip(&free.coarse).enumerate().rev() {
            coarse.copy_from(free)?;
            coarse.add_scaled(-1.0, &change)?;
            coarse.add_scaled(-1.0, &change.transposed()?)?;
            coarse.complete_diagonal()?;
            if level > 0 {
                change = change.congruent(&self.interpolations[level - 1])?;
            }
        }
        self.free = Some(free);
        Ok(is_first)
    }
}

impl Ksp {
    /// Makes conjugate gradients with multigrid the default for a matrix, with the interpolation to
    /// each level from the next coarser one, coarsest first; the user's options override it.
    /// Collective.
    ///
    /// The matrices of the coarse levels follow from that of the finest (Galerkin). The smoother
    /// precedes and follows each correction, and MUMPS factors the matrix of the coarsest level,
    /// all of it on each rank.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where the sizes do not fit.
    pub fn default_to_multigrid(
        &mut self,
        matrix: &Matrix,
        interpolations: &[&Matrix],
        smoother: Smoother,
    ) -> Result<MultigridLevels> {
        self.default_to_conjugate_gradients(MULTIGRID_TOLERANCE)?;
        let ranks = self.context.size();
        let coarsest: &[_] = if ranks == 1 { &COARSEST_ALONE } else { &COARSEST_OF_RANKS };
        for (name, value) in MULTIGRID.iter().chain(&smoother.options(ranks)).chain(coarsest) {
            self.context.default_option(&format!("{}{name}", self.prefix), value)?;
        }
        for part in ["mg_levels_", "mg_coarse_", "mg_coarse_redundant_"] {
            self.context.note_prefix(&format!("{}{part}", self.prefix));
        }
        let multigrid = self.preconditioner()?;
        call!(PCSetType(multigrid, c"mg".as_ptr()))?;
        call!(PCMGSetLevels(multigrid, int(interpolations.len() + 1)?, std::ptr::null_mut()))?;
        // PETSc's own Galerkin products, and its residual on the finest level, would take an
        // operator without entries where the solver has one.
        call!(PCSetUseAmat(multigrid, sys::truth(false)))?;
        let levels = MultigridLevels::new(matrix, interpolations)?;
        self.set_levels(&levels)?;
        Ok(levels)
    }

    /// Hands interpolations and coarse matrices to the preconditioner. Collective.
    fn set_levels(&mut self, levels: &MultigridLevels) -> Result<()> {
        let multigrid = self.preconditioner()?;
        for (level, (interpolation, coarse)) in (0..).zip(levels.interpolations.iter().zip(&levels.coarse)) {
            call!(PCMGSetInterpolation(multigrid, level + 1, interpolation.raw))?;
            call!(PCMGSetRestriction(multigrid, level + 1, interpolation.raw))?;
            let smoother = get!(PCMGGetSmoother(multigrid, level))?;
            call!(KSPSetOperators(smoother, coarse.raw, coarse.raw))?;
            // PETSc keeps the matrix of a level's residual from its first set-up.
            if level > 0 {
                call!(PCMGSetResidual(multigrid, level, None, coarse.raw))?;
            }
        }
        Ok(())
    }

    /// Holds some dofs of this rank, and no others: the preconditioner that
    /// [`Ksp::default_to_multigrid`] made for a matrix, of which only the diagonal changes, then
    /// leaves them as they are. Collective.
    ///
    /// The interpolation to the finest level is truncated there. All patterns stay, so that only
    /// numbers are computed again, and equal dofs give equal numbers whatever was held before.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where the sizes do not fit.
    pub fn hold(&mut self, matrix: &mut Matrix, levels: &mut MultigridLevels, dofs: &[usize]) -> Result<()> {
        levels.scale_diagonal(matrix, &levels.held, 1.0)?;
        if levels.truncate(matrix, dofs)? {
            self.set_levels(levels)?;
        }
        levels.scale_diagonal(matrix, dofs, HELD)?;
        levels.held = dofs.to_vec();
        self.set_up()
    }
}
