//! PETSc's contact solvers through the command, under mpirun: they agree with the native one, or say why not.

#![cfg(feature = "petsc")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The paper's plate on 40 quadrilaterals.
const PLATE: &str = r#"
title = "a fall"
plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
mesh = { element = "fvs", cells = [10, 4] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.1 }]
initial = { static_pressure = 14600 }
time = { scheme = "newmark", mass = "singular", step = 1e-5, end = 0.07 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "middle", at = [1.2, 0.2] }] }
"#;

fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("vi-petsc-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("fall.toml"), PLATE).unwrap();
    folder
}

/// Runs the scene on some ranks; 0 without mpirun.
fn run(folder: &Path, ranks: usize, arguments: &[&str]) -> Output {
    let program = env!("CARGO_BIN_EXE_rebond");
    let mut command = Command::new(if ranks == 0 { program } else { "mpirun" });
    if ranks > 0 {
        command.args(["--oversubscribe", "--mca", "mpi_yield_when_idle", "1", "--timeout", "120", "-n"]);
        command.arg(ranks.to_string()).arg(program);
    }
    command.args(["run", "fall.toml"]).args(arguments).current_dir(folder);
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.env_remove("PETSC_OPTIONS").output().unwrap()
}

/// The columns of a run's history that a plate shows, row by row, and its summary.
fn result(folder: &Path, name: &str, ranks: usize, arguments: &[&str]) -> (Vec<Vec<f64>>, serde_json::Value) {
    let mut all = vec!["--out", name, "--quiet"];
    all.extend(arguments);
    let output = run(folder, ranks, &all);
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    let history = std::fs::read_to_string(folder.join(name).join("history.csv")).unwrap();
    let mut lines = history.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let shown: Vec<usize> = (0..header.len())
        .filter(|&column| ["time", "corner", "middle"].iter().any(|name| header[column].starts_with(name)))
        .collect();
    assert_eq!(shown.len(), 3, "{header:?}");
    let row = |line: &str| {
        let values: Vec<f64> = line.split(',').map(|value| value.parse().unwrap()).collect();
        shown.iter().map(|&column| values[column]).collect()
    };
    let summary = std::fs::read_to_string(folder.join(name).join("summary.json")).unwrap();
    (lines.map(row).collect(), serde_json::from_str(&summary).unwrap())
}

fn assert_agree(left: &[Vec<f64>], right: &[Vec<f64>], name: &str) {
    assert_eq!(left.len(), right.len());
    let difference =
        |(a, b): (&Vec<f64>, &Vec<f64>)| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let worst = left.iter().zip(right).map(difference).fold(0.0, f64::max);
    assert!(worst <= 1e-8, "{name}: {worst:e}");
}

const SOLVERS: [(&str, &[&str]); 4] = [
    ("snes", &["--set", "solver.vi=snes"]),
    ("tron", &["--set", "solver.vi=tao"]),
    ("bnls", &["--set", "solver.vi=tao", "--", "-tao_type", "bnls"]),
    ("gpcg", &["--set", "solver.vi=tao", "--", "-tao_type", "gpcg"]),
];

#[test]
fn they_agree_with_the_native_solver_on_one_rank_and_on_two() {
    let folder = folder("agree");
    // Several ranks on the cores of a test machine spend their time waiting for one another: fewer steps there.
    for (ranks, step) in [(1, "time.step=1e-5"), (2, "time.step=1e-4")] {
        let (native, summary) = result(&folder, "native", 0, &["--set", step]);
        assert!(summary["contact_steps"].as_u64().unwrap() > 20);
        for (name, arguments) in SOLVERS {
            let all = [&["--engine", "petsc", "--set", step][..], arguments].concat();
            let (rows, summary) = result(&folder, &format!("{name}-{ranks}"), ranks, &all);
            assert_agree(&rows, &native, name);
            assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{name} on {ranks}");
            assert_eq!(summary["retries"], 0, "{name} on {ranks}");
        }
    }
}

#[test]
fn a_small_mesh_on_four_ranks() {
    let folder = folder("four");
    let small = ["--set", "mesh.cells=[4,2]", "--set", "time.step=1e-4", "--set", "time.end=0.08"];
    let (native, _) = result(&folder, "native", 0, &small);
    for (name, arguments) in SOLVERS {
        let mut all = small.to_vec();
        all.extend(["--engine", "petsc"]);
        all.extend(arguments);
        let (rows, summary) = result(&folder, name, 4, &all);
        assert_agree(&rows, &native, name);
        assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{name}");
    }
}

