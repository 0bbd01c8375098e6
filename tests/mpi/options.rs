//! PETSc's options through the command: iterative linear solvers, their messages, and options from
//! the environment and from files.

use crate::common::command::{
    self, assert_agree, assert_fails, history, on, rebond, succeeds, summary, text,
};
use crate::common::models::literal;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The paper's plate, bent down and pushed further onto an obstacle just below it.
const PUSHED: &str = concat!(
    "title = \"a push\"\n",
    literal!(PAPER_PUSH),
    r#"
mesh = { element = "fvs", cells = [10, 4] }
obstacle = [{ side = "below", height = -0.2085 }]
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 2e-3 }
output = { every = 5, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "middle", at = [1.2, 0.2] }] }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("options-{test}"), PUSHED)
}

const RUN: [&str; 6] = ["run", "fall.toml", "--engine", "petsc", "--overwrite", "--quiet"];

/// Runs the scene on PETSc for some steps with its options.
fn run(folder: &Path, steps: &str, options: &[&str]) -> Output {
    rebond(folder, &[&RUN[..], &["--set", steps, "--"], options].concat())
}

/// Runs the scene with options in an environment variable.
fn run_with_variable(folder: &Path, variable: &str, options: &[&str]) -> Output {
    with_variable(folder, variable, &[&RUN[..], &["--set", ONE_STEP, "--"], options].concat())
}

fn with_variable(folder: &Path, variable: &str, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rebond"));
    command.args(arguments).env("PETSC_OPTIONS", variable).current_dir(folder).output().unwrap()
}

const ONE_STEP: &str = "time.end=1e-4";

#[test]
fn petscs_linear_solvers_go_through_contact() {
    let folder = folder("linear");
    succeeds(&rebond(&folder, &["run", "fall.toml", "--out", "native", "--quiet"]));
    let native = history(&folder.join("native"));
    for (ranks, preconditioner) in [
        (1, "cholesky"),
        (3, "cholesky"),
        (2, "redundant"),
        (1, "gamg"),
        (1, "jacobi"),
        (1, "bddc"),
        (2, "gamg"),
        (3, "bddc"),
    ] {
        let out = format!("{preconditioner}-{ranks}");
        let arguments = [&RUN[..], &["--out", &out, "--", "-pc_type", preconditioner]].concat();
        succeeds(&if ranks == 1 { rebond(&folder, &arguments) } else { on(&folder, ranks, &arguments) });
        assert_agree(&history(&folder.join(&out)), &native, &out);
        let summary = summary(&folder.join(&out));
        assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{out}");
        assert!(summary["contact_steps"].as_u64().unwrap() > 0, "{out}");
    }
}

/// A solver that the user made too inaccurate is named, beside what else may be wrong.
#[test]
fn a_solver_that_is_too_inaccurate_is_named() {
    let folder = folder("inaccurate");
    for options in ["-ksp_type preonly -pc_type jacobi", "-ksp_rtol 0.9 -ksp_type cg -pc_type jacobi"] {
        let output = run(&folder, ONE_STEP, &options.split(' ').collect::<Vec<_>>());
        assert_fails(&output, 2, &[&format!("first try without {options}")]);
    }
}

/// Cells are five times as long as wide: the norm of the preconditioned residual rises ten
/// thousandfold before it falls.
#[test]
fn conjugate_gradients_outlast_a_rising_residual() {
    let folder = folder("rising");
    let mesh =
        ["--set", "mesh.cells=[6,40]", "--set", ONE_STEP, "--", "-ksp_type", "cg", "-pc_type", "jacobi"];
    succeeds(&rebond(&folder, &[&RUN[..], &mesh].concat()));
}

/// Multigrid knows the motions without energy and the dofs of each node.
#[test]
fn multigrid_needs_few_iterations() {
    let folder = folder("multigrid");
    let fine = ["--set", "mesh.cells=[20,8]", "--set", ONE_STEP, "--", "-pc_type", "gamg"];
    let output = rebond(&folder, &[&RUN[..], &fine, &["-ksp_converged_reason"]].concat());
    let said = succeeds(&output);
    let iterations = said.lines().filter_map(|line| line.rsplit_once("iterations ")?.1.parse::<u32>().ok());
    let most = iterations.max().expect("solves are told");
    assert!(most <= 100, "{most} iterations");
}

