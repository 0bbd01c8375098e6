//! Factors of matrices over all ranks.

use super::hierarchy::Hierarchy;
use super::products::CellOperator;
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, axpy};
use crate::linalg::{Factor, LinearMethod, LinearSolves};
use crate::petsc::{Comm, Context, Index, Ksp, Matrix, Operator, Plex, Vector};
use faer::Mat;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use std::cell::{Cell, RefCell};
use std::rc::Rc;

/// Number of columns of the inverse computed at once.
const BLOCK: usize = 64;

/// Relative tolerance of solves that only have to find the active dofs.
const ROUGH: f64 = 1e-3;

/// Matrix factored by PETSc: Cholesky by MUMPS, unless `-ksp_...` and `-pc_...` say otherwise.
///
/// The Schur complement of the contact dofs is the inverse of their block S of A^-1 (the
/// flexibility), which comes from solves with many right-hand sides at once.
pub struct DistributedFactor {
    context: Rc<Context>,
    matrix: Matrix,
    /// Matrix as the cells apply it, which an iteration solves for.
    cells: Option<Rc<RefCell<CellOperator>>>,
    solver: Ksp,
    linear: SystemSolver,
    /// Solver of the matrix with some dofs held, if there are any.
    pinned: Option<Ksp>,
    /// Held dofs that this rank owns.
    held: Vec<usize>,
    right: Vector,
    solution: Vector,
    /// Systems that iterations have solved, by all factors of the engine.
    solves: Rc<Cell<LinearSolves>>,
    /// Position of this rank's first dof in global vectors.
    first: usize,
    /// Contact dofs of this rank, and the offset of the first among those of all ranks.
    contact_dofs: Vec<usize>,
    before: usize,
    /// Flexibility (block of A^-1 at the contact dofs), and its inverse, the Schur complement.
    flexibility: Mat<f64>,
    schur: Mat<f64>,
    /// Solution of the last condensed right-hand side without contact, its values at the contact
    /// dofs, and the condensed right-hand side.
    free: Vec<f64>,
    free_contact_dofs: Vec<f64>,
    condensed: Vec<f64>,
}

impl DistributedFactor {
    /// Factors a matrix over the dofs of a mesh, by the solver that the options choose.
    /// Collective.
    pub(super) fn new(
        plex: &Plex,
        matrix: Matrix,
        cells: Option<CellOperator>,
        linear: SystemSolver,
        solves: Rc<Cell<LinearSolves>>,
    ) -> Result<DistributedFactor> {
        let context = plex.context().clone();
        solves.set(LinearSolves { method: linear.method(), ..solves.get() });
        let cells = cells
            .filter(|_| linear.method() != LinearMethod::Direct)
            .map(|cells| Rc::new(RefCell::new(cells)));
        let operator = operator(&context, cells.as_ref(), &matrix, &[])?;
        let solver = solver(&context, &matrix, operator, linear.interpolations().as_deref())?;
        let (right, solution) = (plex.global_vector()?, plex.global_vector()?);
        Ok(DistributedFactor {
            context,
            cells,
            solver,
            linear,
            pinned: None,
            held: Vec::new(),
            first: right.range().start as usize,
            contact_dofs: Vec::new(),
            before: 0,
            flexibility: Mat::zeros(0, 0),
            schur: Mat::zeros(0, 0),
            free: vec![0.0; right.local_size()],
            free_contact_dofs: Vec::new(),
            condensed: Vec::new(),
            right,
            solution,
            solves,
            matrix,
        })
    }

    /// Replaces the contact dofs; columns of those that stay are kept.
    pub(super) fn set_contact_dofs(&mut self, contact_dofs: &[usize]) -> Result<()> {
        // Whether each contact dof is an old one, and its index among them.
        let place = |dof: &usize| {
            let old = self.contact_dofs.binary_search(dof);
            (old.is_ok(), old.map_or(0, |k| self.before + k))
        };
        let own: Vec<(bool, usize)> = contact_dofs.iter().map(place).collect();
        let (places, before) = self.context.comm().all_gather_with_offset(&own);
        (self.contact_dofs, self.before) = (contact_dofs.to_vec(), before);
        let count = places.len();
        let old = |i: usize| places[i].0.then_some(places[i].1);
        let mut block = Mat::zeros(count, count);
        for (j, i) in (0..count).flat_map(|j| (0..count).map(move |i| (j, i))) {
            if let (Some(i_old), Some(j_old)) = (old(i), old(j)) {
                block[(i, j)] = self.flexibility[(i_old, j_old)];
            }
        }
        let new: Vec<usize> = (0..count).filter(|&j| old(j).is_none()).collect();
        self.solve_for_columns(&new, &mut block)?;
        for (&j, i) in new.iter().flat_map(|j| (0..count).map(move |i| (j, i))) {
            // Both columns were solved for: take their mean.
            let value = if old(i).is_none() { 0.5 * (block[(i, j)] + block[(j, i)]) } else { block[(i, j)] };
            (block[(i, j)], block[(j, i)]) = (value, value);
        }
        self.flexibility = block;
        self.invert()
    }

