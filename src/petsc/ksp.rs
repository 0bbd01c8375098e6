//! Linear solvers: a factorisation unless the options choose an iteration.

#![allow(unsafe_code)]

use super::callback::settle;
use super::error::{call, get, int, text};
use super::handle::handle;
use super::options::Prefix;
use super::{Context, Matrix, Operator, Reason, Vector, sys};
use crate::error::{Error, Result};
use std::rc::Rc;

handle! {
    /// Linear solver. Creating and dropping it is collective.
    Ksp, KSP, KSPDestroy, prefix: String, operator: Option<Operator>
}

impl Ksp {
    /// Creates a solver that reads the options `-<prefix>ksp_...` and `-<prefix>pc_...`.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn new(context: &Rc<Context>, prefix: &str) -> Result<Self> {
        let raw = get!(KSPCreate(context.raw()))?;
        let mut solver = Self::owning(raw, context);
        call!(KSPSetOptionsPrefix(raw, Prefix::new(prefix)?.pointer()))?;
        solver.prefix = prefix.into();
        context.note_prefix(prefix);
        Ok(solver)
    }

    /// Makes a Cholesky factorisation by MUMPS the default; the user's options override it.
    /// Collective.
    ///
    /// If the user asks for another preconditioner, conjugate gradients become the default, instead
    /// of one application of the preconditioner.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the user asks for a package that corrupts memory;
    /// [`Error::Petsc`] where PETSc reports an error.
    pub fn default_to_cholesky(&mut self) -> Result<()> {
        let direct = is_direct(&self.context, &self.prefix)?;
        let preconditioner = self.preconditioner()?;
        call!(PCSetType(preconditioner, c"cholesky".as_ptr()))?;
        if !direct {
            if self.needs_subdomains()? {
                // Otherwise rounding makes the preconditioner indefinite where subdomains float.
                self.context.default_option(&format!("{}pc_bddc_use_change_of_basis", self.prefix), "1")?;
            }
            return self.default_to_conjugate_gradients(ITERATIVE);
        }
        call!(KSPSetType(self.raw, c"preonly".as_ptr()))?;
        call!(PCFactorSetMatSolverType(preconditioner, c"mumps".as_ptr()))
    }

    /// Makes conjugate gradients the default method, with a relative tolerance.
    pub(super) fn default_to_conjugate_gradients(&mut self, tolerance: f64) -> Result<()> {
        call!(KSPSetType(self.raw, c"cg".as_ptr()))?;
        let kind = self.context.option(&format!("{}ksp_type", self.prefix))?;
        if kind.is_none_or(|kind| kind == "cg") {
            // The natural norm is nearly the energy norm of the error, which decreases in every
            // iteration of conjugate gradients; the norm of the preconditioned residual first rises
            // by orders of magnitude.
            call!(KSPSetNormType(self.raw, sys::KSPNormType::KSP_NORM_NATURAL))?;
        }
        let iterations = int(MOST_ITERATIONS)?;
        call!(KSPSetTolerances(self.raw, tolerance, 0.0, f64::MAX, iterations))
    }

    /// Returns whether a factorisation solves the systems, rather than an iteration.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] where the user asks for a package that corrupts memory.
    pub fn is_direct(&self) -> Result<bool> {
        is_direct(&self.context, &self.prefix)
    }

    /// Returns whether the user asks for geometric multigrid; `None` where the options name no
    /// preconditioner.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn is_multigrid(&self) -> Result<Option<bool>> {
        Ok(self.context.option(&format!("{}pc_type", self.prefix))?.map(|kind| kind == "mg"))
    }

    /// Returns whether the user asks for a preconditioner that needs the matrix of the cells of
    /// each rank by itself, a matrix of subdomains.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn needs_subdomains(&self) -> Result<bool> {
        Ok(self.context.option(&format!("{}pc_type", self.prefix))?.is_some_and(|kind| kind == "bddc"))
    }

    /// Reads the options; [`Ksp::set_operator`] may come before or after. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where an option has an impossible value.
    pub fn set_from_options(&mut self) -> Result<()> {
        call!(KSPSetFromOptions(self.raw))
    }

    /// Sets the matrix. Collective.
    ///
    /// A second call after a change of its values has the matrix factored anew.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn set_operator(&mut self, matrix: &Matrix) -> Result<()> {
        self.set_operators(matrix, matrix)
    }

    /// Sets the matrix and the matrix from which the preconditioner is built. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn set_operators(&mut self, matrix: &Matrix, preconditioner: &Matrix) -> Result<()> {
        call!(KSPSetOperators(self.raw, matrix.raw, preconditioner.raw))
    }

    /// Sets the operator, which the solver keeps, and the matrix from which the preconditioner is
    /// built. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn set_own_operator(&mut self, operator: Operator, preconditioner: &Matrix) -> Result<()> {
        self.set_operators(&operator.matrix, preconditioner)?;
        self.operator = Some(operator);
        Ok(())
    }

    /// Builds the preconditioner, which means factoring the matrix for a direct solver. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the factorisation fails; [`Error::Petsc`] where PETSc
    /// reports an error.
    pub fn set_up(&mut self) -> Result<()> {
        call!(KSPSetUp(self.raw))?;
        self.refuse_failed_factor()
    }

    /// Solves A x = b from x = 0. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the factorisation failed; [`Error::Petsc`] where the
    /// iteration did not converge.
    pub fn solve(&mut self, b: &Vector, x: &mut Vector) -> Result<()> {
        self.settle(call!(KSPSolve(self.raw, b.raw, x.raw)))
    }

    /// Solves A x = b from x = 0 to a residual of a twentieth of b, but no further than
    /// [`Ksp::solve`]: enough to find the active dofs. Collective.
    ///
    /// The natural norm of the last residual would take one more application of the preconditioner,
    /// a third of the time of two iterations. The residual is therefore measured as it is.
    ///
    /// # Errors
    /// Returns the errors of [`Ksp::solve`].
    pub fn solve_roughly(&mut self, b: &Vector, x: &mut Vector) -> Result<()> {
        if !self.measures_energy()? {
            return self.solve_within(ROUGH, 0.0, b, x);
        }
        call!(KSPSetNormType(self.raw, sys::KSPNormType::KSP_NORM_UNPRECONDITIONED))?;
        let solved = self.solve_within(ROUGH, 0.0, b, x);
        call!(KSPSetNormType(self.raw, sys::KSPNormType::KSP_NORM_NATURAL))?;
        solved
    }

    /// Solves A x = b from x = 0 to the largest one of those tolerances of the solver and two
    /// others, the absolute one in the norm in which the method measures its residual. Collective.
    ///
    /// # Errors
    /// Returns the errors of [`Ksp::solve`].
    pub fn solve_within(&mut self, relative: f64, absolute: f64, b: &Vector, x: &mut Vector) -> Result<()> {
        let [usual, least] = self.tolerances()?;
        let keep = f64::from(sys::PETSC_DEFAULT);
        let raw = self.raw;
        let set = |relative: f64, absolute: f64| {
            call!(KSPSetTolerances(raw, relative, absolute, keep, sys::PETSC_DEFAULT))
        };
        set(relative.max(usual), absolute.max(least))?;
        let solved = self.solve(b, x);
        set(usual, least)?;
        solved
    }

    /// Returns the relative tolerance at which iterations end.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn tolerance(&self) -> Result<f64> {
        Ok(self.tolerances()?[0])
    }

    /// Returns whether the method measures its residual in the natural norm, that of the energy.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn measures_energy(&self) -> Result<bool> {
        Ok(get!(KSPGetNormType(self.raw))? == sys::KSPNormType::KSP_NORM_NATURAL)
    }

    /// Returns the relative and the absolute tolerance.
    fn tolerances(&self) -> Result<[f64; 2]> {
        let (relative, absolute, _, _) =
            get!(KSPGetTolerances(self.raw; relative, absolute, divergence, iterations))?;
        Ok([relative, absolute])
    }

    /// Returns the error of the operator, of PETSc or of the iteration, if there is one.
    fn settle(&self, solved: Result<()>) -> Result<()> {
        match &self.operator {
            Some(operator) => settle(&operator.failure, solved)?,
            None => solved?,
        }
        self.judge()
    }

    /// Returns whether the solver iterates until its tolerance is met, rather than apply the
    /// preconditioner once.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn iterates(&self) -> Result<bool> {
        Ok(self.kind()?[0] != "preonly")
    }

    /// Returns the names of the Krylov method and of the preconditioner.
    fn kind(&self) -> Result<[String; 2]> {
        let names = [get!(KSPGetType(self.raw))?, get!(PCGetType(self.preconditioner()?))?];
        // SAFETY: the names belong to PETSc; they are null before they are set.
        Ok(names.map(|name| unsafe { text(name) }))
    }

    /// Returns the preconditioner.
    pub(super) fn preconditioner(&self) -> Result<sys::PC> {
        get!(KSPGetPC(self.raw))
    }

    fn judge(&self) -> Result<()> {
        self.refuse_failed_factor()?;
        let reason = self.reason()?;
        if reason.converged() {
            return Ok(());
        }
        let its = self.iterations()?;
        let ([method, preconditioner], prefix) = (self.kind()?, &self.prefix);
        Err(Error::Petsc(format!(
            "the linear solver (-{prefix}ksp_type {method} -{prefix}pc_type {preconditioner}) gave up after {its} \
             iterations: {}; without these options the matrix is factored",
            reason.text
        )))
    }

    fn refuse_failed_factor(&self) -> Result<()> {
        let what = match get!(PCGetFailedReason(self.preconditioner()?))? {
            sys::PCFailedReason::PC_NOERROR => return Ok(()),
            sys::PCFailedReason::PC_FACTOR_NUMERIC_ZEROPIVOT => "a pivot is zero or has the wrong sign",
            sys::PCFailedReason::PC_FACTOR_STRUCT_ZEROPIVOT => "its pattern is singular",
            sys::PCFailedReason::PC_FACTOR_OUTMEMORY => {
                return Err(Error::Petsc("PCSetUp(): the factor does not fit into memory".into()));
            }
            _ => "the solver gives no reason",
        };
        Err(Error::Singular(format!("the matrix cannot be factored: {what}")))
    }

    /// Returns why the last solve ended.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn reason(&self) -> Result<Reason> {
        let (code, name) =
            (get!(KSPGetConvergedReason(self.raw))?, get!(KSPGetConvergedReasonString(self.raw))?);
        // SAFETY: PETSc returns a constant string.
        Ok(Reason { code: code.0, text: unsafe { text(name) } })
    }

    /// Returns the number of iterations of the last solve.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where PETSc reports an error.
    pub fn iterations(&self) -> Result<usize> {
        Ok(get!(KSPGetIterationNumber(self.raw))? as usize)
    }

    /// Returns the numbers of negative, zero and positive pivots of the factor. Collective.
    ///
    /// MUMPS counts them with `-mat_mumps_icntl_24 1`; several ranks also need
    /// `-mat_mumps_icntl_13 1`.
    ///
    /// # Errors
    /// Returns [`Error::Petsc`] where the preconditioner is no Cholesky factorisation.
    pub fn inertia(&self) -> Result<[usize; 3]> {
        let factor = get!(PCFactorGetMatrix(self.preconditioner()?))?;
        let (negative, zero, positive) = get!(MatGetInertia(factor; negative, zero, positive))?;
        Ok([negative as usize, zero as usize, positive as usize])
    }
}

