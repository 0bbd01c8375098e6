//! PETSc's contact solvers through the command, under mpirun: they agree with the native one, or
//! give the reason why not.

use crate::common::command;
use crate::common::command::{assert_agree, assert_fails, comparison, history, on, rebond, succeeds, text};
use crate::common::models::literal;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;

/// The paper's plate on 40 quadrilaterals, bent down and pushed further onto an obstacle just below
/// it.
const PUSHED: &str = concat!(
    "title = \"a push\"\n",
    literal!(PAPER_PUSH),
    r#"
mesh = { element = "fvs", cells = [10, 4] }
obstacle = [{ side = "below", height = -0.2085 }]
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.02 }
output = { every = 5, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "middle", at = [1.2, 0.2] }] }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("vi-petsc-{test}"), PUSHED)
}

/// Runs the scene on some ranks; 0 means without mpirun.
fn run(folder: &Path, ranks: usize, arguments: &[&str]) -> Output {
    let arguments = [&["run", "fall.toml", "--overwrite"], arguments].concat();
    if ranks == 0 { rebond(folder, &arguments) } else { on(folder, ranks, &arguments) }
}

/// Returns history and summary of a run.
fn result(folder: &Path, name: &str, ranks: usize, arguments: &[&str]) -> (Vec<Vec<f64>>, Value) {
    succeeds(&run(folder, ranks, &[&["--out", name, "--quiet"], arguments].concat()));
    (history(&folder.join(name)), command::summary(&folder.join(name)))
}

const SOLVERS: [(&str, &[&str]); 4] = [
    ("snes", &["--set", "solver.vi=snes"]),
    ("tron", &["--set", "solver.vi=tao"]),
    ("bnls", &["--set", "solver.vi=tao", "--", "-tao_type", "bnls"]),
    ("gpcg", &["--set", "solver.vi=tao", "--", "-tao_type", "gpcg"]),
];

/// All solvers are compared on the paper's scenes, to just beyond the first impact.
#[test]
fn they_agree_with_the_native_solver_at_every_step() {
    let folder = folder("compare");
    for (scene, title) in [("fig2", "fvs"), ("fig1", "hct")] {
        let scene = format!("{}/scenes/csma2013/{scene}.toml", env!("CARGO_MANIFEST_DIR"));
        let set = ["--set", "time.step=2e-5", "--set", "time.end=0.0556", "--json"];
        let output = rebond(&folder, &[&["compare", &scene][..], &set].concat());
        succeeds(&output);
        let value = comparison(&output);
        assert!(
            value["title"].as_str().unwrap().contains(title) && value["impacts"][0].is_number(),
            "{value}"
        );
        let names = ["native", "petsc", "petsc:snes:vinewtonrsls", "petsc:tao:tron", "petsc:tao:bnls"];
        let entries = value["entries"].as_array().unwrap();
        assert_eq!(entries.len(), names.len());
        for (entry, name) in entries.iter().zip(names) {
            assert_eq!((&entry["name"], &entry["steps"]), (&name.into(), &2780.into()));
            assert!(entry["contact_steps"].as_u64().unwrap() > 20, "{entry}");
            assert!(entry["difference"].as_f64().unwrap() <= 1e-8, "{entry}");
            assert!(entry["worst_kkt"].as_f64().unwrap() <= 1e-9, "{entry}");
            assert_eq!(entry["retries"], 0, "{entry}");
        }
    }
}

#[test]
fn they_agree_with_the_native_solver_on_two_ranks() {
    let folder = folder("agree");
    let step = ["--set", "time.step=1e-5", "--set", "time.end=0.002"];
    let (native, summary) = result(&folder, "native", 0, &step);
    assert!(summary["contact_steps"].as_u64().unwrap() > 20, "{summary}");
    for (name, arguments) in SOLVERS {
        let all = [&["--engine", "petsc"], &step[..], arguments].concat();
        let (rows, summary) = result(&folder, name, 2, &all);
        assert_agree(&rows, &native, name);
        assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{name}: {summary}");
        assert_eq!(summary["retries"], 0, "{name}");
    }
}

