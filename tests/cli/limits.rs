//! Scenes that are too large for the available memory, and files that are no scenes: the program
//! answers with one message before it builds anything.

use crate::common::command;
use crate::common::command::{assert_fails, rebond, succeeds, text};
use crate::common::models::{CLAMPED, PAPER_SECTION, literal};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENE: &str = concat!(
    literal!(PAPER_FALL),
    r#"
mesh = { element = "fvs", cells = [10, 4] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 1e-3 }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("limits-{test}"), SCENE)
}

/// Calls the command with a limit on its address space, in KB.
///
/// With PETSc, OpenBLAS reserves address space for each of its threads, 140 MB or more, and ends
/// the program where it does not suffice. With one thread the remainder does not depend on the
/// number of cores.
fn within(folder: &Path, kilobytes: u64, arguments: &[&str]) -> Output {
    let script = format!("ulimit -v {kilobytes}; exec \"$@\"");
    Command::new("sh")
        .args(["-c", &script, "sh", env!("CARGO_BIN_EXE_rebond")])
        .args(arguments)
        .env("OPENBLAS_NUM_THREADS", "1")
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Limit for small runs, in KB. The program with its libraries takes 60 MB of it.
const TIGHT: u64 = 250_000;

#[test]
fn what_does_not_fit_is_refused_before_it_is_built() {
    let folder = folder("fits");
    let large = ["--set", "mesh.cells=[2000, 2000]"];
    let words =
        ["a run with 4000000 cells takes about ", " GB of memory, and ", "mesh.cells = [", "] would fit"];
    let commands = [&["run", "fall.toml"][..], &["check", "fall.toml"], &["inspect", "fall.toml"]];
    for command in commands {
        assert_fails(&within(&folder, 2_000_000, &[command, &large].concat()), 2, &words);
    }
    assert!(!folder.join("runs").exists());
    for scheme in ["time.scheme=exact", "time.scheme=conserving", "mesh.element=hct"] {
        let check = [&["check", "fall.toml", "--set", scheme], &large[..]].concat();
        assert_fails(&within(&folder, 2_000_000, &check), 2, &words[1..]);
    }
    let refined = ["check", "fall.toml", "--set", "mesh.refine=8"];
    assert_fails(&within(&folder, 2_000_000, &refined), 2, &["a run with 2621440 cells", "cells would fit"]);
    // The mesh that the message suggests is accepted.
    let said =
        text(&within(&folder, 1_000_000, &["check", "fall.toml", "--set", "mesh.cells=[800, 300]"]).stderr);
    let cells = &said[said.find("mesh.cells").unwrap()..said.find(" would fit").unwrap()];
    let numbers: Vec<f64> =
        cells.split(|c: char| !c.is_ascii_digit()).filter_map(|number| number.parse().ok()).collect();
    assert!(numbers[0] > 200.0 && numbers[1] > 80.0 && numbers[0] < 800.0, "{said}");
    // Comparisons and studies report each contender that does not fit.
    let compare = [&["compare", "fall.toml", "--with", "native"], &large[..]].concat();
    let output = within(&folder, 2_000_000, &compare);
    assert!([2, 3].contains(&output.status.code().unwrap()), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("of memory, and"), "{}", text(&output.stderr));
    // No machine has memory for this many cells.
    assert_fails(
        &rebond(&folder, &["check", "fall.toml", "--set", "mesh.cells=[1000000, 1000000]"]),
        2,
        &["too many"],
    );
}

#[cfg(feature = "petsc")]
#[test]
fn petsc_is_not_started_for_what_does_not_fit() {
    let folder = folder("petsc");
    let run = ["run", "fall.toml", "--engine", "petsc", "--set", "mesh.cells=[2000, 2000]"];
    assert_fails(&within(&folder, 2_000_000, &run), 2, &["a run with 4000000 cells", "would fit"]);
}

/// Asserts that with any number of cells the answer is a report or one message.
fn any_size(test: &str, limit: u64, cells: impl Iterator<Item = [u32; 2]>) {
    let folder = folder(test);
    let (mut refused, mut done) = (0, 0);
    for [nx, ny] in cells {
        let setting = format!("mesh.cells=[{nx}, {ny}]");
        let output = within(&folder, limit, &["check", "fall.toml", "--set", &setting]);
        match output.status.code() {
            Some(0) => done += 1,
            _ => {
                assert_fails(&output, 2, &["of memory, and ", " would fit"]);
                refused += 1;
            }
        }
    }
    assert!(done > 0 && refused > 0, "{done} done, {refused} refused");
}

#[test]
fn a_limit_is_no_abort() {
    any_size("abort", TIGHT, [[20, 8], [500, 200]].into_iter());
}

#[test]
#[ignore = "minutes"]
fn no_size_is_an_abort() {
    any_size("aborts", TIGHT, (1..=50).map(|step| [10 * step, 4 * step]));
}

#[test]
fn what_is_no_scene_is_not_read() {
    let folder = folder("files");
    for (file, words) in [
        ("/dev/zero", "/dev/zero: a device, pipe or socket; expected a file"),
        (".", ".: a folder; expected a file"),
        ("large.toml", "large.toml: the file has 5.0 MB; expected at most 4.0 MB"),
        ("pipe", "pipe: a device, pipe or socket; expected a file"),
    ] {
        let made = match file {
            "pipe" => Command::new("mkfifo").arg(folder.join(file)).status().unwrap().success(),
            "large.toml" => fs::write(folder.join(file), vec![b'#'; 5_000_000]).is_ok(),
            _ => true,
        };
        assert!(made);
        for command in ["run", "check", "inspect", "study", "compare", "stability"] {
            let output = rebond(&folder, &[command, file]);
            // The command stability accepts folders of scenes.
            if (command, file) != ("stability", ".") {
                assert_fails(&output, 4, &[words]);
            }
        }
    }
    // The same holds for meshes and tables.
    let mesh = ["check", "fall.toml", "--set"];
    let without = format!(
        "plate = {{ {PAPER_SECTION} }}\n{CLAMPED}\
         time = {{ scheme = \"newmark\", mass = \"singular\", step = 1e-4, end = 1e-3 }}\n"
    );
    fs::write(folder.join("mesh.toml"), format!("{without}mesh.file = \"pipe\"\n")).unwrap();
    assert_fails(&rebond(&folder, &["check", "mesh.toml"]), 4, &["pipe: a device, pipe or socket"]);
    assert_fails(&rebond(&folder, &["run", "mesh.toml"]), 4, &["pipe: a device, pipe or socket"]);
    let table = "load.pressure={ table = '/dev/zero', interpolation = 'linear' }";
    let output = rebond(&folder, &[&mesh[..], &[table]].concat());
    assert_fails(&output, 2, &["load.pressure.table: /dev/zero: a device, pipe or socket"]);
    succeeds(&rebond(&folder, &["check", "fall.toml", "--quiet"]));
}

/// A small stack is no abort.
#[test]
fn a_small_stack_suffices() {
    let folder = folder("stack");
    let output = Command::new("sh")
        .args(["-c", "ulimit -s 64; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_rebond")])
        .args(["run", "fall.toml", "--quiet"])
        .current_dir(&folder)
        .output()
        .unwrap();
    succeeds(&output);
}

