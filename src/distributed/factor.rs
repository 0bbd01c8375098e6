//! Factors of matrices over all ranks.

use super::cascade::Cascade;
use super::flexibility::Flexibility;
use super::hierarchy::Hierarchy;
use super::products::CellOperator;
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{add, subtract};
use crate::linalg::{BoundedDofs, CascadeFactor, Factor, LinearMethod, LinearSolves};
use crate::petsc::{Comm, Context, Index, Ksp, Matrix, MultigridLevels, Operator, Plex, Vector};
use faer::Mat;
use std::cell::{Cell, RefCell};
use std::rc::Rc;

/// Share of the tolerance at which the correction of an answer ends, whose start was not zero.
const MARGIN: f64 = 0.1;

/// Largest error of answers up to which columns of A^-1 make a Schur complement, relative and in
/// the energy norm.
///
/// Each column has its own error. Where contact dofs lie close together, the columns differ by
/// less, and the forces on those dofs would be lost in the error of their difference; corrections
/// do not find them again.
const MAX_SCHUR_ERROR: f64 = 1e-6;

/// Criterion at which a solve by iteration ends.
#[derive(Clone, Copy)]
enum StoppingCriterion {
    /// The tolerance of the solver.
    Exact,
    /// Enough to find the active dofs.
    Rough,
    /// This error in the energy norm, where the method measures that.
    UpTo(f64),
}

/// Matrix factored by PETSc: Cholesky by MUMPS, unless `-ksp_...` and `-pc_...` say otherwise.
///
/// The Schur complement of the contact dofs is the inverse of their block of A^-1, the
/// flexibility.
pub struct PetscFactor {
    context: Rc<Context>,
    matrix: Matrix,
    /// Matrix as the cells apply it, which an iteration solves for.
    cells: Option<Rc<RefCell<CellOperator>>>,
    solver: Ksp,
    linear: SystemSolver,
    /// Levels of multigrid, whose solver holds dofs itself.
    levels: Option<MultigridLevels>,
    /// Problems of the coarse meshes, once contact is wide.
    cascade: Option<Cascade>,
    /// Matrix in which other methods held dofs last, and its solver.
    pinned: Option<(Matrix, Ksp)>,
    /// Held dofs that this rank owns, and whether any rank holds some.
    held: Rc<RefCell<Vec<usize>>>,
    holds: bool,
    right: Vector,
    solution: Vector,
    /// Systems that iterations have solved, by all factors of the engine.
    solves: Rc<Cell<LinearSolves>>,
    /// Position of this rank's first dof in global vectors.
    first: usize,
    flexibility: Flexibility,
    /// Solution of the last condensed right-hand side without contact, its values at the contact
    /// dofs, and the condensed right-hand side.
    free: Vec<f64>,
    free_contact_dofs: Vec<f64>,
    condensed: Vec<f64>,
}

impl PetscFactor {
    /// Factors a matrix over the dofs of a mesh, by the solver that the options choose.
    /// Collective.
    pub(super) fn new(
        plex: &Plex,
        matrix: Matrix,
        cells: Option<CellOperator>,
        linear: SystemSolver,
        solves: Rc<Cell<LinearSolves>>,
    ) -> Result<PetscFactor> {
        let context = plex.context().clone();
        solves.set(LinearSolves { method: linear.method(), ..solves.get() });
        let cells = cells
            .filter(|_| linear.method() != LinearMethod::Direct)
            .map(|cells| Rc::new(RefCell::new(cells)));
        let held = Rc::<RefCell<Vec<usize>>>::default();
        // Multigrid holds dofs in its own matrix, other methods in a copy.
        let solver_held =
            if linear.method() == LinearMethod::Multigrid { held.clone() } else { Rc::default() };
        let operator = operator(&context, cells.as_ref(), &matrix, &solver_held)?;
        let (solver, levels) = solver(&context, &matrix, operator, linear.hierarchy())?;
        let (right, solution) = (plex.global_vector()?, plex.global_vector()?);
        Ok(PetscFactor {
            cells,
            solver,
            linear,
            levels,
            cascade: None,
            pinned: None,
            held,
            holds: false,
            first: right.range().start as usize,
            flexibility: Flexibility::new(&context, right.local_size()),
            context,
            free: vec![0.0; right.local_size()],
            free_contact_dofs: Vec::new(),
            condensed: Vec::new(),
            right,
            solution,
            solves,
            matrix,
        })
    }

