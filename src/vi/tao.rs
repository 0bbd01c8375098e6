//! PETSc's minimisers between bounds on a step: `--vi tao`.
//!
//! The unknown minimises \( \frac12 y^T A y - b^T y \) in the scaled unknowns. `-tao_type tron` (trust region, the default), `bnls`,
//! `gpcg` or another one; those that answer wrongly or minimise something else are refused by name. Every default below yields to the
//! user's option of that name.

use super::Solver;
use super::scaled::{Bounded, Method, RESIDUAL, Scaled};
use crate::error::{Error, Result};
use crate::linalg::Sum;
use crate::petsc::{self, Comm, Context, Distributed, Reason, Vector};
use std::rc::Rc;

/// Options that make the methods converge on plates, and their values.
pub const DEFAULTS: &[(&str, &str)] = &[
    ("tao_type", "tron"),
    ("tao_gatol", RESIDUAL),
    ("tao_grtol", "0"),
    ("tao_gttol", "0"),
    ("tao_max_it", "100"),
];

/// The methods between bounds that answer rightly where they say so.
const TYPES: &[&str] = &["tron", "bnls", "gpcg", "bntr", "bntl", "blmvm", "bncg", "bqnls"];

/// Why a method cannot do a step.
fn refusal(kind: &str) -> &'static str {
    match kind {
        "bqpip" => "it says that it converged and answers wrongly where a bound has one side only",
        "ssils" | "asils" | "ssfls" | "asfls" => {
            "it solves for constraints that a step does not have, and crashes without them"
        }
        "almm" | "admm" | "lcl" | "ipm" | "pdipm" => {
            "it is for general constraints, and a step has bounds only"
        }
        "nls" | "ntr" | "ntl" | "lmvm" | "cg" | "nm" | "owlqn" | "bmrm" => "it knows no bounds",
        "bqnktr" | "bqnktl" | "bqnkls" => {
            "its quasi-Newton matrix has no factor, and without one it does not converge"
        }
        "pounders" | "brgn" => "it is for least squares",
        _ => "no PETSc method between bounds has this name",
    }
}

struct Minimiser(petsc::Tao<'static>);

impl Minimiser {
    fn new(context: &Rc<Context>, problem: &Rc<Scaled>, safe: bool) -> Result<Minimiser> {
        let prefix = if safe { "safe_" } else { "" };
        for (name, value) in DEFAULTS {
            context.default_option(&format!("{prefix}{name}"), value)?;
        }
        let option = format!("{prefix}tao_type");
        let kind = context.option(&option)?.unwrap_or_default();
        if !TYPES.contains(&kind.as_str()) {
            return Err(Error::Usage(format!(
                "-{option} {kind}: {}; take tron, bnls or gpcg",
                refusal(&kind)
            )));
        }
        let mut solver = petsc::Tao::new(context, Comm::World, prefix)?;
        solver.set_type(&kind)?;
        if ["bntr", "bntl"].contains(&kind.as_str()) {
            // They need a linear solver that knows a trust region.
            context.default_option(&format!("{prefix}tao_bnk_ksp_type"), "stcg")?;
        }
        solver.default_to_cholesky()?;
        let like = problem.right.borrow().duplicate()?;
        let (matrix, shared) = (problem.matrix.clone(), Rc::downgrade(problem));
        solver.set_objective(&like, move |y, gradient| {
            matrix.multiply(y, gradient)?;
            // The problem lives as long as its solver.
            let Some(problem) = shared.upgrade() else { return Ok(0.0) };
            let right = problem.right.borrow();
            let energy = 0.5 * y.dot(gradient)? - y.dot(&right)?;
            gradient.add_scaled(-1.0, &right)?;
            Ok(energy)
        })?;
        solver.set_hessian(&problem.matrix, |_, _| Ok(()))?;
        solver.set_from_options()?;
        context.accept_options(&format!("{prefix}tao_"))?;
        Ok(Minimiser(solver))
    }
}

impl Method for Minimiser {
    fn solve(&mut self, problem: &Scaled, y: &mut Vector) -> Result<(Reason, usize)> {
        self.0.set_bounds(&problem.lower.borrow(), &problem.upper.borrow())?;
        self.0.solve(y)?;
        Ok((self.0.reason()?, self.0.iterations()?))
    }
}

/// The solver of a step; see the [module page](self).
///
/// It assembles and factors the matrix, for bounds on `bounded` dofs; answers above the tolerance are tried again. Collective.
///
/// # Errors
/// [`Error::Usage`] for options that cannot work, [`Error::Singular`], [`Error::Petsc`].
pub fn solver(
    engine: &Distributed,
    sum: &Sum<Distributed>,
    bounded: usize,
    tolerance: f64,
) -> Result<Box<dyn Solver<Distributed>>> {
    let make = |context: &Rc<Context>, problem: &Rc<Scaled>, safe: bool| {
        Ok(Box::new(Minimiser::new(context, problem, safe)?) as Box<dyn Method>)
    };
    Ok(Box::new(Bounded::new("TAO", engine, sum, bounded, tolerance, make)?))
}