#[test]
fn what_a_method_cannot_solve_is_solved_again_and_counted() {
    let folder = folder("retries");
    let all = [
        "--engine",
        "petsc",
        "--set",
        "time.step=1e-4",
        "--set",
        "solver.vi=snes",
        "--",
        "-snes_max_it",
        "1",
    ];
    let all = [&all[..], &["-snes_linesearch_type", "bt", "-safe_snes_max_it", "1", "-snes_atol", "1e-30"]]
        .concat();
    let output = run(&folder, 1, &all);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("SNES ended a step with DIVERGED_").count(), 1, "{said}");
    let (native, _) = result(&folder, "native", 0, &["--set", "time.step=1e-4"]);
    let (rows, summary) = result(&folder, "again", 2, &all);
    assert_agree(&rows, &native, "again");
    assert_eq!(summary["retries"], summary["contact_steps"]);
    assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10);
}

#[test]
fn every_step_can_be_left_to_the_method() {
    let folder = folder("always");
    let short = ["--engine", "petsc", "--set", "time.end=0.001", "--set", "solver.vi=snes"];
    for (always, iterations) in [(&[][..], 0), (&["--", "-rebond_always_iterate"][..], 101)] {
        let (_, summary) = result(&folder, "always", 0, &[&short[..], always].concat());
        assert!(summary["vi_iterations"].as_u64().unwrap() >= iterations);
        assert_eq!(summary["vi_iterations"] == 0, iterations == 0);
    }
}

#[test]
fn options_reach_the_solver() {
    let folder = folder("options");
    let all =
        ["--engine", "petsc", "--set", "time.step=1e-4", "--set", "solver.vi=snes", "--", "-snes_monitor"];
    for ranks in [0, 2] {
        let output = run(&folder, ranks, &all);
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && said.contains("1 SNES Function norm"), "{said}");
    }
    // Conjugate gradients in place of the factor.
    for vi in ["condensed", "snes"] {
        let solver = format!("solver.vi={vi}");
        let all = ["--engine", "petsc", "--set", &solver, "--set", "time.step=1e-4"];
        let all = [&all[..], &["--", "-ksp_type", "cg", "-pc_type", "jacobi"]].concat();
        let (rows, _) = result(&folder, vi, 1, &all);
        assert_agree(&rows, &result(&folder, "native", 0, &["--set", "time.step=1e-4"]).0, vi);
    }
    // A view is no typo, even if no step needs the solver.
    let all = ["--engine", "petsc", "--set", "time.end=1e-4", "--set", "solver.vi=snes", "--", "-snes_view"];
    assert!(run(&folder, 1, &all).status.success());
}

#[test]
fn what_cannot_work_is_refused_by_name() {
    let folder = folder("refused");
    let cases: [(&[&str], i32, &[&str]); 8] = [
        (&["--set", "solver.vi=tao", "--", "-tao_type", "bqpip"], 2, &["bqpip", "wrong"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "ssils"], 2, &["ssils", "constraints"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "almm"], 2, &["almm", "constraints"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "lmvm"], 2, &["lmvm", "no bounds"]),
        (&["--set", "solver.vi=snes", "--", "-snes_type", "newtonls"], 2, &["newtonls", "vinewtonrsls"]),
        (&["--", "-pc_factor_mat_solver_type", "superlu_dist"], 2, &["superlu_dist", "memory"]),
        (
            &["--set", "solver.vi=snes", "--", "-snes_linesearch_typ", "l2"],
            2,
            &["did you mean `-snes_linesearch_type`"],
        ),
        (&["--set", "solver.vi=snes", "--set", "solver.tolerance=1e-30"], 3, &["asked for 1.0e-30"]),
    ];
    for ranks in [0, 2] {
        for (arguments, code, words) in cases {
            let output = run(&folder, ranks, &[&["--engine", "petsc"][..], arguments].concat());
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
            for word in words {
                assert!(said.contains(word), "{arguments:?}: no {word:?} in {said}");
            }
        }
    }
}
