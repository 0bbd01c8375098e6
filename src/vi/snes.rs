//! PETSc's Newton methods for complementarity problems on a step: `--vi snes`.
//!
//! `-snes_type vinewtonrsls` (reduced space, the default) or `vinewtonssls` (semismooth). Their tolerances are relative to the
//! scaled right-hand side; every default below yields to the user's option of that name.

use super::Solver;
use super::scaled::{Bounded, Method, RESIDUAL, Scaled};
use crate::error::{Error, Result};
use crate::linalg::Sum;
use crate::petsc::{self, Comm, Context, Distributed, Reason, Vector};
use std::rc::Rc;

/// Options that make the methods converge on plates, and their values.
pub const DEFAULTS: &[(&str, &str)] = &[
    ("snes_type", "vinewtonrsls"),
    ("snes_linesearch_type", "l2"),
    ("snes_atol", RESIDUAL),
    ("snes_rtol", "0"),
    ("snes_stol", "0"),
    ("snes_max_it", "100"),
    ("snes_vi_zero_tolerance", "1e-12"),
];

/// The method of the retries: another line search, from nothing.
const SAFE: &[(&str, &str)] = &[("snes_linesearch_type", "basic"), ("snes_max_it", "50")];

/// The methods between bounds.
const TYPES: [&str; 2] = ["vinewtonrsls", "vinewtonssls"];

struct Newton(petsc::Snes<'static>);

impl Newton {
    fn new(context: &Rc<Context>, problem: &Rc<Scaled>, safe: bool) -> Result<Newton> {
        let prefix = if safe { "safe_" } else { "" };
        for (name, value) in if safe { SAFE } else { &[] }.iter().chain(DEFAULTS) {
            context.default_option(&format!("{prefix}{name}"), value)?;
        }
        let option = format!("{prefix}snes_type");
        let kind = context.option(&option)?.unwrap_or_default();
        if !TYPES.contains(&kind.as_str()) {
            return Err(Error::Usage(format!(
                "-{option} {kind}: no PETSc method between bounds; it has {}",
                TYPES.join(" and ")
            )));
        }
        let mut solver = petsc::Snes::new(context, Comm::World, prefix)?;
        solver.default_to_cholesky()?;
        let like = problem.right.borrow().duplicate()?;
        let (matrix, shared) = (problem.matrix.clone(), Rc::downgrade(problem));
        solver.set_residual(&like, move |y, f| {
            matrix.multiply(y, f)?;
            // The problem lives as long as its solver.
            shared.upgrade().map_or(Ok(()), |problem| f.add_scaled(-1.0, &problem.right.borrow()))
        })?;
        // The semismooth method scales its matrix in place.
        let (matrix, overwrites) = (problem.matrix.clone(), kind == "vinewtonssls");
        let own = if overwrites { Some(matrix.duplicate()?) } else { None };
        solver.set_jacobian(own.as_ref().unwrap_or(&problem.matrix), move |_, jacobian| {
            if overwrites { jacobian.copy_from(&matrix) } else { Ok(()) }
        })?;
        solver.force_iteration(true)?;
        solver.set_from_options()?;
        context.accept_options(&format!("{prefix}snes_"))?;
        Ok(Newton(solver))
    }
}

impl Method for Newton {
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
        Ok(Box::new(Newton::new(context, problem, safe)?) as Box<dyn Method>)
    };
    Ok(Box::new(Bounded::new("SNES", engine, sum, bounded, tolerance, make)?))
}
