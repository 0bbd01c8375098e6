//! PETSc's Newton methods for the complementarity problem of a step: `--vi snes`.
//!
//! `-snes_type` is `vinewtonrsls` (reduced space, the default) or `vinewtonssls` (semismooth).
//! Their tolerances are relative to the scaled right-hand side. A user's option overrides the
//! default of the same name below.

use super::scaled::{Family, Method, RESIDUAL, SAFE, Scaled, set_defaults};
use crate::error::{Error, Result};
use crate::petsc::{Comm, Context, Reason, Snes, Vector};
use std::rc::Rc;

/// PETSc's Newton methods for complementarity problems; see the [module page](self).
pub const SNES: Family = Family { name: "SNES", check: check_options, make: newton };

/// Default options, with which the methods converge on plates, and their values.
pub const DEFAULTS: &[(&str, &str)] = &[
    ("snes_type", REDUCED),
    ("snes_linesearch_type", "l2"),
    ("snes_atol", RESIDUAL),
    ("snes_rtol", "0"),
    ("snes_stol", "0"),
    ("snes_max_it", "50"),
    ("snes_vi_zero_tolerance", "1e-12"),
];

/// Default options of the retry, which starts from zero, where they differ from [`DEFAULTS`]. The
/// backtracking line search prevents cycles of active sets.
const SAFE_DEFAULTS: &[(&str, &str)] = &[("snes_linesearch_type", "bt")];

/// Methods for problems with bounds.
const REDUCED: &str = "vinewtonrsls";
const SEMISMOOTH: &str = "vinewtonssls";

/// Line searches that can solve a step.
const LINE_SEARCHES: [&str; 4] = ["l2", "basic", "bt", "cp"];

fn check_options(context: &Context) -> Result<()> {
    for prefix in ["", SAFE] {
        kind(context, prefix)?;
        let option = format!("{prefix}snes_linesearch_type");
        let search = context.option(&option)?;
        if let Some(search) = search.filter(|search| !LINE_SEARCHES.contains(&search.as_str())) {
            let why = match search.as_str() {
                "nleqerr" => {
                    "it multiplies with the whole Jacobian, and the methods for bounds keep only a part of it"
                }
                "ncglinear" => "it is for nonlinear conjugate gradients",
                "shell" => "it needs a function that the program does not have",
                _ => "no line search of PETSc has this name",
            };
            return Err(Error::Usage(format!(
                "-{option} {search}: {why}; take {}",
                LINE_SEARCHES.join(", ")
            )));
        }
    }
    Ok(())
}

/// Returns the method that the option with a prefix names.
fn kind(context: &Context, prefix: &str) -> Result<String> {
    let option = format!("{prefix}snes_type");
    let kind = context.option(&option)?.unwrap_or(REDUCED.into());
    if kind != REDUCED && kind != SEMISMOOTH {
        return Err(Error::Usage(format!(
            "-{option} {kind}: not a PETSc method for bounds; take {REDUCED} or {SEMISMOOTH}"
        )));
    }
    Ok(kind)
}

fn newton(context: &Rc<Context>, problem: &Rc<Scaled>, prefix: &str) -> Result<Box<dyn Method>> {
    if prefix == SAFE {
        set_defaults(context, prefix, SAFE_DEFAULTS)?;
    }
    set_defaults(context, prefix, DEFAULTS)?;
    let kind = kind(context, prefix)?;
    let mut solver = Snes::new(context, Comm::World, prefix)?;
    solver.default_to_cholesky()?;
    let like = problem.right.borrow().duplicate()?;
    let shared = problem.clone();
    solver.set_residual(&like, move |y, f| shared.gradient(y, f))?;
    if kind == SEMISMOOTH || problem.yields() {
        // The semismooth method scales its matrix in place and gets a copy.
        let shared = problem.clone();
        solver.set_jacobian(&problem.matrix.duplicate()?, move |y, own| shared.jacobian(y, own))?;
    } else {
        solver.set_jacobian(&problem.matrix, |_, _| Ok(()))?;
    }
    solver.force_iteration(true)?;
    solver.set_from_options()?;
    context.accept_options(&format!("{prefix}snes_"))?;
    Ok(Box::new(solver))
}

impl Method for Snes<'static> {
    fn solve(&mut self, problem: &Scaled, y: &mut Vector) -> Result<(Reason, usize)> {
        self.set_bounds(&problem.lower.borrow(), &problem.upper.borrow())?;
        Snes::solve(self, y)?;
        Ok((self.reason()?, self.iterations()?))
    }
}
