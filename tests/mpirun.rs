//! The command under mpirun: the same numbers as in one process, one voice, and an end to everything.
#![cfg(feature = "petsc")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The paper's plate, coarse, to its first impact.
const SHORT: &str = r#"
title = "a short fall"
plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
mesh = { element = "fvs", cells = [4, 2] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.1 }]
initial = { static_pressure = 14600 }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.07 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "inside", at = [0.7, 0.15] }] }
"#;

/// The paper's scenes with each element.
const FVS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig2.toml");
const HCT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig1.toml");

/// A folder of its own for a test, with a scene.
fn folder(test: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("mpirun-{test}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("fall.toml"), SHORT).unwrap();
    folder
}

/// The command under mpirun; root may, as in a container.
fn mpirun(folder: &Path, ranks: usize, arguments: &[&str]) -> Command {
    let mut command = Command::new("mpirun");
    command
        .args(["--oversubscribe", "--mca", "mpi_yield_when_idle", "1", "--timeout", "200", "-n"])
        .arg(ranks.to_string())
        .arg(env!("CARGO_BIN_EXE_rebond"))
        .args(arguments)
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env_remove("PETSC_OPTIONS")
        .current_dir(folder);
    command
}

/// Lets one job run at a time: its ranks already share the cores.
fn finish(command: &mut Command) -> Output {
    static TURN: Mutex<()> = Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    command.output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// Asserts an exit code and one message of one line with some words; mpirun adds its own.
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let said = format!("{}{}", text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "{said}");
    let ours: Vec<&str> = said.lines().filter(|line| line.contains("rebond: ")).collect();
    assert_eq!(ours.len(), 1, "{said}");
    for word in words {
        assert!(ours[0].contains(word), "no {word:?} in: {said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

/// Runs natively in one process, and returns its history.
fn natively(folder: &Path, arguments: &[&str]) -> Vec<Vec<f64>> {
    let out = ["--quiet", "--engine", "native", "--out", "native"];
    let output = Command::new(env!("CARGO_BIN_EXE_rebond"))
        .arg("run")
        .args(arguments)
        .args(out)
        .current_dir(folder)
        .output();
    succeeds(&output.unwrap());
    history(&folder.join("native"))
}

/// Runs on some ranks, and returns the history.
fn on(folder: &Path, ranks: usize, arguments: &[&str]) -> Vec<Vec<f64>> {
    let out = format!("on-{ranks}");
    let arguments = [&["run"], arguments, &["--quiet", "--engine", "petsc", "--out", &out]].concat();
    succeeds(&finish(&mut mpirun(folder, ranks, &arguments)));
    history(&folder.join(out))
}

/// The rows of history.csv.
fn history(run: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(run.join("history.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|number| number.parse().unwrap()).collect()).collect()
}

/// Asserts the same rows, with deflections (from column 10 on) to 1e-8 m and energies to 1e-8 of the start.
fn assert_agree(one: &[Vec<f64>], other: &[Vec<f64>]) {
    assert_eq!(one.len(), other.len());
    for (a, b) in one.iter().zip(other) {
        assert_eq!((a[0], a[1], a[6]), (b[0], b[1], b[6]), "step, time, nodes in contact");
        assert!((a[2] - b[2]).abs() <= 1e-8 * one[0][2].abs(), "energy {} or {}", a[2], b[2]);
        for (a, b) in a[10..].iter().zip(&b[10..]) {
            assert!((a - b).abs() <= 1e-8, "{a} or {b} m");
        }
    }
}

fn any_number_of_ranks(test: &str, scene: &str) {
    let folder = folder(test);
    // Where ranks share cores, a step takes long.
    for (ranks, step) in [(2, "time.step=1e-5"), (3, "time.step=1e-4"), (4, "time.step=1e-4")] {
        let arguments = [scene, "--set", "time.end=0.1", "--set", "output.every=5", "--set", step];
        let native = natively(&folder, &arguments);
        assert!(native.iter().any(|row| row[6] > 0.0), "something touches");
        assert_agree(&on(&folder, ranks, &arguments), &native);
    }
}

#[test]
fn quadrilaterals_move_the_same_on_any_number_of_ranks() {
    any_number_of_ranks("fvs", FVS);
}

#[test]
fn triangles_move_the_same_on_any_number_of_ranks() {
    any_number_of_ranks("hct", HCT);
}

#[test]
fn the_energy_is_kept_on_any_number_of_ranks() {
    let folder = folder("conserving");
    for (ranks, element) in [(2, "mesh.element=fvs"), (2, "mesh.element=hct"), (3, "mesh.element=hct")] {
        let arguments =
            ["fall.toml", "--set", "time.scheme=conserving", "--set", "time.step=1e-3", "--set", element];
        let rows = on(&folder, ranks, &[&arguments[..], &["--set", "output.every=1"]].concat());
        assert!(rows.iter().any(|row| row[6] > 0.0), "something touches");
        for row in &rows {
            assert!((row[2] / rows[0][2] - 1.0).abs() <= 1e-9, "t = {}: {} J", row[1], row[2]);
        }
        let summary = std::fs::read(folder.join(format!("on-{ranks}/summary.json"))).unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
        assert!(summary["relaxation"]["relaxed_steps"].as_u64().unwrap() > 0, "{summary}");
    }
}

#[test]
fn one_rank_twice_writes_the_same_bytes() {
    let folder = folder("twice");
    let bytes = || {
        on(&folder, 1, &["fall.toml"]);
        std::fs::read(folder.join("on-1/history.csv")).unwrap()
    };
    assert_eq!(bytes(), bytes());
}

#[test]
fn rank_0_speaks_and_writes_alone() {
    let folder = folder("voice");
    // A scene that names no engine runs on PETSc where there are several processes.
    let output = finish(&mut mpirun(&folder, 2, &["run", "fall.toml"]));
    let said = succeeds(&output);
    for words in ["a short fall", "engine: petsc, 2 ranks", "effects:", "first impact", "written to"] {
        assert_eq!(said.matches(words).count(), 1, "{words:?} in:\n{said}");
    }
    assert_agree(&history(&folder.join("runs/fall")), &natively(&folder, &["fall.toml"]));
    let summary = std::fs::read(folder.join("runs/fall/summary.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    assert_eq!((&summary["status"], &summary["dofs"]), (&"done".into(), &36.into()));
}

#[test]
fn some_ranks_may_have_nothing() {
    let folder = folder("nothing");
    for cells in ["mesh.cells=[1, 1]", "mesh.cells=[2, 1]"] {
        for element in ["mesh.element=fvs", "mesh.element=hct"] {
            let arguments = ["fall.toml", "--set", cells, "--set", element];
            assert_agree(&on(&folder, 4, &arguments), &natively(&folder, &arguments));
        }
    }
    let free = ["fall.toml", "--set", "obstacle=[]"];
    assert_agree(&on(&folder, 4, &free), &natively(&folder, &free));
}

#[test]
fn meshes_refined_in_parallel_move_the_same() {
    let folder = folder("refined");
    for element in ["mesh.element=fvs", "mesh.element=hct"] {
        let arguments = ["fall.toml", "--set", "mesh.refine=1", "--set", element];
        assert_agree(&on(&folder, 2, &arguments), &natively(&folder, &arguments));
    }
}

#[test]
fn compare_measures_the_difference_on_any_number_of_ranks() {
    let folder = folder("compare");
    for ranks in [1, 2, 4] {
        let arguments = ["compare", "fall.toml", "--with", "native,petsc", "--json"];
        let said = succeeds(&finish(&mut mpirun(&folder, ranks, &arguments)));
        let value: serde_json::Value = serde_json::from_str(&said).unwrap();
        assert_eq!(value["ranks"], ranks);
        for entry in value["entries"].as_array().unwrap() {
            assert_eq!((&entry["steps"], &entry["failure"]), (&700.into(), &serde_json::Value::Null));
            assert!(entry["difference"].as_f64().unwrap() < 1e-12, "{entry}");
            assert_eq!(
                entry["difference_up_to_impact"].as_array().unwrap().len(),
                value["impacts"].as_array().unwrap().len()
            );
            assert!(entry["worst_kkt"].as_f64().unwrap() < 1e-10, "{entry}");
        }
    }
    // A contender that fails is a row with its reason.
    let arguments = ["compare", "fall.toml", "--with", "native,petsc", "--", "-pc_type", "nosuch"];
    let said = succeeds(&finish(&mut mpirun(&folder, 2, &arguments)));
    assert!(said.contains("PCSetType(): Unable to find requested PC type nosuch"), "{said}");
}

#[test]
fn what_all_ranks_find_wrong_is_said_once() {
    let folder = folder("wrong");
    let run = |ranks, arguments: &[&str]| {
        finish(&mut mpirun(&folder, ranks, &[&["run", "fall.toml"], arguments].concat()))
    };
    for ranks in [2, 4] {
        assert_fails(
            &run(ranks, &["--set", "plate.thickness=-1"]),
            2,
            &["plate.thickness", "greater than 0"],
        );
        assert_fails(&run(ranks, &["--set", "support=[]"]), 2, &["static_pressure", "mechanism"]);
        assert_fails(&run(ranks, &["--engine", "native"]), 2, &["one process", "--engine petsc"]);
        assert_fails(&run(ranks, &["--", "-pc_typ", "lu"]), 2, &["`-pc_typ`", "did you mean `-pc_type`?"]);
        assert_fails(&run(ranks, &["--", "-pc_type", "nosuch"]), 3, &["PCSetType()", "nosuch"]);
        assert_fails(&run(ranks, &["--set", "solver.tolerance=1e-18"]), 3, &["KKT", "1.0e-18"]);
    }
    assert_fails(&finish(&mut mpirun(&folder, 2, &["check", "fall.toml"])), 2, &["check", "one process"]);
    let wrong = finish(&mut mpirun(&folder, 2, &["run"]));
    assert_eq!((wrong.status.code(), text(&wrong.stderr).matches("Usage:").count()), (Some(2), 1));
    // Only rank 0 writes, and only it can fail to.
    assert_fails(&run(2, &["--out", "fall.toml/run"]), 4, &["fall.toml"]);
}

#[test]
fn a_killed_rank_ends_all() {
    let folder = folder("killed");
    let mut job =
        mpirun(&folder, 2, &["run", "fall.toml", "--quiet", "--set", "time.end=1000"]).spawn().unwrap();
    let start = Instant::now();
    // Its rows are buffered: the file's presence says that the run has begun.
    while !folder.join("runs/fall/history.csv").exists() {
        assert!(start.elapsed() < Duration::from_secs(60) && job.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(50));
    }
    let ranks = children(job.id());
    assert_eq!(ranks.len(), 2);
    assert!(Command::new("kill").args(["-9", &ranks[1].to_string()]).status().unwrap().success());
    let start = Instant::now();
    let status = loop {
        if let Some(status) = job.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > Duration::from_secs(20) {
            job.kill().unwrap();
            unreachable!("the others go on");
        }
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(!status.success());
    while runs(ranks[0]) {
        assert!(start.elapsed() < Duration::from_secs(20), "rank 0 goes on");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// State and parent of a process.
fn state(process: u32) -> Option<(String, u32)> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // They come after the name in parentheses.
    let mut words = stat.rsplit(')').next()?.split_whitespace();
    Some((words.next()?.into(), words.next()?.parse().ok()?))
}

/// Whether a process is there and not a zombie.
fn runs(process: u32) -> bool {
    state(process).is_some_and(|(state, _)| state != "Z" && state != "X")
}

/// The processes that a process started.
fn children(parent: u32) -> Vec<u32> {
    let is_child = |&process: &u32| state(process).is_some_and(|(_, of)| of == parent);
    let all = std::fs::read_dir("/proc").unwrap();
    let mut found: Vec<u32> =
        all.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok()).filter(is_child).collect();
    found.sort_unstable();
    found
}
