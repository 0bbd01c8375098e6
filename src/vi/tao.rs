//! PETSc's bound-constrained minimisers for a step: `--vi tao`.
//!
//! They minimise `$\frac12 y^T A y - b^T y$` in the scaled unknowns, with the energy of bounds that
//! yield. `-tao_type` is `tron` (trust
//! region, the default), `bnls`, `gpcg` or another one; methods that answer wrongly or minimise
//! something else are refused by name. A user's option overrides the default of the same name
//! below.

use super::scaled::{Family, Method, RESIDUAL, SAFE, Scaled, set_defaults};
use crate::error::{Error, Result};
use crate::petsc::{Comm, Context, Reason, Tao, Vector};
use std::rc::Rc;

/// PETSc's bound-constrained minimisers; see the [module page](self).
pub const TAO: Family = Family { name: "TAO", check: check_options, make: minimiser };

/// Default options, with which the methods converge on plates, and their values.
pub const DEFAULTS: &[(&str, &str)] = &[
    ("tao_type", TRUST_REGION),
    ("tao_gatol", RESIDUAL),
    ("tao_grtol", "0"),
    ("tao_gttol", "0"),
    ("tao_tron_maxgpits", "50"),
    ("tao_max_it", "50"),
];

/// Default options of the retry, which starts from zero, where they differ from [`DEFAULTS`].
const SAFE_DEFAULTS: &[(&str, &str)] = &[("tao_type", "bnls")];

/// Default method, a trust-region Newton method.
const TRUST_REGION: &str = "tron";

/// Bound-constrained methods whose answers are right whenever they report convergence.
const TYPES: &[&str] = &[TRUST_REGION, "bnls", "gpcg", "bntr", "bntl", "blmvm", "bncg", "bqnls"];

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

fn check_options(context: &Context) -> Result<()> {
    ["", SAFE].into_iter().try_for_each(|prefix| kind(context, prefix).map(drop))
}

/// Returns the method that the option with a prefix names.
fn kind(context: &Context, prefix: &str) -> Result<String> {
    let option = format!("{prefix}tao_type");
    let kind = context.option(&option)?.unwrap_or(TRUST_REGION.into());
    if !TYPES.contains(&kind.as_str()) {
        let why = refusal(&kind);
        return Err(Error::Usage(format!("-{option} {kind}: {why}; take tron, bnls or gpcg")));
    }
    Ok(kind)
}

fn minimiser(context: &Rc<Context>, problem: &Rc<Scaled>, prefix: &str) -> Result<Box<dyn Method>> {
    if prefix == SAFE {
        set_defaults(context, prefix, SAFE_DEFAULTS)?;
    }
    set_defaults(context, prefix, DEFAULTS)?;
    let kind = kind(context, prefix)?;
    let mut solver = Tao::new(context, Comm::World, prefix)?;
    solver.set_type(&kind)?;
    if ["bntr", "bntl"].contains(&kind.as_str()) {
        // Both methods need a linear solver that respects a trust region.
        set_defaults(context, prefix, &[("tao_bnk_ksp_type", "stcg")])?;
    }
    solver.default_to_cholesky()?;
    let like = problem.right.borrow().duplicate()?;
    let shared = problem.clone();
    solver.set_objective(&like, move |y, gradient| shared.objective(y, gradient))?;
    if problem.yields() {
        let shared = problem.clone();
        solver.set_hessian(&problem.matrix.duplicate()?, move |y, own| shared.jacobian(y, own))?;
    } else {
        solver.set_hessian(&problem.matrix, |_, _| Ok(()))?;
    }
    solver.set_from_options()?;
    context.accept_options(&format!("{prefix}tao_"))?;
    Ok(Box::new(solver))
}

impl Method for Tao<'static> {
    fn solve(&mut self, problem: &Scaled, y: &mut Vector) -> Result<(Reason, usize)> {
        self.set_bounds(&problem.lower.borrow(), &problem.upper.borrow())?;
        Tao::solve(self, y)?;
        Ok((self.reason()?, self.iterations()?))
    }
}
