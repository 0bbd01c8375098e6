//! PETSc's bound-constrained minimisers for a step: `--vi tao`.
//!
//! They minimise `$\frac12 y^T A y - b^T y$` in the scaled unknowns, with the energy of bounds that
//! yield. `-tao_type` is `tron` (trust
//! region, the default), `bnls`, `gpcg` or another one; methods that answer wrongly or minimise
//! something else are refused by name. A user's option overrides the default of the same name
//! below.

use super::scaled::{Family, Method, RESIDUAL, Scaled, set_defaults};
use crate::error::Result;
use crate::petsc::{Context, Tao};
use std::rc::Rc;

/// PETSc's bound-constrained minimisers; see the [module page](self).
pub const TAO: Family = Family {
    name: "TAO",
    defaults: &[
        ("tao_type", TRUST_REGION),
        ("tao_gatol", RESIDUAL),
        ("tao_grtol", "0"),
        ("tao_gttol", "0"),
        ("tao_tron_maxgpits", "50"),
        ("tao_max_it", "50"),
    ],
    safe_defaults: &[("tao_type", "bnls")],
    types: &[TRUST_REGION, "bnls", "gpcg", "bntr", "bntl", "blmvm", "bncg", "bqnls"],
    advised: "tron, bnls or gpcg",
    refusal,
    check: |_, _| Ok(()),
    make: minimiser,
};

/// Default method, a trust-region Newton method.
const TRUST_REGION: &str = "tron";

/// Returns the reason why a method cannot solve a step.
fn refusal(kind: &str) -> &'static str {
    match kind {
        "bqpip" => "it reports convergence but answers wrongly where a bound is one-sided",
        "ssils" | "asils" | "ssfls" | "asfls" => {
            "it solves for constraints that a step does not have, and crashes without them"
        }
        "almm" | "admm" | "lcl" | "ipm" | "pdipm" => {
            "it is for general constraints, and a step has bounds only"
        }
        "nls" | "ntr" | "ntl" | "lmvm" | "cg" | "nm" | "owlqn" | "bmrm" => "it does not support bounds",
        "bqnktr" | "bqnktl" | "bqnkls" => {
            "its quasi-Newton matrix has no factor, and without one it does not converge"
        }
        "pounders" | "brgn" => "it is for least squares",
        _ => "no PETSc method for bounds has this name",
    }
}

fn minimiser(context: &Rc<Context>, problem: &Rc<Scaled>, kind: &str, prefix: &str) -> Result<Method> {
    let mut solver = Tao::new(context, prefix)?;
    solver.set_type(kind)?;
    if ["bntr", "bntl"].contains(&kind) {
        // Both methods need a linear solver that respects a trust region.
        set_defaults(context, prefix, &[("tao_bnk_ksp_type", "stcg")])?;
    }
    solver.default_to_cholesky()?;
    let (like, shared) = (problem.right.borrow().duplicate()?, problem.clone());
    solver.set_objective(&like, move |y, gradient| shared.objective(y, gradient))?;
    let (matrix, update) = problem.derivative(false)?;
    solver.set_hessian(&matrix, update)?;
    solver.set_from_options()?;
    Ok(Box::new(move |problem, y| solver.solve_between(&problem.lower.borrow(), &problem.upper.borrow(), y)))
}
