//! Geometric multigrid as a preconditioner: the matrices of its levels, and dofs that are held.

#![allow(unsafe_code)]

use super::error::{call, int};
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
    /// Interpolation to the finest level without held dofs, once the levels have a copy of it in
    /// which the rows of held dofs are zeroed.
    whole: Option<Matrix>,
    /// Matrix of each level but the finest, coarsest first.
    coarse: Vec<Matrix>,
    /// Diagonal of the finest matrix while no dof is held.
    diagonal: Vector,
    /// Held dofs that this rank owns.
    held: Vec<usize>,
}

impl MultigridLevels {
    /// Creates the levels of a matrix, given the interpolation to each level from the next coarser
    /// one, coarsest first. Collective.
    fn new(matrix: &Matrix, interpolations: &[&Matrix]) -> Result<MultigridLevels> {
        let shared = |of: &&Matrix| Matrix::sharing(of.raw, &of.context);
        let interpolations = interpolations.iter().map(shared).collect::<Result<_>>()?;
        let mut diagonal = matrix.vector()?;
        matrix.diagonal(&mut diagonal)?;
        let mut levels =
            MultigridLevels { interpolations, whole: None, coarse: Vec::new(), diagonal, held: Vec::new() };
        levels.multiply(matrix)?;
        Ok(levels)
    }

    /// Creates the coarse matrices: products of the finest one with the interpolations (Galerkin).
    /// Collective.
    fn multiply(&mut self, matrix: &Matrix) -> Result<()> {
        self.coarse.clear();
        for interpolation in self.interpolations.iter().rev() {
            self.coarse.push(self.coarse.last().unwrap_or(matrix).galerkin(interpolation)?);
        }
        self.coarse.reverse();
        Ok(())
    }

    /// Returns the matrix of each level but the finest, coarsest first, as it is with the dofs that
    /// are held at present.
    pub fn coarse(&self) -> &[Matrix] {
        &self.coarse
    }

    /// Computes the coarse matrices again, on their patterns. Collective.
    fn multiply_again(&mut self, matrix: &Matrix) -> Result<()> {
        let mut fine = matrix;
        for (coarse, interpolation) in self.coarse.iter_mut().zip(&self.interpolations).rev() {
            coarse.set_to_galerkin(fine, interpolation)?;
            fine = coarse;
        }
        Ok(())
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
        let multigrid = self.multigrid()?;
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
        let multigrid = self.multigrid()?;
        for (level, (interpolation, coarse)) in (0..).zip(levels.interpolations.iter().zip(&levels.coarse)) {
            let mut smoother = std::ptr::null_mut();
            call!(PCMGSetInterpolation(multigrid, level + 1, interpolation.raw))?;
            call!(PCMGSetRestriction(multigrid, level + 1, interpolation.raw))?;
            call!(PCMGGetSmoother(multigrid, level, &mut smoother))?;
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
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn hold(&mut self, matrix: &mut Matrix, levels: &mut MultigridLevels, dofs: &[usize]) -> Result<()> {
        let first = matrix.range().start as usize;
        let mut weights = matrix.vector()?;
        weights.with_local_mut(|weights| {
            weights.fill(1.0);
            dofs.iter().for_each(|&dof| weights[dof] = 0.0);
        })?;
        let mut changed = std::mem::replace(&mut levels.held, dofs.to_vec());
        changed.extend(dofs);
        changed.sort_unstable();
        changed.dedup();
        let entries = levels.diagonal.with_local(|diagonal| {
            weights.with_local(|weights| {
                let entry = |dof: usize| diagonal[dof] * if weights[dof] == 0.0 { HELD } else { 1.0 };
                changed.into_iter().map(|dof| ((first + dof) as Index, entry(dof))).collect::<Vec<_>>()
            })
        })??;
        matrix.set_diagonal_entries(&entries)?;
        if let Some(finest) = levels.interpolations.last_mut() {
            let is_first = levels.whole.is_none();
            if let Some(whole) = &levels.whole {
                finest.copy_from(whole)?;
            } else {
                let copy = finest.duplicate()?;
                levels.whole = Some(std::mem::replace(finest, copy));
            }
            finest.scale_rows(&weights)?;
            if is_first {
                // Products remember the objects that they were made from.
                levels.multiply(matrix)?;
                self.set_levels(levels)?;
            } else {
                levels.multiply_again(matrix)?;
            }
        }
        self.set_up()
    }

    /// Returns the preconditioner.
    fn multigrid(&self) -> Result<sys::PC> {
        let mut multigrid = std::ptr::null_mut();
        call!(KSPGetPC(self.raw, &mut multigrid))?;
        Ok(multigrid)
    }
}
