//! Start, options and ends of PETSc.

use crate::common::command::send;
use crate::common::ranks::{Case, Failure, Success, case};
use rebond::communicator::Communicator;
use rebond::petsc::{Context, Ksp, Vector};
use rebond::{Error, Result};
use rustix::process::Signal;
use std::time::Duration;

pub const CASES: &[Case] = &[
    case("start_and_stop", &[1, 2, 4], start_and_stop),
    case("blas_has_one_thread", &[1], blas_has_one_thread),
    Case {
        name: "unused_options",
        ranks: &[1, 2],
        arguments: &["-ksp_typ", "cg", "-ksp_rtol", "1e-12", "-options_left", "no"],
        body: unused_options,
        expect: Success,
        seconds: 60,
        each_kernel: false,
    },
    Case {
        name: "words_that_are_no_options",
        ranks: &[1],
        arguments: &["-ksp_rtol", "-1e-3", "stray"],
        body: words_that_are_no_options,
        expect: Success,
        seconds: 60,
        each_kernel: false,
    },
    Case {
        name: "panic_of_one_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: panic_of_one_rank,
        expect: Failure(101, "only rank 1 fails"),
        seconds: 60,
        each_kernel: false,
    },
    Case {
        name: "killed_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: killed_rank,
        expect: Failure(137, "exited on signal 9"),
        seconds: 60,
        each_kernel: false,
    },
    Case {
        name: "error_of_one_rank",
        ranks: &[2, 4],
        arguments: &[],
        body: error_of_one_rank,
        expect: Failure(3, "rebond: PETSc: only rank 1 fails (rank 1 of "),
        seconds: 60,
        each_kernel: false,
    },
    Case {
        name: "error_of_all_ranks",
        ranks: &[1, 2, 4],
        arguments: &[],
        body: error_of_all_ranks,
        expect: Failure(2, "rebond: the same on all"),
        seconds: 60,
        each_kernel: false,
    },
];

fn start_and_stop(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    assert!(context.rank() < context.size());
    let [major, minor, _] = Context::library_version()?;
    assert!((major, minor) >= (3, 18));
    let second = Context::start(arguments);
    assert!(matches!(second, Err(Error::Petsc(text)) if text.contains("once")));
    // A handle keeps PETSc running.
    let vector = Vector::new(&context, 3)?;
    drop(context);
    assert_eq!(vector.range().start as usize, 3 * vector.context().rank());
    Ok(())
}

fn blas_has_one_thread(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    // The number is unknown where BLAS is not OpenBLAS.
    assert!(context.blas_threads().is_none_or(|threads| threads == 1));
    Ok(())
}

fn unused_options(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    assert!(context.has_option("ksp_typ")? && !context.has_option("ksp_type")?);
    context.default_option("ours_that_nothing_uses", "1")?;
    context.default_option("ksp_rtol", "0.5")?;
    assert_eq!(context.option("ours_that_nothing_uses")?.as_deref(), Some("1"));
    let mut solver = Ksp::new(&context, "")?;
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
        send(Signal::KILL, std::process::id());
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