    /// Solves for the right-hand side in x, with pinned dofs or without.
    fn solve_with(&mut self, pinned: bool, criterion: StoppingCriterion, x: &mut [f64]) -> Result<()> {
        let solver = match &mut self.pinned {
            Some((_, solver)) if pinned && self.holds => solver,
            _ => &mut self.solver,
        };
        // Held dofs have equations of their own, whose size the norm of an iteration cannot weigh
        // against the size of the others.
        let held = if pinned && self.linear.method() != LinearMethod::Direct {
            self.held.borrow().clone()
        } else {
            Vec::new()
        };
        let values: Vec<f64> = held.iter().map(|&dof| std::mem::take(&mut x[dof])).collect();
        self.right.set_local(x)?;
        match criterion {
            StoppingCriterion::Exact => solver.solve(&self.right, &mut self.solution)?,
            StoppingCriterion::Rough => solver.solve_roughly(&self.right, &mut self.solution)?,
            StoppingCriterion::UpTo(error) => solver.solve_to(error, &self.right, &mut self.solution)?,
        }
        if self.linear.method() != LinearMethod::Direct {
            let mut solves = self.solves.get();
            solves.record(solver.iterations()?);
            self.solves.set(solves);
        }
        self.solution.copy_to(x)?;
        held.iter().zip(values).for_each(|(&dof, value)| x[dof] = value);
        Ok(())
    }
}

/// Solver of linear systems that the options choose.
#[derive(Clone)]
pub(super) enum SystemSolver {
    /// Our own factors of the ranks' cells and of their interface.
    Substructures,
    /// Factorisation by PETSc.
    Direct,
    /// Conjugate gradients with geometric multigrid.
    Multigrid(Rc<Hierarchy>),
    /// Iteration whose preconditioner needs the matrix of the cells of each rank by itself.
    Subdomains,
    /// Any other iteration.
    Iterative,
}

impl SystemSolver {
    /// Returns the solver that the options choose, by default multigrid on a mesh with a hierarchy.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the user asks for a package that corrupts memory.
    pub fn new(context: &Rc<Context>, hierarchy: Option<&Rc<Hierarchy>>) -> Result<SystemSolver> {
        let solver = Ksp::new(context, Comm::World, "")?;
        Ok(match (solver.is_multigrid()?, hierarchy) {
            (None | Some(true), Some(hierarchy)) => SystemSolver::Multigrid(hierarchy.clone()),
            _ if context.solver_options()?.is_empty() => SystemSolver::Substructures,
            _ if solver.is_direct()? => SystemSolver::Direct,
            _ if solver.needs_subdomains()? => SystemSolver::Subdomains,
            _ => SystemSolver::Iterative,
        })
    }

    /// Returns the method.
    pub fn method(&self) -> LinearMethod {
        match self {
            SystemSolver::Substructures | SystemSolver::Direct => LinearMethod::Direct,
            SystemSolver::Multigrid(_) => LinearMethod::Multigrid,
            SystemSolver::Subdomains | SystemSolver::Iterative => LinearMethod::Iterative,
        }
    }

    /// Returns the hierarchy of multigrid.
    fn hierarchy(&self) -> Option<&Rc<Hierarchy>> {
        match self {
            SystemSolver::Multigrid(hierarchy) => Some(hierarchy),
            _ => None,
        }
    }
}

/// Creates the operator that an iteration solves for: the product of the cells, with the rows and
/// columns of held dofs replaced by rows of the identity. Collective.
///
/// The assembled matrix of a fine mesh has lost digits, which an iteration on it would have to
/// correct by the residual of the cells.
fn operator(
    context: &Rc<Context>,
    cells: Option<&Rc<RefCell<CellOperator>>>,
    matrix: &Matrix,
    held: &Rc<RefCell<Vec<usize>>>,
) -> Result<Option<Operator>> {
    let Some(cells) = cells.cloned() else { return Ok(None) };
    let held = held.clone();
    let product = move |x: &Vector, y: &mut Vector| {
        let cells = &mut *cells.borrow_mut();
        x.with_local(|x| y.with_local_mut(|y| cells.apply_with_held(&held.borrow(), x, y)))??
    };
    Operator::new(context, matrix.local_size()[0], product).map(Some)
}

/// Creates a solver of a matrix, or of the operator in its place, and factors the matrix; given
/// a hierarchy, multigrid preconditions it.
fn solver(
    context: &Rc<Context>,
    matrix: &Matrix,
    operator: Option<Operator>,
    hierarchy: Option<&Rc<Hierarchy>>,
) -> Result<(Ksp, Option<MultigridLevels>)> {
    let mut solver = Ksp::new(context, Comm::World, "")?;
    let levels = match hierarchy {
        Some(hierarchy) => {
            let interpolations = hierarchy.interpolations();
            Some(solver.default_to_multigrid(matrix, &interpolations, hierarchy.smoother())?)
        }
        None => {
            solver.default_to_cholesky()?;
            None
        }
    };
    match operator {
        Some(operator) => solver.set_own_operator(operator, matrix)?,
        None => solver.set_operator(matrix)?,
    }
    solver.set_from_options()?;
    solver.set_up()?;
    Ok((solver, levels))
}

