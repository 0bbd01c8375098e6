//! Iterative and nonlinear solvers, and their errors.

use super::close;
use super::matrices::string;
use crate::common::ranks::{Case, case};
use rebond::petsc::{Context, INFINITY, Matrix, Snes, Tao, Vector};
use rebond::{Error, Result};
use std::cell::RefCell;
use std::rc::Rc;

pub const CASES: &[Case] = &[
    case("snes_solves_the_obstacle_problem", &[1, 2, 4], snes_solves_the_obstacle_problem),
    case("tao_solves_the_obstacle_problem", &[1, 2, 4], tao_solves_the_obstacle_problem),
    case("refused_calls_say_why", &[1, 2], refused_calls_say_why),
    case("callbacks_fail_cleanly", &[1], callbacks_fail_cleanly),
    case("errors_of_all_ranks_come_back", &[2], errors_of_all_ranks_come_back),
];

/// String over an obstacle: -u'' = -8 on (0, 1), u(0) = u(1) = 0, u >= -1/4.
///
/// The solution leaves the obstacle without a kink at 1/4 from either end: u = 4 (x - 1/4)^2 - 1/4
/// on (0, 1/4), which finite differences reproduce exactly.
struct Obstacle {
    matrix: Matrix,
    load: Vector,
    lower: Vector,
    upper: Vector,
    exact: Vec<f64>,
}

const STRING: usize = 127;

fn obstacle(context: &Rc<Context>) -> Result<Obstacle> {
    let h = 1.0 / (STRING + 1) as f64;
    let (local, rows, columns, values) = string(context, STRING, 0.0);
    let values: Vec<f64> = values.iter().map(|v| v / h).collect();
    let mut matrix = Matrix::from_triplets(context, local, &rows, &columns, &values)?;
    matrix.set_positive_definite()?;
    let (mut load, mut lower, mut upper) = (matrix.vector()?, matrix.vector()?, matrix.vector()?);
    load.fill(-8.0 * h)?;
    lower.fill(-0.25)?;
    upper.fill(INFINITY)?;
    let exact = matrix
        .range()
        .map(|i| {
            let x = f64::from(i + 1) * h;
            let to_end = x.min(1.0 - x);
            if to_end < 0.25 { 4.0 * (to_end - 0.25) * (to_end - 0.25) - 0.25 } else { -0.25 }
        })
        .collect();
    Ok(Obstacle { matrix, load, lower, upper, exact })
}

fn compare(x: &Vector, exact: &[f64]) -> Result<()> {
    for (x, exact) in x.to_vec()?.iter().zip(exact) {
        close(*x, *exact, 1e-9);
    }
    Ok(())
}

fn snes_solves_the_obstacle_problem(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let Obstacle { matrix, load, lower, upper, exact } = obstacle(&context)?;
    let mut x = matrix.vector()?;
    let count = RefCell::new(0);
    context.default_option("snes_linesearch_type", "l2")?;
    context.default_option("snes_vi_zero_tolerance", "1e-12")?;
    let tolerances = [("snes_atol", "1e-12"), ("snes_rtol", "0"), ("snes_stol", "0")];
    tolerances.iter().try_for_each(|(name, value)| context.default_option(name, value))?;
    // Too few iterations are not an error of the call, but appear in the convergence reason.
    for (most, expected) in [("100", "CONVERGED_FNORM_ABS"), ("1", "DIVERGED_MAX_IT")] {
        let mut solver = Snes::new(&context, "")?;
        solver.set_type("vinewtonrsls")?;
        solver.default_to_cholesky()?;
        solver.set_residual(&load, |x, f| {
            *count.borrow_mut() += 1;
            matrix.multiply(x, f)?;
            f.add_scaled(-1.0, &load)
        })?;
        solver.set_jacobian(&matrix, |_, _| Ok(()))?;
        solver.set_bounds(&lower, &upper)?;
        context.with_option(Some(("snes_max_it", most)), || solver.set_from_options())?;
        x.fill(0.0)?;
        solver.solve(&mut x)?;
        let reason = solver.reason()?;
        assert_eq!((reason.converged(), reason.text.as_str()), (most != "1", expected));
        assert!(solver.iterations()? > 0 && *count.borrow() > 0);
        if reason.converged() {
            compare(&x, &exact)?;
            // From the solution the method makes no iteration, unless forced.
            solver.solve(&mut x)?;
            assert_eq!(solver.iterations()?, 0);
            context.refuse_unused_options()?;
        }
    }
    Ok(())
}