/// A number with which nothing can be computed is refused with its key, and one that is far from
/// the usual is named beside the error that it causes, without hundreds of zeros.
#[test]
fn a_number_out_of_range_is_named() {
    let folder = folder("range");
    for (key, value, words) in [
        ("plate.density", "1e100", "1e100 is beyond 1e50 in magnitude; expected a density in kg/m3"),
        ("plate.density", "1e-310", "1e-310 is below 1e-300 in magnitude, and not 0; expected a density"),
        ("plate.length", "1e300", "1e300 is beyond 1e50 in magnitude"),
        ("plate.length", "1e25", "(1.25e24, 0)"),
        ("load.pressure", "\"1e60*2\"", "is beyond 1e50 in magnitude"),
        ("plate.youngs_modulus", "1e-280", "plate.youngs_modulus"),
    ] {
        let set = ["--set", "mesh.cells=[8, 2]", "--set", &format!("{key}={value}")];
        let output = rebond(&folder, &[&["run", "fall.toml"], &set[..]].concat());
        assert_fails(&output, 2, &[key, words]);
        assert!(!text(&output.stderr).contains("000000"), "{}", text(&output.stderr));
    }
}

/// A name that a spreadsheet would take for a formula heads no column.
#[test]
fn a_name_is_no_formula() {
    let folder = folder("formula");
    for name in ["=1+1", "+1", "-1", "@sum", " =1", "a\tb"] {
        let probe = format!("output.probes=[{{ name = {name:?}, at = [0.6, 0.1] }}]");
        assert_fails(
            &rebond(&folder, &["check", "fall.toml", "--set", &probe]),
            2,
            &["cannot head a column"],
        );
    }
}