/// The type in a contender's name takes precedence over the option, and does not affect later
/// contenders.
#[test]
fn contenders_name_their_types() {
    let folder = folder("types");
    let compare = |with: &str, options: &[&str]| {
        let arguments = ["compare", "fall.toml", "--json", "--with", with, "--"];
        rebond(&folder, &[&arguments[..], options].concat())
    };
    // Only BNTR needs a Krylov method. The contender without a type is GPCG, which makes more
    // iterations than BNLS.
    let output = compare("petsc:tao:bntr,petsc:tao:bnls,petsc:tao", &["-tao_type", "gpcg"]);
    succeeds(&output);
    let value = comparison(&output);
    let iterations: Vec<u64> =
        (0..3).map(|k| value["entries"][k]["vi_iterations"].as_u64().unwrap()).collect();
    assert!(iterations[2] > iterations[1], "{iterations:?}");
    assert_fails(&compare("native,petsc:tao:bqpip", &["-log_view"]), 2, &["-tao_type bqpip", "wrong"]);
    // Options are refused before anything is compared.
    for (with, option) in [("petsc:tao:tron,petsc:snes", "-tao_type"), ("petsc,petsc:snes", "-snes_rtoll")] {
        let output = compare(with, &[option, "tron"]);
        assert_fails(&output, 2, &["nothing used", option]);
        assert!(output.stdout.is_empty(), "{}", text(&output.stdout));
    }
}

#[test]
fn a_small_mesh_on_four_ranks() {
    let folder = folder("four");
    let small = ["--set", "mesh.cells=[4,2]", "--set", "time.end=0.008"];
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

/// Compliant stops on a line and at a point, with damping, and a compliant ball.
#[test]
fn they_agree_on_compliant_stops() {
    let folder = folder("stops");
    let stops = [
        "--set",
        "obstacle=[{ name = 'pad', side = 'below', height = -0.2085, line = [[1.2, 0], [1.2, 0.4]], stiffness = 1e7, damping = 1e3 }, \
         { name = 'post', side = 'below', height = -0.075, at = [0.6, 0.2], stiffness = 1e9 }]",
        "--set",
        "ball=[{ at = [0.9, 0.15], mass = 0.3, height = 0.01, velocity = -4, stiffness = 1e6 }]",
        "--set",
        "time.end=0.01",
    ];
    let (native, summary) = result(&folder, "native", 0, &stops);
    assert!(summary["contact_steps"].as_u64().unwrap() > 20, "{summary}");
    assert!(["pad", "post"].iter().all(|of| summary["forces"][of]["peak"].as_f64().unwrap() > 0.0));
    for (name, arguments) in SOLVERS {
        let all = [&["--engine", "petsc"], &stops[..], arguments].concat();
        let (rows, summary) = result(&folder, name, 2, &all);
        assert_eq!(rows.len(), native.len());
        for column in [2, 7, 10, 11, 12, 13, 14, 15] {
            let largest = native.iter().fold(0.0, |m: f64, row| row[column].abs().max(m));
            for (a, b) in rows.iter().zip(&native) {
                let error = (a[column] - b[column]).abs();
                assert!(error <= 1e-7 * largest, "{name}, column {column}: {error:e} of {largest:e}");
            }
        }
        assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{name}: {summary}");
        assert_eq!(summary["retries"], 0, "{name}");
    }
}

/// Stops by the law of Hertz from soft to stiff beside a rigid obstacle, and a ball.
#[test]
fn they_agree_on_stops_by_the_law_of_hertz() {
    let folder = folder("hertz");
    for stiffness in ["1e5", "1e8", "1e11"] {
        let stops = format!(
            "obstacle=[{{ name = 'pin', side = 'below', height = -0.2085, at = [1.2, 0], law = 'hertz', stiffness = {stiffness} }}, \
             {{ side = 'below', height = -0.075, at = [0.6, 0.2], law = 'hertz', stiffness = {stiffness} }}, \
             {{ side = 'below', height = -0.21, where = 'x > 1.1 and y > 0.1' }}]"
        );
        let ball = "ball=[{ at = [0.9, 0.15], mass = 0.3, height = 0.01, velocity = -4, law = 'hertz', stiffness = 1e8 }]";
        let stops = ["--set", &stops, "--set", ball, "--set", "time.end=0.01"];
        let (native, summary) = result(&folder, "native", 0, &stops);
        assert!(summary["contact_steps"].as_u64().unwrap() > 20, "{summary}");
        assert!(summary["forces"]["pin"]["peak"].as_f64().unwrap() > 0.0);
        for (name, arguments) in SOLVERS {
            let all = [&["--engine", "petsc"], &stops[..], arguments].concat();
            let (rows, summary) = result(&folder, name, 2, &all);
            assert_eq!(rows.len(), native.len());
            println!("{stiffness}, {name}: kkt {}, retries {}", summary["worst_kkt"], summary["retries"]);
            for column in [2, 7, 10, 11, 12, 13] {
                let largest = native.iter().fold(0.0, |m: f64, row| row[column].abs().max(m));
                for (a, b) in rows.iter().zip(&native) {
                    let error = (a[column] - b[column]).abs();
                    assert!(error <= 1e-7 * largest, "{name}, column {column}: {error:e} of {largest:e}");
                }
            }
            assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10, "{name}: {summary}");
        }
    }
}