/// Balanced subdomains take few iterations, whether few dofs touch or nearly all, which are held.
#[test]
fn subdomains_take_few_iterations() {
    let folder = folder("subdomains");
    let triangles = ["--set", "mesh.cells=[20,8]", "--set", "mesh.element=\"hct\""];
    let wide = [
        "--set",
        "mesh.cells=[20,8]",
        "--set",
        "initial={ velocity = \"-1\" }",
        "--set",
        "obstacle.0.height=-1e-6",
    ];
    for (name, changes, touching) in [("triangles", &triangles[..], 1), ("wide", &wide[..], 150)] {
        let native = format!("{name}-native");
        succeeds(&rebond(&folder, &[&["run", "fall.toml", "--quiet", "--out", &native], changes].concat()));
        let arguments = [&RUN[..], &["--out", name], changes, &["--", "-pc_type", "bddc"]].concat();
        succeeds(&on(&folder, 2, &arguments));
        let rows = history(&folder.join(name));
        assert_agree(&rows, &history(&folder.join(&native)), name);
        let most = rows.iter().map(|row| row[6]).fold(0.0, f64::max);
        assert!(most >= f64::from(touching), "{name}: {most} nodes in contact");
        let summary = summary(&folder.join(name));
        let iterations = summary["linear"]["iterations_max"].as_u64().unwrap();
        assert!(iterations <= 30, "{name}: {iterations} iterations");
        assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-11, "{name}");
    }
}

#[test]
fn solvers_are_told_by_what_they_are() {
    let folder = folder("names");
    let options = ["-ksp_type", "cg", "-pc_type", "jacobi", "-ksp_max_it", "3", "-ksp_monitor"];
    let output = run(&folder, ONE_STEP, &options);
    assert_fails(&output, 3, &["(-ksp_type cg -pc_type jacobi)", "after 3 iterations: DIVERGED_ITS"]);
    let said = text(&output.stdout);
    assert!(said.contains("KSP Residual norm") && !said.contains("for  solve"), "{said}");
    for (vi, preconditioner) in [("snes", "gamg"), ("tao", "gamg"), ("snes", "bddc"), ("tao", "bddc")] {
        let arguments = [&RUN[..], &["--vi", vi, "--", "-pc_type", preconditioner]].concat();
        let named = format!("-pc_type {preconditioner}");
        assert_fails(&rebond(&folder, &arguments), 2, &[&named, "condensed"]);
    }
}

#[test]
fn options_from_elsewhere_are_checked_too() {
    let folder = folder("elsewhere");
    let refused = |output: &Output, words: &[&str]| assert_fails(output, 2, words);
    refused(&run_with_variable(&folder, "-ksp_tpye cg", &[]), &["-ksp_tpye", "did you mean `-ksp_type`?"]);
    refused(&run_with_variable(&folder, "-ksp_rtol nan", &["-pc_type", "jacobi"]), &["-ksp_rtol nan"]);
    let arguments = ["stability", "fall.toml", "--with", "petsc", "--quiet", "--set", ONE_STEP];
    refused(&with_variable(&folder, "-ksp_tpye cg", &arguments), &["-ksp_tpye", "did you mean `-ksp_type`?"]);

    // PETSc would read this file by itself. The program reports that it does not read it, or reads
    // it and checks its contents.
    std::fs::write(folder.join(".petscrc"), "-ksp_tpye cg\n").unwrap();
    let output = run(&folder, ONE_STEP, &[]);
    succeeds(&output);
    let said = text(&output.stderr);
    assert!(said.contains(".petscrc is not read") && said.contains("-skip_petscrc 0"), "{said}");
    let typo: &[&str] = &["nothing used", "-ksp_tpye"];
    refused(&run(&folder, ONE_STEP, &["-skip_petscrc", "0"]), typo);
    refused(&run_with_variable(&folder, "-skip_petscrc 0", &[]), typo);
    std::fs::write(folder.join(".petscrc"), "-ksp_rtol nan\n-pc_type jacobi\n").unwrap();
    refused(&run(&folder, ONE_STEP, &["-skip_petscrc", "0"]), &["-ksp_rtol nan"]);
}
