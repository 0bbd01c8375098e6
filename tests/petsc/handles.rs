//! The handles on PETSc, on 1, 2 and 4 ranks.

use crate::common::models::PAPER_FALL;
use crate::common::ranks::{Case, Failure, Success, case};
use rebond::communicator::Communicator;
use rebond::linalg::Engine;
use rebond::modes;
use rebond::obstacle::Bounds;
use rebond::petsc::{
    Comm, Context, Dofs, INFINITY, Index, IndexSet, Ksp, Matrix, Plex, Section, Snes, Tao, Vector,
};
use rebond::scene::Scene;
use rebond::scheme::{Damping, ModalDamping, System};
use rebond::simulation::Model;
use rebond::{Error, Result};
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::process::Command;
use std::rc::Rc;
use std::time::Duration;

pub const CASES: &[Case] = &[
    case("start_and_stop", &[1, 2, 4], start_and_stop),
    case("blas_has_one_thread", &[1], blas_has_one_thread),
    case("sums_and_gathers", &[1, 2, 4], sums_and_gathers),
    case("vectors", &[1, 2, 4], vectors),
    case("matrices", &[1, 2, 4], matrices),
    case("cholesky", &[1, 2, 4], cholesky),
    case("cholesky_refuses_an_indefinite_matrix", &[1, 2], cholesky_refuses_an_indefinite_matrix),
    case("snes_solves_the_obstacle_problem", &[1, 2, 4], snes_solves_the_obstacle_problem),
    case("every_column_is_judged", &[1, 2], every_column_is_judged),
    case("tao_solves_the_obstacle_problem", &[1, 2, 4], tao_solves_the_obstacle_problem),
    case("refused_calls_say_why", &[1, 2], refused_calls_say_why),
    case("callbacks_fail_cleanly", &[1], callbacks_fail_cleanly),
    case("errors_of_all_ranks_come_back", &[2], errors_of_all_ranks_come_back),
    case("meshes_of_triangles", &[1, 2, 3, 4], |_| meshes(3)),
    case("meshes_of_quadrilaterals", &[1, 2, 3, 4], |_| meshes(4)),
    case("more_ranks_than_cells", &[4], |_| mesh(4, [1, 1], 0)),
    case("dofs", &[1, 2, 4], dofs),
    case("what_changes_with_time", &[1, 2], what_changes_with_time),
    Case {
        name: "unused_options",
        ranks: &[1, 2],
        arguments: &["-ksp_typ", "cg", "-ksp_rtol", "1e-12", "-options_left", "no"],
        body: unused_options,
        expect: Success,
        seconds: 60,
    },
    Case {
        name: "words_that_are_no_options",
        ranks: &[1],
        arguments: &["-ksp_rtol", "-1e-3", "stray"],
        body: words_that_are_no_options,
        expect: Success,
        seconds: 60,
    },
    Case {
        name: "panic_of_one_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: panic_of_one_rank,
        expect: Failure(101, "only rank 1 fails"),
        seconds: 60,
    },
    Case {
        name: "killed_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: killed_rank,
        expect: Failure(137, "exited on signal 9"),
        seconds: 60,
    },
    Case {
        name: "error_of_one_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: error_of_one_rank,
        expect: Failure(3, "rebond: PETSc: only rank 1 fails (rank 1 of "),
        seconds: 60,
    },
    Case {
        name: "error_of_all_ranks",
        ranks: &[1, 2, 4],
        arguments: &[],
        body: error_of_all_ranks,
        expect: Failure(2, "rebond: the same on all"),
        seconds: 60,
    },
];

fn close(left: f64, right: f64, tolerance: f64) {
    assert!((left - right).abs() <= tolerance * right.abs().max(1.0), "{left} is not {right}");
}

/// Returns this rank's share of `0..n`, whose size differs among ranks.
fn share(context: &Context, n: usize) -> std::ops::Range<usize> {
    let cut = |rank: usize| (n * rank * (rank + 1)) / (context.size() * (context.size() + 1));
    cut(context.rank())..cut(context.rank() + 1)
}