    /// Computes the Schur complement from the flexibility.
    fn invert(&mut self) -> Result<()> {
        let count = self.flexibility.nrows();
        self.schur = Mat::zeros(0, 0);
        if count > 0 {
            let llt = self.flexibility.llt(faer::Side::Lower).map_err(|_| {
                Error::Singular(format!("the flexibility of {count} contact dofs is not positive definite"))
            })?;
            self.schur = llt.inverse();
        }
        Ok(())
    }

    /// Returns the assembled matrix that is factored.
    pub fn matrix(&self) -> &Matrix {
        &self.matrix
    }

    /// Solves for columns of the flexibility.
    fn solve_for_columns(&mut self, columns: &[usize], block: &mut Mat<f64>) -> Result<()> {
        let (own, count) = (self.free.len(), block.nrows());
        for lot in columns.chunks(BLOCK) {
            let mut right = Matrix::dense(&self.context, Comm::World, own, lot.len())?;
            let mut solution = Matrix::dense(&self.context, Comm::World, own, lot.len())?;
            right.with_columns_mut(|values| {
                for (number, column) in lot.iter().enumerate() {
                    let mine = column.checked_sub(self.before).and_then(|k| self.contact_dofs.get(k));
                    if let Some(dof) = mine {
                        values[number * own + dof] = 1.0;
                    }
                }
            })?;
            self.solver.solve_columns(&right, &mut solution)?;
            let mut rows = vec![0.0; count * lot.len()];
            solution.with_columns(|values| {
                for (k, &dof) in self.contact_dofs.iter().enumerate() {
                    for number in 0..lot.len() {
                        rows[number * count + self.before + k] = values[number * own + dof];
                    }
                }
            })?;
            self.context.comm().all_reduce_sum_slice_unordered(&mut rows);
            for (number, &column) in lot.iter().enumerate() {
                for row in 0..count {
                    block[(row, column)] = rows[number * count + row];
                }
            }
        }
        Ok(())
    }

    /// Solves for the right-hand side in x, with pinned dofs or without, to a tolerance larger than
    /// that of the solver if one is given.
    fn solve_with(&mut self, pinned: bool, rough: Option<f64>, x: &mut [f64]) -> Result<()> {
        let solver = if pinned { self.pinned.as_mut().unwrap_or(&mut self.solver) } else { &mut self.solver };
        // Held dofs have equations of their own, whose size the norm of an iteration cannot weigh
        // against that of the others.
        let held: &[usize] =
            if pinned && self.linear.method() != LinearMethod::Direct { &self.held } else { &[] };
        let values: Vec<f64> = held.iter().map(|&dof| std::mem::take(&mut x[dof])).collect();
        self.right.set_local(x)?;
        match rough {
            Some(tolerance) => solver.solve_to(tolerance, &self.right, &mut self.solution)?,
            None => solver.solve(&self.right, &mut self.solution)?,
        }
        if self.linear.method() != LinearMethod::Direct {
            let mut solves = self.solves.get();
            solves.note(solver.iterations()?);
            self.solves.set(solves);
        }
        self.solution.copy_to(x)?;
        held.iter().zip(values).for_each(|(&dof, value)| x[dof] = value);
        Ok(())
    }

    fn times_schur(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (j, x) in x.iter().enumerate() {
            axpy(*x, self.schur.col_as_slice(j), &mut product);
        }
        product
    }
}

/// Solver of linear systems that the options choose.
#[derive(Clone)]
pub(super) enum SystemSolver {
    /// Factorisation.
    Direct,
    /// Conjugate gradients with geometric multigrid.
    Multigrid(Rc<Hierarchy>),
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
            _ if solver.is_direct()? => SystemSolver::Direct,
            _ => SystemSolver::Iterative,
        })
    }

    /// Returns the method.
    pub fn method(&self) -> LinearMethod {
        match self {
            SystemSolver::Direct => LinearMethod::Direct,
            SystemSolver::Multigrid(_) => LinearMethod::Multigrid,
            SystemSolver::Iterative => LinearMethod::Iterative,
        }
    }

    /// Returns the interpolation to each level from the next coarser one, coarsest first.
    fn interpolations(&self) -> Option<Vec<&Matrix>> {
        match self {
            SystemSolver::Multigrid(hierarchy) => Some(hierarchy.interpolations()),
            _ => None,
        }
    }
}

/// Creates the operator that an iteration solves for: the product of the cells, with the rows and
/// columns of held dofs replaced by those of the identity. Collective.
///
/// The assembled matrix of a fine mesh has lost digits, which an iteration on it would have to
/// correct by the residual of the cells.
fn operator(
    context: &Rc<Context>,
    cells: Option<&Rc<RefCell<CellOperator>>>,
    matrix: &Matrix,
    held: &[usize],
) -> Result<Option<Operator>> {
    let Some(cells) = cells.cloned() else { return Ok(None) };
    let held = held.to_vec();
    let product = move |x: &Vector, y: &mut Vector| {
        let cells = &mut *cells.borrow_mut();
        x.with_local(|x| y.with_local_mut(|y| cells.apply_with_held(&held, x, y)))??
    };
    Operator::new(context, matrix.local_size()[0], product).map(Some)
}

