//! Factors of matrices over all ranks.

use super::cascade::Cascade;
use super::hierarchy::Hierarchy;
use super::products::CellOperator;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::{BoundedDofs, CascadeFactor, Factor, LinearMethod, LinearSolves};
use crate::petsc::{Context, Index, Ksp, Matrix, MultigridLevels, Operator, Vector};
use std::cell::{Cell, RefCell};
use std::rc::Rc;

/// Share of the tolerance at which the correction of an answer ends, whose start was not zero.
const MARGIN: f64 = 0.1;

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

/// Matrix factored or iterated on by PETSc: Cholesky by MUMPS, unless `-ksp_...` and `-pc_...` say
/// otherwise. Dofs in contact are pinned.
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
}

impl PetscFactor {
    /// Factors a matrix over the dofs of a mesh, by the solver that the options choose.
    /// Collective.
    pub(super) fn new(
        context: &Rc<Context>,
        matrix: Matrix,
        cells: Option<CellOperator>,
        linear: SystemSolver,
        solves: Rc<Cell<LinearSolves>>,
    ) -> Result<PetscFactor> {
        let context = context.clone();
        solves.set(LinearSolves { method: linear.method(), ..solves.get() });
        let cells = cells
            .filter(|_| linear.method() != LinearMethod::Direct)
            .map(|cells| Rc::new(RefCell::new(cells)));
        let held = Rc::<RefCell<Vec<usize>>>::default();
        // Multigrid holds dofs in its own matrix, other methods in a copy.
        let solver_held =
            if linear.method() == LinearMethod::Multigrid { held.clone() } else { Rc::default() };
        let operator = operator(&context, cells.as_ref(), &matrix, &solver_held)?;
        let (solver, levels) = solver((&context, linear.prefix), &matrix, operator, linear.hierarchy())?;
        let (right, solution) = (matrix.vector()?, matrix.vector()?);
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
            context,
            right,
            solution,
            solves,
            matrix,
        })
    }

    /// Solves for the right-hand side in x, with the pinned dofs held.
    fn solve_with(&mut self, criterion: StoppingCriterion, x: &mut [f64]) -> Result<()> {
        let solver = match &mut self.pinned {
            Some((_, solver)) if self.holds => solver,
            _ => &mut self.solver,
        };
        // Held dofs have equations of their own, whose size the norm of an iteration cannot weigh
        // against the size of the others.
        let held = if self.linear.method() != LinearMethod::Direct {
            self.held.borrow().clone()
        } else {
            Vec::new()
        };
        let values: Vec<f64> = held.iter().map(|&dof| std::mem::take(&mut x[dof])).collect();
        self.right.set_local(x)?;
        match criterion {
            StoppingCriterion::Exact => solver.solve(&self.right, &mut self.solution)?,
            StoppingCriterion::Rough => solver.solve_roughly(&self.right, &mut self.solution)?,
            StoppingCriterion::UpTo(error) => {
                solver.solve_within(0.0, error, &self.right, &mut self.solution)?
            }
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

/// Solver of linear systems that the options with a prefix choose.
#[derive(Clone)]
pub(super) struct SystemSolver {
    prefix: &'static str,
    pub kind: SolverKind,
}

/// Kind of a solver of linear systems.
#[derive(Clone)]
pub(super) enum SolverKind {
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
    /// Returns the solver that the options with a prefix choose, by default multigrid on a mesh
    /// with a hierarchy. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the user asks for a package that corrupts memory.
    pub fn new(
        context: &Rc<Context>,
        prefix: &'static str,
        hierarchy: Option<&Rc<Hierarchy>>,
    ) -> Result<SystemSolver> {
        let solver = Ksp::new(context, prefix)?;
        let kind = match (solver.is_multigrid()?, hierarchy) {
            (None | Some(true), Some(hierarchy)) => SolverKind::Multigrid(hierarchy.clone()),
            _ if context.solver_options(prefix)?.is_empty() => SolverKind::Substructures,
            _ if solver.is_direct()? => SolverKind::Direct,
            _ if solver.needs_subdomains()? => SolverKind::Subdomains,
            _ => SolverKind::Iterative,
        };
        Ok(SystemSolver { prefix, kind })
    }

    /// Returns the method.
    pub fn method(&self) -> LinearMethod {
        match &self.kind {
            SolverKind::Substructures | SolverKind::Direct => LinearMethod::Direct,
            SolverKind::Multigrid(_) => LinearMethod::Multigrid,
            SolverKind::Subdomains | SolverKind::Iterative => LinearMethod::Iterative,
        }
    }

    /// Returns the hierarchy of multigrid.
    fn hierarchy(&self) -> Option<&Rc<Hierarchy>> {
        match &self.kind {
            SolverKind::Multigrid(hierarchy) => Some(hierarchy),
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
    (context, prefix): (&Rc<Context>, &str),
    matrix: &Matrix,
    operator: Option<Operator>,
    hierarchy: Option<&Rc<Hierarchy>>,
) -> Result<(Ksp, Option<MultigridLevels>)> {
    let mut solver = Ksp::new(context, prefix)?;
    let levels = match hierarchy {
        Some(hierarchy) => {
            let interpolations = hierarchy.interpolations();
            Some(solver.default_to_multigrid(matrix, &interpolations, hierarchy.smoother)?)
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
        self.solve_with(StoppingCriterion::Exact, x)
    }

    fn cascade(&mut self) -> Option<&mut dyn CascadeFactor> {
        (self.linear.method() == LinearMethod::Multigrid).then_some(self as _)
    }

    fn known_error(&self) -> Option<f64> {
        let iterates = self.cells.is_some() && self.solver.iterates().unwrap_or(false);
        iterates.then(|| self.solver.tolerance().unwrap_or(f64::NAN))
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
        let (solver, _) = solver((&self.context, self.linear.prefix), &held, operator, None)?;
        self.pinned = Some((held, solver));
        Ok(())
    }
}

impl CascadeFactor for PetscFactor {
    fn solve_roughly(&mut self, x: &mut [f64]) -> Result<()> {
        self.solve_with(StoppingCriterion::Rough, x)
    }

    fn solve_correction(&mut self, norm: f64, x: &mut [f64]) -> Result<()> {
        let ends_early = self.solver.measures_energy()?;
        let error = if ends_early { MARGIN * norm * self.solver.tolerance()? } else { 0.0 };
        self.solve_with(StoppingCriterion::UpTo(error), x)
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
        let answer = cascade.find(&hierarchy.steps, &self.right, bounded, &mut self.solution, sides);
        if answer.is_ok() {
            self.solution.copy_to(x)?;
        }
        Ok(answer.is_ok())
    }
}