fn tao_solves_the_obstacle_problem(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    for kind in ["tron", "bnls", "gpcg"] {
        let Obstacle { matrix, load, lower, upper, exact } = obstacle(&context)?;
        let mut x = matrix.vector()?;
        let mut solver = Tao::new(&context, &format!("{kind}_"))?;
        solver.set_type(kind)?;
        solver.default_to_cholesky()?;
        solver.set_objective(&load, |x, g| {
            matrix.multiply(x, g)?;
            let energy = 0.5 * x.dot(g)? - x.dot(&load)?;
            g.add_scaled(-1.0, &load)?;
            Ok(energy)
        })?;
        solver.set_hessian(&matrix, |_, _| Ok(()))?;
        solver.set_bounds(&lower, &upper)?;
        for (name, value) in [("gatol", "1e-12"), ("grtol", "0"), ("gttol", "0"), ("max_it", "500")] {
            context.default_option(&format!("{kind}_tao_{name}"), value)?;
        }
        solver.set_from_options()?;
        solver.solve(&mut x)?;
        let reason = solver.reason()?;
        assert!(reason.converged(), "{kind}: {reason:?} after {}", solver.iterations()?);
        compare(&x, &exact)?;
    }
    context.refuse_unused_options()
}

fn refused_calls_say_why(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let mut solver = Snes::new(&context, "")?;
    let error = solver.set_type("nosuch").unwrap_err();
    assert_eq!(error.exit_code(), 3);
    let text = error.to_string();
    assert!(text.starts_with("PETSc: SNESSetType(): "), "{text}");
    assert!(text.contains("nosuch") && text.contains("(code 86, snes.c:"), "{text}");
    assert_eq!(text.lines().count(), 1);

    let short = Vector::new(&context, 2)?;
    let mut long = Vector::new(&context, 3)?;
    let text = long.add_scaled(1.0, &short).unwrap_err().to_string();
    assert!(text.contains("Vec"), "{text}");
    // A failed call does not affect later ones.
    long.fill(1.0)
}

fn callbacks_fail_cleanly(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let Obstacle { matrix, load, .. } = obstacle(&context)?;
    std::panic::set_hook(Box::new(|_| {}));
    for panics in [true, false] {
        let mut solver = Snes::new(&context, "")?;
        solver.set_residual(&load, |_, _| {
            assert!(!panics, "deep inside");
            Err(Error::Usage("my own words".into()))
        })?;
        solver.set_jacobian(&matrix, |_, _| Ok(()))?;
        let error = solver.solve(&mut matrix.vector()?).unwrap_err();
        match error {
            Error::Petsc(text) if panics => assert!(text.contains("deep inside"), "{text}"),
            Error::Usage(text) if !panics => assert_eq!(text, "my own words"),
            other => unreachable!("{other:?}"),
        }
        let mut solver = Tao::new(&context, "")?;
        solver.set_type("tron")?;
        solver.set_objective(&load, |_, _| {
            assert!(!panics, "deep inside");
            Err(Error::Usage("my own words".into()))
        })?;
        solver.set_hessian(&matrix, |_, _| Ok(()))?;
        let error = solver.solve(&mut matrix.vector()?).unwrap_err();
        assert!(error.to_string().contains(if panics { "deep inside" } else { "my own words" }), "{error}");
    }
    let _ = std::panic::take_hook();
    Ok(())
}

fn errors_of_all_ranks_come_back(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let Obstacle { matrix, load, .. } = obstacle(&context)?;
    let mut solver = Snes::new(&context, "")?;
    solver.set_residual(&load, |_, _| Err(Error::Usage("my own words".into())))?;
    solver.set_jacobian(&matrix, |_, _| Ok(()))?;
    let error = solver.solve(&mut matrix.vector()?).unwrap_err();
    assert!(matches!(error, Error::Usage(_)));
    Ok(())
}
