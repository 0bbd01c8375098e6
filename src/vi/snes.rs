//! PETSc's Newton methods for the complementarity problem of a step: `--vi snes`.
//!
//! `-snes_type` is `vinewtonrsls` (reduced space, the default) or `vinewtonssls` (semismooth).
//! Their tolerances are relative to the scaled right-hand side. A user's option overrides the
//! default of the same name below.

use super::scaled::{Family, Method, RESIDUAL, Scaled};
use crate::error::{Error, Result};
use crate::petsc::{Context, Snes};
use std::rc::Rc;

/// PETSc's Newton methods for complementarity problems; see the [module page](self).
pub const SNES: Family = Family {
    name: "SNES",
    defaults: &[
        ("snes_type", REDUCED),
        ("snes_linesearch_type", "l2"),
        ("snes_atol", RESIDUAL),
        ("snes_rtol", "0"),
        ("snes_stol", "0"),
        ("snes_max_it", "50"),
        ("snes_vi_zero_tolerance", "1e-12"),
    ],
    // The backtracking line search prevents cycles of active sets.
    safe_defaults: &[("snes_linesearch_type", "bt")],
    types: &[REDUCED, SEMISMOOTH],
    advised: "vinewtonrsls or vinewtonssls",
    refusal: |_| "not a PETSc method for bounds",
    check: check_line_search,
    make: newton,
};

/// Methods for problems with bounds.
const REDUCED: &str = "vinewtonrsls";
const SEMISMOOTH: &str = "vinewtonssls";

/// Line searches that can solve a step.
const LINE_SEARCHES: [&str; 4] = ["l2", "basic", "bt", "cp"];

fn check_line_search(context: &Context, prefix: &str) -> Result<()> {
    let option = format!("{prefix}snes_linesearch_type");
    let search = context.option(&option)?;
    let Some(search) = search.filter(|search| !LINE_SEARCHES.contains(&search.as_str())) else {
        return Ok(());
    };
    let why = match search.as_str() {
        "nleqerr" => {
            "it multiplies with the whole Jacobian, and the methods for bounds keep only a part of it"
        }
        "ncglinear" => "it is for nonlinear conjugate gradients",
        "shell" => "it needs a function that the program does not have",
        _ => "no line search of PETSc has this name",
    };
    Err(Error::Usage(format!("-{option} {search}: {why}; take {}", LINE_SEARCHES.join(", "))))
}

fn newton(context: &Rc<Context>, problem: &Rc<Scaled>, kind: &str, prefix: &str) -> Result<Method> {
    let mut solver = Snes::new(context, prefix)?;
    solver.default_to_cholesky()?;
    let (like, shared) = (problem.right.borrow().duplicate()?, problem.clone());
    solver.set_residual(&like, move |y, f| shared.gradient(y, f))?;
    // The semismooth method scales its matrix in place.
    let (matrix, update) = problem.derivative(kind == SEMISMOOTH)?;
    solver.set_jacobian(&matrix, update)?;
    solver.force_iteration(true)?;
    solver.set_from_options()?;
    Ok(Box::new(move |problem, y| solver.solve_between(&problem.lower.borrow(), &problem.upper.borrow(), y)))
}