/// A static start that presses a stop by the law of Hertz, beside softer and stiffer ones, is the
/// same with every engine, contact solver and number of ranks; its force is that of the law.
#[test]
fn a_static_start_presses_a_stop_by_the_law_of_hertz() {
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/hard/hertz-stops.toml");
    let folder = command::folder("vi-petsc-hertz-start", &std::fs::read_to_string(scene).unwrap());
    let probes = "output.probes=[{ name = 'tip', at = [1.2, 0.2] }, { name = 'middle', at = [0.6, 0.2] }]";
    let short = ["--set", probes, "--set", "time.scheme=conserving", "--set", "time.end=5e-4"];
    let (native, _) = result(&folder, "native", 0, &short);
    let force = -1e7 * (native[0][11] - 0.04).powf(1.5);
    assert!(force < -1e3 && (native[0][7] / force - 1.0).abs() <= 1e-9, "{}, {force}", native[0][7]);
    for ranks in [1, 2, 3] {
        for (name, arguments) in [("condensed", &[][..]), SOLVERS[0], SOLVERS[1]] {
            let all = [&["--engine", "petsc"], &short[..], arguments].concat();
            let (rows, summary) = result(&folder, &format!("{name}-{ranks}"), ranks, &all);
            assert_eq!(rows.len(), native.len());
            for (a, b) in rows.iter().zip(&native) {
                for column in [2, 7, 10, 11] {
                    let error = (a[column] / b[column] - 1.0).abs();
                    assert!(error <= 1e-9, "{name}, t = {}, column {column}: {error:e}", a[1]);
                }
            }
            assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-11, "{name}: {summary}");
        }
    }
}

/// Two obstacles leave no gap or almost none: every scheme, element and solver is tested.
#[test]
fn narrow_gaps_hold_with_every_scheme() {
    let folder = folder("hard");
    for scene in ["closed-gap", "tight-gap"] {
        let scene = format!("{}/scenes/hard/{scene}.toml", env!("CARGO_MANIFEST_DIR"));
        let with = ["--with", "petsc,petsc:snes,petsc:tao", "--set", "time.end=3e-4", "--quiet"];
        succeeds(&rebond(&folder, &[&["stability", &scene][..], &with].concat()));
    }
}

#[test]
fn what_a_method_cannot_solve_is_solved_again_and_counted() {
    let folder = folder("retries");
    let all = ["--engine", "petsc", "--set", "solver.vi=snes", "--", "-snes_max_it", "1"];
    let all = [&all[..], &["-snes_linesearch_type", "bt", "-safe_snes_max_it", "1", "-snes_atol", "1e-30"]]
        .concat();
    let output = run(&folder, 1, &all);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    assert_eq!(said.matches("SNES ended a step with DIVERGED_").count(), 1, "{said}");
    let (native, _) = result(&folder, "native", 0, &[]);
    let (rows, summary) = result(&folder, "again", 2, &all);
    assert_agree(&rows, &native, "again");
    assert_eq!(summary["retries"], summary["contact_steps"]);
    assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10);
}