fn start_and_stop(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    assert!(context.rank() < context.size());
    let [major, minor, _] = context.version();
    assert!((major, minor) >= (3, 18));
    let second = Context::start(arguments);
    assert!(matches!(second, Err(Error::Petsc(text)) if text.contains("once")));
    // A handle keeps PETSc running.
    let vector = Vector::new(&context, Comm::World, 3)?;
    drop(context);
    assert_eq!(vector.size(), 3 * vector.context().size());
    Ok(())
}

/// Time-dependent loads, oscillating obstacles and damping agree with the native engine step by
/// step, through an impact.
fn what_changes_with_time(arguments: &[String]) -> Result<()> {
    fn shake<E: Engine>(mut model: Model<E>, modal: bool) -> Result<Model<E>> {
        let System { engine, stiffness, mass, .. } = &model.system;
        if modal {
            let modes = modes::shapes(engine, stiffness, mass, 2, false)?;
            model.system.drive.modal = Some(ModalDamping::new(engine, mass, &modes, &[0.05, 0.02])?);
        }
        let shape = model.system.load.clone().unwrap_or_default();
        model.system.damping = Damping { mass: 2.0, stiffness: 0.0 };
        model.system.drive.load = Some(Box::new(move |time: f64, load: &mut [f64]| {
            let factor = 3.0 * (75.0 * time).sin();
            load.iter_mut().zip(&shape).for_each(|(load, one)| *load += factor * one);
            Ok(())
        }));
        model.system.drive.bounds = Some(Box::new(|time: f64, bounds: &mut Bounds| {
            bounds.lower.fill(-0.1 + 0.02 * (60.0 * time).sin());
            Ok(())
        }));
        Ok(model)
    }
    let context = Context::start(arguments)?;
    for name in ["newmark", "midpoint", "conserving"] {
        let scene = |engine: &str| {
            let text = format!(
                r#"
                {PAPER_FALL}
                mesh = {{ element = "fvs", cells = [10, 4] }}
                load = {{ pressure = 1000 }}
                time = {{ scheme = "{name}", mass = "singular", step = 5e-4, end = 0.08 }}
                output = {{ probes = [{{ name = "corner", at = [1.2, 0] }}] }}
                solver = {{ engine = "{engine}" }}
                "#
            );
            Scene::from_str(&text, "shaken", &[])
        };
        let (native, petsc) = (scene("native")?, scene("petsc")?);
        let modal = name != "conserving";
        let alone = shake(Model::new(&native)?, modal)?;
        let parted = shake(Model::distributed(&petsc, &context)?, modal)?;
        let mut expected = alone.scheme(&native)?;
        let mut scheme = parted.scheme(&petsc)?;
        let start = scheme.energies()?.total();
        let mut contacts = 0;
        for _ in 0..native.time.steps() {
            expected.advance()?;
            scheme.advance()?;
            let corner = parted.probes[0].deflection(scheme.displacement());
            let other = alone.probes[0].deflection(expected.displacement());
            assert!(
                (context.comm().all_reduce_sum(corner) - other).abs() <= 1e-9,
                "{name}, step {}",
                scheme.step()
            );
            let (now, other) = (scheme.energies()?, expected.energies()?);
            if let Some(relaxation) = scheme.relaxation() {
                // The state of this scheme is one at or after the instant; which one depends on
                // rounding.
                close(now.total() + relaxation.dissipated, start, 1e-11);
            } else {
                close(now.kinetic, other.kinetic, 1e-8);
                close(now.elastic, other.elastic, 1e-8);
                close(now.work, other.work, 1e-8);
            }
            contacts += u32::from(expected.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(contacts > 0);
    }
    Ok(())
}

fn blas_has_one_thread(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    // The number is unknown where BLAS is not OpenBLAS.
    assert!(context.blas_threads().is_none_or(|threads| threads == 1));
    Ok(())
}

fn sums_and_gathers(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let (rank, size) = (context.rank(), context.size());
    assert_eq!(context.comm().all_reduce_sum(rank as f64 + 1.0), (size * (size + 1) / 2) as f64);
    assert_eq!(context.comm().all_reduce_max(-(rank as f64)), 0.0);
    let mut pair = [1.0, rank as f64];
    assert_eq!(context.comm().all_reduce_sum_slice(&pair), context.comm().all_reduce_sum(pair));
    context.comm().all_reduce_sum_slice_unordered(&mut pair);
    assert_eq!(pair, [size as f64, (size * (size - 1) / 2) as f64]);
    let comm = context.comm();
    let mut first = [(rank as f64, rank > 0), (-1.0, true)];
    comm.broadcast(&mut first);
    assert_eq!(first, [(0.0, false), (-1.0, true)]);
    let (all, offset) = comm.all_gather_with_offset(&vec![[rank as u64; 2]; rank]);
    let expected: Vec<_> = (0..size).flat_map(|r| vec![[r as u64; 2]; r]).collect();
    assert_eq!((all, offset), (expected, rank * rank.saturating_sub(1) / 2));
    let ranks: Vec<_> = (0..size).map(|r| (r, r % 2 == 0)).collect();
    assert_eq!(comm.all_gather_one((rank, rank % 2 == 0)), ranks);
    let parts: Vec<_> = (0..size).map(|r| vec![r as u8; r]).collect();
    assert_eq!(comm.gather(&vec![rank as u8; rank]), if rank == 0 { parts } else { Vec::new() });
    assert!(comm.all_reduce_max(if rank == 0 { f64::NAN } else { 1.0 }).is_infinite());
    // Rounding tells the order: rank by rank, the small terms are lost one after the other.
    let term = if rank == 0 { 1.0 } else { f64::EPSILON / 2.0 };
    assert_eq!(comm.all_reduce_sum(term), 1.0);
    assert!(comm.all_reduce_all(true) && !comm.all_reduce_all(rank != size - 1));
    assert!(comm.all_reduce_any(rank == size - 1) && !comm.all_reduce_any(false));
    match comm.all_ok(if rank == size - 1 { Err(Error::Usage("the last".into())) } else { Ok(rank) }) {
        Err(error) => assert_eq!((error.to_string().as_str(), error.exit_code()), ("the last", 2)),
        Ok(rank) => panic!("rank {rank} goes on"),
    }
    context.comm().barrier();
    Ok(())
}

fn vectors(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let range = share(&context, 100);
    let values: Vec<f64> = range.clone().map(|i| i as f64).collect();
    let x = Vector::from_slice(&context, Comm::World, &values)?;
    assert_eq!((x.size(), x.local_size()), (100, values.len()));
    assert_eq!(x.range(), range.start as Index..range.end as Index);
    let mut y = x.duplicate()?;
    assert_eq!(y.norm()?, 0.0);
    y.fill(2.0)?;
    assert_eq!(x.dot(&y)?, 9900.0);
    close(x.norm()?, (328_350f64).sqrt(), 1e-15);
    assert_eq!(x.all_reduce_max()?, 99.0);
    y.add_scaled(-1.0, &x)?;
    assert_eq!(y.norm_infinity()?, 97.0);
    y.scale(3.0)?;
    assert_eq!(y.to_vec()?, values.iter().map(|x| 6.0 - 3.0 * x).collect::<Vec<_>>());
    y.copy_from(&x)?;
    let mut copy = vec![0.0; values.len()];
    y.copy_to(&mut copy)?;
    assert_eq!(copy, values);
    let own = Vector::from_slice(&context, Comm::Own, &[3.0, 4.0])?;
    assert_eq!((own.size(), own.norm()?), (2, 5.0));
    Ok(())
}

/// Returns triplets of this rank's share of the matrix (-1, 2 + shift, -1) of order n, cell by cell
/// as in an assembly. They contain rows of other ranks and repeated positions.
fn string(context: &Context, n: usize, shift: f64) -> (usize, Vec<Index>, Vec<Index>, Vec<f64>) {
    let range = share(context, n);
    let (mut rows, mut columns, mut values) = (vec![], vec![], vec![]);
    let mut add = |i: usize, j: usize, value: f64| {
        let index = |i: usize| if i < n { i as Index } else { -1 };
        rows.push(index(i));
        columns.push(index(j));
        values.push(value);
    };
    for i in range.clone() {
        // The cell lies between i and i + 1; the last cell ends at a support.
        for (a, b, value) in [(i, i, 1.0), (i, i + 1, -1.0), (i + 1, i, -1.0), (i + 1, i + 1, 1.0)] {
            add(a, b, value);
        }
        add(i, i, shift);
    }
    if range.contains(&0) {
        add(0, 0, 1.0);
    }
    (range.len(), rows, columns, values)
}

fn matrices(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let n = 40;
    let (local, rows, columns, values) = string(&context, n, 0.5);
    let mut a = Matrix::from_triplets(&context, Comm::World, local, &rows, &columns, &values)?;
    assert_eq!(a.size(), [n, n]);
    assert_eq!(a.local_size(), [local, local]);
    assert_eq!(a.norm_infinity()?, 4.5);
    let range = a.range();
    for row in range.clone() {
        let (columns, values) = a.row(row)?;
        let dense: BTreeMap<_, _> = columns.into_iter().zip(values).collect();
        assert_eq!(dense[&row], 2.5);
        assert!(row == 0 || dense[&(row - 1)] == -1.0);
        assert_eq!(dense.len(), if row == 0 || row == n as Index - 1 { 2 } else { 3 });
    }

    let mut x = a.vector()?;
    x.set_local(&range.clone().map(|i| f64::from(i * i)).collect::<Vec<_>>())?;
    let mut y = a.vector()?;
    a.multiply(&x, &mut y)?;
    let end = n as Index - 1;
    for (row, y) in range.clone().zip(y.to_vec()?) {
        let next = if row == end { f64::from((row + 1) * (row + 1)) } else { 0.0 };
        close(y, -2.0 + 0.5 * f64::from(row * row) + next + if row == 0 { 1.0 } else { 0.0 }, 1e-14);
    }

    let copy = a.duplicate()?;
    a.scale(2.0)?;
    a.add_scaled(-1.0, &copy)?;
    a.diagonal(&mut y)?;
    assert!(y.to_vec()?.iter().all(|&d| d == 2.5));
    a.set_values(&values.iter().map(|v| 10.0 * v).collect::<Vec<_>>())?;
    assert_eq!(a.norm_infinity()?, 45.0);
    assert!(a.set_values(&values[..values.len() - 1]).is_err());
    a.copy_from(&copy)?;
    assert_eq!(a.norm_infinity()?, 4.5);

    // The first rank names a row for all ranks.
    let named: &[Index] = if context.rank() == 0 { &[7] } else { &[] };
    a.zero_rows_columns(named, 3.0)?;
    for row in range.clone().filter(|row| (6..=8).contains(row)) {
        let (columns, values) = a.row(row)?;
        let coupled = columns.iter().zip(&values).filter(|&(&j, &v)| (j == 7 || row == 7) && v != 0.0);
        assert_eq!(coupled.count(), usize::from(row == 7));
    }

    let even: Vec<_> = range.filter(|i| i % 2 == 0).collect();
    let even = IndexSet::new(&context, Comm::World, &even)?;
    let block = copy.submatrix(&even, &even)?;
    assert_eq!(block.size(), [n / 2, n / 2]);
    assert_eq!(block.norm_infinity()?, 2.5);
    assert!(Matrix::from_triplets(&context, Comm::World, local, &[n as Index], &[0], &[1.0]).is_err());
    Ok(())
}

fn cholesky(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let n = 60;
    let (local, rows, columns, values) = string(&context, n, 0.0);
    let mut a = Matrix::from_triplets(&context, Comm::World, local, &rows, &columns, &values)?;
    a.set_positive_definite()?;
    let mut solver = Ksp::new(&context, Comm::World, "test_")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    solver.set_up()?;

    // With indices from one, the inverse of (-1, 2, -1) is min(i, j) (n + 1 - max(i, j)) / (n + 1).
    let inverse = |i: usize, j: usize| (i.min(j) + 1) as f64 * (n - i.max(j)) as f64 / (n + 1) as f64;
    let range = a.range();
    let (mut b, mut x) = (a.vector()?, a.vector()?);
    b.set_local(&range.clone().map(f64::from).collect::<Vec<_>>())?;
    solver.solve(&b, &mut x)?;
    for (i, x) in range.clone().zip(x.to_vec()?) {
        close(x, (0..n).map(|j| inverse(i as usize, j) * j as f64).sum(), 1e-12);
    }
    assert!(solver.reason()?.converged());
    assert_eq!(solver.iterations()?, 1);

    let columns = [0, 17, 59];
    let (mut unit, mut answer) =
        (Matrix::dense(&context, Comm::World, local, 3)?, Matrix::dense(&context, Comm::World, local, 3)?);
    unit.with_columns_mut(|values| {
        for (c, &j) in columns.iter().enumerate() {
            if range.contains(&j) {
                values[c * local + (j - range.start) as usize] = 1.0;
            }
        }
    })?;
    solver.solve_columns(&unit, &mut answer)?;
    answer.with_columns(|values| {
        for (c, &j) in columns.iter().enumerate() {
            for (k, i) in range.clone().enumerate() {
                close(values[c * local + k], inverse(i as usize, j as usize), 1e-12);
            }
        }
    })?;

    // A factor is kept, then renewed.
    a.scale(2.0)?;
    let before = x.norm()?;
    solver.keep_preconditioner(true)?;
    solver.solve(&b, &mut x)?;
    close(x.norm()?, before, 1e-13);
    solver.keep_preconditioner(false)?;
    solver.solve(&b, &mut x)?;
    close(x.norm()?, before / 2.0, 1e-13);
    Ok(())
}

fn cholesky_refuses_an_indefinite_matrix(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let (local, rows, columns, values) = string(&context, 30, -1.0);
    let mut a = Matrix::from_triplets(&context, Comm::World, local, &rows, &columns, &values)?;
    a.set_positive_definite()?;
    let mut solver = Ksp::new(&context, Comm::World, "")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    let refusal = solver.set_up();
    assert!(matches!(refusal, Err(Error::Singular(_))), "{refusal:?}");

    // The eigenvalues are 1 - 2 cos(k pi / 31), k = 1 to 30; ten are negative.
    let a = Matrix::from_triplets(&context, Comm::World, local, &rows, &columns, &values)?;
    context.default_option("count_mat_mumps_icntl_13", "1")?;
    context.default_option("count_mat_mumps_icntl_24", "1")?;
    let mut solver = Ksp::new(&context, Comm::World, "count_")?;
    solver.default_to_cholesky()?;
    solver.set_from_options()?;
    solver.set_operator(&a)?;
    solver.set_up()?;
    assert_eq!(solver.inertia()?, [10, 0, 20]);
    Ok(())
}

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
    let mut matrix = Matrix::from_triplets(context, Comm::World, local, &rows, &columns, &values)?;
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
    let mut solver = Snes::new(&context, Comm::World, "")?;
    solver.set_type("vinewtonrsls")?;
    solver.default_to_cholesky()?;
    context.default_option("snes_linesearch_type", "l2")?;
    context.default_option("snes_vi_zero_tolerance", "1e-12")?;
    solver.set_residual(&load, |x, f| {
        *count.borrow_mut() += 1;
        matrix.multiply(x, f)?;
        f.add_scaled(-1.0, &load)
    })?;
    solver.set_jacobian(&matrix, |_, _| Ok(()))?;
    solver.set_bounds(&lower, &upper)?;
    solver.set_tolerances(1e-12, 0.0, 0.0, 100)?;
    solver.set_from_options()?;
    solver.solve(&mut x)?;
    let reason = solver.reason()?;
    assert!(reason.converged(), "{reason:?}");
    assert_eq!(reason.text, "CONVERGED_FNORM_ABS");
    assert_eq!(solver.kind()?, "vinewtonrsls");
    assert!(solver.iterations()? > 0 && solver.linear_iterations()? > 0 && *count.borrow() > 0);
    compare(&x, &exact)?;

    // From the solution the method makes no iteration, unless forced.
    solver.solve(&mut x)?;
    assert_eq!(solver.iterations()?, 0);
    assert!(solver.linear_solver()?.reason()?.converged());
    context.refuse_unused_options()?;

    // Too few iterations are not an error of the call, but appear in the convergence reason.
    solver.set_tolerances(1e-12, 0.0, 0.0, 1)?;
    x.fill(0.0)?;
    solver.solve(&mut x)?;
    let reason = solver.reason()?;
    assert_eq!((reason.converged(), reason.text.as_str()), (false, "DIVERGED_MAX_IT"));
    Ok(())
}

/// The iteration for the first of two columns does not converge, and that for the last one has
/// nothing to do.
fn every_column_is_judged(_: &[String]) -> Result<()> {
    let context = Context::start(&["-pc_type".into(), "jacobi".into(), "-ksp_max_it".into(), "1".into()])?;
    let matrix = obstacle(&context)?.matrix;
    let rows = matrix.local_size()[0];
    let mut right = Matrix::dense(&context, Comm::World, rows, 2)?;
    right.with_columns_mut(|values| values[..rows].fill(1.0))?;
    let mut solution = Matrix::dense(&context, Comm::World, rows, 2)?;
    let mut solver = Ksp::new(&context, Comm::World, "")?;
    solver.default_to_cholesky()?;
    solver.set_operator(&matrix)?;
    solver.set_from_options()?;
    let error = solver.solve_columns(&right, &mut solution).unwrap_err().to_string();
    assert!(error.contains("(-ksp_type cg -pc_type jacobi) gave up after 1 iteration"), "{error}");
    Ok(())
}

fn tao_solves_the_obstacle_problem(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    for kind in ["tron", "bnls", "gpcg"] {
        let Obstacle { matrix, load, lower, upper, exact } = obstacle(&context)?;
        let mut x = matrix.vector()?;
        let mut solver = Tao::new(&context, Comm::World, &format!("{kind}_"))?;
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
        solver.set_tolerances(1e-12, 0.0, 0.0, 500)?;
        solver.set_from_options()?;
        solver.solve(&mut x)?;
        let reason = solver.reason()?;
        assert!(reason.converged(), "{kind}: {reason:?} after {}", solver.iterations()?);
        assert_eq!(solver.kind()?, kind);
        assert!(solver.linear_solver()?.is_some());
        compare(&x, &exact)?;
    }
    context.refuse_unused_options()
}

fn refused_calls_say_why(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let mut solver = Snes::new(&context, Comm::World, "")?;
    let error = solver.set_type("nosuch").unwrap_err();
    assert_eq!(error.exit_code(), 3);
    let text = error.to_string();
    assert!(text.starts_with("PETSc: SNESSetType(): "), "{text}");
    assert!(text.contains("nosuch") && text.contains("(code 86, snes.c:"), "{text}");
    assert_eq!(text.lines().count(), 1);

    let short = Vector::new(&context, Comm::World, 2)?;
    let mut long = Vector::new(&context, Comm::World, 3)?;
    let text = long.copy_from(&short).unwrap_err().to_string();
    assert!(text.contains("Vec"), "{text}");
    assert!(solver.set_tolerances(f64::NAN, 0.0, 0.0, 10).is_err());
    // A failed call does not affect later ones.
    long.fill(1.0)
}

fn callbacks_fail_cleanly(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let Obstacle { matrix, load, .. } = obstacle(&context)?;
    std::panic::set_hook(Box::new(|_| {}));
    for panics in [true, false] {
        let mut solver = Snes::new(&context, Comm::World, "")?;
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
        let mut solver = Tao::new(&context, Comm::World, "")?;
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
    let mut solver = Snes::new(&context, Comm::World, "")?;
    solver.set_residual(&load, |_, _| Err(Error::Usage("my own words".into())))?;
    solver.set_jacobian(&matrix, |_, _| Ok(()))?;
    let error = solver.solve(&mut matrix.vector()?).unwrap_err();
    assert!(matches!(error, Error::Usage(_)));
    Ok(())
}

/// Returns a rectangle of 1.2 by 0.4 cut into cells. Cells and vertices are distributed over the
/// ranks independently of each other.
fn rectangle(context: &Rc<Context>, corners: usize, [nx, ny]: [usize; 2]) -> Result<Plex> {
    let vertex = |i: usize, j: usize| (j * (nx + 1) + i) as Index;
    let mut cells = Vec::new();
    for c in share(context, nx * ny) {
        let (i, j) = (c % nx, c / nx);
        let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
        if corners == 4 {
            cells.extend([a, b, c, d]);
        } else {
            cells.extend([a, b, c, a, c, d]);
        }
    }
    let vertices: Vec<_> = share(context, (nx + 1) * (ny + 1))
        .map(|v| [1.2 * (v % (nx + 1)) as f64 / nx as f64, 0.4 * (v / (nx + 1)) as f64 / ny as f64])
        .collect();
    Plex::from_cells(context, corners, &cells, &vertices)
}

/// Returns the edges that lie on x = 0, of some edges.
fn at_left(mesh: &Plex, mut edges: Vec<Index>) -> Result<Vec<Index>> {
    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let corners = edges.iter().map(|&edge| mesh.corners(edge)).collect::<Result<Vec<_>>>()?;
    let mut lies = corners.iter().map(|ends| ends.iter().all(|v| positions[(v - first) as usize][0] == 0.0));
    edges.retain(|_| lies.next() == Some(true));
    Ok(edges)
}

fn meshes(corners: usize) -> Result<()> {
    mesh(corners, [5, 3], 2)
}

fn mesh(corners: usize, cells: [usize; 2], refinements: u32) -> Result<()> {
    let context = Context::start(&[])?;
    let mut mesh = rectangle(&context, corners, cells)?.distribute()?;
    let boundary = mesh.boundary_edges()?;
    let edges = at_left(&mesh, boundary)?;
    mesh.label("support", 1, &edges)?;
    for _ in 0..refinements {
        mesh = mesh.refine()?;
    }

    let [nx, ny] = cells.map(|n| n << refinements);
    let per_rectangle = if corners == 3 { 2 } else { 1 };
    let owned = mesh.owned()?;
    let count = |points: std::ops::Range<Index>| {
        context.comm().all_reduce_sum(points.filter(|&p| owned[(p - mesh.chart().start) as usize]).count())
    };
    assert!(mesh.cells().all(|cell| owned[cell as usize]), "each cell is on one rank");
    assert_eq!(context.comm().all_reduce_sum(mesh.cells().len()), per_rectangle * nx * ny);
    assert_eq!(count(mesh.vertices()), (nx + 1) * (ny + 1));
    let diagonals = if corners == 3 { nx * ny } else { 0 };
    assert_eq!(count(mesh.edges()), nx * (ny + 1) + ny * (nx + 1) + diagonals);

    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let mut area = 0.0;
    for cell in mesh.cells() {
        assert_eq!(mesh.cone(cell)?.len(), corners);
        let at: Vec<_> = mesh.corners(cell)?.iter().map(|v| positions[(v - first) as usize]).collect();
        assert_eq!(at.len(), corners);
        let twice: f64 =
            (0..corners).map(|k| (at[k], at[(k + 1) % corners])).map(|([x, y], [u, v])| x * v - u * y).sum();
        assert!(twice > 0.0, "counterclockwise");
        area += 0.5 * twice;
    }
    close(context.comm().all_reduce_sum(area), 0.48, 1e-13);
    if context.size() > 1 && refinements > 0 {
        let share = context.comm().all_reduce_max(mesh.cells().len() as f64) * context.size() as f64;
        assert!(share <= 1.5 * (per_rectangle * nx * ny) as f64, "an even partition");
    }

    let boundary = mesh.boundary_edges()?;
    assert_eq!(context.comm().all_reduce_sum(boundary.len()), 2 * (nx + ny));
    let mut expected = at_left(&mesh, boundary)?;
    // The label contains the refined edges and the new vertices between them.
    let mut labelled: Vec<_> =
        mesh.labelled("support", 1)?.into_iter().filter(|point| mesh.edges().contains(point)).collect();
    labelled.sort_unstable();
    expected.sort_unstable();
    assert_eq!(context.comm().all_reduce_sum(expected.len()), ny);
    assert_eq!(labelled, expected);
    assert!(mesh.labelled("nothing", 1)?.is_empty());
    Ok(())
}

/// Three dofs per vertex with the left edge held: scatters, numbering, and assembly of a matrix
/// like that of the string.
fn dofs(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let mesh = rectangle(&context, 4, [4, 2])?.distribute()?.refine()?;
    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let vertices = mesh.vertices();
    let section = Section::new(&context, Comm::World, mesh.chart(), |point| {
        if !vertices.contains(&point) {
            return Dofs::default();
        }
        let held = if positions[(point - first) as usize][0] == 0.0 { vec![0, 2] } else { vec![] };
        Dofs { count: 3, held }
    })?;
    let mesh = mesh.with_section(&section)?;
    let (nodes, held) = (9 * 5, 2 * 5);
    let (mut global, mut local) = (mesh.global_vector()?, mesh.local_vector()?);
    assert_eq!(global.size(), 3 * nodes - held);
    assert_eq!((local.size(), section.size()), (3 * vertices.len(), 3 * vertices.len()));

    // The number of each dof reaches the ranks that share it.
    let numbers: Vec<_> = global.range().map(f64::from).collect();
    global.set_local(&numbers)?;
    local.fill(-1.0)?;
    mesh.to_local(&global, &mut local)?;
    let map = mesh.global_dofs()?;
    for (dof, value) in map.iter().zip(local.to_vec()?) {
        assert_eq!(f64::from((*dof).max(-1)), value);
    }
    let global_section = mesh.global_section()?;
    for vertex in vertices.clone() {
        let [at, everywhere] = [section.offset(vertex)?, global_section.offset(vertex)?];
        let free = (0..3).map(|k| map[at as usize + k]).filter(|&dof| dof >= 0).collect::<Vec<_>>();
        let start = if everywhere < 0 { -(everywhere + 1) } else { everywhere };
        assert_eq!(free, (start..start + free.len() as Index).collect::<Vec<_>>());
        assert_eq!(section.dofs(vertex)?, 3);
    }

    // Sums over cells, by vector and by matrix, count the cells that touch each dof.
    global.fill(0.0)?;
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    let mut counts = vec![0.0; local.size()];
    for cell in mesh.cells() {
        for vertex in mesh.corners(cell)? {
            let at = section.offset(vertex)? as usize;
            for dof in at..at + 3 {
                counts[dof] += 1.0;
                rows.push(map[dof]);
                values.push(1.0);
            }
        }
    }
    local.set_local(&counts)?;
    mesh.add_to_global(&local, &mut global)?;
    assert_eq!(global.all_reduce_max()?, 4.0);
    let matrix = Matrix::from_triplets(&context, Comm::World, global.local_size(), &rows, &rows, &values)?;
    let mut diagonal = matrix.vector()?;
    matrix.diagonal(&mut diagonal)?;
    assert_eq!(diagonal.to_vec()?, global.to_vec()?);
    Ok(())
}

fn unused_options(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    assert!(context.has_option("ksp_typ")? && !context.has_option("ksp_type")?);
    context.default_option("ours_that_nothing_uses", "1")?;
    context.default_option("ksp_rtol", "0.5")?;
    assert_eq!(context.option("ours_that_nothing_uses")?.as_deref(), Some("1"));
    let mut solver = Ksp::new(&context, Comm::World, "")?;
    solver.set_from_options()?;
    assert_eq!(context.unused_options()?, ["ksp_typ"]);
    let error = context.refuse_unused_options().unwrap_err();
    assert_eq!(error.exit_code(), 2);
    assert_eq!(error.to_string(), "nothing used the PETSc option `-ksp_typ`; did you mean `-ksp_type`?");
    assert_eq!(context.option("ksp_rtol")?.as_deref(), Some("1e-12"));
    assert_eq!(context.option("ksp_atol")?, None);
    Ok(())
}

fn words_that_are_no_options(arguments: &[String]) -> Result<()> {
    let error = Context::start(arguments).unwrap_err();
    assert!(matches!(&error, Error::Usage(text) if text.contains("`stray`")), "{error}");
    let refused = |words: &[&str]| {
        rebond::petsc::options::validate(&words.iter().map(ToString::to_string).collect::<Vec<_>>()).is_err()
    };
    assert!(!refused(&["-snes_monitor", "-ksp_atol", "-1e-3", "--pc_type", "lu", "-snes_rtol", "-inf"]));
    assert!(refused(&["5"]) && refused(&["-"]) && refused(&["-pc_type", "lu", "ilu"]) && refused(&["-1"]));
    // PETSc was not started by the above, so it can start here.
    Context::start(&arguments[..2]).map(drop)
}

fn panic_of_one_rank(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    assert!(context.rank() != 1, "only rank 1 fails");
    context.comm().barrier();
    Ok(())
}

fn killed_rank(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    if context.rank() == 1 {
        // The shell's own kill is used, since a bare system has no other.
        let kill = format!("kill -9 {}", std::process::id());
        let killed = Command::new("sh").args(["-c", &kill]).status();
        unreachable!("{killed:?}");
    }
    context.comm().barrier();
    Ok(())
}

fn error_of_one_rank(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    if context.rank() == 1 {
        context.fail(&Error::Petsc("only rank 1 fails".into()));
    }
    context.comm().barrier();
    std::thread::sleep(Duration::from_secs(30));
    Ok(())
}

fn error_of_all_ranks(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    context.fail(&Error::Usage("the same on all".into()))
}