/// Creates a solver of a matrix, or of the operator in its place, and factors the matrix; given
/// interpolations, multigrid preconditions it.
fn solver(
    context: &Rc<Context>,
    matrix: &Matrix,
    operator: Option<Operator>,
    interpolations: Option<&[&Matrix]>,
) -> Result<Ksp> {
    let mut solver = Ksp::new(context, Comm::World, "")?;
    match interpolations {
        Some(interpolations) => solver.default_to_multigrid(matrix, interpolations)?,
        None => solver.default_to_cholesky()?,
    }
    match operator {
        Some(operator) => solver.set_own_operator(operator, matrix)?,
        None => solver.set_operator(matrix)?,
    }
    solver.set_from_options()?;
    solver.set_up()?;
    Ok(solver)
}

impl Factor for DistributedFactor {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.solve_with(true, None, x)
    }

    fn solve_roughly(&mut self, x: &mut [f64]) -> Result<bool> {
        let is_exact = !self.prefers_pinning();
        self.solve_with(true, (!is_exact).then_some(ROUGH), x)?;
        Ok(is_exact)
    }

    fn known_error(&self) -> Option<f64> {
        let iterates = self.cells.is_some() && self.solver.iterates().unwrap_or(false);
        iterates.then(|| self.solver.tolerance().unwrap_or(f64::NAN))
    }

    fn prefers_pinning(&self) -> bool {
        self.linear.method() == LinearMethod::Multigrid
    }

    fn schur(&self) -> &Mat<f64> {
        &self.schur
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64]) -> Result<()> {
        let mut free = std::mem::take(&mut self.free);
        free.copy_from_slice(b);
        self.solve_with(false, None, &mut free)?;
        self.free = free;
        let own: Vec<f64> = self.contact_dofs.iter().map(|&dof| self.free[dof]).collect();
        self.free_contact_dofs = self.context.comm().all_gather(&own);
        self.condensed = self.times_schur(&self.free_contact_dofs);
        h.copy_from_slice(&self.condensed);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        if values != self.free_contact_dofs {
            // x = x_free + A^-1 G^T r, where the reactions r move the contact dofs to their values.
            // Overwriting these entries of x by the values themselves would gain a last digit and
            // spoil the equilibrium on fine meshes.
            let forces = self.times_schur(values);
            x.fill(0.0);
            for (k, &dof) in self.contact_dofs.iter().enumerate() {
                x[dof] = forces[self.before + k] - self.condensed[self.before + k];
            }
            self.solve_with(false, None, x)?;
            add(&self.free, x);
        } else {
            x.copy_from_slice(&self.free);
        }
        Ok(())
    }

    fn solve_schur(&self, h: &mut [f64]) {
        if *h == self.condensed {
            h.copy_from_slice(&self.free_contact_dofs);
            return;
        }
        let mut right = Mat::from_fn(h.len(), 1, |i, _| h[i]);
        if let Ok(llt) = self.schur.llt(faer::Side::Lower) {
            llt.solve_in_place(&mut right);
        }
        h.iter_mut().enumerate().for_each(|(i, h)| *h = right[(i, 0)]);
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        self.pinned = None;
        self.held = dofs.to_vec();
        if self.context.comm().all_reduce_any(!dofs.is_empty()) {
            let rows: Vec<Index> = dofs.iter().map(|&dof| (self.first + dof) as Index).collect();
            let mut held = self.matrix.duplicate()?;
            held.copy_from(&self.matrix)?;
            held.zero_rows_columns(&rows, 1.0)?;
            held.set_positive_definite()?;
            held.share_near_null_space(&self.matrix)?;
            let truncated = match &self.linear {
                SystemSolver::Multigrid(hierarchy) => hierarchy.truncated(&self.matrix, dofs)?,
                _ => None,
            };
            let mut interpolations = self.linear.interpolations();
            if let (Some(levels), Some(truncated)) = (&mut interpolations, &truncated) {
                levels.pop();
                levels.push(truncated);
            }
            let operator = operator(&self.context, self.cells.as_ref(), &self.matrix, dofs)?;
            self.pinned = Some(solver(&self.context, &held, operator, interpolations.as_deref())?);
        }
        Ok(())
    }

    /// Archives the flexibility, whose columns depend on the order in which they were solved for.
    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        let count = self.flexibility.nrows();
        let mut columns: Vec<f64> =
            (0..count).flat_map(|j| self.flexibility.col_as_slice(j).to_vec()).collect();
        if archive.value_of_same(&mut columns)? && !archive.saves() {
            self.flexibility = Mat::from_fn(count, count, |i, j| columns[count * j + i]);
            self.invert()?;
        }
        Ok(())
    }
}