#[test]
fn every_step_can_be_left_to_the_method() {
    let folder = folder("always");
    let short = [
        "--engine",
        "petsc",
        "--set",
        "time.step=1e-5",
        "--set",
        "time.end=0.001",
        "--set",
        "solver.vi=snes",
    ];
    for (always, iterations) in [(&[][..], 0), (&["--", "-rebond_always_iterate"][..], 101)] {
        let (_, summary) = result(&folder, "always", 0, &[&short[..], always].concat());
        assert!(summary["vi_iterations"].as_u64().unwrap() >= iterations);
        assert_eq!(summary["vi_iterations"] == 0, iterations == 0);
    }
}

#[test]
fn options_reach_the_solver() {
    let folder = folder("options");
    let all = ["--engine", "petsc", "--set", "solver.vi=snes", "--", "-snes_monitor"];
    for ranks in [0, 2] {
        let output = run(&folder, ranks, &all);
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success() && said.contains("1 SNES Function norm"), "{said}");
    }
    // Conjugate gradients replace the factor.
    for vi in ["condensed", "snes"] {
        let solver = format!("solver.vi={vi}");
        let all = ["--engine", "petsc", "--set", &solver];
        let all = [&all[..], &["--", "-ksp_type", "cg", "-pc_type", "jacobi"]].concat();
        let (rows, _) = result(&folder, vi, 1, &all);
        assert_agree(&rows, &result(&folder, "native", 0, &[]).0, vi);
    }
    // An option that prints a solver is no misspelt option, even if no step needs the solver.
    let all = ["--engine", "petsc", "--set", "time.end=1e-4", "--set", "solver.vi=snes", "--", "-snes_view"];
    assert!(run(&folder, 1, &all).status.success());
}

#[test]
fn what_cannot_work_is_refused_by_name() {
    let folder = folder("refused");
    let cases: [(&[&str], i32, &[&str]); 11] = [
        (&["--set", "solver.vi=tao", "--", "-tao_type", "bqpip"], 2, &["bqpip", "wrong"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "ssils"], 2, &["ssils", "constraints"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "almm"], 2, &["almm", "constraints"]),
        (&["--set", "solver.vi=tao", "--", "-tao_type", "lmvm"], 2, &["lmvm", "not support bounds"]),
        (&["--set", "solver.vi=snes", "--", "-snes_type", "newtonls"], 2, &["newtonls", "vinewtonrsls"]),
        (&["--set", "solver.vi=snes", "--", "-snes_linesearch_type", "nleqerr"], 2, &["nleqerr", "Jacobian"]),
        (&["--set", "solver.vi=snes", "--", "-safe_snes_linesearch_type", "l3"], 2, &["l3", "l2, basic"]),
        (&["--set", "solver.vi=snes", "--", "-snes_atol", "nan"], 2, &["`-snes_atol nan`", "not a number"]),
        (&["--", "-pc_factor_mat_solver_type", "superlu_dist"], 2, &["superlu_dist", "memory"]),
        (
            &["--set", "solver.vi=snes", "--", "-snes_linesearch_typ", "l2"],
            2,
            &["did you mean `-snes_linesearch_type`"],
        ),
        (&["--set", "solver.vi=snes", "--set", "solver.tolerance=1e-30"], 3, &["asked for 1.0e-30"]),
    ];
    // On two ranks only some of each kind are run, since each start of the launcher takes time.
    for (ranks, every) in [(0, 1), (2, 3)] {
        for (arguments, code, words) in cases.into_iter().rev().step_by(every) {
            let output = run(&folder, ranks, &[&["--engine", "petsc"][..], arguments].concat());
            let said = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
            for word in words {
                assert!(said.contains(word), "{arguments:?}: no {word:?} in {said}");
            }
        }
    }
}