impl Factor for PetscFactor {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.solve_with(true, StoppingCriterion::Exact, x)
    }

    fn cascade(&mut self) -> Option<&mut dyn CascadeFactor> {
        (self.linear.method() == LinearMethod::Multigrid).then_some(self as _)
    }

    fn known_error(&self) -> Option<f64> {
        let iterates = self.cells.is_some() && self.solver.iterates().unwrap_or(false);
        iterates.then(|| self.solver.tolerance().unwrap_or(f64::NAN))
    }

    fn max_schur_error(&self) -> f64 {
        MAX_SCHUR_ERROR
    }

    fn schur(&self) -> &Mat<f64> {
        self.flexibility.schur()
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], more: &mut [f64]) -> Result<()> {
        self.context.comm().all_reduce_sum_slice_unordered(more);
        let mut free = std::mem::take(&mut self.free);
        free.copy_from_slice(b);
        self.solve_with(false, StoppingCriterion::Exact, &mut free)?;
        self.free = free;
        self.free_contact_dofs = self.flexibility.gather(&self.free);
        self.condensed = self.flexibility.times_schur(&self.free_contact_dofs);
        h.copy_from_slice(&self.condensed);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        x.copy_from_slice(&self.free);
        if values != self.free_contact_dofs {
            // x = x_free + A^-1 G^T r, where the reactions r move the contact dofs to their values.
            // Overwriting these entries of x by the values themselves would gain a last digit and
            // spoil the equilibrium on fine meshes.
            let mut forces = self.flexibility.times_schur(values);
            subtract(&self.condensed, &mut forces);
            if !self.flexibility.add_displacement(&forces, x) {
                self.flexibility.put_forces(&forces, x);
                self.solve_with(false, StoppingCriterion::Exact, x)?;
                add(&self.free, x);
            }
        }
        Ok(())
    }

    fn solve_schur(&self, h: &mut [f64]) {
        if *h == self.condensed {
            h.copy_from_slice(&self.free_contact_dofs);
        } else {
            self.flexibility.solve_schur(h);
        }
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        *self.held.borrow_mut() = dofs.to_vec();
        self.holds = self.context.comm().all_reduce_any(!dofs.is_empty());
        if let Some(levels) = &mut self.levels {
            return self.solver.hold(&mut self.matrix, levels, dofs);
        }
        if !self.holds {
            return Ok(());
        }
        let rows: Vec<Index> = dofs.iter().map(|&dof| (self.first + dof) as Index).collect();
        if let (LinearMethod::Direct, Some((held, solver))) = (self.linear.method(), &mut self.pinned) {
            // The matrix keeps its pattern, and thus its analysis.
            held.copy_from(&self.matrix)?;
            held.zero_rows_columns(&rows, 1.0)?;
            solver.set_operator(held)?;
            return solver.set_up();
        }
        self.pinned = None;
        let mut held = self.matrix.duplicate()?;
        held.copy_from(&self.matrix)?;
        held.keep_pattern()?;
        held.zero_rows_columns(&rows, 1.0)?;
        held.set_positive_definite()?;
        held.share_near_null_space(&self.matrix)?;
        let operator = operator(&self.context, self.cells.as_ref(), &self.matrix, &self.held)?;
        let (solver, _) = solver(&self.context, &held, operator, None)?;
        self.pinned = Some((held, solver));
        Ok(())
    }

    fn set_contact_dofs(&mut self, contact_dofs: &[usize]) -> Result<bool> {
        self.flexibility.set(contact_dofs, &mut self.solver)?;
        Ok(true)
    }

    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        self.flexibility.archive(&mut self.solver, archive)
    }
}

impl CascadeFactor for PetscFactor {
    fn solve_roughly(&mut self, x: &mut [f64]) -> Result<()> {
        self.solve_with(true, StoppingCriterion::Rough, x)
    }

    fn solve_correction(&mut self, norm: f64, x: &mut [f64]) -> Result<()> {
        let ends_early = self.solver.measures_energy()?;
        let error = if ends_early { MARGIN * norm * self.solver.tolerance()? } else { 0.0 };
        self.solve_with(true, StoppingCriterion::UpTo(error), x)
    }

    fn find_contact(
        &mut self,
        b: &[f64],
        bounded: &BoundedDofs,
        x: &mut [f64],
        sides: &mut [i8],
    ) -> Result<bool> {
        let Some(hierarchy) = self.linear.hierarchy().cloned() else { return Ok(false) };
        let Some(levels) = &self.levels else { return Ok(false) };
        let cascade = match self.cascade.take() {
            Some(cascade) => cascade,
            None => Cascade::new(&self.context, levels.free_coarse(), &hierarchy)?,
        };
        let cascade = self.cascade.insert(cascade);
        self.right.set_local(b)?;
        // An iteration that gives up on a coarse mesh suggests nothing, and harms no answer.
        let answer = cascade.find(hierarchy.steps(), &self.right, bounded, &mut self.solution, sides);
        if answer.is_ok() {
            self.solution.copy_to(x)?;
        }
        Ok(answer.is_ok())
    }
}