/// Relative tolerance of iterative linear solvers; the check of each step demands this accuracy.
const ITERATIVE: f64 = 1e-13;

/// Residual, relative to the right-hand side, at which rough solves end.
const ROUGH: f64 = 0.05;

/// Limit on the iterations of linear solvers.
const MOST_ITERATIONS: usize = 20_000;

/// Returns whether the user's options leave the linear solver a factorisation.
///
/// # Errors
/// Returns [`Error::Usage`] where the user asks for a package that corrupts memory.
fn is_direct(context: &Context, prefix: &str) -> Result<bool> {
    let package = format!("{prefix}pc_factor_mat_solver_type");
    if context.option(&package)?.is_some_and(|name| name.eq_ignore_ascii_case("superlu_dist")) {
        return Err(Error::Usage(format!(
            "-{package} superlu_dist: it corrupts the memory as the program ends; take mumps"
        )));
    }
    let preconditioner = context.option(&format!("{prefix}pc_type"))?;
    Ok(preconditioner.as_deref().is_none_or(|kind| kind == "cholesky" || kind == "lu"))
}

/// Sets the default options of a prefix to a Cholesky factorisation by MUMPS.
///
/// The user's options override them. With `alone`, the factor solves by itself; any other
/// preconditioner goes with conjugate gradients.
pub(super) fn direct_defaults(context: &Context, prefix: &str, alone: bool) -> Result<()> {
    let name = |end: &str| format!("{prefix}{end}");
    let direct = is_direct(context, prefix)?;
    if alone {
        context.default_option(&name("ksp_type"), if direct { "preonly" } else { "cg" })?;
    }
    context.default_option(&name("pc_type"), "cholesky")?;
    if direct {
        context.default_option(&name("pc_factor_mat_solver_type"), "mumps")?;
    }
    Ok(())
}
